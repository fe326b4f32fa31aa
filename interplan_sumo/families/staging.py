"""What the staged families share: where the ego starts and how fast, who drives around it, how large what stands is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot, sqrt
from typing import Any, Final

import numpy as np

from interplan_sumo.errors import ScenarioError
from interplan_sumo.families.draws import Draws
from interplan_sumo.scenario.kinds import ObstacleKind
from interplan_sumo.scenario.route import route_centerline, start_arc_m
from interplan_sumo.scenario.scenario import (
    DRIVERS,
    Behaviour,
    Density,
    LanePosition,
    Obstacle,
    PlacedVehicle,
    Scenario,
    TrafficDemand,
)
from interplan_sumo.scenario.sites import (
    BESIDE_M,
    CENTIMETRES,
    IN_LANE_M,
    OPPOSITE_RAD,
    ROOM_M,
    Site,
    UnsuitableError,
    lane_width_m,
    site_at,
    walk,
)
from interplan_sumo.world.geometry import wrap_angle
from interplan_sumo.world.roads import USUAL_LIMIT_MPS, Lane, Roads

DISTANCE_M: Final = (30.0, 120.0)
"""From the start to the event (benchmark.md, version 2)."""
START_SHARE: Final = (0.5, 1.0)
"""Of the speed limit (benchmark.md, version 2)."""
BEYOND_M: Final = (30.0, 50.0)
"""From the end of the event to the goal line."""
PERCEPTION: Final = "occluded"
TRIES: Final = 12
MEDIUM_SHARE: Final = 0.5
"""Of the scenes where one changes lane or nudges beside others; the rest has low density."""
EASY_MPS2: Final = 1.5
STANDOFF_M: Final = 10.0
"""The ego can stop at `EASY_MPS2` so far before the event; half of it is the car's own length."""
WAITING_M: Final = 24.0
"""The same where one waits for those who come: from there on one moves out to pass."""
BUMPERS_M: Final = 3.0
FREE_S: Final = 3.2
"""Nothing is hit within the first 3 s: half the ego, and some."""

BEHIND_M: Final = (6.0, 15.0)
"""On the lane beside it somebody is so far behind the ego, as fast as it, in the way of who does not look."""
STANDING: Final[
    dict[str, tuple[float, ObstacleKind, tuple[float, float], tuple[float, float], tuple[float, float]]]
] = {
    "small car": (0.2, "car", (3.6, 4.1), (1.62, 1.76), (1.44, 1.52)),
    "car": (0.35, "car", (4.3, 4.9), (1.78, 1.90), (1.42, 1.50)),
    "sport utility": (0.2, "car", (4.5, 5.1), (1.84, 2.00), (1.62, 1.85)),
    "van": (0.15, "van", (5.3, 6.9), (1.95, 2.10), (2.0, 2.8)),
    "truck": (0.1, "truck", (7.0, 10.0), (2.30, 2.50), (2.8, 3.6)),
}
"""Share among what is parked, kind, and ranges of length, width and height, m: segments of the European fleet (ICCT,
European Vehicle Market Statistics 2022/23: A/B, C/D, sport utility, light commercial), rigid trucks of up to 10 m."""
BUS: Final = ("bus", (9.5, 12.5), (2.50, 2.55), (2.9, 3.2))
"""City buses, midi to standard."""
WALK_MPS: Final = (1.42, 0.26)
"""Mean and deviation of walking speeds: those of 295 people in recordings (facts/drivers.md), as Weidmann 1993 has
them, 1.34 (0.26) m/s on pavements, faster on a road;"""
WALKS_MPS: Final = (1.0, 1.9)
"""cut to these (benchmark.md, version 2)."""
PLATOON_HEADWAY_S: Final = (1.3, 1.8)
PLATOON_APART_M: Final = 8.0
"""At the start, from middle to middle. Nobody starts inside a junction: who would, comes to the lane before it."""
PLATOON_MARGIN_S: Final = 1.0
"""Who swerves out on arrival meets oncoming cars: from so long before a drive that speeds up to the limit is there, to
so long after one that holds its speed."""
SECOND_PLATOON_S: Final = 4.0
WINDOW_S: Final = (11.0, 15.0)
"""After them no other is placed for so long: who waits beside what blocks the lane needs 6 to 8 s, and to be sure."""
REACHED_MPS2: Final = 2.0
LATEST_S: Final = 11.0
"""At its start speed the ego comes to the event within this time: a drive lasts 30 s, and some of it one waits."""


