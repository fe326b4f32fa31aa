"""Fuzz cases: a number makes a scene, its drivers and a rude ego; driving one gives every violation in it.

A case is a function of (seed, number, maps) alone, so one number repeats it.
"""

from __future__ import annotations

import hashlib
import traceback
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import libsumo
import numpy as np

from interplan_sumo.families import FAMILIES
from interplan_sumo.families.generate import Search
from interplan_sumo.maps.store import load_roads
from interplan_sumo.scenario.route import route_centerline, route_lanes
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.sites import lane_width_m
from interplan_sumo.scenario.suite import find_suite
from interplan_sumo.simulation.setup import open_sumo_traffic, start_state
from interplan_sumo.simulation.traffic import EgoPresence
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import Polyline
from interplan_sumo.world.roads import Connector, Roads
from tests.simulation import traffic_invariants as invariants
from tests.simulation import twin_invariants
from tests.simulation.fuzz_drivers import DAWDLING, STEADY, drivers_of
from tests.simulation.random_drives import random_scenario
from tests.simulation.recorded_frames import FrameRecorder
from tests.simulation.rude_egos import Surroundings, behaviours, driven
from tests.simulation.traffic_invariants import Array, Body, Drive, Violation

RANDOM_BRAKING = "PWagner2009"
"""Ends its braking by chance, and SUMO's chance falls otherwise where there is an ego: no twin tells a reaction."""
BRAKE_ANYWAY = (RANDOM_BRAKING, "ACC", "CACC", "Wiedemann")
"""Models whose hard braking is no bad start: they brake so more often once they have driven a while.

In plain SUMO, without an ego, with a `decel` of 2 m/s2, braking above 3 m/s2 begins so many times in 100 agent-seconds:
PWagner2009 0.28 in the first two seconds, 3.0 later on (of 16,943 s); ACC 0.10 and 0.40 (15,145 s); CACC 0 and 2.5
(15,633 s); Wiedemann, of our own starts, 0.013 (of 7,452 s) and 0.165. IDM never, and 0.03.
"""
OUR_OWN = ("spawn_braking", "appears", "leaves")
"""Where vehicles start, come and go is ours to say, also where plain SUMO drives them."""
ERRING = "EIDM"
"""Its drivers err by chance."""
SHIPPED_MAPS = ("back_bay", "hazelwood", "one_north", "strip")
SUITES = ("interplan==1", "common==1")
DENSITIES = ("low", "medium", "high")
BLOCKED_BY_FOLLOWER = (1 << 10) | (1 << 12)
"""In SUMO's lane-change states, left or right."""
BEYOND_M = 400.0
"""The ego's line goes on this far behind the goal, and begins this far before the start."""


@dataclass(frozen=True, slots=True)
class Maps:
    """Where scenes may be."""

    names: tuple[str, ...] = SHIPPED_MAPS
    """Of shipped maps, or folders."""
    suites: tuple[str, ...] = SUITES


@dataclass(frozen=True, slots=True)
class Case:
    """One drive to be made."""

    number: int
    scenario: Scenario
    seed: int
    ego: str
    """Name of the behaviour."""
    types: Path
    drivers: str
    """What the types are, in words."""


@dataclass(slots=True)
class Outcome:
    """What came of a case."""

    violations: list[Violation] = field(default_factory=list[Violation])
    agent_s: float = 0.0
    drive: Drive | None = None
    twin: Drive | None = None
    types: dict[str, str] = field(default_factory=dict[str, str])
    """Type of each agent by its id."""
    hash: str = ""
    egos: list[EgoState] = field(default_factory=list[EgoState])
    giving_way: set[tuple[int, str]] = field(default_factory=set[tuple[int, str]])
    """Frames, and ids of the agents that, for SUMO, then want a lane and wait for who is behind there."""


def case(seed: int, number: int, maps: Maps, folder: Path) -> Case:
    """Case `number`; files of derived types are written to `folder`."""
    rng = np.random.default_rng((seed, number))
    names = list(behaviours())
    ego = names[number % len(names)]
    pick = rng.random()
    if pick < 0.6 and maps.suites:
        pool = [each for suite in maps.suites for each in find_suite(suite).scenarios]
        scenario = pool[int(rng.integers(len(pool)))]
        if not scenario.has_traffic or rng.random() < 0.5:
            scenario = _denser(scenario, rng)
    else:
        scenario = _generated(maps.names[int(rng.integers(len(maps.names)))], seed, number, rng, families=pick < 0.75)
    kinds = {each.kind for each in scenario.vehicles}
    file, only = folder / f"types_{seed}_{number}.xml", "urban" if kinds - {"car"} else None
    types, words = drivers_of(file, rng, only, dawdle=number % 2 == 1)
    return Case(number, scenario, int(rng.integers(1000)), ego, types, words)


