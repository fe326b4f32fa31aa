"""Jaywalker: people step into the road when the ego comes near."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot
from typing import Final, Literal

import numpy as np

from interplan_sumo.errors import ScenarioError
from interplan_sumo.families.crossing import unhurt_problems
from interplan_sumo.families.family import Family
from interplan_sumo.scenario.jaywalking import trigger_distance_m
from interplan_sumo.scenario.scenario import OBSTACLES, Jaywalker, Obstacle, Scenario
from interplan_sumo.scenario.sites import Site, UnsuitableError, roomiest_site_at
from interplan_sumo.world.roads import Roads

APPROACH_M: Final = 80.0
"""More than the farthest trigger, so that everyone waits at the start."""
BEYOND_M: Final = 60.0
FASTEST_MPS: Final = 13.9
"""Sites have limits up to 50 km/h (decisions.md)."""
KERB_M: Final = 0.5
"""People wait at least this far behind the edge of the road, and walk a metre beyond the other one."""
BEYOND_KERB_M: Final = 1.0
MIDDLE_OF_EGO_S: Final = 0.2
"""A person is in the middle of the lane this long after the front of a car that holds its speed is there."""
SLOWEST_MPS, FASTEST_WALK_MPS = 1.0, 1.9
BEFORE_BUS_M: Final = 1.2
"""A hidden person steps out this far before the front of the bus."""
BAY_M: Final = 1.6
"""A bus in its bay stands with its middle this far beyond the lane's edge."""


@dataclass(frozen=True, slots=True)
class Person:
    """One who walks straight across."""

    speed_mps: float
    ahead_m: float = 0.0
    """Where it waits, along the road from the site."""
    slant_m: float = 0.0
    """How far along the road, in the ego's direction, it walks while crossing."""
    far: bool = False
    """Comes from the far side."""


def jaywalker(
    id: str,
    *,
    site: Site,
    people: tuple[Person, ...],
    bus: Literal["none", "bay", "kerb_lane"] = "none",
) -> Scenario:
    """`people` cross so that a car that holds lane and speed meets each of them in the middle of its lane.

    A stopped `bus`, in a bay beside the lane or in the lane at the kerb, hides
    the first of them. ScenarioError if somebody walks too slowly to start behind the kerb.
    """
    if site.limit_mps > FASTEST_MPS:
        raise ScenarioError(f"{id}: the limit at the site is {site.limit_mps} m/s, expected at most {FASTEST_MPS}")
    speed_mps = site.start_speed_mps
    walks = tuple(_walk(id, site, person, speed_mps) for person in people)
    obstacles: tuple[Obstacle, ...] = ()
    if bus != "none":
        if bus == "kerb_lane" and not site.lanes_near:
            raise ScenarioError(f"{id}: bus is 'kerb_lane', but the ego's lane is the one at the kerb; use 'bay'")
        half_m = OBSTACLES["bus"][1] / 2.0
        across_m = site.width_m if bus == "kerb_lane" else site.width_m / 2.0 + BAY_M
        obstacles = (Obstacle(site.place(people[0].ahead_m - BEFORE_BUS_M - half_m, across_m), "bus"),)
    return site.scenario(id, "jaywalker", obstacles=obstacles, jaywalkers=walks, occluder=0 if obstacles else None)


