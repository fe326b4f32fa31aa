"""Accident: crashed cars stand at odd angles in the road."""

from __future__ import annotations

from functools import partial
from typing import Final, Literal

import numpy as np

from interplan_sumo.errors import ScenarioError
from interplan_sumo.families.family import Family
from interplan_sumo.families.passing import offset_asked_m, passing_problems, vehicles_standing, wreck_problems
from interplan_sumo.families.shapes import CLEARANCE_M, NO_TRAFFIC, reach_m
from interplan_sumo.scenario.scenario import Obstacle, Scenario, TrafficDemand
from interplan_sumo.scenario.sites import Site, UnsuitableError, roomiest_site_at
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.roads import Roads

EXEMPT: Final = ("driving_direction",)
"""One may have to pass through the oncoming lane."""
Crash = Literal["rear_end", "t_bone", "side_swipe", "pile_up"]
CRASHES: Final[dict[Crash, tuple[tuple[float, float, float], ...]]] = {
    "rear_end": ((0.0, 0.0, 0.15), (-4.2, -0.35, -0.3)),
    "t_bone": ((0.0, 0.0, 1.35), (-2.85, 0.25, -0.1)),
    "side_swipe": ((0.0, 0.0, 0.05), (1.3, 1.55, 0.4)),
    "pile_up": ((0.0, 0.0, 0.2), (-4.2, -0.3, -0.25), (-7.8, 0.7, 0.6)),
}
"""Each car's place relative to the first, ahead and towards the kerb (m), and its heading relative to the lane, turned
towards the kerb (rad). The boxes of neighbours intersect."""
APPROACH_M: Final = 70.0
BEYOND_M: Final = 80.0
FASTEST_MPS: Final = 20.5
ROOM_M: Final = PACIFICA.width_m + 2.0 * CLEARANCE_M
"""What must be left of the road."""


def accident(
    id: str,
    *,
    site: Site,
    crash: Crash,
    towards_kerb_m: float,
    turned_rad: float = 0.0,
    mirrored: bool = False,
    traffic: TrafficDemand = NO_TRAFFIC,
) -> Scenario:
    """A `crash` whose first car stands `towards_kerb_m` off the lane's centre line.

    `turned_rad` turns all of it towards the kerb, `mirrored` swaps its sides.
    ScenarioError if the road leaves less than the ego's width and 0.3 m on
    either side.
    """
    flip = -1.0 if mirrored else 1.0
    cosine, sine = np.cos(turned_rad), np.sin(turned_rad)
    cars: list[Obstacle] = []
    for ahead_m, kerbwards_m, heading_rad in CRASHES[crash]:
        across_m, heading_rad = flip * kerbwards_m, flip * heading_rad + turned_rad
        x_m = float(cosine * ahead_m - sine * across_m)
        y_m = float(sine * ahead_m + cosine * across_m)
        cars.append(
            Obstacle(site.place(x_m, towards_kerb_m + y_m), "car", turned_rad=round(float(site.kerb * heading_rad), 3))
        )
    to_kerb_m, away_m = reach_m(cars, site.kerb)
    left_m = max(site.far_edge_m - away_m, site.near_edge_m - to_kerb_m)
    if left_m < ROOM_M:
        raise ScenarioError(
            f"{id}: the crash leaves {left_m:.2f} m of the road, the ego needs {ROOM_M:.2f} m; "
            "move it with towards_kerb_m"
        )
    return site.scenario(id, "accident", traffic=traffic, obstacles=tuple(cars), exempt=EXEMPT)


def suitable(roads: Roads, lane_id: str, at_m: float) -> Site:
    """A road with a second lane to pass on, of whatever direction; UnsuitableError otherwise."""
    site = roomiest_site_at(roads, lane_id, at_m, approach_m=APPROACH_M, beyond_m=BEYOND_M)
    if site.limit_mps > FASTEST_MPS:
        raise UnsuitableError(f"the limit is {site.limit_mps:.1f} m/s, crashes stand on roads of {FASTEST_MPS} or less")
    if site.lanes_far + site.lanes_near == 0 and site.oncoming_m < PACIFICA.width_m:
        raise UnsuitableError("there is no lane beside it to pass on")
    return site


def drawn(id: str, _roads: Roads, site: Site, rng: np.random.Generator) -> Scenario:
    """A scenario of the family at a site, what varies drawn; UnsuitableError if no crash leaves room."""
    many = site.lanes_far + site.lanes_near > 0
    for _ in range(50):
        try:
            return accident(
                id,
                site=site,
                crash=tuple(CRASHES)[int(rng.integers(len(CRASHES)))],
                towards_kerb_m=float(np.round(rng.uniform(-1.0, 1.5), 2)),
                turned_rad=float(np.round(rng.uniform(-0.5, 0.5), 2)),
                mirrored=bool(rng.random() < 0.5),
                traffic=TrafficDemand(
                    density="low" if many and rng.random() < 0.3 else "none",
                    oncoming="sparse" if not many and rng.random() < 0.3 else "none",
                    behaviour=("conservative", "assertive", "mixed")[int(rng.integers(3))],
                ),
            )
        except ScenarioError:
            continue
    raise UnsuitableError("no crash leaves room to pass")


def asks(scenario: Scenario, roads: Roads) -> bool:
    """Whether several vehicles stand in the way, and nobody walks into it."""
    if scenario.jaywalkers or len(vehicles_standing(scenario)) < 2:
        return False
    offset_m = offset_asked_m(scenario, roads)
    return offset_m is None or offset_m > 0.0


FAMILY: Final = Family(
    title="Accident",
    description="Crashed cars stand at odd angles and stay; pass them with care, if need be through the oncoming lane.",
    suitable=suitable,
    drawn=drawn,
    order=20,
    column="Acc.",
    checks=(wreck_problems, partial(passing_problems, own_side_only=False)),
    may_overlap=vehicles_standing,
    exempt=EXEMPT,
    weighs_direction=True,
    asks=asks,
    original="avoid_crashed_cars",
)