def _denser(scenario: Scenario, rng: np.random.Generator) -> Scenario:
    """The same place with other traffic."""
    drawn: dict[str, Any] = {"density": str(rng.choice(DENSITIES)), "oncoming": str(rng.choice(("none", *DENSITIES)))}
    return replace(scenario, traffic=replace(scenario.traffic, **drawn))


def _generated(map: str, seed: int, number: int, rng: np.random.Generator, *, families: bool) -> Scenario:
    """A new scene on a map: of a family, or a random drive."""
    if families:
        search = Search(load_roads(map), str(rng.choice([name for name in FAMILIES if name != "trip"])), seed + number)
        for made in search:
            return replace(_denser(made, rng), map=map) if rng.random() < 0.5 else replace(made, map=map)
    return random_scenario(map, rng, number, obstacles=bool(rng.random() < 0.3), jaywalker=bool(rng.random() < 0.2))


def egos_of(case: Case, roads: Roads, steps: int) -> list[EgoState]:
    """The poses of the case's ego."""
    rng = np.random.default_rng((case.number, case.seed, 1))
    scenario = case.scenario
    line = _extended(roads, scenario, route_centerline(roads, scenario))
    start = start_state(scenario, roads)
    return driven(line, start, behaviours()[case.ego](_surroundings(roads, scenario, line), rng), steps)


def _extended(roads: Roads, scenario: Scenario, line: Polyline) -> Polyline:
    """The line with the lanes before its start and behind its end."""
    here, wanted_m = scenario.goal.lane, line.length_m + BEYOND_M
    while line.length_m < wanted_m and (ways := sorted(roads.outgoing(here))):
        here = ways[0]
        line = line.joined(roads[here].centerline)
    here, wanted_m = route_lanes(roads, scenario)[0], line.length_m + BEYOND_M
    while line.length_m < wanted_m and (ways := sorted(roads.incoming(here))):
        here = ways[0]
        line = roads[here].centerline.joined(line)
    return line


def _surroundings(roads: Roads, scenario: Scenario, line: Polyline) -> Surroundings:
    lane = roads[scenario.start.lane]
    at = scenario.start.pose(roads)
    width_m = 3.5 if isinstance(lane, Connector) else lane_width_m(lane, scenario.start.arc_m)
    left = not isinstance(lane, Connector) and roads.left_of(lane.id) is not None
    oncoming: list[float] = []
    for other in roads.lanes.values():
        arc_m, _ = other.centerline.project_point(at.x_m, at.y_m)
        pose = other.centerline.pose_at(arc_m)
        if np.cos(pose.heading_rad - at.heading_rad) < -0.9:
            offset = float(np.cos(at.heading_rad) * (pose.y_m - at.y_m) - np.sin(at.heading_rad) * (pose.x_m - at.x_m))
            if np.hypot(pose.x_m - at.x_m, pose.y_m - at.y_m) < 16.0:
                oncoming.append(offset)
    junctions: list[tuple[float, float]] = []
    for connector in roads.connectors.values():
        ends = [line.project_point(*connector.centerline.points[i].tolist()) for i in (0, -1)]
        if all(abs(off) < 0.3 for _, off in ends) and ends[1][0] > ends[0][0] + 3.0:
            junctions.append((ends[0][0], ends[1][0]))
    cruise = max(5.0, min(scenario.start_speed_mps or 9.0, 20.0))
    nearest = min(oncoming, key=abs, default=None)
    return Surroundings(cruise, width_m, 1.0 if left else -1.0, nearest, tuple(sorted(junctions)))


