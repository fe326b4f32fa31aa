"""Ordinary scenes: made anew from seeds, sound, and none of them an official one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from interplan_sumo.errors import InputError
from interplan_sumo.families.generate import Search
from interplan_sumo.maps.store import load_roads
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.suite import find_suite, suites
from interplan_sumo.verification.ordinary_scenes import FIRST_SEED, KINDS, NEAR_M, is_official, ordinary_scenes
from interplan_sumo.verification.start_checks import start_problems
from interplan_sumo.world.lane_changes import lane_changes_needed

MAP = "back_bay"


@pytest.fixture(scope="module")
def scenes() -> list[Scenario]:
    return ordinary_scenes(load_roads(MAP), FIRST_SEED)


def test_a_round_has_three_types_a_lane_change_and_three_trips(scenes: list[Scenario]) -> None:
    families = [scene.family for scene in scenes]
    assert families.count("trip") == 3
    assert families.count("changing_lane") == 1
    assert len(set(families)) == 5
    assert len({scene.id for scene in scenes}) == len(scenes)
    assert all(scene.id.split("/")[1].startswith(str(FIRST_SEED)) for scene in scenes)


@pytest.mark.slow
def test_equal_seeds_give_equal_scenes_and_others_others(scenes: list[Scenario]) -> None:
    assert [scene.hash() for scene in ordinary_scenes(load_roads(MAP), FIRST_SEED)] == [s.hash() for s in scenes]
    later = ordinary_scenes(load_roads(MAP), FIRST_SEED + 1)
    assert not {scene.hash() for scene in scenes} & {scene.hash() for scene in later}
    assert {s.family for s in scenes} & {s.family for s in later} == {"trip", "changing_lane"}


@pytest.mark.slow
def test_nothing_out_of_the_ordinary_happens_but_that_people_cross_where_one_turns(scenes: list[Scenario]) -> None:
    roads = load_roads(MAP)
    for scene in scenes:
        assert not start_problems(scene, roads), scene.id
        assert not scene.jaywalkers or scene.family.endswith("_turn")
        assert {obstacle.kind for obstacle in scene.obstacles} <= {"car", "person"}
    assert "waiting_for_pedestrian_to_cross" not in KINDS


def test_no_scene_is_an_official_one(scenes: list[Scenario]) -> None:
    official = {scenario.hash() for suite in suites().values() for scenario in suite.scenarios}
    assert not {scene.hash() for scene in scenes} & official
    assert not any(is_official(scene, load_roads(MAP)) for scene in scenes)


def test_seeds_that_may_have_made_suites_are_refused() -> None:
    with pytest.raises(InputError, match="seed is 99999, expected 100000 or more"):
        ordinary_scenes(load_roads(MAP), FIRST_SEED - 1)


@pytest.mark.parametrize(("ahead_m", "found"), [(0.0, True), (NEAR_M - 0.1, True), (NEAR_M + 0.1, False)])
def test_a_start_within_5_m_of_an_official_one_with_its_route_is_that_one(ahead_m: float, found: bool) -> None:
    official = find_suite("interplan==1").scenarios[0]
    start = replace(official.start, arc_m=official.start.arc_m + ahead_m)
    assert is_official(replace(official, id="mine/0", start=start), load_roads(official.map)) == found


def test_another_route_from_the_same_place_is_another_scene() -> None:
    official = next(s for s in find_suite("common==1").scenarios if len(s.route) > 1)
    roads = load_roads(official.map)
    assert is_official(official, roads)
    assert not is_official(replace(official, route=official.route[:1]), roads)


def test_trips_turn_and_change_lane() -> None:
    roads = load_roads("strip")
    trips = [scene for scene, _ in zip(Search(roads, "trip", FIRST_SEED), range(20), strict=False)]
    changes = [lane_changes_needed(roads, t.route, t.goal.lane).get(t.start.lane, 0) for t in trips]
    turned = [
        abs(np.sin((t.goal.pose(roads).heading_rad - t.start.pose(roads).heading_rad) / 2.0)) > 0.5 for t in trips
    ]
    assert 3 <= sum(bool(n) for n in changes) < 20
    assert 3 <= sum(turned) < 20
    assert len({t.start_speed_mps > 0.0 for t in trips}) == 2
