"""The conformance suite: tells a planner's author in seconds, and in words, what is wrong.

    from interplan_sumo.testing import assert_planner_conforms

    def test_my_planner_conforms() -> None:
        assert_planner_conforms("my_package.planner:MyPlanner?gain=2")

The planner drives a few seconds on each of ten little worlds, with nuPlan's
tracker and bicycle and without SUMO, and two of the worlds once more.
"""

from __future__ import annotations

import signal
import sysconfig
import threading
import time
import traceback
from collections.abc import Callable, Generator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from math import cos, degrees, hypot, sin
from pathlib import Path
from types import FrameType
from typing import Any, Literal

import numpy as np

from interplan_sumo._check_worlds import CheckWorld, check_worlds
from interplan_sumo.dynamics.lqr import follow
from interplan_sumo.errors import InputError, PlannerError, PlannerOverdueError
from interplan_sumo.plan_check import check_plan
from interplan_sumo.planner import Observation, Planner, load_planner
from interplan_sumo.planner_process.external import ExternalPlanner
from interplan_sumo.tiny_worlds import DT_S
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import wrap_angle
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trajectory import Trajectory

Severity = Literal["error", "warning", "note"]
Call = Literal["start", "plan"]

SLOW_PLAN_S = 1.0
"""nuPlan's budget for one step."""
CALL_LIMIT_S = 10.0
"""The default limit of a run for one call of plan()."""
TRACKED_AHEAD_S = 1.0
"""The tracker takes its target speed from the plan one second ahead."""
ADVISED_REACH_S = 8.0
"""What nuPlan's planners return."""
HEADING_OFF_RAD = 0.5
_REPEATED = ("bend", "dense traffic")


@dataclass(frozen=True, slots=True)
class ConformanceFinding:
    """One thing the suite noticed."""

    severity: Severity
    """Errors would be faults in a run; warnings are likely mistakes; notes are for information."""
    rule: str
    message: str
    """What happened, with the numbers and the way out."""
    worlds: tuple[str, ...] = ()
    """Where; the message speaks of the first."""

    def __str__(self) -> str:
        where = f" [{', '.join(self.worlds)}]" if self.worlds else ""
        return f"{self.severity}: {self.rule}: {self.message}{where}"


def assert_planner_conforms(planner: Planner | str, *, steps: int = 40) -> None:
    """AssertionError that lists all errors `check_planner` finds; for use in tests."""
    errors = [finding for finding in check_planner(planner, steps=steps) if finding.severity == "error"]
    if errors:
        raise AssertionError("the planner does not conform:\n" + "\n".join(f"  {finding}" for finding in errors))


def check_planner(
    planner: Planner | str, *, steps: int = 40, on_call: Callable[[Call], None] | None = None
) -> list[ConformanceFinding]:
    """Everything found, errors first; a conforming planner has no finding of severity "error".

    `planner` is an instance, or a name as `run --planner` takes it. `steps` of
    0.1 s are driven on every world. Calls longer than 10 s are cut off where
    the platform has alarms and this is the main thread. `on_call` is told of
    each call of the planner before it is made.
    """
    if isinstance(planner, str):
        try:
            planner = load_planner(planner)
        except InputError as error:
            return [ConformanceFinding("error", "loads", str(error))]
    missing = [name for name in ("start", "plan") if not callable(getattr(planner, name, None))]
    if missing:
        text = f"{type(planner).__name__} has no method {' and no method '.join(missing)}"
        return [ConformanceFinding("error", "methods", f"{text}; a planner needs start(mission) and plan(observation)")]
    if isinstance(planner, type):
        return [
            ConformanceFinding("error", "methods", f"{planner.__name__} is a class; give an instance or 'module:Class'")
        ]

    tell = on_call or (lambda _call: None)
    drives: dict[str, _Drive] = {}
    for world in check_worlds():
        drives[world.name] = _drive(planner, world, steps, tell)
        if any(finding.rule == "time" and finding.severity == "error" for finding in drives[world.name].findings):
            break  # who hangs would hang again
    findings = [finding for drive in drives.values() for finding in drive.findings]
    for world in check_worlds():
        first = drives.get(world.name)
        if first is not None and world.name in _REPEATED and not first.failed:
            findings += _differences(first, _drive(planner, world, steps, tell))
    findings += _habits(list(drives.values()))
    order = ("error", "warning", "note")
    return sorted(_merged(findings), key=lambda finding: order.index(finding.severity))


