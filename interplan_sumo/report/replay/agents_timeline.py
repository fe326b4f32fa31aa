"""Agents timeline: everything that moves or stands in a drive, frame by frame."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.batch.stored_drive import StoredDrive
from interplan_sumo.report.replay.numbers import PER_METRE, PER_UNIT, Whole, angles, column, points
from interplan_sumo.scenario.jaywalking import trigger_distance_m, walk
from interplan_sumo.scenario.scenario import OBSTACLES, Scenario
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.geometry import Floats, Ints, Polyline, Pose
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import SEEN_BEFORE, ActorTable, EgoTrack, Trace

SIGHT_M: Final = 130.0
"""What never comes nearer to the ego is left out; planners see 100 m."""
PLAN_STEP_S: Final = 0.5
"""Between the points of a plan that are shown."""
MOVING_MPS: Final = 0.05
SAME_PLACE_M: Final = 0.3
BUS_LENGTH_M: Final = 10.0
TRUCK_LENGTH_M: Final = 6.5
MOTORCYCLE_WIDTH_M: Final = 1.2


def ego(trace: Trace, origin: Floats) -> dict[str, Any]:
    """The ego's box and its columns: x, y, heading."""
    return {
        "length_m": trace.shape.length_m,
        "width_m": trace.shape.width_m,
        **_path(trace.ego.x_m, trace.ego.y_m, trace.ego.heading_rad, origin),
    }


def expert(track: EgoTrack, times_us: Ints, origin: Floats) -> dict[str, Any]:
    """The expert's columns at the times of a drive's frames; it stays where it ends."""
    if not len(track):
        return _path(np.zeros(0), np.zeros(0), np.zeros(0), origin)
    since_us, at_us = track.time_us - track.time_us[0], times_us - times_us[0]
    x_m, y_m, heading_rad = (
        np.interp(at_us, since_us, values) for values in (track.x_m, track.y_m, np.unwrap(track.heading_rad))
    )
    return _path(x_m, y_m, heading_rad, origin)


def agents(drive: StoredDrive, origin: Floats) -> list[dict[str, Any]]:
    """Every stretch of frames in which an actor is there, in the order of ids.

    Each has `id`, `kind` (a word for people), `behaviour` (or ""), `look` (what
    decides its colour), its size, its first frame, how many there are, and
    columns: x, y, heading, speed.
    """
    trace, table = drive.trace, drive.trace.actors
    staged = _staged(drive.scenario, drive.roads)
    found: list[dict[str, Any]] = []
    for rows in _stretches(table):
        first = int(rows[0])
        away_m = np.hypot(
            table.x_m[rows] - trace.ego.x_m[table.frame[rows]], table.y_m[rows] - trace.ego.y_m[table.frame[rows]]
        )
        if away_m.min() > SIGHT_M:
            continue
        look, word = _look(table, rows, staged)
        speed_mps = np.hypot(table.vx_mps[rows], table.vy_mps[rows])
        found.append(
            {
                "id": str(table.ids[first]),
                "kind": word,
                "behaviour": str(table.behaviour[first]),
                "look": look,
                "length_m": round(float(table.length_m[first]), 2),
                "width_m": round(float(table.width_m[first]), 2),
                "first": int(table.frame[first]),
                "frames": len(rows),
                **_path(table.x_m[rows], table.y_m[rows], table.heading_rad[rows], origin),
                "speed": column(speed_mps, PER_UNIT),
            }
        )
    return found


def seen(trace: Trace, origin: Floats) -> list[dict[str, Any]]:
    """Every stretch of frames in which the planner saw an actor, where its perception was not `full`.

    Each has `id`, its size, its first frame, how many there are, and columns: x, y, heading.
    """
    table = trace.seen
    if table is None:
        return []
    started = table.frame >= SEEN_BEFORE
    found: list[dict[str, Any]] = []
    for rows in (stretch[started[stretch]] for stretch in _stretches(table)):
        if len(rows):
            first = int(rows[0])
            found.append(
                {
                    "id": str(table.ids[first]),
                    "length_m": round(float(table.length_m[first]), 2),
                    "width_m": round(float(table.width_m[first]), 2),
                    "first": int(table.frame[first]) - SEEN_BEFORE,
                    "frames": len(rows),
                    **_path(table.x_m[rows], table.y_m[rows], table.heading_rad[rows], origin),
                }
            )
    return found


def plans(trace: Trace, origin: Floats) -> list[Whole]:
    """Each plan as points: now, every `PLAN_STEP_S` from now, and its end; a last one that was refused is missing."""
    found: list[Whole] = []
    for plan in trace.plans[: len(trace)]:
        at_s = np.append(np.arange(plan.time_s[0], plan.time_s[-1], PLAN_STEP_S), plan.time_s[-1])
        found.append(points(plan.poses_at(at_s)[:, :2], origin))
    return found


