"""The tables of README and docs are what the stored drives give: nobody types their figures."""

from __future__ import annotations

import sys
from pathlib import Path
from shutil import copytree

import msgspec
import pytest

import tools.kilometres
import tools.renewed_kilometres
from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.records import decode, encode
from interplan_sumo.batch.run_folder import read_run
from interplan_sumo.endurance.kilometres import (
    ABOUT,
    SEGMENTS,
    AboutEndure,
    EndureOptions,
    drive_kilometres,
    read_segments,
)
from interplan_sumo.scenario.suite import find_suite
from interplan_sumo.world.csv_tables import read_table
from tools import fresh_scenes, kept_drives, kept_seeds, kept_sweeps
from tools.hard_scores import HARD
from tools.kept_drives import folder_of, take
from tools.kilometres import KEPT, keep_kilometres
from tools.tables import PAGES, ROOT, SMALL, TABLE, TABLES, Drives, Pages, stored


@pytest.fixture(scope="module")
def drives() -> dict[str, Drives]:
    return stored()


@pytest.fixture(scope="module")
def pages(drives: dict[str, Drives]) -> Pages:
    return Pages(drives)


LONG = ("docs/benchmark.md", "docs/endurance.md", "docs/hard_scenes.md")
"""Pages whose figures take seconds, for they are drawn again many times."""


@pytest.mark.parametrize("page", [pytest.param(page, marks=[pytest.mark.slow] * (page in LONG)) for page in PAGES])
def test_each_figure_is_what_the_stored_drives_give(page: str, pages: Pages) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    assert TABLE.search(text) is not None
    assert pages.written(text) == text


def test_every_table_stands_somewhere_and_another_figure_would_be_put_right(pages: Pages) -> None:
    texts = [(ROOT / page).read_text(encoding="utf-8") for page in PAGES]
    assert {name for text in texts for name in TABLE.findall(text)} == set(TABLES)
    wrong = texts[0].replace("| `foresight` (ours) | ", "| `foresight` (ours) | 1")
    assert wrong != texts[0]
    assert pages.written(wrong) == texts[0]


def test_the_stored_drives_are_all_of_the_suites_as_they_are(drives: dict[str, Drives]) -> None:
    for key, held in drives.items():
        suite = find_suite(key)
        assert (held.run.manifest.suite, held.run.manifest.suite_hash) == (key, suite.hash())
        assert held.strict.complete
        assert all(
            line.scenarios == len(suite.scenarios) and line.official and not line.faults for line in held.strict.lines
        )


def test_what_is_kept_beside_the_suite_is_of_the_same_traffic_and_its_seed_0_of_the_same_scores(
    drives: dict[str, Drives],
) -> None:
    """An edit may change the hash of a planner and none of its drives: so it is the scores that are looked at."""
    held = drives[SMALL].run
    again: dict[tuple[str, str], float] = {}
    for path in (kept_seeds.KEPT, kept_sweeps.kept("track"), kept_sweeps.kept("behaviour"), fresh_scenes.KEPT):
        for line in read_table(path, ("planner", "traffic_version")):
            assert line["traffic_version"] == str(held.manifest.traffic_version), path
            assert line["planner"] in held.planners
            if line.get("seed") == "0":
                again[line["planner"], line["scenario"]] = float(line["score"])
    assert {planner for planner, _ in again} == {line.planner for line in drives[SMALL].strict.lines}
    for (planner, scenario), score in again.items():
        assert held.rows[scenario, planner, 0].score == pytest.approx(score, abs=1e-4), (planner, scenario)


