"""Lane changes: only where the route ends for who keeps its lane, with room for the changes and time for the way."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice, pairwise

import numpy as np
import pytest
from worlds import straight_road

from interplan_sumo.families import find_family
from interplan_sumo.families.generate import Search
from interplan_sumo.families.lane_change import (
    DURATION_S,
    LEAST_CHANGE_S,
    NOMINAL_SHARE,
    SPARE_M,
    dead_end,
    nominal_s,
    suitable,
)
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.sites import UnsuitableError
from interplan_sumo.verification.suite_judging import avoidable_change
from interplan_sumo.world.lane_changes import lane_changes_needed
from interplan_sumo.world.roads import Roads

WHOLE = straight_road(lanes=3, length_m=500.0, limit_mps=14.0, cuts_m=((300.0, 310.0),))
FAMILIES = ("lane_change_ltd", "lane_change_mtd", "lane_change_htd")


def without(roads: Roads, *ending: str) -> Roads:
    """The road where some lanes end at the cut: their connectors are gone."""
    blocks = dict(roads.roadblocks)
    blocks["2"] = replace(blocks["2"], lane_ids=tuple(way for way in blocks["2"].lane_ids if way not in ending))
    ways = {name: way for name, way in roads.connectors.items() if name not in ending}
    return replace(roads, connectors=ways, roadblocks=blocks)


DROP = without(WHOLE, "23")
"""The right lane of three ends after 300 m."""
PAIR_ENDS = without(WHOLE, "22", "23")


def some(roads: Roads, family: str = "lane_change_ltd", count: int = 20) -> list[Scenario]:
    return list(islice(Search(roads, family, 0), count))


def changes(roads: Roads, scenario: Scenario) -> int:
    return lane_changes_needed(roads, scenario.route, scenario.goal.lane)[scenario.start.lane]


def test_a_place_behind_a_lane_drop_does_and_one_that_every_lane_leads_to_does_not() -> None:
    assert {start.lane for start in suitable(DROP, "32", 40.0).starts} == {"13"}
    with pytest.raises(UnsuitableError, match="does a lane end or lead elsewhere"):
        suitable(WHOLE, "32", 40.0)


def test_from_two_ending_lanes_one_and_two_changes_lead_to_the_one_that_goes_on() -> None:
    found = {start.lane: start.changes for start in suitable(PAIR_ENDS, "31", 40.0).starts}
    assert found == {"12": 1, "13": 2}


def test_a_goal_that_asks_for_more_changes_behind_the_drop_does_not_do() -> None:
    with pytest.raises(UnsuitableError, match="does a lane end"):
        suitable(DROP, "31", 40.0)  # who merges from 13 into 12 comes to 32, beside the goal's lane


@pytest.mark.parametrize(("at_m", "does"), [(14.9, False), (15.1, True), (183.9, True), (184.1, False)])
def test_a_goal_keeps_away_from_both_ends_of_its_lane(at_m: float, does: bool) -> None:
    if does:
        assert suitable(DROP, "32", at_m).starts
    else:
        with pytest.raises(UnsuitableError, match=r"less than 15 m|at its end"):
            suitable(DROP, "32", at_m)


@pytest.mark.parametrize("roads", [DROP, PAIR_ENDS])
def test_every_scene_has_room_and_time_for_its_changes_and_ends_for_who_keeps_its_lane(roads: Roads) -> None:
    scenes = some(roads)
    assert len({scene.start for scene in scenes}) == len(scenes) == 20
    for scene in scenes:
        needed_m = LEAST_CHANGE_S * changes(roads, scene) * scene.start_speed_mps
        room_m = 300.0 - scene.start.arc_m
        assert needed_m + SPARE_M[0] - 0.1 <= room_m <= needed_m + SPARE_M[1] + 0.1
        assert 7.0 <= scene.start_speed_mps <= 14.0
        assert nominal_s(roads, scene) <= NOMINAL_SHARE * DURATION_S
        assert avoidable_change(scene, roads) == []
        assert (scene.perception, scene.duration_s) == ("occluded", DURATION_S)


def test_a_change_is_avoidable_where_the_lane_leads_on_to_the_goals_block() -> None:
    scene = some(DROP, count=1)[0]
    (problem,) = avoidable_change(scene, WHOLE)
    assert "it goes on for who keeps to lane 13" in problem


def test_who_keeps_its_lane_ends_where_it_ends() -> None:
    scene = some(DROP, count=1)[0]
    need = lane_changes_needed(DROP, scene.route, "32")
    assert dead_end(DROP, need, "13", "3") == "13"
    assert dead_end(DROP, need, "12", "3") is None


def test_the_three_densities_draw_the_same_scenes() -> None:
    for scenes in zip(*(some(PAIR_ENDS, family) for family in FAMILIES), strict=True):
        assert [scene.traffic.density for scene in scenes] == ["low", "medium", "high"]
        for one, other in pairwise(scenes):
            as_other = find_family(other.family).restaged
            assert as_other is not None
            assert replace(as_other(one), id=other.id) == other


def test_drivers_of_the_paper_and_measured_ones_are_drawn() -> None:
    drawn = [scene.traffic.behaviour for scene in some(DROP, count=60)]
    assert {"conservative", "mixed", "measured_city", "measured_city_bold"} <= set(drawn)
    assert np.mean([name.startswith("measured") for name in drawn]) == pytest.approx(0.5, abs=0.2)


def test_the_start_checks_of_a_family_hold_for_what_it_draws() -> None:
    (check,) = find_family("lane_change_ltd").checks
    assert all(check(scene, PAIR_ENDS) == [] for scene in some(PAIR_ENDS))
