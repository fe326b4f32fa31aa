"""Tables as CSV files, read as strictly as they are written."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from math import isfinite, nan
from pathlib import Path

from interplan_sumo.errors import InputError
from interplan_sumo.world.files import OTHER_FOLDER, writing


def write_table(path: Path, names: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a table as CSV; InputError if it cannot be written."""
    with writing(path.parent, OTHER_FOLDER), path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(names)
        table.writerows(rows)


def read_table(path: Path, names: Sequence[str]) -> list[dict[str, str]]:
    """The rows of a table as `write_table` wrote it; InputError if it cannot be read or lacks one of these columns."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            table = csv.DictReader(file, restval="")
            missing = [name for name in names if name not in (table.fieldnames or ())]
            if missing:
                raise InputError(f"{path} has no column {missing[0]}, expected {', '.join(names)}")
            return list(table)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from None


def number_in(text: str, path: Path) -> float:
    """A finite number of a table; InputError for something else."""
    try:
        number = float(text)
    except ValueError:
        number = nan
    if not isfinite(number):
        raise InputError(f"{path}: {text!r} is no number")
    return number
