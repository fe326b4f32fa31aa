"""The families: the official eighty follow the rules of the benchmark, and each family refuses what it cannot stage."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np
import pytest
import shapely

from interplan_sumo.errors import ScenarioError
from interplan_sumo.families import FAMILIES, construction, jaywalker, nudge, overtake
from interplan_sumo.families.jaywalker import Person
from interplan_sumo.families.shapes import PASSING_M, reach_m
from interplan_sumo.maps.store import load_roads
from interplan_sumo.scenario.route import goal_arc_m, route_centerline
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.sites import Site, site_at
from interplan_sumo.scenario.suite import find_suite
from interplan_sumo.world.geometry import box_polygons
from interplan_sumo.world.lane_changes import lane_changes_needed

OFFICIAL = find_suite("interplan==1").scenarios
LANE_CHANGES = ("lane_change_ltd", "lane_change_mtd", "lane_change_htd")


def place_of(scenario: Scenario) -> tuple[str, str, float]:
    """Map, roadblock and arc of what happens."""
    map_name, _, place = scenario.site(load_roads(scenario.map)).partition("/")
    block, _, arc = place.partition("@")
    return map_name, block, float(arc)


def different(a: tuple[str, str, float], b: tuple[str, str, float]) -> bool:
    return a[:2] != b[:2] or abs(a[2] - b[2]) >= 50.0


def boxes(scenario: Scenario) -> np.ndarray:
    poses = [obstacle.pose(load_roads(scenario.map)) for obstacle in scenario.obstacles]
    length, width = zip(*(obstacle.size_m for obstacle in scenario.obstacles), strict=True)
    return box_polygons([p.x_m for p in poses], [p.y_m for p in poses], [p.heading_rad for p in poses], length, width)


def test_there_are_eighty_ten_per_family_with_ids_in_order() -> None:
    assert [s.id for s in OFFICIAL] == [f"{family}/{i}" for family in FAMILIES for i in range(10)]
    assert len(OFFICIAL) == 80


def test_no_two_of_a_family_share_a_site_and_there_are_at_least_forty() -> None:
    kept: list[tuple[str, str, float]] = []
    for scenario in OFFICIAL:
        if all(different(place_of(scenario), other) for other in kept):
            kept.append(place_of(scenario))
    assert len(kept) >= 40
    for family in FAMILIES.values():
        for a, b in combinations(family.scenarios, 2):
            assert different(place_of(a), place_of(b)), f"{a.id} and {b.id} share a site"


@pytest.mark.parametrize("family", FAMILIES)
def test_each_family_is_on_both_sides_of_driving(family: str) -> None:
    assert {load_roads(s.map).driving_side for s in FAMILIES[family].scenarios} == {"left", "right"}


@pytest.mark.parametrize("scenario", OFFICIAL, ids=lambda s: s.id)
def test_the_goal_lies_at_least_20_m_behind_the_last_obstacle(scenario: Scenario) -> None:
    roads = load_roads(scenario.map)
    line = route_centerline(roads, scenario)
    if scenario.obstacles:
        corners = shapely.get_coordinates(boxes(scenario))
        assert goal_arc_m(roads, scenario) - line.project(corners)[0].max() >= 20.0


@pytest.mark.parametrize("scenario", OFFICIAL, ids=lambda s: s.id)
def test_the_ego_starts_within_the_limit(scenario: Scenario) -> None:
    limit = load_roads(scenario.map)[scenario.start.lane].speed_limit_mps
    assert limit is not None
    assert 0.3 * limit <= scenario.start_speed_mps <= limit


# --- lane changes ------------------------------------------------------------------------------


def test_the_three_densities_have_the_same_ten_recipes() -> None:
    recipes = [
        [replace(s, id="", family="", traffic=replace(s.traffic, density="low")) for s in FAMILIES[name].scenarios]
        for name in LANE_CHANGES
    ]
    assert recipes[0] == recipes[1] == recipes[2]
    assert [FAMILIES[name].scenarios[0].traffic.density for name in LANE_CHANGES] == ["low", "medium", "high"]


def test_lane_changes_come_in_ones_twos_and_threes_to_both_sides_with_all_behaviours() -> None:
    rows = FAMILIES["lane_change_ltd"].scenarios
    needs: list[int] = []
    sides: set[bool] = set()
    for scenario in rows:
        roads = load_roads(scenario.map)
        needs.append(lane_changes_needed(roads, scenario.route, scenario.goal.lane)[scenario.start.lane])
        x, y, heading = roads[scenario.start.lane].centerline.poses_at(scenario.start.arc_m)[0]
        goal = scenario.goal.pose(roads)
        sides.add(bool(np.cos(heading) * (goal.y_m - y) - np.sin(heading) * (goal.x_m - x) > 0.0))
    assert set(needs) == {1, 2, 3}
    assert sides == {True, False}
    behaviours = [scenario.traffic.behaviour for scenario in rows]
    assert {b: behaviours.count(b) for b in set(behaviours)} == {"conservative": 3, "assertive": 3, "mixed": 4}


def test_one_recipe_merges_from_a_ramp_whose_lane_ends() -> None:
    merge = FAMILIES["lane_change_ltd"].scenarios[7]
    roads = load_roads(merge.map)
    lane = roads[merge.start.lane]
    before = [roads.connectors[i].from_lane_id for i in roads.incoming(lane.id)]
    assert any(len(roads.roadblocks[roads[i].roadblock_id].lane_ids) == 1 for i in before), "it comes from a ramp"
    here = lane.id
    while here not in roads.lanes or len(roads.roadblocks[roads[here].roadblock_id].lane_ids) == 3:
        here = roads.outgoing(here)[0]
    assert len(roads.roadblocks[roads[here].roadblock_id].lane_ids) == 2, "the road goes on with one lane less"


# --- what stands and who walks -----------------------------------------------------------------


@pytest.mark.parametrize("scenario", FAMILIES["accident"].scenarios, ids=lambda s: s.id)
def test_the_boxes_of_crashed_cars_really_intersect(scenario: Scenario) -> None:
    for a, b in pairwise(boxes(scenario)):
        assert a.intersection(b).area > 0.05


@pytest.mark.parametrize("family", ["construction", "accident", "nudge", "overtake"])
def test_the_middle_of_the_lane_is_blocked_in_every_obstacle_scene(family: str) -> None:
    for scenario in FAMILIES[family].scenarios:
        kerb = 1 if load_roads(scenario.map).driving_side == "left" else -1
        to_kerb_m, away_m = reach_m(scenario.obstacles, kerb)
        assert min(to_kerb_m, away_m) > -PASSING_M + 0.3, scenario.id


def test_five_nudges_take_at_most_a_metre_and_the_others_at_most_1_4() -> None:
    offsets: list[float] = []
    for scenario in FAMILIES["nudge"].scenarios:
        kerb = 1 if load_roads(scenario.map).driving_side == "left" else -1
        offsets.append(reach_m(scenario.obstacles, kerb)[1] + PASSING_M)
    assert sum(offset <= 1.006 for offset in offsets) >= 5
    assert max(offsets) <= 1.406


def test_overtakes_meet_no_light_and_dense_oncoming_traffic_and_followers() -> None:
    rows = FAMILIES["overtake"].scenarios
    assert {s.traffic.oncoming for s in rows} == {"none", "low", "medium", "high"}
    assert any(s.vehicles for s in rows)
    assert any(not s.vehicles for s in rows)


def test_jaywalkers_are_one_to_three_near_and_far_square_and_slanted_with_and_without_a_bus() -> None:
    rows = FAMILIES["jaywalker"].scenarios
    assert {len(s.jaywalkers) for s in rows} == {1, 2, 3}
    assert {s.occluder for s in rows} == {None, 0}
    speeds = [w.speed_mps for s in rows for w in s.jaywalkers]
    assert min(speeds) == pytest.approx(1.0)
    assert max(speeds) == pytest.approx(1.9)
    kerb = {s.id: 1 if load_roads(s.map).driving_side == "left" else -1 for s in rows}
    assert {kerb[s.id] * w.start.left_m > 0.0 for s in rows for w in s.jaywalkers} == {True, False}
    assert {abs(w.start.arc_m - w.end.arc_m) < 0.01 for s in rows for w in s.jaywalkers} == {True, False}


def test_construction_has_three_to_eight_cones_at_the_published_spacing_and_a_worker() -> None:
    for scenario in FAMILIES["construction"].scenarios:
        cones = [o for o in scenario.obstacles if o.kind == "cone"]
        assert 3 <= len(cones) <= 8, scenario.id
        assert any(o.kind == "worker" for o in scenario.obstacles)
        points = np.array([(o.place.arc_m, o.place.left_m) for o in cones])
        nearest = [np.sort(np.hypot(*(points - p).T))[1] for p in points]
        assert min(nearest) >= 1.5, scenario.id
        assert max(nearest) <= 4.5, scenario.id


# --- what a family refuses ---------------------------------------------------------------------


def narrow() -> Site:
    return site_at(load_roads("back_bay"), "301020", 100.0, approach_m=80.0, beyond_m=80.0)


def test_a_nudge_beyond_1_4_m_is_an_overtake() -> None:
    assert nudge.nudge("nudge/x", site=narrow(), offset_m=1.4).family == "nudge"
    with pytest.raises(ScenarioError, match=r"use overtake\(\)"):
        nudge.nudge("nudge/x", site=narrow(), offset_m=1.41)


def test_an_overtake_that_fits_on_the_own_side_is_a_nudge() -> None:
    with pytest.raises(ScenarioError, match=r"use nudge\(\)"):
        overtake.overtake("overtake/x", site=narrow(), offset_m=1.5)
    assert overtake.overtake("overtake/x", site=narrow(), offset_m=1.6).family == "overtake"


def test_an_overtake_needs_room_on_the_oncoming_lane() -> None:
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
