"""Scenes of nuPlan's logs: which moments, on which map, from a user's own copy of the data set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from interplan_sumo.errors import InputError, UnknownNameError
from interplan_sumo.maps.store import MANIFEST, MapFiles, find_map, maps
from interplan_sumo.recordings.nuplan_db import WINDOW_S, LogMoment, NuplanLog
from interplan_sumo.scenario.recorded import RecordedScene
from interplan_sumo.verification.recorded_scenes import Moments, scenes_of
from interplan_sumo.world.recording import Recording

APART_S: Final = 20.0
"""Moments with the same tag are taken this far apart: a tag marks every sweep of what may last long."""


@dataclass(frozen=True, slots=True)
class Picked:
    """Which moments of a log; where nothing is named, its beginning."""

    tokens: tuple[str, ...] = ()
    tags: tuple[str, ...] = ()
    count: int = 1
    """Of each tag."""
    at_s: tuple[float, ...] = ()
    """Since the log began."""


def nuplan_scenes(
    source: Path, map: str, picked: Picked, moments: Moments, folder: Path, *, overwrite: bool = False
) -> tuple[list[RecordedScene], tuple[str, ...]]:
    """The scenes of a log and what there is to say about it, on a part of the map in `folder` as `recorded_scenes`.

    `map` is a map that was imported, one of nuPlan's, or the folder of all of
    them. InputError if log, map or moments cannot be used.
    """
    with NuplanLog(source) as log:
        files = log_map(map, log.map_name)
        recordings = [log.recording(moment, moments.duration_s or WINDOW_S) for moment in picked_moments(log, picked)]
    begins = replace(moments, at_s=(0.0,))  # every recording begins at its moment
    scenes = scenes_of(recordings, files, begins, folder, overwrite=overwrite)
    return scenes, _notes(recordings)


def log_map(map: str, location: str) -> MapFiles:
    """The map that a name or folder means for a log of this location; UnknownNameError if there is none.

    A folder that holds nuPlan's manifest, or one named after the location, is
    the root of all maps.
    """
    root = Path(map).expanduser()
    if (root / MANIFEST).is_file():
        held = maps(root)
        if location not in held:
            raise UnknownNameError("map", location, held, f"The log was recorded there; {root} lacks it.")
        return held[location]
    return find_map(root / location if (root / location).is_dir() else map)


def picked_moments(log: NuplanLog, picked: Picked) -> list[LogMoment]:
    """The moments of a log, each once, in order of time; InputError if one is not there."""
    if picked.count < 1:
        raise InputError(f"count is {picked.count}, expected 1 or more")
    found = [log.moment(token) for token in picked.tokens]
    for tag in picked.tags:
        found += _apart(log.moments_tagged(tag))[: picked.count]
    found += [log.moment_at(at_s) for at_s in picked.at_s]
    return sorted(set(found or [log.moment_at(0.0)]), key=lambda moment: moment.at_s)


def _apart(moments: Sequence[LogMoment]) -> list[LogMoment]:
    """The first, and each that lies far enough behind the one before."""
    kept: list[LogMoment] = []
    for moment in moments:
        if not kept or moment.at_s - kept[-1].at_s >= APART_S:
            kept.append(moment)
    return kept


def _notes(recordings: Sequence[Recording]) -> tuple[str, ...]:
    """What the recordings have to say, each with the moment that it is about where there are several."""
    if len(recordings) == 1:
        return recordings[0].notes
    return tuple(f"{recording.ego_id}: {note}" for recording in recordings for note in recording.notes)
