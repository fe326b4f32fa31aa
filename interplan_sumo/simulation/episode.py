"""The closed loop: one scenario, one planner, from the first frame to the goal line or the last second.

Read this first. `drive` opens the traffic, `run_loop` asks the planner, `Loop` is one step after the other.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from interplan_sumo.dynamics.lqr import follow
from interplan_sumo.errors import PlannerError, TrafficError
from interplan_sumo.maps.store import load_roads
from interplan_sumo.plan_check import check_plan
from interplan_sumo.planner import Mission, Observation, Past, Planner
from interplan_sumo.planner_seat import PlannerSeat, seated
from interplan_sumo.scenario.route import GoalLine, goal_arc_m, route_centerline
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.history import PAST_STEPS, extrapolated_egos
from interplan_sumo.simulation.perception import Perception
from interplan_sumo.simulation.setup import open_traffic, start_state
from interplan_sumo.simulation.traffic import Traffic, TrafficState
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import PACIFICA, EgoShape, EgoState
from interplan_sumo.world.geometry import Polyline
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.signals import Signals
from interplan_sumo.world.trace import ActorTable, EgoTrack, Trace
from interplan_sumo.world.trajectory import Trajectory

DT_S = 0.1

FaultClass = Literal["planner", "traffic"]
Phase = Literal["setup", "start", "plan", "simulate", "record"]


@dataclass(frozen=True, slots=True)
class EpisodeFault:
    """Why an episode ended before its time."""

    kind: FaultClass
    message: str


@dataclass(frozen=True, slots=True)
class EpisodeOptions:
    """What may differ between runs of one scenario."""

    vehicle_types: Path | None = None
    """A vehicle-type file in place of the scenario's own."""
    shape: EgoShape = PACIFICA


@dataclass(frozen=True, slots=True, eq=False)
class Episode:
    """What came out: the trace up to the end or the fault."""

    trace: Trace | None
    """None if nothing was recorded."""
    fault: EpisodeFault | None
    reached_goal: bool
    times_s: dict[str, float]
    """Wall-clock seconds spent in `setup`, `simulation`, `planner` and the rest, `loop`."""


@dataclass(slots=True)
class _Record:
    """What is written down, frame by frame."""

    egos: list[EgoState] = field(default_factory=list)
    actors: list[Actors] = field(default_factory=list)
    without_ego: list[Mapping[str, float] | None] = field(default_factory=list)
    """As in `TrafficState`."""
    seen: list[Actors] = field(default_factory=list)
    """What the planner saw, from `PAST_STEPS` frames before the first on; nothing where that is `full`."""
    signals: list[Signals] = field(default_factory=list)
    plans: list[Trajectory] = field(default_factory=list)
    plan_wall_s: list[float] = field(default_factory=list)

    def trace(self, behaviours: dict[str, str], shape: EgoShape) -> Trace | None:
        if not self.egos:
            return None
        asked = [each for each in self.without_ego if each is not None]
        actors = ActorTable.of(self.actors, behaviours, asked if len(asked) == len(self.actors) else None)
        seen = ActorTable.of(self.seen) if self.seen else None
        plan_wall_s = np.array(self.plan_wall_s)
        return Trace(EgoTrack.of(self.egos), actors, tuple(self.signals), tuple(self.plans), plan_wall_s, shape, seen)


def drive(
    scenario: Scenario,
    planner: Planner | PlannerSeat,
    *,
    seed: int = 0,
    options: EpisodeOptions | None = None,
    on_phase: Callable[[Phase], None] | None = None,
) -> Episode:
    """Run one scenario on SUMO; a planner without a seat of its own drives in this process.

    InputError if its map or vehicle types cannot be used; all else is in the result.
    """
    options = options or EpisodeOptions()
    tell = on_phase or (lambda _phase: None)
    tell("setup")
    began = time.perf_counter()
    roads = load_roads(scenario.map, scenario.maps_beside)
    try:
        traffic = open_traffic(scenario, roads, seed=seed, vehicle_types=options.vehicle_types, shape=options.shape)
    except TrafficError as error:
        return Episode(None, EpisodeFault("traffic", str(error)), False, {"setup": time.perf_counter() - began})
    setup_s = time.perf_counter() - began
    try:
        episode = run_loop(scenario, roads, planner, traffic, options=options, on_phase=tell, seed=seed)
    finally:
        traffic.close()
    return Episode(episode.trace, episode.fault, episode.reached_goal, {"setup": setup_s, **episode.times_s})


def run_loop(
    scenario: Scenario,
    roads: Roads,
    planner: Planner | PlannerSeat,
    traffic: Traffic,
    *,
    options: EpisodeOptions,
    on_phase: Callable[[Phase], None],
    seed: int = 0,
) -> Episode:
    """The loop on any traffic; what the planner sees is drawn from `seed`.

    Planner and traffic faults end it and are told apart in the result.
    """
    began = time.perf_counter()
    loop = Loop(scenario, roads, traffic, options.shape, seed)
    record, fault = loop.record, None
    try:
        _run(loop, seated(planner), on_phase)
    except PlannerError as error:
        fault = EpisodeFault(
            "planner", f"{error} (t = {(len(record.egos) - 1) * DT_S:.1f} s)" if record.egos else str(error)
        )
    except TrafficError as error:
        fault = EpisodeFault("traffic", f"{error} (scenario {scenario.id}, t = {len(record.egos) * DT_S:.1f} s)")
    on_phase("record")
    trace = loop.trace()
    planner_s = sum(record.plan_wall_s)
    # A planner that thinks while the agents react makes the parts more than the whole.
    loop_s = max(time.perf_counter() - began - planner_s - loop.simulation_s, 0.0)
    return Episode(
        trace, fault, loop.reached_goal, {"simulation": loop.simulation_s, "planner": planner_s, "loop": loop_s}
    )


