"""From a plan to `Roads`: lanes, connectors, junctions, stop lines and the surfaces around them.

Ids say where a thing belongs, so that an edit of one road leaves the others' alone:

- roadblock `RRDPP`: road number, direction (1 forward, 2 backward), piece along it
- lane `RRDPPI`: its roadblock and its index from the left
- connector `RRDPPIXT`: the lane it leaves, the exit (0 straight on to the next piece, 9 a ramp,
  else the arm of the junction), the index of the lane it enters
- roadblock connector `RRDPPX`; stop line `RRDPPG` with G the group of lanes (0 main, 1 inner and 2 kerb pocket)
- intersection: the number of the junction, or the roadblock before the joint
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely

from interplan_sumo.maps.districts.geometry import Course, beside, smooth_step, turn
from interplan_sumo.maps.districts.kerb import bus_bays, parking_strips, sidewalks
from interplan_sumo.maps.districts.layout import Arm, Block, Joint, Layout, Strip, layout
from interplan_sumo.maps.districts.movements import joint_pairs, movements
from interplan_sumo.maps.districts.plan import Crossing, Junction, Plan, Ramp
from interplan_sumo.maps.districts.sheet import Sheet, between
from interplan_sumo.world.geometry import Floats, Pose, wrap_angle
from interplan_sumo.world.roads import (
    Area,
    Connector,
    Intersection,
    IntersectionKind,
    Lane,
    Roadblock,
    Roads,
    StopLine,
    StopLineKind,
    Turn,
)

CROSSWALK_M = 3.2
CROSSWALK_GAP_M = 1.2
"""From the stop line to the crosswalk."""
STOP_LINE_BEFORE_M, STOP_LINE_AFTER_M = 0.5, 0.5
"""The stop line lies on the end of the lanes, so that it touches their connectors."""
OVERLAP_M = 0.002
"""Neighbouring surfaces overlap by this much, so that no point falls between them."""
CURVE_COMFORT_MPS2 = 3.0
"""Lateral acceleration at the limit of a turning connector."""
SLOWEST_TURN_KMH = 15.0

INTERSECTION_KINDS = {
    "signal": IntersectionKind.TRAFFIC_LIGHT,
    "all_way_stop": IntersectionKind.STOP_SIGN,
    "stop": IntersectionKind.STOP_SIGN,
    "yield": IntersectionKind.DEFAULT,
    "none": IntersectionKind.DEFAULT,
}


@dataclass
class _Drawing:
    """What has been drawn so far."""

    sheet: Sheet
    layout: Layout
    lanes: dict[str, Lane] = field(default_factory=dict[str, Lane])
    connectors: dict[str, Connector] = field(default_factory=dict[str, Connector])
    roadblocks: dict[str, Roadblock] = field(default_factory=dict[str, Roadblock])
    stop_lines: dict[str, StopLine] = field(default_factory=dict[str, StopLine])
    intersections: list[Intersection] = field(default_factory=list[Intersection])
    crosswalks: list[Area] = field(default_factory=list[Area])


def block_id(sheet: Sheet, block: Block) -> int:
    digit = 1 if block.direction == "forward" else 2
    return sheet.plan.road[block.road].number * 1000 + digit * 100 + block.piece


def lane_id(sheet: Sheet, block: Block, lane: int) -> int:
    """Of a lane counted from the inner one; the id counts from the left."""
    return block_id(sheet, block) * 10 + sheet.left_to_right(len(block.strips)).index(lane)


def draw_plan(plan: Plan) -> Roads:
    """The plan on the ground; ValueError says where it does not fit."""
    drawing = _Drawing(Sheet(plan), layout(plan))
    for block in drawing.layout.blocks:
        _draw_block(drawing, block)
    for joint in drawing.layout.joints:
        _draw_joint(drawing, joint)
    for junction in plan.junctions:
        _draw_junction(drawing, junction, drawing.layout.arms[junction.number])
    return _assembled(drawing)


def _draw_block(drawing: _Drawing, block: Block) -> None:
    sheet = drawing.sheet
    road = sheet.plan.road[block.road]

    def parallel(outward_m: float) -> Floats:
        return sheet.along(road, block.direction, block.from_m, block.to_m, outward_m, outward_m).points

    name = str(block_id(sheet, block))
    members: list[str] = []
    for index, lane in enumerate(sheet.left_to_right(len(block.strips))):
        strip = block.strips[lane]
        left, right = sheet.left_edge_first(parallel(strip.inner_m), parallel(strip.kerb_m))
        left_edge, right_edge = sheet.edge(left), sheet.edge(right)
        own = str(lane_id(sheet, block, lane))
        members.append(own)
        drawing.lanes[own] = Lane(
            id=own,
            roadblock_id=name,
            index=index,
            centerline=sheet.centerline(parallel(strip.middle_m)),
            polygon=between(left_edge.points, right_edge.points),
            left_boundary=left_edge,
            right_boundary=right_edge,
            speed_limit_mps=round(block.way.limit_kmh / 3.6, 4),
        )
    left, right = sheet.left_edge_first(parallel(block.strips[0].inner_m), parallel(block.strips[-1].kerb_m))
    drawing.roadblocks[name] = Roadblock(name, sheet.surface(left, right), tuple(members))


# --- connectors ----------------------------------------------------------------------------------


def _connect(
    drawing: _Drawing,
    before: Block,
    from_lane: int,
    after: Block,
    to_lane: int,
    exit_digit: int,
    turn_kind: Turn,
    stop_line_ids: tuple[str, ...],
    *,
    along_road: bool,
) -> Connector:
    """Draw one connector; along the axis of the road where both lanes belong to it, else as a driver steers."""
    sheet = drawing.sheet
    start, end = before.strips[from_lane], after.strips[to_lane]
    if along_road:
        road = sheet.plan.road[before.road]

        def gliding(from_outward_m: float, to_outward_m: float) -> Floats:
            return sheet.along(road, before.direction, before.to_m, after.from_m, from_outward_m, to_outward_m).points

        middle = gliding(start.middle_m, end.middle_m)
        left, right = sheet.left_edge_first(
            gliding(start.inner_m, end.inner_m), gliding(start.kerb_m, end.kerb_m)
        )
    else:
        course = turn(
            sheet.pose(before, start.middle_m, at_end=True), sheet.pose(after, end.middle_m, at_end=False)
        )
        half = _half_width_m(course, start, end)
        middle, left, right = course.points, course.shifted(half), course.shifted(-half)
    from_id, to_id = lane_id(sheet, before, from_lane), lane_id(sheet, after, to_lane)
    left_edge, right_edge = sheet.edge(left), sheet.edge(right)
    connector = Connector(
        id=str(from_id * 100 + exit_digit * 10 + to_id % 10),
        roadblock_id=str(block_id(sheet, before) * 10 + exit_digit),
        from_lane_id=str(from_id),
        to_lane_id=str(to_id),
        centerline=sheet.centerline(middle),
        polygon=between(left_edge.points, right_edge.points),
        left_boundary=left_edge,
        right_boundary=right_edge,
        speed_limit_mps=_connector_limit_mps(middle, before, after),
        turn=turn_kind,
        stop_line_ids=stop_line_ids,
    )
    drawing.connectors[connector.id] = connector
    return connector


def _half_width_m(course: Course, start: Strip, end: Strip) -> Floats:
    share, _ = smooth_step(np.linspace(0.0, 1.0, len(course.points)))
    return (start.width_m + share * (end.width_m - start.width_m)) / 2.0


def _connector_limit_mps(points: Floats, before: Block, after: Block) -> float:
    """The lower limit of both lanes, or what the tightest bend allows in comfort, in whole 5 km/h."""
    road_kmh = min(before.way.limit_kmh, after.way.limit_kmh)
    steps = np.diff(points, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    bend = np.abs(np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))) / ((lengths[1:] + lengths[:-1]) / 2.0)
    # The mean over about 3 m: single vertices say little about a bend.
    window = min(len(bend), 7)
    tightest = float(np.convolve(bend, np.full(window, 1.0 / window), mode="valid").max(initial=0.0))
    comfort_kmh = 3.6 * np.sqrt(CURVE_COMFORT_MPS2 / max(tightest, 1e-6))
    if comfort_kmh >= road_kmh:
        return round(road_kmh / 3.6, 4)
    return round(max(SLOWEST_TURN_KMH, 5.0 * np.floor(comfort_kmh / 5.0)) / 3.6, 4)


def _group_connectors(drawing: _Drawing, connectors: Sequence[Connector], from_id: str, to_id: str, place: str) -> None:
    """Put parallel connectors into a roadblock connector, from left to right."""
    ordered = sorted(connectors, key=lambda c: (c.from_lane_id, c.to_lane_id))
    outline = shapely.union_all([c.polygon for c in ordered])
    if outline.geom_type != "Polygon":
        outline = between(ordered[0].left_boundary.points, ordered[-1].right_boundary.points).buffer(0)
    if outline.geom_type != "Polygon":
        outline = outline.convex_hull
    name = ordered[0].roadblock_id
    drawing.roadblocks[name] = Roadblock(
        name, outline, tuple(c.id for c in ordered), True, from_id, to_id, place  # type: ignore[arg-type]
    )


# --- joints --------------------------------------------------------------------------------------


def _ramp_at(plan: Plan, joint: Joint) -> Ramp | None:
    low_m, high_m = sorted((joint.before.to_m, joint.after.from_m))
    for ramp in plan.ramps:
        if (ramp.road, ramp.direction) == (joint.before.road, joint.before.direction) and low_m <= ramp.at_m <= high_m:
            return ramp
    return None


def _crossing_at(plan: Plan, joint: Joint) -> Crossing | None:
    low_m, high_m = sorted((joint.before.to_m, joint.after.from_m))
    for crossing in plan.road[joint.before.road].crossings:
        if low_m <= crossing.at_m <= high_m:
            return crossing
    return None


def _draw_joint(drawing: _Drawing, joint: Joint) -> None:
    sheet, before, after = drawing.sheet, joint.before, joint.after
    road = sheet.plan.road[before.road]
    ramp, crossing = _ramp_at(sheet.plan, joint), _crossing_at(sheet.plan, joint)
    before_id, after_id = str(block_id(sheet, before)), str(block_id(sheet, after))
    place = before_id
    stop_line_ids: tuple[str, ...] = ()
    kind = IntersectionKind.PASS_THROUGH
    if crossing is not None:
        # Both carriageways stop for one crossing: one place, named after the forward roadblock before it.
        forward = before if before.direction == "forward" else None
        stop = StopLineKind.TRAFFIC_LIGHT if crossing.signal else StopLineKind.PEDESTRIAN_CROSSING
        line = _draw_stop_line(drawing, before, range(len(before.strips)), 0, stop)
        stop_line_ids = (line,) if crossing.signal else ()
        kind = IntersectionKind.TRAFFIC_LIGHT if crossing.signal else kind
        place = _draw_crossing(drawing, crossing, joint, kind, first=forward is not None)
    pairs = joint_pairs(before.strips, after.strips)
    ramp_block = None
    if ramp is not None:
        pairs = pairs[:-1]
        ramp_blocks = [b for b in drawing.layout.blocks if b.road == ramp.ramp]
        ramp_block = ramp_blocks[0] if ramp.kind == "exit" else ramp_blocks[-1]
    if ramp is not None or len(after.strips) != len(before.strips):
        gains = len(after.strips) > len(before.strips)
        kind = IntersectionKind.LANE_MERGE if gains == (ramp is not None) else IntersectionKind.LANE_BRANCH
    drawn = [
        _connect(drawing, before, a, after, b, 0, Turn.STRAIGHT, stop_line_ids, along_road=True) for a, b in pairs
    ]
    _group_connectors(drawing, drawn, before_id, after_id, place)
    surface = [c.polygon for c in drawn]
    if ramp is not None and ramp_block is not None:
        if ramp.kind == "exit":
            source, source_lane, target, target_lane = before, len(before.strips) - 1, ramp_block, 0
        else:
            source, source_lane, target, target_lane = ramp_block, 0, after, len(after.strips) - 1
        link = _connect(
            drawing, source, source_lane, target, target_lane, 9, Turn.STRAIGHT, (), along_road=False
        )
        _group_connectors(
            drawing, [link], str(block_id(sheet, source)), str(block_id(sheet, target)), place
        )
        surface.append(link.polygon)
    if crossing is None:
        left, right = sheet.left_edge_first(
            sheet.along(
                road, before.direction, before.to_m, after.from_m, before.strips[0].inner_m, after.strips[0].inner_m
            ).points,
            sheet.along(
                road, before.direction, before.to_m, after.from_m, before.strips[-1].kerb_m, after.strips[-1].kerb_m
            ).points,
        )
        envelope = sheet.surface(left, right)
        _draw_intersection(drawing, place, [envelope, *surface] if ramp is None else surface, kind)


def _draw_crossing(
    drawing: _Drawing, crossing: Crossing, joint: Joint, kind: IntersectionKind, *, first: bool
) -> str:
    """The place of a crossing in the middle of a road, drawn with its first carriageway."""
    sheet = drawing.sheet
    road = sheet.plan.road[joint.before.road]
    low_m, high_m = sorted((joint.before.to_m, joint.after.from_m))
    edges: list[float] = []
    names: list[str] = []
    for other in drawing.layout.joints:
        if other.before.road == road.name and _crossing_at(sheet.plan, other) is crossing:
            side = sheet.side(other.before.direction)
            edges += [side * other.before.strips[0].inner_m, side * other.before.strips[-1].kerb_m]
            names.append(str(block_id(sheet, other.before)))
    if first or len(names) == 1:
        middle_m = (low_m + high_m) / 2.0
        area = sheet.across(road, middle_m - CROSSWALK_M / 2.0, middle_m + CROSSWALK_M / 2.0, min(edges), max(edges))
        drawing.crosswalks.append(Area(names[0], area))
        _draw_intersection(drawing, names[0], [sheet.across(road, low_m, high_m, min(edges), max(edges))], kind)
    return names[0]


def _draw_intersection(
    drawing: _Drawing, name: str, surfaces: Sequence[shapely.Geometry], kind: IntersectionKind
) -> None:
    merged = shapely.union_all([s.buffer(OVERLAP_M, join_style="mitre") for s in surfaces])
    parts = shapely.get_parts(merged)
    largest = max(parts, key=lambda p: p.area)
    drawing.intersections.append(Intersection(name, shapely.Polygon(largest.exterior), kind))


def _draw_stop_line(
    drawing: _Drawing, block: Block, lanes: Sequence[int], group: int, kind: StopLineKind
) -> str:
    """A stop line across some lanes, counted from the inner one."""
    sheet = drawing.sheet
    road = sheet.plan.road[block.road]
    ahead = 1.0 if block.direction == "forward" else -1.0
    low_m, high_m = sorted((block.to_m - ahead * STOP_LINE_BEFORE_M, block.to_m + ahead * STOP_LINE_AFTER_M))
    side = sheet.side(block.direction)
    right_m, left_m = sorted((side * (block.strips[lanes[0]].inner_m + 0.1), side * (block.strips[lanes[-1]].kerb_m - 0.1)))
    name = str(block_id(sheet, block) * 10 + group)
    drawing.stop_lines[name] = StopLine(name, sheet.across(road, low_m, high_m, right_m, left_m), kind)
    return name


# --- junctions -----------------------------------------------------------------------------------


def _stop_kind(junction: Junction, arm: Arm, group: int) -> StopLineKind | None:
    """Why the lanes of a group stop at a junction; None where they have the right of way."""
    if junction.control == "signal":
        return StopLineKind.TRAFFIC_LIGHT
    if junction.control == "all_way_stop":
        return StopLineKind.STOP_SIGN
    if junction.control in ("stop", "yield") and arm.road != junction.roads[0]:
        return StopLineKind.STOP_SIGN if junction.control == "stop" else StopLineKind.YIELD
    return StopLineKind.TURN_STOP if group == 1 else None


def _groups(block: Block) -> tuple[tuple[int, range], ...]:
    """The lanes of an approach by stop line: main lanes, inner pockets, kerb pockets."""
    count = len(block.strips)
    parts = (
        (0, range(block.inner_pockets, count - block.kerb_pockets)),
        (1, range(block.inner_pockets)),
        (2, range(count - block.kerb_pockets, count)),
    )
    return tuple((group, lanes) for group, lanes in parts if lanes)


def _draw_junction(drawing: _Drawing, junction: Junction, arms: Sequence[Arm]) -> None:
    sheet = drawing.sheet
    line_of: dict[tuple[str, int], str] = {}
    for arm in arms:
        if arm.arriving is not None:
            for group, group_lanes in _groups(arm.arriving):
                kind = _stop_kind(junction, arm, group)
                if kind is not None:
                    name = _draw_stop_line(drawing, arm.arriving, group_lanes, group, kind)
                    for lane in group_lanes:
                        line_of[arm.key, lane] = name
    place = str(junction.number)
    by_block: dict[tuple[str, str], list[Connector]] = {}
    for move in movements(sheet.plan, junction, arms):
        before, after = move.arriving.arriving, move.leaving.leaving
        assert before is not None and after is not None
        lines = (line_of[move.arriving.key, move.from_lane],) if junction.control == "signal" else ()
        connector = _connect(
            drawing,
            before,
            move.from_lane,
            after,
            move.to_lane,
            1 + arms.index(move.leaving),
            move.turn,
            lines,
            along_road=move.arriving.road == move.leaving.road,
        )
        by_block.setdefault((str(block_id(sheet, before)), str(block_id(sheet, after))), []).append(connector)
    for (before_id, after_id), drawn in by_block.items():
        _group_connectors(drawing, drawn, before_id, after_id, place)
    surfaces = [_junction_surface(drawing, arms), *(c.polygon for group in by_block.values() for c in group)]
    _draw_intersection(drawing, place, surfaces, INTERSECTION_KINDS[junction.control])
    marked = junction.crosswalks
    for digit, arm in enumerate(arms, start=1):
        if marked is None or arm.key in marked:
            right_m, left_m = sheet.arm_edges_m(arm)
            from_m, to_m = sorted(
                (arm.cut_m - arm.sign * CROSSWALK_GAP_M, arm.cut_m - arm.sign * (CROSSWALK_GAP_M + CROSSWALK_M))
            )
            area = sheet.across(sheet.plan.road[arm.road], from_m, to_m, right_m, left_m)
            drawing.crosswalks.append(Area(str(junction.number * 10 + digit), area))


def _junction_surface(drawing: _Drawing, arms: Sequence[Arm]) -> shapely.Geometry:
    """The paved area between the cuts of all arms, with rounded corners."""
    sheet = drawing.sheet

    def outward(arm: Arm, *, left: bool) -> Pose:
        right_m, left_m = sheet.arm_edges_m(arm)
        low_first = arm.sign > 0
        pose = sheet.plan.road[arm.road].axis.pose(arm.cut_m, left_m if left == low_first else right_m)
        return Pose(pose.x_m, pose.y_m, pose.heading_rad + (0.0 if arm.sign > 0 else np.pi))

    ordered = sorted(arms, key=lambda a: float(wrap_angle(outward(a, left=True).heading_rad)))
    ring: list[Floats] = []
    for arm, following in zip(ordered, [*ordered[1:], ordered[0]], strict=True):
        start, end = outward(arm, left=True), outward(following, left=False)
        ring.append(np.array([[outward(arm, left=False).x_m, outward(arm, left=False).y_m]]))
        inward = Pose(start.x_m, start.y_m, start.heading_rad + np.pi)
        ring.append(turn(inward, end, spiral_share=0.0).points)
    return shapely.Polygon(sheet.on_map(np.concatenate(ring))).buffer(0)


# --- the whole -----------------------------------------------------------------------------------


def _assembled(drawing: _Drawing) -> Roads:
    sheet, plan = drawing.sheet, drawing.sheet.plan
    segments: list[Area] = []
    for road in plan.roads:
        own = [
            drawing.roadblocks[str(block_id(sheet, b))].polygon for b in drawing.layout.blocks if b.road == road.name
        ]
        merged = shapely.union_all([p.buffer(OVERLAP_M, join_style="mitre") for p in own])
        parts = sorted(shapely.get_parts(merged), key=lambda p: tuple(np.round(p.bounds, 1)))
        segments += [Area(str(road.number * 1000 + i), p) for i, p in enumerate(parts, start=1)]
    extras: list[Area] = []
    for strips in (parking_strips(sheet, drawing.layout), bus_bays(sheet, drawing.layout)):
        for road, polygon in strips:
            count = sum(area.id.startswith(str(road.number)) for area in extras)
            extras.append(Area(str(road.number * 1000 + count + 1), polygon.buffer(OVERLAP_M, join_style="mitre")))
    paved = shapely.union_all(
        [a.polygon for a in (*segments, *extras)] + [i.polygon for i in drawing.intersections]
    )
    places = {int(i.id): i.polygon for i in drawing.intersections if len(i.id) < 3}
    walkways = [
        Area(str(i), polygon) for i, polygon in enumerate(sidewalks(sheet, drawing.layout, places, paved), start=1)
    ]
    return Roads(
        name=plan.name,
        crs=plan.crs,
        driving_side=plan.driving_side,
        lanes=drawing.lanes,
        connectors=drawing.connectors,
        roadblocks=drawing.roadblocks,
        intersections=tuple(drawing.intersections),
        stop_lines=drawing.stop_lines,
        crosswalks=tuple(drawing.crosswalks),
        walkways=tuple(walkways),
        road_segments=tuple(segments),
        generic_drivable_areas=tuple(extras),
    )
