"""Jaywalker: people step into the road when the ego comes near, from behind something or in the open."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot
from typing import Final

import numpy as np

from interplan_sumo.errors import ScenarioError
from interplan_sumo.families.crossing import unhurt_problems
from interplan_sumo.families.draws import Draws
from interplan_sumo.families.family import Family
from interplan_sumo.families.staging import (
    TRIES,
    WALK_MPS,
    WALKS_MPS,
    Approach,
    along,
    approach,
    behaviour,
    bus,
    obstacle,
    parked,
    site_for,
)
from interplan_sumo.scenario.jaywalking import trigger_distance_m
from interplan_sumo.scenario.scenario import Jaywalker, Obstacle, Scenario, TrafficDemand, WalkStage
from interplan_sumo.scenario.sites import Site, UnsuitableError
from interplan_sumo.world.roads import Roads

FASTEST_MPS: Final = 13.9
"""Sites have limits up to 50 km/h (decisions.md)."""
SPARE_M: Final = 4.0
"""The ego starts so much farther away than the trigger: half its length, and some."""
KERB_M: Final = 0.5
"""People wait at least this far behind the edge of the road, and walk a metre beyond the other one."""
BEYOND_KERB_M: Final = 1.0
MIDDLE_OF_EGO_S: Final = 0.2
"""A person is in the middle of the lane this long after the front of a car that holds its speed is there."""
CYCLES_MPS: Final = (2.6, 3.6)
COURSES: Final = {"straight": 0.75, "stops": 0.09, "turns back": 0.08, "runs": 0.08}
"""One in four stops midway, turns back or breaks into a run (benchmark.md, version 2)."""
STOPS_S: Final = (0.8, 2.5)
CYCLIST_SHARE: Final = 0.12
"""Of the first of the people, one who rides off the pavement."""
FAR_SHARE: Final = 0.35
GROUP: Final = {1: 0.4, 2: 0.35, 3: 0.15, 4: 0.1}
"""How many cross."""
BYSTANDERS: Final = (0, 2)
"""How many wait and stay."""
APART_M: Final = (0.9, 1.8)
SLANT_M: Final = (-3.0, 3.0)
HIDERS: Final = {"nothing": 0.3, "row": 0.3, "van": 0.15, "truck": 0.1, "bus": 0.15}
"""What stands between the ego and those who cross."""
ROW: Final = (2, 4)
PASSAGE_M: Final = (1.3, 2.0)
"""Between what hides somebody and the middle of the way that it takes."""
BAY_M: Final = (0.15, 0.45)
"""What is parked stands this far beyond the edge of the lane."""


@dataclass(frozen=True, slots=True)
class Person:
    """One who crosses."""

    speed_mps: float
    ahead_m: float = 0.0
    """Where it waits, along the road from the site."""
    slant_m: float = 0.0
    """How far along the road, in the ego's direction, it walks while crossing."""
    far: bool = False
    """Comes from the far side."""
    course: str = "straight"
    pause_s: float = 0.0
    """How long it stands midway, or before it turns back."""
    cyclist: bool = False


