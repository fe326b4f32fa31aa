"""What a recording is here: boxes of road users over time, read from the plain track form or any known format."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil
from pathlib import Path
from typing import Final, Literal, cast

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from interplan_sumo.errors import InputError
from interplan_sumo.recordings.formats import RECORDING_FORMATS, RecordingFormat, format_of
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.geometry import Floats, frozen
from interplan_sumo.world.recording import Recording

TrackKind = Literal["vehicle", "pedestrian", "bicycle"]
LONGEST_GAP_S: Final = 0.55
"""A road user unseen for longer goes on as another track: half a second, and the noise of time stamps."""
COLUMNS: Final = ("track", "type", "time_s", "x_m", "y_m", "heading_rad", "speed_mps", "length_m", "width_m")
"""Of the plain track form. Speeds may be missing, or NaN."""
KINDS: Final[dict[str, TrackKind]] = {"veh": "vehicle", "ped": "pedestrian", "bike": "bicycle"}
ACTOR_KINDS: Final[dict[ActorKind, TrackKind]] = {
    ActorKind.VEHICLE: "vehicle",
    ActorKind.PEDESTRIAN: "pedestrian",
    ActorKind.BICYCLE: "bicycle",
}
PART_S: Final = 100.0
"""Logs are read in parts of this length at most: what a car sees in it fits into memory."""
_MOST_ROWS: Final = 50_000_000
_FARTHEST_M: Final = 1e8
_LARGEST_M: Final = 40.0
"""No body on a road is longer."""


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """The box of one road user over time, as recorded: not smoothed, and in whatever frame the recording has.

    x and y are the box centre in metres, headings radians counter-clockwise
    from +x. Times rise, and leave no gap above `LONGEST_GAP_S`. Arrays are
    made read-only.
    """

    id: str
    kind: TrackKind
    time_s: Floats
    x_m: Floats
    y_m: Floats
    heading_rad: Floats
    speed_mps: Floats
    """NaN where the recording has none."""
    length_m: float
    width_m: float

    def __post_init__(self) -> None:
        for name in ("time_s", "x_m", "y_m", "heading_rad", "speed_mps"):
            array = frozen(getattr(self, name))
            if array.shape != np.shape(self.time_s) or array.ndim != 1 or not len(array):
                raise ValueError(f"Track.{name} of {self.id} has shape {array.shape}, expected {np.shape(self.time_s)}")
            object.__setattr__(self, name, array)
        if (np.diff(self.time_s) <= 0.0).any():
            raise ValueError(f"Track.time_s of {self.id} does not rise")


@dataclass(frozen=True, slots=True, eq=False)
class RecordedTraffic:
    """The road users of one recording."""

    name: str
    place: str
    """What recordings of the same street or city have in common."""
    tracks: tuple[Track, ...]


def open_recordings(paths: Sequence[Path]) -> tuple[RecordedTraffic, ...]:
    """Files, and all recordings in folders, in order; InputError."""
    return tuple(traffic for path in paths for traffic in open_recording(path))


def open_recording(path: Path) -> tuple[RecordedTraffic, ...]:
    """The plain track form, or whatever formats of recordings are known; InputError for anything else.

    A log of nuPlan is read from its beginning to its end, in parts of one length, `PART_S` at most. A folder that is
    no recording itself is all that are in it.
    """
    if is_plain(path):
        return (read_tracks(path),)
    if not path.exists():
        raise InputError(f"cannot read {path}: there is no such file or folder")
    within = _within(path) if path.is_dir() else []
    if within:
        return tuple(traffic for each in within for traffic in open_recording(each))
    name = _known_format(path)
    if name is None:
        raise InputError(
            f"{path} is no recording: neither a plain track file (Parquet with the columns {', '.join(COLUMNS)}) "
            f"nor of one of the formats {', '.join(RECORDING_FORMATS)}"
        )
    return tuple(_parts(path, RECORDING_FORMATS[name]))


def _within(folder: Path) -> list[Path]:
    """The recordings in a folder, in order, and Parquet files that may be none; nothing if it is one itself."""
    name = _known_format(folder)
    if name is not None and RECORDING_FORMATS[name].is_folder:
        return []
    return [each for each in sorted(folder.iterdir()) if each.suffix == ".parquet" or _known_format(each) is not None]


def _known_format(path: Path) -> str | None:
    try:
        return format_of(path)
    except InputError:
        return None


def _parts(path: Path, kind: RecordingFormat) -> Iterator[RecordedTraffic]:
    """A recording, or its scenes; a log in consecutive parts."""
    if kind.lasts is None:
        read = kind.read(path)
        yield from (of_recording(each) for each in ([read] if isinstance(read, Recording) else read))
        return
    lasts_s = kind.lasts(path)[0]
    count = max(1, ceil(lasts_s / PART_S))
    for part in range(count):
        at_s = part * lasts_s / count
        read = kind.read(path, at=(at_s,), duration=lasts_s / count)
        traffic = of_recording(_from_its_start(read if isinstance(read, Recording) else read[0]))
        yield traffic if count == 1 else replace(traffic, name=f"{traffic.name} from {at_s:.0f} s")


def _from_its_start(recording: Recording) -> Recording:
    """Without the past of the car that measured, which the part before has seen."""
    cut = [(each, max(recording.start_step - each.first_step, 0)) for each in recording.tracks]
    tracks = [
        replace(each, first_step=each.first_step + off, poses=each.poses[off:], velocity_mps=each.velocity_mps[off:])
        for each, off in cut
        if off < len(each.poses)
    ]
    return replace(recording, tracks=tuple(tracks))


def unbroken(id_: str, time_s: Floats) -> Iterator[tuple[str, slice]]:
    """The parts of a record between gaps above `LONGEST_GAP_S`, each with an id of its own."""
    bounds = [0, *(np.flatnonzero(np.diff(time_s) > LONGEST_GAP_S) + 1).tolist(), len(time_s)]
    for number, (begin, end) in enumerate(pairwise(bounds), start=1):
        yield (id_ if number == 1 else f"{id_}~{number}"), slice(begin, end)


def is_plain(path: Path) -> bool:
    """Whether a file is a Parquet file with the columns of the plain track form."""
    try:
        return path.is_file() and {*COLUMNS} - {"speed_mps"} <= {*pq.read_schema(path).names}
    except (OSError, pa.ArrowException, ValueError):
        return False


def read_tracks(path: Path) -> RecordedTraffic:
    """A file of the plain track form; InputError where it cannot be used."""
    table = _table(path)
    tracks = [track for id_, rows in table.groupby("track", sort=True) for track in _tracks(path, str(id_), rows)]
    return RecordedTraffic(path.stem, place_of(path.stem), tuple(tracks))


def of_recording(recording: Recording) -> RecordedTraffic:
    """The vehicles, pedestrians and bicycles of a recording that an importer has read."""
    tracks = [
        Track(
            id=each.id,
            kind=ACTOR_KINDS[each.kind],
            time_s=(each.first_step + np.arange(float(len(each.poses)))) * recording.step_s,
            x_m=each.poses[:, 0],
            y_m=each.poses[:, 1],
            heading_rad=each.poses[:, 2],
            speed_mps=np.hypot(*each.velocity_mps.T),
            length_m=each.length_m,
            width_m=each.width_m,
        )
        for each in recording.tracks
        if each.kind in ACTOR_KINDS
    ]
    return RecordedTraffic(recording.name, recording.map_name or place_of(recording.name), tuple(tracks))


def place_of(name: str) -> str:
    """The place that a name tells: without the numbers at its end, `fzi_k729_03` is of `fzi_k729`."""
    return re.sub(r"([_-]\d+)+$", "", name) or name


def _table(path: Path) -> pd.DataFrame:
    if not path.is_file():
        raise InputError(f"no recording at {path}")
    if not is_plain(path):
        raise InputError(f"{path} is no file of tracks: a Parquet file with the columns {', '.join(COLUMNS)}")
    try:
        with pq.ParquetFile(path) as file:
            if not 0 < file.metadata.num_rows <= _MOST_ROWS:
                raise InputError(f"{path}: has {file.metadata.num_rows} rows, expected 1 to {_MOST_ROWS}")
            names = [name for name in COLUMNS if name in file.schema_arrow.names]
            table = cast(pd.DataFrame, file.read(columns=names, use_threads=False).to_pandas())
        table = table.assign(track=table["track"].astype(str), type=table["type"].astype(str))
        numbers = [name for name in names if name not in ("track", "type")]
        table[numbers] = table[numbers].astype(np.float64)
    except (OSError, pa.ArrowException, ValueError, TypeError) as error:
        raise InputError(f"{path}: cannot be read as tracks ({' '.join(str(error).split())[:120]})") from None
    _check(path, table)
    return table if "speed_mps" in names else table.assign(speed_mps=np.nan)


def _check(path: Path, table: pd.DataFrame) -> None:
    sizes = table[["length_m", "width_m"]]
    for bad, what in (
        (~table["type"].isin(list(KINDS)), f"type is not one of {', '.join(KINDS)}"),
        (~(table["time_s"].abs() < 1e12), "time_s is no time"),
        (~(table[["x_m", "y_m"]].abs() < _FARTHEST_M).all(axis=1), f"x_m or y_m is not within {_FARTHEST_M:g} m"),
        (~(table["heading_rad"].abs() < 1e3), "heading_rad is no angle"),
        (~((sizes > 0.0) & (sizes < _LARGEST_M)).all(axis=1), f"length_m or width_m is not within 0 to {_LARGEST_M:g}"),
    ):
        if bad.any():
            row = int(np.argmax(bad.to_numpy()))
            raise InputError(f"{path}: row {row}, track {table['track'].iloc[row][:40]!r}: {what}")


def _tracks(path: Path, id_: str, rows: pd.DataFrame) -> Iterator[Track]:
    """One road user, cut where it was unseen for long. Of two boxes at one time the first is kept."""
    rows = rows.drop_duplicates("time_s").sort_values("time_s", kind="stable")
    if rows["type"].nunique() > 1:
        raise InputError(f"{path}: track {id_[:40]!r} is of several types: {', '.join(sorted(rows['type'].unique()))}")
    time_s = rows["time_s"].to_numpy()
    length_m, width_m = (float(rows[name].median()) for name in ("length_m", "width_m"))
    for name, part in unbroken(id_, time_s):
        columns = {column: rows[column].to_numpy()[part] for column in COLUMNS[2:7]}
        yield Track(name, KINDS[rows["type"].iloc[0]], **columns, length_m=length_m, width_m=width_m)
