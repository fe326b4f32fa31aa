"""Parts of the drawing: ids, connectors, stop lines and paved places, collected as they are drawn.

Ids say where a thing belongs, so that an edit of one road leaves the others' alone:

- roadblock `RRDPP`: road number, direction (1 forward, 2 backward), piece along it
- lane `RRDPPI`: its roadblock and its index from the left
- connector `RRDPPIXT`: the lane it leaves, the exit (0 on to the next piece, 9 a ramp, else the
  arm of the junction), the index of the lane it enters; roadblock connector `RRDPPX`
- stop line `RRDPPG`: the roadblock it ends and the group of lanes (0 main, 1 inner pockets, 2 kerb pockets)
- intersection: the number of the junction, or the roadblock before a ramp
- crosswalk: junction and arm, or the roadblock before it; all other areas: road number and a count

Roads of a plan have two digits, those made by rule (`rules`, `driveways`) six, so that no two ids meet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely

from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import (
    Area,
    Connector,
    Intersection,
    IntersectionKind,
    Lane,
    Roadblock,
    StopLine,
    StopLineKind,
    Turn,
)
from tools.make_maps.geometry import SmoothCurve, smooth_step, turn
from tools.make_maps.layout import Block, Layout
from tools.make_maps.plan import LaneStrip
from tools.make_maps.road_geometry import RoadGeometry, between

STOP_LINE_BEFORE_M, STOP_LINE_AFTER_M = 0.5, 0.5
"""The stop line lies on the end of the lanes, so that it touches their connectors."""
STOP_LINE_INSET_M = 0.1
OVERLAP_M = 0.002
"""Neighbouring surfaces overlap by this much, so that no point falls between them."""
CURVE_COMFORT_MPS2 = 3.0
"""Lateral acceleration at the limit of a turning connector."""
SLOWEST_TURN_KMH = 15.0
NEXT_PIECE, RAMP = 0, 9
"""Exit digits of connectors that do not belong to a junction."""


@dataclass
class Drawing:
    """What has been drawn so far."""

    ground: RoadGeometry
    layout: Layout
    lanes: dict[str, Lane] = field(default_factory=dict[str, Lane])
    connectors: dict[str, Connector] = field(default_factory=dict[str, Connector])
    roadblocks: dict[str, Roadblock] = field(default_factory=dict[str, Roadblock])
    stop_lines: dict[str, StopLine] = field(default_factory=dict[str, StopLine])
    intersections: list[Intersection] = field(default_factory=list[Intersection])
    crosswalks: list[Area] = field(default_factory=list[Area])
    joints: list[tuple[str, shapely.Polygon]] = field(default_factory=list[tuple[str, shapely.Polygon]])
    """Ground of roads between their roadblocks, by road."""


def block_id(ground: RoadGeometry, block: Block) -> int:
    digit = 1 if block.direction == "forward" else 2
    return ground.plan.road[block.road].number * 1000 + digit * 100 + block.piece


def lane_id(ground: RoadGeometry, block: Block, lane: int) -> int:
    """Of a lane counted from the inner one; the id counts from the left."""
    return block_id(ground, block) * 10 + ground.left_to_right(len(block.strips)).index(lane)


def connect(
    drawing: Drawing,
    before: Block,
    from_lane: int,
    after: Block,
    to_lane: int,
    exit_digit: int,
    *,
    kind: Turn = Turn.STRAIGHT,
    stop_line_ids: tuple[str, ...] = (),
) -> Connector:
    """Draw one connector: along the axis where the road goes on, else as a driver steers."""
    ground = drawing.ground
    start, end = before.strips[from_lane], after.strips[to_lane]
    if before.road == after.road:
        road = ground.plan.road[before.road]

        def gliding(from_outward_m: float, to_outward_m: float) -> Floats:
            return ground.along(road, before.direction, before.to_m, after.from_m, from_outward_m, to_outward_m).points

        middle = gliding(start.middle_m, end.middle_m)
        left, right = ground.left_edge_first(gliding(start.inner_m, end.inner_m), gliding(start.kerb_m, end.kerb_m))
    else:
        curve = turn(ground.pose(before, start.middle_m, at_end=True), ground.pose(after, end.middle_m, at_end=False))
        half = _half_width_m(curve, start, end)
        middle, left, right = curve.points, curve.shifted(half), curve.shifted(-half)
    from_id, to_id = lane_id(ground, before, from_lane), lane_id(ground, after, to_lane)
    left_edge, right_edge = ground.edge(left), ground.edge(right)
    connector = Connector(
        id=str(from_id * 100 + exit_digit * 10 + to_id % 10),
        roadblock_id=str(block_id(ground, before) * 10 + exit_digit),
        from_lane_id=str(from_id),
        to_lane_id=str(to_id),
        centerline=ground.centerline(middle),
        polygon=between(left_edge.points, right_edge.points),
        left_boundary=left_edge,
        right_boundary=right_edge,
        speed_limit_mps=_connector_limit_mps(middle, before, after),
        turn=kind,
        stop_line_ids=stop_line_ids,
    )
    drawing.connectors[connector.id] = connector
    return connector


def _half_width_m(curve: SmoothCurve, start: LaneStrip, end: LaneStrip) -> Floats:
    share, _ = smooth_step(np.linspace(0.0, 1.0, len(curve.points)))
    return (start.width_m + share * (end.width_m - start.width_m)) / 2.0


def _connector_limit_mps(points: Floats, before: Block, after: Block) -> float:
    """The lower limit of both lanes, or what the tightest bend allows in comfort, in whole 5 km/h."""
    road_kmh = min(before.carriageway.limit_kmh, after.carriageway.limit_kmh)
    steps = np.diff(points, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    bend = np.abs(np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))) / ((lengths[1:] + lengths[:-1]) / 2.0)
    # The mean over a few vertices: a single one says little about a bend.
    window = min(len(bend), 5)
    tightest = float(np.convolve(bend, np.full(window, 1.0 / window), mode="valid").max(initial=0.0))
    comfort_kmh = 3.6 * np.sqrt(CURVE_COMFORT_MPS2 / max(tightest, 1e-6))
    if comfort_kmh >= road_kmh:
        return limit_mps(road_kmh)
    return limit_mps(max(SLOWEST_TURN_KMH, 5.0 * float(np.floor(comfort_kmh / 5.0))))


def limit_mps(limit_kmh: float) -> float:
    return round(limit_kmh / 3.6, 4)


def group_connectors(
    drawing: Drawing, connectors: Sequence[Connector], before: Block, after: Block, place: str | None
) -> None:
    """Put parallel connectors into a roadblock connector, from left to right."""
    ordered = sorted(connectors, key=lambda c: (c.from_lane_id, c.to_lane_id))
    outline = shapely.union_all([c.polygon.buffer(OVERLAP_M, join_style="mitre") for c in ordered])
    if not isinstance(outline, shapely.Polygon):
        outline = outline.convex_hull
    assert isinstance(outline, shapely.Polygon)
    name = ordered[0].roadblock_id
    drawing.roadblocks[name] = Roadblock(
        id=name,
        polygon=shapely.Polygon(outline.exterior),
        lane_ids=tuple(c.id for c in ordered),
        is_connector=True,
        from_id=str(block_id(drawing.ground, before)),
        to_id=str(block_id(drawing.ground, after)),
        intersection_id=place,
    )


def draw_intersection(drawing: Drawing, name: str, surfaces: Sequence[shapely.Polygon], kind: IntersectionKind) -> None:
    """The paved place made of some surfaces that touch."""
    merged = shapely.union_all([s.buffer(OVERLAP_M, join_style="mitre") for s in surfaces])
    largest = max(shapely.get_parts(merged), key=shapely.area)
    drawing.intersections.append(Intersection(name, shapely.Polygon(largest.exterior), kind))


def draw_stop_line(drawing: Drawing, block: Block, lanes: Sequence[int], group: int, kind: StopLineKind) -> str:
    """A stop line across some lanes of a block, counted from the inner one; its id."""
    ground = drawing.ground
    ahead = 1.0 if block.direction == "forward" else -1.0
    low_m, high_m = sorted((block.to_m - ahead * STOP_LINE_BEFORE_M, block.to_m + ahead * STOP_LINE_AFTER_M))
    side = ground.side(block.direction)
    inner_m = block.strips[lanes[0]].inner_m + STOP_LINE_INSET_M
    kerb_m = block.strips[lanes[-1]].kerb_m - STOP_LINE_INSET_M
    right_m, left_m = sorted((side * inner_m, side * kerb_m))
    name = str(block_id(ground, block) * 10 + group)
    area = ground.across(ground.plan.road[block.road], low_m, high_m, right_m, left_m)
    drawing.stop_lines[name] = StopLine(name, area, kind)
    return name
