"""Kilometres: as many segments as it takes, over workers, into a folder that a kill at any moment leaves whole.

| file | what |
|---|---|
| endure.json | which program, maps, drivers and planners its segments are of |
| segments.jsonl | one record per segment, appended and synced by the one process that holds `lock` |
| events/ | a run folder: the seconds around each kept event, to `replay`, and as scenarios to `run` |
| traffic/ | the vehicle-type file, where it is the user's own |

Which segments are driven follows from those that came before by rounds: each
round is planned from all segments of the rounds before it, so workers and kills
change nothing.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil
from pathlib import Path
from typing import Annotated, Final, Protocol

import msgspec
from msgspec import Meta, Struct

from interplan_sumo.batch.backend import one_connection
from interplan_sumo.batch.drive_job import DriveSettings
from interplan_sumo.batch.engine import run_tasks
from interplan_sumo.batch.folder_lock import FolderLock
from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.records import PlannerRecord, RecordError, decode, encode
from interplan_sumo.batch.tasks import Task
from interplan_sumo.batch.versions import versions
from interplan_sumo.endurance.code_hash import code_hash
from interplan_sumo.endurance.event_folder import collect_events, open_event_folder
from interplan_sumo.endurance.rare_events import boosted_for
from interplan_sumo.endurance.records import RARE_KINDS, RareKind, SegmentRecord, TrafficCell, segment_of
from interplan_sumo.endurance.remote_segments import RemoteSegments
from interplan_sumo.endurance.saturation import saturation_per_km
from interplan_sumo.endurance.segment_job import SegmentJob, SegmentSettings, empty_record
from interplan_sumo.endurance.segment_plan import SEGMENT_M
from interplan_sumo.endurance.segment_worker import segment_jobs
from interplan_sumo.endurance.stop_rule import StopRule, StopStanding
from interplan_sumo.errors import InputError, RunFolderError
from interplan_sumo.maps.store import MapFiles, find_map, is_shipped, load_roads
from interplan_sumo.metrics.profile import DEFAULT_PROFILE, find_profile
from interplan_sumo.planner import find_planner
from interplan_sumo.planner_source import PlannerSource
from interplan_sumo.simulation.network import read_network
from interplan_sumo.simulation.traffic import TRAFFIC_VERSION
from interplan_sumo.simulation.vehicle_types import read_vehicle_types, vehicle_type_file
from interplan_sumo.world.files import replacing

SEGMENTS: Final = "segments.jsonl"
ABOUT: Final = "endure.json"
EVENTS: Final = "events"
STAGED: Final = RARE_KINDS
"""Rare events that are staged: all of them."""
NATURAL: Final = 3e-4
"""Probability per opportunity and second where none is given: with the opportunities there are, one of them in some ten
kilometres."""
PER_SEGMENT: Final[Mapping[RareKind, float]] = {
    "jaywalker": 50.0, "blocked_lane": 25.0, "cut_in": 10.0, "hard_braking_ahead": 25.0,
    "red_light_runner": 2.0, "door": 10.0, "crosswalk": 4.0,
}  # fmt: skip
"""Opportunity-seconds of an ordinary segment, for how much to boost; what there was is counted."""
MOST_TIMES: Final = 8
"""No more than so many times the segments are driven that the distance would take at best."""
NOWHERE_M: Final = 50.0
"""A planner that on average comes no farther than this gets the segments once and a half: it will never get there."""
LEAST_MEAN_M: Final = 250.0
"""No round is planned for segments shorter than this."""
LEAST_NAIVE: Final = 0.2
NAMED: Final = ("maps", "drivers", "planners")
"""What `AboutEndure` has several of, each by its name."""


@dataclass(frozen=True, slots=True)
class EndureOptions:
    """What to drive. InputError for a value that cannot be."""

    planner: str
    map: str
    km: float
    out: Path
    density: float = 0.5
    """As a fraction of the district's saturation."""
    behaviour: str = "mixed"
    traffic: Path | None = None
    """A vehicle-type file instead of the behaviour's."""
    rare: float | None = None
    """Probability of each rare event per opportunity and second; None for the usual one."""
    seed: int = 0
    naive_share: float = 0.5
    until: StopRule | None = None
    """Drives no farther than until a rate is known; `km` are then the most."""
    run: RunOptions = field(default_factory=RunOptions)
    """Workers and limits."""
    segment_m: float = SEGMENT_M

    def __post_init__(self) -> None:
        for name, value, least, most in (
            ("--km", self.km, 0.01, 100_000.0),
            ("--density", self.density, 0.01, 1.5),
            ("--rare", NATURAL if self.rare is None else self.rare, 0.0, 0.1),
            ("--seed", self.seed, 0, 9999),
            ("--naive-share", self.naive_share, LEAST_NAIVE, 1.0),
        ):
            if not least <= value <= most:
                raise InputError(f"{name} is {value:g}, expected {least:g} to {most:g}")
        find_planner(self.planner)
        load_roads(self.map)
        read_network(self.map_files.network)
        read_vehicle_types(self.types_path)

    @property
    def map_files(self) -> MapFiles:
        return find_map(self.map)

    @property
    def types_path(self) -> Path:
        return vehicle_type_file(self.behaviour) if self.traffic is None else self.traffic.resolve()

    @property
    def cell(self) -> TrafficCell:
        return TrafficCell(self.map_files.name, self.density, self.types_path.stem)

    @property
    def natural(self) -> dict[RareKind, float]:
        return dict.fromkeys(STAGED, NATURAL if self.rare is None else self.rare)


