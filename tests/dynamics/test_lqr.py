from __future__ import annotations

from dataclasses import replace
from math import cos, pi, sin
from typing import TypeVar

import numpy as np
import pytest
from golden_controller import aim_pairs, case_names, loop_pairs, read_case, step_pairs
from hypothesis import given
from hypothesis import strategies as st
from worlds import ego, straight_plan

from interplan_sumo.dynamics import lqr
from interplan_sumo.dynamics.lqr import LARGEST_INVERSE, Command, target, track
from interplan_sumo.dynamics.rear_axle import center_of
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.trajectory import Trajectory
from tests.golden_values import GOLDEN, SHIPPED

# The fits of nuPlan run on pseudo-inverses at coordinates of 4e6 m: 1e-9 is what agrees.
TIGHT = 1e-9
CLOSED_LOOP = 1e-6

AnyNumbers = TypeVar("AnyNumbers", Floats, float)


def through_rear_axle(time_s: Floats, x_m: Floats, y_m: Floats, heading: Floats) -> Trajectory:
    d = PACIFICA.rear_axle_to_center_m
    return Trajectory(time_s, x_m + d * np.cos(heading), y_m + d * np.sin(heading), heading)


def every(dt_s: float, count: int) -> Floats:
    return np.linspace(0.0, dt_s * (count - 1), count)


def ego_with_rear_axle(x_m: float, y_m: float, heading: float, **dynamics: float) -> EgoState:
    return EgoState(0.0, *center_of(x_m, y_m, heading, PACIFICA), heading, **dynamics)


@pytest.mark.parametrize("name", case_names())
def test_one_step_agrees_with_nuplan_in_every_stored_number(name: str) -> None:
    case = read_case(name)
    assert {p.what: p.difference for p in aim_pairs(case) if not p.difference <= TIGHT} == {}
    assert {p.what: p.difference for p in step_pairs(case) if not p.difference <= 1e-8} == {}


@pytest.mark.parametrize("name", [name for name in case_names() if name.startswith("loop_")])
def test_fifty_steps_agree_with_nuplan(name: str) -> None:
    found = list(loop_pairs(read_case(name)))
    assert sum(p.count for p in found) > 100
    assert {p.what: p.difference for p in found if not p.difference <= CLOSED_LOOP} == {}


@pytest.mark.skipif(GOLDEN != SHIPPED, reason="another folder of golden cases")
def test_the_golden_cases_are_all_there() -> None:
    assert len(case_names()) == 21