# --- one drive -----------------------------------------------------------------------------------


@dataclass
class _Drive:
    """What happened on one world."""

    world: CheckWorld
    egos: list[EgoState]
    """One per plan; the state in which it was asked for."""
    plans: list[Trajectory]
    wall_s: list[float]
    findings: list[ConformanceFinding]
    timed: bool = True
    """Whether calls are cut off here; programs have limits of their own, another one for taking a map."""

    @property
    def failed(self) -> bool:
        return any(finding.severity == "error" for finding in self.findings)

    def report(self, severity: Severity, rule: str, message: str) -> None:
        self.findings.append(ConformanceFinding(severity, rule, message, (self.world.name,)))


class _OverrunError(BaseException):
    """A call took too long; not an Exception, so that a planner does not swallow it by accident."""


def _drive(planner: Planner, world: CheckWorld, steps: int, tell: Callable[[Call], None]) -> _Drive:
    drive = _Drive(world, [], [], [], [], timed=not isinstance(planner, ExternalPlanner))
    mission = world.mission
    roads_before = _roads_print(mission.roads)
    tell("start")
    if _called(drive, "start", lambda: planner.start(mission)) is _FAILED:
        return drive
    ego = world.ego
    for _ in range(steps):
        observation = world.observation(ego, drive.egos)
        before = _observation_print(observation)
        began_s = time.perf_counter()
        tell("plan")
        plan = _called(drive, "plan", lambda observation=observation: planner.plan(observation))
        drive.wall_s.append(time.perf_counter() - began_s)
        if plan is _FAILED:
            break
        if _observation_print(observation) != before:
            drive.report("error", "inputs", f"plan() changed its observation at t = {ego.time_s:.1f} s; work on a copy")
            break
        try:
            check_plan(plan, ego, ego.time_s)
        except PlannerError as error:
            drive.report("error", "plan", f"at t = {ego.time_s:.1f} s {error}")
            break
        drive.egos.append(ego)
        drive.plans.append(plan)
        ego = follow(ego, plan, DT_S, mission.shape)
        if not drive.failed:
            _note_outcome(drive, ego)
    if _roads_print(mission.roads) != roads_before:
        drive.report("error", "inputs", "the planner changed the map of its mission; work on a copy")
    return drive


_FAILED = object()


def _called(drive: _Drive, method: str, call: Callable[[], Any]) -> Any:
    """The result of a call of the planner, or _FAILED with the reason reported."""
    try:
        with _alarm(CALL_LIMIT_S) if drive.timed else nullcontext():
            return call()
    except _OverrunError:
        drive.report("error", "time", f"{method}() did not return within {CALL_LIMIT_S:g} s")
    except PlannerOverdueError as error:
        drive.report("error", "time", str(error))
    except PlannerError as error:  # of a program: it has no lines that could be told
        drive.report("error", "raises", str(error))
    except SystemExit as error:
        drive.report("error", "raises", f"{method}() called sys.exit({error.code!r}){_place(error)}; raise an error")
    except Exception as error:
        hint = ""
        if isinstance(error, (ValueError, AttributeError)) and "read-only" in str(error):
            hint = "; what a planner is given must not be changed, work on a copy"
        elif type(error).__name__ == "FrozenInstanceError":
            hint = "; what a planner is given must not be changed, use dataclasses.replace"
        drive.report("error", "raises", f"{method}() raised {type(error).__name__}: {error}{_place(error)}{hint}")
    return _FAILED


