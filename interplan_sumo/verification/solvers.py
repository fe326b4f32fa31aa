"""Solvers: which planners do what a scenario asks, none of whom knows more than it sees."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from interplan_sumo.maps.store import load_roads
from interplan_sumo.metrics.score import score
from interplan_sumo.planner import load_planner
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.episode import drive
from interplan_sumo.world.trace import EgoTrack, Trace

PANEL: Final = ("idm", "idm_mobil", "pdm_closed", "foresight")
"""Who is asked: rules of every strength, quick enough for every scene."""
SOLVED_SCORE: Final = 0.8
"""A drive with at least this score, under the profile that suites are judged by, has done what is asked, and well."""


def solvers(scenario: Scenario, expert: EgoTrack, panel: Sequence[str] = PANEL) -> tuple[str, ...]:
    """Those of a panel of planners that solve a scenario with seed 0, in the panel's order.

    `expert` is the drive that progress is measured against. A planner that
    faults does not solve it. TrafficError if SUMO fails; UnknownNameError or
    PlannerLoadError if there is no such planner.
    """
    return tuple(name for name in panel if solving_drive(scenario, expert, name) is not None)


def solving_drive(scenario: Scenario, expert: EgoTrack, planner: str) -> Trace | None:
    """The drive of a planner that solves a scenario; None if it does not. Errors as of `solvers`."""
    episode = drive(scenario, load_planner(planner))
    if episode.trace is None or episode.fault is not None:
        return None
    roads = load_roads(scenario.map, scenario.maps_beside)
    return episode.trace if score(episode.trace, roads, expert, scenario).score >= SOLVED_SCORE else None
