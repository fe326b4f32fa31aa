"""Argoverse 2 motion forecasting: `read_argoverse2_recording` makes a `Recording` of a `scenario_*.parquet`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from interplan_sumo.errors import InputError, UnknownNameError
from interplan_sumo.recordings.formats import RecordingFormat, head
from interplan_sumo.recordings.gaps import bridged, gap_notes, pieces
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.argoverse_frame import argoverse_name, city_frame, find_city
from interplan_sumo.world.geometry import Floats, Ints
from interplan_sumo.world.recording import RecordedTrack, Recording

STEP_S = 0.1
"""The set is sampled at 10 Hz."""
EGO_ID = "AV"
MAX_FILE_BYTES = 200 * 2**20
MAX_ROWS = 2_000_000
"""A scenario has some ten thousand rows."""
MAX_STEPS = 36_000
"""An hour; a scenario lasts 11 s."""
MAX_COORDINATE_M = 100_000.0
MAX_SPEED_MPS = 150.0
MAX_HEADING_RAD = 100.0

TEXTS = ("track_id", "object_type", "city")
NUMBERS = ("timestep", "position_x", "position_y", "heading", "velocity_x", "velocity_y")
SIZES_NOTE = "The format has no sizes: every road user has the usual size of its type."
ENDS_NOTE = "Positions are smoothed: near the ends of tracks they advance by {share:.0%} of what the velocities tell."
_ENDS = 5
"""Steps at either end of a track that the note looks at."""


@dataclass(frozen=True, slots=True)
class _Type:
    """What becomes of the road users of one type."""

    kind: ActorKind
    length_m: float
    width_m: float
    model: str = "car"


# Vehicles, pedestrians and things: medians of nuPlan's recordings. Buses and motorcycles: SUMO's defaults.
# Bicycles: what Argoverse's own drawings take. The recording car is a Ford Fusion.
_THING = _Type(ActorKind.GENERIC_OBJECT, 0.4, 0.4)
_EGO = _Type(ActorKind.VEHICLE, 4.87, 1.85)
TYPES = {
    "vehicle": _Type(ActorKind.VEHICLE, 4.8, 2.0),
    "bus": _Type(ActorKind.VEHICLE, 12.0, 2.5, "bus"),
    "motorcyclist": _Type(ActorKind.VEHICLE, 2.2, 0.9, "motorcycle"),
    "cyclist": _Type(ActorKind.BICYCLE, 2.0, 0.7),
    "pedestrian": _Type(ActorKind.PEDESTRIAN, 0.8, 0.75),
    "riderless_bicycle": _Type(ActorKind.GENERIC_OBJECT, 2.0, 0.7),
    "static": _THING,
    "background": _THING,
    "construction": _THING,
    "unknown": _THING,
}


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """The rows of a file, sorted by road user and step."""

    path: Path
    ids: NDArray[np.object_]
    types: NDArray[np.object_]
    city: str
    step: Ints
    poses: Floats
    """(N, 3) in city coordinates."""
    velocity_mps: Floats
    """(N, 2)"""

    def fault(self, row: int, what: str) -> NoReturn:
        raise InputError(f"{self.path}: track {self.ids[row]}, timestep {self.step[row]}: {what}")


def read_argoverse2_recording(path: Path) -> Recording:
    """The tracks of a `scenario_*.parquet`, or of the one in a folder, in the frame of `read_argoverse2`.

    Positions are box centres. The car that measured is the track "AV". Gaps of
    up to 0.5 s are filled along a straight line; after a longer one the road
    user goes on as "<id>~2". Raises InputError for a file that cannot be used.
    """
    rows = _rows(_recording_file(path))
    crs, origin_m = city_frame(rows.city)
    notes = [SIZES_NOTE]
    tracks = _tracks(rows, origin_m, notes)
    _note_ends(tracks, notes)
    return Recording(
        name=argoverse_name(rows.city, rows.path.stem.removeprefix("scenario_")),
        crs=crs,
        step_s=STEP_S,
        tracks=tuple(sorted(tracks, key=lambda track: track.id)),
        ego_id=EGO_ID if any(track.id == EGO_ID for track in tracks) else None,
        notes=tuple(notes),
    )


# --- tracks ----------------------------------------------------------------------------------------


def _tracks(rows: _Rows, origin_m: tuple[float, float], notes: list[str]) -> list[RecordedTrack]:
    starts = np.flatnonzero(np.append(True, rows.ids[1:] != rows.ids[:-1]))
    tracks: list[RecordedTrack] = []
    strange: set[str] = set()
    filled = 0
    for start, end in zip(starts.tolist(), [*starts[1:].tolist(), len(rows.ids)], strict=True):
        label, found = _type(rows, start, end)
        if label not in TYPES:
            strange.add(label)
        for id_, rows_of in pieces(rows.ids[start], rows.step[start:end]):
            piece = np.arange(start, end)[rows_of]
            track = _track(rows, piece, id_, found, origin_m)
            filled += len(track.poses) - len(piece)
            tracks.append(track)
    if strange:
        notes.append(f"Road users of the unknown type {', '.join(sorted(strange)[:5])} are taken for things.")
    notes.extend(gap_notes(filled, len(tracks) - len(starts)))
    return tracks


def _type(rows: _Rows, start: int, end: int) -> tuple[str, _Type]:
    """The type of the road user of some rows, by name and as what it becomes."""
    other = np.flatnonzero(rows.types[start:end] != rows.types[start])
    if len(other):
        row = start + int(other[0])
        rows.fault(row, f"object_type is {_brief(rows.types[row])}, before it was {_brief(rows.types[start])}")
    label = str(rows.types[start])
    return label, _EGO if rows.ids[start] == EGO_ID else TYPES.get(label, _THING)


def _track(rows: _Rows, piece: Ints, id_: str, found: _Type, origin_m: tuple[float, float]) -> RecordedTrack:
    """One track over consecutive steps, with the missing ones filled in."""
    seen = rows.step[piece]
    steps, poses = bridged(seen, rows.poses[piece])
    return RecordedTrack(
        id=id_,
        kind=found.kind,
        length_m=found.length_m,
        width_m=found.width_m,
        first_step=int(seen[0]),
        poses=poses + np.array((*origin_m, 0.0)),
        velocity_mps=np.stack([np.interp(steps, seen, v) for v in rows.velocity_mps[piece].T], axis=1),
        model=found.model,
    )


def _note_ends(tracks: Sequence[RecordedTrack], notes: list[str]) -> None:
    """Say by how much positions lag at the ends of tracks: published scenarios come smoothed there."""
    way_m = told_m = 0.0
    for track in tracks:
        if len(track.poses) > 4 * _ENDS:
            steps_m = np.hypot(*np.diff(track.poses[:, :2], axis=0).T)
            speed_mps = np.hypot(*(track.velocity_mps[1:] + track.velocity_mps[:-1]).T) / 2.0
            ends = np.r_[:_ENDS, -_ENDS:0]
            moving = ends[speed_mps[ends] > 2.0]
            way_m += float(steps_m[moving].sum())
            told_m += float(speed_mps[moving].sum()) * STEP_S
    if way_m < 0.9 * told_m:
        notes.append(ENDS_NOTE.format(share=way_m / told_m))


# --- the file --------------------------------------------------------------------------------------


def _recording_file(path: Path) -> Path:
    path = Path(path)
    if not path.is_dir():
        return path
    files = sorted(path.glob("scenario_*.parquet"))
    if len(files) != 1:
        raise InputError(f"{path}: holds {len(files) or 'no'} files scenario_*.parquet; name one file")
    return files[0]


def _rows(path: Path) -> _Rows:
    table = _table(path)
    texts = {name: _texts(path, table, name) for name in TEXTS}
    numbers = {name: _numbers(path, table, name) for name in NUMBERS}
    step = _steps(path, numbers["timestep"])
    order = np.lexsort((step, texts["track_id"].astype(str)))
    rows = _Rows(
        path=path,
        ids=texts["track_id"][order],
        types=texts["object_type"][order],
        city=_city(path, texts["city"]),
        step=step[order],
        poses=np.stack([numbers[name][order] for name in ("position_x", "position_y", "heading")], axis=1),
        velocity_mps=np.stack([numbers[name][order] for name in ("velocity_x", "velocity_y")], axis=1),
    )
    _check(rows)
    return rows


def _table(path: Path) -> pa.Table:
    if not path.is_file():
        raise InputError(f"no recording at {path}; Argoverse 2's are called scenario_*.parquet")
    if path.stat().st_size > MAX_FILE_BYTES:
        raise InputError(f"{path}: the file is larger than {MAX_FILE_BYTES >> 20} MB; it is no scenario")
    try:
        with pq.ParquetFile(path) as file:
            missing = [name for name in (*TEXTS, *NUMBERS) if name not in file.schema_arrow.names]
            if missing:
                raise InputError(f"{path}: column {missing[0]} is missing; it is no motion-forecasting scenario")
            if not 0 < file.metadata.num_rows <= MAX_ROWS:
                raise InputError(f"{path}: has {file.metadata.num_rows} rows, expected 1 to {MAX_ROWS}")
            return file.read(columns=[*TEXTS, *NUMBERS], use_threads=False)
    except (OSError, pa.ArrowException, ValueError) as error:
        raise InputError(f"{path}: not a Parquet file that can be read ({_brief(error)})") from error


def _texts(path: Path, table: pa.Table, name: str) -> NDArray[np.object_]:
    column = table.column(name)
    if not (pa.types.is_string(column.type) or pa.types.is_large_string(column.type)):
        raise InputError(f"{path}: column {name} holds {column.type}, expected text")
    try:
        values = np.array(column.to_pylist(), dtype=object)
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: column {name} holds no text ({_brief(error)})") from error
    row = _first(np.array([not (value and re.fullmatch(r"[\w.-]{1,64}", value)) for value in values]))
    if row is not None:
        raise InputError(f"{path}: row {row}: {name} is {_brief(values[row])}, expected a word")
    return values


def _numbers(path: Path, table: pa.Table, name: str) -> Floats:
    column = table.column(name)
    if not (pa.types.is_floating(column.type) or pa.types.is_integer(column.type)):
        raise InputError(f"{path}: column {name} holds {column.type}, expected numbers")
    values = column.to_pandas().to_numpy(dtype=np.float64)
    row = _first(~np.isfinite(values))
    if row is not None:
        raise InputError(f"{path}: row {row}: {name} is {values[row]}")
    return values


def _steps(path: Path, numbers: Floats) -> Ints:
    row = _first((numbers != np.round(numbers)) | (numbers < 0) | (numbers >= MAX_STEPS))
    if row is not None:
        raise InputError(f"{path}: row {row}: timestep is {numbers[row]:g}, expected 0 to {MAX_STEPS - 1}")
    return numbers.astype(np.int64)


def _city(path: Path, names: NDArray[np.object_]) -> str:
    if (names != names[0]).any():
        raise InputError(f"{path}: column city names more than one city")
    try:
        return find_city(str(names[0])).name
    except UnknownNameError as error:
        raise InputError(f"{path}: column city: {error}") from error


def _check(rows: _Rows) -> None:
    """That no road user is twice at a time, nor beyond the world, nor faster than anything on a road."""
    twice = np.append((rows.ids[1:] == rows.ids[:-1]) & (rows.step[1:] == rows.step[:-1]), False)
    position_m, heading_rad = np.abs(rows.poses[:, :2]).max(axis=1), np.abs(rows.poses[:, 2])
    for bad, what in (
        (twice, "appears twice"),
        (position_m > MAX_COORDINATE_M, f"position_x or position_y lies beyond {MAX_COORDINATE_M:g} m"),
        (heading_rad > MAX_HEADING_RAD, "heading is not in radians"),
        (np.abs(rows.velocity_mps).max(axis=1) > MAX_SPEED_MPS, f"its velocity is above {MAX_SPEED_MPS:g} m/s"),
    ):
        row = _first(bad)
        if row is not None:
            rows.fault(row, what)


def _first(rows: NDArray[np.bool_]) -> int | None:
    """The first row that is true."""
    return int(np.argmax(rows)) if rows.any() else None


def _brief(value: Any) -> str:
    """An error or a value in at most 120 characters on one line."""
    text = str(value) if isinstance(value, Exception) else repr(value)
    return " ".join(text.split())[:120]


def _is_scenario(path: Path) -> bool:
    """A Parquet file, or a folder that holds Argoverse's."""
    return any(path.glob("scenario_*.parquet")) if path.is_dir() else head(path).startswith(b"PAR1")


FORMAT = RecordingFormat("a scenario of Argoverse 2", _is_scenario, read_argoverse2_recording)