@dataclass(frozen=True, slots=True)
class Approach:
    """A site that the ego comes to from a start that was drawn, at a speed that was drawn."""

    site: Site
    start_speed_mps: float
    distance_m: float
    """From the start to the event."""

    def scenario(self, id: str, family: str, **staged: Any) -> Scenario:
        """A scenario that leads past the site, with what is `staged` there; ScenarioError as from `Scenario`."""
        made = self.site.scenario(id, family, **{"perception": PERCEPTION, **staged})
        return replace(made, start_speed_mps=self.start_speed_mps)


def site_for(roads: Roads, lane_id: str, at_m: float, fastest_mps: float, *, room_m: float = ROOM_M) -> Site:
    """The site at a place with the shortest way there and on; UnsuitableError if it has none or is too fast."""
    site = site_at(roads, lane_id, at_m, approach_m=DISTANCE_M[0], beyond_m=BEYOND_M[0], room_m=room_m)
    if site.limit_mps > fastest_mps:
        raise UnsuitableError(f"the limit is {site.limit_mps:.1f} m/s, expected {fastest_mps} or less")
    return site


def approach(
    roads: Roads,
    site: Site,
    draws: Draws,
    *,
    distance_m: tuple[float, float] = DISTANCE_M,
    before_m: float = 0.0,
    after_m: float = 0.0,
    beyond_m: tuple[float, float] = BEYOND_M,
    room_m: float = ROOM_M,
    latest_s: float = LATEST_S,
) -> Approach:
    """A start and a goal drawn for a site whose event reaches from `before_m` before it to `after_m` behind it.

    The distance and the speed are uniform, as far as the road is long enough and
    the start is sound: see `STANDOFF_M` and `FREE_S`. UnsuitableError if no draw is.
    """
    reason = UnsuitableError("no start is far enough away for its speed")
    for _ in draws.tries(TRIES):
        away_m = draws.uniform("distance_m", distance_m, 1)
        goal_m = after_m + draws.uniform("goal_beyond_m", beyond_m, 1)
        share = draws.uniform("start_speed_share", START_SHARE)
        try:
            found = site_at(roads, site.lane, site.at_m, approach_m=away_m + before_m, beyond_m=goal_m, room_m=room_m)
        except UnsuitableError as error:
            reason = error
            continue
        if site.lanes_near + site.lanes_far == 0 and _others_turn_in(roads, found):
            reason = UnsuitableError("others turn in before it, who would stand in the ego's way for good")
            continue
        away_m = _driven_m(roads, found) - before_m  # a start that falls on a junction lies before it
        if away_m > distance_m[1]:
            continue
        limit_mps = roads[found.start.lane].speed_limit_mps or USUAL_LIMIT_MPS
        standoff_m = STANDOFF_M if site.lanes_near + site.lanes_far else WAITING_M
        stops_mps = sqrt(2.0 * EASY_MPS2 * max(away_m - standoff_m, 0.0))
        most_mps = min(stops_mps, (away_m - BUMPERS_M) / FREE_S)
        speed_mps = round(min(share * limit_mps, most_mps), 1)
        made = Approach(found, speed_mps, away_m)
        if speed_mps >= START_SHARE[0] * limit_mps and away_m / speed_mps <= latest_s:
            return made
    raise reason


def _others_turn_in(roads: Roads, site: Site) -> bool:
    """Whether a lane of the way from the start to the site can be reached from elsewhere."""
    lane, upstream = site.lane, list[str]()
    while lane != site.start.lane:
        upstream.append(lane)
        before = [way for way in roads.incoming(lane) if roads[way].roadblock_id in site.route]
        if not before:
            return False
        lane = min(before, key=lambda way: (abs(roads[way].centerline.turned_rad), way))
    return any(isinstance(roads[each], Lane) and len(roads.incoming(each)) > 1 for each in upstream)


