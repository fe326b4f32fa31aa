"""Cars: the background cars of a drive in the place of its ego: their own motion, everyone else around them.

SUMO drives them, and so they take no part in what our planners do well or
badly. Only stretches that a car can have driven are used.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.dataset.motion import body, ego_track, roadworthy, rolled, smoothed
from interplan_sumo.features.schema import FUTURE_FRAMES, HISTORY_FRAMES, LONG_VEHICLE_M, STEP_S
from interplan_sumo.scenario.recorded import ego_scene
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.geometry import Floats, Ints, box_corners, penetration_m
from interplan_sumo.world.recording import RecordedTrack, Recording
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import ActorTable, Trace

SUMO: Final = "sumo"
"""Stands for the planner of a background car."""
EGO: Final = "ego"
"""Among the actors, the ego of the drive."""
SHORTEST_M: Final = 3.5
"""Shorter vehicles are motorcycles."""
BEYOND_M: Final = 100.0
"""The way of a car goes on so far beyond its last place: where it ends says nothing of how far the car got."""
MATCHED_FRAMES: Final = 3
"""Places so many frames apart tell which lanes it follows."""
TOUCH_M: Final = 0.05
"""Boxes that overlap by less only touch."""
_COLUMNS: Final = ("frame", "ids", "kind", "x_m", "y_m", "heading_rad", "length_m", "width_m", "vx_mps", "vy_mps",
                   "behaviour")  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class CarDrive:
    """A background car as the ego of a trace, and which of its frames can be used."""

    token: str
    first_frame: int
    """Of the drive in which it drove; the trace begins there."""
    trace: Trace
    good: NDArray[np.bool_]
    """(F,) whether it moved as a car can, and free of others."""
    slid_mps: float
    """Largest speed to the side at which SUMO drew it: it changed lane if that is not next to nothing."""

    @property
    def samples(self) -> Ints:
        """The frames with 2 s before and 8 s after them that are all good."""
        bad = np.concatenate(([0], np.cumsum(~self.good)))
        frames = np.arange(HISTORY_FRAMES - 1, len(self.good) - FUTURE_FRAMES)
        return frames[bad[frames + FUTURE_FRAMES + 1] == bad[frames - HISTORY_FRAMES + 1]]


class Cars:
    """The background cars of one drive."""

    def __init__(self, trace: Trace) -> None:
        self._trace = trace

    @cached_property
    def tokens(self) -> tuple[str, ...]:
        """Those of a car's size that are there long enough for a sample, in order of their ids."""
        table = self._everyone
        kept = (table.kind == ActorKind.VEHICLE) & (table.length_m >= SHORTEST_M) & (table.length_m < LONG_VEHICLE_M)
        ids, counts = np.unique(table.ids[kept & (table.ids != EGO)].astype(str), return_counts=True)
        return tuple(ids[counts >= HISTORY_FRAMES + FUTURE_FRAMES].tolist())

    def drive(self, token: str) -> CarDrive:
        """The drive of one car, over the frames in which it is there; all others are around it, the ego too."""
        table = self._everyone
        own = np.flatnonzero(table.ids == token)
        first, last = int(table.frame[own[0]]), int(table.frame[own[-1]]) + 1
        recorded = np.stack((table.x_m[own], table.y_m[own], table.heading_rad[own]), axis=1)
        shape = body(float(table.length_m[own[0]]), float(table.width_m[own[0]]))
        places = smoothed(recorded[:, :2])
        poses = np.column_stack((places, rolled(places, float(recorded[0, 2]), shape)))
        track = ego_track(self._trace.ego.time_us[first:last], poses, shape)
        inside = (table.frame >= first) & (table.frame < last) & (table.ids != token)
        others = _rows(table, np.flatnonzero(inside), first, last)
        trace = Trace(track, others, self._trace.signals[first:last], (), np.zeros(0), shape)
        return CarDrive(token, first, trace, roadworthy(track, recorded) & ~_touched(trace), _slid_mps(recorded))

    @cached_property
    def _everyone(self) -> ActorTable:
        """All actors and the ego, ordered by frame and then by id."""
        actors, ego, shape = self._trace.actors, self._trace.ego, self._trace.shape
        count = len(ego)
        vx, vy = ego.vx_mps * np.cos(ego.heading_rad), ego.vx_mps * np.sin(ego.heading_rad)
        added: tuple[NDArray[Any], ...] = (
            np.arange(count), np.full(count, EGO, dtype=object), np.full(count, ActorKind.VEHICLE, dtype=np.int8),
            ego.x_m, ego.y_m, ego.heading_rad, np.full(count, shape.length_m), np.full(count, shape.width_m), vx, vy,
            np.full(count, "", dtype=object),
        )  # fmt: skip
        columns: list[NDArray[Any]] = [
            np.concatenate((getattr(actors, name), values)) for name, values in zip(_COLUMNS, added, strict=True)
        ]
        order = np.lexsort((np.unique(columns[1].astype(str), return_inverse=True)[1], columns[0]))
        frame = columns[0][order]
        return ActorTable(*(column[order] for column in columns), starts=np.searchsorted(frame, np.arange(count + 1)))


