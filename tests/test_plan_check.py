from __future__ import annotations

import re

import numpy as np
import pytest
from worlds import ego, straight_plan

from interplan_sumo.dynamics.lqr import follow
from interplan_sumo.errors import PlannerError
from interplan_sumo.plan_check import check_plan
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.trajectory import Trajectory

EGO = ego(100.0, 50.0, 10.0, time_s=3.5)


def plan(*, time_s: Floats | None = None, x_m: Floats | None = None, heading: float = 0.0) -> Trajectory:
    """Straight on from the ego at 10 m/s, but for what is given."""
    time_s = np.linspace(3.5, 11.5, 81) if time_s is None else time_s
    x_m = 100.0 + 10.0 * (time_s - 3.5) if x_m is None else x_m
    return Trajectory(time_s, x_m, np.full_like(time_s, 50.0), np.full_like(time_s, heading))


def refused(bad: object) -> str:
    with pytest.raises(PlannerError) as caught:
        check_plan(bad, EGO, EGO.time_s)
    return str(caught.value)


def forged(name: str, values: Floats) -> Trajectory:
    """A Trajectory that got round its own checks."""
    good = plan()
    object.__setattr__(good, name, values)
    return good


def test_a_plan_from_the_ego_onwards_is_fine() -> None:
    check_plan(plan(), EGO, EGO.time_s)


def test_what_is_no_trajectory_is_named_by_its_type() -> None:
    assert refused(np.zeros((80, 3))).startswith("the plan is of type ndarray; return a Trajectory(")
    assert refused(None).startswith("the plan is of type NoneType (did plan() forget to return it?);")


@pytest.mark.parametrize("late_s", [0.0009, -5.0])
def test_a_plan_may_begin_up_to_a_millisecond_late_or_any_time_before(late_s: float) -> None:
    check_plan(plan(time_s=np.linspace(3.5 + late_s, 12.0, 81)), EGO, EGO.time_s)


def test_a_plan_that_begins_after_now_is_refused_with_the_numbers() -> None:
    assert "begins 0.001 s after now" in refused(plan(time_s=np.linspace(3.5011, 11.6, 81)))
    message = refused(plan(time_s=np.linspace(3.6, 11.6, 81)))
    assert message.startswith("the plan begins 0.100 s after now (time_s[0] = 3.600, now = 3.500);")


def test_a_plan_must_reach_the_next_step() -> None:
    check_plan(plan(time_s=np.array([3.5, 3.6])), EGO, EGO.time_s)
    assert "the plan ends only 0.099 s after now" in refused(plan(time_s=np.array([3.5, 3.599])))


def test_a_plan_in_times_relative_to_now_is_told_that_times_are_absolute() -> None:
    message = refused(plan(time_s=np.linspace(0.0, 3.0, 31)))
    assert message.startswith("the plan ends 0.500 s before now")
    assert message.endswith("are its times absolute, as observation.time_s is?")


def test_so_is_one_that_has_not_ended_yet_and_begins_where_the_ego_is() -> None:
    relative = plan(time_s=np.linspace(0.0, 8.0, 81), x_m=100.0 + 10.0 * np.linspace(0.0, 8.0, 81))
    assert "35.00 m away from the ego at now" in refused(relative)
    assert refused(relative).endswith(
        "its first pose is where the ego is, at time_s[0] = 0.000, and now is 3.500: are its times absolute, as "
        "observation.time_s is?"
    )
    assert refused(plan(x_m=90.0 + np.linspace(0.0, 8.0, 81))).endswith("plan the box centre, in the map frame")


def test_a_plan_in_microseconds_is_asked_for_seconds() -> None:
    check_plan(plan(time_s=np.linspace(3.5, 123.5, 1201)), EGO, EGO.time_s)
    assert "are its times in seconds?" in refused(plan(time_s=np.array([3.5, 124.0])))
    assert "are its times in seconds?" in refused(plan(time_s=np.array([3.5, 3.5e6])))


@pytest.mark.parametrize(("offset_m", "fine"), [(2.4, True), (-2.4, True), (2.6, False), (-2.6, False)])
def test_the_pose_at_now_must_be_near_the_ego(offset_m: float, fine: bool) -> None:
    moved = plan(x_m=100.0 + offset_m + 10.0 * np.linspace(0.0, 8.0, 81))
    if fine:
        check_plan(moved, EGO, EGO.time_s)
    else:
        assert f"the plan is 2.60 m away from the ego at now, at ({100.0 + offset_m:.2f}, 50.00)" in refused(moved)


