from __future__ import annotations

import json
import re
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import count
from typing import Any

import numpy as np
import pytest

import interplan_sumo.testing as suite
from interplan_planners.idm import IdmPlanner
from interplan_planners.straight_ahead import StraightAhead
from interplan_sumo.errors import told
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.testing import ConformanceFinding, assert_planner_conforms, check_planner
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.trajectory import Trajectory
from tests.quick import few

STEPS = 4


class Altered(StraightAhead):
    """StraightAhead whose every plan passes through a function."""

    def __init__(self, alter: Callable[[Trajectory, Observation], Any], horizon_s: float = 8.0) -> None:
        super().__init__(horizon_s)
        self.alter = alter

    def plan(self, observation: Observation) -> Trajectory:
        return self.alter(super().plan(observation), observation)


def found(alter: Callable[[Trajectory, Observation], Any], horizon_s: float = 8.0) -> ConformanceFinding:
    """The worst finding."""
    return check_planner(Altered(alter, horizon_s), steps=STEPS)[0]


def nothing(plan: Trajectory, _seen: Observation) -> Trajectory:
    return plan


# --- planners that conform -----------------------------------------------------------------------


@pytest.mark.parametrize("planner", few(["straight_ahead", IdmPlanner(), "idm", "idm?radius_m=60&headway_s=1.0"], 2))
def test_the_reference_planners_conform(planner: Any) -> None:
    assert_planner_conforms(planner)


def test_a_good_planner_gets_its_time_and_nothing_else() -> None:
    assert [(f.severity, f.rule) for f in check_planner(IdmPlanner())] == [("note", "time")]


def test_a_blind_planner_conforms_but_is_told_what_it_hits() -> None:
    notes = {f.worlds: f.message for f in check_planner(StraightAhead()) if f.rule == "drives"}
    assert notes[("standing car ahead",)].startswith("hits car00 at t = 2.9 s with 6.0 m/s")
    assert notes[("red light",)].startswith("passes a red light at t = 3.")


def test_findings_read_as_lines() -> None:
    finding = ConformanceFinding("error", "plan", "the plan ends.", ("bend", "empty road"))
    assert str(finding) == "error: plan: the plan ends. [bend, empty road]"


# --- one alteration, one finding -----------------------------------------------------------------

RNG = np.random.default_rng()


def writing(plan: Trajectory, seen: Observation) -> Trajectory:
    seen.actors.x_m[:] = 0.0
    return plan


def assigning(plan: Trajectory, seen: Observation) -> Trajectory:
    seen.ego.x_m = 0.0  # type: ignore[misc]
    return plan


def forcing(plan: Trajectory, seen: Observation) -> Trajectory:
    seen.actors.x_m.setflags(write=True)
    return writing(plan, seen)


def of_the_rear_axle(plan: Trajectory, _seen: Observation) -> Trajectory:
    dx, dy = 1.461 * np.cos(plan.heading_rad), 1.461 * np.sin(plan.heading_rad)
    return replace(plan, x_m=plan.x_m - dx, y_m=plan.y_m - dy)


@pytest.mark.parametrize(
    ("alter", "said"),
    [
        (lambda _p, _s: sys.exit(3), r"error: raises: plan\(\) called sys.exit\(3\) \(test_check_planner.py:"),
        (lambda p, seen: None if seen.time_s > 0.25 else p, "error: .*at t = 0.3 s the plan is of type NoneType"),
        (lambda p, _: replace(p, x_m=p.x_m + np.where(np.arange(len(p)) > 40, 50.0, 0.0)), "error: .*the plan jumps"),
        (lambda p, _: replace(p, y_m=p.y_m + RNG.uniform(-0.1, 0.1)), "error: repeatable: "),
        (writing, "ValueError: assignment destination is read-only .*must not be changed, work on a copy "),
        (assigning, "error: raises: .*must not be changed, use dataclasses.replace "),
        (forcing, r"plan\(\) changed its observation at t = 0.0 s; work on a copy "),
        (lambda p, _: replace(p, heading_rad=np.degrees(p.heading_rad) + 90.0), "warning: heading: .*are radians"),
        (of_the_rear_axle, "warning: reference: plans begin 1.46 m behind the ego's centre"),
    ],
)
def test_what_is_wrong_with_the_plans_is_told(alter: Callable[[Trajectory, Observation], Any], said: str) -> None:
    assert re.search(said, str(found(alter)))


# --- what is no planner --------------------------------------------------------------------------


def test_an_unknown_name_is_one_finding() -> None:
    (finding,) = check_planner("idn")
    assert (finding.severity, finding.rule) == ("error", "loads")
    assert "Did you mean 'idm'?" in finding.message


def test_missing_methods_are_named() -> None:
    class Half:
        def plan(self, observation: Observation) -> None: ...

    (finding,) = check_planner(Half())  # type: ignore[arg-type]
    assert finding.message == "Half has no method start; a planner needs start(mission) and plan(observation)"


def test_a_class_is_no_planner() -> None:
    (finding,) = check_planner(StraightAhead)  # type: ignore[arg-type]
    assert "StraightAhead is a class; give an instance" in finding.message