def way_of(drive: CarDrive, host: Scenario, roads: Roads) -> Scenario:
    """The scenario in which a car drives where the ego of `host` did: its start, and a way along its lanes.

    The goal lies beyond its last place, straight on. ScenarioError if it does not follow the lanes.
    """
    ego, shape = drive.trace.ego, drive.trace.shape
    poses = np.stack((ego.x_m, ego.y_m, ego.heading_rad), axis=1)
    velocity = ego.vx_mps[:, None] * np.stack((np.cos(ego.heading_rad), np.sin(ego.heading_rad)), axis=1)
    some = slice(None, None, MATCHED_FRAMES)
    track = RecordedTrack(drive.token, ActorKind.VEHICLE, shape.length_m, shape.width_m, 0, poses[some], velocity[some])
    recording = Recording(host.id, roads.crs, MATCHED_FRAMES * STEP_S, (track,), drive.token)
    went_m = float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum())
    bare, *_ = ego_scene(
        recording, roads, ego_id=None, at_s=0.0, agents="replayed", goal_m=went_m + BEYOND_M, duration_s=None
    )
    return replace(host, start=bare.start, start_speed_mps=bare.start_speed_mps, goal=bare.goal, route=bare.route)


def _rows(table: ActorTable, rows: Ints, first: int, last: int) -> ActorTable:
    """Some rows, which lie in the frames from `first` to before `last`; these are counted from 0 then."""
    columns = {name: getattr(table, name)[rows] for name in _COLUMNS}
    columns["frame"] = columns["frame"] - first
    return ActorTable(**columns, starts=np.searchsorted(columns["frame"], np.arange(last - first + 1)))


def _slid_mps(poses: Floats) -> float:
    """Largest speed of poses (F, 3) across their headings."""
    went, heading = np.diff(poses[:, :2], axis=0), poses[:-1, 2]
    return float(np.abs(went[:, 1] * np.cos(heading) - went[:, 0] * np.sin(heading)).max(initial=0.0)) / STEP_S


def _touched(trace: Trace) -> NDArray[np.bool_]:
    """(F,) whether the box of the ego overlaps one of anybody else."""
    ego, shape, actors = trace.ego, trace.shape, trace.actors
    at = actors.frame
    reach_m = (np.hypot(actors.length_m, actors.width_m) + np.hypot(shape.length_m, shape.width_m)) / 2.0
    near = np.flatnonzero(np.hypot(actors.x_m - ego.x_m[at], actors.y_m - ego.y_m[at]) < reach_m)
    touched = np.zeros(len(ego), dtype=np.bool_)
    if len(near):
        boxes = box_corners(actors.x_m[near], actors.y_m[near], actors.heading_rad[near], actors.length_m[near],
                            actors.width_m[near])  # fmt: skip
        overlap_m: Floats = penetration_m(ego.corners(shape)[at[near]], boxes)
        touched[at[near[overlap_m > TOUCH_M]]] = True
    return touched