class KilometresWatch(Protocol):
    """Told how it goes on."""

    def planned(self, segments: int, done: Sequence[SegmentRecord]) -> None:
        """So many segments in all, as far as is known, of which these are done."""
        ...

    def finished(self, record: SegmentRecord) -> None:
        """One more has been driven."""
        ...

    def looked(self, standing: StopStanding) -> None:
        """After a batch, where it drives until a rate is known."""
        ...


class AboutEndure(Struct, frozen=True):
    """What endure.json says: what all segments of a folder share, and the planners and drivers that they are of."""

    format: Annotated[int, Meta(ge=2, le=2)]
    versions: dict[str, str]
    code: str
    """Hash of the code that drives (`code_hash`)."""
    traffic_version: int
    maps: dict[str, str]
    """Hash by name."""
    drivers: dict[str, str]
    """Hash of the vehicle-type file by name."""
    planners: dict[str, str]
    """Hash by name."""
    natural: dict[str, float]
    naive_share: float
    segment_m: float

    def beside(self, other: AboutEndure) -> AboutEndure:
        """This one with the maps, drivers and planners of another besides."""
        return msgspec.structs.replace(
            self, **{name: {**getattr(self, name), **getattr(other, name)} for name in NAMED}
        )


def drive_kilometres(options: EndureOptions, watch: KilometresWatch | None = None) -> list[SegmentRecord]:
    """Drive what is missing of the kilometres that are asked for; the segments of this planner and cell, in order.

    InputError for what cannot be used, RunFolderError for a folder that is in use, unwritable, or of something else.
    KeyboardInterrupt leaves a folder that the same options complete.
    """
    files, source = options.map_files, PlannerSource.of(options.planner)
    types_hash = _digest(options.types_path.read_bytes())
    about = AboutEndure(
        2, versions(), code_hash(), TRAFFIC_VERSION, {files.name: files.hash()}, {options.types_path.stem: types_hash},
        {options.planner: source.hash}, {str(kind): p for kind, p in options.natural.items()}, options.naive_share,
        options.segment_m,
    )  # fmt: skip
    with one_connection(options.run.who), _opened(options.out, about) as records:
        mine = SegmentPlan(options, {each.index: each for each in records if _is_of(each, options)})
        planners = {options.planner: PlannerRecord(source.hash, source.files)}
        open_event_folder(options.out / EVENTS, planners)
        while missing := mine.missing(number := mine.planned()):
            if watch is not None:
                watch.planned(len(mine.done) + len(missing), list(mine.done.values()))
            for record in driven_segments(missing, options):
                _append(options.out / SEGMENTS, record)
                mine.done[record.index] = record
                if watch is not None:
                    watch.finished(record)
            if mine.missing(number):
                raise RunFolderError(f"some segments in {options.out} could not be driven; repeat the command")
            if watch is not None and (standing := mine.standing()) is not None:
                watch.looked(standing)
        collect_events(options.out / EVENTS, planners, files)
    return [mine.done[index] for index in sorted(mine.done)]


