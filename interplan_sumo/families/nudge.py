"""Nudge: a parked car stands half in the lane."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np

from interplan_sumo.errors import ScenarioError
from interplan_sumo.families.family import Family
from interplan_sumo.families.passing import is_small, offset_asked_m, passing_problems, small_offset
from interplan_sumo.families.shapes import LARGEST_OFFSET_M, PASSING_M
from interplan_sumo.scenario.scenario import OBSTACLES, Obstacle, ObstacleKind, Scenario
from interplan_sumo.scenario.sites import Site, UnsuitableError, roomiest_site_at
from interplan_sumo.world.roads import Roads

APPROACH_M: Final = 70.0
BEYOND_M: Final = 80.0
FASTEST_MPS: Final = 16.0
"""Nobody parks half in the lane on faster roads."""


def nudge(id: str, *, site: Site, offset_m: float, kind: ObstacleKind = "car", turned_rad: float = 0.0) -> Scenario:
    """A parked vehicle that one passes, 0.3 m clear, `offset_m` off the lane's centre line.

    `turned_rad` turns its nose towards the road.
    """
    if not 0.0 < offset_m <= LARGEST_OFFSET_M:
        raise ScenarioError(
            f"{id}: offset_m is {offset_m}, expected more than 0 and at most {LARGEST_OFFSET_M}; "
            "use overtake() where the oncoming lane is needed"
        )
    _, length_m, width_m = OBSTACLES[kind]
    half_m = abs(np.sin(turned_rad)) * length_m / 2.0 + abs(np.cos(turned_rad)) * width_m / 2.0
    towards_kerb_m = PASSING_M - offset_m + float(half_m)
    parked = Obstacle(site.place(0.0, towards_kerb_m), kind, turned_rad=round(-site.kerb * turned_rad, 3) + 0.0)
    return site.scenario(id, "nudge", obstacles=(parked,))


def suitable(roads: Roads, lane_id: str, at_m: float) -> Site:
    """A kerb lane of a road that is not too fast, and wide enough to pass on; UnsuitableError otherwise."""
    site = roomiest_site_at(roads, lane_id, at_m, approach_m=APPROACH_M, beyond_m=BEYOND_M)
    if site.limit_mps > FASTEST_MPS:
        raise UnsuitableError(f"the limit is {site.limit_mps:.1f} m/s, cars park on roads of {FASTEST_MPS} or less")
    if site.lanes_near:
        raise UnsuitableError("it is not the lane at the kerb")
    if site.far_edge_m < LARGEST_OFFSET_M + PASSING_M:
        raise UnsuitableError(f"the road ends {site.far_edge_m:.1f} m beside the lane's centre line: no room to pass")
    return site


def drawn(id: str, _roads: Roads, site: Site, rng: np.random.Generator) -> Scenario:
    """A scenario of the family at a site, what varies drawn at random."""
    largest_m = min(LARGEST_OFFSET_M, site.width_m / 2.0)  # the ego's centre stays in its lane
    return nudge(
        id,
        site=site,
        offset_m=float(np.round(rng.uniform(0.5, largest_m), 2)),
        turned_rad=float(np.round(rng.uniform(-0.1, 0.1), 2)),
    )


def asks(scenario: Scenario, roads: Roads) -> bool:
    """Whether what stands there is passed with a small offset."""
    offset_m = offset_asked_m(scenario, roads)
    return is_small(offset_m) and offset_m != 0.0


FAMILY: Final = Family(
    title="Nudge",
    description="A parked car stands half in the lane; pass it on the own side with a moderate lateral offset.",
    suitable=suitable,
    drawn=drawn,
    order=40,
    checks=(partial(passing_problems, own_side_only=True, offset=small_offset),),
    weighs_direction=True,
    asks=asks,
    original="nudge_around_parked_vehicle",
)
