"""Which tables of states a car can have driven."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_sumo.dynamics import bicycle
from interplan_sumo.verification.privileged_rollout import rounded
from interplan_sumo.verification.reachability import unreachable
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.trace import EgoTrack

START = EgoState(0.0, 365_548.35, 143_575.14, 0.7, vx_mps=8.0)


def driven(commands: list[tuple[float, float]]) -> EgoTrack:
    states = [START]
    for push, steering in commands:
        states.append(rounded(bicycle.step(states[-1], push, steering, 0.1)))
    return EgoTrack.of(states)


def tampered(track: EgoTrack, row: int, **changes: float) -> EgoTrack:
    columns = {name: getattr(track, name).copy() for name in changes}
    for name, value in changes.items():
        columns[name][row] += value
    return replace(track, **columns)


@settings(max_examples=20)
@given(st.lists(st.tuples(st.floats(-8.0, 4.0), st.floats(-1.0, 1.0)), min_size=1, max_size=30))
def test_whatever_the_bicycle_does_under_possible_commands_is_reachable(commands: list[tuple[float, float]]) -> None:
    assert unreachable(START, driven(commands), 30.0) == []


STRAIGHT = driven([(0.5, 0.0)] * 20)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"x_m": 0.01}, "0.010 m apart"),
        ({"heading_rad": 0.01}, "heading_rad"),
        ({"vx_mps": 0.5}, "vx_mps"),
        ({"ax_mps2": 0.3}, "vx_mps"),
        ({"tire_angle_rad": 0.05}, "tire_angle_rad"),
        ({"yaw_rate_radps": 0.1}, "yaw_rate_radps"),
    ],
)
def test_a_state_that_was_changed_does_not_follow(change: dict[str, float], said: str) -> None:
    (problem,) = unreachable(START, tampered(STRAIGHT, 10, **change), 30.0)
    assert "1.0 s" in problem
    assert said in problem


def test_what_is_no_drive_of_this_scenario_is_refused() -> None:
    keep = np.arange(len(STRAIGHT)) != 10
    gap = replace(STRAIGHT, **{name: getattr(STRAIGHT, name)[keep] for name in STRAIGHT.__dataclass_fields__})
    assert "does not follow" in unreachable(START, gap, 30.0)[0]
    assert "begin" in unreachable(replace(START, vx_mps=9.0), STRAIGHT, 30.0)[0]
    assert "not finite" in unreachable(START, tampered(STRAIGHT, 5, x_m=float("nan")), 30.0)[0]
    assert "expected 1 to 301" in unreachable(START, driven([(0.0, 0.0)] * 301), 30.0)[0]


@pytest.mark.parametrize(
    ("push", "steering", "reachable"),
    [
        (-8.9, 0.0, True),
        (-9.1, 0.0, False),
        (4.9, 0.0, True),
        (5.1, 0.0, False),
        (0.0, 1.45, True),
        (0.0, 1.55, False),
    ],
)
def test_commands_beyond_what_a_car_can_do_are_refused(push: float, steering: float, reachable: bool) -> None:
    assert (unreachable(START, driven([(push, steering)]), 30.0) == []) == reachable
