"""Peek: the beginning of a drive, up to where there is something to see."""

from __future__ import annotations

from collections.abc import Callable

from interplan_sumo.maps.store import load_roads
from interplan_sumo.planner import Planner
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.episode import Loop
from interplan_sumo.simulation.setup import open_traffic


def drive_until(scenario: Scenario, planner: Planner, enough: Callable[[], bool], *, seed: int = 0) -> float | None:
    """Drive until `enough()` is true after a plan; the time of it in seconds, None if the episode ends before.

    Unlike `drive` it lets through whatever the planner raises. TrafficError if SUMO fails.
    """
    roads = load_roads(scenario.map, scenario.maps_beside)
    with open_traffic(scenario, roads, seed=seed) as traffic:
        loop = Loop(scenario, roads, traffic)
        planner.start(loop.open())
        while loop.begin_frame():
            plan = planner.plan(loop.seen)
            if enough():
                return loop.ego.time_s
            loop.advance(plan)
    return None
