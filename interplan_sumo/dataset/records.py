"""Records: what a dataset says of itself and of each of its drives, declared once, checked when it is read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Literal, TypeVar

import msgspec
from msgspec import UNSET, Struct, UnsetType

from interplan_sumo.errors import InputError

Split = Literal["train", "val", "test"]
SPLITS: tuple[Split, ...] = ("train", "val", "test")
Origin = Literal["run", "certificate", "recording"]

T = TypeVar("T")


class DriveRecord(Struct, frozen=True, kw_only=True):
    """A line of drives.jsonl."""

    origin: Origin
    source: str
    scenario_id: str
    family: str
    map: str
    seed: int
    planner: str
    car: str | None
    """The background car that is the ego; None for the ego itself."""
    score: float | None
    route: tuple[str, ...]
    goal_lane: str
    split: Split
    samples: int
    scenario_hash: str
    trace_hash: str
    generator: str


class FileRecord(Struct, frozen=True):
    """A file that is known by its hash."""

    file: str
    sha256: str


class ShardRecord(Struct, frozen=True):
    """One of the files that hold samples."""

    file: str
    split: Split
    samples: int
    bytes: int
    sha256: str


class MapRecord(Struct, frozen=True):
    """A map on which drives are; `sha256` is that of its lane graph."""

    crs: str
    driving_side: str
    map_sha256: str
    sha256: str


class FeaturesRecord(Struct, frozen=True):
    """What the arrays mean."""

    format: int
    ego_frame: str
    map_frame: str
    step_s: float
    fields: list[dict[str, Any]]


class OptionsRecord(Struct, frozen=True):
    """What the export was asked for."""

    every_s: float
    least_future_s: float
    min_score: float
    exclude: list[str]
    holdout_maps: list[str]
    holdout_seeds: list[int]


class SourceRecord(Struct, frozen=True):
    """A run folder, a suite or a recording that drives are of."""

    origin: Origin
    name: str
    drives: int
    samples: int
    hash: str


class CountsRecord(Struct, frozen=True):
    """How much there is."""

    drives: int
    samples: int
    by_split: dict[str, int]
    by_family: dict[str, int]
    by_map: dict[str, int]
    by_planner: dict[str, int]
    by_situation: dict[str, dict[str, int]]


class FiltersRecord(Struct, frozen=True):
    """What of ordinary driving was taken."""

    min_score: float
    most_cars_of_a_drive: int
    most_samples_of_a_car: int
    most_standing_samples: int
    car_sample_every_s: float


class OrdinaryRecord(Struct, frozen=True):
    """How a dataset of ordinary driving was made."""

    samples_wanted: int
    first_seed: int
    seeds: list[int]
    maps: list[str]
    scene_kinds: list[str]
    clean_drives: int
    experts: list[str]
    planner_share: float
    samples_offered: int
    filters: FiltersRecord


class DatasetManifest(Struct, frozen=True, kw_only=True):
    """manifest.json."""

    kind: str
    format: int
    hash: str
    """SHA-256 over all files."""
    versions: dict[str, Any]
    features: FeaturesRecord
    options: OptionsRecord
    sources: list[SourceRecord]
    left_out: dict[str, int]
    counts: CountsRecord
    maps: dict[str, MapRecord]
    drives: FileRecord
    shards: list[ShardRecord]
    ordinary: OrdinaryRecord | UnsetType = UNSET


class ManifestHead(Struct, frozen=True):
    """What every version's manifest begins with."""

    kind: str
    format: int


def record_of(text: bytes, kind: type[T], where: str) -> T:
    """JSON as a record; InputError with the field that is wrong and `where` it stands."""
    try:
        return msgspec.json.decode(text, type=kind)
    except (ValueError, RecursionError) as error:
        raise InputError(f"cannot read {where}: {' '.join(str(error).split())}; export the data again") from None


def text_of(record: Struct, indent: int | None = None) -> str:
    """A record as JSON."""
    return json.dumps(msgspec.to_builtins(record), indent=indent, ensure_ascii=False)


def read_drive_records(path: Path) -> tuple[DriveRecord, ...]:
    """The lines of drives.jsonl; InputError with the line that is wrong."""
    lines = path.read_bytes().splitlines()
    return tuple(record_of(line, DriveRecord, f"{path}:{number}") for number, line in enumerate(lines, 1))
