"""What the privileged driver drives: near its speed profile, in comfort, and rounded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from problems import FRAMES, laid_out, start_of, steady
from stages import ONE_LANE, TWO_LANES, car, staged, widened
from worlds import straight_road

from interplan_sumo.metrics.comfort import BOUNDS
from interplan_sumo.metrics.comfort_signals import comfort_signals
from interplan_sumo.scenario.scenario import LanePosition
from interplan_sumo.simulation.setup import start_state
from interplan_sumo.verification.drivable_paths import Swerve
from interplan_sumo.verification.planning_problem import CALM, Margins, PlanningProblem
from interplan_sumo.verification.privileged_rollout import driven, planned_line, rounded
from interplan_sumo.verification.reachability import unreachable
from interplan_sumo.verification.speed_lattice import cheapest_profile
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.trace import EgoTrack


def drive(problem: PlanningProblem) -> tuple[EgoTrack, np.ndarray, np.ndarray]:
    """The lane path, where it should be and where it is along its line (K,)."""
    corridor = problem.corridor
    profile = cheapest_profile(problem, start_of(corridor), Margins(), CALM)
    assert profile is not None
    line = planned_line(corridor, problem.paths, profile)
    track = EgoTrack.of(driven(corridor, line, profile, (start_state(corridor.scenario, corridor.roads),), FRAMES))
    knots = 10 * np.arange(min(len(profile.arc_m), (len(track) - 1) // 10 + 1))
    arc, _, _ = corridor.unrolled(np.stack((track.x_m[knots], track.y_m[knots]), axis=1))
    return track, profile.arc_m[: len(knots)], arc


def worst_discomfort(track: EgoTrack) -> float:
    """1 is the bound of comfort."""
    signals = comfort_signals(track, PACIFICA.rear_axle_to_center_m, 0.1)
    return max(float(np.abs(values / np.where(values < 0, *BOUNDS[name])).max()) for name, values in signals.items())


SCENES = {
    "free": laid_out(),
    "behind a slow car": (lambda o: replace(o, others=steady(o.corridor.start_m + 25.0, 5.0)))(laid_out()),
    "lane change": laid_out(staged(goal=LanePosition("12", 200.0)), TWO_LANES),
    "swerve": laid_out(staged(obstacles=(car(100.0),)), widened(ONE_LANE), Swerve(over="left")),
}


@pytest.mark.parametrize("scene", sorted(SCENES))
def test_the_driver_keeps_to_its_timing_to_comfort_and_to_the_bicycle_model(scene: str) -> None:
    corridor = SCENES[scene].corridor
    track, wanted, driven_m = drive(SCENES[scene])
    assert np.abs(wanted - driven_m).max() < 0.15
    assert worst_discomfort(track) < 1.0
    assert unreachable(start_state(corridor.scenario, corridor.roads), track, 30.0) == []
    if scene == "lane change":  # it ends in the middle of the new lane
        assert track.y_m[-1] == pytest.approx(-3.5, abs=0.1)
        assert track.y_m.min() > -3.7
    if scene == "free":  # it ends with the first state beyond the goal line
        assert track.x_m[-2] <= 200.0 < track.x_m[-1]


@pytest.mark.parametrize(("speed_mps", "frames"), [(10.0, 10), (2.0, 20)])
def test_who_begins_askew_is_soon_back_on_the_line_and_stays_there(speed_mps: float, frames: int) -> None:
    problem = laid_out(staged(start_speed_mps=speed_mps), straight_road(length_m=300.0, limit_mps=speed_mps))
    corridor, start = problem.corridor, start_state(problem.corridor.scenario, problem.corridor.roads)
    profile = cheapest_profile(problem, start_of(corridor), Margins(), CALM)
    assert profile is not None
    line = planned_line(corridor, problem.paths, profile)
    off_m = np.abs(EgoTrack.of(driven(corridor, line, profile, (replace(start, heading_rad=0.05),), 60)).y_m)
    assert off_m.max() > 0.02
    assert off_m[frames:].max() < 0.005


def test_rounded_states_have_six_decimals_and_no_negative_zero() -> None:
    state = rounded(EgoState(0.1, 1.23456789, -0.0000001, 0.5))
    assert state.x_m == 1.234568
    assert str(state.y_m) == "0.0"
