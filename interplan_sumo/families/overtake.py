"""Overtake: a parked vehicle blocks the lane of a two-way road."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np

from interplan_sumo.errors import ScenarioError
from interplan_sumo.families.family import Family
from interplan_sumo.families.passing import beyond_own_side, is_small, offset_asked_m, passing_problems
from interplan_sumo.families.shapes import CLEARANCE_M, LARGEST_OFFSET_M, PASSING_M
from interplan_sumo.scenario.scenario import (
    OBSTACLES,
    Behaviour,
    Density,
    LanePosition,
    Obstacle,
    ObstacleKind,
    PlacedVehicle,
    Scenario,
    TrafficDemand,
)
from interplan_sumo.scenario.sites import Site, UnsuitableError, roomiest_site_at
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.roads import Roads

EXEMPT: Final = ("driving_direction",)
"""One must pass through the oncoming lane."""
APPROACH_M: Final = 70.0
BEYOND_M: Final = 80.0
FASTEST_MPS: Final = 16.0


def overtake(
    id: str,
    *,
    site: Site,
    offset_m: float,
    oncoming: Density = "none",
    behind_m: tuple[float, ...] = (),
    kind: ObstacleKind = "car",
    behaviour: Behaviour = "mixed",
) -> Scenario:
    """A parked vehicle that one passes, 0.3 m clear, `offset_m` off the lane's centre line, on the oncoming side.

    `behind_m` are the distances, centre to centre, of cars that follow the ego at
    its speed. ScenarioError if the road has no room, or if the ego could stay on its own side.
    """
    _, _, width_m = OBSTACLES[kind]
    if offset_m <= max(LARGEST_OFFSET_M, site.width_m / 2.0):
        raise ScenarioError(f"{id}: offset_m is {offset_m}: the ego could pass on its own side; use nudge()")
    needed_m = offset_m + PACIFICA.width_m / 2.0 + CLEARANCE_M
    if needed_m > site.width_m / 2.0 + site.oncoming_m:
        raise ScenarioError(
            f"{id}: passing takes {needed_m:.2f} m beside the lane's centre line, "
            f"the road has {site.width_m / 2.0 + site.oncoming_m:.2f} m"
        )
    parked = Obstacle(site.place(0.0, PASSING_M - offset_m + width_m / 2.0), kind)
    places = [LanePosition(site.start.lane, round(site.start.arc_m - away_m, 2)) for away_m in behind_m]
    followers = [PlacedVehicle(place, site.start_speed_mps) for place in places]
    traffic = TrafficDemand(oncoming=oncoming, behaviour=behaviour)
    staged = {"traffic": traffic, "obstacles": (parked,), "vehicles": tuple(followers)}
    return site.scenario(id, "overtake", **staged, exempt=EXEMPT)


def suitable(roads: Roads, lane_id: str, at_m: float) -> Site:
    """A two-way road with one lane per direction and room to pass; UnsuitableError otherwise."""
    site = roomiest_site_at(roads, lane_id, at_m, approach_m=APPROACH_M, beyond_m=BEYOND_M)
    if site.limit_mps > FASTEST_MPS:
        raise UnsuitableError(f"the limit is {site.limit_mps:.1f} m/s, cars park on roads of {FASTEST_MPS} or less")
    if site.lanes_near + site.lanes_far:
        raise UnsuitableError("there is a second lane in the own direction")
    if site.oncoming_m < PACIFICA.width_m + CLEARANCE_M:
        raise UnsuitableError("there is no oncoming lane beside it")
    return site


def drawn(id: str, _roads: Roads, site: Site, rng: np.random.Generator) -> Scenario:
    """A scenario of the family at a site, what varies drawn at random."""
    least_m = max(LARGEST_OFFSET_M, site.width_m / 2.0) + 0.1
    most_m = min(site.width_m / 2.0 + site.oncoming_m - PASSING_M, least_m + 0.8)
    if most_m < least_m:
        raise UnsuitableError("the oncoming lane is too narrow to pass on")
    oncoming: Density = "sparse" if rng.random() < 0.6 else "none"  # denser traffic, which has no end, leaves no gap
    followers = tuple(d for d in (15.0, 32.0) if site.start.arc_m - d > 5.0 and rng.random() < 0.3)
    return overtake(
        id,
        site=site,
        offset_m=float(np.round(rng.uniform(least_m, most_m), 2)),
        oncoming=oncoming,
        behind_m=followers,
        behaviour=("conservative", "assertive", "mixed")[int(rng.integers(3))],
    )


def asks(scenario: Scenario, roads: Roads) -> bool:
    """Whether something stands there that is not passed on the own side."""
    return not is_small(offset_asked_m(scenario, roads))


FAMILY: Final = Family(
    title="Overtake",
    description="A parked vehicle blocks the lane; wait for a gap, use the oncoming lane, come back.",
    suitable=suitable,
    drawn=drawn,
    order=50,
    column="Overt.",
    checks=(partial(passing_problems, own_side_only=False, offset=beyond_own_side),),
    exempt=EXEMPT,
    weighs_direction=True,
    asks=asks,
    original="overtake_parked_vehicle",
)
