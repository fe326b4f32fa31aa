"""Export: drives become a dataset: every drive by itself into a part, then the parts into shards."""

from __future__ import annotations

import contextlib
import hashlib
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import UNSET, UnsetType, convert, structs

from interplan_sumo.batch.engine import run_tasks
from interplan_sumo.batch.tasks import Answer, Limits, Publish, Task, Work
from interplan_sumo.batch.versions import versions
from interplan_sumo.dataset import folder as layout
from interplan_sumo.dataset.columns import count_of, joined, picked, read_arrays, write_arrays
from interplan_sumo.dataset.drives import (
    Chosen,
    Drive,
    DriveSelection,
    chosen_drives,
    driven,
    map_hash,
    source_hash,
)
from interplan_sumo.dataset.recorded import window_frames
from interplan_sumo.dataset.records import (
    SPLITS,
    CountsRecord,
    DatasetManifest,
    FeaturesRecord,
    FileRecord,
    MapRecord,
    OptionsRecord,
    OrdinaryRecord,
    Origin,
    ShardRecord,
    SourceRecord,
    Split,
    text_of,
)
from interplan_sumo.dataset.samples import LEAST_FUTURE_FRAMES, drive_samples
from interplan_sumo.errors import InputError, InterplanError, TrafficError
from interplan_sumo.features import schema
from interplan_sumo.features.lane_graph import lane_graph
from interplan_sumo.maps.store import load_roads
from interplan_sumo.world.files import file_hash

SHARD_SAMPLES = 512
_GROUP = "export"


@dataclass(frozen=True, slots=True)
class ExportRequest:
    """What to export, and where to."""

    folder: Path
    runs: tuple[Path, ...] = ()
    certificates: tuple[str, ...] = ()
    """Suites, as `name==version`."""
    recordings: tuple[Path, ...] = ()
    """Files of recordings, or folders of nuPlan's logs."""
    map: str = ""
    """Of the recordings: a map that was imported, or the folder of nuPlan's maps."""
    every_s: float = 0.5
    """Between the samples of a drive."""
    choice: DriveSelection = field(default_factory=DriveSelection)
    workers: int = 1
    """Processes; 0 works in this one."""
    shard_samples: int = SHARD_SAMPLES


@dataclass(frozen=True, slots=True)
class _Part:
    """Samples of one drive to be made."""

    number: int
    drive: Drive
    every_frames: int
    frames: tuple[int, ...] | None
    """None: all that are far enough apart and have enough ahead of them."""


@dataclass(frozen=True, slots=True)
class _Made:
    """What became of a part."""

    samples: int = 0
    situations: tuple[int, ...] = (0,) * len(schema.SITUATIONS)
    """How many samples show each."""


@dataclass(frozen=True, slots=True)
class _Shard:
    """A shard to be made from rows (first to last) of parts."""

    name: str
    split: Split
    pieces: tuple[tuple[int, int, int], ...]
    """Part, first row, row after the last."""

    @property
    def samples(self) -> int:
        return sum(last - first for _, first, last in self.pieces)


def export(request: ExportRequest, on_drive: Callable[[Drive, int, int], None] | None = None) -> DatasetManifest:
    """Write a dataset; its manifest. Equal drives and options give equal files, whatever the workers.

    `on_drive` is told of each drive that is done, how many are, and of how
    many. InputError for what cannot be used, TrafficError if SUMO fails: the
    folder is left unfinished then.
    """
    check(request)
    chosen = chosen_drives(request.runs, request.certificates, request.choice, request.recordings, request.map)
    return write(request, chosen, on_drive=on_drive)


def check(request: ExportRequest) -> None:
    """InputError if a number of the request cannot be."""
    frames_in(request.every_s)
    if request.workers < 0:
        raise InputError(f"workers is {request.workers}, expected 0 (in this process) or more")
    if request.shard_samples < 1:
        raise InputError(f"shard_samples is {request.shard_samples}, expected 1 or more")


