"""Ordinary driving as training data: scenes made for it, driven, surveyed, chosen from in balance, and exported.

Round after round of scenes is driven until there are samples enough. The
drives lie in run folders below the dataset, so that what is done is not done
again; everything follows from the request, whatever the workers.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf
from pathlib import Path
from typing import Final

import numpy as np
from msgspec import convert, to_builtins

from interplan_sumo.batch.briefs import Brief
from interplan_sumo.batch.engine import run_tasks
from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.records import JobKey, Row
from interplan_sumo.batch.run import run
from interplan_sumo.batch.run_folder import read_run
from interplan_sumo.batch.stored_drive import StoredDrives
from interplan_sumo.batch.tasks import Answer, Limits, OpenGroup, Outcome, Publish, Task, Work
from interplan_sumo.dataset import cars, sample_index
from interplan_sumo.dataset import export as exporting
from interplan_sumo.dataset.balance import balanced
from interplan_sumo.dataset.drives import Chosen, Drive, DriveSelection
from interplan_sumo.dataset.folder import DRIVEN, check_free, writing_in
from interplan_sumo.dataset.records import DatasetManifest, FiltersRecord, OrdinaryRecord
from interplan_sumo.dataset.sample_index import IndexedSamples
from interplan_sumo.errors import InputError, InterplanError, check_names
from interplan_sumo.maps.store import find_map, load_roads
from interplan_sumo.metrics.score import weighted_score
from interplan_sumo.scenario.files import read_scenarios, scenario_text
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.verification.ordinary_scenes import CHANGE, FIRST_SEED, KINDS, MAPS, check_seed, ordinary_scenes
from interplan_sumo.world.files import replacing
from interplan_sumo.world.lane_changes import lane_changes_needed

EXPERTS: Final = ("foresight?budget=fast", "pdm_closed")
"""The first one drives where the way asks for lane changes, which the second one does not make; else in turn."""
PLANNER_SHARE: Final = 0.2
"""Of the samples; the others are of background cars, which come for nothing."""
ARRIVING: Final = ("task_done", "progress")
"""Metrics that tell how far a drive came."""
LANES: Final = "lane_changes"
"""The one that tells whether it ended in the goal lane."""
VAL_SHARE: Final = 0.1
VAL_SEEDS: Final = 50_000
"""Seeds of the validation scenes begin so far behind those of the training scenes."""
EVERY_S: Final = 0.5
"""Between the samples that an expert's drive has to offer."""
UNLIMITED: Final = Limits(plan_s=inf, task_s=inf)
"""However slow the machine is, it makes the same data."""
MOST_BARREN: Final = 3
"""After so many rounds in a row that offer nothing of what is missing there is no hope for more."""


@dataclass(frozen=True, slots=True)
class OrdinaryRequest:
    """What to make, and where to."""

    folder: Path
    samples: int
    seed: int = FIRST_SEED
    maps: tuple[str, ...] = MAPS
    holdout_maps: tuple[str, ...] = ()
    """For the split `test` only."""
    min_score: float = 0.9
    """Of `conduct`."""
    experts: tuple[str, str] = EXPERTS
    workers: int = 1
    """Processes; 0 works in this one."""
    shard_samples: int = exporting.SHARD_SAMPLES


