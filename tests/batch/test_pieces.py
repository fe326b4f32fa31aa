"""Parquet pieces and rows read late: they say what the lines say, whatever happened to the files in between."""

from __future__ import annotations

import json
import os
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from interplan_sumo.batch import results, run_folder
from interplan_sumo.batch.briefs import Brief, brief_of
from interplan_sumo.batch.pieces import COLUMNS
from interplan_sumo.batch.records import AppliedOverrides, Fault, Row, row_of
from interplan_sumo.batch.results import StoredRows, line_of, write_rows
from interplan_sumo.batch.run_folder import RunFolder
from interplan_sumo.errors import RunFolderError
from tests import records
from tests.records import asked, manifest, metric

AT_ONCE = 3


@pytest.fixture(autouse=True)
def short_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(results, "LINES_AT_ONCE", AT_ONCE)
    monkeypatch.setattr(run_folder, "LINES_AT_ONCE", AT_ONCE)


def row(number: int, **changes: Any) -> Row:
    """A drive that changed lane; `changes` replace what it holds."""
    held: dict[str, Any] = {
        "score": number % 8 / 8.0, "gates": ("no_collision",), "weights": {"lane_changes": 4.0},
        "metrics": {"no_collision": metric(1.0), "lane_changes": metric(0.5, {"goal": False}, "a lane short")},
        "trace_hash": f"{number:064}", "times_s": {"total": 2.5}, "versions": {"sumo": "1.28.0"}, "traffic_version": 2,
        "reached_goal": True, "trace": f"traces/{number}",
    }  # fmt: skip
    return records.row(f"lane_change_ltd/{number}", **held | changes)


def opened(place: Path, count: int = 8) -> RunFolder:
    return RunFolder(place, manifest(asked(scenarios=" ".join(f"lane_change_ltd/{n}" for n in range(count)))))


def truth(place: Path) -> list[Row]:
    return [row_of(line) for line in (place / "results.jsonl").read_bytes().splitlines()]


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A finished run of seven drives, of which one ended in a fault."""
    fault = Fault("planner", "raised ValueError: Straße")
    nothing: dict[str, Any] = {"metrics": {}, "gates": (), "weights": {}, "trace": None}
    with opened(tmp_path) as folder:
        for number in range(6):
            folder.append(row(number))
        folder.append(row(6, score=0.0, fault=fault, overrides=AppliedOverrides(density="high"), **nothing))
    return tmp_path


def pieces(place: Path) -> dict[str, int]:
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


def test_pieces_are_written_while_rows_come_in_and_the_rest_at_the_end(tmp_path: Path) -> None:
    with opened(tmp_path) as folder:
        for number in range(AT_ONCE - 1):
            folder.append(row(number))
        assert not (tmp_path / "results").exists()
        folder.append(row(AT_ONCE - 1))
        assert list(pieces(tmp_path)) == ["part-00000.parquet"]
        folder.append(row(AT_ONCE))
        assert list(pieces(tmp_path)) == ["part-00000.parquet"]
    assert list(pieces(tmp_path)) == ["part-00000.parquet", "part-00001.parquet"]


def test_going_on_keeps_full_pieces_and_makes_the_last_one_again(place: Path) -> None:
    before = pieces(place)
    with opened(place) as folder:
        folder.append(row(7))
    after = pieces(place)
    assert [name for name in before if after[name] == before[name]] == ["part-00000.parquet", "part-00001.parquet"]
    assert len(pd.read_parquet(place / "results")) == 8


def test_an_interrupted_run_leaves_whole_pieces_and_the_next_one_completes_them(place: Path) -> None:
    folder = opened(place)
    folder.append(row(7))
    folder.__exit__(KeyboardInterrupt, KeyboardInterrupt(), None)
    assert len(pd.read_parquet(place / "results")) == 7
    opened(place).__exit__(None, None, None)
    assert len(pd.read_parquet(place / "results")) == 8


def changed_line(place: Path) -> None:
    rows = enumerate(truth(place))
    write_rows(place / "results.jsonl", [replace(each, score=0.875) if n == 1 else each for n, each in rows])


def deleted_line(place: Path) -> None:
    lines = (place / "results.jsonl").read_bytes().splitlines(keepends=True)
    (place / "results.jsonl").write_bytes(b"".join(lines[1:]))


def foreign_piece(place: Path) -> None:
    pd.DataFrame({"score": [1.0, 1.0, 1.0]}).to_parquet(place / "results" / "part-00000.parquet")


def forged_piece(place: Path) -> None:
    path = place / "results" / "part-00000.parquet"
    table = pq.read_table(path)
    at = table.schema.get_field_index("score")
    forged = table.set_column(at, table.schema.field(at), pa.array([1.0] * len(table)))
    pq.write_table(forged.replace_schema_metadata(table.schema.metadata), path)


def swapped_pieces(place: Path) -> None:
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


OF_LINES = (changed_line, deleted_line)
DAMAGES = (*OF_LINES, foreign_piece, forged_piece, swapped_pieces, no_parquet, cut_short, a_bit_fell_over)


@pytest.mark.parametrize("damage", DAMAGES)
def test_the_same_command_makes_them_again(damage: Callable[[Path], None], place: Path) -> None:
    damage(place)
    with opened(place):
        pass
    rows = truth(place)
    assert pd.read_parquet(place / "results")["score"].tolist() == [each.score for each in rows]
    assert list(pieces(place)) == [f"part-{n:05}.parquet" for n in range(-(-len(rows) // AT_ONCE))]


def test_pieces_that_cannot_be_written_are_an_error_in_one_line(tmp_path: Path) -> None:
    folder = opened(tmp_path)
    (tmp_path / "results").touch()
    with pytest.raises(RunFolderError, match="cannot write the run folder"):
        folder.__exit__(None, None, None)


VALUES = st.none() | st.floats(0.0, 1.0)


@pytest.mark.slow
@settings(max_examples=10)
@given(VALUES, VALUES, st.none() | st.booleans(), st.none() | st.text(), st.booleans())
def test_a_line_and_its_row_have_the_same_brief(
    score: float | None, found: float | None, goal: bool | None, fault: str | None, official: bool
) -> None:
    because = Fault("timeout", fault or "killed") if fault or score is None else None
    held = {"no_collision": metric(found), "lane_changes": metric(None, {"goal": goal})}
    made = row(1, score=score, metrics=held, gates=(), weights={}, fault=because, official=official)
    assert brief_of(line_of(made)) == (made.key, Brief.of(made))
    assert (Brief.of(made).no_collision, Brief.of(made).goal_lane) == (found, goal)


# --- rows read late ---


def test_a_row_is_read_when_it_is_asked_for_and_not_kept(tmp_path: Path) -> None:
    count = 300
    write_rows(tmp_path / "results.jsonl", (row(n, printed="x" * 20_000) for n in range(count)))
    tracemalloc.start()
    rows = StoredRows.read(tmp_path)
    assert sum(len(each.printed) for each in rows.values()) == count * 20_000
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
