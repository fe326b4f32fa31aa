"""Verify: an honest run comes again; a row, trace or planner that was changed is found and named."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from msgspec import structs

from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.records import Fault, MetricRecord, Row
from interplan_sumo.batch.results import write_rows
from interplan_sumo.batch.row_check import SCORE_BAR, RowCheck
from interplan_sumo.batch.run import run
from interplan_sumo.batch.run_folder import StoredRun, read_run
from interplan_sumo.batch.trace_difference import POSITION_BAR_M, TraceDifference, difference
from interplan_sumo.batch.verified import verified_rows
from interplan_sumo.batch.verify import RowSample, Verification, note_verified, verify
from interplan_sumo.errors import InputError, PlannerLoadError, RunFolderError, UnknownNameError
from interplan_sumo.report.table import make_table
from interplan_sumo.resources import routes_root
from interplan_sumo.scenario.files import write_scenarios
from interplan_sumo.scenario.scenario import TrafficDemand
from interplan_sumo.world.trace import Trace
from tests.batch.busy import PLAIN
from tests.quick import few
from tests.records import row as a_row

QUIET = replace(PLAIN, duration_s=1.5)
BUSY = replace(QUIET, id="mine/1", traffic=TrafficDemand("low"))
RAISES = "tests.batch.rude_planners:Raises"


def driven(folder: Path, *planners: str, **changes: Any) -> StoredRun:
    """Both scenarios, 1.5 s each, into `folder`/run."""
    folder.mkdir(exist_ok=True)
    write_scenarios((QUIET, BUSY), folder / "mine.yaml")
    base = RunOptions(
        planners or ("straight_ahead",), folder / "run", scenarios=(str(folder / "mine.yaml"),), workers=0
    )
    command = changes.pop("command", ())
    return run(replace(base, **changes), command=command)


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> StoredRun:
    """Not to be changed."""
    return driven(tmp_path_factory.mktemp("verify") / "made", "straight_ahead", RAISES)


@pytest.fixture
def copy(original: StoredRun, tmp_path: Path) -> Path:
    shutil.copytree(original.path, tmp_path / "run")
    return tmp_path / "run"


def checked(
    place: Path, sample: RowSample | None = None, *, with_planner: bool = False, **options: Any
) -> Verification:
    asked = RunOptions(workers=0, **options)
    return verify(read_run(place), sample or RowSample(None), asked, with_planner=with_planner)


def rewritten(place: Path, change: Callable[[Row], Row], scenario: str = "mine/1") -> None:
    """The run folder with the rows of one scenario changed."""
    rows = list(read_run(place).rows.values())
    write_rows(place / "results.jsonl", (change(row) if row.scenario_id == scenario else row for row in rows))


def more(row: Row, score: float) -> Row:
    """The row with so much more, if it ended in no fault."""
    return row if row.fault or row.score is None else structs.replace(row, score=row.score + score)


def verdicts(found: Verification) -> dict[str, str]:
    return {check.row.scenario_id: check.verdict for check in found.checks}


STRAIGHT = RowSample(None, planners=("straight_ahead",))


@pytest.mark.parametrize(
    ("with_planner", "words"),
    few([(True, "the same planner fault"), (False, "its drive until the planner fault")], 1, 2),
)
def test_a_run_comes_again_with_its_faults_and_is_left_as_it_was(
    with_planner: bool, words: str, original: StoredRun
) -> None:
    before = {path: path.stat().st_mtime_ns for path in original.path.rglob("*")}
    found = checked(original.path, with_planner=with_planner)
    assert len(found.checks) == found.count("equal") == 4
    assert {check.reason for check in found.checks} == {"", words}
    assert {path: path.stat().st_mtime_ns for path in original.path.rglob("*")} == before


@pytest.mark.slow
def test_what_came_again_is_noted_until_its_row_changes(copy: Path) -> None:
    found = checked(copy, STRAIGHT)
    note_verified(found)
    noted = verified_rows(read_run(copy))
    assert {key[0]: each.means for key, each in noted.items()} == {"mine/0": "plans", "mine/1": "plans"}
    (line, other) = make_table([read_run(copy)]).lines
    assert (line.verified, other.verified) == (2, 0)
    rewritten(copy, lambda row: more(row, -0.1))
    assert {key[0] for key in verified_rows(read_run(copy))} == {"mine/0"}
    note_verified(checked(copy, STRAIGHT))
    rewritten(copy, lambda row: more(row, 0.1))
    assert {key[0] for key in verified_rows(read_run(copy))} == {"mine/0"}
    note_verified(checked(copy, STRAIGHT))
    assert {key[0] for key in verified_rows(read_run(copy))} == {"mine/0", "mine/1"}
    rewritten(copy, lambda row: structs.replace(row, metrics=row.metrics | {"mine": MetricRecord(0.5, {}, None)}))
    assert {key[0] for key in verified_rows(read_run(copy))} == {"mine/0"}, "judged by other metrics"


def test_a_damaged_note_is_one_line(copy: Path) -> None:
    (copy / "verified.json").write_text('{"rows": [{}]}')
    with pytest.raises(RunFolderError, match=r"verified\.json is damaged .* delete it and verify again"):
        verified_rows(read_run(copy))


def test_plans_that_were_tampered_with_make_another_drive(copy: Path, original: StoredRun) -> None:
    place = copy / str(original.rows["mine/0", "straight_ahead", 0].trace) / "plans.parquet"
    table = pd.read_parquet(place)
    table["x"] += 0.01 * (table["frame"] == 8)
    table.to_parquet(place)
    check = checked(copy, replace(STRAIGHT, scenarios=("*/0",))).checks[0]
    assert check.verdict == "differs"
    assert check.difference is None or check.difference.frame >= 8


def test_a_metric_that_was_tampered_with_is_found(copy: Path) -> None:
    def easier(row: Row) -> Row:
        judged = next(name for name, each in row.metrics.items() if each.score == 1.0 and name not in row.gates)
        return structs.replace(row, metrics=row.metrics | {judged: structs.replace(row.metrics[judged], score=0.5)})

    rewritten(copy, lambda row: row if row.fault else easier(row))
    check = checked(copy, STRAIGHT).checks[1]
    assert check.verdict == "differs"
    assert "the same drive and score, but its metric" in check.reason


@pytest.mark.slow
def test_a_worker_makes_the_same_drives(original: StoredRun) -> None:
    found = verify(original, RowSample(1, planners=("straight_ahead",)), RunOptions(workers=1))
    assert found.count("equal") == 1


def test_a_trace_that_was_tampered_with_is_found_though_its_row_is_honest(copy: Path, original: StoredRun) -> None:
    place = copy / str(original.rows["mine/1", "straight_ahead", 0].trace) / "ego.parquet"
    table = pd.read_parquet(place)
    table["center_x"] += 0.5 * (table.index == 5)
    table.to_parquet(place)
    found = checked(copy, STRAIGHT)
    assert verdicts(found) == {"mine/0": "equal", "mine/1": "differs"}
    assert "its trace file does not" in found.checks[1].reason


def test_a_row_and_trace_of_another_drive_are_found_with_step_and_distance(copy: Path, original: StoredRun) -> None:
    place = copy / str(original.rows["mine/1", "straight_ahead", 0].trace)
    table = pd.read_parquet(place / "actors.parquet")
    row = table.index[table["frame"] == 7][0]
    table["x"] += 0.5 * (table.index == row)
    table.to_parquet(place / "actors.parquet")
    rewritten(copy, lambda row: row if row.fault else structs.replace(row, trace_hash=Trace.read(place).hash()))
    (check,) = checked(copy, replace(STRAIGHT, scenarios=("*/1",))).checks
    assert check.verdict == "differs"
    assert check.difference is not None
    assert check.difference.frame == 7
    assert check.difference.time_s == pytest.approx(0.7)
    assert check.difference.what.startswith(f"actor {table.loc[row, 'track_token']}: x ")
    assert check.difference.largest_m == pytest.approx(0.5)
    assert not check.within_bars


@pytest.mark.slow
def test_a_score_that_was_tampered_with_is_found(copy: Path) -> None:
    rewritten(copy, lambda row: more(row, -2 * SCORE_BAR))
    assert verdicts(checked(copy, STRAIGHT))["mine/1"] == "differs"
    rewritten(copy, lambda row: more(row, 1.5 * SCORE_BAR))
    assert verdicts(checked(copy, STRAIGHT))["mine/1"] == "equal"


def test_without_trace_files_there_are_no_plans_to_drive(copy: Path) -> None:
    shutil.rmtree(copy / "traces")
    found = checked(copy, STRAIGHT)
    assert verdicts(found) == {"mine/0": "unverifiable", "mine/1": "unverifiable"}
    assert "--with-planner drives the planner again" in found.checks[0].reason


@pytest.mark.slow
def test_a_missing_trace_file_leaves_the_hash_to_compare(copy: Path) -> None:
    shutil.rmtree(copy / "traces")
    found = checked(copy, STRAIGHT, with_planner=True)
    assert verdicts(found) == {"mine/0": "equal", "mine/1": "equal"}
    assert found.checks[0].reason == "no trace file: only the hashes were compared"
    rewritten(copy, lambda row: structs.replace(row, trace_hash="0" * 64))
    assert verdicts(checked(copy, STRAIGHT, with_planner=True))["mine/1"] == "differs"


@pytest.mark.parametrize(
    ("fault", "verdict", "words"),
    [
        (Fault("planner", "raised anything"), "equal", "the same planner fault"),
        (Fault("timeout", "no result"), "differs", "a timeout fault then, a planner fault now"),
        (None, "differs", "now it ends in a planner fault"),
    ],
)
def test_a_fault_must_come_again_with_its_class(fault: Fault | None, verdict: str, words: str, copy: Path) -> None:
    rewritten(copy, lambda row: structs.replace(row, fault=fault, score=0.0) if row.planner == RAISES else row)
    again = RowSample(None, scenarios=("mine/1",), planners=(RAISES,))
    (check,) = checked(copy, again, with_planner=True).checks
    assert check.verdict == verdict
    assert words in check.reason


def test_a_drive_that_ended_early_cannot_pass_for_a_whole_one(copy: Path) -> None:
    rewritten(copy, lambda row: structs.replace(row, fault=None, score=0.0))
    (check,) = checked(copy, RowSample(None, scenarios=("mine/1",), planners=(RAISES,))).checks
    assert check.verdict == "differs"
    assert "no more plans are stored" in check.reason


def test_a_fault_that_does_not_come_again_differs(copy: Path) -> None:
    fault = Fault("planner", "raised ValueError")
    rewritten(copy, lambda row: structs.replace(row, fault=fault, score=0.0))
    (check,) = checked(copy, replace(STRAIGHT, scenarios=("mine/1",)), with_planner=True).checks
    assert check.verdict == "differs"
    assert "does not now: raised ValueError" in check.reason


def test_rows_without_a_score_are_left_out_and_counted(copy: Path) -> None:
    fault = Fault("traffic", "SUMO gave up")
    rewritten(copy, lambda row: structs.replace(row, fault=fault, score=None))
    found = checked(copy)
    assert [check.row.scenario_id for check in found.checks] == ["mine/0", "mine/0"]
    assert found.left_out == 2


@pytest.mark.slow
def test_other_versions_are_named(copy: Path) -> None:
    changes = {"planner_hash": "0" * 64}
    rewritten(copy, lambda row: structs.replace(row, versions=row.versions | {"sumo": "1.20.0"}, **changes))
    assert "planner" not in checked(copy, STRAIGHT).checks[1].changed_versions
    still, other = checked(copy, STRAIGHT, with_planner=True).checks
    assert still.changed_versions == {}
    assert other.changed_versions.keys() == {"sumo", "planner"}
    assert other.changed_versions["sumo"][0] == "1.20.0"
    assert other.changed_versions["planner"][0] == "0" * 12


@pytest.mark.slow
def test_a_run_with_ones_own_vehicle_types_comes_again_from_the_copy_that_it_keeps(tmp_path: Path) -> None:
    file = tmp_path / "mine.xml"
    shutil.copy(routes_root() / "urban.xml", file)
    stored = driven(tmp_path / "own, with a comma", traffic=file)
    assert (stored.path / "traffic" / "mine.xml").read_bytes() == file.read_bytes()
    file.unlink()
    assert checked(stored.path).count("equal") == 2


@pytest.mark.slow
def test_ones_own_vehicle_types_are_looked_for_where_the_copy_is_not_what_was_driven(tmp_path: Path) -> None:
    file = tmp_path / "mine.xml"
    shutil.copy(routes_root() / "urban.xml", file)
    command = ("interplan-sumo", "run", "--traffic", str(file))
    stored = driven(tmp_path / "own", traffic=file, command=command)
    shutil.copy(routes_root() / "mixed.xml", stored.path / "traffic" / "mine.xml")
    assert checked(stored.path).count("equal") == 2
    moved = file.rename(tmp_path / "moved.xml")
    with pytest.raises(InputError, match=r"cannot find mine\.xml, .* give it as --traffic"):
        checked(stored.path)
    assert checked(stored.path, traffic=moved).count("equal") == 2
    with pytest.raises(InputError, match="is not the vehicle-type file"):
        checked(stored.path, traffic=routes_root() / "mixed.xml")


def test_a_vehicle_type_file_of_a_run_that_had_none_is_refused(original: StoredRun) -> None:
    with pytest.raises(InputError, match="was not driven with --traffic"):
        checked(original.path, traffic=routes_root() / "mixed.xml")


def test_a_sample_depends_on_its_seed_alone_and_grows_without_losing_rows(original: StoredRun) -> None:
    def drawn(size: int | None, seed: int) -> set[object]:
        from interplan_sumo.batch.verify import _candidates, _drawn

        sample = RowSample(size, seed)
        return set(_drawn(_candidates(original, sample), sample))

    assert len(drawn(2, 0)) == 2
    assert drawn(2, 0) == drawn(2, 0)
    assert drawn(1, 0) < drawn(2, 0) < drawn(3, 0)
    assert drawn(9, 0) == drawn(None, 0) == set(original.rows)
    assert len({frozenset(drawn(2, seed)) for seed in range(20)}) > 1


@pytest.mark.parametrize(
    ("sample", "error", "words"),
    [
        (RowSample(0), InputError, "sample is 0, expected 1 or more"),
        (RowSample(scenarios=("mine/7",)), UnknownNameError, "Did you mean"),
        (RowSample(planners=("idm",)), UnknownNameError, "no planner in"),
    ],
)
def test_what_the_run_does_not_hold_is_one_line(
    sample: RowSample, error: type[Exception], words: str, original: StoredRun
) -> None:
    with pytest.raises(error, match=words):
        checked(original.path, sample)


def test_an_empty_run_is_one_line(copy: Path) -> None:
    (copy / "results.jsonl").write_text("")
    with pytest.raises(RunFolderError, match="there is nothing to verify"):
        checked(copy)


def test_a_planner_that_is_gone_is_one_line(copy: Path) -> None:
    (copy / "results.jsonl").write_text((copy / "results.jsonl").read_text().replace(RAISES, "gone.away:Planner"))
    with pytest.raises(PlannerLoadError, match=r"there is no module 'gone\.away'"):
        checked(copy, with_planner=True)
    assert checked(copy, STRAIGHT).count("equal") == 2


# --- where two traces part ---


@pytest.fixture(scope="module")
def trace(original: StoredRun) -> Trace:
    return Trace.read(original.path / str(original.rows["mine/1", "straight_ahead", 0].trace))


def moved(trace: Trace, frame: int, by_m: float) -> Trace:
    """The trace with the ego's centre elsewhere in one frame."""
    x_m = trace.ego.x_m.copy()
    x_m[frame] += by_m
    return replace(trace, ego=replace(trace.ego, x_m=x_m))


