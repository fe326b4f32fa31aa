"""The families: declared in full, found by name, and each refuses what it cannot stage."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import pytest

from interplan_sumo.errors import ScenarioError, UnknownNameError
from interplan_sumo.families import (
    FAMILIES,
    Family,
    construction,
    families,
    find_family,
    jaywalker,
    names,
    nudge,
    overtake,
)
from interplan_sumo.families.jaywalker import Person
from interplan_sumo.maps.store import load_roads
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.sites import Site, site_at
from interplan_sumo.scenario.suite import DEFAULT_SUITE, find_suite
from interplan_sumo.world.lane_changes import lane_changes_needed

BENCHMARK = (
    "construction", "accident", "jaywalker", "nudge", "overtake",
    "lane_change_ltd", "lane_change_mtd", "lane_change_htd",
)  # fmt: skip


def test_the_families_of_the_benchmark_stand_in_the_order_of_the_paper_before_ordinary_driving() -> None:
    ordinary = names(ordinary=True)
    assert names(ordinary=False) == BENCHMARK
    assert len(ordinary) == 14
    assert tuple(families()) == (*BENCHMARK, *ordinary, "trip")


def test_no_two_families_share_a_column_or_a_name_in_the_papers_configuration() -> None:
    columns = [each.column or each.title for each in families().values() if not each.ordinary]
    originals = [each.original for each in families().values() if each.original]
    assert len(set(columns)) == len(columns)
    assert len(set(originals)) == len(originals) == 8
    assert all(each.description.endswith(".") for each in families().values())


def test_a_family_that_is_not_installed_has_everything_as_usual_and_its_name_as_title() -> None:
    mine = find_family("mine")
    assert isinstance(mine, Family)
    assert (mine.title, mine.ordinary, mine.checks, mine.exempt) == ("mine", False, (), ())
    with pytest.raises(UnknownNameError, match="Did you mean 'nudge'"):
        FAMILIES["nuge"]
    assert find_family("nudge") is FAMILIES["nudge"]


# --- the official eighty -----------------------------------------------------------------------


def place_of(scenario: Scenario) -> tuple[str, str, float]:
    """Map, roadblock and arc of what happens."""
    map_name, _, place = scenario.site(load_roads(scenario.map)).partition("/")
    block, _, arc = place.partition("@")
    return map_name, block, float(arc)


def different(a: tuple[str, str, float], b: tuple[str, str, float]) -> bool:
    return a[:2] != b[:2] or abs(a[2] - b[2]) >= 50.0


def test_no_two_official_scenarios_of_a_family_share_a_site_and_each_family_is_on_both_sides_of_driving() -> None:
    for family in BENCHMARK:
        rows = [scenario for scenario in find_suite(DEFAULT_SUITE).scenarios if scenario.family == family]
        assert len(rows) == 10
        assert all(different(place_of(a), place_of(b)) for a, b in combinations(rows, 2)), family
        assert {load_roads(each.map).driving_side for each in rows} == {"left", "right"}


def test_the_three_densities_have_the_same_ten_recipes_with_one_to_three_changes() -> None:
    recipes: list[list[Scenario]] = []
    for family in BENCHMARK[5:]:
        rows = [scenario for scenario in find_suite(DEFAULT_SUITE).scenarios if scenario.family == family]
        recipes.append([replace(s, id="", family="", traffic=replace(s.traffic, density="low")) for s in rows])
    assert recipes[0] == recipes[1] == recipes[2]
    needs = {lane_changes_needed(load_roads(s.map), s.route, s.goal.lane)[s.start.lane] for s in recipes[0]}
    assert needs == {1, 2, 3}


# --- what a family refuses ---------------------------------------------------------------------


def narrow() -> Site:
    return site_at(load_roads("back_bay"), "301020", 100.0, approach_m=80.0, beyond_m=80.0)


def test_a_nudge_ends_at_1_4_m_and_an_overtake_begins_where_a_nudge_does_not_do() -> None:
    assert nudge.nudge("nudge/x", site=narrow(), offset_m=1.4).family == "nudge"
    assert overtake.overtake("overtake/x", site=narrow(), offset_m=1.6).family == "overtake"
    with pytest.raises(ScenarioError, match=r"use overtake\(\)"):
        nudge.nudge("nudge/x", site=narrow(), offset_m=1.41)
    with pytest.raises(ScenarioError, match=r"use nudge\(\)"):
        overtake.overtake("overtake/x", site=narrow(), offset_m=1.5)
    with pytest.raises(ScenarioError, match=r"the road has 4\.65 m"):
        overtake.overtake("overtake/x", site=narrow(), offset_m=3.5)


def test_cones_that_force_the_ego_onto_the_other_side_are_refused() -> None:
    with pytest.raises(ScenarioError, match=r"reach_m may be at most -0\.30"):
        construction.construction("construction/x", site=narrow(), layout="row", cones=3, spacing_m=3.0, reach_m=0.0)


def test_a_jaywalker_too_slow_to_start_behind_the_kerb_is_refused_with_the_least_speed() -> None:
    site = replace(narrow(), right_edge_m=5.0)
    with pytest.raises(ScenarioError, match=r"at least 1\.3\d m/s"):
        jaywalker.jaywalker("jaywalker/x", site=site, people=(Person(1.0),))
    assert jaywalker.jaywalker("jaywalker/x", site=site, people=(Person(1.4),)).jaywalkers
