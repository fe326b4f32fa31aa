"""Scenes of nuPlan's logs: a recording for each moment that is asked for, from a user's own copy of the data set."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from interplan_sumo.errors import InputError
from interplan_sumo.recordings.formats import RecordingFormat, head
from interplan_sumo.recordings.nuplan_db import WINDOW_S, LogMoment, NuplanLog
from interplan_sumo.world.recording import Recording

APART_S: Final = 20.0
"""Moments with the same tag are taken this far apart: a tag marks every sweep of what may last long."""


def read_nuplan_log(
    path: Path,
    *,
    at: Sequence[float] = (),
    token: Sequence[str] = (),
    tag: Sequence[str] = (),
    count: int = 1,
    duration: float = WINDOW_S,
) -> list[Recording]:
    """The pieces of a log that begin at times, tokens and the first `count` moments of each tag; else its beginning.

    InputError if the log or a moment cannot be used.
    """
    with NuplanLog(_file(path)) as log:
        return [log.recording(moment, duration) for moment in picked_moments(log, at, token, tag, count)]


def picked_moments(
    log: NuplanLog, at: Sequence[float] = (), token: Sequence[str] = (), tag: Sequence[str] = (), count: int = 1
) -> list[LogMoment]:
    """The moments of a log, each once, in order of time; InputError if one is not there."""
    if count < 1:
        raise InputError(f"count is {count}, expected 1 or more")
    found = [log.moment(each) for each in token]
    for each in tag:
        found += _apart(log.moments_tagged(each))[:count]
    found += [log.moment_at(at_s) for at_s in at]
    return sorted(set(found or [log.moment_at(0.0)]), key=lambda moment: moment.at_s)


def _apart(moments: Sequence[LogMoment]) -> list[LogMoment]:
    """The first, and each that lies far enough behind the one before."""
    kept: list[LogMoment] = []
    for moment in moments:
        if not kept or moment.at_s - kept[-1].at_s >= APART_S:
            kept.append(moment)
    return kept


def _file(path: Path) -> Path:
    """A log itself, or the only one of a folder."""
    if not path.is_dir():
        return path
    found = sorted(path.rglob("*.db"))
    if len(found) != 1:
        raise InputError(f"{path} holds {len(found)} logs; name one of them, such as {found[0] if found else 'X.db'}")
    return found[0]


def _lasts(path: Path) -> tuple[float, str]:
    with NuplanLog(_file(path)) as log:
        return log.lasts_s, log.map_name


def _is_log(path: Path) -> bool:
    """A database of SQLite that is no GeoPackage, or a folder that holds nuPlan's."""
    if path.is_dir():
        return any(path.rglob("*.db"))
    begin = head(path)
    return begin.startswith(b"SQLite format 3") and begin[68:72] != b"GPKG"


FORMAT = RecordingFormat(
    "a log of nuPlan", _is_log, read_nuplan_log, ("at", "token", "tag", "count", "duration"), _lasts
)