@dataclass(slots=True)
class SegmentPlan:
    """Those of one planner in one cell."""

    options: EndureOptions
    done: dict[int, SegmentRecord]

    def planned(self) -> int:
        """How many are to be driven, as far as the rounds, or the batches, that are whole can tell."""
        most, until = self._for_the_distance(), self.options.until
        return most if until is None else until.planned([*self.done.values()], most)

    def standing(self) -> StopStanding | None:
        """How well the rate is known that it drives for."""
        until = self.options.until
        return None if until is None else until.standing([*self.done.values()])

    def _for_the_distance(self) -> int:
        """A round is planned from those before it."""
        wanted_m, best = 1000.0 * self.options.km, self.options.segment_m
        number = first = max(1, ceil(wanted_m / best))
        while True:
            so_far = [self.done[index] for index in range(number) if index in self.done]
            driven_m = sum(each.metres for each in so_far)
            mean_m = driven_m / number
            most = MOST_TIMES * first if mean_m > NOWHERE_M else ceil(1.5 * first)
            if len(so_far) < number or driven_m >= wanted_m or number >= most:
                return number
            number = min(most, number + max(1, ceil((wanted_m - driven_m) / max(mean_m, LEAST_MEAN_M))))

    def missing(self, number: int) -> list[SegmentJob]:
        """The jobs of the first `number` segments that are not done."""
        options, natural = self.options, self.options.natural
        boosted = boosted_for(natural, PER_SEGMENT)
        return [
            SegmentJob(
                index,
                options.cell,
                options.planner,
                options.seed,
                is_naive(index, options.naive_share),
                natural,
                boosted,
            )
            for index in range(number)
            if index not in self.done
        ]


def is_naive(index: int, share: float) -> bool:
    """Whether the segment of this number has natural probabilities: evenly spread, the first one is."""
    return ceil((index + 1) * share - 1e-9) > ceil(index * share - 1e-9)


def driven_segments(jobs: Sequence[SegmentJob], options: EndureOptions) -> Iterator[SegmentRecord]:
    """Records in the order in which they end; a job whose worker ended by no fault of planner or traffic has none."""
    files, run = options.map_files, options.run
    settings = SegmentSettings(
        drive=DriveSettings((options.out / EVENTS).resolve(), run, find_profile(DEFAULT_PROFILE)),
        map=options.map if is_shipped(files) else str(files.folder.resolve()),
        maps_beside=None if is_shipped(files) else files.folder.resolve().parent,
        types_path=options.types_path,
        saturation_per_km=saturation_per_km(files.name),
        most_m=options.segment_m,
        planner_hashes={options.planner: PlannerSource.of(options.planner).hash},
    )
    tasks = [Task(job.index, job.planner, job) for job in jobs]
    if run.who.ray is None:
        outcomes = run_tasks(tasks, segment_jobs(settings), workers=run.who.processes, limits=run.limits)
    else:
        from interplan_sumo.batch.ray_backend import run_on_ray

        outcomes = run_on_ray(tasks, RemoteSegments(settings), address=run.who.ray, limits=run.limits)
    with contextlib.closing(outcomes):
        for outcome in outcomes:
            job: SegmentJob = outcome.task.payload
            if "segment" in outcome.value:
                yield msgspec.convert(outcome.value["segment"], SegmentRecord)
            elif outcome.fault is not None and outcome.fault.kind in ("planner", "traffic"):
                yield empty_record(job, outcome.fault, settings.planner_hashes.get(job.planner))


def _is_of(record: SegmentRecord, options: EndureOptions) -> bool:
    return (record.planner, record.cell, record.seed) == (options.planner, options.cell, options.seed)


