"""The closed loop: one scenario, one planner, from the first frame to the goal line or the last second.

Read this first. `drive` opens the traffic, `run_loop` is the loop.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np

from interplan_sumo.dynamics.lqr import follow
from interplan_sumo.errors import PlannerError, TrafficError
from interplan_sumo.maps.store import load_roads
from interplan_sumo.plan_check import check_plan
from interplan_sumo.planner import Mission, Observation, Past, Planner
from interplan_sumo.scenario.route import goal_arc_m, route_centerline
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.history import PAST_STEPS, invented_past
from interplan_sumo.simulation.setup import open_traffic, start_state
from interplan_sumo.simulation.sight import occluding_box, visible
from interplan_sumo.simulation.traffic import Traffic
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import PACIFICA, EgoShape, EgoState
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.signals import Signals
from interplan_sumo.world.trace import ActorTable, EgoTrack, Trace
from interplan_sumo.world.trajectory import Trajectory

DT_S = 0.1

FaultClass = Literal["planner", "traffic"]
Phase = Literal["setup", "plan", "simulate", "record"]
_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class Fault:
    """Why an episode ended before its time."""

    kind: FaultClass
    message: str


@dataclass(frozen=True, slots=True)
class EpisodeOptions:
    """What may differ between runs of one scenario."""

    vehicle_types: Path | None = None
    """A vehicle-type file in place of the scenario's own."""
    plan_limit_s: float = 10.0
    """Wall-clock seconds that one planner call may take."""
    shape: EgoShape = PACIFICA


@dataclass(frozen=True, slots=True, eq=False)
class Episode:
    """What came out: the trace up to the end or the fault."""

    trace: Trace | None
    """None if nothing was recorded."""
    fault: Fault | None
    reached_goal: bool
    times_s: dict[str, float]
    """Wall-clock seconds spent in `setup`, `simulation`, `planner` and the rest, `loop`."""


@dataclass(slots=True)
class _Record:
    """What is written down, frame by frame."""

    egos: list[EgoState] = field(default_factory=list)
    actors: list[Actors] = field(default_factory=list)
    signals: list[Signals] = field(default_factory=list)
    plans: list[Trajectory] = field(default_factory=list)
    plan_wall_s: list[float] = field(default_factory=list)
    simulation_s: float = 0.0

    def trace(self, behaviours: dict[str, str], shape: EgoShape) -> Trace | None:
        if not self.egos:
            return None
        actors = ActorTable.of(self.actors, behaviours)
        return Trace(
            EgoTrack.of(self.egos), actors, tuple(self.signals), tuple(self.plans), np.array(self.plan_wall_s), shape
        )


def drive(
    scenario: Scenario,
    planner: Planner,
    *,
    seed: int = 0,
    options: EpisodeOptions | None = None,
    on_phase: Callable[[Phase], None] | None = None,
) -> Episode:
    """Run one scenario on SUMO. InputError if its map or vehicle types cannot be used; all else is in the result."""
    options = options or EpisodeOptions()
    tell = on_phase or (lambda _phase: None)
    tell("setup")
    began = time.perf_counter()
    roads = load_roads(scenario.map, scenario.maps_beside)
    try:
        traffic = open_traffic(scenario, roads, seed=seed, vehicle_types=options.vehicle_types, shape=options.shape)
    except TrafficError as error:
        return Episode(None, Fault("traffic", str(error)), False, {"setup": time.perf_counter() - began})
    setup_s = time.perf_counter() - began
    try:
        episode = run_loop(scenario, roads, planner, traffic, options=options, on_phase=tell)
    finally:
        traffic.close()
    return Episode(episode.trace, episode.fault, episode.reached_goal, {"setup": setup_s, **episode.times_s})


