"""Every official scenario: it fits its map, has an expert, and is what its lock says."""

from __future__ import annotations

from collections import Counter
from itertools import combinations

import pytest

from interplan_sumo.families import FAMILIES
from interplan_sumo.maps.store import load_roads
from interplan_sumo.scenario.certificates import FILE, read_certificates
from interplan_sumo.scenario.route import goal_arc_m, route_centerline
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.suite import DEFAULT_SUITE, LLM_INDICES, certificate_of, expert, find_suite, suites
from interplan_sumo.verification.lock import lock, read_lock
from interplan_sumo.verification.start_checks import start_problems

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


def test_the_suite_for_language_models_has_three_of_each_family_as_they_are_in_the_benchmark() -> None:
    found = find_suite("llm==1").scenarios
    assert Counter(scenario.family for scenario in found) == dict.fromkeys(FAMILIES, 3)
    assert set(found) <= set(find_suite("interplan==1").scenarios)


def test_its_experts_are_those_of_the_benchmark() -> None:
    ours, theirs = (read_certificates(find_suite(key).folder / FILE) for key in ("llm==1", "interplan==1"))
    assert len(ours) == 24
    assert all(each.as_json() == theirs[name].as_json() for name, each in ours.items())


def test_its_three_places_are_those_with_the_most_maps_and_the_most_even_share_of_them() -> None:
    def maps(triple: tuple[int, ...]) -> tuple[int, int]:
        chosen = [[family.scenarios[index].map for index in triple] for family in FAMILIES.values()]
        shares = Counter(name for names in chosen for name in names)
        return sum(len(set(names)) for names in chosen), -sum(share**2 for share in shares.values())

    assert max(combinations(range(10), 3), key=maps) == LLM_INDICES
