"""The families: declared in full, found by name, and each refuses what it cannot stage."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import combinations, islice, pairwise

import numpy as np
import pytest

from interplan_sumo.errors import ScenarioError, UnknownNameError
from interplan_sumo.families import (
    FAMILIES,
    Family,
    accident,
    construction,
    families,
    find_family,
    jaywalker,
    names,
    overtake,
)
from interplan_sumo.families.draws import Draws
from interplan_sumo.families.generate import Search
from interplan_sumo.families.jaywalker import Person
from interplan_sumo.families.passing import corners_in_the_way
from interplan_sumo.families.shapes import PASSING_M
from interplan_sumo.families.staging import Approach
from interplan_sumo.maps.store import load_roads
from interplan_sumo.scenario.jaywalking import walk
from interplan_sumo.scenario.route import route_centerline, start_arc_m
from interplan_sumo.scenario.scenario import DRIVERS, LanePosition, Obstacle, Scenario
from interplan_sumo.scenario.sites import site_at
from interplan_sumo.scenario.suite import DEFAULT_SUITE, find_suite
from interplan_sumo.world.geometry import wrap_angle
from interplan_sumo.world.lane_changes import lane_changes_needed
from interplan_sumo.world.roads import USUAL_LIMIT_MPS, Roads

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


@pytest.mark.slow
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
    assert {1, 2} <= needs <= {1, 2, 3}


# --- what is drawn -----------------------------------------------------------------------------


STAGED = BENCHMARK[:5]


@cache
def some(family: str) -> list[tuple[Roads, Scenario]]:
    maps = (load_roads(name) for name in ("back_bay", "one_north"))
    return [(roads, scenario) for roads in maps for scenario in islice(Search(roads, family, 7), 8)]


@pytest.mark.parametrize("family", STAGED)
def test_distances_speeds_and_sizes_are_spread_and_everyone_has_traffic_and_looks_past_nothing(family: str) -> None:
    shares: list[float] = []
    for roads, scenario in some(family):
        share = scenario.start_speed_mps / (roads[scenario.start.lane].speed_limit_mps or USUAL_LIMIT_MPS)
        assert 0.49 <= share <= 1.01
        shares.append(share)
        assert scenario.perception == "occluded"
        assert scenario.traffic.density in ("low", "medium")
        assert scenario.traffic.behaviour in DRIVERS
    assert max(shares) - min(shares) > 0.15
    away_m = [event_m(roads, scenario) for roads, scenario in some(family)]
    assert min(away_m) >= 24.0
    assert max(away_m) <= 121.0
    assert np.std(away_m) > 8.0


def event_m(roads: Roads, scenario: Scenario) -> float:
    """Along the route, from the ego's start to the first of what stands in the way, crawls there or walks into it."""
    line = route_centerline(roads, scenario)
    if scenario.jaywalkers:
        first_m = walk(scenario.jaywalkers[0], roads, line).conflict_m
    else:
        first_m = float(line.project(corners_in_the_way(scenario, roads).reshape(-1, 2))[0].min())
    return first_m - start_arc_m(roads, scenario)


def test_where_the_own_direction_has_one_lane_cars_in_platoons_come_when_the_ego_does() -> None:
    for roads, scenario in some("overtake"):
        oncoming = [each for each in scenario.vehicles if each.kind == "car"]
        assert oncoming
        heading = scenario.start.pose(roads).heading_rad
        assert all(abs(wrap_angle(each.place.pose(roads).heading_rad - heading)) > 2.0 for each in oncoming)
        places = [each.place.pose(roads) for each in oncoming]
        assert all(np.hypot(a.x_m - b.x_m, a.y_m - b.y_m) > 7.9 for a, b in pairwise(places))


