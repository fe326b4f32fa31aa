"""Kilometres in a folder: what is driven follows from the options alone, whoever drives and however often killed."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from msgspec import structs

from interplan_sumo.batch.drive_job import DriveSettings
from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.records import encode
from interplan_sumo.batch.run_folder import read_run
from interplan_sumo.batch.versions import versions
from interplan_sumo.endurance.code_hash import code_files
from interplan_sumo.endurance.kilometres import (
    ABOUT,
    EVENTS,
    MOST_TIMES,
    SEGMENTS,
    AboutEndure,
    EndureOptions,
    SegmentPlan,
    drive_kilometres,
    is_naive,
    read_segments,
)
from interplan_sumo.endurance.records import SegmentRecord
from interplan_sumo.endurance.saturation import saturation_per_km
from interplan_sumo.endurance.segment_job import SegmentSettings, empty_record
from interplan_sumo.endurance.segment_worker import segment_jobs
from interplan_sumo.endurance.stop_rule import StopStanding
from interplan_sumo.errors import InputError, RunFolderError
from interplan_sumo.metrics.profile import DEFAULT_PROFILE, find_profile
from interplan_sumo.scenario.files import read_scenarios
from interplan_sumo.simulation.traffic import TRAFFIC_VERSION

TINY = EndureOptions("idm", "back_bay", 0.2, Path("unused"), density=0.05, segment_m=60.0, run=RunOptions(workers=0))


def driven(plan: SegmentPlan, number: int, metres: float) -> dict[int, SegmentRecord]:
    jobs = SegmentPlan(plan.options, {}).missing(number)
    return {job.index: structs.replace(empty_record(job, None, None), metres=metres) for job in jobs}


@pytest.mark.parametrize("share", [0.2, 0.3, 0.5, 1.0])
def test_naive_segments_are_spread_evenly_and_the_first_is_one(share: float) -> None:
    naive = [is_naive(index, share) for index in range(100)]
    assert naive[0]
    assert sum(naive) == round(100 * share)
    assert np.diff(np.flatnonzero(naive)).max(initial=1) <= np.ceil(1.0 / share)


def test_rounds_go_on_until_the_distance_is_driven() -> None:
    plan = SegmentPlan(replace(TINY, km=3.0, segment_m=1500.0), {})
    assert plan.planned() == 2
    plan.done = driven(plan, 1, 1000.0)
    assert plan.planned() == 2  # a round is planned from whole ones only
    plan.done = driven(plan, 2, 1000.0)
    assert plan.planned() == 3
    plan.done = driven(plan, 3, 1000.0)
    assert plan.planned() == 3
    assert plan.missing(3) == []


def test_a_planner_that_stands_still_does_not_drive_for_ever() -> None:
    plan = SegmentPlan(replace(TINY, km=15.0, segment_m=1500.0), {})
    plan.done = driven(plan, 200, 0.0)
    assert plan.planned() == 15
    plan.done = driven(plan, 200, 60.0)
    assert plan.planned() == MOST_TIMES * 10


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"km": 0.0}, "--km is 0"),
        ({"density": 2.0}, "--density is 2"),
        ({"rare": 0.5}, "--rare is 0.5"),
        ({"naive_share": 0.1}, "--naive-share is 0.1"),
        ({"planner": "nobody"}, "nobody"),
        ({"map": "nowhere"}, "nowhere"),
        ({"behaviour": "nasty"}, "nasty"),
    ],
)
def test_what_cannot_be_driven_is_refused_before_there_is_a_folder(change: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        replace(TINY, **change)


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("all my work")
    with pytest.raises(RunFolderError, match=r"thesis.tex"):
        drive_kilometres(replace(TINY, out=tmp_path))
    assert [each.name for each in tmp_path.iterdir()] == ["thesis.tex"]


def test_a_damaged_line_is_named(tmp_path: Path) -> None:
    (tmp_path / SEGMENTS).write_bytes(b'{"index": 1}\n')
    with pytest.raises(RunFolderError, match=r"segments.jsonl, line 1 is damaged"):
        read_segments(tmp_path)


class Killer:
    """Ends the run after the first segment, with half a line on the disk."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def planned(self, segments: int, done: Sequence[SegmentRecord]) -> None:
        assert segments > len(done)

    def looked(self, standing: StopStanding) -> None:
        raise AssertionError(standing)

    def finished(self, record: SegmentRecord) -> None:
        with (self._folder / SEGMENTS).open("ab") as file:
            file.write(encode(record)[:100])
        raise KeyboardInterrupt


def told(records: Sequence[SegmentRecord]) -> list[SegmentRecord]:
    return [structs.replace(each, wall_s=0.0, plan_ms=None) for each in records]