@pytest.mark.parametrize(("speed", "fine"), [(60.0, True), (-60.0, True), (60.1, False)])
def test_the_plan_must_not_race(speed: float, fine: bool) -> None:
    racing = plan(x_m=100.0 + speed * np.linspace(0.0, 8.0, 81))
    if fine:
        check_plan(racing, EGO, EGO.time_s)
    else:
        assert "that is 60.1 m/s (at most 60)" in refused(racing)


def test_a_jump_is_told_with_place_and_size() -> None:
    x_m = 100.0 + 10.0 * np.linspace(0.0, 8.0, 81)
    x_m[41:] += 30.0
    assert refused(plan(x_m=x_m)) == "the plan jumps 31.00 m from 7.50 to 7.60 s, that is 310 m/s (at most 60)"


@pytest.mark.parametrize("towards_rad", np.linspace(0.0, 2.0 * np.pi, 9))
@pytest.mark.parametrize("step_s", [0.1, 0.07])
def test_a_race_is_one_into_whatever_direction_and_at_whatever_pace_the_plan_is_told(
    towards_rad: float, step_s: float
) -> None:
    time_s = 3.5 + step_s * np.arange(60, dtype=np.float64)
    for speed, fine in ((59.9, True), (60.1, False)):
        gone = speed * (time_s - 3.5)
        x_m, y_m = 100.0 + gone * np.cos(towards_rad), 50.0 + gone * np.sin(towards_rad)
        racing = Trajectory(time_s, x_m, y_m, np.full_like(time_s, towards_rad))
        if fine:
            check_plan(racing, EGO, EGO.time_s)
        else:
            assert "that is 60.1 m/s (at most 60)" in refused(racing)


@pytest.mark.parametrize(("off_m", "fine"), [(5.9, True), (6.1, False), (1e100, False), (-1e300, False)])
def test_a_spike_between_samples_is_a_jump(off_m: float, fine: bool) -> None:
    time_s = 3.5 + 0.05 * np.arange(81, dtype=np.float64)
    x_m = 100.0 + 10.0 * (time_s - 3.5)
    x_m[3:40:2] += off_m
    if fine:
        check_plan(plan(time_s=time_s, x_m=x_m), EGO, EGO.time_s)
    else:
        assert re.match(
            r"the plan jumps \S+ m at 3\.65\d s, off the poses around it", refused(plan(time_s=time_s, x_m=x_m))
        )


def test_noise_between_close_samples_is_no_jump() -> None:
    time_s = np.sort(np.concatenate((np.linspace(3.5, 11.5, 81), np.linspace(3.55, 11.45, 80) + 1e-5)))
    noise = 0.01 * np.random.default_rng(1).normal(size=len(time_s))
    check_plan(plan(time_s=time_s, x_m=100.0 + 10.0 * (time_s - 3.5) + noise), EGO, EGO.time_s)


@pytest.mark.parametrize(("heading", "fine"), [(999.0, True), (-1001.0, False), (1e300, False)])
def test_headings_need_not_be_wrapped_but_must_be_angles(heading: float, fine: bool) -> None:
    if fine:
        check_plan(plan(heading=heading), EGO, EGO.time_s)
    else:
        assert re.match(r"the plan's heading_rad\[0\] = -?1\S+ is no angle in radians", refused(plan(heading=heading)))


@pytest.mark.parametrize("name", ["time_s", "x_m", "y_m", "heading_rad"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite_are_found_whoever_made_them(name: str, bad: float) -> None:
    values = getattr(plan(), name).copy()
    values[7] = bad
    assert refused(forged(name, values)) == f"the plan holds a number that is not finite: {name}[7] = {bad}"


def test_times_that_stand_still_are_found_whoever_made_them() -> None:
    time_s = np.linspace(3.5, 11.5, 81)
    time_s[3] = time_s[2]
    assert "times do not increase: time_s[2] = 3.700000, time_s[3] = 3.700000" in refused(forged("time_s", time_s))


@pytest.mark.parametrize("size", [1e155, 1.7e308])
def test_absurd_numbers_are_refused_without_a_warning(size: float) -> None:
    far = np.concatenate(([100.0, 101.0], np.full(79, size)))
    assert "the plan jumps" in refused(plan(x_m=far))
    assert "the plan jumps" in refused(plan(x_m=200.0 - far))
    flip = np.full(81, size)
    flip[::2] *= -1.0
    assert "away from the ego" in refused(plan(x_m=flip))


@pytest.mark.parametrize("shape", ["two poses", "long", "from the past"])
def test_what_passes_can_be_followed(shape: str) -> None:
    good = {
        "two poses": straight_plan(EGO, 0.1, 0.1),
        "long": straight_plan(EGO, 120.0, 10.0),
        "from the past": plan(time_s=np.linspace(3.0, 3.6, 7)),
    }[shape]
    check_plan(good, EGO, EGO.time_s)
    assert np.isfinite(follow(EGO, good, 0.1).x_m)