def _driven_m(roads: Roads, site: Site) -> float:
    """From the start to the site along the route."""
    bare = site.scenario("bare/0", "bare")
    at_m, _ = route_centerline(roads, bare).project_point(*_centre(roads, site))
    return at_m - start_arc_m(roads, bare)


def parked(draws: Draws, *names: str) -> tuple[ObstacleKind, tuple[float, float, float]]:
    """A standing vehicle of one of these classes, by default of any: its kind, and its length, width and height."""
    chosen = names or tuple(STANDING)
    shares = np.array([STANDING[name][0] for name in chosen])
    likely: list[float] = (shares / shares.sum()).tolist()
    _, kind, *bounds = STANDING[draws.by_share("vehicle", dict(zip(chosen, likely, strict=True)))]
    return kind, _size_m(bounds, draws)


def bus(draws: Draws) -> tuple[ObstacleKind, tuple[float, float, float]]:
    """A stopped bus."""
    return "bus", _size_m(BUS[1:], draws)


def _size_m(bounds: Sequence[tuple[float, float]], draws: Draws) -> tuple[float, float, float]:
    length_m, width_m, height_m = bounds
    return (
        draws.uniform("vehicle_length_m", length_m),
        draws.uniform("vehicle_width_m", width_m),
        draws.uniform("vehicle_height_m", height_m),
    )


def along(roads: Roads, site: Site, ahead_m: float, towards_kerb_m: float) -> LanePosition:
    """A place as `Site.place` gives it, also where it lies on the connectors or lanes of the route beyond."""
    lane, arc_m = site.lane, site.at_m + ahead_m
    while arc_m > roads[lane].centerline.length_m or arc_m < 0.0:
        ways = roads.outgoing(lane) if arc_m > 0.0 else roads.incoming(lane)
        onward = [way for way in ways if roads[way].roadblock_id in site.route]
        if not onward:
            raise ScenarioError(f"the road is too short for what is to stand {ahead_m:.1f} m from the site")
        way = min(onward, key=lambda each: (abs(roads[each].centerline.turned_rad), each))
        arc_m += -roads[lane].centerline.length_m if arc_m > 0.0 else roads[way].centerline.length_m
        lane = way
    return LanePosition(lane, round(arc_m, CENTIMETRES), round(site.kerb * towards_kerb_m, CENTIMETRES) + 0.0)


def beside_traffic(roads: Roads, to: Approach, draws: Draws, *, towards_kerb: bool = False) -> dict[str, Any]:
    """Traffic where the own direction has a second lane, on which somebody drives a little behind the ego.

    What is staged, for `Approach.scenario`; who drives there is on the side `towards_kerb`, or on the other.
    """
    density: Density = "medium" if draws.happens("medium_density", MEDIUM_SHARE) else "low"
    demand = TrafficDemand(density=density, behaviour=behaviour(draws), oncoming="low")
    start, behind_m = to.site.start, draws.uniform("follower_behind_m", BEHIND_M, 1)
    beside = roads.left_of(start.lane) if (to.site.kerb > 0) == towards_kerb else roads.right_of(start.lane)
    if beside is None:
        return {"traffic": demand}
    pose = start.pose(roads)
    arc_m = round(beside.centerline.project_point(pose.x_m, pose.y_m)[0] - behind_m, CENTIMETRES)
    if arc_m < IN_LANE_M:
        return {"traffic": demand}
    return {"traffic": demand, "vehicles": (PlacedVehicle(LanePosition(beside.id, arc_m), to.start_speed_mps),)}


def behaviour(draws: Draws) -> Behaviour:
    """The drivers of a scene."""
    return draws.one_of("drivers", DRIVERS)


# --- who comes towards the ego -----------------------------------------------------------------


