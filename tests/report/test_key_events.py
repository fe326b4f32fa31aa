"""When a drive lost its points, and which moment decided it."""

from __future__ import annotations

import numpy as np
import pytest

from interplan_sumo.errors import UnknownNameError
from interplan_sumo.report.key_events import FAULT, NOTHING, KeyEvent, deciding_moment, key_events
from tests.metrics.staging import drive_at
from tests.report.tiny_drives import CRUISE_MPS, START_M, parked_at, tiny_drive
from tests.worlds import cars, straight_road

CRUISE = [CRUISE_MPS] * 80


def names(found: tuple[KeyEvent, ...]) -> list[str]:
    return [event.metric for event in found]


def test_a_drive_that_lost_nothing_is_decided_at_its_end() -> None:
    drive = tiny_drive(CRUISE)
    assert key_events(drive) == ()
    assert deciding_moment(drive) == KeyEvent(7.9, 79, NOTHING, "no points were lost")


def test_a_collision_is_decided_when_the_boxes_meet() -> None:
    # the ego's front is 2.588 m ahead of its centre, the car's rear at 47.6 m: 45 m are too little, 46 enough
    found = deciding_moment(tiny_drive(CRUISE, actors=cars((50.0, 0.0))))
    assert (found.metric, found.frame, found.time_s) == ("no_collision", 36, 3.6)
    assert "at 3.6 s" in found.reason


def test_moments_come_in_time_order_and_a_gate_decides_before_a_weight_of_the_same_frame() -> None:
    fast_at_first = [20.0] * 5 + CRUISE
    drive = tiny_drive(fast_at_first, actors=cars((50.0, 0.0)))
    found = key_events(drive)
    assert [event.frame for event in found] == sorted(moment.frame for moment in found)
    assert names(found)[0] == "speed_limit"
    assert deciding_moment(drive).metric == "no_collision"


def test_the_gate_that_was_lost_first_decides() -> None:
    leaving = np.where(np.arange(80) < 20, 0.0, -4.0)
    drive = tiny_drive(
        [], trace=drive_at(START_M + np.arange(80.0), leaving, actors=cars((50.0, -4.0))), expert_mps=CRUISE
    )
    found = deciding_moment(drive)
    assert (found.metric, found.frame) == ("drivable_area", 20)
    assert {"drivable_area", "no_collision"} <= set(names(key_events(drive)))


def test_of_weighted_metrics_the_one_that_cost_most_decides() -> None:
    drive = tiny_drive([20.0] * 30, expert_mps=[25.0] * 30)  # speed_limit costs 4 of 4, progress 1 of 5
    assert set(names(key_events(drive))) == {"speed_limit", "progress"}
    assert deciding_moment(drive).metric == "speed_limit"


def test_an_obstacle_is_not_passed_from_the_beginning_of_the_longest_wait_on() -> None:
    stops = [CRUISE_MPS] * 30 + [0.0] * 12 + [2.0] * 10 + [0.0] * 30
    found = deciding_moment(tiny_drive(stops, actors=cars((100.0, 0.0)), obstacles=(parked_at(100.0),)))
    assert (found.metric, found.frame) == ("obstacle_passed", 52)


@pytest.mark.parametrize(("speed_mps", "frame"), [(0.49, 30), (0.51, 60)])
def test_who_creeps_waits_and_who_is_faster_advances_to_the_last(speed_mps: float, frame: int) -> None:
    drive = tiny_drive([CRUISE_MPS] * 30 + [speed_mps] * 32, obstacles=(parked_at(100.0),))
    assert deciding_moment(drive).frame == frame


@pytest.mark.parametrize(("frames", "waits"), [(9, False), (10, True)])
def test_a_wait_lasts_a_second(frames: int, waits: bool) -> None:
    drive = tiny_drive([CRUISE_MPS] * 10 + [0.0] * frames + [CRUISE_MPS] * 10, obstacles=(parked_at(100.0),))
    assert (deciding_moment(drive).frame == 10) is waits


@pytest.mark.parametrize(("expert_m", "told"), [(100.04, False), (100.06, True)])
def test_a_loss_that_no_table_shows_has_no_moment(expert_m: float, told: bool) -> None:
    drive = tiny_drive([CRUISE_MPS] * 101, expert_mps=[expert_m / 10.0] * 101)
    assert ("progress" in names(key_events(drive))) is told


def test_a_fault_decides_whatever_was_lost_before_and_is_the_last_frame() -> None:
    drive = tiny_drive(CRUISE, actors=cars((50.0, 0.0)), fault=("planner", "ValueError: no way"))
    assert deciding_moment(drive) == KeyEvent(7.9, 79, FAULT, "planner fault: ValueError: no way")
    assert "no_collision" in names(key_events(drive))


def test_the_time_that_a_reason_names_is_that_of_its_moment() -> None:
    braking = [CRUISE_MPS] * 40 + list(np.linspace(CRUISE_MPS, 0.0, 10)) + [0.0] * 30
    drive = tiny_drive(braking, actors=cars((60.0, 0.0)))
    found = [event for event in key_events(drive) if " at " in event.reason]
    assert {"comfort", "time_to_collision"} <= set(names(tuple(found)))
    assert all(f"at {event.time_s:.1f} s" in event.reason for event in found)


def test_driving_against_the_traffic_is_decided_where_it_was_worst() -> None:
    back = np.concatenate((np.arange(50.0), 49.0 - np.arange(1.0, 20.0), np.full(20, 30.0)))
    found = deciding_moment(tiny_drive([], trace=drive_at(START_M + back), expert_mps=CRUISE))
    assert found.metric == "driving_direction"
    assert f"before {found.time_s:.1f} s" in found.reason


def test_what_only_the_end_decides_has_its_moment_there() -> None:
    roads = straight_road(lanes=2, length_m=300.0)
    beside = drive_at(START_M + np.arange(80.0), -3.5)
    found = deciding_moment(tiny_drive([], trace=beside, roads=roads, expert_mps=CRUISE))
    assert (found.metric, found.frame) == ("lane_changes", 79)


def test_an_unknown_profile_is_refused() -> None:
    with pytest.raises(UnknownNameError, match="interplan"):
        key_events(tiny_drive(CRUISE), "interplan-papre")
