"""Sources of traffic: run folders and traces of ours, fcd output of SUMO's, recordings; all as the same tracks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final, cast

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from interplan_sumo.batch.run_folder import MANIFEST, read_run
from interplan_sumo.errors import InputError
from interplan_sumo.realism.fcd import is_fcd, read_fcd
from interplan_sumo.realism.tracker_noise import NO_NOISE, TrackerNoise
from interplan_sumo.realism.tracks import ACTOR_KINDS, RecordedTraffic, Track, TrackKind, open_recordings

STEP_S: Final = 0.1
"""Between the frames of a trace."""
KINDS: Final[dict[str, TrackKind]] = {actor.name: kind for actor, kind in ACTOR_KINDS.items()}
ACTORS: Final = "actors.parquet"
_LARGEST: Final = 1e8
_COLUMNS: Final = ("frame", "track_token", "type", "x", "y", "heading", "length", "width", "vx", "vy")


@dataclass(frozen=True, slots=True)
class TrafficSource:
    """Where traffic comes from. What is read belongs together in one frame and time; several parts never meet."""

    name: str
    path: Path
    vehicle_types: Path | None = None
    """Of fcd output: the file that says how large its vehicles are."""

    def parts(self, noise: TrackerNoise = NO_NOISE) -> Iterator[RecordedTraffic]:
        """One for each trace, or recording, read one at a time; InputError names what cannot be used.

        What was simulated gets the noise of what it is compared with; a recording has its own.
        """
        path = self.path
        if (path / MANIFEST).is_file():
            yield from map(noise.on, _of_run(path))
        elif (path / ACTORS).is_file():
            yield noise.on(read_trace(path, self.name))
        elif is_fcd(path):
            yield noise.on(read_fcd(path, self.vehicle_types))
        else:
            yield from open_recordings([path])


def named_sources(paths: Sequence[Path], vehicle_types: Path | None = None) -> list[TrafficSource]:
    """Each under its own name, or where two have the same, its path."""
    names = [path.resolve().name for path in paths]
    return [
        TrafficSource(name if names.count(name) == 1 else str(path), path, vehicle_types)
        for path, name in zip(paths, names, strict=True)
    ]


def _of_run(path: Path) -> Iterator[RecordedTraffic]:
    """The drives of a run folder that left a trace, in the order of their rows."""
    traces = [row.trace for row in read_run(path).rows.values() if row.trace is not None]
    if not traces:
        raise InputError(f"{path} holds no trace yet; run something in it first")
    for trace in traces:
        yield read_trace(path / trace, trace)


def read_trace(folder: Path, name: str) -> RecordedTraffic:
    """The road users of a trace without its ego; InputError if it cannot be read."""
    try:
        table = cast(pd.DataFrame, pq.read_table(folder / ACTORS, columns=[*_COLUMNS], use_threads=False).to_pandas())
        table = table[table["type"].isin([*KINDS])]
        table = table.sort_values(["track_token", "frame"], kind="stable")
        numbers = {each: table[each].to_numpy(np.float64) for each in _COLUMNS if each not in ("track_token", "type")}
        ids, kinds = table["track_token"].astype(str).to_numpy(object), table["type"].astype(str).to_numpy(object)
        if not all((np.abs(column) < _LARGEST).all() for column in numbers.values()):
            raise ValueError("it holds a number that is none of traffic")
        if any((numbers[each] <= 0.0).any() for each in ("length", "width")):
            raise ValueError("it holds a box without a size")
        fresh = (np.diff(numbers["frame"]) != 1.0) | (ids[1:] != ids[:-1])
        bounds = [0, *(np.flatnonzero(fresh) + 1).tolist(), len(ids)] if len(ids) else []
        return RecordedTraffic(
            name,
            name,
            tuple(
                Track(
                    id=ids[a],
                    kind=KINDS[kinds[a]],
                    time_s=STEP_S * numbers["frame"][a:b],
                    x_m=numbers["x"][a:b],
                    y_m=numbers["y"][a:b],
                    heading_rad=numbers["heading"][a:b],
                    speed_mps=np.hypot(numbers["vx"][a:b], numbers["vy"][a:b]),
                    length_m=float(numbers["length"][a]),
                    width_m=float(numbers["width"][a]),
                )
                for a, b in pairwise(bounds)
            ),
        )
    except (OSError, pa.ArrowException, ValueError, TypeError, KeyError) as error:
        said = " ".join(str(error).split())[:200]
        raise InputError(f"cannot read {folder / ACTORS}: {said}; run the job again to write it anew") from None
