"""Tiny roads drawn from a few lines: lane groups given from left to right, connectors as smooth curves between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from interplan_sumo.world.geometry import Floats, Polyline
from interplan_sumo.world.roads import (
    Connector,
    DrivingSide,
    Intersection,
    Lane,
    Roadblock,
    Roads,
    StopLine,
    StopLineKind,
    Turn,
)

WIDTH_M = 3.5


@dataclass(frozen=True)
class Ways:
    """Connectors from one roadblock to another, as pairs of lane places counted from the left."""

    start: str
    end: str
    pairs: tuple[tuple[int, int], ...] = ((0, 0),)
    stop_line: str | None = None
    turn: Turn = Turn.UNKNOWN
    limit_mps: float | None = 8.0


def straight(start: tuple[float, float], end: tuple[float, float]) -> Floats:
    """A straight line with a vertex every metre."""
    a, b = np.array(start), np.array(end)
    share = np.linspace(0.0, 1.0, int(np.ceil(np.hypot(*(b - a)))) + 1)[:, None]
    return a + (b - a) * share


def beside(points: Floats, right_m: float) -> Floats:
    """A line moved to its right, vertex by vertex."""
    ahead = np.asarray(np.gradient(points, axis=0))
    to_right = np.stack((ahead[:, 1], -ahead[:, 0]), axis=1)
    return points + right_m * to_right / np.hypot(ahead[:, 0], ahead[:, 1])[:, None]


def curve(start: Floats, start_rad: float, end: Floats, end_rad: float) -> Floats:
    """A smooth turn between two poses."""
    reach = 0.4 * np.hypot(*(end - start))
    p1 = start + reach * np.array([np.cos(start_rad), np.sin(start_rad)])
    p2 = end - reach * np.array([np.cos(end_rad), np.sin(end_rad)])
    t = np.linspace(0.0, 1.0, max(4, int(np.hypot(*(end - start)) / 0.5)))[:, None]
    return (1 - t) ** 3 * start + 3 * t * (1 - t) ** 2 * p1 + 3 * t**2 * (1 - t) * p2 + t**3 * end


def small_roads(
    groups: Mapping[str, Sequence[Floats]],
    ways: Sequence[Ways] = (),
    *,
    side: DrivingSide = "right",
    limits: Mapping[str, float | None] | None = None,
    signs: Mapping[str, StopLineKind] | None = None,
    intersection: str | None = "900",
) -> Roads:
    """The roads of these lane groups; lane ids are the roadblock's followed by the place from the left.

    `signs` puts a stop line of some kind across the end of a roadblock.
    """
    lanes: dict[str, Lane] = {}
    blocks: dict[str, Roadblock] = {}
    stops: dict[str, StopLine] = {}
    for block, lines in groups.items():
        ids = tuple(f"{block}{k}" for k in range(len(lines)))
        for k, (lane_id, points) in enumerate(zip(ids, lines, strict=True)):
            limit = (limits or {}).get(block, 13.89)
            lanes[lane_id] = Lane(lane_id, block, k, *_shapes(points), limit)
        blocks[block] = Roadblock(block, _around([lanes[i].polygon for i in ids]), ids)
    for number, (block, kind) in enumerate((signs or {}).items()):
        ends = shapely.MultiPoint([lanes[i].centerline.points[-1] for i in blocks[block].lane_ids])
        stops[str(800 + number)] = StopLine(str(800 + number), ends.convex_hull.buffer(0.5), kind)
    connectors: dict[str, Connector] = {}
    for number, way in enumerate(ways):
        block = str(7000 + number)
        for a, b in way.pairs:
            before, after = lanes[f"{way.start}{a}"].centerline, lanes[f"{way.end}{b}"].centerline
            points = curve(
                before.points[-1], before.segment_heading_rad[-1], after.points[0], after.segment_heading_rad[0]
            )
            id_ = str(70000 + 100 * number + 10 * a + b)
            if way.stop_line is not None and way.stop_line not in stops:
                stops[way.stop_line] = StopLine(
                    way.stop_line, shapely.Point(before.points[-1]).buffer(0.5), StopLineKind.TRAFFIC_LIGHT
                )
            connectors[id_] = Connector(
                id_, block, f"{way.start}{a}", f"{way.end}{b}", *_shapes(points), way.limit_mps, way.turn,
                () if way.stop_line is None else (way.stop_line,),
            )  # fmt: skip
        own = tuple(c.id for c in connectors.values() if c.roadblock_id == block)
        blocks[block] = Roadblock(
            block, _around([connectors[c].polygon for c in own]), own, True, way.start, way.end, intersection
        )
    area = _around([c.polygon for c in connectors.values()]) if connectors else shapely.Point(0, 0).buffer(1.0)
    return Roads(
        "small", "EPSG:32611", side, lanes, connectors, blocks,
        () if intersection is None else (Intersection(intersection, area),), stops,
    )  # fmt: skip


def crossing(
    *, side: DrivingSide = "right", lit: bool = False, signs: Mapping[str, StopLineKind] | None = None,
    limits: Mapping[str, float | None] | None = None, arms: str = "NESW",
) -> Roads:  # fmt: skip
    """Two-way streets of one lane each way that meet at (0, 0); roadblock 1x comes in on arm x, 2x goes out."""
    near, far, half = 12.0, 112.0, WIDTH_M / 2 * (1.0 if side == "right" else -1.0)
    number = {"N": 1, "E": 2, "S": 3, "W": 4}
    out = {"N": (0, 1), "E": (1, 0), "S": (0, -1), "W": (-1, 0)}
    groups: dict[str, list[Floats]] = {}
    for arm in arms:
        x, y = out[arm]
        to, back = f"1{number[arm]}", f"2{number[arm]}"
        groups[to] = [beside(straight((far * x, far * y), (near * x, near * y)), half)]
        groups[back] = [beside(straight((near * x, near * y), (far * x, far * y)), half)]
    ways = [
        Ways(f"1{number[a]}", f"2{number[b]}", stop_line=f"9{number[a]}" if lit else None)
        for a in arms
        for b in arms
        if a != b
    ]
    return small_roads(groups, ways, side=side, signs=signs, limits=limits)


def _shapes(points: Floats) -> tuple[Polyline, shapely.Polygon, Polyline, Polyline]:
    line = shapely.LineString(points)
    polygon = line.buffer(WIDTH_M / 2, cap_style="flat")
    left, right = (shapely.get_coordinates(line.offset_curve(s * WIDTH_M / 2)) for s in (1, -1))
    return Polyline(points), polygon, Polyline(left), Polyline(right)


def _around(polygons: Sequence[shapely.Polygon]) -> shapely.Polygon:
    hull = shapely.MultiPolygon(list(polygons)).convex_hull
    assert isinstance(hull, shapely.Polygon)
    return hull
