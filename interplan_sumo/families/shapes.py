"""What the families share: how much room the ego needs, and how far obstacles reach across a lane."""

from __future__ import annotations

from collections.abc import Iterable
from math import cos, sin, sqrt
from typing import Final

from interplan_sumo.scenario.scenario import Obstacle, TrafficDemand
from interplan_sumo.scenario.sites import Site
from interplan_sumo.world.ego import PACIFICA

CLEARANCE_M: Final = 0.3
"""Room between the ego and what it passes (decisions.md, nudge)."""
PASSING_M: Final = PACIFICA.width_m / 2.0 + CLEARANCE_M
"""From the ego's centre line to what it may just pass."""
LARGEST_OFFSET_M: Final = 1.4
"""The ego can pass on its own side of the road up to this lateral offset (decisions.md, nudge)."""
START_SHARE: Final = 0.8
"""The ego starts at this share of the speed limit."""
EASY_MPS2: Final = 2.0
STANDOFF_M: Final = 12.0
"""With a short run-up the ego can stop at `EASY_MPS2` so far before the site; half of it is the car's own length,"""
NO_TRAFFIC: Final = TrafficDemand()
BUMPERS_M: Final = 8.0
FREE_S: Final = 3.2
"""and nothing is hit within the first 3 s: half the ego, half of what stands there, and some."""


def start_speed_mps(site: Site) -> float:
    """A usual speed for a car under way on this road, less where the run-up is too short to stop from it at ease."""
    usual_mps = START_SHARE * site.limit_mps
    if site.run_up_m is not None:
        stops_mps = sqrt(2.0 * EASY_MPS2 * max(site.run_up_m - STANDOFF_M, 1.0))
        usual_mps = min(usual_mps, stops_mps, (site.run_up_m - BUMPERS_M) / FREE_S)
    return round(usual_mps, 1)


def reach_m(obstacles: Iterable[Obstacle], kerb: int) -> tuple[float, float]:
    """How far obstacles reach from the lane's centre line towards the kerb and away from it, on a straight road."""
    to_kerb_m = away_m = float("-inf")
    for each in obstacles:
        length_m, width_m = each.size_m
        half_m = abs(sin(each.turned_rad)) * length_m / 2.0 + abs(cos(each.turned_rad)) * width_m / 2.0
        at_m = kerb * each.place.left_m
        to_kerb_m, away_m = max(to_kerb_m, at_m + half_m), max(away_m, half_m - at_m)
    return to_kerb_m, away_m