def crossing(roads: Roads, to: Approach, person: Person) -> Jaywalker:
    """From behind one kerb to behind the other, or back, so that it meets an ego that holds lane and speed.

    ScenarioError if somebody walks too slowly to start behind the kerb.
    """
    site = to.site
    reach_s = trigger_distance_m(to.start_speed_mps) / to.start_speed_mps + MIDDLE_OF_EGO_S
    here_m, there_m = (site.far_edge_m, site.near_edge_m) if person.far else (site.near_edge_m, site.far_edge_m)
    start_m = person.speed_mps * reach_s
    width_m = start_m + there_m + BEYOND_KERB_M
    for _ in range(20):  # the slanted way is longer: speed across and place of the start depend on one another
        width_m = start_m + there_m + BEYOND_KERB_M
        start_m = person.speed_mps * width_m / hypot(width_m, person.slant_m) * reach_s
    if start_m < here_m + KERB_M:
        raise ScenarioError(
            f"a person at {person.speed_mps} m/s would have to wait on the road, {start_m:.1f} m from the lane's "
            f"centre line; it must walk at least {(here_m + KERB_M) / reach_s:.2f} m/s"
        )
    sign = -1.0 if person.far else 1.0
    middle_m = person.ahead_m + person.slant_m * start_m / width_m
    start = along(roads, site, person.ahead_m, sign * start_m)
    middle = along(roads, site, middle_m, 0.0)
    end = along(roads, site, person.ahead_m + person.slant_m, -sign * (there_m + BEYOND_KERB_M))
    kind = "cyclist" if person.cyclist else "pedestrian"
    if person.course == "stops":
        return Jaywalker(start, end, person.speed_mps, (WalkStage(middle, person.speed_mps, person.pause_s),), kind)
    if person.course == "turns back":
        via = (WalkStage(middle, person.speed_mps, person.pause_s),)
        return Jaywalker(start, start, min(1.2 * person.speed_mps, WALKS_MPS[1]), via, kind)
    if person.course == "runs":
        return Jaywalker(start, end, round(2.0 * person.speed_mps, 2), (WalkStage(middle, person.speed_mps),), kind)
    return Jaywalker(start, end, person.speed_mps, (), kind)


def suitable(roads: Roads, lane_id: str, at_m: float) -> Site:
    """A road of at most 50 km/h with a kerb near enough to come from; UnsuitableError otherwise."""
    site = site_for(roads, lane_id, at_m, FASTEST_MPS)
    _slowest_mps(site, START_S, far=False)
    return site


START_S: Final = 4.2
"""Between the trigger and the meeting, at most speeds."""


def _slowest_mps(site: Site, reach_s: float, *, far: bool) -> float:
    """The slowest walk with which one can start behind a kerb; UnsuitableError if that is too far away."""
    edge_m = site.far_edge_m if far else site.near_edge_m
    least_mps = max(WALKS_MPS[0], (edge_m + KERB_M) / reach_s + 0.03)
    if least_mps > WALKS_MPS[1]:
        raise UnsuitableError(f"the {'far' if far else 'near'} kerb is {edge_m:.1f} m away: too far to walk in time")
    return least_mps


def drawn(id: str, roads: Roads, site: Site, draws: Draws) -> Scenario:
    """A scenario of the family at a site, what varies drawn at random."""
    to = _approach(roads, site, draws)
    hider = draws.by_share("hidden_by", HIDERS)
    people = _people(to, draws, hidden=hider != "nothing")
    walkers = tuple(crossing(roads, to, person) for person in people)
    standing = [*_hiding(roads, to, people[0], hider, draws), *_waiting(roads, to, people, draws)]
    demand = TrafficDemand(density="medium", behaviour=behaviour(draws), oncoming="low")
    return to.scenario(id, "jaywalker", obstacles=tuple(standing), jaywalkers=walkers, traffic=demand)


def _approach(roads: Roads, site: Site, draws: Draws) -> Approach:
    """Farther away than everybody's trigger, so that they wait at the start."""
    for _ in draws.tries(TRIES):
        to = approach(roads, site, draws, after_m=max(APART_M) * max(GROUP) + max(SLANT_M))
        if to.distance_m > trigger_distance_m(to.start_speed_mps) + SPARE_M - min(SLANT_M):
            return to
    raise UnsuitableError("no start is far enough away for its speed that everybody still waits")


