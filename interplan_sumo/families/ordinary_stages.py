"""How scenes of ordinary driving are staged: at junctions, along the road, and through the town."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import shapely

from interplan_sumo.families import named_family
from interplan_sumo.families.draws import Draws
from interplan_sumo.families.staging import WALK_MPS, WALKS_MPS
from interplan_sumo.scenario.scenario import (
    Density,
    Jaywalker,
    LanePosition,
    Obstacle,
    PlacedVehicle,
    Scenario,
    TrafficDemand,
    VehicleKind,
)
from interplan_sumo.scenario.sites import CENTIMETRES, IN_LANE_M, Site, UnsuitableError, edges_m, site_at, walk
from interplan_sumo.world.roads import USUAL_LIMIT_MPS, Connector, Roads, Turn

PARKING_M: Final = 2.0
"""Width beside the lane in which a car can park without reaching into it."""
TRIP_M: Final = (150.0, 350.0)
"""Length of a trip; 30 s of driving at most of our limits."""
CHANGE_ROOM_M: Final = 50.0
"""A trip leaves as much room for each of its lane changes: almost 4 s at 50 km/h."""
BESIDE_SHARE: Final = 0.7
"""Of the trips with room for it end on the lane beside the one that they would come to."""
STRAIGHT_SHARE: Final = 0.4
"""Of the junctions at which a trip could also turn."""
DRIVERS: Final = "urban"
"""Vehicle types of ordinary driving."""
LANE_CHANGE_M: Final = (280.0, 240.0, 200.0, 160.0, 120.0)
"""From the start of a lane change at leisure to its goal line: the longest that a place has room for."""
GOAL_ROOM_M: Final = 8.0
LIGHT_TIMES_S: Final = (0, 119)
"""How long lights have run at first, longer than a cycle takes: they are found at any of its phases."""
LIGHT_TRAFFIC: Final = TrafficDemand("low", DRIVERS, "low")
CROSSING: Final = {1: 0.5, 2: 0.35, 3: 0.15}
"""How many walk over a crosswalk together,"""
APART_M: Final = 0.9
"""so far from one another, one behind the other where there are more than two;"""
AT_EXIT_SHARE: Final = 0.5
"""at so many turns somebody does on the road that the ego turns into."""
WAITING_SHARE: Final = 0.6
"""Beside so many of those parked at the kerb somebody stands,"""
PAVEMENT_M: Final = (1.5, 2.2)
"""so far from the car's middle line."""


@dataclass(frozen=True, slots=True)
class Course:
    """A way to drive: from where to where, along which roadblocks."""

    start: LanePosition
    goal: LanePosition
    route: tuple[str, ...]


# --- at junctions ------------------------------------------------------------------------------


def ways_out(turn: Turn, light: bool | None, roads: Roads, lane_id: str, _at_m: float) -> tuple[Connector, ...]:
    """The ways that leave a lane with a turn, with or without a traffic light; None: either."""
    ways = [roads.connectors[i] for i in roads.outgoing(lane_id)]
    found = tuple(w for w in ways if w.turn is turn and _bends(w, turn) and light in (None, w.has_traffic_light))
    if not found:
        raise UnsuitableError(f"no way {turn.name.lower()} leaves the lane")
    return found


def cross(
    share: float, before_m: tuple[float, float], id: str, roads: Roads, ways: tuple[Connector, ...],
    draws: Draws,
) -> Scenario:  # fmt: skip
    """Comes to a junction and goes through it; `share` is the start speed as a share of the limit."""
    way = draws.one_of("way", ways)
    course = _through(roads, way, draws.uniform("distance_m", before_m, 1), 60.0)
    people: list[Jaywalker] = []
    crosswalks = _crosswalks_m(roads, way) if way.turn is not Turn.STRAIGHT else []
    if crosswalks and draws.happens("people_at_exit", AT_EXIT_SHARE):
        edges = edges_m(roads, roads.lanes[way.to_lane_id], 1.0)
        people = _walkers(way, crosswalks[-1], edges, draws, from_left=draws.happens("from_left", 0.5))
    return _scenario(id, roads, draws, course, share, TrafficDemand(_some(draws), DRIVERS, "low"), jaywalkers=people)


