"""Scenarios as data: what is refused, what the hash sees, and the route as a line."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import pytest
from worlds import straight_road

from interplan_sumo.errors import ScenarioError
from interplan_sumo.scenario.recorded_parts import PAST_COLUMNS, PAST_STEPS, EgoPast, LoggedLight, ReplayedTrack
from interplan_sumo.scenario.route import goal_arc_m, route_centerline, route_lanes
from interplan_sumo.scenario.scenario import Jaywalker, LanePosition, Obstacle, Scenario, TrafficDemand
from tests.metrics.staging import scenario_on

ROAD = straight_road(lanes=3, length_m=300.0, cuts_m=((100.0, 110.0), (200.0, 210.0)))


def staged(goal_lane: str = "51", start_lane: str = "13") -> Scenario:
    return scenario_on(ROAD, (start_lane, 10.0), (goal_lane, 50.0))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"duration_s": 0.0}, "duration_s is 0.0"),
        ({"duration_s": 3.05}, "multiple of 0.1 s"),
        ({"start_speed_mps": -1.0}, "start_speed_mps is -1.0"),
        ({"start_speed_mps": float("nan")}, "start_speed_mps is nan"),
        ({"start_speed_mps": 60.1}, "start_speed_mps is 60.1, expected 0 to 60"),
        ({"duration_s": 3600.1}, "duration_s is 3600.1, expected 0.1 to 3600"),
        ({"duration_s": 0.0}, "duration_s is 0.0, expected 0.1 to 3600"),
        ({"light_time_s": 1e300}, "light_time_s is 1e.300, expected 0 to 3600"),
        ({"start": LanePosition("11", 20.0, 1e300)}, r"start.left_m is 1e.300, expected -100 to 100"),
        (
            {"obstacles": (Obstacle(LanePosition("11", 60.0), turned_rad=1e308),)},
            r"obstacles\[0\].turned_rad is 1e.308, expected -7 to 7",
        ),
        (
            {"obstacles": (Obstacle(LanePosition("11", 60.0), length_m=101.0),)},
            r"has the size .*, expected more than 0 and at most 100 m",
        ),
        ({"route": ()}, "route is empty"),
        (
            {"traffic": TrafficDemand(density=cast(Any, "dense"))},
            "traffic.density is 'dense', expected none, rare, sparse, low, medium, high",
        ),
        ({"obstacles": (Obstacle(LanePosition("11", 5.0), cast("Any", "tank")),)}, r"obstacles\[0\]\.kind is 'tank'"),
        ({"obstacles": (Obstacle(LanePosition("11", 5.0), length_m=-1.0),)}, r"obstacles\[0\] has the size"),
        ({"jaywalkers": (Jaywalker(LanePosition("11", 5.0), LanePosition("11", 5.0, 9.0), 9.0),)}, r"speed_mps is 9.0"),
    ],
)
def test_a_field_that_cannot_be_is_named(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        replace(staged(), **change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"start": LanePosition("99", 5.0)}, "start: map .* has no lane '99'"),
        ({"goal": LanePosition("51", 500.0)}, "goal: lane 51 is 90.0 m long, there is no place at 500.0 m"),
        ({"route": ("1", "3", "5")}, "route jumps from roadblock 1 to 3"),
        ({"route": ("1", "2", "77")}, "does not lie on the route"),
        ({"obstacles": (Obstacle(LanePosition("88", 5.0)),)}, r"obstacles\[0\]: map .* has no lane '88'"),
    ],
)
def test_what_does_not_fit_the_map_is_named(change: dict[str, Any], message: str) -> None:
    staged().check(ROAD)
    with pytest.raises(ScenarioError, match=message):
        replace(staged(), **change).check(ROAD)


def test_the_hash_sees_every_field_and_seeds_give_different_chance() -> None:
    one, values = staged(), (0.0,) * PAST_STEPS
    changed = [
        replace(one, start_speed_mps=10.1),
        replace(one, obstacles=(Obstacle(LanePosition("11", 5.0)),)),
        replace(one, lights=(LoggedLight("21", (0,), ("red",)),)),
        replace(one, past=EgoPast(*[values] * len(PAST_COLUMNS))),
        replace(one, replayed=(ReplayedTrack("a", "vehicle", 4.6, 1.85, 0, *[values] * 5),)),
    ]
    assert len({each.hash() for each in (one, staged(), *changed)}) == 6
    assert one.rng(0).random() == staged().rng(0).random() != one.rng(1).random()


def test_the_route_follows_the_goal_lane_back_to_the_start() -> None:
    assert route_lanes(ROAD, staged("51"))[::2] == ("11", "31", "51")
    line = route_centerline(ROAD, staged("51"))
    assert line.length_m == pytest.approx(300.0)
    assert goal_arc_m(ROAD, staged("51")) == pytest.approx(260.0)


def test_a_goal_off_the_route_is_an_error() -> None:
    astray = replace(staged(), route=("3", "4", "5"), start=LanePosition("33", 10.0), goal=LanePosition("13", 1.0))
    with pytest.raises(ScenarioError, match="goal lane 13 does not lie on the route"):
        route_lanes(ROAD, astray)


def test_the_site_is_the_first_obstacle_or_else_the_goal() -> None:
    assert staged().site(ROAD) == "tiny_road/5@50"
    blocked = replace(staged(), obstacles=(Obstacle(LanePosition("31", 47.0)),))
    assert blocked.site(ROAD) == "tiny_road/3@40"