def triggers(drive: StoredDrive, route: Polyline, origin: Floats) -> list[dict[str, Any]]:
    """Of each jaywalker who still waits: where the ego's front must be, at its speed of each frame, to set it off.

    `frame` is that of the first step, None if it never came; `x`, `y` and `heading` are columns up to it.
    """
    ego_track = drive.trace.ego
    speed_mps = np.hypot(ego_track.vx_mps, ego_track.vy_mps)
    found: list[dict[str, Any]] = []
    for jaywalker in drive.scenario.jaywalkers:
        way = walk(jaywalker, drive.roads, route)
        frame = set_off(drive.trace, way.start)
        until = len(drive.trace) if frame is None else max(frame, 1)
        ahead_m = [way.conflict_m - trigger_distance_m(each) for each in speed_mps[:until].tolist()]
        poses = route.poses_at(np.array(ahead_m))
        found.append(
            {
                "frame": frame,
                "way": points(way.points, origin),
                **_path(poses[:, 0], poses[:, 1], poses[:, 2], origin),
            }
        )
    return found


def set_off(trace: Trace, start: tuple[float, float]) -> int | None:
    """The first frame in which the pedestrian who waited at a place walks."""
    table = trace.actors
    if not len(table):
        return None
    people = table.kind == ActorKind.PEDESTRIAN
    here = np.hypot(table.x_m - start[0], table.y_m - start[1]) < SAME_PLACE_M
    waiting = np.flatnonzero(people & here & (table.frame == table.frame[0]))
    if not len(waiting):
        return None
    mine = table.ids == table.ids[int(waiting[0])]
    moving = np.flatnonzero(mine & (np.hypot(table.vx_mps, table.vy_mps) > MOVING_MPS))
    return int(table.frame[moving[0]]) if len(moving) else None


def standing_rows(actors: ActorTable) -> NDArray[np.bool_]:
    """(R,) which rows belong to what never moves and is nobody's car."""
    rows: dict[str, list[int]] = {}
    for row, name in enumerate(actors.ids):
        rows.setdefault(name, []).append(row)
    still = np.zeros(len(actors), dtype=np.bool_)
    for of_one in rows.values():
        places = np.stack((actors.x_m[of_one], actors.y_m[of_one], actors.heading_rad[of_one]))
        still[of_one] = not actors.behaviour[of_one[0]] and bool((np.ptp(places, axis=1) < 1e-6).all())
    return still


# --- who it is -----------------------------------------------------------------------------------


def _staged(scenario: Scenario, roads: Roads) -> list[tuple[ActorKind, Pose, str, str]]:
    """What was staged and could be taken for traffic: kind, place, what decides its colour, and a word for it."""
    found: list[tuple[ActorKind, Pose, str, str]] = []
    for i, obstacle in enumerate(scenario.obstacles):
        kind = OBSTACLES[obstacle.kind][0]
        if kind is ActorKind.VEHICLE:
            look = "hiding" if i == scenario.occluder else "standing"
            found.append((kind, obstacle.pose(roads), look, f"parked {obstacle.kind}"))
        elif kind is ActorKind.PEDESTRIAN:
            found.append((kind, obstacle.pose(roads), "worker", obstacle.kind))
    return found


KIND_LOOKS: Final[Mapping[ActorKind, tuple[str, str]]] = {
    ActorKind.PEDESTRIAN: ("pedestrian", "pedestrian"),
    ActorKind.BICYCLE: ("bicycle", "bicycle"),
    ActorKind.TRAFFIC_CONE: ("cone", "traffic cone"),
    ActorKind.BARRIER: ("barrier", "barrier"),
    ActorKind.CZONE_SIGN: ("barrier", "construction sign"),
    ActorKind.GENERIC_OBJECT: ("object", "object"),
}
"""What decides the colour of whoever is no vehicle, and a word for it."""


def _look(table: ActorTable, rows: Ints, staged: Iterable[tuple[ActorKind, Pose, str, str]]) -> tuple[str, str]:
    """What decides the colour of the actor of these rows, and a word for it."""
    first = int(rows[0])
    kind = ActorKind(int(table.kind[first]))
    for other, pose, look, word in staged:
        if kind is other and np.hypot(table.x_m[first] - pose.x_m, table.y_m[first] - pose.y_m) < SAME_PLACE_M:
            return look, word
    if kind is ActorKind.VEHICLE:
        moves = np.any(np.hypot(table.vx_mps[rows], table.vy_mps[rows]) > MOVING_MPS) or table.behaviour[first]
        return (
            "vehicle" if moves else "standing",
            _vehicle_word(float(table.length_m[first]), float(table.width_m[first])),
        )
    return KIND_LOOKS[kind]


def _vehicle_word(length_m: float, width_m: float) -> str:
    """Traces tell vehicles apart by their size only."""
    if width_m < MOTORCYCLE_WIDTH_M:
        return "motorcycle"
    return "bus" if length_m >= BUS_LENGTH_M else "truck" if length_m >= TRUCK_LENGTH_M else "car"


def _stretches(table: ActorTable) -> list[Ints]:
    """Rows of each actor in successive frames, in the order of ids and then of time."""
    if not len(table):
        return []
    _, number = np.unique(table.ids.astype(str), return_inverse=True)
    order = np.lexsort((table.frame, number))
    breaks = (np.diff(number[order]) != 0) | (np.diff(table.frame[order]) != 1)
    return np.split(order, np.flatnonzero(breaks) + 1)


def _path(x_m: Floats, y_m: Floats, heading_rad: Floats, origin: Floats) -> dict[str, Whole]:
    return {
        "x": column(x_m - origin[0], PER_METRE),
        "y": column(y_m - origin[1], PER_METRE),
        "heading": angles(heading_rad),
    }