def test_a_planner_that_drives_anew_takes_the_place_of_what_it_drove_and_of_nobody_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    held, fresh = tmp_path / "interplan-hard-1", tmp_path / "run"
    copytree(folder_of(HARD), held)
    copytree(held, fresh)
    monkeypatch.setattr(kept_drives, "RESULTS", tmp_path)
    before = {key: row.score for key, row in read_run(held).rows.items()}
    manifest = msgspec.json.decode((fresh / "manifest.json").read_bytes())
    manifest["planners"] = {"idm": manifest["planners"]["idm"]}
    manifest["requests"] = [request | {"planners": ["idm"]} for request in manifest["requests"]]
    (fresh / "manifest.json").write_bytes(msgspec.json.encode(manifest))
    rows = [msgspec.json.decode(line) for line in (fresh / "results.jsonl").read_bytes().splitlines()]
    again = [row | {"score": 0.125} for row in rows if row["planner"] == "idm"]
    (fresh / "results.jsonl").write_bytes(b"".join(msgspec.json.encode(row) + b"\n" for row in again))

    take(fresh)
    after = read_run(held)
    assert {key: row.score for key, row in after.rows.items()} == {
        key: 0.125 if "idm" in key else score for key, score in before.items()
    }
    assert not after.missing

    manifest["versions"]["sumo"] = "1.0.0"
    (fresh / "manifest.json").write_bytes(msgspec.json.encode(manifest))
    with pytest.raises(SystemExit, match="versions"):
        take(fresh)


def test_kilometres_that_are_kept_already_are_kept_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = tmp_path / "endure"
    copytree(KEPT, kept)
    monkeypatch.setattr(tools.kilometres, "KEPT", kept)
    keep_kilometres([KEPT])
    for name in ("endure.json", "segments.jsonl"):
        assert (kept / name).read_bytes() == (KEPT / name).read_bytes()


@pytest.mark.nightly
def test_kilometres_of_other_code_are_renewed_if_a_sample_of_them_comes_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    kept, out = tmp_path / "kept", tmp_path / "out"
    options = EndureOptions(
        "idm", "back_bay", 0.2, kept, density=0.05, behaviour="measured_city", segment_m=60.0, run=RunOptions(workers=0)
    )
    driven = drive_kilometres(options)
    about = decode((kept / ABOUT).read_bytes(), AboutEndure)
    old = msgspec.structs.replace(about, code="0" * 64, planners={"idm": "1" * 64})
    (kept / ABOUT).write_bytes(encode(old))
    monkeypatch.setattr(tools.renewed_kilometres, "KEPT", kept)
    command = ["renewed", str(out), "--planners", "idm", "--kinds", "door", "--sample", "2", "--workers", "0"]
    monkeypatch.setattr(sys, "argv", command)

    tools.renewed_kilometres.main()
    assert "2 others came as they were" in " ".join(capsys.readouterr().out.split())
    now = decode((out / ABOUT).read_bytes(), AboutEndure)
    assert (now.code, now.planners) == (about.code, about.planners)
    assert [each.trace_hash for each in read_segments(out)] == [each.trace_hash for each in driven]

    (out / SEGMENTS).write_bytes((out / SEGMENTS).read_bytes()[:-40])  # a kill has torn the last
    tools.renewed_kilometres.main()
    assert [each.trace_hash for each in read_segments(out)] == [each.trace_hash for each in driven]

    monkeypatch.setattr(sys, "argv", [each if each != "door" else "jaywalker" for each in command])
    with pytest.raises(SystemExit, match="is of another command or of other code; give a new folder"):
        tools.renewed_kilometres.main()

    monkeypatch.setattr(tools.kilometres, "KEPT", kept)
    lines = (out / SEGMENTS).read_bytes()
    (out / SEGMENTS).write_bytes(lines.split(b"\n")[0] + b"\n")
    with pytest.raises(
        SystemExit, match=f"of other code, and {len(driven) - 1} segments of it are not here; renew all"
    ):
        keep_kilometres([out])
    (out / SEGMENTS).write_bytes(lines)
    keep_kilometres([out])
    assert decode((kept / ABOUT).read_bytes(), AboutEndure).code == about.code

    (kept / ABOUT).write_bytes(encode(old))
    (kept / SEGMENTS).write_bytes(lines.replace(b'"trace_hash":"', b'"trace_hash":"x'))
    other = tmp_path / "other"
    monkeypatch.setattr(sys, "argv", ["renewed", str(other), *command[2:]])
    with pytest.raises(SystemExit, match="2 of 2 segments did not come again"):
        tools.renewed_kilometres.main()
    assert len(read_segments(other)) == 2  # nothing is taken for untouched