class _Told:
    """Watches a run and says a line of every drive."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say, self._done, self._jobs = say, 0, 0

    def begin(self, jobs: int, done: Iterable[tuple[JobKey, Brief]]) -> None:
        self._jobs, self._done = jobs, sum(1 for _ in done)

    def finished(self, row: Row) -> None:
        self._done += 1
        came_to = row.fault.kind + " fault" if row.fault else f"{row.score:.2f}"
        self._say(f"[{self._done}/{self._jobs}] {row.scenario_id}, {row.planner}: {came_to}")


@dataclass(frozen=True, slots=True)
class _Offered:
    """One ego of one drive, and what it offers."""

    drive: Drive
    offer: IndexedSamples

    @property
    def by_planner(self) -> bool:
        return not self.offer.car


def make_ordinary(request: OrdinaryRequest, say: Callable[[str], None] = lambda _line: None) -> DatasetManifest:
    """Make a dataset of ordinary driving; its manifest. The same request on the same folder goes on where it stopped.

    `say` is told in a line what is done. InputError for what cannot be, or if
    the maps do not give so many samples.
    """
    _check(request)
    wanted = _wanted(request)
    found = {split: _collected(request, split, wanted[split], say) for split in ("train", "val")}
    seeds = tuple(sorted({each.drive.seed for each in found["val"]}))
    choice = DriveSelection(request.min_score, (), request.holdout_maps, seeds)
    every = [*found["train"], *found["val"]]
    rng = np.random.default_rng(request.seed)
    picked: list[tuple[Drive, tuple[int, ...]]] = []
    for split, count in wanted.items():
        picked += _picked([each for each in every if choice.split(each.drive) == split], count, rng)
    picked.sort(key=lambda each: each[0].key)
    say(f"writing {sum(len(frames) for _, frames in picked)} samples of {len(picked)} drives and cars")
    order = exporting.ExportRequest(
        request.folder, every_s=EVERY_S, choice=choice, workers=request.workers, shard_samples=request.shard_samples
    )
    chosen = Chosen(tuple(drive for drive, _ in picked), {})
    return exporting.write(order, chosen, [frames for _, frames in picked], _about(request, every))


def _check(request: OrdinaryRequest) -> None:
    """InputError or UnknownNameError for what cannot be asked for."""
    if request.samples < 1:
        raise InputError(f"samples is {request.samples}, expected 1 or more")
    check_seed(request.seed)
    if not 0.0 <= request.min_score <= 1.0:
        raise InputError(f"min-score is {request.min_score:g}, expected 0 to 1: scores count from 0 to 1 here")
    for name in request.maps:
        find_map(name)
    check_names("map among those to drive on", request.holdout_maps, request.maps)
    if not set(request.maps) - set(request.holdout_maps):
        raise InputError("every map is held out, none is left to train on; hold out fewer")
    check_free(request.folder)


def _wanted(request: OrdinaryRequest) -> dict[str, int]:
    """How many samples of each split; those of `test` come on top."""
    val = round(VAL_SHARE * request.samples)
    return {"train": request.samples - val, "val": val} | ({"test": val} if request.holdout_maps else {})


# --- rounds --------------------------------------------------------------------------------------


def _collected(request: OrdinaryRequest, split: str, count: int, say: Callable[[str], None]) -> list[_Offered]:
    """Everything that the rounds of a split offer, as many rounds as it takes; maps held out only have those of val."""
    held = request.holdout_maps if split == "train" else ()
    maps = tuple(name for name in request.maps if name not in held)
    found: list[_Offered] = []
    barren = 0
    seed = request.seed + (VAL_SEEDS if split == "val" else 0)
    while missing := _missing(found, request, count):
        offered = _round(request, maps, seed, say)
        barren = 0 if missing & {each.by_planner for each in offered} else barren + 1
        if barren == MOST_BARREN:
            what = "clean drive" if True in missing else "background car to learn from"
            raise InputError(
                f"the last {barren} rounds of scenes on {', '.join(maps)} gave no {what}; ask for fewer samples, "
                "other maps, or a lower --min-score"
            )
        found += offered
        seed += 1
        say(f"{split}: {_tally(found)} samples offered, {count} wanted")
    return found


def _missing(found: Sequence[_Offered], request: OrdinaryRequest, count: int) -> set[bool]:
    """Whose share is not offered yet on maps that are not held out: planners' (True), background cars' (False)."""
    usable = [each for each in found if each.drive.map.name not in request.holdout_maps]
    shares = {True: PLANNER_SHARE * count, False: (1.0 - PLANNER_SHARE) * count}
    return {by for by, share in shares.items() if _tally([each for each in usable if each.by_planner == by]) < share}


def _tally(found: Sequence[_Offered]) -> int:
    return sum(len(each.offer.frames) for each in found)


def _round(request: OrdinaryRequest, maps: Sequence[str], seed: int, say: Callable[[str], None]) -> list[_Offered]:
    """Make, drive and survey the scenes of one seed."""
    folder = request.folder / DRIVEN / f"{seed}-{'-'.join(maps)}"
    scenes = _scenes(folder.with_suffix(".yaml"), maps, seed, request.workers)
    if not scenes:
        return []
    for expert, driven in _shared_out(scenes, request.experts).items():
        names = (str(folder.with_suffix(".yaml")), *(scene.id for scene in driven))
        options = RunOptions((expert,), folder, scenarios=names, workers=request.workers, plan_limit_s=0, job_limit_s=0)
        run(options, _Told(say))
    return [each for row in _surveyed(request, folder) for each in _offered(folder, row, seed)]


def _scenes(path: Path, maps: Sequence[str], seed: int, workers: int) -> tuple[Scenario, ...]:
    """The scenes of a round, from the file if they were made before."""
    if path.is_file():
        return read_scenarios(path)
    tasks = [Task(name, "scenes", name) for name in maps]
    found = {outcome.task.key: outcome.value["texts"] for outcome in _done(tasks, partial(_finder, seed), workers)}
    texts = [text for name in maps for text in found[name]]
    if not texts:
        return ()
    with writing_in(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as fresh:
            fresh.write_text("---\n".join(texts), encoding="utf-8", newline="\n")
    return read_scenarios(path)


def _finder(seed: int, _group: str, publish: Publish) -> Work:
    def work(map_name: str) -> Answer:
        publish("simulate")
        return {"texts": [*map(scenario_text, ordinary_scenes(load_roads(map_name), seed))]}, None

    return work


def _shared_out(scenes: Sequence[Scenario], experts: tuple[str, str]) -> dict[str, list[Scenario]]:
    """Who drives which scene."""
    shares: dict[str, list[Scenario]] = {expert: [] for expert in experts}
    for number, scene in enumerate(scenes):
        roads = load_roads(scene.map, scene.maps_beside)
        changes = lane_changes_needed(roads, scene.route, scene.goal.lane).get(scene.start.lane, 0)
        shares[experts[0] if changes else experts[number % 2]].append(scene)
    return {expert: driven for expert, driven in shares.items() if driven}


# --- what drives have to offer -------------------------------------------------------------------


def _surveyed(request: OrdinaryRequest, folder: Path) -> Iterator[tuple[JobKey, list[IndexedSamples]]]:
    """What each drive of a run folder offers, in order: its ego if it drove cleanly, its background cars anyway."""
    rows = read_run(folder).rows
    whole = [key for key in sorted(rows) if not rows[key].fault]
    clean = {key for key in whole if conduct(rows[key]) >= request.min_score}
    work = partial(_open, folder.resolve(), exporting.frames_in(EVERY_S))
    tasks = [Task(key, "survey", key) for key in whole]
    found = {
        outcome.task.payload: convert(outcome.value["offers"], list[IndexedSamples])
        for outcome in _done(tasks, work, request.workers)
    }
    return ((key, [offer for offer in found[key] if offer.car or key in clean]) for key in whole)


def _done(tasks: Sequence[Task], open_group: OpenGroup, workers: int) -> Iterator[Outcome]:
    """How tasks ended; InterplanError where one did not end well."""
    workers = workers if len(tasks) > 1 else 0
    with contextlib.closing(run_tasks(tasks, open_group, workers=workers, limits=UNLIMITED)) as outcomes:
        for outcome in outcomes:
            if outcome.fault is not None:
                raise InterplanError(f"{outcome.task.key}: {outcome.fault.kind} fault: {outcome.fault.message}")
            yield outcome


def conduct(row: Row) -> float:
    """How well somebody drove, 0 to 1, however far: its score without what tells whether it arrived.

    Who waits at a red light or in a queue until its time is up drives as well as
    who meets neither, and a learner should see both. Who is in another lane than
    that of its goal in the end, or hardly moves, has not.
    """
    gates = [name for name in row.gates if name not in ARRIVING]
    weights = {name: weight for name, weight in row.weights.items() if name not in ARRIVING}
    scores = {name: metric.score or 0.0 for name, metric in row.metrics.items()}
    return weighted_score(scores, (*gates, LANES), weights)


def _open(folder: Path, every_frames: int, _group: str, publish: Publish) -> Work:
    stored = StoredDrives(read_run(folder))

    def work(key: JobKey) -> Answer:
        publish("simulate")
        drive = stored.read(stored.run.rows[key])
        offers = sample_index.index_samples(drive.scenario, drive.roads, drive.trace, every_frames)
        return {"offers": to_builtins(offers)}, None

    return work


def _offered(folder: Path, surveyed: tuple[JobKey, list[IndexedSamples]], seed: int) -> Iterator[_Offered]:
    key, offers = surveyed
    stored = StoredDrives(read_run(folder))
    row = stored.run.rows[key]
    host = stored.scenario(row)
    for offer in offers:
        if offer.frames:
            scenario = replace(
                host, start=offer.start, start_speed_mps=offer.start_speed_mps, goal=offer.goal, route=offer.route
            )
            yield _Offered(
                Drive(
                    "run", f"{DRIVEN}/{folder.name}", scenario, find_map(host.map, host.maps_beside),
                    cars.SUMO if offer.car else key[1], seed, row.score, row.trace_hash or "",
                    row.versions["interplan_sumo"], folder.resolve(), key, offer.car,
                ),
                offer,
            )  # fmt: skip


def _picked(
    offered: Sequence[_Offered], count: int, rng: np.random.Generator
) -> Iterator[tuple[Drive, tuple[int, ...]]]:
    """`count` samples in balance, planners' and background cars' each by themselves: drives with frames of them."""
    planners = [each for each in offered if each.by_planner]
    others = [each for each in offered if not each.by_planner]
    share = round(PLANNER_SHARE * count)
    for group, most in ((planners, share), (others, count - share)):
        owners = np.repeat(np.arange(len(group)), [len(each.offer.frames) for each in group])
        shown = np.array([code for each in group for code in each.offer.situations], dtype=np.int64)
        frames = np.array([frame for each in group for frame in each.offer.frames], dtype=np.int64)
        taken = balanced(shown, most, rng)
        for owner in np.unique(owners[taken]).tolist():
            rows = taken[owners[taken] == owner]
            yield group[owner].drive, tuple(np.sort(frames[rows]).tolist())


def _about(request: OrdinaryRequest, every: Sequence[_Offered]) -> OrdinaryRecord:
    """What the manifest says of how it was made, besides what every dataset says."""
    clean = {(each.drive.run_folder, each.drive.row) for each in every if each.by_planner}
    return OrdinaryRecord(
        samples_wanted=request.samples,
        first_seed=request.seed,
        seeds=sorted({each.drive.seed for each in every}),
        maps=sorted(request.maps),
        scene_kinds=sorted(("trip", CHANGE, *KINDS)),
        clean_drives=len(clean),
        experts=list(request.experts),
        planner_share=PLANNER_SHARE,
        samples_offered=_tally(every),
        filters=FiltersRecord(
            min_score=request.min_score,
            most_cars_of_a_drive=sample_index.MOST_CARS,
            most_samples_of_a_car=sample_index.MOST_PER_CAR,
            most_standing_samples=sample_index.MOST_STANDING,
            car_sample_every_s=round(sample_index.CAR_EVERY_FRAMES * 0.1, 3),
        ),
    )
