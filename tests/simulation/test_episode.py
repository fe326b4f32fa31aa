"""The closed loop on replayed traffic: what it records, when it ends, and whose fault a fault is."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable

import numpy as np
import pytest
from worlds import replayed, rolling, straight_road

from interplan_planners.straight_ahead import StraightAhead
from interplan_sumo.errors import PlannerError, TrafficError
from interplan_sumo.planner import Mission, Observation, Planner
from interplan_sumo.scenario.recorded_parts import ReplayedTrack
from interplan_sumo.scenario.scenario import LanePosition, Scenario
from interplan_sumo.simulation.episode import Episode, EpisodeOptions, Loop, run_loop
from interplan_sumo.simulation.replayed import ReplayedTraffic
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import Polyline
from interplan_sumo.world.trajectory import Trajectory

ROADS = straight_road(lanes=2, length_m=400.0)


def scenario(goal_m: float = 390.0, duration_s: float = 3.0, start_m: float = 20.0) -> Scenario:
    return Scenario(
        id="test/0",
        family="test",
        map="test",
        start=LanePosition("11", start_m),
        start_speed_mps=10.0,
        goal=LanePosition("11", goal_m),
        route=("1",),
        duration_s=duration_s,
    )


class Planning:
    """A planner from a function."""

    def __init__(self, plan: Callable[[Observation], object]) -> None:
        self._plan = plan
        self.seen: list[Observation] = []

    def start(self, mission: Mission) -> None:
        self.mission = mission

    def plan(self, observation: Observation) -> Trajectory:
        self.seen.append(observation)
        return self._plan(observation)  # type: ignore[return-value]


def straight(observation: Observation, speed_mps: float = 10.0, from_s: float = 0.0, to_s: float = 4.0) -> Trajectory:
    ahead = np.array([from_s, to_s])
    x, y = observation.ego.x_m, observation.ego.y_m
    return Trajectory(observation.time_s + ahead, x + speed_mps * ahead, np.full(2, y), np.zeros(2))


def run(planner: Planner, where: Scenario | None = None, actors: tuple[ReplayedTrack, ...] = ()) -> Episode:
    phases: list[str] = []
    return run_loop(
        where or scenario(),
        ROADS,
        planner,
        replayed(*actors),
        options=EpisodeOptions(),
        on_phase=phases.append,
    )


def test_three_seconds_are_thirty_frames_and_thirty_plans() -> None:
    episode = run(StraightAhead())
    assert episode.fault is None
    assert not episode.reached_goal
    trace = episode.trace
    assert trace is not None
    assert (len(trace), len(trace.plans), len(trace.plan_wall_s)) == (30, 30, 30)
    assert trace.ego.time_us.tolist() == [100_000 * k for k in range(30)]
    assert trace.ego.x_m[-1] == pytest.approx(20.0 + 2.9 * 10.0, abs=0.01)


def test_the_run_ends_at_the_goal_line_and_that_frame_is_recorded() -> None:
    episode = run(StraightAhead(), scenario(goal_m=34.9))
    assert episode.reached_goal
    trace = episode.trace
    assert trace is not None
    assert trace.ego.x_m[-2] <= 34.9 < trace.ego.x_m[-1]
    assert len(trace.plans) == len(trace) - 1


def test_a_planner_sees_two_seconds_of_past_from_the_first_call_on() -> None:
    car = rolling("c", Polyline(np.array([[0.0, 0.0], [400.0, 0.0]])), 50.0, 5.0)
    planner = Planning(straight)
    run(planner, actors=(car,))
    first = planner.seen[0]
    assert len(first.past.egos) == len(first.past.actors) == 20
    assert first.past.egos[0].time_s == pytest.approx(-2.0)
    assert first.past.egos[0].x_m == pytest.approx(0.0)
    assert first.past.actors[0].x_m[0] == pytest.approx(40.0)
    later = planner.seen[25]
    assert [e.time_s for e in later.past.egos] == pytest.approx([0.1 * k for k in range(5, 25)])
    assert later.past.actors[-1].x_m[0] == pytest.approx(later.actors.x_m[0] - 0.5)


def test_a_planner_sees_as_far_as_100_m_and_the_trace_farther() -> None:
    line = Polyline(np.array([[0.0, 0.0], [400.0, 0.0]]))
    planner = Planning(straight)
    episode = run(planner, actors=(rolling("near", line, 119.0), rolling("far", line, 121.0)))
    assert planner.seen[0].actors.ids == ("near",)
    assert episode.trace is not None
    assert episode.trace.actors.at(0).ids == ("far", "near")


def raising(_: Observation) -> object:
    raise RuntimeError("lost the map")


def leaving(_: Observation) -> object:
    sys.exit(3)


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        (raising, r"plan\(\) raised RuntimeError: lost the map \(test_episode\.py:\d+ in [^)]*\) \(t = 0\.0 s\)"),
        (leaving, r"raised SystemExit: 3"),
        (lambda _: Trajectory(np.array([0.0, np.inf]), *[np.zeros(2)] * 3), r"not finite"),
        (lambda observation: straight(observation, speed_mps=100.0), r"100 m/s \(at most 60\)"),
        (lambda _: None, r"NoneType"),
    ],
)
def test_a_faulty_planner_ends_its_episode_with_a_planner_fault_that_says_why(
    plan: Callable[[Observation], object], message: str
) -> None:
    episode = run(Planning(plan))
    assert episode.fault is not None
    assert episode.fault.kind == "planner"
    assert re.search(message, episode.fault.message), episode.fault.message


def test_the_time_of_a_plan_is_told_apart_from_the_loops(monkeypatch: pytest.MonkeyPatch) -> None:
    clock_s = [0.0]
    monkeypatch.setattr("time.perf_counter", lambda: clock_s[0])

    def dawdle(observation: Observation) -> object:
        clock_s[0] += 1.9
        return straight(observation)

    episode = run(Planning(dawdle), scenario(duration_s=0.3))
    assert (episode.times_s["planner"], episode.times_s["loop"]) == pytest.approx((3 * 1.9, 0.0))


def test_a_planner_that_teleports_is_stopped_before_the_ego_moves() -> None:
    def teleport(observation: Observation) -> object:
        if observation.time_s < 1.0:
            return straight(observation)
        ahead = np.array([0.0, 4.0])
        return Trajectory(observation.time_s + ahead, observation.ego.x_m + 50.0 + ahead, np.zeros(2), np.zeros(2))

    episode = run(Planning(teleport))
    assert episode.fault is not None
    assert episode.fault.kind == "planner"
    assert episode.trace is not None
    assert len(episode.trace) == 11
    assert len(episode.trace.plans) == 10


def test_a_failure_of_the_traffic_is_not_the_planners() -> None:
    class Breaking(ReplayedTraffic):
        def advance(self) -> None:
            raise TrafficError("the engine stopped")

    episode = run_loop(
        scenario(),
        ROADS,
        StraightAhead(),
        Breaking((), (), Actors.none()),
        options=EpisodeOptions(),
        on_phase=lambda _: None,
    )
    assert episode.fault is not None
    assert episode.fault.kind == "traffic"
    assert "scenario test/0, t = 0.1 s" in episode.fault.message


def test_ctrl_c_is_nobodys_fault() -> None:
    def interrupted(_: Observation) -> object:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(Planning(interrupted))


def test_a_planner_cannot_change_what_it_is_shown() -> None:
    def vandal(observation: Observation) -> object:
        observation.actors.x_m[:] = 0.0
        return straight(observation)

    car = rolling("c", Polyline(np.array([[0.0, 0.0], [400.0, 0.0]])), 50.0)
    episode = run(Planning(vandal), actors=(car,))
    assert episode.fault is not None
    assert "read-only" in episode.fault.message


def test_equal_drives_have_equal_hashes_and_another_start_has_another() -> None:
    first, second, other = run(StraightAhead()), run(StraightAhead()), run(StraightAhead(), scenario(start_m=20.001))
    assert first.trace is not None
    assert second.trace is not None
    assert other.trace is not None
    assert first.trace.hash() == second.trace.hash() != other.trace.hash()


def test_the_scene_that_a_planner_gets_is_of_its_own_time() -> None:
    planner = Planning(straight)
    run(planner)
    assert [s.time_s for s in planner.seen] == pytest.approx([0.1 * k for k in range(30)])
    assert isinstance(planner.seen[0].actors, Actors)
    assert isinstance(planner.seen[0].ego, EgoState)
    assert planner.mission.route == ("1",)
    assert planner.mission.goal.x_m == pytest.approx(390.0)


# --- step by step, by hand ---------------------------------------------------------------------


def test_a_loop_that_is_advanced_by_hand_gives_the_trace_of_a_run() -> None:
    loop, planner = Loop(scenario(), ROADS, replayed()), StraightAhead()
    planner.start(loop.open())
    while loop.begin_frame():
        loop.advance(planner.plan(loop.observation))
    by_hand, at_once = loop.trace(), run(StraightAhead()).trace
    assert by_hand is not None
    assert at_once is not None
    assert by_hand.hash() == at_once.hash()
    assert not loop.reached_goal


def test_before_the_first_frame_there_is_no_trace() -> None:
    loop = Loop(scenario(), ROADS, replayed())
    mission = loop.open()
    assert mission.route == ("1",)
    assert loop.trace() is None
    assert loop.observation.time_s == 0.0


def test_a_plan_that_cannot_be_followed_moves_nothing() -> None:
    loop = Loop(scenario(), ROADS, replayed())
    loop.open()
    loop.begin_frame()
    with pytest.raises(PlannerError, match="100 m/s"):
        loop.advance(straight(loop.observation, speed_mps=100.0))
    assert loop.ego.time_s == 0.0
    trace = loop.trace()
    assert trace is not None
    assert (len(trace), len(trace.plans)) == (1, 0)
