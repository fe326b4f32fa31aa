"""Recorded drives: what the car that measured did, out of nuPlan's logs and other recordings, as drives to export.

A log is taken in windows. Within a window all is as in a drive of the
benchmark with replayed agents: the same route, lights and road users.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np

from interplan_sumo.dataset.motion import body, ego_track, smoothed
from interplan_sumo.errors import InputError, ScenarioError
from interplan_sumo.features.schema import FUTURE_FRAMES, HISTORY_FRAMES, STEP_S
from interplan_sumo.maps.store import MapFiles, load_roads
from interplan_sumo.recordings.formats import RECORDING_FORMATS, format_of
from interplan_sumo.scenario.recorded import replayed_track, scene
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.setup import open_traffic
from interplan_sumo.verification.map_bundling import own_maps_root
from interplan_sumo.verification.recorded_scenes import SceneFormat, recorded_map
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.recording import RecordedTrack, Recording
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import ActorTable, Trace

RECORDED: Final = "recorded"
"""Stands for the planner: whoever drove the car that measured."""
APART_S: Final = 20.0
"""Between the beginnings of windows; their samples do not overlap."""
WINDOW_S: Final = APART_S + (HISTORY_FRAMES - 1 + FUTURE_FRAMES) * STEP_S
BEYOND_M: Final = 100.0
"""The route goes on so far beyond the last place: where it ends says nothing of how far the car got."""


@dataclass(frozen=True, slots=True)
class Window:
    """A stretch of a recording."""

    path: Path
    format: str
    at_s: float | None
    """Since a log began; None of a recording that is one window."""
    map: MapFiles


def windows(source: Path, map: str) -> list[Window]:
    """The windows of a recording, or of all logs in a folder; `map` as `scenarios import` takes it.

    InputError if nothing can be read.
    """
    name = format_of(source)
    kind = RECORDING_FORMATS[name]
    if isinstance(kind, SceneFormat):
        raise InputError(f"{source} is {kind.title}, no recording; give the recordings themselves")
    if kind.lasts is None:
        return [Window(source, name, None, recorded_map(map, None))]
    files = sorted(path for path in source.rglob("*") if path.is_file() and kind.matches(path))
    return [window for path in (files or [source]) for window in _of_log(path, name, *kind.lasts(path), map)]


def window_drive(window: Window) -> tuple[Scenario, Roads, Trace]:
    """The drive of a window; ScenarioError if the car that measured did not follow the lanes, or nobody is around.

    InputError if the recording is not of the map, or does not say which car measured: it holds no drive at all.
    """
    roads = load_roads(window.map.folder)
    recording = _recording(window)
    if recording.ego_id is None:
        raise InputError(f"{window.path} does not say which car measured: nobody is there to learn from")
    if recording.crs != roads.crs:
        raise InputError(
            f"{window.path} is in {recording.crs}, map {roads.name} in {roads.crs}; give the map that belongs to it"
        )
    ego = next((track for track in recording.tracks if track.id == recording.ego_id), None)
    went_m = 0.0 if ego is None else float(np.hypot(*np.diff(ego.poses[:, :2], axis=0).T).sum())
    made = scene(recording, roads, agents="replayed", goal_m=went_m + BEYOND_M).scenario
    assert ego is not None  # a scene needs one
    trace = _trace(made, roads, recording, ego)
    return made, roads, trace


def window_frames(window: Window, trace: Trace, every_frames: int) -> range:
    """The frames of a window that become samples: 2 s after its beginning, up to where the next window's begin.

    Of a recording that is one window, up to 8 s before its end.
    """
    last = len(trace) - FUTURE_FRAMES
    if window.at_s is not None:
        last = min(last, round(APART_S / STEP_S) + HISTORY_FRAMES - 1)
    return range(HISTORY_FRAMES - 1, last, every_frames)


def maps_beside(window: Window) -> Path | None:
    """The maps root in which a scenario of a window finds its map, if that is not shipped."""
    return own_maps_root(window.map)


def _of_log(path: Path, name: str, lasts_s: float, location: str, map: str) -> Iterator[Window]:
    files = recorded_map(map, location)
    at_s = 0.0
    while at_s + (HISTORY_FRAMES + FUTURE_FRAMES) * STEP_S <= lasts_s:
        yield Window(path, name, at_s, files)
        at_s += APART_S


@lru_cache(maxsize=1)
def _recording(window: Window) -> Recording:
    asked = {} if window.at_s is None else {"at": (window.at_s,), "duration": WINDOW_S}
    read = RECORDING_FORMATS[window.format].read(window.path, **asked)
    return read if isinstance(read, Recording) else read[0]


def _trace(scenario: Scenario, roads: Roads, recording: Recording, ego: RecordedTrack) -> Trace:
    """The drive from where the scenario begins, as long as it lasts and the ego is there."""
    poses = _poses(recording, ego, round(scenario.duration_s / STEP_S) + 1)
    shape = body(ego.length_m, ego.width_m)
    time_us = np.arange(len(poses)) * round(STEP_S * 1e6)
    scenes = []
    with open_traffic(scenario, roads) as traffic:
        for _ in poses:
            scenes.append(traffic.observe())
            traffic.advance()
    actors = ActorTable.of([each.actors for each in scenes])
    signals = tuple(each.signals for each in scenes)
    return Trace(ego_track(time_us, poses, shape), actors, signals, (), np.zeros(0), shape)


def _poses(recording: Recording, ego: RecordedTrack, steps: int) -> Floats:
    """(F, 3) smoothed poses of the ego 0.1 s apart; ScenarioError if it is not there from the start on."""
    found = replayed_track(ego, recording.step_s, recording.start_step, steps)
    if isinstance(found, str) or found.first_step:
        raise ScenarioError(f"recording {recording.name}: track {ego.id} is not there from the start on")
    return smoothed(np.column_stack((found.x_m, found.y_m, np.unwrap(found.heading_rad))))
