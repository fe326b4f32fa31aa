"""Drives away from home: what they need is packed, what they leave comes home once and whole."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from interplan_sumo.batch.drive_job import DriveSettings
from interplan_sumo.batch.jobs import Job
from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.remote_jobs import Files, RemoteJobs, write_files
from interplan_sumo.batch.run_folder import trace_place
from interplan_sumo.batch.tasks import Task
from interplan_sumo.errors import RunFolderError
from interplan_sumo.metrics.profile import find_profile
from tests.batch.busy import PLAIN

PLACE = "traces/nudge_0-12345678/idm-12345678/seed0"


def drives(home: Path, vehicle_types: Path | None = None) -> RemoteJobs:
    return RemoteJobs(
        DriveSettings(home, RunOptions(traffic=vehicle_types), find_profile("nuplan"), own_scenarios=True)
    )


def folder(place: Path, files: Files) -> Path:
    place.mkdir()
    write_files(place, files)
    return place


def below(place: Path) -> list[str]:
    return sorted(str(path.relative_to(place)) for path in place.rglob("*") if path.is_file())


def test_luggage_is_what_drives_read_of_the_run_folder_and_no_results(tmp_path: Path) -> None:
    needed = {"maps/mine/1.0/map.gpkg": b"map", "experts/a.parquet": b"drive"}
    home = folder(tmp_path / "home", {**needed, "results.jsonl": b"", f"{PLACE}/ego.parquet": b"old"})
    (tmp_path / "rude.xml").write_bytes(b"<routes/>")
    assert drives(home, tmp_path / "rude.xml").stage_in() == {**needed, "traffic/rude.xml": b"<routes/>"}
    assert drives(folder(tmp_path / "empty", {})).stage_in() == {}


def test_a_vehicle_type_file_that_is_gone_is_named(tmp_path: Path) -> None:
    with pytest.raises(RunFolderError, match=r"cannot read .*gone\.xml: No such file"):
        drives(tmp_path, tmp_path / "gone.xml").stage_in()


def test_plans_go_to_the_drive_that_is_made_of_them_and_no_further(tmp_path: Path) -> None:
    key = ("nudge/0", "idm", 3)
    home = folder(tmp_path / "home", {f"{trace_place(key)}/{name}.parquet": b"x" for name in ("plans", "ego")})
    jobs = RemoteJobs(replace(drives(home).settings, plans_of=home))
    task = Task(key, "idm", Job(replace(PLAIN, id="nudge/0"), "idm", 3))
    assert drives(home).needs(task) == {}
    assert jobs.needs(task) == {f"plans/{trace_place(key)}/plans.parquet": b"x"}
    there = folder(tmp_path / "there", jobs.needs(task))
    assert jobs.collect(there) == {}
    assert below(there) == []


def test_what_drives_leave_comes_home_once(tmp_path: Path) -> None:
    there = folder(tmp_path / "there", {"experts/a.parquet": b"had"})
    jobs = drives(tmp_path / "home")
    jobs.open_in(there)
    assert jobs.collect(there) == {}
    left = {f"{PLACE}/ego.parquet": b"ego", f"{PLACE}/scenario.json": b"{}", "experts/b.parquet": b"new"}
    write_files(there, {**left, "traces/.part-x/ego.parquet": b"torn", "experts/.part-y": b"torn"})
    assert jobs.collect(there) == left
    assert jobs.collect(there) == {}
    assert below(there / "experts") == [".part-y", "a.parquet", "b.parquet"]
    assert not (there / "traces").exists()


def test_what_comes_home_lies_in_its_place_over_what_was_there(tmp_path: Path) -> None:
    home = folder(tmp_path / "home", {f"{PLACE}/stale.parquet": b"old"})
    drives(home).stage_out(
        {f"{PLACE}/ego.parquet": b"ego", f"{PLACE}/plans.parquet": b"p", "experts/b.parquet": b"new"}
    )
    assert below(home) == ["experts/b.parquet", f"{PLACE}/ego.parquet", f"{PLACE}/plans.parquet"]
    assert (home / PLACE / "ego.parquet").read_bytes() == b"ego"


def test_what_cannot_be_written_at_home_ends_the_run_in_one_line(tmp_path: Path) -> None:
    home = folder(tmp_path / "home", {"experts": b"a file in its place", "traces": b"too"})
    for path in ("experts/b.parquet", f"{PLACE}/ego.parquet"):
        with pytest.raises(RunFolderError, match="cannot write") as caught:
            drives(home).stage_out({path: b""})
        assert "\n" not in str(caught.value)