def _bends(way: Connector, turn: Turn) -> bool:
    bend = abs(way.centerline.turned_rad)
    return bend < np.radians(20.0) if turn is Turn.STRAIGHT else bend > np.radians(45.0)


def _through(roads: Roads, way: Connector, before_m: float, after_m: float) -> Course:
    length_m = roads[way.from_lane_id].centerline.length_m
    behind, start = walk(roads, way.from_lane_id, length_m, -before_m)
    ahead, goal = walk(roads, way.to_lane_id, 0.0, after_m)
    chain = (*reversed(behind), way.from_lane_id, way.id, way.to_lane_id, *ahead)
    return Course(start, goal, roads.route_through(chain))


def light_ahead(roads: Roads, lane_id: str, _at_m: float) -> Connector:
    ways = [roads.connectors[i] for i in roads.outgoing(lane_id)]
    ways = [w for w in ways if w.turn is Turn.STRAIGHT and w.has_traffic_light]
    if not ways:
        raise UnsuitableError("no traffic light with a way straight on ends the lane")
    return ways[0]


def stand_in_queue(id: str, roads: Roads, way: Connector, draws: Draws) -> Scenario:
    before_m = draws.uniform("distance_m", (14.0, 26.0), 1)
    course = _through(roads, way, before_m, 60.0)
    room_m = before_m - 2.6
    cars = [
        PlacedVehicle(_ahead_of(roads, course.start, 2.6 + 2.0 + 2.5 + i * 7.5), 0.0)
        for i in range(int((room_m - 2.0) // 7.5))
    ]
    return _scenario(id, roads, draws, course, 0.0, LIGHT_TRAFFIC, vehicles=cars)


def stop_behind(id: str, roads: Roads, way: Connector, draws: Draws) -> Scenario:
    course = _through(roads, way, draws.uniform("distance_m", (60.0, 90.0), 1), 50.0)
    limit_mps = _limit_mps(roads, course.start)
    lead = PlacedVehicle(_ahead_of(roads, course.start, 2.6 + 2.5 + 0.9 * limit_mps), round(0.6 * limit_mps, 1))
    return _scenario(id, roads, draws, course, 0.6, LIGHT_TRAFFIC, vehicles=[lead])


def crosswalk_ahead(roads: Roads, lane_id: str, _at_m: float) -> tuple[Connector, float]:
    """The way straight on where no light holds the ego, and where a crosswalk crosses it."""
    ways = [roads.connectors[i] for i in roads.outgoing(lane_id)]
    ways = [w for w in ways if w.turn is Turn.STRAIGHT and not w.has_traffic_light]
    if not ways:
        raise UnsuitableError("no way straight on without a traffic light leaves the lane")
    return ways[0], _crosswalk_m(roads, ways[0])


def wait_for_pedestrian(id: str, roads: Roads, place: tuple[Connector, float], draws: Draws) -> Scenario:
    way, crossing_m = place
    course = _through(roads, way, draws.uniform("distance_m", (50.0, 70.0), 1), 50.0)
    lane = roads.lanes[way.from_lane_id]
    edges = edges_m(roads, lane, lane.centerline.length_m - 1.0)
    people = _walkers(way, crossing_m, edges, draws, from_left=edges[0] < edges[1])  # from afar they come too late
    return _scenario(id, roads, draws, course, 0.6, LIGHT_TRAFFIC, jaywalkers=people)


def _walkers(
    way: Connector, crossing_m: float, edges: tuple[float, float], draws: Draws, *, from_left: bool
) -> list[Jaywalker]:
    """People who walk over a crosswalk from kerb to kerb, which are as far away as `edges` says, left and right."""
    left_m, right_m = edges
    here_m, there_m = (left_m + 1.0, -right_m - 1.0) if from_left else (-right_m - 1.0, left_m + 1.0)
    people: list[Jaywalker] = []
    for i in range(draws.by_share("people", CROSSING)):
        along_m = min(max(crossing_m + APART_M * (i % 2), 0.0), way.centerline.length_m)
        behind_m = APART_M * (i // 2) * (1.0 if from_left else -1.0)
        ends = (here_m + behind_m, there_m + behind_m)
        start, end = (LanePosition(way.id, round(along_m, CENTIMETRES), round(left_m, 2)) for left_m in ends)
        people.append(Jaywalker(start, end, round(draws.normal("walk_mps", WALK_MPS, WALKS_MPS), 2)))
    return people


def _crosswalk_m(roads: Roads, way: Connector) -> float:
    """Where the first crosswalk crosses a connector, arc length."""
    at_m = _crosswalks_m(roads, way)
    if not at_m:
        raise UnsuitableError("no crosswalk crosses the way on")
    return at_m[0]


def _crosswalks_m(roads: Roads, way: Connector) -> list[float]:
    """Where crosswalks cross a connector, arc lengths in order."""
    line = way.centerline
    at_m = [
        line.project_point(*shapely.get_coordinates(shapely.centroid(part))[0])[0]
        for area in roads.crosswalks
        if not (part := shapely.intersection(area.polygon, line.linestring)).is_empty
    ]
    return sorted(round(each_m, CENTIMETRES) for each_m in at_m)


# --- along the road ----------------------------------------------------------------------------


def bend(roads: Roads, lane_id: str, at_m: float) -> Site:
    """A bend that is felt at the limit with at least 1.5 m/s2 to the side (nuPlan's bound for the type)."""
    site = site_at(roads, lane_id, at_m, approach_m=70.0, beyond_m=60.0)
    line = roads[lane_id].centerline
    around_m = np.linspace(max(at_m - 8.0, 0.0), min(at_m + 8.0, line.length_m), 9)
    headings = np.unwrap([line.pose_at(float(s)).heading_rad for s in around_m])
    curvature = abs(float(headings[-1] - headings[0])) / float(around_m[-1] - around_m[0])
    felt_mps2 = curvature * site.limit_mps**2
    if not 1.5 <= felt_mps2 <= 3.5:
        raise UnsuitableError(f"at the limit the bend is felt with {felt_mps2:.1f} m/s2, expected 1.5 to 3.5")
    return site


def fast_road(roads: Roads, lane_id: str, at_m: float) -> Site:
    site = site_at(roads, lane_id, at_m, approach_m=30.0, beyond_m=300.0)
    if site.limit_mps < 17.0:
        raise UnsuitableError(f"the limit is {site.limit_mps:.1f} m/s, expected 17 or more")
    return site


def slow_street(roads: Roads, lane_id: str, at_m: float) -> Site:
    site = site_at(roads, lane_id, at_m, approach_m=20.0, beyond_m=110.0)
    if site.limit_mps > 11.5:
        raise UnsuitableError(f"the limit is {site.limit_mps:.1f} m/s, expected 11.5 or less")
    return site


def wide_road(roads: Roads, lane_id: str, at_m: float) -> Site:
    site = site_at(roads, lane_id, at_m, approach_m=30.0, beyond_m=180.0)
    if len(site.beside_start) < 3:
        raise UnsuitableError(f"{len(site.beside_start)} lanes, expected 3 or more")
    return site


def lane_beside(roads: Roads, lane_id: str, at_m: float) -> Site:
    """A goal on a lane with others beside it, far from a start without lights between."""
    reason = UnsuitableError("there is one lane only")
    for approach_m in LANE_CHANGE_M:
        try:
            site = site_at(roads, lane_id, at_m, approach_m=approach_m, beyond_m=GOAL_ROOM_M, room_m=GOAL_ROOM_M)
        except UnsuitableError as shorter:
            reason = shorter
            continue
        if len(site.beside_start) > 1:
            return replace(site, goal=LanePosition(lane_id, round(at_m, CENTIMETRES)))
        reason = UnsuitableError("there is one lane only")
    raise reason


def kerb_to_park(roads: Roads, lane_id: str, at_m: float) -> Site:
    site = site_at(roads, lane_id, at_m, approach_m=70.0, beyond_m=80.0)
    if site.lanes_near or _beside_m(site) < PARKING_M:
        raise UnsuitableError(f"{_beside_m(site):.1f} m beside the lane at the kerb, expected {PARKING_M} or more")
    return site


def _beside_m(site: Site) -> float:
    """Width beside the lane, towards the kerb."""
    return site.near_edge_m - site.width_m / 2.0


def drive_past(
    share: float, traffic: TrafficDemand, id: str, roads: Roads, site: Site, draws: Draws
) -> Scenario:  # fmt: skip
    """Drives past a site in traffic."""
    return _scenario(id, roads, draws, _past(site), share, traffic)


def follow(
    kind: VehicleKind, gap_s: float, share: float, id: str, roads: Roads, site: Site, draws: Draws
) -> Scenario:  # fmt: skip
    """Follows a leader of a kind, `gap_s` ahead, at `share` of the limit."""
    speed_mps = round(share * site.limit_mps, 1)
    half_m = {"car": 2.5, "truck": 4.5, "bus": 6.5, "motorcycle": 1.2}[kind]
    place = _ahead_of(roads, site.start, 2.6 + half_m + max(4.0, gap_s * speed_mps))
    lead = PlacedVehicle(place, speed_mps, kind)
    return _scenario(id, roads, draws, _past(site), share, LIGHT_TRAFFIC, vehicles=[lead])


def pass_parked(id: str, roads: Roads, site: Site, draws: Draws) -> Scenario:
    across_m = site.width_m / 2.0 + _beside_m(site) - 1.0
    standing: list[Obstacle] = []
    for ahead_m in (-9.0, 0.0, 7.5)[: draws.whole("row", (1, 3))]:
        standing.append(Obstacle(site.place(ahead_m, across_m), "car"))
        if draws.happens("somebody_waits", WAITING_SHARE):
            beside_m = ahead_m + draws.uniform("bystander_ahead_m", (-2.0, 2.0))
            beside = site.place(beside_m, across_m + draws.uniform("bystander_aside_m", PAVEMENT_M))
            standing.append(Obstacle(beside, "person", draws.uniform("bystander_turned_rad", (-3.0, 3.0))))
    return _scenario(id, roads, draws, _past(site), 0.8, LIGHT_TRAFFIC, obstacles=standing)


def change_lane(id: str, roads: Roads, site: Site, draws: Draws) -> Scenario:
    index = site.beside_start.index(site.start.lane)
    start = site.beside_start[index - 1 if index else 1]
    arc_m = min(site.start.arc_m, round(roads[start].centerline.length_m - 1.0, 2))
    start = LanePosition(start, arc_m)
    return _scenario(id, roads, draws, Course(start, site.goal, site.route), 0.7, LIGHT_TRAFFIC)


# --- through the town --------------------------------------------------------------------------


def anywhere(_roads: Roads, lane_id: str, at_m: float) -> LanePosition:
    return LanePosition(lane_id, round(at_m, CENTIMETRES))


def trip_through_town(id: str, roads: Roads, start: LanePosition, draws: Draws) -> Scenario:
    """Goes some way through the town: straight on, off to the sides and from lane to lane, as drawn."""
    share = draws.one_of("start_speed_share", (0.0, 0.4, 0.7, 0.9))
    length_m, left_m = roads[start.lane].centerline.length_m, draws.uniform("trip_m", TRIP_M, None)
    if not IN_LANE_M <= start.arc_m <= length_m - IN_LANE_M:
        raise UnsuitableError(f"an end of the lane is nearer than {IN_LANE_M:.0f} m")
    here, room_m, chain = start.lane, length_m - start.arc_m, [start.lane]
    while left_m > room_m - IN_LANE_M:
        way = _way_on(roads, here, room_m, draws)
        if roads[way.to_lane_id].roadblock_id in roads.route_through(chain):
            raise UnsuitableError("the way drawn comes back to where it was")
        left_m -= room_m + way.centerline.length_m
        here, room_m = way.to_lane_id, roads[way.to_lane_id].centerline.length_m
        chain += [way.from_lane_id, way.id, here]
    begin_m = roads[here].centerline.length_m - room_m
    goal = _beside(roads, LanePosition(here, round(begin_m + max(left_m, IN_LANE_M), CENTIMETRES)), begin_m, draws)
    course = Course(start, goal, roads.route_through((*chain, goal.lane)))
    return _scenario(id, roads, draws, course, share, TrafficDemand(_some(draws), DRIVERS, _some(draws)))


def _way_on(roads: Roads, lane_id: str, room_m: float, draws: Draws) -> Connector:
    """A way out of the roadblock, from a lane that can be reached in time; turns and straight ways alike."""
    siblings = roads.roadblocks[roads[lane_id].roadblock_id].lane_ids
    here = siblings.index(lane_id)
    near = [lane for i, lane in enumerate(siblings) if abs(i - here) * CHANGE_ROOM_M <= room_m]
    ways = [roads.connectors[way] for lane in near for way in roads.outgoing(lane)]
    turns = sorted({way.turn for way in ways} - {Turn.U_TURN})
    if not turns:
        raise UnsuitableError("the road ends on the way drawn")
    straight = Turn.STRAIGHT in turns and (len(turns) == 1 or draws.happens("straight_on", STRAIGHT_SHARE))
    others = [turn for turn in turns if turn is not Turn.STRAIGHT]
    turn = Turn.STRAIGHT if straight else draws.one_of("turn", others)
    pool = [way for way in ways if way.turn is turn]
    return draws.one_of("connector", pool)


def _beside(roads: Roads, place: LanePosition, begin_m: float, draws: Draws) -> LanePosition:
    """A goal, or in most cases the one beside it on a neighbour lane, where there is room to change."""
    neighbours = [lane for lane in (roads.left_of(place.lane), roads.right_of(place.lane)) if lane is not None]
    if not neighbours or place.arc_m - begin_m < CHANGE_ROOM_M or not draws.happens("goal_beside", BESIDE_SHARE):
        return place
    lane = draws.one_of("neighbour", neighbours)
    there = place.pose(roads)
    arc_m = round(lane.centerline.project_point(there.x_m, there.y_m)[0], CENTIMETRES)
    return LanePosition(lane.id, min(arc_m, lane.centerline.length_m - IN_LANE_M))


# --- parts -------------------------------------------------------------------------------------


def _past(site: Site) -> Course:
    return Course(site.start, site.goal, site.route)


def _scenario(
    id: str, roads: Roads, draws: Draws, course: Course, share: float, traffic: TrafficDemand, *,
    vehicles: Sequence[PlacedVehicle] = (), obstacles: Sequence[Obstacle] = (), jaywalkers: Sequence[Jaywalker] = (),
) -> Scenario:  # fmt: skip
    return Scenario(
        id=id,
        family=named_family(id),
        map=roads.name,
        start=course.start,
        start_speed_mps=round(share * _limit_mps(roads, course.start), 1),
        goal=course.goal,
        route=course.route,
        traffic=traffic,
        obstacles=tuple(obstacles),
        jaywalkers=tuple(jaywalkers),
        vehicles=tuple(vehicles),
        light_time_s=float(draws.whole("light_time_s", LIGHT_TIMES_S)),
    )


def _limit_mps(roads: Roads, place: LanePosition) -> float:
    return roads[place.lane].speed_limit_mps or USUAL_LIMIT_MPS


def _some(draws: Draws) -> Density:
    return draws.one_of("density", ("low", "medium"))


def _ahead_of(roads: Roads, start: LanePosition, ahead_m: float) -> LanePosition:
    """A place ahead of the start, on its lane; UnsuitableError where the lane ends before."""
    arc_m = round(start.arc_m + ahead_m, 2)
    if arc_m > roads[start.lane].centerline.length_m - 3.0:
        raise UnsuitableError("the lane ends before the car ahead would stand")
    return LanePosition(start.lane, arc_m)
