"""Every official scenario: it fits its map, has an expert, and is what its lock says."""

from __future__ import annotations

import pytest

from interplan_sumo.maps.store import load_roads
from interplan_sumo.proving.lock import lock, read_lock
from interplan_sumo.proving.start_checks import start_problems
from interplan_sumo.scenario.route import goal_arc_m, route_centerline
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.suite import DEFAULT_SUITE, certificate_of, expert, suites

OFFICIAL = list({scenario.id: scenario for suite in suites().values() for scenario in suite.scenarios}.values())


@pytest.mark.parametrize("scenario", OFFICIAL, ids=lambda s: s.id)
def test_an_official_scenario_fits_its_map_and_its_goal_lies_ahead(scenario: Scenario) -> None:
    roads = load_roads(scenario.map)
    scenario.check(roads)
    start = scenario.start.pose(roads)
    start_m, _ = route_centerline(roads, scenario).project_point(start.x_m, start.y_m)
    assert goal_arc_m(roads, scenario) > start_m + 50.0


@pytest.mark.parametrize("scenario", OFFICIAL, ids=lambda s: s.id)
def test_the_expert_starts_where_the_ego_does_and_gets_somewhere(scenario: Scenario) -> None:
    roads = load_roads(scenario.map)
    track = expert(scenario)
    start = scenario.start.pose(roads)
    assert track.x_m[0] == pytest.approx(start.x_m, abs=1e-6)
    assert track.y_m[0] == pytest.approx(start.y_m, abs=1e-6)
    line = route_centerline(roads, scenario)
    arcs, _ = line.project(list(zip(track.x_m, track.y_m, strict=True)))
    proof = certificate_of(scenario)
    assert proof is not None
    assert arcs[-1] - arcs[0] >= 0.7 * proof.reference_distance_m
    assert arcs[-1] - arcs[0] > (5.0 if scenario.family == "stationary_in_traffic" else 50.0)


@pytest.mark.parametrize("key", sorted(suites()))
def test_a_suite_is_what_its_lock_says(key: str) -> None:
    assert lock(suites()[key]) == read_lock(suites()[key])


@pytest.mark.parametrize("scenario", OFFICIAL, ids=lambda s: s.id)
def test_every_official_scenario_is_certified(scenario: Scenario) -> None:
    proof = certificate_of(scenario)
    assert proof is not None
    assert proof.score >= (0.8 if scenario.family == "lane_change_htd" else 0.9)


@pytest.mark.parametrize("scenario", OFFICIAL, ids=lambda s: s.id)
def test_an_official_scenario_passes_every_start_check(scenario: Scenario) -> None:
    assert start_problems(scenario, load_roads(scenario.map)) == []


def test_the_default_suite_exists() -> None:
    assert DEFAULT_SUITE in suites()