def run(case: Case, *, steps: int = 300, twin: bool = True, twice: bool = False) -> Outcome:
    """Drive a case and look for violations; with a `twin`, where nobody meets the ego, also for those that need one.

    What is bit by bit as in plain SUMO, where nothing of ours acts, is named so.
    """
    found = Outcome()
    roads = load_roads(case.scenario.map, case.scenario.maps_beside)
    steps = min(steps, round(case.scenario.duration_s * 10))
    egos = found.egos = egos_of(case, roads, steps)
    first = _recorded(case, roads, egos, found, EgoPresence.DRIVES)
    if first is None:
        return found
    found.drive, bodies, placed, begins, ends, found.hash = first
    found.types = {name: body.type_id for name, body in bodies.items()}
    found.agent_s = float(found.drive.there[:, [name in bodies for name in found.drive.ids]].sum()) * 0.1
    found.violations += invariants.violations(
        found.drive, bodies, standing=placed["standing"], walking=placed["walking"], map_begins=begins, map_ends=ends
    )
    if twin:
        without = _recorded(case, roads, egos, found, EgoPresence.UNSEEN)
        if without is not None:
            found.twin, twin_bodies = without[0], without[1]
            if not any(each in case.drivers.split() for each in BRAKE_ANYWAY):
                found.violations += _bad_starts(case, roads, egos, found, twin_bodies)
            if not _by_chance(case):
                found.violations += twin_invariants.reactions_to_what_is_behind(
                    found.drive, found.twin, bodies, found.giving_way
                )
            found.violations += [
                replace(each, kind=f"without_ego_{each.kind}")
                for each in invariants.violations(
                    found.twin, twin_bodies, standing=placed["standing"], walking=placed["walking"],
                    map_begins=begins, map_ends=ends,
                )
                if not each.kind.startswith(("appears", "leaves"))
            ]  # fmt: skip
    if any(each.agent for each in found.violations):
        plain = _recorded(case, roads, egos, found, EgoPresence.ABSENT)
        if plain is not None:
            found.violations = [
                replace(each, kind=f"in_plain_sumo_{each.kind}")
                if not each.kind.startswith(OUR_OWN)
                and twin_invariants.same(found.drive, plain[0], each.agent.split("+"), each.frame)
                else each
                for each in found.violations
            ]
    if twice:
        again = _recorded(case, roads, egos, found, EgoPresence.DRIVES)
        if again is not None and again[5] != found.hash:
            found.violations.append(Violation("not_repeatable", 0, "", 0.0, "two equal runs differ"))
    return found


def _bad_starts(
    case: Case, roads: Roads, egos: list[EgoState], found: Outcome, bodies: Mapping[str, Body]
) -> list[Violation]:
    """Agents that brake hard in the twin as soon as they are there, but not for pedestrians that set out just then.

    Whose start was bad brakes as well in a third run, in which an ego without speed sets nobody off.
    """
    hard = list(twin_invariants.spawn_braking(found.twin, bodies)) if found.twin is not None else []
    if hard and case.scenario.jaywalkers:
        still = [replace(each, vx_mps=0.0, vy_mps=0.0) for each in egos]
        waiting = _recorded(case, roads, still, found, EgoPresence.UNSEEN)
        if waiting is not None:
            mild = set(waiting[0].ids) - {each.agent for each in twin_invariants.spawn_braking(waiting[0], waiting[1])}
            hard = [each for each in hard if each.agent not in mild]
    return hard


def _by_chance(case: Case) -> bool:
    """Whether drivers brake by chance."""
    words, text = case.drivers.split(), case.types.read_text()
    dawdle = STEADY not in words and any(each in words for each in DAWDLING)
    return dawdle or any(f'carFollowModel="{each}"' in text for each in (RANDOM_BRAKING, ERRING))


_Recorded = tuple[Drive, dict[str, Body], dict[str, frozenset[str]], Array, Array, str]


def _recorded(
    case: Case, roads: Roads, egos: list[EgoState], found: Outcome, presence: EgoPresence
) -> _Recorded | None:
    """Frames of one drive; None, and a violation in `found`, if it ended in an exception before the first frame."""
    recorder = FrameRecorder(case.scenario.map, case.scenario.maps_beside)
    begins = ends = np.zeros((0, 2))
    digest = hashlib.sha256()
    kind = "exception" if presence is EgoPresence.DRIVES else "without_ego_exception"
    try:
        with open_sumo_traffic(
            case.scenario, roads, seed=case.seed, vehicle_types=case.types, presence=presence
        ) as traffic:
            begins, ends = recorder.map_ends()
            for k in range(len(egos) - 1):
                frame = recorder.note(traffic.observe(), egos[k], frozenset(traffic.behaviours))
                if presence is EgoPresence.DRIVES:
                    names = recorder.sumo_names
                    found.giving_way |= {(k, name) for name in frame.ids if _gives_way(names.get(name))}
                for column in (frame.x_m, frame.y_m, frame.heading_rad, frame.speed_mps):
                    digest.update(np.ascontiguousarray(column).tobytes())
                digest.update(" ".join(frame.ids).encode())
                traffic.react(egos[k])
                traffic.place_ego(egos[k + 1])
                traffic.advance()
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        text = f"{type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})"
        found.violations.append(Violation(kind, len(recorder.frames), "", 0.0, text))
    if not recorder.frames:
        return None
    walking = frozenset(recorder.walking if case.scenario.jaywalkers else ())
    placed = {"standing": frozenset(recorder.standing | recorder.walking) - walking, "walking": walking}
    bodies = invariants.erring(recorder.bodies, case.types.read_text())
    return recorder.drive(), bodies, placed, begins, ends, digest.hexdigest()


def _gives_way(name: str | None) -> bool:
    """Whether SUMO's car wants to change lane and may not because of who is behind it there."""
    if name is None or not libsumo.vehicle.getLaneID(name):
        return False
    return any(libsumo.vehicle.getLaneChangeState(name, side)[0] & BLOCKED_BY_FOLLOWER for side in (-1, 1))
