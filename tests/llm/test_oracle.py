"""The oracle: it finds the better choice, keeps what is as good, and never falls behind the policy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from math import inf, nextafter
from typing import Any

import numpy as np
import pytest

from interplan_sumo.maps.store import load_roads
from interplan_sumo.planner import Mission, Observation, Planner
from interplan_sumo.scenario.scenario import LanePosition, Scenario
from interplan_sumo.simulation.episode import drive
from interplan_sumo.world.trace import EgoTrack
from interplan_sumo.world.trajectory import Trajectory
from tools.oracle import ENOUGH, Effort, OracleChooser, OracleDrive, Value, oracle_drive

SPEEDS_MPS = {"go": 8.0, "also_go": 8.0, "creep": 2.0}
SECONDS = 3


@dataclass(frozen=True)
class Instant:
    time_s: float


class Always:
    """One option whenever it is offered, else the first."""

    def __init__(self, option: str) -> None:
        self.option = option

    def start(self, mission: Mission) -> None: ...

    def choose(self, scene: Instant, options: tuple[str, ...], now: str | None) -> tuple[str, float]:  # noqa: ARG002
        return (self.option if self.option in options else options[0]), 0.0


class Cruise:
    """Straight on at the speed that is chosen each second; to choose "fail" is a fault."""

    def __init__(
        self, chooser: OracleChooser, recorded: Sequence[Trajectory], offered: Callable[[float], tuple[str, ...]]
    ):
        self.chooser = chooser
        self.recorded = len(recorded)
        self.offered = offered
        self.choices: list[str] = []

    def start(self, mission: Mission) -> None:
        self.chooser.start(mission)

    def plan(self, observation: Observation) -> Trajectory:
        if round(observation.time_s * 10) % 10 == 0:
            now = self.choices[-1] if self.choices else None
            choice, _ = self.chooser.choose(Instant(observation.time_s), self.offered(observation.time_s), now)
            if choice == "fail":
                raise RuntimeError("told to")
            self.choices.append(choice)
        ahead_s, pose = np.array([0.0, 4.0]), observation.ego
        ahead_m = SPEEDS_MPS[self.choices[-1]] * ahead_s
        x_m, y_m = pose.x_m + ahead_m * np.cos(pose.heading_rad), pose.y_m + ahead_m * np.sin(pose.heading_rad)
        return Trajectory(observation.time_s + ahead_s, x_m, y_m, np.full(2, pose.heading_rad))


class Workshop:
    """Makes such planners, and keeps them."""

    def __init__(self, *options: str) -> None:
        self.offered: Callable[[float], tuple[str, ...]] = lambda _: options
        self.made: list[Cruise] = []

    def __call__(self, chooser: OracleChooser, recorded: Sequence[Trajectory]) -> Planner:
        self.made.append(Cruise(chooser, recorded, self.offered))
        return self.made[-1]


@cache
def empty_road() -> Scenario:
    """A straight lane of a shipped map, nobody on it."""
    roads = load_roads("strip")
    lane = next(
        lane
        for lane in roads.lanes.values()
        if lane.centerline.length_m > 120.0 and np.ptp(lane.centerline.vertex_heading_rad) < 0.01
    )
    return Scenario(
        id="oracle/0", family="lane_change_ltd", map="strip", start=LanePosition(lane.id, 10.0), start_speed_mps=8.0,
        goal=LanePosition(lane.id, 110.0), route=(lane.roadblock_id,), duration_s=float(SECONDS),
    )  # fmt: skip


@cache
def swift() -> EgoTrack:
    trace = drive(empty_road(), Workshop("go")(Always("go"), ())).trace
    assert trace is not None
    return trace.ego


def searched(make: Workshop, policy: str, effort: Effort = Effort()) -> OracleDrive:  # noqa: B008
    return oracle_drive(empty_road(), swift(), make, Always(policy), effort=effort)


def test_it_finds_the_better_option_where_the_policy_takes_the_worse() -> None:
    make = Workshop("creep", "go")
    alone = searched(make, "creep", Effort(most_drives=1))
    found = searched(make, "creep")
    assert alone.tried == ()
    assert found.value.beats(alone.value)
    assert found.tried[0].held == "creep"
    assert found.tried[0].best == "go"
    best, worse = found.tried[0].values[1], found.tried[0].values[0]
    assert best.beats(worse)
    assert worse == alone.value


def test_of_options_that_are_as_good_the_one_that_was_held_stays() -> None:
    found = searched(Workshop("also_go", "go"), "go", Effort(enough=inf))
    assert {each.values[0] for each in found.tried} == {found.value}
    assert [each.best for each in found.tried] == ["go"] * SECONDS


@pytest.mark.parametrize(
    ("enough", "drives"), [(None, 1), ("as much", 1), ("more", 1 + SECONDS)], ids=["full marks", "as much", "more"]
)
def test_it_ends_as_soon_as_a_drive_is_good_enough(enough: str | None, drives: int) -> None:
    make = Workshop("creep", "go")
    score = searched(make, "go").value.score
    assert score >= ENOUGH
    wanted = {None: ENOUGH, "as much": score, "more": nextafter(score, inf)}[enough]
    assert searched(make, "go", Effort(enough=wanted)).drives == drives


def test_an_option_with_which_the_planner_fails_is_never_taken() -> None:
    found = searched(Workshop("fail", "creep"), "creep", Effort(enough=inf))
    assert all(each.values[0].failed for each in found.tried)
    assert all(each.best == "creep" for each in found.tried)
    assert found.episode.fault is None


def test_where_the_policy_fails_it_is_changed_until_the_drive_comes_to_its_end() -> None:
    found = searched(Workshop("fail", "go"), "fail")
    assert [each.best for each in found.tried] == ["go"] * SECONDS
    assert [each.values[0].failed for each in found.tried] == [True] * SECONDS
    assert [each.values[1].failed for each in found.tried] == [True] * (SECONDS - 1) + [False]
    assert found.value.score >= ENOUGH


def test_every_other_decision_is_looked_at_and_none_before_a_time() -> None:
    make = Workshop("creep", "go")
    times = lambda effort: [each.scene.time_s for each in searched(make, "go", effort).tried]  # noqa: E731
    assert times(Effort(every=2, enough=inf)) == pytest.approx([0.0, 2.0])
    assert times(Effort(after_s=1.0, enough=inf)) == pytest.approx([1.0, 2.0])
    assert times(Effort(after_s=1.01, enough=inf)) == pytest.approx([2.0])
    assert times(Effort(after_s=60.0, enough=inf)) == []


def test_a_decision_that_is_not_worth_it_is_left_as_it_is() -> None:
    effort = Effort(worth=lambda instant, options, before: instant.time_s >= 1.0 and len(options) == 2 + len(before))
    found = searched(Workshop("creep", "go"), "creep", effort)
    assert [each.scene.time_s for each in found.tried] == pytest.approx([1.0])
    assert [each.taken for each in found.choices] == ["creep", "go", "creep"]


def test_after_enough_drives_no_further_decision_is_begun() -> None:
    make = Workshop("creep", "go", "also_go")
    assert searched(make, "go", Effort(enough=inf, most_drives=3)).drives == 3
    assert searched(make, "go", Effort(enough=inf, most_drives=4)).drives == 5


def test_an_option_is_held_for_as_long_as_it_is_offered_and_then_the_policy_chooses() -> None:
    make = Workshop("creep", "go")
    searched(make, "go", Effort(enough=inf, hold=2, most_drives=2))
    assert make.made[1].choices == ["creep", "creep", "go"]
    make = Workshop("creep", "go")
    make.offered = lambda time_s: ("go",) if time_s > 0.5 else ("creep", "go")
    searched(make, "go", Effort(enough=inf, hold=2, most_drives=2))
    assert make.made[1].choices == ["creep", "go", "go"]


@pytest.mark.nightly
def test_the_plans_until_a_decision_are_handed_on() -> None:
    make = Workshop("creep", "go")
    searched(make, "go", Effort(enough=inf))
    assert [each.recorded for each in make.made] == [0, 0, 10, 20]


@pytest.mark.parametrize("name", ["every", "hold", "most_drives"])
def test_an_effort_of_nothing_is_refused(name: str) -> None:
    one: dict[str, Any] = {name: 1}
    replace(Effort(), **one)
    with pytest.raises(ValueError, match=f"{name} is 0, expected 1 or more"):
        replace(Effort(), **one | {name: 0})


def test_scores_come_first_then_gates_then_progress() -> None:
    value = Value(0.5, 3, 0.5)
    assert value.beats(Value(0.4, 5, 1.0))
    assert value.beats(Value(0.5, 2, 1.0))
    assert value.beats(Value(0.5, 3, 0.4))
    assert not value.beats(value)
    assert Value(0.0, 0, 0.0).beats(Value(-1.0, 0, 1.0))  # no fault is the best, a later one the better
    assert Value(-1.0, 0, 0.5).beats(Value(-1.0, 0, 0.25))
    assert not value.beats(Value(0.5 - 1e-7, 3, 0.5))  # as good as equal