# --- the folder ------------------------------------------------------------------------------------


def read_segments(folder: Path) -> list[SegmentRecord]:
    """All whole records of a folder, sorted by cell, planner, seed and number; RunFolderError for one that is none."""
    path = folder / SEGMENTS
    if not path.is_file():
        raise RunFolderError(f"{folder} holds no {SEGMENTS}; drive some kilometres: interplan-sumo endure --help")
    found: dict[tuple[TrafficCell, str, int, int], SegmentRecord] = {}
    for number, line in enumerate(path.read_bytes().split(b"\n")[:-1], start=1):
        try:
            record = segment_of(line)
        except RecordError as error:
            raise RunFolderError(
                f"{path}, line {number} is damaged ({error}); delete it, and it is driven again"
            ) from None
        found[record.cell, record.planner, record.seed, record.index] = record
    return [found[key] for key in sorted(found)]


@contextlib.contextmanager
def _opened(folder: Path, wanted: AboutEndure) -> Generator[list[SegmentRecord]]:
    """The folder, held by this process alone, with what it holds; RunFolderError if that is of something else."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        strangers = sorted(each.name for each in folder.iterdir() if each.name != "lock")
        if strangers and not (folder / ABOUT).is_file():
            raise RunFolderError(
                f"{folder} holds {strangers[0]!r} and no {ABOUT}; give an empty or a new folder as --out"
            )
        lock = FolderLock(folder / "lock")
    except OSError as error:
        raise RunFolderError(f"cannot write {folder}: {error.strerror or error}; give another one as --out") from None
    try:
        _agree(folder, wanted)
        path = folder / SEGMENTS
        _without_torn_end(path)
        yield read_segments(folder) if path.is_file() else []
        if path.is_file():
            lines = [encode(each) for each in read_segments(folder)]
            with replacing(path) as fresh:
                fresh.write_bytes(b"".join(line + b"\n" for line in lines))
    finally:
        lock.release()


def _agree(folder: Path, wanted: AboutEndure) -> None:
    """Hold what is wanted against what the folder says of itself, and add to that."""
    path = folder / ABOUT
    held = wanted
    if path.is_file():
        try:
            held = decode(path.read_bytes(), AboutEndure)
        except RecordError as error:
            raise RunFolderError(
                f"{path} is damaged, or of an older program ({error}); give another folder as --out"
            ) from None
        if held.code != wanted.code:
            raise RunFolderError(
                f"{folder} holds segments that other code drove ({held.code[:8]}, this is {wanted.code[:8]}); "
                "give another folder as --out"
            )
        for name in ("versions", "traffic_version", "natural", "naive_share", "segment_m"):
            if getattr(held, name) != getattr(wanted, name):
                raise RunFolderError(
                    f"{folder} holds segments with {name.replace('_', ' ')} {getattr(held, name)}, these have "
                    f"{getattr(wanted, name)}; give another folder as --out"
                )
        for name in NAMED:
            then, now = getattr(held, name), getattr(wanted, name)
            changed = [each for each in now if each in then and then[each] != now[each]]
            if changed:
                raise RunFolderError(
                    f"{folder} holds segments of {changed[0]!r} from before it changed; give another folder as --out"
                )
        held = held.beside(wanted)
    with replacing(path) as fresh:
        fresh.write_bytes(msgspec.json.format(encode(held), indent=2) + b"\n")


def _without_torn_end(path: Path) -> None:
    """Cut off what a kill has left of a line."""
    if path.is_file():
        content = path.read_bytes()
        whole = content.rfind(b"\n") + 1
        if whole != len(content):
            os.truncate(path, whole)


def _append(path: Path, record: SegmentRecord) -> None:
    """Write a record and wait until it is on the disk."""
    try:
        with path.open("ab") as file:
            file.write(encode(record) + b"\n")
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise RunFolderError(f"cannot write {path}: {error.strerror or error}; free some space and repeat") from None


def _digest(content: bytes) -> str:
    import hashlib

    return hashlib.sha256(content).hexdigest()
