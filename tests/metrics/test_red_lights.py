"""Red lights: what counts is the light when the front bumper comes to the start of the connector driven."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from interplan_sumo.metrics.diagnostics import diagnostics, red_light_runs
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.signals import Signals
from tests.metrics.staging import drive_at, facts_of
from tests.worlds import junction, signals

ROAD = junction()
START_M = -12.0
X_M = np.arange(-40.0, 30.0)
ARRIVES = int(np.argmax(X_M + PACIFICA.length_m / 2 >= START_M))
"""The first frame with the front bumper past the start."""


def through(lights: list[Signals], x_m: np.ndarray = X_M):
    """A drive from west to east at 10 m/s."""
    trace = replace(drive_at(x_m, -1.75), signals=tuple(lights))
    return red_light_runs(facts_of(trace, ROAD))


def shows(until: int, first: Signals, then: Signals, frames: int = len(X_M)) -> list[Signals]:
    return [first if frame < until else then for frame in range(frames)]


RED, GREEN, YELLOW = signals(red=("13",)), signals(green=("13",)), signals(yellow=("13",))


def test_a_light_that_is_red_on_arrival_is_run():
    (found,) = through(shows(ARRIVES + 1, RED, GREEN))
    assert (found["connector"], found["speed_mps"]) == ("13", 10.0)
    assert found["time_s"] == pytest.approx(0.1 * ARRIVES)
    assert through(shows(ARRIVES, RED, GREEN)) == []


@pytest.mark.parametrize("before", [GREEN, YELLOW])
def test_a_light_that_turns_red_a_step_later_is_not(before: Signals):
    assert through(shows(ARRIVES + 1, before, RED)) == []
    assert len(through(shows(ARRIVES, before, RED))) == 1


def test_another_connectors_light_does_not_matter():
    assert through(shows(0, RED, signals(green=("13",), red=("12", "14")))) == []


def test_whoever_begins_beyond_the_start_or_stops_there_has_run_no_light():
    inside = X_M[ARRIVES:]
    assert through([RED] * len(inside), inside) == []
    short = X_M[: ARRIVES + 1]
    assert through([RED] * len(short), short) == []


def test_where_it_is_not_told_which_connector_is_driven_all_must_be_red():
    entering = X_M[X_M < START_M + 1.5]
    some = signals(red=("13",), green=("12", "14"))
    assert through([some] * len(entering), entering) == []
    assert len(through([signals(red=("12", "13", "14"))] * len(entering), entering)) == 1


def test_whoever_backs_out_again_has_run_the_light():
    x_m = np.append(X_M[X_M < START_M + 1.5], X_M[0])
    assert len(through([signals(red=("12", "13", "14"))] * len(x_m), x_m)) == 1


def test_a_trace_without_lights_runs_none():
    assert through([Signals.none()] * len(X_M)) == []
    assert diagnostics(facts_of(drive_at(X_M, -1.75), ROAD)).detail["red_lights_run"] == []
