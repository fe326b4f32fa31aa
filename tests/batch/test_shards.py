"""Parquet shards and rows read late: they say what the lines say, whatever happened to the files in between."""

from __future__ import annotations

import json
import os
import tempfile
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_sumo.batch import results, run_folder
from interplan_sumo.batch.results import Brief, Row, row_key, write_rows
from interplan_sumo.batch.run_folder import RunFolder, read_run
from interplan_sumo.batch.shards import COLUMNS, keep_shards, read_briefs
from interplan_sumo.batch.stored_rows import StoredRows
from interplan_sumo.errors import RunFolderError

AT_ONCE = 3


@pytest.fixture(autouse=True)
def short_shards(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(results, "LINES_AT_ONCE", AT_ONCE)
    monkeypatch.setattr(run_folder, "LINES_AT_ONCE", AT_ONCE)


def row(number: int, **changes: Any) -> Row:
    """A drive that changed lane; `changes` replace what it holds."""
    metrics = {
        "no_collision": {"score": 1.0, "detail": {}, "reason": None},
        "lane_changes": {"score": 0.5, "detail": {"goal": False}, "reason": "a lane short"},
    }
    return {
        "scenario_id": f"lane_change_ltd/{number}", "family": "lane_change_ltd", "planner": "idm", "seed": 0,
        "score": number / 8.0, "metrics": metrics, "gates": ["no_collision"], "weights": {"lane_changes": 4.0},
        "fault": None, "official": True, "overrides": {}, "trace_hash": f"{number:064}", "times_s": {"total": 2.5},
        "versions": {"sumo": "1.28.0"}, "reached_goal": True, "trace": f"traces/{number}", **changes,
    }  # fmt: skip


def opened(place: Path, count: int = 8) -> RunFolder:
    request = {"planners": ["idm"], "scenarios": [f"lane_change_ltd/{n}" for n in range(count)], "seeds": 1}
    return RunFolder(place, {"suite": "toy==1"}, request, {})


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A finished run of seven drives, of which one ended in a fault."""
    fault = {"class": "planner", "message": "raised ValueError: Straße"}
    with opened(tmp_path) as folder:
        for number in range(6):
            folder.append(row(number))
        folder.append(row(6, score=0.0, fault=fault, metrics={}, overrides={"density": "high"}, trace=None))
    return tmp_path


def shards(place: Path) -> dict[str, int]:
    """Their names and which files they are."""
    return {path.name: path.stat().st_ino for path in sorted((place / "results").iterdir())}


def test_a_finished_run_is_one_data_frame_with_what_the_lines_say(place: Path) -> None:
    frame = pd.read_parquet(place / "results")
    assert list(frame.columns) == [column.name for column in COLUMNS]
    assert frame["score"].tolist() == [n / 8.0 for n in range(6)] + [0.0]
    assert frame["metric_lane_changes"].tolist()[:6] == [0.5] * 6
    assert frame["metric_comfort"].isna().all()
    assert frame["reached_goal_lane"].tolist() == [False] * 6 + [None]
    assert frame["fault_class"].dropna().to_dict() == {6: "planner"}
    assert frame["fault_message"].iloc[6] == "raised ValueError: Straße"
    assert frame["override_density"].iloc[6] == "high"
    assert frame["trace"].dropna().tolist() == [f"traces/{n}" for n in range(6)]
    assert frame["total_s"].tolist() == [2.5] * 7
    assert json.loads(frame["versions"].iloc[0]) == {"sumo": "1.28.0"}


def test_shards_are_written_while_rows_come_in_and_the_rest_at_the_end(tmp_path: Path) -> None:
    with opened(tmp_path) as folder:
        for number in range(AT_ONCE - 1):
            folder.append(row(number))
        assert not (tmp_path / "results").exists()
        folder.append(row(AT_ONCE - 1))
        assert list(shards(tmp_path)) == ["part-00000.parquet"]
        folder.append(row(AT_ONCE))
        assert list(shards(tmp_path)) == ["part-00000.parquet"]
    assert list(shards(tmp_path)) == ["part-00000.parquet", "part-00001.parquet"]


def test_going_on_keeps_full_shards_and_makes_the_last_one_again(place: Path) -> None:
    before = shards(place)
    with opened(place) as folder:
        folder.append(row(7))
    after = shards(place)
    assert [name for name in before if after[name] == before[name]] == ["part-00000.parquet", "part-00001.parquet"]
    assert len(pd.read_parquet(place / "results")) == 8


def test_an_interrupted_run_leaves_whole_shards_and_the_next_one_completes_them(place: Path) -> None:
    folder = opened(place)
    folder.append(row(7))
    folder.__exit__(KeyboardInterrupt, KeyboardInterrupt(), None)
    assert len(pd.read_parquet(place / "results")) == 7
    opened(place).__exit__(None, None, None)
    assert len(pd.read_parquet(place / "results")) == 8


def changed_line(place: Path) -> None:
    rows = [json.loads(line) for line in (place / "results.jsonl").read_text().splitlines()]
    write_rows(place / "results.jsonl", (each | {"score": 0.875} if n == 1 else each for n, each in enumerate(rows)))


def deleted_line(place: Path) -> None:
    lines = (place / "results.jsonl").read_bytes().splitlines(keepends=True)
    (place / "results.jsonl").write_bytes(b"".join(lines[1:]))


def foreign_shard(place: Path) -> None:
    pd.DataFrame({"score": [1.0, 1.0, 1.0]}).to_parquet(place / "results" / "part-00000.parquet")


def swapped_shards(place: Path) -> None:
    os.replace(place / "results" / "part-00001.parquet", place / "results" / "part-00000.parquet")


def no_parquet(place: Path) -> None:
    (place / "results" / "part-00001.parquet").write_bytes(b"PAR1 and nothing more")
    (place / "results" / ".part-a1b2c3d4e5f60718").write_bytes(b"PAR1")
    (place / "results" / "part-00099.parquet").write_bytes(b"PAR1")


def cut_short(place: Path) -> None:
    content = (place / "results" / "part-00000.parquet").read_bytes()
    (place / "results" / "part-00000.parquet").write_bytes(content[: len(content) // 2])


def a_bit_fell_over(place: Path) -> None:
    content = bytearray((place / "results" / "part-00000.parquet").read_bytes())
    for at in range(4, len(content) // 4):
        content[at] ^= 1
    (place / "results" / "part-00000.parquet").write_bytes(content)


DAMAGES = (changed_line, deleted_line, foreign_shard, swapped_shards, no_parquet, cut_short, a_bit_fell_over)


@pytest.mark.parametrize("damage", DAMAGES)
def test_nobody_believes_a_shard_that_is_not_of_the_lines(damage: Callable[[Path], None], place: Path) -> None:
    damage(place)
    truth = [json.loads(line) for line in (place / "results.jsonl").read_text().splitlines()]
    stored = read_run(place)
    assert dict(stored.rows) == {row_key(each): each for each in truth}
    assert stored.briefs == {row_key(each): Brief.of(each) for each in truth}


@pytest.mark.parametrize("damage", DAMAGES)
def test_the_same_command_makes_them_again(damage: Callable[[Path], None], place: Path) -> None:
    damage(place)
    with opened(place):
        pass
    truth = [json.loads(line) for line in (place / "results.jsonl").read_text().splitlines()]
    assert pd.read_parquet(place / "results")["score"].tolist() == [each["score"] for each in truth]
    assert list(shards(place)) == [f"part-{n:05}.parquet" for n in range(-(-len(truth) // AT_ONCE))]


def test_a_value_of_another_type_is_named_with_its_lines(tmp_path: Path) -> None:
    write_rows(tmp_path / "results.jsonl", [row(n, trace=["no", "text"] if n == 4 else None) for n in range(7)])
    with pytest.raises(RunFolderError, match=r"results\.jsonl, lines 4 to 6: trace is no string everywhere"):
        keep_shards(tmp_path)


def test_shards_that_cannot_be_written_are_an_error_in_one_line(tmp_path: Path) -> None:
    folder = opened(tmp_path)
    (tmp_path / "results").touch()
    with pytest.raises(RunFolderError, match="cannot write the run folder"):
        folder.__exit__(None, None, None)


VALUES = st.none() | st.floats(0.0, 1.0)


@settings(max_examples=30)
@given(
    st.lists(st.tuples(VALUES, VALUES, st.none() | st.booleans(), st.none() | st.text(), st.booleans()), max_size=7),
)
def test_a_shard_and_the_lines_give_the_same_briefs(
    drives: list[tuple[float | None, float | None, bool | None, str | None, bool]],
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        rows: list[Row] = []
        for number, (score, metric, goal, fault, official) in enumerate(drives):
            metrics = {"no_collision": {"score": metric}, "lane_changes": {"score": 0.5, "detail": {"goal": goal}}}
            because = fault and {"class": fault, "message": fault}
            rows.append(row(number, score=score, metrics=metrics, fault=because or None, official=official))
        write_rows(place / "results.jsonl", rows)
        keep_shards(place)
        lines = list(results.whole_lines(place / "results.jsonl"))
        found = [pair for n, part in enumerate(lines) for pair in read_briefs(place, n, part) or [None]]
        assert found == [(row_key(each), Brief.of(each)) for each in rows]


# --- rows read late ---


def test_a_row_is_read_when_it_is_asked_for_and_not_kept(tmp_path: Path) -> None:
    count = 300
    write_rows(tmp_path / "results.jsonl", (row(n, text="x" * 20_000) for n in range(count)))
    tracemalloc.start()
    rows = StoredRows.read(tmp_path)
    assert sum(len(each["text"]) for each in rows.values()) == count * 20_000
    kept, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert kept / count < 1500
    assert peak < 20 * AT_ONCE * 20_000


def test_rows_are_a_mapping_in_the_order_of_the_file(place: Path) -> None:
    rows = StoredRows.read(place)
    assert [key[0] for key in rows] == [f"lane_change_ltd/{n}" for n in range(7)]
    assert rows["lane_change_ltd/3", "idm", 0] == row(3)
    assert ("lane_change_ltd/7", "idm", 0) not in rows
    with pytest.raises(KeyError):
        rows["lane_change_ltd/7", "idm", 0]
    only = rows.only([("lane_change_ltd/7", "idm", 0), ("lane_change_ltd/2", "idm", 0)])
    assert dict(only) == {("lane_change_ltd/2", "idm", 0): row(2)}
    assert only.briefs.keys() == only.keys()


def test_a_file_that_was_replaced_since_is_named(place: Path) -> None:
    rows = StoredRows.read(place)
    deleted_line(place)
    with pytest.raises(RunFolderError, match=r"results\.jsonl was replaced while it was read"):
        rows["lane_change_ltd/4", "idm", 0]
    (place / "results.jsonl").unlink()
    with pytest.raises(RunFolderError, match=r"cannot read .*results\.jsonl"):
        rows["lane_change_ltd/4", "idm", 0]
