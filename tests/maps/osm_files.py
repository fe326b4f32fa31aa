"""OpenStreetMap extracts for tests, written from a few words; places are metres east and north of a point in Munich."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

MUNICH = (11.55, 48.15)
METRES_PER_DEGREE = 111_320.0


def tags(named: Mapping[str, str]) -> str:
    return "".join(f'<tag k="{key}" v="{value}"/>' for key, value in named.items())


def node(id_: int, x_m: float, y_m: float, *, at: tuple[float, float] = MUNICH, **named: str) -> str:
    longitude = at[0] + x_m / (METRES_PER_DEGREE * math.cos(math.radians(at[1])))
    return f'<node id="{id_}" lon="{longitude:.8f}" lat="{at[1] + y_m / METRES_PER_DEGREE:.8f}">{tags(named)}</node>'


def way(id_: int, nodes: Sequence[int], **named: str) -> str:
    refs = "".join(f'<nd ref="{one}"/>' for one in nodes)
    return f'<way id="{id_}">{refs}{tags(named)}</way>'


def osm(*parts: str) -> str:
    return f'<?xml version="1.0"?>\n<osm version="0.6">{"".join(parts)}</osm>\n'


def written(folder: Path, text: str, name: str = "town.osm") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def crossing(at: tuple[float, float] = MUNICH, **more: str) -> str:
    """Two streets of 300 m that cross under a light, with a limit and sidewalks on the one, and a footway beside."""
    ends = ((2, -150, 0), (3, 150, 0), (4, 0, -150), (5, 0, 150))
    return "".join(
        (
            node(1, 0, 0, at=at, highway="traffic_signals"),
            *(node(id_, x, y, at=at) for id_, x, y in ends),
            way(10, (2, 1, 3), highway="secondary", maxspeed="30", lanes="2", sidewalk="both", **more),
            way(11, (4, 1, 5), highway="tertiary", lanes="2", sidewalk="both"),
            way(12, (2, 4), highway="footway"),
            way(13, (3, 5), highway="service"),
        )
    )


def roundabout(first: int, x_m: float, *, clockwise: bool, at: tuple[float, float] = MUNICH) -> str:
    turn = -1 if clockwise else 1
    corners = [(20 * math.cos(k * math.pi / 4), turn * 20 * math.sin(k * math.pi / 4)) for k in range(8)]
    nodes = [node(first + k, x_m + x, y, at=at) for k, (x, y) in enumerate(corners)]
    ring = (*range(first, first + 8), first)
    return "".join(nodes) + way(first + 100, ring, highway="residential", junction="roundabout")
