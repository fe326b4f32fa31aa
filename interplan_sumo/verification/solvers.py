"""Solvers: which planners do what a scenario asks, none of whom knows more than it sees."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from interplan_sumo.maps.store import load_roads
from interplan_sumo.metrics.score import score
from interplan_sumo.planner import load_planner
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.episode import drive
from interplan_sumo.world.trace import EgoTrack

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
    roads = load_roads(scenario.map, scenario.maps_beside)
    solved: list[str] = []
    for name in panel:
        episode = drive(scenario, load_planner(name))
        if episode.trace is None or episode.fault is not None:
            continue
        if score(episode.trace, roads, expert, scenario).score >= SOLVED_SCORE:
            solved.append(name)
    return tuple(solved)
