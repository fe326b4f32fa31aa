"""Roads drawn from a few lines: crossings, streets of any shape, and grid cities with every kind of thing in them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count, cycle

import numpy as np
import shapely

from interplan_sumo.world.geometry import Floats, Polyline
from interplan_sumo.world.roads import (
    Area,
    Connector,
    DrivingSide,
    Intersection,
    IntersectionKind,
    Lane,
    Roadblock,
    Roads,
    StopLine,
    StopLineKind,
    Turn,
)

WIDTH_M = 3.5
KERB_M = 6.0
"""From the outermost lane to the corner of a junction of a grid."""


@dataclass(frozen=True)
class Ways:
    """Connectors from one roadblock to another, as pairs of lane places counted from the left."""

    start: str
    end: str
    pairs: tuple[tuple[int, int], ...] = ((0, 0),)
    stop_line: str | None = None
    turn: Turn = Turn.UNKNOWN
    limit_mps: float | None = 8.0
    intersection: str | None = None
    """None: that of all."""


def straight(start: Sequence[float] | Floats, end: Sequence[float] | Floats) -> Floats:
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
    id_of: Callable[[str], str] = lambda name: name.lstrip("abcdefghijklmnopqrstuvwxyz"),
) -> Roads:
    """The roads of these lane groups; lane ids are the roadblock's followed by the place from the left.

    `signs` puts a stop line of some kind across the end of a roadblock. `id_of` turns a letter and a number into an id.
    """
    lanes: dict[str, Lane] = {}
    connectors: dict[str, Connector] = {}
    blocks: dict[str, Roadblock] = {}
    stops: dict[str, StopLine] = {}
    inside: dict[str, list[shapely.Polygon]] = defaultdict(list)

    def stop(name: str, block: Roadblock, kind: StopLineKind) -> str:
        ends = shapely.MultiPoint([lanes[i].centerline.points[-1] for i in block.lane_ids])
        stops.setdefault(id_of(name), StopLine(id_of(name), rounded(ends.convex_hull.buffer(0.5)), kind))
        return id_of(name)

    for name, lines in groups.items():
        block = id_of(f"b{name}")
        ids = tuple(id_of(f"l{name}{k}") for k in range(len(lines)))
        for k, (lane_id, points) in enumerate(zip(ids, lines, strict=True)):
            lanes[lane_id] = Lane(lane_id, block, k, *_shapes(points), (limits or {}).get(name, 13.89))
        blocks[block] = Roadblock(block, _around([lanes[i].polygon for i in ids]), ids)
    for number, (name, kind) in enumerate((signs or {}).items()):
        stop(f"s{800 + number}", blocks[id_of(f"b{name}")], kind)
    for number, way in enumerate(ways):
        block, start, end = id_of(f"w{7000 + number}"), blocks[id_of(f"b{way.start}")], blocks[id_of(f"b{way.end}")]
        lit = () if way.stop_line is None else (stop(f"s{way.stop_line}", start, StopLineKind.TRAFFIC_LIGHT),)
        own: list[str] = []
        for a, b in way.pairs:
            before, after = lanes[start.lane_ids[a]], lanes[end.lane_ids[b]]
            line = curve(
                before.centerline.points[-1], before.centerline.segment_heading_rad[-1],
                after.centerline.points[0], after.centerline.segment_heading_rad[0],
            )  # fmt: skip
            own.append(id_of(f"c{70000 + 100 * number + 10 * a + b}"))
            connectors[own[-1]] = Connector(
                own[-1], block, before.id, after.id, *_shapes(line), way.limit_mps, way.turn, lit
            )  # fmt: skip
        shapes = [connectors[i].polygon for i in own]
        place = way.intersection or intersection
        where = None if place is None else id_of(f"i{place}")
        if where is not None:
            inside[where] += shapes
        blocks[block] = Roadblock(block, _around(shapes), tuple(own), True, start.id, end.id, where)
    if not ways and intersection is not None:
        inside[id_of(f"i{intersection}")] = [shapely.Point(0, 0).buffer(1.0)]
    places = tuple(Intersection(i, _around(shapes)) for i, shapes in inside.items())
    return Roads("small", "EPSG:32611", side, lanes, connectors, blocks, places, stops)


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


@dataclass(frozen=True)
class GridPlan:
    """What a grid city looks like: junctions in columns and rows, a two-way road between neighbours."""

    columns: int = 2
    rows: int = 1
    lanes: int = 2
    """Per direction."""
    spacing_m: float = 90.0
    side: DrivingSide = "right"
    crs: str = "EPSG:32611"
    origin_m: tuple[float, float] = (664000.0, 3998000.0)
    rotation_rad: float = 0.0
    limits_mps: tuple[float | None, ...] = (13.89,)
    """Dealt out to lanes and connectors in turn."""
    signals: bool = True
    first_id: int = 1


def grid_city(plan: GridPlan = GridPlan(), name: str = "grid") -> Roads:
    """A city of that plan; coordinates are multiples of 1e-6 m."""
    cos, sin = np.cos(plan.rotation_rad), np.sin(plan.rotation_rad)

    def xy(points: Floats) -> Floats:
        return points @ np.array(((cos, sin), (-sin, cos))) + plan.origin_m

    def strip(start: Floats, along: Floats, length_m: float, left_m: float, width_m: float) -> shapely.Polygon:
        """A rectangle from `start` along a direction, its axis moved to the left."""
        left = np.array((-along[1], along[0]))
        near, far = start + left * (left_m + width_m / 2), start + left * (left_m - width_m / 2)
        return rounded(shapely.Polygon(xy(np.array((far, far + along * length_m, near + along * length_m, near)))))

    ids, limits = count(plan.first_id), cycle(plan.limits_mps)
    names: dict[str, str] = defaultdict(lambda: str(next(ids)))
    nodes = [np.array((i, j), dtype=np.float64) for j in range(plan.rows) for i in range(plan.columns)]
    inner, length_m = plan.lanes * WIDTH_M + KERB_M, plan.spacing_m - 2 * (plan.lanes * WIDTH_M + KERB_M)
    outside = -1.0 if plan.side == "right" else 1.0  # the sign of a lateral offset, left positive, towards the kerb
    around = sorted({-plan.columns, -1, 1, plan.columns})
    edges = [
        (a, a + step, nodes[a + step] - nodes[a])
        for a in range(len(nodes))
        for step in around
        if 0 <= a + step < len(nodes)
    ]
    edges = [(a, b, along) for a, b, along in edges if abs(along).sum() == 1.0]  # no end of a row is beside the next
    roadways = [(along, nodes[a] * plan.spacing_m + along * inner) for a, _, along in edges]
    leaving: dict[int, list[tuple[int, Floats]]] = defaultdict(list)
    for k, (node, _, along) in enumerate(edges):
        leaving[node].append((k, along))
    first = 0 if plan.side == "right" else -plan.lanes
    middles = [(first + k + 0.5) * WIDTH_M for k in range(plan.lanes)]
    groups = {
        str(k): [beside(straight(xy(at), xy(at + along * length_m)), right_m) for right_m in middles]
        for k, (along, at) in enumerate(roadways)
    }
    ways: list[Ways] = []
    for k, (_, node, along) in enumerate(edges):
        for other, heading in leaving[node]:
            if np.array_equal(heading, -along):
                continue
            left = along[0] * heading[1] - along[1] * heading[0]
            place = 0 if left > 0 else plan.lanes - 1
            ways.append(
                Ways(
                    str(k), str(other),
                    ((place, place),) if left else tuple((p, p) for p in range(plan.lanes)),
                    str(900 + k) if plan.signals else None,
                    Turn.LEFT if left > 0 else Turn.RIGHT if left < 0 else Turn.STRAIGHT,
                    intersection=str(node),
                )
            )  # fmt: skip
    signs = {} if plan.signals else dict.fromkeys(groups, StopLineKind.STOP_SIGN)
    roads = small_roads(groups, ways, side=plan.side, signs=signs, intersection=None, id_of=names.__getitem__)
    kind = IntersectionKind.TRAFFIC_LIGHT if plan.signals else IntersectionKind.STOP_SIGN

    def areas(layer: str, shapes: Sequence[shapely.Polygon]) -> tuple[Area, ...]:
        return tuple(Area(names[f"{layer}{k}"], shape) for k, shape in enumerate(shapes))

    lot = np.array(((-60.0, -60.0), (-30.0, -60.0), (-30.0, -30.0), (-60.0, -30.0)))
    yard = shapely.Polygon(xy(lot - 40.0), [xy(lot * 0.5 - 62.5)])
    pavement_m = outside * (plan.lanes * WIDTH_M + 2.0)
    return replace(
        roads,
        name=name,
        crs=plan.crs,
        lanes={i: replace(lane, speed_limit_mps=next(limits)) for i, lane in roads.lanes.items()},
        connectors={i: replace(each, speed_limit_mps=next(limits)) for i, each in roads.connectors.items()},
        intersections=tuple(replace(each, kind=kind) for each in roads.intersections),
        crosswalks=areas("z", [strip(at + along * length_m, along, 3.0, 0.0, 2 * inner - 1) for along, at in roadways]),
        walkways=areas("p", [strip(at, along, length_m, pavement_m, 1.5) for along, at in roadways]),
        carparks=areas("k", [rounded(shapely.Polygon(xy(lot)))]),
        road_segments=areas("r", [each.polygon for each in roads.roadblocks.values() if not each.is_connector]),
        generic_drivable_areas=areas("g", [rounded(yard)]),
    )


def rounded(polygon: shapely.Geometry) -> shapely.Polygon:
    """To micrometres, as map files keep them."""
    found = shapely.transform(polygon, lambda xy: np.round(xy, 6))
    assert isinstance(found, shapely.Polygon)
    return found


def _shapes(points: Floats) -> tuple[Polyline, shapely.Polygon, Polyline, Polyline]:
    line = shapely.LineString(points)
    left, right = (shapely.get_coordinates(line.offset_curve(s * WIDTH_M / 2)).round(6) for s in (1, -1))
    polygon = rounded(line.buffer(WIDTH_M / 2, cap_style="flat"))
    return Polyline(points.round(6)), polygon, Polyline(left), Polyline(right)


def _around(polygons: Sequence[shapely.Polygon]) -> shapely.Polygon:
    hull = shapely.MultiPolygon(list(polygons)).convex_hull
    assert isinstance(hull, shapely.Polygon)
    return hull