def run_until(scenario: Scenario, planner: Planner, enough: Callable[[], bool], *, seed: int = 0) -> float | None:
    """Drive until `enough()` is true after a plan; the time of it in seconds, None if the episode ends before.

    Unlike `drive` it lets through whatever the planner raises. TrafficError if SUMO fails.
    """
    roads = load_roads(scenario.map, scenario.maps_beside)
    with open_traffic(scenario, roads, seed=seed) as traffic:
        loop = Loop(scenario, roads, traffic, seed=seed)
        planner.start(loop.open())
        while loop.begin_frame():
            plan = planner.plan(loop.observation)
            if enough():
                return loop.ego.time_s
            loop.advance(plan)
    return None


def _run(loop: Loop, seat: PlannerSeat, on_phase: Callable[[Phase], None]) -> None:
    """Drive to the end."""

    def meanwhile() -> None:
        on_phase("simulate")
        loop.react()
        on_phase("plan")

    mission = loop.open()
    on_phase("start")
    seat.start(mission)
    while loop.begin_frame():
        on_phase("plan")
        timed = seat.plan_while(loop.observation, meanwhile)
        loop.record.plan_wall_s.append(timed.wall_s)
        on_phase("simulate")
        loop.advance(timed.plan)


class Loop:
    """One episode, step by step: `open`, then `advance` with a plan for `observation` as long as `begin_frame` says so.

    PlannerError from `advance` if the plan cannot be followed, TrafficError from all where the traffic fails: no
    step can follow either.
    """

    ego: EgoState
    scene: TrafficState
    """Both now."""
    route: Polyline
    """The route as one line, map frame."""
    goal_m: float
    """Where on `route` the goal line lies."""

    def __init__(
        self, scenario: Scenario, roads: Roads, traffic: Traffic, shape: EgoShape = PACIFICA, seed: int = 0
    ) -> None:
        """`seed` is that of the traffic: what the planner sees of it is drawn from it, too."""
        self.scenario = scenario
        self.roads = roads
        self.traffic = traffic
        self.shape = shape
        self._seed = seed
        self.record = _Record()
        self.reached_goal = False
        self._has_reacted = False
        self.simulation_s = 0.0
        """Wall-clock seconds that the traffic took."""

    def open(self) -> Mission:
        """Look at the scene for the first time; what a planner is told before the first step."""
        self.route = route_centerline(self.roads, self.scenario)
        self.goal_m = goal_arc_m(self.roads, self.scenario)
        self._goal_line = GoalLine(self.route, self.goal_m)
        self.ego = start_state(self.scenario, self.roads)
        self.scene = self.traffic.observe()
        self._perception = Perception(self.scenario, self.roads, self.traffic.heights_m, self._seed, DT_S)
        before, self._seen = self._perception.first(self.ego, self.scene.actors)
        egos = extrapolated_egos(self.roads, self.ego, DT_S, self.scenario.past)
        self._egos, self._others = deque(egos, PAST_STEPS), deque(before, PAST_STEPS)
        self._keeps_seen = self.scenario.perception != "full"
        if self._keeps_seen:
            self.record.seen.extend(before)
        return Mission(self.roads, self.scenario.route, self.scenario.goal.pose(self.roads), self.shape, DT_S)

    @property
    def observation(self) -> Observation:
        """What a planner sees now."""
        past = Past(tuple(self._egos), tuple(self._others))
        return Observation(self.ego.time_s, self.ego, self._seen, self.scene.signals, past)

    def begin_frame(self) -> bool:
        """Write the present down; False past the goal line, where no plan is needed, and when time is up."""
        if len(self.record.egos) == round(self.scenario.duration_s / DT_S):
            return False
        self.record.egos.append(self.ego)
        self.record.actors.append(self.scene.actors)
        self.record.without_ego.append(self.scene.ax_without_ego)
        if self._keeps_seen:
            self.record.seen.append(self._seen)
        self.record.signals.append(self.scene.signals)
        self.reached_goal = self._goal_line.is_passed(self.ego.x_m, self.ego.y_m)
        return not self.reached_goal

    def react(self) -> None:
        """Have the agents answer the ego as it is now, once per step; the plan need not be known for that."""
        if not self._has_reacted:
            self._has_reacted = True
            stepping = time.perf_counter()
            self.traffic.react(self.ego)
            self.simulation_s += time.perf_counter() - stepping

    def advance(self, plan: Trajectory) -> None:
        """One step along a plan for `observation`."""
        check_plan(plan, self.ego, self.ego.time_s)
        self.record.plans.append(plan)
        self.react()
        self._has_reacted = False
        self._egos.append(self.ego)
        self._others.append(self._seen)
        self.ego = follow(self.ego, plan, DT_S, self.shape)
        stepping = time.perf_counter()
        self.traffic.place_ego(self.ego)
        self.traffic.advance()
        self.scene = self.traffic.observe()
        self.simulation_s += time.perf_counter() - stepping
        self._seen = self._perception.look(self.ego, self.scene.actors)

    def trace(self) -> Trace | None:
        """What was written down so far; None before the first frame."""
        return self.record.trace(dict(self.traffic.behaviours), self.shape)
