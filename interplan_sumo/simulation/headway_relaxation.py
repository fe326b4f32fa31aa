"""Relaxation: whoever is cut in on accepts the headway that it is left with, and comes back to its own by and by.

A driver that follows a car-following model to the letter brakes hard for a
cut-in that people hardly notice: they take 60 to 90 % of their usual gap for
some seconds (I-24 MOTION and NGSIM US-101; Laval and Leclercq, 2008). The
headway `tau` that SUMO's model keeps starts at the actual one and returns with
the time constant `interplan.relaxation`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from math import exp

from interplan_sumo.simulation.vehicle_types import VehicleType

LEAST_HEADWAY_S = 0.2
"""No model is told to keep less: at two steps of 0.1 s all of SUMO's are stable."""
RELAXED_S = 0.01
"""So near to its own headway it is back at it."""
SLOWEST_MPS = 1.0
"""Below this speed the gap at standstill, not the headway, decides."""

Leader = tuple[str, float] | None
"""Who is ahead, and the gap from bumper to bumper beyond `minGap`, in m."""


class HeadwayRelaxation:
    """Knows who follows whom, and at which headway each agent is."""

    def __init__(self, drivers: Mapping[str, VehicleType], set_tau: Callable[[str, float], None], dt_s: float) -> None:
        self._drivers = drivers
        self._set_tau = set_tau
        self._dt_s = dt_s
        self._leaders: dict[str, str] = {}
        self._short_s: dict[str, float] = {}
        """Headway less than `tau` by this, of agents that relax."""

    def step(self, names: Iterable[str], speed_mps: Callable[[str], float], leader_of: Callable[[str], Leader]) -> None:
        """Notice new leaders, and let those that relax come back by one step."""
        for name in names:
            driver = self._drivers[name]
            if name in self._short_s:
                self._keep(name, self._short_s[name] * exp(-self._dt_s / driver.relaxation_s))
            leader = leader_of(name)
            before = self._leaders.get(name)
            if leader is None:
                self._leaders.pop(name, None)
                continue
            self._leaders[name] = leader[0]
            if leader[0] != before:
                self.cut_in(name, leader[1], speed_mps(name))

    def cut_in(self, name: str, gap_m: float, speed_mps: float) -> None:
        """Somebody is new ahead of an agent, `gap_m` beyond its standstill gap."""
        driver = self._drivers[name]
        if driver.relaxation_s <= 0.0 or speed_mps < SLOWEST_MPS:
            return
        actual_s = max(LEAST_HEADWAY_S, gap_m / speed_mps)
        if actual_s < driver.tau_s - self._short_s.get(name, 0.0):
            self._keep(name, driver.tau_s - actual_s)

    def _keep(self, name: str, short_s: float) -> None:
        if short_s < RELAXED_S:
            self._short_s.pop(name, None)
            short_s = 0.0
        else:
            self._short_s[name] = short_s
        self._set_tau(name, self._drivers[name].tau_s - short_s)

    def forget(self, name: str) -> None:
        """The agent has left."""
        self._leaders.pop(name, None)
        self._short_s.pop(name, None)
