"""Situations: what a sample shows, on both sides of what tells one from another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from worlds import cars, drive, drive_along, junction, signals, straight_road

from interplan_sumo.dataset.labels import GraphWay
from interplan_sumo.dataset.scenario_tags import ScenarioTags
from interplan_sumo.features.schema import SITUATIONS
from interplan_sumo.scenario.scenario import LanePosition, Scenario
from interplan_sumo.world.geometry import Polyline, Pose
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import Trace


def shown(roads: Roads, route: tuple[str, ...], trace: Trace, frame: int = 0) -> str:
    scenario = Scenario("test/0", "test", roads.name, LanePosition("1", 0.0), 0.0, LanePosition("1", 1.0), route)
    return SITUATIONS[ScenarioTags(scenario, roads, trace, GraphWay(roads, trace)).at(frame)]


def on_a_road(trace: Trace, frame: int = 0) -> str:
    roads = straight_road(lanes=2, length_m=400.0)
    return shown(roads, tuple(roads.roadblocks), trace, frame)


def start(left_m: float = 0.0) -> Pose:
    return Pose(10.0, left_m, 0.0)


LEADER_M = 10.0 + 2.588 + 2.4
"""Half the ego's and half the car's length ahead of the start."""


@pytest.mark.parametrize(
    ("car", "found"),
    [
        ((), "free"),
        (((LEADER_M + 39.9, 0.0, 10.0),), "following"),
        (((LEADER_M + 40.1, 0.0, 10.0),), "free"),  # too far
        (((40.0, 1.9, 10.0),), "following"),
        (((40.0, 2.1, 10.0),), "free"),  # not in the way
        (((40.0, 0.0, 10.0, np.pi / 2),), "free"),  # crosses
    ],
)
def test_a_leader_is_in_the_way_and_nearer_than_40_m(car: tuple[tuple[float, ...], ...], found: str) -> None:
    assert on_a_road(drive(*(10.0,) * 100, start=start(), actors=cars(*car))) == found


@pytest.mark.parametrize(
    ("now_mps", "later_mps", "found"),
    [(10.0, 0.49, "stopping"), (10.0, 0.51, "free"), (0.0, 1.9, "standing"), (0.0, 2.1, "starting")],
)
def test_who_stops_and_who_stands_starts_or_stays(now_mps: float, later_mps: float, found: str) -> None:
    assert on_a_road(drive(*(now_mps,) * 40, *(later_mps,) * 60, start=start())) == found


@pytest.mark.parametrize(("frame", "found"), [(0, "free"), (15, "lane_change"), (60, "lane_change"), (85, "free")])
def test_a_lane_change_is_one_from_5_s_before_to_1_s_after_the_other_lane_is_reached(frame: int, found: str) -> None:
    line = Polyline(np.array(((10.0, -3.5), (60.0, -3.5), (80.0, 0.0), (390.0, 0.0))))  # crossed after 6 s
    assert on_a_road(drive_along(line, *(10.0,) * 200), frame) == found


def at_the_junction(chain: tuple[str, ...], start_m: float, light: str = "", speeds: tuple[float, ...] = ()) -> str:
    roads = junction()
    line = Polyline(np.concatenate([roads[lane].centerline.points for lane in chain]))
    trace = drive_along(line, *(speeds or (8.0,) * 100), start_m=start_m)
    if light:
        trace = replace(trace, signals=(signals(**{light: [chain[1]]}),) * len(trace))
    return shown(roads, chain, trace)


@pytest.mark.parametrize(
    ("chain", "found"), [(("1", "14", "8"), "turning"), (("1", "12", "6"), "turning"), (("1", "13", "7"), "free")]
)
def test_a_turn_is_told_5_s_ahead(chain: tuple[str, ...], found: str) -> None:
    assert at_the_junction(chain, 35.0) == found
    assert at_the_junction(chain, 3.0, speeds=(5.0,) * 100) == "free"  # 11 s before


@pytest.mark.parametrize(
    ("light", "start_m", "found"),
    [("red", 10.5, "red_light"), ("yellow", 10.5, "red_light"), ("green", 10.5, "free"), ("red", 9.5, "free")],
)
def test_a_red_light_matters_from_50_m_on(light: str, start_m: float, found: str) -> None:
    assert at_the_junction(("1", "13", "7"), start_m, light) == found  # the lane is 60 m long


def test_standing_at_a_red_light_is_standing() -> None:
    assert at_the_junction(("1", "13", "7"), 50.0, "red", (0.0,) * 100) == "standing"


def test_the_lights_of_other_ways_do_not_matter() -> None:
    roads = junction()
    trace = replace(drive_along(roads["1"].centerline, *(8.0,) * 30, start_m=20.0))
    trace = replace(trace, signals=(signals(red=["14"], green=["13"]),) * len(trace))
    assert shown(roads, ("1", "13", "7"), trace) == "free"


def test_off_the_route_is_not_on_the_way() -> None:
    roads = straight_road(lanes=1, length_m=100.0, cuts_m=((40.0, 60.0),))
    trace = drive(*(10.0,) * 80, start=start())
    scenario = Scenario("test/0", "test", "tiny", LanePosition("11", 0.0), 0.0, LanePosition("11", 1.0), ("1",))
    own = ScenarioTags(scenario, roads, trace, GraphWay(roads, trace))
    assert own.on_way[0]
    assert not own.on_way[60]
