"""Replays of a report: a page to watch for each drive, in a folder beside the report, made by several processes."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Final

from interplan_sumo.batch.processes import available_cores
from interplan_sumo.batch.records import JobKey
from interplan_sumo.batch.run_folder import StoredRun, read_run
from interplan_sumo.batch.stored_drive import StoredDrives
from interplan_sumo.errors import InputError, InterplanError
from interplan_sumo.report.page.drives import ShownDrive, by_scenario, pair_replay, replays_folder, shown_drives
from interplan_sumo.report.table import ResultsTable
from interplan_sumo.world.files import writing

ALONE: Final = 3
"""So few replays are made in this process: starting others would take longer."""


TOLD_EVERY: Final = 20
"""Replays, where progress is written line by line."""


@dataclass(frozen=True, slots=True)
class ReplayJob:
    """One page to make: of one drive, or of two side by side."""

    drives: tuple[tuple[Path, JobKey], ...]
    """Run folder and job of each."""
    path: Path


def wanted_drives(table: ResultsTable, which: str) -> list[ShownDrive]:
    """The drives that `which` names: all, lost (points), none or a number of the worst; InputError for other words."""
    if which == "none":
        return []
    drives = shown_drives(table)
    if which == "all":
        return drives
    if which == "lost":
        return [drive for drive in drives if drive.lost]
    if not (which.isascii() and which.isdigit()):
        raise InputError(f"--replays {which}: give all, lost, none or how many of the worst drives")
    return sorted(drives, key=lambda drive: drive.rank)[: int(which)]


def write_replays(table: ResultsTable, runs: Sequence[StoredRun], page: Path, which: str) -> None:
    """Make the replays for a page, with progress on stderr. One that cannot be made is named there and left out.

    InputError if `which` is none of the words of `wanted_drives`, or the folder cannot be written.
    """
    jobs = replay_jobs(table, runs, page, which)
    if not jobs:
        return
    with writing(replays_folder(page)):
        replays_folder(page).mkdir(parents=True, exist_ok=True)
    problems: list[str] = []
    for done, problem in enumerate(_made(jobs), start=1):
        problems += [problem] if problem else []
        _tell(done, len(jobs))
    for problem in problems:
        print(f"no replay: {problem}", file=sys.stderr)


def _tell(done: int, jobs: int) -> None:
    """One line that changes on a terminal; elsewhere a line now and then."""
    live = sys.stderr.isatty()
    if live or done == jobs or done % TOLD_EVERY == 0:
        start, end = ("\r", "" if done < jobs else "\n") if live else ("", "\n")
        print(f"{start}replays: {done} of {jobs}", end=end, file=sys.stderr, flush=True)


def replay_jobs(table: ResultsTable, runs: Sequence[StoredRun], page: Path, which: str) -> list[ReplayJob]:
    """A page for each wanted drive, and for each of their scenarios one of its best drive beside its worst."""
    wanted = wanted_drives(table, which)
    if not wanted:
        return []
    folder = replays_folder(page)
    held = drive_folders(table, runs)

    def place(drive: ShownDrive) -> tuple[Path, JobKey]:
        key = (drive.scenario, drive.planner, drive.seed)
        return held[drive.line, key], key

    jobs = [ReplayJob((place(drive),), folder / drive.replay) for drive in wanted]
    all_drives = by_scenario(shown_drives(table))
    for scenario in by_scenario(wanted):
        scored = [drive for drive in all_drives[scenario] if drive.score is not None]
        if scored:
            best, worst = (choose(scored, key=lambda drive: drive.rank) for choose in (max, min))
            if best.line != worst.line and best.score != worst.score:
                jobs.append(ReplayJob((place(best), place(worst)), folder / pair_replay(all_drives[scenario])))
    return jobs


def drive_folders(table: ResultsTable, runs: Sequence[StoredRun]) -> dict[tuple[int, JobKey], Path]:
    """The run folder of each drive, by the number of its line; without those of runs that are not given."""
    folders = {id(run.rows): run.path for run in runs}
    return {
        (number, key): folders[id(rows)]
        for number, line in enumerate(table.lines)
        for rows, key in line.rows.places
        if id(rows) in folders
    }


def _made(jobs: Sequence[ReplayJob]) -> Iterator[str | None]:
    """Make the pages; for each, as it is ready, what went wrong, if anything."""
    workers = min(available_cores(), len(jobs)) if len(jobs) > ALONE else 1
    if workers == 1:
        yield from map(make_replay, jobs)
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        futures: list[Future[str | None]] = [pool.submit(make_replay, job) for job in jobs]
        for future in as_completed(futures):
            yield future.result()


def make_replay(job: ReplayJob) -> str | None:
    """Write one page; what went wrong, if anything."""
    from interplan_sumo.report.replay.page import write_replay

    try:
        drives = [_stored(path).read(_stored(path).run.rows[key]) for path, key in job.drives]
        write_replay(drives, job.path)
    except InterplanError as error:
        return str(error)
    return None


@cache
def _stored(path: Path) -> StoredDrives:
    return StoredDrives(read_run(path))
