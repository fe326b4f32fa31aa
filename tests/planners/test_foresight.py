"""What the foresight planner does in small worlds, driven in closed loop with others that keep their speed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from worlds import cars, ego, ego_on, junction, mission, observation, pedestrians, signals, straight_road, together

from interplan_planners.foresight import ForesightPlanner
from interplan_sumo.errors import InputError
from interplan_sumo.planner import Past, load_planner
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.roads import DrivingSide, Roads
from tests.planners.staging_planners import foresee, moved
from tests.quick import few
from tests.worlds import unmoved

WIDTH_M = 3.5
TWO = straight_road(lanes=2, length_m=400.0, limit_mps=12.0)
THREE = straight_road(lanes=3, length_m=400.0, limit_mps=12.0)
CROSSING = junction(arm_m=100.0)


def two_way(driving_side: DrivingSide = "right") -> Roads:
    """A road with one lane per direction: along lane "1" x grows from -312 m, lane "5" is beside it."""
    return junction(arm_m=300.0, limit_mps=10.0, driving_side=driving_side)


@pytest.mark.parametrize(("away_m", "goes"), [(6.0, True), (60.0, False)])
def test_at_yellow_it_stops_only_if_it_can(away_m: float, goes: bool) -> None:
    start = ego_on(CROSSING, "1", 100.0 - PACIFICA.length_m / 2 - away_m, 11.0)
    states = foresee(mission(CROSSING, ("1", "13", "7")), start, lights=signals(yellow=("13",)), seconds=9.0)
    assert (states[-1].x_m > 0.0) == goes


def test_beyond_its_goal_it_stops() -> None:
    states = foresee(mission(TWO, ("11",), goal_arc_m=60.0), ego(40.0, 0.0, 10.0), seconds=9.0)
    assert states[-1].vx_mps < 0.3
    assert states[-1].x_m > 60.0


def test_it_changes_to_the_goal_lane_on_a_free_road_and_tells_what_was_weighed() -> None:
    planner = ForesightPlanner()
    planner.start(mission(TWO, ("12",)))
    planner.plan(observation(ego(20.0, 0.0, 9.0)))
    assert planner.decision is not None
    assert (planner.decision.manoeuvre, planner.decision.waits_for_gap) == ("change", True)
    costs = [cost for _, cost in planner.decision.options]
    assert [planner.decision.cost, *costs] == sorted([*costs, costs[0]])
    states = foresee(mission(THREE, ("13",)), ego(20.0, 0.0, 10.0), seconds=12.0)
    assert states[-1].y_m == pytest.approx(-2 * WIDTH_M, abs=0.3)


def planned_jerk_mps3(planner: ForesightPlanner, time_s: float, actors: Actors) -> float:
    """Of the largest size within the first half second of a plan, from 12 m/s and no acceleration."""
    plan = planner.plan(observation(replace(ego(50.0, 0.0, 12.0), time_s=time_s), actors))
    speeds = np.hypot(np.diff(plan.x_m), np.diff(plan.y_m))[:6] / np.diff(plan.time_s)[:6]
    return float(np.abs(np.diff(speeds, 2)).max()) / 0.01


def test_a_drive_begins_gently_and_brakes_firmly_later() -> None:
    slower = cars((80.0, 0.0, 6.0))
    beginning, later = ForesightPlanner(), ForesightPlanner()
    for planner in (beginning, later):
        planner.start(mission(TWO, ("11",)))
    assert planned_jerk_mps3(beginning, 0.0, slower) < 1.2
    later.plan(observation(ego(38.0, 0.0, 12.0)))
    assert planned_jerk_mps3(later, 0.6, slower) < 1.2
    assert planned_jerk_mps3(later, 1.0, slower) > 1.6


def test_who_steps_out_is_braked_for_at_once_even_then() -> None:
    planner = ForesightPlanner()
    planner.start(mission(TWO, ("11",)))
    plan = planner.plan(observation(ego(50.0, 0.0, 12.0), pedestrians((68.0, 0.0))))
    speeds = np.hypot(np.diff(plan.x_m), np.diff(plan.y_m)) / np.diff(plan.time_s)
    assert speeds[5] < 12.0 - 0.5 * 5.0


def test_where_there_is_one_way_to_go_many_speeds_get_a_close_look_and_none_of_them_twice() -> None:
    planner, road = ForesightPlanner(), straight_road(lanes=1, length_m=400.0, limit_mps=12.0)
    planner.start(mission(road, ("11",)))
    planner.plan(observation(ego(50.0, 0.0, 11.0), cars((80.0, 0.0, 5.0))))
    assert planner.decision is not None
    names = [name for name, _ in planner.decision.options]
    assert len(names) >= 5
    assert "keep, at most 0 m/s2 for 2.4 s" not in names  # who has to brake anyhow brakes as in "keep"


@pytest.mark.slow
def test_it_gets_in_behind_a_car_beside_it() -> None:
    """The cars drive at the limit and never let it in; behind them there is room."""
    beside = cars((21.0, -WIDTH_M, 12.0), (36.0, -WIDTH_M, 12.0), (51.0, -WIDTH_M, 12.0))
    states = foresee(mission(TWO, ("12",)), ego(20.0, 0.0, 12.0), beside, seconds=18.0)
    assert states[-1].y_m == pytest.approx(-WIDTH_M, abs=0.4)
    assert states[-1].x_m < 21.0 + 18.0 * 12.0 - PACIFICA.length_m


@pytest.mark.slow
def test_it_does_not_cut_in_before_a_faster_car() -> None:
    """A car comes from behind on the goal lane; the change waits until it is past."""
    fast = cars((5.0, -WIDTH_M, 12.0))
    states = foresee(mission(TWO, ("12",)), ego(20.0, 0.0, 7.0), fast, seconds=12.0)
    assert states[-1].y_m == pytest.approx(-WIDTH_M, abs=0.4)
    crosses = next(k for k, state in enumerate(states) if state.y_m < -WIDTH_M / 2)
    other_m = 5.0 + 12.0 * 0.1 * crosses
    assert abs(other_m - states[crosses].x_m) > PACIFICA.length_m


def test_it_stays_where_it_is_while_the_goal_lane_is_full() -> None:
    row = cars(*((x, -WIDTH_M, 8.0) for x in np.arange(-60.0, 140.0, 8.0).tolist()))
    states = foresee(mission(TWO, ("12",), goal_arc_m=380.0), ego(20.0, 0.0, 8.0), row, seconds=5.0)
    assert max(abs(state.y_m) for state in states) < 0.7


@pytest.mark.slow
@pytest.mark.parametrize("driving_side", few(["right", "left"], 1))
def test_it_passes_a_parked_car_and_comes_back(driving_side: DrivingSide) -> None:
    """On the own side of a two-way road: the centre does not leave the lane."""
    sign = 1.0 if driving_side == "right" else -1.0
    task = mission(two_way(driving_side), ("1",), goal_arc_m=200.0)
    middle_m = -sign * WIDTH_M / 2
    parked = cars((90.0 - 312.0, middle_m - 1.6 * sign))
    states = foresee(task, ego_on(task.roads, "1", 45.0, 9.0), parked, seconds=13.0)
    assert states[-1].x_m > 110.0 - 312.0
    assert states[-1].y_m == pytest.approx(middle_m, abs=0.4)
    assert 0.4 < max(sign * (state.y_m - middle_m) for state in states) < WIDTH_M / 2


@pytest.mark.slow
def test_it_waits_for_an_oncoming_car_before_it_uses_its_lane() -> None:
    task = mission(two_way(), ("1",), goal_arc_m=250.0)
    oncoming = cars((170.0 - 312.0, WIDTH_M / 2, 10.0, np.pi), prefix="oncoming")
    others = together(cars((90.0 - 312.0, -WIDTH_M / 2)), oncoming)
    states = foresee(task, ego_on(task.roads, "1", 40.0, 9.0), others, seconds=21.0)
    assert states[-1].x_m > 110.0 - 312.0
    out = next(k for k, state in enumerate(states) if state.y_m > 1.0 - WIDTH_M / 2)
    assert 170.0 - 312.0 - out * 0.1 * 10.0 < states[out].x_m


def test_the_longer_it_waits_the_more_it_is_worth_to_pass() -> None:
    """It is held where it is; somebody might come all the time, and nobody does."""
    planner, parked = ForesightPlanner(), cars((150.0 - 312.0, -WIDTH_M / 2), length_m=9.0)
    task = mission(two_way(), ("1",), goal_arc_m=250.0)
    planner.start(task)
    costs: list[float] = []
    for k in range(30):
        held = ego_on(task.roads, "1", 110.0, time_s=0.4 * k)
        planner.plan(unmoved(held, parked))
        assert planner.decision is not None
        if held.time_s > 0.7:  # until then it would set off more gently
            costs.append(min(cost for name, cost in planner.decision.options if name.startswith("pass")))
    assert costs == sorted(costs, reverse=True)
    assert costs[-1] < costs[0] - 2.0
    assert planner.decision is not None
    assert planner.decision.manoeuvre == "pass"


@pytest.mark.slow
def test_it_waits_behind_a_car_that_waits_at_a_light() -> None:
    waiting = cars((-16.0, -WIDTH_M / 2))
    task = mission(CROSSING, ("1", "13", "7"))
    states = foresee(task, ego_on(CROSSING, "1", 50.0, 9.0), waiting, signals(red=("13",)), 13.0)
    assert states[-1].vx_mps == pytest.approx(0.0, abs=0.1)
    assert max(abs(state.y_m + WIDTH_M / 2) for state in states) < 0.3


@pytest.mark.slow
def test_it_leaves_a_lane_that_cones_close_and_returns_for_the_goal() -> None:
    cones = cars(
        *((90.0 + 3.0 * i, -1.2 + 0.4 * i) for i in range(6)), kind=ActorKind.TRAFFIC_CONE, length_m=0.5, width_m=0.5
    )
    states = foresee(mission(TWO, ("11",), goal_arc_m=250.0), ego(40.0, 0.0, 10.0), cones, seconds=21.0)
    assert states[-1].x_m > 200.0
    assert min(state.y_m for state in states) < -1.5 or max(state.y_m for state in states) > 0.5
    assert states[-1].y_m == pytest.approx(0.0, abs=0.5)


@pytest.mark.slow
def test_it_lets_somebody_cross_and_goes_on() -> None:
    def crossing(time_s: float) -> Actors:
        y = min(-6.0 + 1.4 * time_s, 8.0)
        return pedestrians((75.0, y, 1.4 if y < 8.0 else 0.0, np.pi / 2))

    states = foresee(mission(TWO, ("11",)), ego(30.0, 0.0, 11.0), crossing, seconds=14.0)
    assert min(state.vx_mps for state in states) < 9.0
    assert states[-1].x_m > 100.0


@settings(max_examples=6)
@given(
    seed=st.integers(0, 2**31), speed=st.floats(0.0, 12.0), left_m=st.floats(-0.5, 0.5),
)  # fmt: skip
@example(seed=396, speed=10.0, left_m=0.0)
def test_a_mirrored_world_gives_a_mirrored_plan(seed: int, speed: float, left_m: float) -> None:
    rng = np.random.default_rng(seed)
    axis_m = -WIDTH_M  # the middle lane
    rows = np.stack(
        (rng.uniform(0.0, 160.0, 8), rng.choice((0.0, -WIDTH_M, -2 * WIDTH_M), 8), rng.choice((0.0, 4.0, 9.0), 8)),
        axis=1,
    )
    rows = rows[(np.abs(rows[:, 0] - 60.0) > 8.0) | (np.abs(rows[:, 1] - axis_m) > 1.0)]
    others = cars(*(tuple(row) for row in rows.tolist()))
    plans = []
    for flip, lane in ((1.0, "11"), (-1.0, "13")):
        flipped = {"y_m": 2.0 * axis_m - others.y_m, "heading_rad": -others.heading_rad, "vy_mps": -others.vy_mps}
        world = others if flip > 0 else replace(others, **flipped)
        planner = ForesightPlanner()
        planner.start(mission(THREE, (lane,), goal_arc_m=300.0))
        past = Past((), tuple(moved(world, -0.1 * ago) for ago in range(20, 0, -1)))
        plans.append(planner.plan(observation(ego(60.0, axis_m + flip * left_m, speed), world, past=past)))
        assert planner.decision is not None
        (_, best), (_, second), *_ = planner.decision.options
        assume(second - best > 1e-9)  # left and right may be worth the same
    assert plans[0].x_m == pytest.approx(plans[1].x_m, abs=1e-6)
    assert plans[0].y_m - axis_m == pytest.approx(axis_m - plans[1].y_m, abs=1e-6)


@pytest.mark.parametrize("option", ["replan_s", "fallback_limit_mps", "change_time_s", "horizon_s"])
def test_options_that_cannot_be_are_refused(option: str) -> None:
    with pytest.raises(InputError, match=option):
        load_planner(f"foresight?{option}=0")
