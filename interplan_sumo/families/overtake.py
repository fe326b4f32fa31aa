"""Overtake: something blocks the lane of a two-way road, or crawls along it, and others come towards the ego."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

from interplan_sumo.errors import ScenarioError
from interplan_sumo.families.draws import Draws
from interplan_sumo.families.family import Family
from interplan_sumo.families.passing import beyond_own_side, is_small, offset_asked_m, passing_problems
from interplan_sumo.families.shapes import CLEARANCE_M, LARGEST_OFFSET_M, PASSING_M
from interplan_sumo.families.staging import (
    Approach,
    approach,
    bus,
    obstacle,
    oncoming_traffic,
    parked,
    site_for,
)
from interplan_sumo.scenario.kinds import SLOW_SIZES_M, VehicleKind
from interplan_sumo.scenario.scenario import Obstacle, PlacedVehicle, Scenario
from interplan_sumo.scenario.sites import Site, UnsuitableError
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.roads import Roads

EXEMPT: Final = ("driving_direction",)
"""One must pass through the oncoming lane."""
FASTEST_MPS: Final = 16.0
SLOW_SHARE: Final = 0.2
"""Of the scenes in which what blocks the lane moves."""
BUS_SHARE: Final = 0.15
SLOW: Final[dict[VehicleKind, tuple[float, float]]] = {"bicycle": (3.0, 5.0), "tractor": (3.5, 5.5)}
"""Speeds, m/s: cyclists in towns ride at 4 to 6 m/s on the flat, slower uphill; tractors at work at 10 to 20 km/h."""
SLOW_M: Final = (25.0, 50.0)
"""From the start to a slow vehicle, and how near to the middle of the lane a cyclist keeps that takes the lane."""
ASIDE_M: Final = (0.0, 0.35)
FOLLOWED_M: Final = 175.0
"""To here nobody comes in time who stays behind one at 4 m/s."""
TURNED_M: Final = 0.25
"""What is left of the road beside the ego and 0.3 m: it passes turned."""
REACH_M: Final = 0.8
"""How much farther aside than needed the ego may have to pass."""


def blocked(id: str, to: Approach, standing: Obstacle, staged: dict[str, Any]) -> Scenario:
    """What stands there, passed through the oncoming lane; ScenarioError if the ego could stay on its own side."""
    _, width_m = standing.size_m
    offset_m = PASSING_M + width_m / 2.0 - to.site.kerb * standing.place.left_m
    if offset_m <= max(LARGEST_OFFSET_M, to.site.width_m / 2.0):
        raise ScenarioError(f"{id}: passing takes {offset_m:.2f} m: the ego could pass on its own side; use a nudge")
    needed_m = offset_m + PACIFICA.width_m / 2.0 + CLEARANCE_M
    if needed_m > to.site.width_m / 2.0 + to.site.oncoming_m:
        raise ScenarioError(
            f"{id}: passing takes {needed_m:.2f} m beside the lane's centre line, "
            f"the road has {to.site.width_m / 2.0 + to.site.oncoming_m:.2f} m"
        )
    return to.scenario(id, "overtake", obstacles=(standing,), exempt=EXEMPT, **staged)


def suitable(roads: Roads, lane_id: str, at_m: float) -> Site:
    """A two-way road with one lane per direction and room to pass; UnsuitableError otherwise."""
    site = site_for(roads, lane_id, at_m, FASTEST_MPS)
    if site.lanes_near + site.lanes_far:
        raise UnsuitableError("there is a second lane in the own direction")
    if site.oncoming_m < PACIFICA.width_m + CLEARANCE_M:
        raise UnsuitableError("there is no oncoming lane beside it")
    return site


def drawn(id: str, roads: Roads, site: Site, draws: Draws) -> Scenario:
    """A scenario of the family at a site, what varies drawn at random."""
    if draws.happens("slow_vehicle", SLOW_SHARE):
        return _behind_slow(id, roads, site, draws)
    what = bus(draws) if draws.happens("bus", BUS_SHARE) else parked(draws)
    _, (length_m, width_m, _) = what
    to = approach(roads, site, draws, before_m=length_m / 2.0, after_m=length_m / 2.0)
    least_m = max(LARGEST_OFFSET_M, site.width_m / 2.0) + 0.1
    most_m = min(site.width_m / 2.0 + site.oncoming_m - PASSING_M - TURNED_M, least_m + REACH_M)
    if most_m < least_m:
        raise UnsuitableError("the oncoming lane is too narrow to pass on")
    offset_m = draws.uniform("offset_m", (least_m, most_m))
    standing = obstacle(to.site.place(0.0, PASSING_M - offset_m + width_m / 2.0), what)
    return blocked(id, to, standing, oncoming_traffic(roads, to, draws, complete=True))


def _behind_slow(id: str, roads: Roads, site: Site, draws: Draws) -> Scenario:
    """A cyclist in the middle of the lane, or a tractor, that is passed while it moves."""
    kind: VehicleKind = "bicycle" if draws.happens("bicycle", 0.5) else "tractor"
    speed_mps = draws.uniform("slow_mps", SLOW[kind], 1)
    beyond_m = (FOLLOWED_M - SLOW_M[0], FOLLOWED_M)
    to = approach(roads, site, draws, distance_m=SLOW_M, beyond_m=beyond_m)
    length_m, _ = SLOW_SIZES_M[kind]
    aside_m = draws.uniform("aside_m", ASIDE_M) if kind == "bicycle" else 0.0
    ahead = PlacedVehicle(to.site.place(length_m / 2.0, aside_m), speed_mps, kind)
    staged = oncoming_traffic(roads, to, draws, complete=True)
    return to.scenario(id, "overtake", exempt=EXEMPT, **{**staged, "vehicles": (ahead, *staged.get("vehicles", ()))})


def asks(scenario: Scenario, roads: Roads) -> bool:
    """Whether something stands or crawls there that is not passed on the own side."""
    return not is_small(offset_asked_m(scenario, roads))


FAMILY: Final = Family(
    title="Overtake",
    description="Something blocks the lane or crawls along it; wait for a gap, use the oncoming lane, come back.",
    suitable=suitable,
    drawn=drawn,
    telling=("offset_m", "start_speed_share"),
    order=50,
    column="Overt.",
    checks=(partial(passing_problems, own_side_only=False, offset=beyond_own_side),),
    exempt=EXEMPT,
    weighs_direction=True,
    asks=asks,
    original="overtake_parked_vehicle",
)