def _place(error: BaseException) -> str:
    """Where in the planner's own code an error arose: the deepest line that is in no library."""
    libraries = {Path(__file__).parent, Path(sysconfig.get_path("stdlib"))}
    written = [frame for frame in traceback.extract_tb(error.__traceback__) if not frame.filename.startswith("<")]
    frames = [frame for frame in written if not libraries & {*Path(frame.filename).parents}]
    own = [frame for frame in frames if "site-packages" not in Path(frame.filename).parts] or frames
    if not own:
        return ""
    last = own[-1]
    return f" ({Path(last.filename).name}:{last.lineno}, in {last.name}: {last.line})"


@contextmanager
def _alarm(limit_s: float) -> Generator[None]:
    """Raises _OverrunError inside the block after `limit_s`; does nothing where alarms do not work or one is in use."""
    usable = hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread()
    if not usable or signal.getitimer(signal.ITIMER_REAL)[0] > 0.0:
        yield
        return

    def overrun(_number: int, _frame: FrameType | None) -> None:
        raise _OverrunError

    previous = signal.signal(signal.SIGALRM, overrun)
    signal.setitimer(signal.ITIMER_REAL, limit_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, previous)


def _observation_print(observation: Observation) -> tuple[Any, ...]:
    """Everything in an observation that a planner could change, as bytes."""
    a = observation.actors
    columns = (
        a.kind,
        a.x_m,
        a.y_m,
        a.heading_rad,
        a.length_m,
        a.width_m,
        a.vx_mps,
        a.vy_mps,
        observation.signals.status,
    )
    past = tuple((e.x_m, e.y_m, e.heading_rad, e.vx_mps) for e in observation.past.egos)
    past_actors = tuple(p.x_m.tobytes() + p.y_m.tobytes() for p in observation.past.actors)
    return (*(column.tobytes() for column in columns), observation.ego, past, past_actors)


def _roads_print(roads: Roads) -> tuple[bytes, ...]:
    everything = (*roads.lanes.values(), *roads.connectors.values())
    return tuple(lane.centerline.points.tobytes() + lane.centerline.arc_m.tobytes() for lane in everything)


# --- rules ---------------------------------------------------------------------------------------


def _note_outcome(drive: _Drive, ego: EgoState) -> None:
    """A planner may drive badly and conform; it is said once per world all the same."""
    if any(finding.rule == "drives" for finding in drive.findings):
        return
    world, shape = drive.world, drive.world.mission.shape
    if world.name == "standing car ahead":
        for actor_id, box in zip(world.actors.ids, world.actors.polygons, strict=True):
            if box.intersects(ego.polygon(shape)):
                drive.report(
                    "note", "drives", f"hits {actor_id} at t = {ego.time_s:.1f} s with {ego.speed_mps:.1f} m/s"
                )
    elif world.name == "red light":
        line = world.mission.roads["1"].centerline
        front = ego.x_m + cos(ego.heading_rad) * shape.length_m / 2
        if front > float(line.points[-1, 0]) + 0.5:
            drive.report("note", "drives", f"passes a red light at t = {ego.time_s:.1f} s")


def _differences(first: _Drive, again: _Drive) -> list[ConformanceFinding]:
    """Whether a second drive on the same world, by the same instance, gave the same plans to the last bit."""
    where = (first.world.name,)
    advice = (
        "is something left over from the last episode (start() must reset it), or is there chance without a fixed seed?"
    )
    if again.failed:
        text = f"the second drive fails where the first did not: {again.findings[-1].message}; {advice}"
        return [ConformanceFinding("error", "repeatable", text, where)]
    for k, (one, two) in enumerate(zip(first.plans, again.plans, strict=True)):
        if len(one) != len(two):
            what = f"{len(one)} poses, then {len(two)}"
        else:
            apart = [np.abs(getattr(one, n) - getattr(two, n)).max() for n in ("time_s", "x_m", "y_m", "heading_rad")]
            if max(apart) == 0.0:
                continue
            what = f"up to {max(apart[1:3]):.3g} m and {apart[3]:.3g} rad apart"
        text = f"two drives on the same world give different plans from t = {k * DT_S:.1f} s on ({what}); {advice}"
        return [ConformanceFinding("error", "repeatable", text, where)]
    return []


