"""Accident: crashed cars stand at odd angles in the road, on the way or inside a junction, with people beside them."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

import numpy as np

from interplan_sumo.errors import ScenarioError
from interplan_sumo.families.draws import Draws
from interplan_sumo.families.family import Family
from interplan_sumo.families.passing import offset_asked_m, passing_problems, vehicles_standing, wreck_problems
from interplan_sumo.families.shapes import reach_m
from interplan_sumo.families.staging import (
    Approach,
    along,
    approach,
    beside_traffic,
    obstacle,
    oncoming_traffic,
    parked,
    site_for,
)
from interplan_sumo.scenario.scenario import LanePosition, Obstacle, Scenario
from interplan_sumo.scenario.sites import ROOM_M as USUAL_ROOM_M
from interplan_sumo.scenario.sites import Site, UnsuitableError
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.roads import Roads

EXEMPT: Final = ("driving_direction",)
"""One may have to pass through the oncoming lane."""
CRASHES: Final[tuple[tuple[tuple[float, float, float], ...], ...]] = (
    ((0.0, 0.0, 0.0), (0.48, 4.01, -80.0)),
    ((0.0, 0.0, 0.0), (4.73, -2.94, 130.0)),
    ((0.0, 0.0, 0.0), (-5.48, -0.31, -29.0)),
    ((0.0, 0.0, 0.0), (3.48, 2.93, -130.0)),
    ((0.0, 0.0, 0.0), (-3.55, 2.70, -42.0)),
    ((0.0, 0.0, 0.0), (1.52, 2.95, -41.0)),
    ((0.0, 0.0, 0.0), (4.95, 0.78, 23.0), (10.40, 3.31, 28.0)),
    ((0.0, 0.0, 0.0), (-4.80, 0.08, 36.0)),
    ((0.0, 0.0, 0.0), (2.34, -2.25, 37.0)),
    ((0.0, 0.0, 0.0), (3.79, 1.56, -102.0)),
)
"""interPlan's ten: each car's place relative to the first, along its heading and to its left (m), and its heading
relative to it (degrees). The cars are pushed together until their boxes intersect."""
PUSH: Final = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5)
TURNED_RAD: Final = (-0.7, 0.7)
"""Of the first car against the lane."""
ASIDE_M: Final = (-1.0, 1.6)
"""From the lane's centre line towards the kerb to the first car."""
PEOPLE: Final = (0, 3)
STANDS_OFF_M: Final = (0.9, 1.8)
"""From the side of a crashed car to somebody who stands beside it."""
FASTEST_MPS: Final = 20.5
ROOM_M: Final = PACIFICA.width_m + 2.0 * 0.6
"""What must be left of the road: the ego passes turned, and a little more than 0.3 m clear."""
NEAR_END_M: Final = 1.0
"""Nearer to the end of its lane than usual a place stands for the junction there."""
TRIES: Final = 60


def suitable(roads: Roads, lane_id: str, at_m: float) -> Site:
    """A road with a second lane to pass on, of whatever direction, or a junction; UnsuitableError otherwise."""
    site = site_for(roads, lane_id, at_m, FASTEST_MPS, room_m=NEAR_END_M)
    length_m = roads[lane_id].centerline.length_m
    if at_m < USUAL_ROOM_M:
        raise UnsuitableError(f"the beginning of the lane is nearer than {USUAL_ROOM_M:.0f} m")
    if at_m > length_m - USUAL_ROOM_M and _junction_m(roads, site) is None:
        raise UnsuitableError(f"the end of the lane is nearer than {USUAL_ROOM_M:.0f} m, and there is no junction")
    if site.lanes_far + site.lanes_near == 0 and site.oncoming_m < PACIFICA.width_m:
        raise UnsuitableError("there is no lane beside it to pass on")
    return site


def _junction_m(roads: Roads, site: Site) -> float | None:
    """From the site to the middle of the junction at the end of its lane, where one can go several ways."""
    ways = [way for way in roads.outgoing(site.lane) if roads[way].roadblock_id in site.route]
    others = roads.roadblocks[roads[site.lane].roadblock_id].lane_ids
    if not ways or len({roads[way].roadblock_id for lane in others for way in roads.outgoing(lane)}) < 2:
        return None
    straight = min(ways, key=lambda way: (abs(roads[way].centerline.turned_rad), way))
    return roads[site.lane].centerline.length_m - site.at_m + roads[straight].centerline.length_m / 2.0