def test_an_ego_on_its_plan_changes_nothing() -> None:
    state = ego(100.0, 50.0, 9.0, heading_rad=0.7)
    command = track(state, straight_plan(state, horizon_s=8.0))
    assert (command.acceleration_mps2, command.tire_rate_radps) == pytest.approx((0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize("late_s", [0.0, 0.05, 0.3, 1.0])
def test_a_plan_that_began_before_now_is_followed_from_now_on(late_s: float) -> None:
    plan = straight_plan(ego(speed_mps=9.0), horizon_s=2.0)
    command = track(ego(9.0 * late_s, 0.0, 9.0, time_s=late_s), plan)
    assert (command.acceleration_mps2, command.tire_rate_radps) == pytest.approx((0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize("horizon_s", [0.1, 0.2, 0.25, 0.5])
def test_two_poses_suffice(horizon_s: float) -> None:
    plan = straight_plan(ego(speed_mps=5.0), horizon_s, step_s=horizon_s)
    assert len(plan) == 2
    assert target(ego(speed_mps=4.0), plan).speed_mps == pytest.approx(5.0)


@pytest.mark.parametrize(("now_s", "covered"), [(2.9985, False), (2.9995, True), (4.0005, True), (4.0015, False)])
def test_a_plan_must_cover_now(now_s: float, covered: bool) -> None:
    plan = straight_plan(ego(speed_mps=5.0, time_s=3.0))
    state = replace(ego(speed_mps=5.0), time_s=now_s)
    if covered:
        track(state, plan)
    else:
        with pytest.raises(ValueError, match=r"the plan covers 3.000 to 4.000 s, not now"):
            track(state, plan)


@pytest.mark.skipif(GOLDEN != SHIPPED, reason="another folder of golden cases")
def test_times_of_the_epoch_change_little() -> None:
    case = read_case("noisy_plan_0p5")
    later = case.start_us * 1e-6
    plan = replace(case.plan, time_s=case.plan.time_s + later)
    assert target(replace(case.ego, time_s=later), plan).speed_mps == pytest.approx(
        target(case.ego, case.plan).speed_mps, abs=1e-5
    )


@st.composite
def drives(draw: st.DrawFn) -> tuple[EgoState, Trajectory]:
    """An ego near a plan of changing speed and curvature that never stands: a turn on the spot is ill-conditioned."""
    count = draw(st.integers(2, 30))
    dt_s = draw(st.sampled_from((0.1, 0.2, 0.5)))
    speed = np.array(draw(st.lists(st.floats(1.0, 20.0), min_size=count, max_size=count)))
    turn = np.array(draw(st.lists(st.floats(-0.1, 0.1), min_size=count, max_size=count)))
    heading = np.cumsum(turn)
    x = np.cumsum(speed * dt_s * np.cos(heading))
    y = np.cumsum(speed * dt_s * np.sin(heading))
    plan = through_rear_axle(every(dt_s, count), x, y, heading)
    near = st.floats(-1.0, 1.0)
    state = ego_with_rear_axle(
        float(x[0]) + draw(near), float(y[0]) + draw(near), float(heading[0]) + 0.3 * draw(near),
        vx_mps=draw(st.floats(0.0, 20.0)), tire_angle_rad=0.3 * draw(near),
    )  # fmt: skip
    return state, plan


@given(drive=drives(), angle=st.floats(-pi, pi), dx=st.floats(-1e6, 1e6), dy=st.floats(-5e6, 5e6))
def test_moving_the_world_does_not_change_the_command(
    drive: tuple[EgoState, Trajectory], angle: float, dx: float, dy: float
) -> None:
    state, plan = drive
    c, s = cos(angle), sin(angle)

    def moved(x: AnyNumbers, y: AnyNumbers) -> tuple[AnyNumbers, AnyNumbers]:
        return c * x - s * y + dx, s * x + c * y + dy

    moved_plan = Trajectory(plan.time_s, *moved(plan.x_m, plan.y_m), plan.heading_rad + angle)
    x_m, y_m = moved(state.x_m, state.y_m)
    moved_state = replace(state, x_m=x_m, y_m=y_m, heading_rad=state.heading_rad + angle)
    assert_close(track(moved_state, moved_plan), track(state, plan))


@given(drive=drives(), turns=st.integers(-3, 3))
def test_full_turns_of_the_headings_do_not_change_the_command(drive: tuple[EgoState, Trajectory], turns: int) -> None:
    state, plan = drive
    jumps = 2 * pi * np.arange(len(plan)) * turns
    assert_close(track(state, replace(plan, heading_rad=plan.heading_rad + jumps)), track(state, plan))


@given(drive=drives())
def test_mirroring_the_world_mirrors_the_steering(drive: tuple[EgoState, Trajectory]) -> None:
    state, plan = drive
    mirrored = replace(state, y_m=-state.y_m, heading_rad=-state.heading_rad, tire_angle_rad=-state.tire_angle_rad)
    command = track(mirrored, replace(plan, y_m=-plan.y_m, heading_rad=-plan.heading_rad))
    assert_close(Command(command.acceleration_mps2, -command.tire_rate_radps), track(state, plan))


@given(drive=drives(), later_s=st.floats(0.0, 1e3))
def test_the_clock_does_not_matter(drive: tuple[EgoState, Trajectory], later_s: float) -> None:
    state, plan = drive
    later = replace(plan, time_s=plan.time_s + later_s)
    assert_close(track(replace(state, time_s=float(later.time_s[0])), later), track(state, plan))


def assert_close(command: Command, wanted: Command) -> None:
    assert command.acceleration_mps2 == pytest.approx(wanted.acceleration_mps2, abs=1e-6)
    # An error of half a turn may be steered either way.
    assert abs(command.tire_rate_radps) == pytest.approx(abs(wanted.tire_rate_radps), abs=1e-6)


def test_the_speed_fit_solves_its_normal_equations() -> None:
    """Against the dense system, second differences weighted by jerk penalty / dt^4 = 1; short plans and long ones."""
    rng = np.random.default_rng(3)
    for count in (1, 2, 3, 4, 7, 80, LARGEST_INVERSE, LARGEST_INVERSE + 1):
        moved = rng.uniform(0.0, 2.0, count)
        x = np.concatenate(([0.0], np.cumsum(moved)))
        time_s = every(0.1, count + 1)
        plan = Trajectory(time_s, x, 0 * x, 0 * x)
        second = np.diff(np.eye(count), n=2, axis=0)
        wanted = np.linalg.solve(np.eye(count) + second.T @ second, moved / 0.1)
        now = max(0, count - 11)
        at = target(ego(float(x[now]), time_s=float(time_s[now])), plan)
        assert at.speed_mps == pytest.approx(wanted[min(now + 10, count - 1)], abs=1e-9)


def test_the_quick_way_for_straight_plans_gives_what_the_whole_fit_gives() -> None:
    rng = np.random.default_rng(5)
    for count in (2, 3, 11, 80, 250):
        forward_m = rng.uniform(0.0, 2.0, count)
        profile = lqr._speeds(forward_m)
        for at in (10.0, 10.25, 40.5, 0.0):
            assert lqr._speed_at(forward_m, at) == lqr._held(profile, at)


def test_a_plan_that_bends_after_a_straight_is_steered_into_ahead_of_the_bend() -> None:
    heading = np.concatenate((np.zeros(5), 0.05 * np.arange(1.0, 40.0)))
    x, y = (np.concatenate(([0.0], np.cumsum(0.8 * turn(heading[:-1])))) for turn in (np.cos, np.sin))
    plan = through_rear_axle(every(0.1, len(heading)), x, y, heading)
    assert target(ego_with_rear_axle(0.0, 0.0, 0.0, vx_mps=8.0), plan).curvature_per_m[9] == pytest.approx(
        0.0625, abs=2e-3
    )