def _people(to: Approach, draws: Draws, *, hidden: bool) -> list[Person]:
    """Those who cross; the first of them meets the ego whatever the others do."""
    reach_s = trigger_distance_m(to.start_speed_mps) / to.start_speed_mps + MIDDLE_OF_EGO_S
    people: list[Person] = []
    ahead_m = 0.0
    for i in range(draws.by_share("people", GROUP)):
        far = draws.happens("from_far_side", FAR_SHARE)
        try:
            least_mps = _slowest_mps(to.site, reach_s, far=far)
        except UnsuitableError:
            far = False
            least_mps = _slowest_mps(to.site, reach_s, far=False)
        speed_mps = round(draws.normal("walk_mps", WALK_MPS, (least_mps, WALKS_MPS[1])) + 0.005, 2)
        if i == 0 and draws.happens("cyclist", CYCLIST_SHARE):
            speed_mps = draws.uniform("cycle_mps", CYCLES_MPS)
            people.append(Person(speed_mps, far=far, cyclist=True))
            ahead_m += draws.uniform("people_apart_m", APART_M)
            continue
        slant_m = 0.0 if hidden or draws.happens("walks_straight", 0.6) else draws.uniform("slant_m", SLANT_M, 1)
        if slant_m:
            speed_mps = round(min(speed_mps + 0.15, WALKS_MPS[1] + 0.1), 2)
        course = draws.by_share("course", COURSES)
        pause_s = draws.uniform("pause_s", STOPS_S, 1) if course in ("stops", "turns back") else 0.0
        people.append(Person(speed_mps, round(ahead_m, 2), slant_m, far, course, pause_s))
        ahead_m += draws.uniform("people_apart_m", APART_M)
    return people


def _hiding(roads: Roads, to: Approach, first: Person, hider: str, draws: Draws) -> list[Obstacle]:
    """Something parked before the first of those who cross, as the ego sees it, at the kerb that it comes from."""
    if hider == "nothing":
        return []
    many = draws.whole("row", ROW) if hider == "row" else 1
    side = -1.0 if first.far else 1.0
    edge_m = to.site.far_edge_m if first.far else to.site.near_edge_m
    end_m = first.ahead_m - draws.uniform("passage_m", PASSAGE_M)
    found: list[Obstacle] = []
    for _ in range(many):
        what = bus(draws) if hider == "bus" else parked(draws, *(() if hider == "row" else (hider,)))
        _, (length_m, width_m, _) = what
        beside_m = edge_m + draws.uniform("bay_m", BAY_M) + width_m / 2.0
        place = along(roads, to.site, end_m - length_m / 2.0, side * beside_m)
        found.append(obstacle(place, what, np.pi if first.far else 0.0))
        end_m -= length_m + draws.uniform("row_gap_m", (0.8, 1.6))
    return found


def _waiting(roads: Roads, to: Approach, people: list[Person], draws: Draws) -> list[Obstacle]:
    """People on the pavement who stay there."""
    found: list[Obstacle] = []
    ahead_m = max(person.ahead_m for person in people) + max(SLANT_M)
    for _ in range(draws.whole("bystanders", BYSTANDERS)):
        ahead_m += draws.uniform("bystander_ahead_m", (1.2, 4.0))
        far = draws.happens("bystander_far_side", FAR_SHARE)
        edge_m = to.site.far_edge_m if far else to.site.near_edge_m
        aside_m = (edge_m + KERB_M + draws.uniform("bystander_aside_m", (0.2, 1.2))) * (-1.0 if far else 1.0)
        turned_rad = draws.uniform("bystander_turned_rad", (-3.0, 3.0))
        found.append(Obstacle(along(roads, to.site, ahead_m, aside_m), "person", turned_rad))
    return found


def asks(scenario: Scenario, _roads: Roads) -> bool:
    """Whether anybody walks into the road."""
    return bool(scenario.jaywalkers)


FAMILY: Final = Family(
    title="Jaywalker",
    description="People step into the road when the ego comes near; anticipate, stop or slow, do not swerve at speed.",
    suitable=suitable,
    drawn=drawn,
    telling=("hidden_by", "walk_mps"),
    order=30,
    column="Jayw.",
    checks=(unhurt_problems,),
    asks=asks,
    audit_class="jaywalkers",
    original="jaywalking_pedestrian",
)