def drawn(id: str, roads: Roads, site: Site, draws: Draws) -> Scenario:
    """A scenario of the family at a site, what varies drawn; UnsuitableError if no crash leaves room."""
    at_end = site.at_m > roads[site.lane].centerline.length_m - USUAL_ROOM_M
    ahead_m = (_junction_m(roads, site) or 0.0) if at_end else 0.0
    room_m = NEAR_END_M if at_end else USUAL_ROOM_M
    to = approach(roads, site, draws, before_m=4.0 - ahead_m, after_m=6.0 + ahead_m, room_m=room_m)
    for _ in draws.tries(TRIES):
        try:
            cars = crashed(roads, to.site, ahead_m, draws)
        except ScenarioError:
            continue
        to_kerb_m, away_m = reach_m(cars, to.site.kerb)
        if not at_end and max(to.site.far_edge_m - away_m, to.site.near_edge_m - to_kerb_m) < ROOM_M:
            continue
        passed_far = at_end or to.site.far_edge_m - away_m > to.site.near_edge_m - to_kerb_m
        people = bystanders(cars, to.site.kerb if passed_far else -to.site.kerb, draws)
        return to.scenario(id, "accident", obstacles=(*cars, *people), exempt=EXEMPT, **_traffic(roads, to, draws))
    raise UnsuitableError("no crash leaves room to pass")


def crashed(roads: Roads, site: Site, at_m: float, draws: Draws) -> tuple[Obstacle, ...]:
    """Cars in one of interPlan's crashes, mirrored or not, of sizes that were drawn; ScenarioError beyond the road."""
    crash = draws.one_of("crash", CRASHES)
    flip = -1.0 if draws.happens("mirrored", 0.5) else 1.0
    aside_m, turned_rad = draws.uniform("aside_m", ASIDE_M), draws.uniform("turned_rad", TURNED_RAD)
    whats = [parked(draws, "small car", "car", "sport utility", "van") for _ in crash]
    cosine, sine = np.cos(turned_rad), np.sin(turned_rad)
    for push in PUSH:
        cars: list[Obstacle] = []
        for (x_m, y_m, degrees), what in zip(crash, whats, strict=True):
            x, y = push * x_m, push * flip * y_m
            place = along(roads, site, at_m + float(cosine * x - sine * y), aside_m + float(sine * x + cosine * y))
            heading_rad = site.kerb * (turned_rad + flip * float(np.radians(degrees)))
            cars.append(obstacle(place, what, float((heading_rad + np.pi) % (2.0 * np.pi) - np.pi)))
        bare = site.scenario("crash/0", "accident", obstacles=tuple(cars))
        if not wreck_problems(bare, roads):
            return tuple(cars)
    raise ScenarioError("the cars do not meet")


def bystanders(cars: tuple[Obstacle, ...], side: int, draws: Draws) -> tuple[Obstacle, ...]:
    """People beside the cars, on their left (1) or right (-1), where nobody passes."""
    found: list[Obstacle] = []
    for _ in range(draws.whole("bystanders", PEOPLE)):
        car = draws.one_of("bystander_at", cars)
        length_m, width_m = car.size_m
        half_m = abs(np.sin(car.turned_rad)) * length_m / 2.0 + abs(np.cos(car.turned_rad)) * width_m / 2.0
        off_m = side * float(half_m + draws.uniform("bystander_off_m", STANDS_OFF_M))
        arc_m = max(0.0, round(car.place.arc_m + draws.uniform("bystander_ahead_m", (-1.5, 1.5)), 2))
        place = LanePosition(car.place.lane, arc_m, round(car.place.left_m + off_m, 2))
        found.append(Obstacle(place, "person", draws.uniform("bystander_turned_rad", (-3.0, 3.0))))
    return tuple(found)


def _traffic(roads: Roads, to: Approach, draws: Draws) -> dict[str, Any]:
    """Where the own direction has a second lane, traffic on it; else as where one overtakes."""
    if to.site.lanes_far + to.site.lanes_near == 0:
        return oncoming_traffic(roads, to, draws, complete=True)
    return beside_traffic(roads, to, draws, towards_kerb=to.site.lanes_far == 0)


def asks(scenario: Scenario, roads: Roads) -> bool:
    """Whether vehicles that have run into one another stand in the way, and nobody walks into it."""
    if scenario.jaywalkers or len(vehicles_standing(scenario)) < 2 or wreck_problems(scenario, roads):
        return False
    offset_m = offset_asked_m(scenario, roads)
    return offset_m is None or offset_m > 0.0


FAMILY: Final = Family(
    title="Accident",
    description="Crashed cars stand at odd angles and stay; pass them with care, if need be through the oncoming lane.",
    suitable=suitable,
    drawn=drawn,
    telling=("crash", "aside_m"),
    order=20,
    column="Acc.",
    checks=(wreck_problems, partial(passing_problems, own_side_only=False)),
    may_overlap=vehicles_standing,
    exempt=EXEMPT,
    weighs_direction=True,
    asks=asks,
    original="avoid_crashed_cars",
)
