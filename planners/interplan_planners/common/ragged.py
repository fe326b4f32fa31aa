"""Rows of unequal length as one table."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from interplan_sumo.world.geometry import Floats


def stacked(rows: Sequence[Floats]) -> Floats:
    """(N, S) rows, each of which goes on with its last value."""
    table = np.empty((len(rows), max(map(len, rows))))
    for line, row in zip(table, rows, strict=True):
        line[: len(row)] = row
        line[len(row) :] = row[-1]
    return table
