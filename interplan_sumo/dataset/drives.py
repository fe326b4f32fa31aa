"""Drives: which drives of runs and suites become training data, and how each is had back."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from pathlib import Path

from interplan_sumo.batch.records import JobKey
from interplan_sumo.batch.run_folder import read_run
from interplan_sumo.batch.stored_drive import StoredDrive, StoredDrives
from interplan_sumo.batch.versions import versions
from interplan_sumo.dataset.cars import Cars
from interplan_sumo.dataset.recorded import RECORDED, Window, maps_beside, window_drive, windows
from interplan_sumo.dataset.records import DriveRecord, Origin, Split
from interplan_sumo.errors import InputError, ScenarioError, check_names
from interplan_sumo.maps.store import MapFiles, find_map, load_roads
from interplan_sumo.scenario import certificates
from interplan_sumo.scenario.certificates import Certificate
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.suite import Suite, find_suite
from interplan_sumo.verification.replay import replay
from interplan_sumo.world.files import file_hash
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import Trace

CERTIFICATE = "certificate"
"""Stands for the planner of a certificate: a search that knows everything."""


@dataclass(frozen=True, slots=True)
class Drive:
    """One drive, not read yet."""

    origin: Origin
    source: str
    """Name of the run folder or of the recording's file, or `name==version` of the suite."""
    scenario: Scenario
    """As it was driven; for a background car with its own start, route and goal."""
    map: MapFiles
    planner: str
    """Who drove; `sumo` for a background car."""
    seed: int
    """Of a recording its number among those that were given, from 0 on."""
    score: float | None
    """None for a recording."""
    trace_hash: str
    generator: str
    """Version of interplan-sumo that drove it; certificates are replayed by this one."""
    run_folder: Path | None = None
    """None for a certificate."""
    row: JobKey | None = None
    """In the run folder."""
    car: str = ""
    """The background car that is taken for the ego; none is the ego itself."""
    window: Window | None = None
    """Of a recording."""

    @property
    def key(self) -> tuple[str, str, int, str, str]:
        return (self.scenario.id, self.planner, self.seed, self.trace_hash, self.car)

    def record(self, split: Split, samples: int) -> DriveRecord:
        """Its line of drives.jsonl."""
        scenario = self.scenario
        return DriveRecord(
            origin=self.origin, source=self.source, scenario_id=scenario.id, family=scenario.family,
            map=self.map.name, seed=self.seed, planner=self.planner, car=self.car or None,
            score=None if self.score is None else round(self.score, 6), route=tuple(scenario.route),
            goal_lane=scenario.goal.lane, split=split, samples=samples, scenario_hash=scenario.hash(),
            trace_hash=self.trace_hash, generator=self.generator,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class DriveSelection:
    """Which drives are taken, and which are held out of training."""

    min_score: float = 0.9
    exclude: tuple[str, ...] = ()
    """Families."""
    holdout_maps: tuple[str, ...] = ()
    holdout_seeds: tuple[int, ...] = ()

    def split(self, drive: Drive) -> Split:
        """`test` on a map that is held out, `val` with a seed that is, else `train`."""
        if drive.map.name in self.holdout_maps:
            return "test"
        return "val" if drive.seed in self.holdout_seeds else "train"


@dataclass(frozen=True, slots=True)
class Chosen:
    """The drives to export, in order, and why others are not among them."""

    drives: tuple[Drive, ...]
    left_out: dict[str, int]


def chosen_drives(
    runs: Sequence[Path],
    suites: Sequence[str],
    choice: DriveSelection,
    recordings: Sequence[Path] = (),
    on_map: str = "",
) -> Chosen:
    """The drives of run folders, the certificates of suites that pass, and what recordings on a map show; each once.

    InputError if there is nothing to look at, nothing passes, or something is
    named in vain.
    """
    if not runs and not suites and not recordings:
        raise InputError(
            "nothing to export: give run folders, such as runs/mine, or --certificates NAME==VERSION, such as "
            "--certificates common==1, or --recordings with a log"
        )
    if recordings and not on_map:
        raise InputError(f"no map for {recordings[0]}; give it with --map, for nuPlan the folder of its maps")
    if not 0.0 <= choice.min_score <= 1.0:
        raise InputError(f"min-score is {choice.min_score:g}, expected 0 to 1: scores count from 0 to 1 here")
    left_out: Counter[str] = Counter()
    found = [drive for folder in dict.fromkeys(runs) for drive in _of_run(folder, left_out)]
    found += [drive for key in dict.fromkeys(suites) for drive in _of_suite(find_suite(key), left_out)]
    numbers: dict[Path, int] = {}
    for source in dict.fromkeys(recordings):
        found += _of_recording(source, on_map, numbers, left_out)
    check_names("family", choice.exclude, (drive.scenario.family for drive in found))
    kept: dict[tuple[str, str, int, str, str], Drive] = {}
    for drive in sorted(found, key=lambda each: (each.key, each.source)):
        if drive.scenario.family in choice.exclude:
            left_out["family excluded"] += 1
        elif drive.score is not None and drive.score < choice.min_score:
            left_out[f"score below {choice.min_score:g}"] += 1
        elif kept.setdefault(drive.key, drive) is not drive:
            left_out["the same drive twice"] += 1
    if not kept:
        why = ", ".join(f"{count} {reason}" for reason, count in sorted(left_out.items())) or "the run is empty"
        raise InputError(f"no drive is left to export ({why}); lower --min-score or give other runs")
    check_names("map among the drives", choice.holdout_maps, (drive.map.name for drive in kept.values()))
    check_names("seed among the drives", map(str, choice.holdout_seeds), (str(d.seed) for d in kept.values()))
    _check_maps(kept.values())
    return Chosen(tuple(kept.values()), dict(sorted(left_out.items())))


def driven(drive: Drive) -> tuple[Scenario, Roads, Trace]:
    """Scenario, map and trace of a drive; a certificate is replayed in its traffic.

    InputError if the trace is not the one that was scored, TrafficError if SUMO fails.
    """
    if drive.window is not None:
        return window_drive(drive.window)
    roads = load_roads(drive.scenario.map, drive.scenario.maps_beside)
    if drive.run_folder is not None and drive.row is not None:
        trace = _stored_drive(drive.run_folder, drive.row).trace
        return drive.scenario, roads, _cars(drive.run_folder, drive.row).drive(drive.car).trace if drive.car else trace
    certificate = _certificates(find_suite(drive.source))[drive.scenario.id]
    trace = replay(drive.scenario, certificate.track)
    if trace.hash() != drive.trace_hash:
        raise InputError(
            f"the certificate of {drive.scenario.id} does not repeat its trace: it was made with other versions of "
            f"SUMO or the package; see `interplan-sumo scenarios certify --suite {drive.source} --check`"
        )
    return drive.scenario, roads, trace


def map_hash(files: MapFiles) -> str:
    """SHA-256 of a map, with its network where it has one: recordings need none."""
    return files.hash() if files.network.is_file() else file_hash(files.gpkg)


def source_hash(drives: Iterable[Drive]) -> str:
    """SHA-256 over what was driven in these drives."""
    return hashlib.sha256("\n".join(f"{d.scenario.hash()} {d.trace_hash}" for d in drives).encode()).hexdigest()


def _of_run(folder: Path, left_out: Counter[str]) -> Iterable[Drive]:
    stored = StoredDrives(read_run(folder))
    for key in sorted(stored.run.rows):
        row = stored.run.rows[key]
        if row.score is None or row.fault:
            left_out["ended in a fault"] += 1
            continue
        scenario = stored.scenario(row)
        yield Drive(
            "run", folder.resolve().name, scenario, find_map(scenario.map, scenario.maps_beside), key[1], key[2],
            row.score, row.trace_hash or "", row.versions.get("interplan_sumo", ""), folder.resolve(), key,
        )  # fmt: skip


def _of_suite(suite: Suite, left_out: Counter[str]) -> Iterable[Drive]:
    stored, package = _certificates(suite), versions()["interplan_sumo"]
    for scenario in suite.scenarios:
        certificate = stored.get(scenario.id)
        if certificate is None or certificate.summary.scenario_hash != scenario.hash():
            left_out["no certificate"] += 1
            continue
        yield Drive(
            "certificate", suite.key, scenario, find_map(scenario.map, scenario.maps_beside), CERTIFICATE, 0,
            certificate.summary.score, certificate.summary.trace_hash, package,
        )  # fmt: skip


def _of_recording(source: Path, map: str, numbers: dict[Path, int], left_out: Counter[str]) -> Iterable[Drive]:
    """The drives of a recording, or of the logs in a folder; `numbers` counts the logs as they come."""
    package = versions()["interplan_sumo"]
    for window in windows(source, map):
        number = numbers.setdefault(window.path, len(numbers))
        try:
            made, _, trace = window_drive(window)
        except ScenarioError:
            left_out["recorded off the lanes, or alone"] += 1
            continue
        scenario = replace(made, maps_beside=maps_beside(window))
        yield Drive(
            "recording", window.path.name, scenario, window.map, RECORDED, number, None, trace.hash(), package,
            window=window,
        )  # fmt: skip


def _certificates(suite: Suite) -> dict[str, Certificate]:
    return _read_certificates(suite.folder / certificates.FILE)


@cache
def _read_certificates(path: Path) -> dict[str, Certificate]:
    return certificates.read_certificates(path) if path.is_file() else {}


@cache
def _stored_drives(folder: Path) -> StoredDrives:
    return StoredDrives(read_run(folder))


@lru_cache(maxsize=1)  # the cars of a drive come one after the other
def _stored_drive(folder: Path, row: JobKey) -> StoredDrive:
    stored = _stored_drives(folder)
    return stored.read(stored.run.rows[row])


@lru_cache(maxsize=1)
def _cars(folder: Path, row: JobKey) -> Cars:
    return Cars(_stored_drive(folder, row).trace)


def _check_maps(drives: Iterable[Drive]) -> None:
    """InputError if two maps of one name differ: their lane ids would be mixed up."""
    first: dict[str, MapFiles] = {}
    for drive in drives:
        other = first.setdefault(drive.map.name, drive.map)
        if other.folder != drive.map.folder and map_hash(other) != map_hash(drive.map):
            raise InputError(
                f"{other.folder} and {drive.map.folder} are two maps of one name; export their drives apart"
            )