def _walk(id: str, site: Site, person: Person, ego_mps: float) -> Jaywalker:
    """From behind one kerb to behind the other, timed by the trigger."""
    reach_s = trigger_distance_m(ego_mps) / ego_mps + MIDDLE_OF_EGO_S
    here_m, there_m = (site.far_edge_m, site.near_edge_m) if person.far else (site.near_edge_m, site.far_edge_m)
    start_m = person.speed_mps * reach_s
    for _ in range(20):  # the slanted way is longer: speed across and place of the start depend on one another
        width_m = start_m + there_m + BEYOND_KERB_M
        start_m = person.speed_mps * width_m / hypot(width_m, person.slant_m) * reach_s
    if start_m < here_m + KERB_M:
        least_mps = (here_m + KERB_M) / reach_s
        raise ScenarioError(
            f"{id}: a person at {person.speed_mps} m/s would have to wait on the road, "
            f"{start_m:.1f} m from the lane's centre line; it must walk at least {least_mps:.2f} m/s"
        )
    sign = -1.0 if person.far else 1.0
    start = site.place(person.ahead_m, sign * start_m)
    end = site.place(person.ahead_m + person.slant_m, -sign * (there_m + BEYOND_KERB_M))
    return Jaywalker(start, end, person.speed_mps)


def walking_speeds_mps(site: Site, *, far: bool) -> tuple[float, float]:
    """The slowest and the fastest walk that the family has at a site; UnsuitableError if the kerb is too far away."""
    ego_mps = site.start_speed_mps
    reach_s = trigger_distance_m(ego_mps) / ego_mps + MIDDLE_OF_EGO_S
    edge_m = site.far_edge_m if far else site.near_edge_m
    least_mps = max(SLOWEST_MPS, (edge_m + KERB_M) / reach_s + 0.03)
    if least_mps > FASTEST_WALK_MPS:
        raise UnsuitableError(f"the {'far' if far else 'near'} kerb is {edge_m:.1f} m away: too far to walk in time")
    return least_mps, FASTEST_WALK_MPS


def suitable(roads: Roads, lane_id: str, at_m: float) -> Site:
    """A road of at most 50 km/h with a kerb near enough to come from; UnsuitableError otherwise."""
    site = roomiest_site_at(roads, lane_id, at_m, approach_m=APPROACH_M, beyond_m=BEYOND_M)
    if site.limit_mps > FASTEST_MPS:
        raise UnsuitableError(f"the limit is {site.limit_mps:.1f} m/s, jaywalkers need {FASTEST_MPS} or less")
    walking_speeds_mps(site, far=False)
    return site


def drawn(id: str, _roads: Roads, site: Site, rng: np.random.Generator) -> Scenario:
    """A scenario of the family at a site, what varies drawn at random."""
    people: list[Person] = []
    for i in range(int(rng.integers(1, 4))):
        far = bool(rng.random() < 0.3)
        try:
            least_mps, most_mps = walking_speeds_mps(site, far=far)
        except UnsuitableError:
            far = False
            least_mps, most_mps = walking_speeds_mps(site, far=False)
        speed_mps = float(np.ceil(rng.uniform(least_mps, min(most_mps, least_mps + 0.5)) * 100.0) / 100.0)
        slant_m = 0.0 if i or rng.random() < 0.5 else float(np.round(rng.uniform(-3.0, 3.0), 1))
        if slant_m:
            speed_mps = round(min(speed_mps + 0.2, FASTEST_WALK_MPS + 0.1), 2)
        people.append(Person(speed_mps, float(np.round(i * rng.uniform(0.8, 2.0), 1)), slant_m, far))
    bus: Literal["none", "kerb_lane"] = "kerb_lane" if site.lanes_near == 1 and rng.random() < 0.5 else "none"
    if bus != "none":
        people[0] = Person(walking_speeds_mps(site, far=False)[0] + 0.05)
    return jaywalker(id, site=site, people=tuple(people), bus=bus)


def asks(scenario: Scenario, _roads: Roads) -> bool:
    """Whether anybody walks into the road."""
    return bool(scenario.jaywalkers)


FAMILY: Final = Family(
    title="Jaywalker",
    description="People step into the road when the ego comes near; anticipate, stop or slow, do not swerve at speed.",
    suitable=suitable,
    drawn=drawn,
    order=30,
    column="Jayw.",
    checks=(unhurt_problems,),
    asks=asks,
    audit_class="jaywalkers",
    original="jaywalking_pedestrian",
)
