"""What the families share: how much room the ego needs, and how far obstacles reach across a lane."""

from __future__ import annotations

from collections.abc import Iterable
from math import cos, sin
from typing import Final

from interplan_sumo.scenario.scenario import Obstacle
from interplan_sumo.world.ego import PACIFICA

CLEARANCE_M: Final = 0.3
"""Room between the ego and what it passes (decisions.md, nudge)."""
PASSING_M: Final = PACIFICA.width_m / 2.0 + CLEARANCE_M
"""From the ego's centre line to what it may just pass."""
LARGEST_OFFSET_M: Final = 1.4
"""The ego can pass on its own side of the road up to this lateral offset (decisions.md, nudge)."""


def reach_m(obstacles: Iterable[Obstacle], kerb: int) -> tuple[float, float]:
    """How far obstacles reach from the lane's centre line towards the kerb and away from it, on a straight road."""
    to_kerb_m = away_m = float("-inf")
    for each in obstacles:
        length_m, width_m = each.size_m
        half_m = abs(sin(each.turned_rad)) * length_m / 2.0 + abs(cos(each.turned_rad)) * width_m / 2.0
        at_m = kerb * each.place.left_m
        to_kerb_m, away_m = max(to_kerb_m, at_m + half_m), max(away_m, half_m - at_m)
    return to_kerb_m, away_m
