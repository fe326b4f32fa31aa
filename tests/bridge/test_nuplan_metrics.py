"""The devkit's own metrics say of our drives what ours say."""

from __future__ import annotations

from pathlib import Path

import pytest
from devkit import devkit

from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.score import score_facts
from interplan_sumo.planner import load_planner
from interplan_sumo.scenario.suite import expert, find_scenario, find_suite
from interplan_sumo.simulation.episode import drive
from tests.golden_values import TOLERANCE
from tests.metrics.golden_metrics import Case, pairs

OFFICIAL = [scenario.id for scenario in find_suite("interplan==1").scenarios[::4]]
"""Twenty of the eighty, from every family."""


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    ("scenario_id", "planner"),
    [("nudge/0", "idm"), ("nudge/0", "pdm_closed"), ("lane_change_htd/3", "straight_ahead")],
)
def test_every_score_statistic_and_series_is_the_same(scenario_id: str, planner: str) -> None:
    _compare(scenario_id, planner)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("planner", ["idm", "pdm_closed"])
@pytest.mark.parametrize("scenario_id", OFFICIAL)
def test_they_are_the_same_on_twenty_official_scenarios(scenario_id: str, planner: str) -> None:
    _compare(scenario_id, planner)


def _compare(scenario_id: str, planner: str) -> None:
    devkit()
    from devkit_metrics import nuplan_results

    scenario = find_scenario(scenario_id)
    episode = drive(scenario, load_planner(planner))
    assert episode.trace is not None
    roads = devkit("interplan_sumo.maps.store").load_roads(scenario.map)
    facts = Facts(episode.trace, roads, expert(scenario))
    theirs = nuplan_results(episode.trace, roads, facts.expert, scenario.goal.pose(roads))
    case = Case(Path(), {}, {"metrics": theirs}, facts, score_facts(facts, "nuplan"))
    found = list(pairs(case))
    assert len(found) > 60
    assert [(pair.what, pair.difference) for pair in found if not pair.difference <= TOLERANCE] == []
