"""Columns: many samples as named arrays, one row a sample; joined, picked from, written and read.

A ragged field is two arrays: all its numbers one after the other, and
`<field>_offsets` (S + 1,): the numbers of sample i are offsets[i] to
offsets[i + 1]. Files are npz: zip archives of npy files, without pickles. Equal
columns give equal bytes.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.errors import InputError
from interplan_sumo.features.schema import BY_NAME

Columns = dict[str, NDArray[Any]]
RAGGED = frozenset(field.name for field in BY_NAME.values() if None in field.shape)
_LONG_AGO = (1980, 1, 1, 0, 0, 0)  # the earliest time a zip archive can tell
_UNIX = 3  # said of archives from Windows, too: equal columns, equal bytes


def offsets_name(field: str) -> str:
    return f"{field}_offsets"


def stacked(samples: Sequence[Mapping[str, Any]]) -> Columns:
    """Columns from one mapping per sample; types are those of the schema."""
    columns: Columns = {}
    for name, field in BY_NAME.items():
        values = [np.asarray(sample[name], dtype=field.dtype) for sample in samples]
        if name in RAGGED:
            columns[name] = np.concatenate([*values, np.zeros(0, dtype=field.dtype)])
            columns[offsets_name(name)] = np.cumsum([0, *map(len, values)], dtype=np.int64)
        else:
            shape = tuple(size or 0 for size in field.shape)
            columns[name] = np.array(values, dtype=field.dtype).reshape(len(samples), *shape)
    return columns


def joined(parts: Sequence[Columns]) -> Columns:
    """Several columns of the same fields, one after the other."""
    columns: Columns = {}
    for name in parts[0]:
        if name.removesuffix("_offsets") in RAGGED and name not in RAGGED:
            counts = np.concatenate([np.diff(part[name]) for part in parts])
            columns[name] = np.concatenate(([0], np.cumsum(counts))).astype(np.int64)
        else:
            columns[name] = np.concatenate([part[name] for part in parts])
    return columns


def picked(columns: Columns, rows: NDArray[np.int64]) -> Columns:
    """Some rows (K,), in the given order."""
    found: Columns = {}
    for name, values in columns.items():
        if name in RAGGED:
            starts = columns[offsets_name(name)]
            found[name] = np.concatenate(
                [values[:0], *(values[starts[row] : starts[row + 1]] for row in rows.tolist())]
            )
        elif name.removesuffix("_offsets") in RAGGED:
            found[name] = np.concatenate(([0], np.cumsum(np.diff(values)[rows]))).astype(np.int64)
        else:
            found[name] = values[rows]
    return found


def count_of(columns: Columns) -> int:
    """How many samples they are."""
    name, values = next(iter(columns.items()))
    return len(columns[offsets_name(name)]) - 1 if name in RAGGED else len(values)


def ragged(columns: Columns, field: str) -> list[NDArray[Any]]:
    """A ragged field as one array per sample."""
    return [columns[field][a:b] for a, b in pairwise(columns[offsets_name(field)].tolist())]


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]], *, level: int = 6) -> None:
    """Write an npz file; `level` 1 is quick, 9 small."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=level) as archive:
        for name, values in arrays.items():
            text = io.BytesIO()
            np.lib.format.write_array(text, np.asarray(values, order="C"), version=(1, 0), allow_pickle=False)
            entry = zipfile.ZipInfo(f"{name}.npy", _LONG_AGO)
            entry.create_system = _UNIX
            archive.writestr(entry, text.getbuffer(), zipfile.ZIP_DEFLATED, level)


def read_arrays(path: Path, names: Sequence[str] | None = None) -> Columns:
    """Some or all arrays of an npz file; InputError if it is damaged or lacks one."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            return {name: archive[name] for name in (archive.files if names is None else names)}
    except Exception as error:
        raise InputError(f"cannot read {path}: {error}; export the data again") from None
