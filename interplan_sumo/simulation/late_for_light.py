"""Late for a light: cars that can no longer stop before a light that turns red drive on.

SUMO lets a car that cannot stop for yellow speed up, and if red comes before the
line is crossed it halts it there and then, from any speed. What no brakes can do
is not asked of it: as long as it cannot stop before the line, it overlooks red.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import floor

from interplan_sumo.simulation.agent_registry import AgentSnapshot
from interplan_sumo.simulation.sumo import DT_S, Commanding, sumo
from interplan_sumo.simulation.vehicle_types import VehicleType

SETTLED = 2.0
"""Who is farther from the line than so many times what it comfortably stops within will stop, whatever its model."""
ROUNDING_S = 1e-6
NEAR_M = 5.0
"""Nearer than this it is looked at anyway."""


class LateForLight:
    """Finds them; only around the instants at which lights switch is anybody asked."""

    def __init__(self, drivers: Mapping[str, VehicleType]) -> None:
        """`drivers` by agent, as they come."""
        self._drivers = drivers
        self._due = True
        self._near: frozenset[str] = frozenset()

    def notice_switch(self) -> None:
        """Some light has switched."""
        self._due = True

    def agents(self, snapshot: AgentSnapshot, next_switch_s: float) -> frozenset[str]:
        """Names of those that cannot stop before the light ahead of them.

        `next_switch_s` is the time at which the next light switches: with the step that begins then.
        """
        self._due = self._due or sumo.simulation.getTime() >= next_switch_s - ROUNDING_S
        if not self._due and not self._near:
            return frozenset()
        near: set[str] = set()
        late: set[str] = set()
        with Commanding("looking for agents that are late for a light"):
            for name in snapshot.names if self._due else self._near & snapshot.rows.keys():
                speed_mps, driver = float(snapshot.speed_mps[snapshot.rows[name]]), self._drivers[name]
                lights = sumo.vehicle.getNextTLS(name) if speed_mps > 0.0 else ()
                if not lights:
                    continue
                away_m = lights[0][2]
                if away_m > NEAR_M + SETTLED * speed_mps * speed_mps / (2.0 * driver.decel_mps2):
                    continue
                near.add(name)
                if stopping_m(speed_mps, driver.emergency_decel_mps2) > away_m:
                    late.add(name)
        self._due, self._near = False, frozenset(near)
        return frozenset(late)


def stopping_m(speed_mps: float, decel_mps2: float) -> float:
    """What a car still covers that brakes as hard as it can from the next step on, in SUMO's steps."""
    braked_mps = decel_mps2 * DT_S
    steps = floor(speed_mps / braked_mps)
    return DT_S * (steps * speed_mps - braked_mps * steps * (steps + 1) / 2.0)
