from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest
from worlds import curved_road, ego, ego_on, junction, mission, signals, straight_road

from interplan_planners.common.driven_route import DrivenRoute
from interplan_planners.common.lane_routes import Ways
from interplan_planners.common.paths import DrivingPath
from interplan_planners.common.red_lights import RedLights
from interplan_planners.common.route_correction import block_at, corrected_route
from interplan_planners.common.route_search import LaneFinder, lane_chain, lane_changes_to
from interplan_planners.mobil_published import lane_costs
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import Pose
from interplan_sumo.world.roads import Roads

CROSSING = junction()
WIDE = straight_road(lanes=3, length_m=300.0, limit_mps=13.9, cuts_m=((120.0, 135.0),))
ROUTE = ("1", "2", "3")


def test_the_finder_takes_the_lane_that_holds_the_point() -> None:
    finder = LaneFinder(WIDE, ROUTE)
    assert finder.at(50.0, -3.0, 0.0) == (0, "12")
    assert finder.at(125.0, 0.5, 0.0) == (1, "21")
    assert finder.at(200.0, -40.0, 0.0) == (2, "33")


def test_where_connectors_overlap_the_heading_decides() -> None:
    finder = LaneFinder(CROSSING, ("1", "12", "13", "14"))
    place = CROSSING["1"].centerline.points[-1]
    x_m, y_m = float(place[0]) + 1.0, float(place[1])
    found = {finder.at(x_m, y_m, turn)[1] for turn in (-0.6, 0.6)}
    assert found == {"12", "14"}


def test_the_shortest_chain_need_not_be_the_first() -> None:
    chain = lane_chain(CROSSING, ("1", "14", "8"), 0, "1", shortest=True)
    assert chain == ("1", "14", "8")
    assert lane_chain(WIDE, ROUTE, 0, "12", shortest=True, depth=2) == ("12", "22")


@pytest.mark.parametrize(("y_m", "needed"), [(0.0, {"11": 0, "12": 1, "13": 2}), (-7.0, {"11": 2, "12": 1, "13": 0})])
def test_lane_changes_are_counted_to_the_lane_of_the_goal(y_m: float, needed: dict[str, int]) -> None:
    found = lane_changes_to(WIDE, ROUTE, Pose(250.0, y_m, 0.0))
    assert {lane: found[lane] for lane in ("11", "12", "13")} == needed
    assert {found[f"2{i}"] for i in (1, 2, 3)} == {0, 1, 2}


def test_a_lane_that_leads_nowhere_is_counted_by_its_neighbours() -> None:
    found = lane_changes_to(CROSSING, ("1", "14", "8"), Pose(1.75, 60.0, np.pi / 2))
    assert found == {"8": 0, "14": 0, "1": 0}


def test_published_costs_know_the_goal_only_on_the_last_block() -> None:
    costs = lane_costs(WIDE, ROUTE, Pose(250.0, -7.0, 0.0))
    assert [costs[f"3{i}"] for i in (1, 2, 3)] == [2, 1, 0]
    assert [costs[f"1{i}"] for i in (1, 2, 3)] == [2, 1, 0]  # carried back, for all lanes of block 1 lead on
    assert set(lane_costs(WIDE, ROUTE, Pose(250.0, 50.0, 0.0)).values()) == {0}  # a goal off every lane: all are good


@pytest.mark.parametrize(
    ("roads", "route", "x_m", "y_m", "corrected"),
    [
        (WIDE, ROUTE, 50.0, 0.0, ROUTE),
        (WIDE, ("3",), 50.0, -3.5, ROUTE),  # blocks are put in front
        (CROSSING, ("1", "8"), -40.0, -1.75, ("1", "14", "8")),  # one is missing
        (WIDE, ROUTE, 200.0, 0.0, ROUTE),  # begins behind the ego
        (WIDE, (*ROUTE, *ROUTE), 50.0, 0.0, ROUTE),  # a circle
        (CROSSING, ("6",), 60.0, -1.75, ("6",)),  # cannot be reached
    ],
)
def test_a_route_is_corrected_to_lead_from_the_ego(
    roads: Roads, route: tuple[str, ...], x_m: float, y_m: float, corrected: tuple[str, ...]
) -> None:
    assert corrected_route(roads, route, Pose(x_m, y_m, 0.0)) == corrected


def test_the_ego_is_on_the_block_that_heads_its_way() -> None:
    assert block_at(CROSSING, (), Pose(-40.0, -1.75, 0.0)) == "1"
    assert block_at(CROSSING, (), Pose(-40.0, 0.0, np.pi)) == "5"
    assert block_at(CROSSING, (), Pose(300.0, 300.0, 0.0)) in {"8", "4", "7", "3"}


