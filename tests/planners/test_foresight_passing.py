"""How the foresight planner gets around who stands or is slow, and what it does when they go on."""

from __future__ import annotations

from dataclasses import replace
from math import pi

import numpy as np
import pytest
import shapely
from worlds import cars, curved_road, ego, ego_on, junction, mission, signals, straight_road, together

from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.signals import Signals
from tests.planners.staging_planners import foresee
from tests.quick import few

WIDTH_M = 3.5
FRONT_M = PACIFICA.length_m / 2
CROSSING = junction(arm_m=100.0)


@pytest.mark.parametrize(("lights", "least_m", "most_m"), [(signals(red=("13",)), 3.0, 6.0), (None, 6.5, 11.0)])
def test_behind_who_may_have_broken_down_it_keeps_room_to_pull_out(
    lights: Signals | None, least_m: float, most_m: float
) -> None:
    waiting = cars((-16.0, -WIDTH_M / 2))
    states = foresee(mission(CROSSING, ("1", "13", "7")), ego_on(CROSSING, "1", 40.0, 9.0), waiting, lights, 11.0)
    assert least_m < -16.0 - 2.4 - FRONT_M - states[-1].x_m < most_m


@pytest.mark.slow
def test_it_pulls_out_from_seven_metres_behind_a_parked_car() -> None:
    roads = junction(arm_m=300.0, limit_mps=10.0)
    parked = cars((90.0 - 312.0, -WIDTH_M / 2 - 0.3))
    start = ego_on(roads, "1", 90.0 - 2.4 - 7.0 - FRONT_M, 0.0)
    states = foresee(mission(roads, ("1",), goal_arc_m=200.0), start, parked, seconds=20.0)
    assert states[-1].x_m > 96.0 - 312.0


@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_who_stands_in_a_bend_with_its_wheel_turned_sets_off_without_cutting_it(turn: float) -> None:
    roads = curved_road(radius_m=7.0, angle_rad=turn * 0.8, run_in_m=40.0)
    stopped = replace(ego_on(roads, "11", 44.5), tire_angle_rad=turn * 0.5)
    states = foresee(mission(roads, ("11",)), stopped, seconds=9.0)
    road = shapely.union_all([lane.polygon for lane in roads.lanes.values()]).buffer(0.3)
    assert all(road.covers(state.polygon(PACIFICA)) for state in states if state.x_m > 42.0)
    assert np.hypot(states[-1].x_m - stopped.x_m, states[-1].y_m - stopped.y_m) > 12.0
    assert abs(states[-1].heading_rad - turn * 0.8) < pi / 8


def test_it_creeps_around_who_stands_close_to_its_way() -> None:
    """In a turn to the right, before the corner of a car that waits to come in; briskly it would come too near."""
    roads = curved_road(radius_m=12.0, angle_rad=-1.5, run_in_m=40.0)
    stopped = replace(ego_on(roads, "11", 43.0), tire_angle_rad=-0.24)
    forward = np.array((np.cos(stopped.heading_rad), np.sin(stopped.heading_rad)))
    x_m, y_m = np.array((stopped.x_m, stopped.y_m)) + 9.0 * forward
    waiting = cars((x_m, y_m, 0.0, stopped.heading_rad + np.radians(142.0)))
    states = foresee(mission(roads, ("11",)), stopped, waiting, seconds=12.0)
    assert np.hypot(states[-1].x_m - stopped.x_m, states[-1].y_m - stopped.y_m) > 20.0


@pytest.mark.slow
def test_it_keeps_its_lane_when_what_it_waited_to_pass_goes_on() -> None:
    """It has begun to pull out behind the last oncoming cars when the one before it sets off."""
    roads = junction(arm_m=300.0, limit_mps=10.0)
    middle_m = -WIDTH_M / 2

    def others(time_s: float) -> Actors:
        gone_s = max(0.0, time_s - 6.0)
        gone_m = 0.75 * min(gone_s, 6.0) ** 2 + 9.0 * max(gone_s - 6.0, 0.0)
        ahead = cars((90.0 - 312.0 + gone_m, middle_m, min(1.5 * gone_s, 9.0)))
        places = [(x_m - 312.0 - 10.0 * time_s, -middle_m, 10.0, pi) for x_m in np.arange(70.0, 151.0, 16.0).tolist()]
        return together(ahead, cars(*places, prefix="oncoming"))

    states = foresee(mission(roads, ("1",), goal_arc_m=250.0), ego_on(roads, "1", 52.0, 4.0), others, seconds=16.0)
    assert max(abs(state.y_m - middle_m) for state in states) < 1.0
    assert states[-1].x_m > 100.0 - 312.0


@pytest.mark.slow
def test_it_gives_up_a_pass_on_the_oncoming_lane_when_what_it_was_to_pass_is_gone() -> None:
    roads = junction(arm_m=300.0, limit_mps=10.0)
    middle_m = -WIDTH_M / 2

    def farthest_m(gone_s: float) -> float:
        def parked(time_s: float) -> Actors:
            return cars((90.0 - 312.0 + (150.0 if time_s > gone_s else 0.0), middle_m))

        states = foresee(mission(roads, ("1",), goal_arc_m=250.0), ego_on(roads, "1", 45.0, 9.0), parked, seconds=7.0)
        return max(state.y_m - middle_m for state in states)

    assert farthest_m(2.2) < 2.2 < 2.8 < farthest_m(60.0)


@pytest.mark.slow
@pytest.mark.parametrize(("rider_mps", "passes"), [(4.0, True), (9.5, False)])
def test_who_rides_a_bicycle_is_passed_if_slow(rider_mps: float, passes: bool) -> None:
    roads = straight_road(lanes=2, length_m=500.0, limit_mps=11.0)
    rider = cars((60.0, -WIDTH_M - 0.9, rider_mps), kind=ActorKind.BICYCLE, length_m=1.8, width_m=0.7)
    states = foresee(mission(roads, ("12",)), ego(30.0, -WIDTH_M, 9.0), rider, seconds=18.0)
    assert (states[-1].x_m > 60.0 + 18.0 * rider_mps + 8.0) == passes
    assert states[-1].y_m == pytest.approx(-WIDTH_M, abs=0.5)


@pytest.mark.slow
@pytest.mark.parametrize(("lead_m", "mps"), few([(73.5, 4.0), (74.0, 5.0)], 1))
def test_beside_what_it_was_to_pass_and_that_goes_on_it_waits_and_comes_in_behind_it(lead_m: float, mps: float) -> None:
    """It stands behind a queue on the lane beside, most of it ahead of the car in its own lane, when both set off."""
    roads = straight_road(lanes=2, length_m=500.0, limit_mps=11.0)

    def others(time_s: float) -> Actors:
        gone_s, rises_s = max(time_s - 9.0, 0.0), mps / 1.5
        gone_m = 0.75 * min(gone_s, rises_s) ** 2 + mps * max(gone_s - rises_s, 0.0)
        now_mps = min(1.5 * gone_s, mps)
        return cars((60.0 + gone_m, -WIDTH_M, now_mps), (lead_m + gone_m, 0.0, now_mps))

    states = foresee(mission(roads, ("12",)), ego_on(roads, "12", 35.0, 6.0), others, seconds=20.0)
    assert states[90].y_m > -WIDTH_M + 2.0
    assert states[90].x_m > 60.0 + 4.0
    assert states[-1].y_m == pytest.approx(-WIDTH_M, abs=0.6)
    assert states[-1].x_m < others(20.0).x_m[0] - 5.0
