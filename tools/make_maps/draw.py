"""From a plan to `Roads`: every road, joint and junction on the ground."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
import shapely

from interplan_sumo.world.geometry import Floats, Pose, wrap_angle
from interplan_sumo.world.roads import Area, Connector, IntersectionKind, Lane, Roadblock, Roads, StopLineKind
from tools.make_maps.drawing import (
    NEXT_PIECE,
    OVERLAP_M,
    RAMP,
    Drawing,
    block_id,
    connect,
    draw_intersection,
    draw_stop_line,
    group_connectors,
    lane_id,
    limit_mps,
)
from tools.make_maps.geometry import turn
from tools.make_maps.kerb import bus_bays, car_parks, parking_strips, sidewalks
from tools.make_maps.layout import Arm, Block, Joint, layout
from tools.make_maps.movements import joint_pairs, movements
from tools.make_maps.plan import Plan, PlannedCrossing, PlannedJunction, Ramp, Road
from tools.make_maps.road_geometry import RoadGeometry, between

CROSSWALK_M = 3.2
CROSSWALK_GAP_M = 1.2
"""From the stop line to the crosswalk."""
INTERSECTION_KINDS = {
    "signal": IntersectionKind.TRAFFIC_LIGHT,
    "all_way_stop": IntersectionKind.STOP_SIGN,
    "stop": IntersectionKind.STOP_SIGN,
    "yield": IntersectionKind.DEFAULT,
    "none": IntersectionKind.DEFAULT,
}


def draw_plan(plan: Plan) -> Roads:
    """The plan on the ground; ValueError says where it does not fit."""
    drawing = Drawing(RoadGeometry(plan), layout(plan))
    for block in drawing.layout.blocks:
        _draw_block(drawing, block)
    for joint in drawing.layout.joints:
        _draw_joint(drawing, joint)
    for junction in plan.junctions:
        _draw_junction(drawing, junction, drawing.layout.arms[junction.number])
    return _assembled(drawing)


def _draw_block(drawing: Drawing, block: Block) -> None:
    ground = drawing.ground
    road = ground.plan.road[block.road]

    def parallel(outward_m: float) -> Floats:
        return ground.along(road, block.direction, block.from_m, block.to_m, outward_m, outward_m).points

    name = str(block_id(ground, block))
    members: list[str] = []
    for index, lane in enumerate(ground.left_to_right(len(block.strips))):
        strip = block.strips[lane]
        left, right = ground.left_edge_first(parallel(strip.inner_m), parallel(strip.kerb_m))
        left_edge, right_edge = ground.edge(left), ground.edge(right)
        own = str(lane_id(ground, block, lane))
        members.append(own)
        drawing.lanes[own] = Lane(
            id=own,
            roadblock_id=name,
            index=index,
            centerline=ground.centerline(parallel(strip.middle_m)),
            polygon=between(left_edge.points, right_edge.points),
            left_boundary=left_edge,
            right_boundary=right_edge,
            speed_limit_mps=limit_mps(block.carriageway.limit_kmh),
        )
    left, right = ground.left_edge_first(parallel(block.strips[0].inner_m), parallel(block.strips[-1].kerb_m))
    drawing.roadblocks[name] = Roadblock(name, ground.surface(left, right), tuple(members))


# --- joints --------------------------------------------------------------------------------------


def _within(joint: Joint, at_m: float) -> bool:
    """Whether a station of its road lies in a joint."""
    low_m, high_m = sorted((joint.before.to_m, joint.after.from_m))
    return low_m <= at_m <= high_m


def _ramp_at(plan: Plan, joint: Joint) -> Ramp | None:
    way = (joint.before.road, joint.before.direction)
    return next((r for r in plan.ramps if (r.road, r.direction) == way and _within(joint, r.at_m)), None)


def _crossing_at(plan: Plan, joint: Joint) -> PlannedCrossing | None:
    return next((c for c in plan.road[joint.before.road].crossings if _within(joint, c.at_m)), None)


def _draw_joint(drawing: Drawing, joint: Joint) -> None:
    crossing = _crossing_at(drawing.ground.plan, joint)
    ramp = _ramp_at(drawing.ground.plan, joint)
    if crossing is not None:
        _draw_crossing(drawing, joint, crossing)
    elif ramp is not None:
        _draw_ramp(drawing, joint, ramp)
    else:
        drawn = _join(drawing, joint, joint_pairs(joint.before.strips, joint.after.strips), None, ())
        drawing.joints.append((joint.before.road, _envelope(drawing.ground, joint)))
        drawing.joints += [(joint.before.road, connector.polygon) for connector in drawn]


def _join(
    drawing: Drawing, joint: Joint, pairs: Sequence[tuple[int, int]], place: str | None, stop_line_ids: tuple[str, ...]
) -> list[Connector]:
    drawn = [
        connect(drawing, joint.before, a, joint.after, b, NEXT_PIECE, stop_line_ids=stop_line_ids) for a, b in pairs
    ]
    group_connectors(drawing, drawn, joint.before, joint.after, place)
    return drawn


def _envelope(ground: RoadGeometry, joint: Joint) -> shapely.Polygon:
    """The whole carriageway between two blocks."""
    before, after = joint.before, joint.after
    road = ground.plan.road[before.road]
    ends = (before.to_m, after.from_m)
    inner = ground.along(road, before.direction, *ends, before.strips[0].inner_m, after.strips[0].inner_m)
    kerb = ground.along(road, before.direction, *ends, before.strips[-1].kerb_m, after.strips[-1].kerb_m)
    return ground.surface(*ground.left_edge_first(inner.points, kerb.points))


def _draw_ramp(drawing: Drawing, joint: Joint, ramp: Ramp) -> None:
    """The kerb lane leads into a ramp, or a ramp becomes the kerb lane."""
    before, after = joint.before, joint.after
    place = str(block_id(drawing.ground, before))
    drawn = _join(drawing, joint, joint_pairs(before.strips, after.strips)[:-1], place, ())
    own = [block for block in drawing.layout.blocks if block.road == ramp.ramp]
    if ramp.kind == "exit":
        source, source_lane, target, target_lane = before, len(before.strips) - 1, own[0], 0
    else:
        source, source_lane, target, target_lane = own[-1], 0, after, len(after.strips) - 1
    link = connect(drawing, source, source_lane, target, target_lane, RAMP)
    group_connectors(drawing, [link], source, target, place)
    kind = IntersectionKind.LANE_BRANCH if ramp.kind == "exit" else IntersectionKind.LANE_MERGE
    draw_intersection(drawing, place, [c.polygon for c in (*drawn, link)], kind)


def _draw_crossing(drawing: Drawing, joint: Joint, crossing: PlannedCrossing) -> None:
    """A pedestrian crossing; its area over both carriageways is drawn with the first of them."""
    ground, plan = drawing.ground, drawing.ground.plan
    road = plan.road[joint.before.road]
    same = [j for j in drawing.layout.joints if j.before.road == road.name and _crossing_at(plan, j) is crossing]
    place = str(block_id(ground, same[0].before))
    kind = StopLineKind.TRAFFIC_LIGHT if crossing.signal else StopLineKind.PEDESTRIAN_CROSSING
    line = draw_stop_line(drawing, joint.before, range(len(joint.before.strips)), 0, kind)
    pairs = joint_pairs(joint.before.strips, joint.after.strips)
    _join(drawing, joint, pairs, None, (line,) if crossing.signal else ())
    drawing.joints.append((road.name, _envelope(ground, joint)))
    if joint is same[0]:
        low_m, high_m = sorted((joint.before.to_m, joint.after.from_m))
        middle_m = (low_m + high_m) / 2.0
        edges = [
            ground.side(j.before.direction) * edge_m
            for j in same
            for edge_m in (j.before.strips[0].inner_m, j.before.strips[-1].kerb_m)
        ]
        across = min(edges), max(edges)
        area = ground.across(road, middle_m - CROSSWALK_M / 2.0, middle_m + CROSSWALK_M / 2.0, *across)
        drawing.crosswalks.append(Area(place, area))


# --- junctions -----------------------------------------------------------------------------------


def _stop_kind(junction: PlannedJunction, arm: Arm, group: int) -> StopLineKind | None:
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


def _draw_junction(drawing: Drawing, junction: PlannedJunction, arms: Sequence[Arm]) -> None:
    ground = drawing.ground
    line_of: dict[tuple[str, int], str] = {}
    for arm in arms:
        if arm.arriving is not None:
            for group, group_lanes in _groups(arm.arriving):
                kind = _stop_kind(junction, arm, group)
                if kind is not None:
                    name = draw_stop_line(drawing, arm.arriving, group_lanes, group, kind)
                    line_of |= {(arm.key, lane): name for lane in group_lanes}
    place = str(junction.number)
    assert junction.control is not None, "controls are written out"
    signal = junction.control == "signal"
    drawn: dict[tuple[str, str], list[Connector]] = {}
    blocks: dict[tuple[str, str], tuple[Block, Block]] = {}
    for move in movements(ground.plan, junction, arms):
        way = move.arriving.key, move.leaving.key
        blocks[way] = move.before, move.after
        connector = connect(
            drawing,
            move.before,
            move.from_lane,
            move.after,
            move.to_lane,
            1 + arms.index(move.leaving),
            kind=move.turn,
            stop_line_ids=(line_of[move.arriving.key, move.from_lane],) if signal else (),
        )
        drawn.setdefault(way, []).append(connector)
    for way, parallel in drawn.items():
        group_connectors(drawing, parallel, *blocks[way], place)
    surfaces = [_junction_surface(ground, arms), *(c.polygon for parallel in drawn.values() for c in parallel)]
    draw_intersection(drawing, place, surfaces, INTERSECTION_KINDS[junction.control])
    for digit, arm in enumerate(arms, start=1):
        if junction.crosswalks is None or arm.key in junction.crosswalks:
            right_m, left_m = ground.arm_edges_m(arm)
            near_m = arm.cut_m - arm.sign * CROSSWALK_GAP_M
            far_m = near_m - arm.sign * CROSSWALK_M
            area = ground.across(ground.plan.road[arm.road], min(near_m, far_m), max(near_m, far_m), right_m, left_m)
            drawing.crosswalks.append(Area(str(junction.number * 10 + digit), area))


def _junction_surface(ground: RoadGeometry, arms: Sequence[Arm]) -> shapely.Polygon:
    """The paved area between the cuts of all arms, with rounded corners."""

    def kerb(arm: Arm, *, left: bool) -> Pose:
        """A kerb of an arm at its cut, seen and heading away from the junction."""
        right_m, left_m = ground.arm_edges_m(arm)
        pose = ground.plan.road[arm.road].axis.pose(arm.cut_m, left_m if left == (arm.sign > 0) else right_m)
        return Pose(pose.x_m, pose.y_m, pose.heading_rad + (0.0 if arm.sign > 0 else np.pi))

    ordered = sorted(arms, key=lambda arm: float(wrap_angle(kerb(arm, left=True).heading_rad)))
    ring: list[Floats] = []
    for arm, following in zip(ordered, [*ordered[1:], ordered[0]], strict=True):
        right, left = kerb(arm, left=False), kerb(arm, left=True)
        ring.append(np.array([[right.x_m, right.y_m]]))
        inward = Pose(left.x_m, left.y_m, left.heading_rad + np.pi)
        ring.append(turn(inward, kerb(following, left=False), spiral_share=0.0).points)
    surface = shapely.Polygon(ground.on_map(np.concatenate(ring))).buffer(0)
    return max(shapely.get_parts(surface), key=shapely.area)


# --- the whole -----------------------------------------------------------------------------------


def _assembled(drawing: Drawing) -> Roads:
    ground, plan = drawing.ground, drawing.ground.plan
    surfaces: list[tuple[Road, shapely.Polygon]] = []
    for road in plan.roads:
        own = [block for block in drawing.layout.blocks if block.road == road.name]
        polygons = [drawing.roadblocks[str(block_id(ground, block))].polygon for block in own]
        polygons += [polygon for name, polygon in drawing.joints if name == road.name]
        merged = shapely.union_all([p.buffer(OVERLAP_M, join_style="mitre") for p in polygons])
        parts = sorted(shapely.get_parts(merged), key=lambda p: tuple(np.round(p.bounds, 1)))
        surfaces += [(road, part) for part in parts]
    segments = _numbered(surfaces)
    beside = [*parking_strips(ground, drawing.layout), *bus_bays(ground, drawing.layout)]
    extras = _numbered([(road, p.buffer(OVERLAP_M, join_style="mitre")) for road, p in beside])
    parks = _numbered(car_parks(ground))
    paved = [area.polygon for area in (*segments, *extras, *parks, *drawing.intersections)]
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
        walkways=_numbered(sidewalks(ground, drawing.layout, shapely.union_all(paved))),
        carparks=parks,
        road_segments=segments,
        generic_drivable_areas=extras,
    )


def _numbered(surfaces: Sequence[tuple[Road, shapely.Polygon]]) -> tuple[Area, ...]:
    """Areas with ids from their road and a count along it."""
    count: Counter[int] = Counter()
    areas: list[Area] = []
    for road, polygon in surfaces:
        count[road.number] += 1
        areas.append(Area(str(road.number * 1000 + count[road.number]), polygon))
    return tuple(areas)