def test_a_way_runs_from_its_lane_as_far_as_the_route() -> None:
    job = mission(WIDE, ("11", "21", "31"), goal_arc_m=100.0)
    way = Ways(job, ROUTE, 10.0).from_lane(0, "12")
    assert way.lanes == ("12", "22", "32")
    assert way.starts_m == pytest.approx([0.0, 120.0, 135.0])
    assert way.path.length_m == pytest.approx(300.0)
    assert way.room_m == pytest.approx(235.0)
    assert way.limit_mps == pytest.approx(13.9)


def test_where_a_way_leaves_the_route_the_room_ends() -> None:
    job = mission(CROSSING, ("1", "14"))
    way = Ways(job, ("1", "14", "7"), 10.0).from_lane(0, "1")
    assert way.lanes == ("1", "14")
    assert way.room_m == pytest.approx(way.path.length_m)


def test_neighbours_are_told_with_what_they_spare() -> None:
    ways = Ways(mission(WIDE, ("11", "21", "31")), ROUTE, 10.0)
    assert [(lane.id, spared) for lane, spared in ways.beside("12")] == [("11", 1), ("13", -1)]
    assert [(lane.id, spared) for lane, spared in ways.beside("11")] == [("12", -1)]
    assert ways.beside("22") == ()


def test_speed_limits_slow_for_bends_and_in_time() -> None:
    road = curved_road(radius_m=12.0, run_in_m=100.0, limit_mps=15.0)
    way = Ways(mission(road, ("11",)), ("1",), 10.0).from_lane(0, "11")
    assert way.limit_mps[0] == pytest.approx(15.0)
    assert way.limit_mps[110] == pytest.approx(np.sqrt(3.0 * 12.0), rel=0.05)
    before = np.diff(way.limit_mps[60:98] ** 2)
    assert before.min() >= -2.0 * 1.5 - 1e-6
    unknown = mission(straight_road(limit_mps=None), ("11",))
    assert Ways(unknown, ("1",), 9.0).from_lane(0, "11").limit_mps == pytest.approx(9.0)


def test_red_connectors_of_the_route_close_the_path() -> None:
    lights = RedLights(CROSSING, ("1", "14", "8"), PACIFICA.width_m / 2)
    path = DrivingPath(CROSSING["1"].centerline)
    closed = lights.closed(signals(red=("12", "14"), green=("13",)), ego_on(CROSSING, "1", 20.0), PACIFICA)
    assert closed == ("14",)
    ((start_m, _),) = lights.on_path(path, closed)
    assert start_m == pytest.approx(59.0, abs=1.1)  # a touch of the end of the lane; resolution is 1 m
    assert lights.on_path(path, ()) == []


def test_an_ego_inside_a_red_connector_is_let_go() -> None:
    lights = RedLights(CROSSING, ("1", "13", "7"), PACIFICA.width_m / 2)
    red = signals(red=("13",))
    assert lights.closed(red, ego(-11.0, -1.75), PACIFICA) == ("13",)
    assert lights.closed(red, ego(0.0, -1.75), PACIFICA) == ()


def test_paths_that_nobody_has_any_more_are_forgotten() -> None:
    lights = RedLights(CROSSING, ("1", "14", "8"), PACIFICA.width_m / 2)

    def asked_about() -> weakref.ref[DrivingPath]:
        path = DrivingPath(CROSSING["1"].centerline)
        assert lights.on_path(path, ("14",)) == lights.on_path(path, ("14",)) != []
        return weakref.ref(path)

    forgotten = [asked_about() for _ in range(3)]
    gc.collect()
    assert [each() for each in forgotten] == [None, None, None]


def test_a_driven_route_begins_where_the_ego_is_and_makes_each_part_once() -> None:
    task = mission(WIDE, ("12", "22", "32"), goal_arc_m=100.0)
    route = DrivenRoute(task, ego_on(WIDE, "12", 20.0).pose, 9.0)
    assert route.blocks == corrected_route(WIDE, task.route, ego_on(WIDE, "12", 20.0).pose)
    assert route.lane_at(Pose(50.0, -3.0, 0.0)) == (0, "12")
    assert route.limit_mps("12") == 13.9
    assert DrivenRoute(mission(straight_road(limit_mps=None), ("11",)), ego(5.0, 0.0).pose, 9.0).limit_mps("11") == 9.0
    assert (route.ways, route.ground, route.red_lights) == (route.ways, route.ground, route.red_lights)
    on_route = route.ground.under(np.array((50.0, 50.0)), np.array((-3.0, 40.0))).on_route
    assert on_route.tolist() == [True, False]
