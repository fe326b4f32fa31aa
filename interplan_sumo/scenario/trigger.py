"""When a jaywalker sets off: the distance at which the ego's approach triggers the walk (decisions.md)."""

from __future__ import annotations

NEAREST_TRIGGER_M = 8.0
FARTHEST_TRIGGER_M = 50.0
TRIGGER_TIME_S = 4.0


def trigger_distance_m(ego_mps: float) -> float:
    """How near, along the route, the ego's front bumper must be to the crossing for the walk to begin."""
    return max(NEAREST_TRIGGER_M, min(FARTHEST_TRIGGER_M, TRIGGER_TIME_S * ego_mps))