@pytest.mark.nightly
def test_workers_and_kills_change_nothing(tmp_path: Path) -> None:
    here, killed, apart = (replace(TINY, km=0.1, out=tmp_path / name) for name in ("here", "killed", "apart"))
    first = drive_kilometres(here)
    assert sum(each.metres for each in first) >= 100.0
    assert all(each.trace_hash for each in first)
    with pytest.raises(KeyboardInterrupt):
        drive_kilometres(killed, Killer(killed.out))
    assert told(drive_kilometres(killed)) == told(first)
    assert told(drive_kilometres(replace(apart, run=RunOptions(workers=2)))) == told(first)
    assert told(read_segments(apart.out)) == told(first)
    assert told(drive_kilometres(here)) == told(first)


@pytest.mark.nightly
def test_a_line_that_was_deleted_is_driven_again_though_later_ones_are_there(tmp_path: Path) -> None:
    options = replace(TINY, km=0.2, out=tmp_path)
    first = drive_kilometres(options)
    _, *rest = (tmp_path / SEGMENTS).read_bytes().splitlines(keepends=True)
    (tmp_path / SEGMENTS).write_bytes(b"".join(rest))
    assert told(drive_kilometres(replace(options, km=0.1))) == told(first)


@pytest.mark.slow
def test_each_kept_event_is_a_drive_to_look_at_and_a_scenario_to_drive_again(tmp_path: Path) -> None:
    blind = replace(TINY, out=tmp_path, planner="straight_ahead", km=0.4, segment_m=200.0, density=0.2)
    records = drive_kilometres(blind)
    assert any(each.events for each in records)
    run = read_run(tmp_path / EVENTS)
    assert len(run.briefs) >= 1
    scenarios = read_scenarios(tmp_path / EVENTS / "scenarios.yaml")
    assert [each.id for each in scenarios] == sorted(key[0] for key in run.briefs)
    assert all(each.family == "endure" and each.replayed for each in scenarios)


@pytest.mark.slow
def test_a_planner_that_stands_still_stalls_in_every_segment(tmp_path: Path) -> None:
    still = replace(TINY, out=tmp_path, planner="tests.endurance.still_planner:Still", km=0.1, segment_m=100.0)
    records = drive_kilometres(still)
    assert len(records) == 2
    for each in records:
        assert [event.kind for event in each.events if event.kind != "hard_braking"] == ["stall"]
        assert each.seconds >= 60.0
        assert each.metres < 60.0


@pytest.mark.nightly
def test_boosted_to_the_natural_probabilities_a_segment_is_the_naive_one_to_the_bit(tmp_path: Path) -> None:
    options = replace(TINY, out=tmp_path, segment_m=200.0, density=0.3, rare=0.1)
    job = replace(SegmentPlan(options, {}).missing(3)[2], naive=True)
    same = replace(job, naive=False, drawn_with=job.natural)
    settings = SegmentSettings(
        DriveSettings(tmp_path, options.run, find_profile(DEFAULT_PROFILE)), options.map, None, options.types_path,
        saturation_per_km(options.map), options.segment_m,
    )  # fmt: skip
    work = segment_jobs(settings)(options.planner, lambda _: None)
    (tmp_path / "experts").mkdir()
    naive, boosted = (msgspec.convert(work(each)[0]["segment"], SegmentRecord) for each in (job, same))
    assert naive.rare_events
    assert naive.rare_events == boosted.rare_events
    assert naive.trace_hash == boosted.trace_hash
    assert boosted.final_weight == 1.0


def test_a_folder_that_other_code_drove_is_refused_in_one_line(tmp_path: Path) -> None:
    still = replace(TINY, out=tmp_path, planner="tests.endurance.still_planner:Still", km=0.01)
    about = AboutEndure(
        2, versions(), "0" * 64, TRAFFIC_VERSION, {}, {}, {}, {str(kind): p for kind, p in still.natural.items()},
        still.naive_share, still.segment_m,
    )  # fmt: skip
    (tmp_path / ABOUT).write_bytes(encode(about))
    with pytest.raises(RunFolderError, match=r"holds segments that other code drove \(00000000, this is "):
        drive_kilometres(still)
    (tmp_path / ABOUT).write_bytes(encode(about).replace(b'"format":2', b'"format":1'))
    with pytest.raises(RunFolderError, match="of an older program"):
        drive_kilometres(still)


ELSEWHERE = frozenset(
    {
        "batch", "errors", "families", "maps", "planner", "planner_options", "planner_process", "planner_seat",
        "planner_source", "registry", "resources",
    }
)  # fmt: skip
"""What a worker imports besides: of maps and planners there are hashes of their own, and the rest carries jobs."""


def test_all_that_a_worker_imports_to_drive_is_in_the_hash_of_the_code() -> None:
    code = "import sys, interplan_sumo.endurance.driving, interplan_sumo.endurance.segment_worker; print(*sys.modules)"
    told = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.split()
    hashed = {path.as_posix() for path in code_files()}
    for name in told:
        package = name.split(".")
        if package[0] == "interplan_sumo" and len(package) > 1 and package[1] not in ELSEWHERE:
            spec = importlib.util.find_spec(name)
            assert spec is not None
            assert spec.origin in hashed, name
