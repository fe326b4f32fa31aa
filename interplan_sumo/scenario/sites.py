"""Sites: places on any map that suit a family of scenarios, and a plain reason for each place that does not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import sqrt
from typing import Any

import numpy as np
import shapely

from interplan_sumo.scenario.scenario import LanePosition, Scenario
from interplan_sumo.world.geometry import wrap_angle
from interplan_sumo.world.roads import USUAL_LIMIT_MPS, DrivingSide, Lane, Roads

STEP_M = 10.0
"""Places are looked for this far apart along a lane."""
BESIDE_M = 0.6
"""Lanes whose edges lie this near to one another are neighbours; a median is wider."""
OPPOSITE_RAD = np.radians(150.0)
KERB_REACH_M = 30.0
"""How far to the side the edge of the road is looked for."""
ROOM_M = 16.0
"""What happens at a site needs this much of its lane before and behind it."""
IN_LANE_M = 6.0
"""Start and goal keep this distance from the ends of their lane: the car's length and some."""
SHORTER = (1.0, 0.7, 0.5, 0.3)
"""Where the road is too short for the usual way to a site and on from it, these shares of it are tried."""
CENTIMETRES = 2
"""Measures are rounded to this many decimals: a site is data that people read."""
START_SHARE = 0.8
"""The ego starts at this share of the speed limit."""
EASY_MPS2 = 2.0
STANDOFF_M = 12.0
"""With a short run-up the ego can stop at `EASY_MPS2` so far before the site; half of it is the car's own length,"""
BUMPERS_M = 8.0
FREE_S = 3.2
"""and nothing is hit within the first 3 s: half the ego, half of what stands there, and some."""


class UnsuitableError(Exception):
    """A place does not do; the message says why."""