def run_loop(
    scenario: Scenario,
    roads: Roads,
    planner: Planner,
    traffic: Traffic,
    *,
    options: EpisodeOptions,
    on_phase: Callable[[Phase], None],
) -> Episode:
    """The loop on any traffic. Planner and traffic faults end it and are told apart in the result."""
    began = time.perf_counter()
    record = _Record()
    reached_goal, fault = False, None
    try:
        reached_goal = _run(scenario, roads, planner, traffic, record, options, on_phase)
    except PlannerError as error:
        fault = Fault("planner", f"{error} (t = {(len(record.egos) - 1) * DT_S:.1f} s)" if record.egos else str(error))
    except TrafficError as error:
        fault = Fault("traffic", f"{error} (scenario {scenario.id}, t = {len(record.egos) * DT_S:.1f} s)")
    on_phase("record")
    trace = record.trace(dict(traffic.behaviours), options.shape)
    planner_s = sum(record.plan_wall_s)
    loop_s = time.perf_counter() - began - planner_s - record.simulation_s
    return Episode(
        trace, fault, reached_goal, {"simulation": record.simulation_s, "planner": planner_s, "loop": loop_s}
    )


def _run(
    scenario: Scenario,
    roads: Roads,
    planner: Planner,
    traffic: Traffic,
    record: _Record,
    options: EpisodeOptions,
    on_phase: Callable[[Phase], None],
) -> bool:
    """Fill `record`; whether the goal line was passed."""
    route, goal_m = route_centerline(roads, scenario), goal_arc_m(roads, scenario)
    ego = start_state(scenario, roads)
    scene = traffic.observe()
    occluder = occluding_box(scenario, roads)
    in_sight = visible(scene.actors, ego, occluder)
    past = invented_past(roads, ego, in_sight, DT_S)
    egos, others = deque(past.egos, PAST_STEPS), deque(past.actors, PAST_STEPS)
    mission = Mission(roads, scenario.route, scenario.goal.pose(roads), options.shape, DT_S)
    on_phase("plan")
    _guarded(lambda: planner.start(mission), "start()")

    for _ in range(round(scenario.duration_s / DT_S)):
        record.egos.append(ego)
        record.actors.append(scene.actors)
        record.signals.append(scene.signals)
        if route.project_point(ego.x_m, ego.y_m)[0] > goal_m:
            return True

        seen = Observation(ego.time_s, ego, in_sight, scene.signals, Past(tuple(egos), tuple(others)))
        on_phase("plan")
        plan = _planned(planner, seen, record, options.plan_limit_s)
        on_phase("simulate")
        check_plan(plan, ego, ego.time_s)
        record.plans.append(plan)

        stepping = time.perf_counter()
        traffic.react(ego)
        egos.append(ego)
        others.append(in_sight)
        record.simulation_s += time.perf_counter() - stepping
        ego = follow(ego, plan, DT_S, options.shape)
        stepping = time.perf_counter()
        traffic.place_ego(ego)
        traffic.advance()
        scene = traffic.observe()
        record.simulation_s += time.perf_counter() - stepping
        in_sight = visible(scene.actors, ego, occluder)
    return False


def _planned(planner: Planner, seen: Observation, record: _Record, limit_s: float) -> Trajectory:
    began = time.perf_counter()
    plan = _guarded(lambda: planner.plan(seen), "plan()")
    wall_s = time.perf_counter() - began
    record.plan_wall_s.append(wall_s)
    if wall_s > limit_s:
        raise PlannerError(f"plan() took {wall_s:.1f} s, the limit is {limit_s:g} s")
    return plan


def _guarded(call: Callable[[], _T], what: str) -> _T:
    """The planner's own exceptions, sys.exit included, as PlannerError with the place where they were raised."""
    try:
        return call()
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        where = error.__traceback__
        while where is not None and where.tb_next is not None:
            where = where.tb_next
        place = f" ({Path(where.tb_frame.f_code.co_filename).name}:{where.tb_lineno})" if where is not None else ""
        raise PlannerError(f"{what} raised {type(error).__name__}: {error}{place}") from error