def _habits(drives: list[_Drive]) -> list[ConformanceFinding]:
    """What only shows over all drives."""
    findings: list[ConformanceFinding] = []
    wall_s = np.array([wall for drive in drives for wall in drive.wall_s])
    if wall_s.size:
        slow = bool(wall_s.max() > SLOW_PLAN_S)
        text = f"plan() takes {1e3 * wall_s.mean():.2f} ms on average, {1e3 * wall_s.max():.2f} ms at most"
        hint = f"; nuPlan allows {SLOW_PLAN_S:g} s, a run cuts off at {CALL_LIMIT_S:g} s by default" if slow else ""
        findings.append(ConformanceFinding("warning" if slow else "note", "time", text + hint))
    plans = [(ego, plan) for drive in drives for ego, plan in zip(drive.egos, drive.plans, strict=True)]
    if not plans:
        return findings

    reach_s = min(float(plan.time_s[-1]) - ego.time_s for ego, plan in plans)
    if reach_s < TRACKED_AHEAD_S - 1e-6:
        text = (
            f"a plan reaches only {reach_s:.2f} s ahead; the tracker takes its speed from {TRACKED_AHEAD_S:g} s ahead"
        )
        findings.append(
            ConformanceFinding("warning", "horizon", f"{text} and holds the last one; reach {ADVISED_REACH_S:g} s")
        )
    elif reach_s < ADVISED_REACH_S - 1e-6:
        text = f"a plan reaches {reach_s:.2f} s ahead; nuPlan's planners return {ADVISED_REACH_S:g} s"
        findings.append(ConformanceFinding("note", "horizon", text))

    offsets: list[tuple[float, float]] = []
    for ego, plan in plans:
        pose = plan.at(max(ego.time_s, float(plan.time_s[0])))
        turned = wrap_angle(pose.heading_rad - ego.heading_rad)
        if abs(turned) > HEADING_OFF_RAD:
            text = (
                f"at t = {ego.time_s:.1f} s the plan's heading is {pose.heading_rad:.2f} rad, "
                f"{degrees(abs(turned)):.0f} degrees off the ego's ({ego.heading_rad:.2f}); "
                "headings are radians, counter-clockwise from +x"
            )
            findings.append(ConformanceFinding("warning", "heading", text))
            break
        dx, dy = pose.x_m - ego.x_m, pose.y_m - ego.y_m
        c, s = cos(ego.heading_rad), sin(ego.heading_rad)
        offsets.append((c * dx + s * dy, c * dy - s * dx))
    shape = drives[0].world.mission.shape
    ahead_m, left_m = np.median(offsets, axis=0) if offsets else (0.0, 0.0)
    if hypot(ahead_m + shape.rear_axle_to_center_m, left_m) < 0.15:
        text = (
            f"plans begin {-ahead_m:.2f} m behind the ego's centre, where the rear axle is; "
            f"a plan is of the box centre: move poses {shape.rear_axle_to_center_m} m ahead"
        )
        findings.append(ConformanceFinding("warning", "reference", text))
    return findings


def _merged(findings: list[ConformanceFinding]) -> list[ConformanceFinding]:
    """One finding per severity and rule: the first, with the worlds of all of them."""
    merged: dict[tuple[str, str, str], ConformanceFinding] = {}
    for finding in findings:
        # Notes on the drive differ in kind from world to world; errors of one rule hardly ever do.
        key = (finding.severity, finding.rule, finding.message if finding.severity == "note" else "")
        known = merged.get(key)
        worlds = (*known.worlds, *(w for w in finding.worlds if w not in known.worlds)) if known else finding.worlds
        merged[key] = replace(known or finding, worlds=worlds)
    return list(merged.values())