@dataclass(frozen=True, slots=True)
class Site:
    """A place on a lane, how the ego comes there and goes on, and what lies to its sides."""

    map: str
    lane: str
    at_m: float
    """Arc length on `lane`."""
    start: LanePosition
    goal: LanePosition
    route: tuple[str, ...]
    driving_side: DrivingSide
    limit_mps: float
    """Of the lane, or the usual one where the map knows none."""
    width_m: float
    """Of the lane."""
    left_edge_m: float
    """From the lane's centre line to the left edge of what can be driven on, oncoming lanes included."""
    right_edge_m: float
    lanes_left: int = 0
    """Lanes of the same direction on the left."""
    lanes_right: int = 0
    oncoming_m: float = 0.0
    """Width of the oncoming lanes beside the own ones, if no median parts them."""
    beside_start: tuple[str, ...] = ()
    """All lanes of the ego's direction at the start, from left to right."""
    run_up_m: float | None = None
    """From the start to the site, where that is less than usual."""

    @property
    def kerb(self) -> int:
        """Sign of `left_m` towards the near kerb: +1 where one drives on the left."""
        return 1 if self.driving_side == "left" else -1

    @property
    def near_edge_m(self) -> float:
        """To the edge of the road on the kerb's side."""
        return self.left_edge_m if self.driving_side == "left" else self.right_edge_m

    @property
    def far_edge_m(self) -> float:
        """To the edge of the road on the other side."""
        return self.right_edge_m if self.driving_side == "left" else self.left_edge_m

    @property
    def lanes_near(self) -> int:
        """Lanes of the same direction between this one and the kerb."""
        return self.lanes_left if self.driving_side == "left" else self.lanes_right

    @property
    def lanes_far(self) -> int:
        """Lanes of the same direction between this one and the middle of the road."""
        return self.lanes_right if self.driving_side == "left" else self.lanes_left

    def place(self, ahead_m: float, towards_kerb_m: float = 0.0) -> LanePosition:
        """A place `ahead_m` behind the site in driving direction (negative: before it) and towards the near kerb."""
        arc_m, left_m = self.at_m + ahead_m, self.kerb * towards_kerb_m
        return LanePosition(self.lane, round(arc_m, CENTIMETRES), round(left_m, CENTIMETRES) + 0.0)

    @property
    def start_speed_mps(self) -> float:
        """A usual speed for a car under way here, less where the run-up is too short to stop from it at ease."""
        usual_mps = START_SHARE * self.limit_mps
        if self.run_up_m is not None:
            stops_mps = sqrt(2.0 * EASY_MPS2 * max(self.run_up_m - STANDOFF_M, 1.0))
            usual_mps = min(usual_mps, stops_mps, (self.run_up_m - BUMPERS_M) / FREE_S)
        return round(usual_mps, 1)

    def scenario(self, id: str, family: str, **staged: Any) -> Scenario:
        """A scenario that leads past the site, with what is `staged` there; ScenarioError as from `Scenario`."""
        return Scenario(
            id=id, family=family, map=self.map, start=self.start, start_speed_mps=self.start_speed_mps,
            goal=self.goal, route=self.route, **staged,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Rejected:
    """A place that does not suit, and why."""

    lane: str
    at_m: float
    reason: str


def site_at(
    roads: Roads, lane_id: str, at_m: float, *, approach_m: float, beyond_m: float, room_m: float = ROOM_M
) -> Site:
    """The site at a place; the ego starts `approach_m` before it and its goal lies `beyond_m` behind it.

    The way there and on is the straightest one, without traffic lights.
    Raises UnsuitableError with a plain reason.
    """
    lane = roads.lanes[lane_id]
    if not room_m <= at_m <= lane.centerline.length_m - room_m:
        raise UnsuitableError(f"an end of the lane is nearer than {room_m:.0f} m")
    before, start = walk(roads, lane_id, at_m, -approach_m)
    after, goal = walk(roads, lane_id, at_m, beyond_m)
    chain = (*reversed(before), lane_id, *after)
    left_edge_m, right_edge_m = edges_m(roads, lane, at_m)
    siblings = roads.roadblocks[lane.roadblock_id].lane_ids
    index = siblings.index(lane_id)
    return Site(
        map=roads.name,
        lane=lane_id,
        at_m=round(at_m, CENTIMETRES),
        start=start,
        goal=goal,
        route=roads.route_through(chain),
        driving_side=roads.driving_side,
        limit_mps=round(lane.speed_limit_mps or USUAL_LIMIT_MPS, CENTIMETRES),
        width_m=round(lane_width_m(lane, at_m), CENTIMETRES),
        left_edge_m=round(left_edge_m, CENTIMETRES),
        right_edge_m=round(right_edge_m, CENTIMETRES),
        lanes_left=index,
        lanes_right=len(siblings) - 1 - index,
        oncoming_m=round(oncoming_width_m(roads, lane_id, at_m), CENTIMETRES),
        beside_start=roads.roadblocks[roads[start.lane].roadblock_id].lane_ids,
    )


def roomiest_site_at(roads: Roads, lane_id: str, at_m: float, *, approach_m: float, beyond_m: float) -> Site:
    """`site_at` with the usual way to the site and on, or with as much of it as the road has, at least 30 %.

    UnsuitableError, with the reason why not even that does.
    """
    reason: UnsuitableError | None = None
    for share in SHORTER:
        try:
            site = site_at(
                roads, lane_id, at_m, approach_m=share * approach_m, beyond_m=share * beyond_m, room_m=share * ROOM_M
            )
        except UnsuitableError as error:
            reason = error
        else:
            return site if share == 1.0 else replace(site, run_up_m=round(share * approach_m, CENTIMETRES))
    assert reason is not None
    raise reason


def places(roads: Roads, step_m: float = STEP_M) -> Iterator[tuple[str, float]]:
    """Every lane of the map, at places `step_m` apart."""
    for lane in roads.lanes.values():
        for at_m in np.arange(step_m, lane.centerline.length_m, step_m):
            yield lane.id, float(at_m)


# --- the way there and on ----------------------------------------------------------------------


def walk(roads: Roads, lane_id: str, at_m: float, distance_m: float) -> tuple[list[str], LanePosition]:
    """Lanes and connectors beyond `lane_id` in walking order, and the place `distance_m` away (negative: upstream).

    Follows the straightest way without traffic lights; UnsuitableError where there is none.
    """
    here, left_m = lane_id, abs(distance_m)
    room_m = at_m if distance_m < 0.0 else roads[here].centerline.length_m - at_m
    chain: list[str] = []
    while True:
        line = roads[here].centerline
        if left_m <= room_m - IN_LANE_M and isinstance(roads[here], Lane):
            arc_m = room_m - left_m if distance_m < 0.0 else line.length_m - (room_m - left_m)
            arc_m = max(arc_m, IN_LANE_M) if distance_m > 0.0 else min(arc_m, line.length_m - IN_LANE_M)
            if IN_LANE_M <= arc_m <= line.length_m - IN_LANE_M:
                return chain, LanePosition(here, round(arc_m, CENTIMETRES))
        left_m -= room_m
        here = _next(roads, here, upstream=distance_m < 0.0, walked_m=abs(distance_m) - left_m)
        chain.append(here)
        room_m = roads[here].centerline.length_m


def _next(roads: Roads, here: str, *, upstream: bool, walked_m: float) -> str:
    """The straightest way on from a lane or connector, without a traffic light."""
    where = f"{max(walked_m, 0.0):.0f} m {'before' if upstream else 'behind'} it"
    ways = roads.incoming(here) if upstream else roads.outgoing(here)
    if not ways:
        raise UnsuitableError(f"the road {'begins' if upstream else 'ends'} {where}")
    if here in roads.connectors:
        return ways[0]
    free = [way for way in ways if not roads.connectors[way].has_traffic_light]
    if not free:
        raise UnsuitableError(f"there is a traffic light {where}")
    bends = {way: abs(roads[way].centerline.turned_rad) for way in free}
    best = min(free, key=lambda way: (bends[way], way))
    if bends[best] > np.radians(45.0):
        raise UnsuitableError(f"the road turns off {where}")
    return best


# --- what lies to the sides --------------------------------------------------------------------


def lane_width_m(lane: Lane, at_m: float) -> float:
    """Width of a lane at a place, between its boundaries."""
    pose = lane.centerline.pose_at(at_m)
    point = (pose.x_m, pose.y_m)
    return sum(abs(float(line.project(point)[1][0])) for line in (lane.left_boundary, lane.right_boundary))


def edges_m(roads: Roads, lane: Lane, at_m: float) -> tuple[float, float]:
    """From the centre line to the left and to the right edge of the drivable area, at most `KERB_REACH_M`."""
    here = lane.centerline.pose_at(at_m)
    found: list[float] = []
    for side in (1.0, -1.0):
        far = lane.centerline.pose_at(at_m, side * KERB_REACH_M)
        ray = shapely.LineString([(here.x_m, here.y_m), (far.x_m, far.y_m)])
        drivable = shapely.intersection(ray, _near_drivable(roads, ray))
        parts = [part for part in shapely.get_parts(drivable) if part.length > 0.0]
        first = min(parts, key=lambda part: part.distance(shapely.Point(here.x_m, here.y_m)), default=None)
        found.append(0.0 if first is None else float(first.length))
    return found[0], found[1]


def _near_drivable(roads: Roads, ray: shapely.LineString) -> shapely.Geometry:
    areas = (*roads.road_segments, *roads.intersections, *roads.generic_drivable_areas, *roads.carparks)
    near = [area.polygon for area in areas if area.polygon.intersects(ray)]
    return shapely.union_all(near)


def oncoming_width_m(roads: Roads, lane_id: str, at_m: float) -> float:
    """Width of the oncoming lanes that border on the own direction at a place; 0 where a median parts them."""
    here = roads.lanes[lane_id]
    siblings = roads.roadblocks[here.roadblock_id].lane_ids
    inner = roads.lanes[siblings[0] if roads.driving_side == "right" else siblings[-1]]
    side = 1.0 if roads.driving_side == "right" else -1.0
    pose = here.centerline.pose_at(at_m)
    arc_m, _ = inner.centerline.project_point(pose.x_m, pose.y_m)
    heading = inner.centerline.pose_at(arc_m).heading_rad
    reach_m = lane_width_m(inner, arc_m) / 2.0
    width_m = 0.0
    while reach_m < KERB_REACH_M:
        there = inner.centerline.pose_at(arc_m, side * (reach_m + BESIDE_M))
        lanes = [roads.lanes[i] for i in roads.lanes_at(there.x_m, there.y_m)]
        opposite = [lane for lane in lanes if _turned(lane, there.x_m, there.y_m, heading) > OPPOSITE_RAD]
        if not opposite:
            break
        at_other_m, _ = opposite[0].centerline.project_point(there.x_m, there.y_m)
        lane_m = lane_width_m(opposite[0], at_other_m)
        width_m, reach_m = width_m + lane_m, reach_m + lane_m
    return width_m


def _turned(lane: Lane, x_m: float, y_m: float, heading_rad: float) -> float:
    arc_m, _ = lane.centerline.project_point(x_m, y_m)
    return abs(float(wrap_angle(lane.centerline.pose_at(arc_m).heading_rad - heading_rad)))