# --- planners that raise, exit or hang -----------------------------------------------------------


def test_an_exception_is_told_with_the_line_of_the_planner() -> None:
    def stumble(_plan: Trajectory, _seen: Observation) -> Trajectory:
        return json.loads("{")

    finding = found(stumble)
    assert finding.rule == "raises"
    assert finding.message.startswith("plan() raised JSONDecodeError: Expecting property name")
    line = stumble.__code__.co_firstlineno + 1
    assert finding.message.endswith(f'(test_check_planner.py:{line}, in stumble: return json.loads("{{"))')
    assert len(finding.worlds) == 10


def test_lines_that_nobody_wrote_are_not_told() -> None:
    with pytest.raises(ValueError, match="not finite") as raised:  # in the constructor that dataclasses make
        Trajectory(np.arange(2.0), np.full(2, np.nan), np.zeros(2), np.zeros(2))
    assert re.fullmatch(r"ValueError: [^<]* \(test_check_planner\.py:\d+ in \w+\)", told(raised.value))


def test_an_exception_in_start_is_told() -> None:
    class Broken(StraightAhead):
        def start(self, mission: Mission) -> None:
            raise RuntimeError(f"no weights for {mission.roads.name}")

    assert (
        "start() raised RuntimeError: no weights for tiny_road (test_check_planner.py:"
        in check_planner(Broken())[0].message
    )


@pytest.mark.skipif(not hasattr(suite.signal, "setitimer"), reason="no alarms on this platform")
def test_a_planner_that_hangs_is_cut_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(suite, "CALL_LIMIT_S", 0.05)

    def hang(plan: Trajectory, _seen: Observation) -> Trajectory:
        time.sleep(5.0)
        return plan

    began = time.monotonic()
    finding = found(hang)
    assert (finding.severity, finding.rule) == ("error", "time")
    assert finding.message == "plan() did not return within 0.05 s"
    assert len(finding.worlds) == 1  # one that hangs would hang again
    assert time.monotonic() - began < 3.0


def test_a_slow_planner_is_warned(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(suite, "SLOW_PLAN_S", 0.001)

    def dawdle(plan: Trajectory, _seen: Observation) -> Trajectory:
        time.sleep(0.002)
        return plan

    finding = found(dawdle)
    assert (finding.severity, finding.rule) == ("warning", "time")


# --- plans that cannot be followed ---------------------------------------------------------------


def test_a_plan_that_begins_late_is_refused_in_every_world_but_said_once() -> None:
    findings = check_planner(Altered(lambda p, _: replace(p, time_s=p.time_s + 0.4)), steps=STEPS)
    (error,) = [finding for finding in findings if finding.severity == "error"]
    assert error.message.startswith("at t = 0.0 s the plan begins 0.400 s after now")
    assert len(error.worlds) == 10


# --- planners that remember, gamble or meddle ----------------------------------------------------


def test_state_left_over_from_the_last_episode_is_found() -> None:
    calls = count()

    def drift(plan: Trajectory, _seen: Observation) -> Trajectory:
        return replace(plan, x_m=plan.x_m + 1e-9 * next(calls))

    finding = found(drift)
    assert (finding.severity, finding.rule) == ("error", "repeatable")
    assert "give different plans from t = 0.0 s on (up to " in finding.message
    assert finding.worlds == ("bend", "dense traffic")


def test_chance_with_a_seed_per_episode_is_fine() -> None:
    class Dice(StraightAhead):
        def start(self, mission: Mission) -> None:
            super().start(mission)
            self.rng = np.random.default_rng(0)

        def plan(self, observation: Observation) -> Trajectory:
            plan = super().plan(observation)
            return replace(plan, y_m=plan.y_m + self.rng.uniform(-0.1, 0.1))

    assert_planner_conforms(Dice(), steps=STEPS)


def test_changing_the_map_is_found() -> None:
    class Digger(StraightAhead):
        def start(self, mission: Mission) -> None:
            super().start(mission)
            points: Floats = next(iter(mission.roads.lanes.values())).centerline.points
            points.setflags(write=True)
            points[0] += 1.0

    assert (
        check_planner(Digger(), steps=STEPS)[0].message == "the planner changed the map of its mission; work on a copy"
    )


# --- likely mistakes -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("horizon_s", "severity"), [(8.0, None), (7.5, "note"), (1.0, "note"), (0.9, "warning"), (0.1, "warning")]
)
def test_short_plans_are_advised_to_reach_eight_seconds(horizon_s: float, severity: str | None) -> None:
    findings = {f.rule: f for f in check_planner(Altered(nothing, horizon_s), steps=STEPS)}
    assert (findings["horizon"].severity if "horizon" in findings else None) == severity
    assert all(f.severity != "error" for f in findings.values())


# --- the assertion -------------------------------------------------------------------------------


def test_the_assertion_lists_the_errors_only() -> None:
    with pytest.raises(
        AssertionError, match=r"(?s)the planner does not conform:\n  error: raises: plan\(\) raised"
    ) as e:
        assert_planner_conforms(Altered(lambda _p, _s: 1 / 0), steps=STEPS)
    assert "note" not in str(e.value)