def oncoming_traffic(roads: Roads, to: Approach, draws: Draws, *, complete: bool = False) -> dict[str, Any]:
    """Traffic that meets who swerves out without looking, and then leaves room: platoons, placed, and few others.

    The first platoon passes the site when the ego would come there, whatever
    speed it takes up to the limit. What is staged, for `Approach.scenario`;
    where no lane comes towards the ego, density alone. UnsuitableError where
    the road has no room for all of it, if it is to be `complete`.
    """
    demand = TrafficDemand(density="medium", behaviour=behaviour(draws), oncoming="rare")
    lane = oncoming_lane(roads, to.site)
    if lane is None:
        return {"traffic": replace(demand, oncoming="none")}
    at_m, _ = roads[lane].centerline.project_point(*_centre(roads, to.site))
    speed_mps = roads[lane].speed_limit_mps or USUAL_LIMIT_MPS
    placed: list[PlacedVehicle] = []
    passes_s = arrival_s(to) - PLATOON_MARGIN_S
    last_s = max(to.distance_m / to.start_speed_mps, passes_s) + PLATOON_MARGIN_S
    for platoon in range(2):
        while passes_s <= last_s:
            place = _upstream(roads, lane, at_m, passes_s * speed_mps)
            if place is not None:
                if not placed or _apart_m(roads, placed[-1].place, place) >= PLATOON_APART_M:
                    placed.append(PlacedVehicle(place, round(speed_mps - 0.05, 1)))
            elif complete and platoon == 0:
                raise UnsuitableError("the oncoming lane begins too near for a platoon to come from")
            passes_s += draws.uniform("platoon_headway_s", PLATOON_HEADWAY_S, None)
        passes_s += draws.uniform("platoon_window_s", WINDOW_S, None)
        last_s = passes_s + draws.uniform("platoon_lasts_s", (0.0, SECOND_PLATOON_S), None)
    return {"traffic": demand, "vehicles": tuple(placed)}


def arrival_s(to: Approach) -> float:
    """When the ego is at the event if it speeds up to the limit."""
    limit_mps, speed_mps = max(to.site.limit_mps, to.start_speed_mps), to.start_speed_mps
    speeding_s = (limit_mps - speed_mps) / REACHED_MPS2
    speeding_m = (limit_mps + speed_mps) / 2.0 * speeding_s
    if speeding_m < to.distance_m:
        return speeding_s + (to.distance_m - speeding_m) / limit_mps
    return (sqrt(speed_mps**2 + 2.0 * REACHED_MPS2 * to.distance_m) - speed_mps) / REACHED_MPS2


def oncoming_lane(roads: Roads, site: Site) -> str | None:
    """The innermost lane that comes towards the ego beside a site; None where a median parts them, or there is none."""
    siblings = roads.roadblocks[roads[site.lane].roadblock_id].lane_ids
    inner = roads.lanes[siblings[-1] if site.driving_side == "left" else siblings[0]]
    arc_m, _ = inner.centerline.project_point(*_centre(roads, site))
    here = inner.centerline.pose_at(arc_m)
    there = inner.centerline.pose_at(arc_m, -site.kerb * (lane_width_m(inner, arc_m) / 2.0 + BESIDE_M))
    for lane in roads.lanes_at(there.x_m, there.y_m):
        line = roads[lane].centerline
        heading_rad = line.pose_at(line.project_point(there.x_m, there.y_m)[0]).heading_rad
        if abs(float(wrap_angle(heading_rad - here.heading_rad))) > OPPOSITE_RAD:
            return lane
    return None


def _centre(roads: Roads, site: Site) -> tuple[float, float]:
    pose = roads[site.lane].centerline.pose_at(site.at_m)
    return pose.x_m, pose.y_m


def _apart_m(roads: Roads, one: LanePosition, other: LanePosition) -> float:
    here, there = one.pose(roads), other.pose(roads)
    return hypot(here.x_m - there.x_m, here.y_m - there.y_m)


def _upstream(roads: Roads, lane: str, at_m: float, distance_m: float) -> LanePosition | None:
    """A place where a car can start, so far before one on a lane; None where the road begins nearer."""
    try:
        place = walk(roads, lane, at_m, -distance_m)[1]
    except UnsuitableError:
        return None
    return place if isinstance(roads[place.lane], Lane) else None


def obstacle(
    place: LanePosition, what: tuple[ObstacleKind, tuple[float, float, float]], turned_rad: float = 0.0
) -> Obstacle:
    """Something that stands, of a size that was drawn."""
    kind, (length_m, width_m, height_m) = what
    return Obstacle(place, kind, round(turned_rad, 3) + 0.0, length_m, width_m, height_m)
