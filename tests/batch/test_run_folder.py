"""The run folder: whatever the moment of a kill, nothing finished is lost and nothing counts twice."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_sumo.batch.records import AppliedOverrides, PlannerRecord, RequestedJobs
from interplan_sumo.batch.run_folder import RunFolder, place_folder, read_run, slug, trace_place
from interplan_sumo.errors import InputError, RunFolderError
from tests.batch.busy import PLAIN
from tests.records import asked, manifest, row


def opened(path: Path, request: RequestedJobs | None = None, redo: tuple[str, ...] = (), **changes: Any) -> RunFolder:
    return RunFolder(path, manifest(request or asked(), **changes), redo)


def test_rows_come_back_as_they_were_appended(tmp_path: Path) -> None:
    with opened(tmp_path / "run") as folder:
        folder.append(row("a/0", 0.25))
        folder.append(row("a/1", 1.0, printed="Straße"))
    run = read_run(tmp_path / "run")
    assert run.rows["a/0", "idm", 0] == row("a/0", 0.25)
    assert run.rows["a/1", "idm", 0].printed == "Straße"
    assert run.missing == [("a/2", "idm", 0)]


def test_a_second_run_on_the_folder_is_refused_while_the_first_holds_it(tmp_path: Path) -> None:
    refused = pytest.raises(RunFolderError, match=rf"in use by another run \(process {os.getpid()}\)")
    with opened(tmp_path / "run"), refused:
        opened(tmp_path / "run")
    opened(tmp_path / "run").close()


def test_the_lock_is_free_again_when_its_owner_was_killed(tmp_path: Path) -> None:
    owner = (
        "import os, sys; from pathlib import Path; from interplan_sumo.batch.run_folder import RunFolder;"
        "from tests.records import asked, manifest; folder = RunFolder(Path(sys.argv[1]), manifest(asked()));"
        "os.kill(os.getpid(), 9)"
    )
    assert subprocess.run([sys.executable, "-c", owner, str(tmp_path / "run")], check=False).returncode == -9
    opened(tmp_path / "run").close()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"suite": "interplan==1"}, "with suite smoke==1, this one has interplan==1"),
        ({"suite_hash": "def"}, "with suite_hash 1, this one has def"),
        ({"overrides": AppliedOverrides(density="high")}, "with overrides density none, this one has high"),
        ({"overrides": AppliedOverrides(traffic="my.xml sha256:12")}, "with overrides traffic none, this one has my"),
        ({"versions": {"sumo": "1.29.0", "python": "3.11.7"}}, "with versions sumo 1.28.0, this one has 1.29.0"),
        ({"traffic_version": 3}, "with traffic_version 2, this one has 3"),
        ({"profile": "nuplan"}, "with profile interplan-paper, this one has nuplan"),
    ],
)
def test_another_benchmark_on_the_folder_is_refused_naming_the_difference(
    changes: dict[str, Any], words: str, tmp_path: Path
) -> None:
    opened(tmp_path / "run").close()
    before = (tmp_path / "run" / "manifest.json").read_bytes()
    with pytest.raises(RunFolderError) as caught:
        opened(tmp_path / "run", **changes)
    assert words in str(caught.value)
    assert (tmp_path / "run" / "manifest.json").read_bytes() == before
    opened(tmp_path / "run").close()  # and the lock was given back


def test_more_planners_and_seeds_may_be_added(tmp_path: Path) -> None:
    with opened(tmp_path / "run") as folder:
        folder.append(row("a/0"))
    with opened(tmp_path / "run", asked(planners="idm pdm", scenarios="a/0", seeds=2)) as folder:
        assert folder.done == {("a/0", "idm", 0)}
    assert set(read_run(tmp_path / "run").keys) == {
        *((f"a/{n}", "idm", 0) for n in range(3)),
        *(("a/0", planner, seed) for planner in ("idm", "pdm") for seed in (0, 1)),
    }


def planned(version: str) -> dict[str, Any]:
    """A manifest of a version of the planner."""
    return {"planners": {"idm": PlannerRecord(version, {"idm/idm.py": version, "idm/same.py": "1"})}}


def test_an_edited_planner_is_refused_until_its_rows_are_to_be_driven_again(tmp_path: Path) -> None:
    with opened(tmp_path / "run", asked(planners="idm pdm"), **planned("one")) as folder:
        folder.append(row("a/0", planner="idm"))
        folder.append(row("a/0", planner="pdm"))
    with opened(tmp_path / "run", **planned("one")) as folder:
        assert ("a/0", "idm", 0) in folder.done
    with pytest.raises(RunFolderError) as caught:
        opened(tmp_path / "run", **planned("two"))
    assert str(caught.value).endswith(
        "holds drives of planner 'idm' from before idm/idm.py changed; "
        "--redo 'idm' drives them again, another --out keeps both"
    )
    with opened(tmp_path / "run", redo=("idm",), **planned("two")) as folder:
        assert folder.done == {("a/0", "pdm", 0)}
        folder.append(row("a/0", planner="idm"))
    with pytest.raises(RunFolderError, match=r"idm/idm\.py changed"):
        opened(tmp_path / "run", **planned("one"))
    with opened(tmp_path / "run", **planned("two")) as folder:
        assert len(folder.done) == 2


@pytest.mark.parametrize("version", ["one", "two"])
def test_drives_to_be_done_again_go_on_where_they_were_stopped(version: str, tmp_path: Path) -> None:
    with opened(tmp_path / "run", **planned("one")) as folder:
        for number in range(3):
            folder.append(row(f"a/{number}", 0.25))
    folder = opened(tmp_path / "run", redo=("idm",), **planned(version))
    assert folder.done == set()
    folder.append(row("a/0", 0.5))
    folder.__exit__(KeyboardInterrupt)
    with opened(tmp_path / "run", redo=("idm",), **planned(version)) as folder:
        assert folder.done == {("a/0", "idm", 0)}
        folder.append(row("a/1", 0.5))
        folder.append(row("a/2", 0.5))
    with opened(tmp_path / "run", redo=("idm",), **planned(version)) as folder:
        assert folder.done == set()  # all had been done: this is another time


def test_what_others_drive_meanwhile_leaves_what_is_to_be_done_again(tmp_path: Path) -> None:
    with opened(tmp_path / "run", **planned("one")) as folder:
        folder.append(row("a/0", 0.25))
    opened(tmp_path / "run", redo=("idm",), **planned("one")).__exit__(KeyboardInterrupt)
    with opened(tmp_path / "run", asked(planners="pdm", scenarios="a/0"), **planned("one")) as folder:
        folder.append(row("a/0", planner="pdm"))
    with opened(tmp_path / "run", **planned("one")) as folder:
        folder.append(row("a/0", 0.5))
    with opened(tmp_path / "run", redo=("idm",), **planned("one")) as folder:
        assert ("a/0", "idm", 0) in folder.done  # two of its three scenes are still to be driven


def test_planners_that_exist_in_a_process_only_are_driven_again_too(tmp_path: Path) -> None:
    with opened(tmp_path / "run") as folder:
        folder.append(row("a/0", 0.25))
    with opened(tmp_path / "run", redo=("idm",)) as folder:
        assert folder.done == set()


def test_another_limit_of_plans_is_refused(tmp_path: Path) -> None:
    opened(tmp_path / "run", plan_limit_s=10.0).close()
    with pytest.raises(RunFolderError, match=r"a run with --plan-limit 10, this one has 0\.5; give another folder"):
        opened(tmp_path / "run", plan_limit_s=0.5)
    with pytest.raises(RunFolderError, match="a run with --plan-limit 10, this one has 0; give another folder"):
        opened(tmp_path / "run", plan_limit_s=None)


def test_an_empty_folder_is_left_empty_by_what_cannot_be_driven(tmp_path: Path) -> None:
    folder = opened(tmp_path)
    folder.keep_scenarios([PLAIN])
    folder.__exit__(InputError)
    assert {each.name for each in tmp_path.iterdir()} <= {"lock"}
    opened(tmp_path).close()


def test_a_file_system_without_locks_is_not_taken_for_a_folder_in_use(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def without(_handle: int, _how: int) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr("fcntl.flock", without)
    with pytest.raises(RunFolderError, match=r"cannot write .*No locks available"):
        opened(tmp_path / "run")


def test_a_planner_that_was_edited_before_it_drove_is_no_matter(tmp_path: Path) -> None:
    opened(tmp_path / "run", **planned("one")).close()
    opened(tmp_path / "run", **planned("two")).close()
    assert read_run(tmp_path / "run").manifest.planners["idm"].hash == "two"


@pytest.mark.parametrize("change", [{"printed": "\ud800"}, {"times_s": {"total": float("nan")}}])
def test_a_row_that_could_not_be_read_again_is_a_fault(change: dict[str, Any], tmp_path: Path) -> None:
    with opened(tmp_path / "run") as folder:
        folder.append(row("a/0", 0.5, **change))
    stored = read_run(tmp_path / "run").rows["a/0", "idm", 0]
    assert stored.score is None
    assert stored.fault is not None
    assert stored.fault.kind == "harness"


def test_rows_without_a_score_are_done_again_and_do_not_stay(tmp_path: Path) -> None:
    with opened(tmp_path / "run") as folder:
        folder.append(row("a/0", None))
        folder.append(row("a/1", 0.0))
    with opened(tmp_path / "run") as folder:
        assert folder.done == {("a/1", "idm", 0)}
        folder.append(row("a/0", 0.75))
    lines = (tmp_path / "run" / "results.jsonl").read_text().splitlines()
    assert [json.loads(line)["scenario_id"] for line in lines] == ["a/1", "a/0"]


@settings(max_examples=60)
@given(st.integers(min_value=0))
def test_a_file_cut_anywhere_gives_its_whole_rows_and_goes_on(cut: int) -> None:
    with tempfile.TemporaryDirectory() as place:
        path = Path(place)
        with opened(path) as folder:
            for n in range(3):
                folder.append(row(f"a/{n}", n / 4, printed="ü" * n))
        whole = (path / "results.jsonl").read_bytes()
        cut %= len(whole) + 1
        (path / "results.jsonl").write_bytes(whole[:cut])
        expected = whole[:cut].count(b"\n")
        assert len(read_run(path).rows) == expected
        with opened(path) as folder:
            assert len(folder.done) == expected
            for n in range(expected, 3):
                folder.append(row(f"a/{n}", n / 4, printed="ü" * n))
        assert (path / "results.jsonl").read_bytes() == whole


@pytest.mark.parametrize("content", ["{", "[]", '{"format": 1}', '{"format": 1, "requests": [{}]}'])
def test_a_damaged_manifest_is_named(content: str, tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text(content)
    with pytest.raises(RunFolderError, match=r"manifest\.json is damaged"):
        read_run(tmp_path)


def test_a_folder_of_another_format_is_refused(tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text('{"format": 99}')
    with pytest.raises(RunFolderError, match="has format 99, this version reads 1"):
        opened(tmp_path)


def test_a_folder_with_other_things_in_it_is_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(RunFolderError, match=r"holds 'thesis\.tex' and no manifest\.json"):
        opened(tmp_path)
    assert not (tmp_path / "manifest.json").exists()


def test_a_folder_that_is_no_run_is_named(tmp_path: Path) -> None:
    with pytest.raises(RunFolderError, match="is not a run folder"):
        read_run(tmp_path / "nowhere")


def test_a_file_in_the_place_of_the_folder_is_an_error_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "run").touch()
    with pytest.raises(RunFolderError, match="cannot write the run folder"):
        opened(tmp_path / "run")


def test_a_full_disk_loses_nothing_that_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write = os.write

    def half(handle: int, data: bytes) -> int:
        return write(handle, data[: len(data) // 2])

    with opened(tmp_path) as folder:
        folder.append(row("a/0"))
        before = (tmp_path / "results.jsonl").read_bytes()
        monkeypatch.setattr(os, "write", half)
        with pytest.raises(RunFolderError, match="no space left"):
            folder.append(row("a/1"))
        monkeypatch.undo()
        assert (tmp_path / "results.jsonl").read_bytes() == before
        folder.append(row("a/1"))
    assert len(read_run(tmp_path).rows) == 2


@pytest.mark.parametrize("replaced", [False, True])
def test_rows_are_not_written_into_nowhere(replaced: bool, tmp_path: Path) -> None:
    file = tmp_path / "results.jsonl"
    with opened(tmp_path) as folder:
        folder.append(row("a/0"))
        file.unlink()
        if replaced:
            file.touch()
        with pytest.raises(RunFolderError, match=r"results\.jsonl was deleted or replaced while the run wrote to it"):
            folder.append(row("a/1"))


def test_what_somebody_else_writes_into_the_file_swallows_no_row(tmp_path: Path) -> None:
    file = tmp_path / "results.jsonl"
    folder = opened(tmp_path)
    folder.append(row("a/0"))
    with file.open("a") as other:
        other.write("junk")
    folder.append(row("a/1"))
    folder.close()
    with pytest.raises(RunFolderError, match=r"results\.jsonl, line 2 is damaged"):
        read_run(tmp_path)
    file.write_text(file.read_text().replace("junk\n", ""))
    assert [key[0] for key in read_run(tmp_path).rows] == ["a/0", "a/1"]


def test_rows_are_appended_where_the_system_cannot_read_at_a_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(os, "pread", raising=False)  # as on Windows
    with opened(tmp_path) as folder:
        folder.append(row("a/0"))
        folder.append(row("a/1"))
    assert [key[0] for key in read_run(tmp_path).rows] == ["a/0", "a/1"]


def test_a_disk_that_cannot_be_synced_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_handle: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    with opened(tmp_path) as folder:
        monkeypatch.setattr(os, "fsync", fail)
        with pytest.raises(RunFolderError, match="cannot write the run folder"):
            folder.append(row("a/0"))
        assert folder.done == set()


def test_half_written_files_and_traces_of_a_killed_run_are_cleared_away(tmp_path: Path) -> None:
    (tmp_path / ".part-x1").write_text("{", encoding="utf-8")  # killed before it was a run folder
    opened(tmp_path).close()
    (tmp_path / ".part-x2").touch()
    for name in (".part-x1", "a_0-12345678"):
        (tmp_path / "traces" / name).mkdir(parents=True)
    opened(tmp_path).close()
    assert [p.name for p in (*tmp_path.glob(".*"), *(tmp_path / "traces").iterdir())] == ["a_0-12345678"]


def test_a_trace_replaces_what_an_interrupted_run_left(tmp_path: Path) -> None:
    for content in ("old", "new"):
        fresh = tmp_path / "fresh"
        fresh.mkdir()
        (fresh / content).touch()
        place_folder(fresh, tmp_path / "deep" / "final")
    assert [p.name for p in (tmp_path / "deep" / "final").iterdir()] == ["new"]


@pytest.mark.parametrize(
    ("text", "begins"),
    [
        ("nudge/0", "nudge_0-"),
        ("idm?headway_s=1.5&x=2", "idm_headway_s_1.5_x_2-"),
        ("../../etc/passwd", "etc_passwd-"),
        ("..", "_-"),
        ("", "_-"),
    ],
)
def test_a_folder_name_is_readable_and_harmless(text: str, begins: str) -> None:
    assert slug(text).startswith(begins)


@given(st.text(), st.text())
def test_two_things_never_share_a_folder(a: str, b: str) -> None:
    assert (slug(a) == slug(b)) == (a == b)
    assert "/" not in slug(a)
    assert len(slug(a)) <= 77


def test_the_place_of_a_trace_names_scenario_planner_and_seed() -> None:
    scenario, planner, seed = Path(trace_place(("nudge/3", "idm", 2))).parts[1:]
    assert (scenario[:8], planner[:4], seed) == ("nudge_3-", "idm-", "seed2")