def write(
    request: ExportRequest,
    chosen: Chosen,
    frames: Sequence[tuple[int, ...]] | None = None,
    ordinary: OrdinaryRecord | UnsetType = UNSET,
    on_drive: Callable[[Drive, int, int], None] | None = None,
) -> DatasetManifest:
    """Write the samples of drives that have been chosen, at some frames of each if they are given; the manifest.

    `ordinary` becomes part of the manifest. Otherwise as `export`.
    """
    every_frames = frames_in(request.every_s)
    layout.begin(request.folder)
    with layout.writing_in(request.folder):
        parts = [
            _Part(number, drive, every_frames, None if frames is None else frames[number])
            for number, drive in enumerate(chosen.drives)
        ]
        made = _made(request, parts, on_drive)
        counts = [each.samples for each in made]
        splits: list[Split] = [request.choice.split(drive) for drive in chosen.drives]
        shards = _shards(counts, splits, request.shard_samples)
        for _ in _answers(request, shards):
            pass
        _write_drives(request.folder / layout.DRIVES, chosen.drives, splits, counts)
        maps = _write_maps(request.folder, chosen.drives)
        manifest = _manifest(request, chosen, splits, made, shards, maps)
        manifest = structs.replace(manifest, ordinary=ordinary)
        layout.finish(request.folder, manifest)
    return manifest


def frames_in(every_s: float) -> int:
    """How many frames apart samples are; InputError if that is no whole number."""
    frames = round(every_s / schema.STEP_S)
    if frames < 1 or abs(frames * schema.STEP_S - every_s) > 1e-9:
        raise InputError(f"every is {every_s:g} s, expected a positive multiple of {schema.STEP_S:g} s")
    return frames


# --- the workers' side ---------------------------------------------------------------------------


def _open(out: Path, _group: str, publish: Publish) -> Work:
    def work(task: _Part | _Shard) -> Answer:
        publish("simulate")
        return (_write_part(out, task) if isinstance(task, _Part) else _write_shard(out, task)), None

    return work


def _write_part(out: Path, part: _Part) -> dict[str, Any]:
    scenario, roads, trace = driven(part.drive)
    frames: Sequence[int] | None = part.frames
    if frames is None and part.drive.window is not None:
        frames = window_frames(part.drive.window, trace, part.every_frames)
    columns = drive_samples(scenario, roads, trace, drive=part.number, every_frames=part.every_frames, frames=frames)
    write_arrays(_part_file(out, part.number), columns, level=1)
    shown = np.bincount(columns["situation"], minlength=len(schema.SITUATIONS))
    return {"samples": count_of(columns), "situations": shown.tolist()}


def _write_shard(out: Path, shard: _Shard) -> dict[str, Any]:
    pieces = [
        picked(read_arrays(_part_file(out, number)), np.arange(first, last)) for number, first, last in shard.pieces
    ]
    write_arrays(out / layout.SHARDS / shard.name, joined(pieces))
    return {"samples": shard.samples}


def _part_file(out: Path, number: int) -> Path:
    return out / layout.PARTS / f"{number}.npz"


# --- this side -----------------------------------------------------------------------------------


def _made(
    request: ExportRequest, parts: Sequence[_Part], on_drive: Callable[[Drive, int, int], None] | None
) -> list[_Made]:
    """Make all parts; what became of each."""
    made = [_Made()] * len(parts)
    for done, (part, answer) in enumerate(_answers(request, parts), start=1):
        made[part.number] = convert(answer, _Made)
        if on_drive is not None:
            on_drive(part.drive, done, len(parts))
    return made


def _answers(request: ExportRequest, payloads: Sequence[Any]) -> Iterable[tuple[Any, dict[str, Any]]]:
    """Each payload with its answer, as they are done; the first fault ends it. For a single one nobody is hired."""
    workers = request.workers if len(payloads) > 1 else 0
    tasks = [Task(number, _GROUP, payload) for number, payload in enumerate(payloads)]
    work = partial(_open, request.folder.resolve())
    with contextlib.closing(run_tasks(tasks, work, workers=workers, limits=Limits())) as outcomes:
        for outcome in outcomes:
            payload, fault = outcome.task.payload, outcome.fault
            if fault is not None:
                what = f"{payload.drive.scenario.id}, " if isinstance(payload, _Part) else ""
                error = TrafficError if fault.kind == "traffic" else InterplanError
                raise error(f"{what}{fault.kind} fault: {fault.message}; repeat the export")
            yield payload, outcome.value


def _shards(counts: Sequence[int], splits: Sequence[Split], size: int) -> list[_Shard]:
    """Shards of `size` samples, split by split, drives in order."""
    shards: list[_Shard] = []
    for split in SPLITS:
        pieces: list[tuple[int, int, int]] = []
        full: list[list[tuple[int, int, int]]] = []
        room = size
        for number in (k for k, each in enumerate(splits) if each == split):
            first = 0
            while first < counts[number]:
                last = min(counts[number], first + room)
                pieces.append((number, first, last))
                room -= last - first
                first = last
                if not room:
                    full.append(pieces)
                    pieces, room = [], size
        full += [pieces] if pieces else []
        shards += [_Shard(f"{split}-{k:05d}.npz", split, tuple(each)) for k, each in enumerate(full)]
    return shards


