"""Argoverse 2 map files for tests: small tiles made by hand, and where the real ones lie."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

MAP_NAME = "log_map_archive_0123abcd-0000-4000-8000-000000000000____PIT_city_42.json"

Point = Sequence[float]


def line(*points: Point) -> list[dict[str, float]]:
    """Points of two or three numbers as the files have them."""
    return [{"x": p[0], "y": p[1], "z": p[2] if len(p) > 2 else 0.0} for p in points]


def lane(id_: int, left: Sequence[Point], right: Sequence[Point], **fields: Any) -> dict[str, Any]:
    """One lane for cars, alone in the world unless `fields` tell more."""
    return {
        "id": id_,
        "is_intersection": False,
        "lane_type": "VEHICLE",
        "left_lane_boundary": line(*left),
        "left_lane_mark_type": "NONE",
        "left_neighbor_id": None,
        "predecessors": [],
        "right_lane_boundary": line(*right),
        "right_lane_mark_type": "NONE",
        "right_neighbor_id": None,
        "successors": [],
        **fields,
    }


def straight(id_: int, start_m: float, end_m: float, left_m: float, z_m: float = 0.0, **fields: Any) -> dict[str, Any]:
    """A lane 3 m wide along x, eastward if `end_m` is larger; `left_m` is y of its left boundary."""
    right_m = left_m - 3.0 if end_m > start_m else left_m + 3.0
    ends = [(start_m, end_m), (start_m, end_m)]
    left, right = ([(x, y, z_m) for x in xs] for xs, y in zip(ends, (left_m, right_m), strict=True))
    return lane(id_, left, right, **fields)


def tile(*lanes: dict[str, Any], crossings: Sequence[Any] = (), areas: Sequence[Any] = ()) -> dict[str, Any]:
    """The content of a file."""
    layers = {"lane_segments": lanes, "pedestrian_crossings": crossings, "drivable_areas": areas}
    return {name: {str(row["id"]): row for row in rows} for name, rows in layers.items()}


def street() -> dict[str, Any]:
    """Two lanes eastward and one westward, 40 m long, then 20 m of an intersection; a cycle lane; a crossing.

    Lanes 1 (left) and 2 go east, 3 comes back on their left, 4 follows 1 in
    the intersection, 5 is the cycle lane right of 2 and follows nothing.
    """
    return tile(
        straight(1, 0.0, 40.0, 0.0, successors=[4], left_neighbor_id=3, right_neighbor_id=2),
        straight(2, 0.0, 40.0, -3.0, left_neighbor_id=1, right_neighbor_id=5, successors=[900], predecessors=[901]),
        straight(3, 40.0, 0.0, 0.0, left_neighbor_id=1),
        straight(4, 40.0, 60.0, 0.0, is_intersection=True, successors=[5]),
        straight(5, 0.0, 40.0, -6.0, lane_type="BIKE", left_neighbor_id=2),
        crossings=[{"id": 7, "edge1": line((30.0, -6.0), (30.0, 3.0)), "edge2": line((33.0, -6.0), (33.0, 3.0))}],
        areas=[{"id": 8, "area_boundary": line((-1.0, -10.0), (61.0, -10.0), (61.0, 4.0), (-1.0, 4.0))}],
    )


def written(content: Any, folder: Path, name: str = MAP_NAME) -> Path:
    path = folder / name
    path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return path
