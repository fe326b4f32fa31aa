"""Fresh scenes: scores in scenes of chance, kept by planner, told beside those of the suites."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest

from interplan_sumo.batch.run_folder import read_run
from interplan_sumo.families import names
from interplan_sumo.report.table import ResultsTable, make_table
from interplan_sumo.world.csv_tables import read_table, write_table
from tools import fresh_scenes
from tools.fresh_scenes import fresh, keep_fresh
from tools.kept_drives import folder_of, traffic_of
from tools.kept_sweeps import SUITE

TODAY = traffic_of(SUITE)
"""The version of the traffic that is kept."""


def driven(
    place: Path, scores: dict[str, float], *, scenes: int = 80, official: bool = False, older: int = 0
) -> tuple[Path, Path]:
    """Scenes of one map, so many of the suite, and a run in which each planner has one score.

    One more scene is not certified; there all have full marks.
    """
    held = read_run(folder_of(SUITE))
    about = msgspec.json.decode((held.path / "manifest.json").read_bytes())
    rows = [row for row in held.rows.values() if row.planner == "idm"][:scenes]
    other = msgspec.structs.replace(rows[0], scenario_id="not/0")
    about |= {"suite": "generated", "traffic_version": about["traffic_version"] - older}
    about["planners"] = dict.fromkeys(scores, about["planners"]["idm"])
    about["requests"] = [{"planners": [*scores], "scenarios": [row.scenario_id for row in (*rows, other)], "seeds": 1}]
    made: list[Any] = [
        msgspec.structs.replace(row, planner=planner, score=1.0 if row is other else score, official=official)
        for row in (*rows, other)
        for planner, score in scores.items()
    ]
    folder, run = place / "scenes/strip", place / "runs/strip"
    for each in (folder, run):
        each.mkdir(parents=True)
    found = [(row.scenario_id, row is not other) for row in (*rows, other)]
    write_table(folder / "report.csv", ("scenario_id", "certified"), found)
    (run / "manifest.json").write_bytes(msgspec.json.encode(about))
    (run / "results.jsonl").write_bytes(b"".join(msgspec.json.encode(row) + b"\n" for row in made))
    return folder.parent, run.parent


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fresh_scenes, "KEPT", tmp_path / "fresh.csv")


@pytest.fixture(scope="module")
def rare() -> ResultsTable:
    held = read_run(folder_of(SUITE))
    request = msgspec.structs.replace(held.manifest.requests[0], planners=("idm",))
    return make_table([held.narrowed(request)])


def test_they_stand_beside_what_the_planner_has_in_the_suites(tmp_path: Path, rare: ResultsTable) -> None:
    keep_fresh(*driven(tmp_path / "a", {"idm": 0.2, "mine": 0.8}))
    titles, _, *lines = fresh(rare, rare)
    assert titles == (
        f"planner | {SUITE} | {SUITE} | 80 fresh scenes | Constr. | Acc. | Jayw. | Nudge | Overt. | LTD | MTD | HTD"
    )
    assert lines == [
        "`mine` | - | - | 80 [76, 81] | 80 | 80 | 80 | 80 | 80 | 80 | 80 | 80",
        f"`idm` | {rare.lines[0].cells['interplan'].value:.0f} | {rare.lines[0].cells['interplan'].value:.0f} | "
        "20 [19, 24] | 20 | 20 | 20 | 20 | 20 | 20 | 20 | 20",
    ]


def test_who_drives_again_takes_the_place_of_its_former_self_and_of_nobody_else(tmp_path: Path) -> None:
    keep_fresh(*driven(tmp_path / "a", {"idm": 0.2, "mine": 0.8}))
    keep_fresh(*driven(tmp_path / "b", {"mine": 0.5}))
    lines = read_table(fresh_scenes.KEPT, fresh_scenes.COLUMNS)
    assert {(line["planner"], line["score"]) for line in lines} == {("idm", "0.2000"), ("mine", "0.5000")}
    assert len(lines) == 2 * 80
    assert {line["family"] for line in lines} == {*names(ordinary=False)}
    assert {line["planner_hash"] for line in lines} == {read_run(folder_of(SUITE)).manifest.planners["idm"].hash}


@pytest.mark.parametrize(
    ("how", "says"),
    [
        ({"official": True}, "is of generated; drive scenes of"),
        ({"older": 1}, f"is of traffic version {TODAY - 1}, the kept drives are of {TODAY}"),
        ({"scenes": 79}, "drove other scenes than"),
    ],
)
def test_other_runs_are_refused_and_nothing_is_lost(how: dict[str, Any], says: str, tmp_path: Path) -> None:
    keep_fresh(*driven(tmp_path / "a", {"idm": 0.2}))
    before = fresh_scenes.KEPT.read_bytes()
    with pytest.raises(SystemExit, match=says):
        keep_fresh(*driven(tmp_path / "b", {"mine": 0.2}, **how))
    assert fresh_scenes.KEPT.read_bytes() == before