def _write_drives(path: Path, drives: Sequence[Drive], splits: Sequence[Split], counts: Sequence[int]) -> None:
    lines = [
        text_of(drive.record(split, samples)) for drive, split, samples in zip(drives, splits, counts, strict=True)
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def _write_maps(folder: Path, drives: Sequence[Drive]) -> dict[str, MapRecord]:
    """Write the lane graph of every map; what the manifest says of each."""
    about: dict[str, MapRecord] = {}
    for drive in sorted(drives, key=lambda each: each.map.name):
        name = drive.map.name
        if name not in about:
            roads = load_roads(drive.scenario.map, drive.scenario.maps_beside)
            path = folder / layout.MAPS / f"{name}.npz"
            write_arrays(path, lane_graph(roads).tables())
            about[name] = MapRecord(roads.crs, roads.driving_side, map_hash(drive.map), file_hash(path))
    return about


def _manifest(
    request: ExportRequest, chosen: Chosen, splits: Sequence[Split], made: Sequence[_Made], shards: Sequence[_Shard],
    maps: dict[str, MapRecord],
) -> DatasetManifest:  # fmt: skip
    folder, choice = request.folder, request.choice
    counts = [each.samples for each in made]
    files = [folder / layout.SHARDS / shard.name for shard in shards]
    held = [
        ShardRecord(
            f"{layout.SHARDS}/{path.name}", shard.split, shard.samples, path.stat().st_size, file_hash(path)
        )
        for shard, path in zip(shards, files, strict=True)
    ]  # fmt: skip
    drives_hash = file_hash(folder / layout.DRIVES)
    parts = [*(each.sha256 for each in held), *(each.sha256 for each in maps.values()), drives_hash]
    digest = hashlib.sha256("\n".join((f"{layout.FORMAT} {schema.FORMAT}", *parts)).encode()).hexdigest()
    return DatasetManifest(
        kind=layout.KIND,
        format=layout.FORMAT,
        hash=digest,
        versions=versions(),
        features=FeaturesRecord(
            format=schema.FORMAT,
            ego_frame="origin on the rear axle at the present, x forward, y left, radians counter-clockwise",
            map_frame="metres in the map's crs, x east, y north",
            step_s=schema.STEP_S,
            fields=schema.as_json(),
        ),
        options=OptionsRecord(
            every_s=request.every_s,
            least_future_s=round(LEAST_FUTURE_FRAMES * schema.STEP_S, 3),
            min_score=choice.min_score,
            exclude=sorted(choice.exclude),
            holdout_maps=sorted(choice.holdout_maps),
            holdout_seeds=sorted(choice.holdout_seeds),
        ),
        sources=_sources(chosen.drives, counts),
        left_out=chosen.left_out,
        counts=CountsRecord(
            drives=len(chosen.drives),
            samples=sum(counts),
            by_split=_tally(zip(splits, counts, strict=True)),
            by_family=_tally(zip((d.scenario.family for d in chosen.drives), counts, strict=True)),
            by_map=_tally(zip((d.map.name for d in chosen.drives), counts, strict=True)),
            by_planner=_tally(zip((d.planner for d in chosen.drives), counts, strict=True)),
            by_situation=_by_situation(splits, made),
        ),
        maps=maps,
        drives=FileRecord(layout.DRIVES, drives_hash),
        shards=held,
    )


def _sources(drives: Sequence[Drive], counts: Sequence[int]) -> list[SourceRecord]:
    names: list[tuple[Origin, str]] = sorted({(drive.origin, drive.source) for drive in drives})
    found: list[SourceRecord] = []
    for origin, name in names:
        rows = [k for k, drive in enumerate(drives) if (drive.origin, drive.source) == (origin, name)]
        found.append(
            SourceRecord(origin, name, len(rows), sum(counts[k] for k in rows), source_hash(drives[k] for k in rows))
        )
    return found


def _by_situation(splits: Sequence[Split], made: Sequence[_Made]) -> dict[str, dict[str, int]]:
    """For each split, how many of its samples show what."""
    sums = {split: np.zeros(len(schema.SITUATIONS), dtype=np.int64) for split in SPLITS if split in splits}
    for split, each in zip(splits, made, strict=True):
        sums[split] += each.situations
    return {split: dict(zip(schema.SITUATIONS, total.tolist(), strict=True)) for split, total in sums.items()}


def _tally(pairs: Iterable[tuple[str, int]]) -> dict[str, int]:
    tally: Counter[str] = Counter()
    for name, count in pairs:
        tally[name] += count
    return dict(sorted(tally.items()))