def test_a_lane_is_closed_by_a_taper_as_long_as_the_limit_asks_and_narrowed_by_a_short_one() -> None:
    draws, site = Draws(np.random.default_rng(0)), replace(narrow().site, width_m=3.5, limit_mps=50.0 / 3.6)
    closed, narrowed = (construction.works(layout, site, 1.4, draws).cones for layout in ("closure", "narrowing"))
    for cones, taper_m in ((closed, 3.15 * 50.0**2 / 155.0), (narrowed, 15.0)):
        row = cones[cones[:, 0] > taper_m + 0.1]
        assert np.diff(cones[:, 1])[: len(cones) - len(row) - 1].min() > 0.0  # ever farther into the lane
        assert row[:, 1] == pytest.approx(1.4, abs=construction.JITTER_M + 1e-9)
        assert row[0, 0] > taper_m + 2.0


@pytest.mark.parametrize("side", [1, -1])
def test_people_stand_beside_the_crashed_cars_and_all_on_the_side_on_which_nobody_passes(side: int) -> None:
    cars = (Obstacle(LanePosition("1", 50.0)), Obstacle(LanePosition("1", 53.0), turned_rad=1.57))
    people = [
        each for seed in range(20) for each in accident.bystanders(cars, side, Draws(np.random.default_rng(seed)))
    ]
    assert len(people) > 10
    assert min(side * each.place.left_m for each in people) >= 0.925 + accident.STANDS_OFF_M[0] - 0.01


# --- what a family refuses ---------------------------------------------------------------------


def narrow() -> Approach:
    site = site_at(load_roads("back_bay"), "301020", 100.0, approach_m=80.0, beyond_m=80.0)
    return Approach(site, 8.0, 80.0)


def parked(offset_m: float) -> Obstacle:
    """A car that one passes so far off the lane's centre line."""
    return Obstacle(narrow().site.place(0.0, PASSING_M - offset_m + 1.85 / 2.0), "car")


def test_an_overtake_begins_where_the_own_side_has_no_room_and_ends_where_the_road_does() -> None:
    assert overtake.blocked("overtake/x", narrow(), parked(1.6), {}).family == "overtake"
    with pytest.raises(ScenarioError, match="the ego could pass on its own side"):
        overtake.blocked("overtake/x", narrow(), parked(1.5), {})
    with pytest.raises(ScenarioError, match=r"the road has 4\.65 m"):
        overtake.blocked("overtake/x", narrow(), parked(3.5), {})


def test_a_cyclist_and_those_who_come_along_do_not_ride_and_walk_in_one_line() -> None:
    draws = Draws(np.random.default_rng(0), {"cyclist": 0.0, "people": 0.99})
    people = jaywalker._people(narrow(), draws, hidden=False)
    assert [each.cyclist for each in people] == [True, *(False for _ in people[1:])]
    assert len(people) > 1
    assert min(b.ahead_m - a.ahead_m for a, b in pairwise(people)) >= min(jaywalker.APART_M)


def test_a_jaywalker_too_slow_to_start_behind_the_kerb_is_refused_with_the_least_speed() -> None:
    roads, to = load_roads("back_bay"), narrow()
    wide = replace(to, site=replace(to.site, right_edge_m=5.0))
    with pytest.raises(ScenarioError, match=r"at least 1\.3\d m/s"):
        jaywalker.crossing(roads, wide, Person(1.0))
    assert jaywalker.crossing(roads, wide, Person(1.4)).speed_mps == 1.4


def test_who_crosses_may_stop_midway_turn_back_or_break_into_a_run() -> None:
    roads, to = load_roads("back_bay"), narrow()
    plain, stops, back, runs = (
        jaywalker.crossing(roads, to, Person(1.4, course=course, pause_s=1.5))
        for course in ("straight", "stops", "turns back", "runs")
    )
    assert plain.via == ()
    assert (stops.via[0].wait_s, stops.end) == (1.5, plain.end)
    assert stops.via[0].to.left_m == pytest.approx(0.0)
    assert (back.end, runs.end) == (back.start, plain.end)
    assert runs.speed_mps == 2.8