def test_equal_traces_do_not_part(trace: Trace) -> None:
    assert difference(trace, trace) is None
    assert difference(trace, moved(trace, 3, 1e-9)) is None


@pytest.mark.parametrize(("by_m", "within"), [(0.9 * POSITION_BAR_M, True), (1.1 * POSITION_BAR_M, False)])
def test_a_millimetre_is_the_bar(by_m: float, within: bool, trace: Trace) -> None:
    parted = difference(trace, moved(trace, 3, by_m))
    assert parted is not None
    assert (parted.frame, parted.within_bar) == (3, within)
    assert parted.what.startswith("ego: x ")
    assert parted.largest_m == pytest.approx(by_m, rel=1e-4)


def test_a_drive_that_ends_sooner_is_beyond_any_bar(trace: Trace) -> None:
    table = trace.ego
    columns = {name: getattr(table, name)[:-1] for name in table.__dataclass_fields__}
    shorter = replace(trace, ego=replace(table, **columns), signals=trace.signals[:-1])
    parted = difference(trace, shorter)
    assert parted is not None
    assert parted.what == "ego: only stored"
    assert not parted.only_numbers
    assert not parted.within_bar


def test_an_actor_of_another_name_is_beyond_any_bar(trace: Trace) -> None:
    ids = trace.actors.ids.copy()
    ids[0] = "zzzz"
    parted = difference(trace, replace(trace, actors=replace(trace.actors, ids=ids)))
    assert parted is not None
    assert (parted.frame, parted.only_numbers, parted.within_bar) == (0, False, False)
    assert parted.what.endswith((": only stored", ": only now"))


@pytest.mark.parametrize(("score", "within"), [(0.5 + 0.9e-6, True), (0.5 + 1.1e-6, False), (None, False)])
def test_a_millionth_of_a_score_is_the_bar(score: float | None, within: bool) -> None:
    parted = TraceDifference(3, 0.3, "ego: x", 1e-4, only_numbers=True)
    check = RowCheck(a_row("mine/1", 0.5), "differs", "", "1", score, parted)
    assert check.within_bars is within


def test_what_is_not_a_number_is_no_distance(trace: Trace) -> None:
    gone = replace(trace, actors=replace(trace.actors, behaviour=np.full(len(trace.actors), "other", dtype=object)))
    parted = difference(trace, gone)
    assert parted is not None
    assert "behaviour" in parted.what
    assert (parted.largest_m, parted.within_bar) == (0.0, False)
