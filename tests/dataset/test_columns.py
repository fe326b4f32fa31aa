"""Columns: joined, picked from, written and read, ragged ones too."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_sumo.dataset.columns import Columns, count_of, joined, picked, ragged, read_arrays, stacked, write_arrays
from interplan_sumo.errors import InputError
from interplan_sumo.features import schema

EDGES = st.lists(st.integers(0, 99), max_size=3)


def sample(number: int, edges: list[int]) -> dict[str, Any]:
    """A sample that is all zeros but for its number and its edges."""
    empty = {f.name: np.zeros([n or 0 for n in f.shape], dtype=f.dtype) for f in schema.FIELDS}
    return {**empty, "tick": number, "expert_edges": edges}


def columns(*edges: list[int]) -> Columns:
    return stacked([sample(number, each) for number, each in enumerate(edges)])


def edges_of(found: Columns) -> list[list[int]]:
    return [each.tolist() for each in ragged(found, "expert_edges")]


def test_a_ragged_field_is_its_numbers_and_where_each_sample_begins() -> None:
    found = columns([7, 8], [], [9])
    assert found["expert_edges"].tolist() == [7, 8, 9]
    assert found["expert_edges_offsets"].tolist() == [0, 2, 2, 3]
    assert edges_of(found) == [[7, 8], [], [9]]
    alone = {name: found[name] for name in ("expert_edges", "expert_edges_offsets")}
    assert count_of(found) == count_of(alone) == 3
    assert count_of(picked(alone, np.array((1,)))) == 1


def test_types_and_shapes_are_those_of_the_schema_also_of_no_samples() -> None:
    for found in (stacked([]), columns([1])):
        for field in schema.FIELDS:
            assert found[field.name].dtype == field.dtype, field.name
            if None not in field.shape:
                assert found[field.name].shape[1:] == field.shape, field.name


@settings(max_examples=8)
@given(st.lists(st.lists(EDGES, min_size=1, max_size=4), min_size=1, max_size=3), st.data())
def test_whatever_is_joined_and_picked_is_what_was_put_in(parts: list[list[list[int]]], data: st.DataObject) -> None:
    whole = joined([columns(*part) for part in parts])
    put_in = [edges for part in parts for edges in part]
    assert edges_of(whole) == put_in
    rows = data.draw(st.lists(st.integers(0, len(put_in) - 1), max_size=5))
    assert edges_of(picked(whole, np.array(rows, dtype=np.int64))) == [put_in[row] for row in rows]


def test_equal_columns_give_equal_bytes_and_are_read_as_they_were(tmp_path: Path) -> None:
    found = columns([1], [2, 3])
    for name in ("a.npz", "b.npz"):
        write_arrays(tmp_path / name, found)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    again = read_arrays(tmp_path / "a.npz")
    assert again.keys() == found.keys()
    for name, values in found.items():
        np.testing.assert_array_equal(again[name], values)
        assert again[name].dtype == values.dtype
    assert list(read_arrays(tmp_path / "a.npz", ["tick"])) == ["tick"]


@pytest.mark.parametrize("damage", ["cut", "foreign", "pickled", "missing"])
def test_a_damaged_file_is_named(tmp_path: Path, damage: str) -> None:
    path = tmp_path / "a.npz"
    write_arrays(path, columns([1]))
    if damage == "cut":
        path.write_bytes(path.read_bytes()[:-50])
    elif damage == "foreign":
        path.write_text("no archive")
    elif damage == "pickled":
        np.savez(path, tick=np.array([{}], dtype=object))
    else:
        path.unlink()
    with pytest.raises(InputError, match=r"a\.npz.*export the data again"):
        read_arrays(path)
