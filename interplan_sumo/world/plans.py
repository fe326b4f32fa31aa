"""Plans of a drive, frame by frame, as a table and as plain bytes.

The bytes are those of five columns one after the other, each little-endian float64: frame, time_s, x, y, heading. So
`numpy.fromfile(file, "<f8").reshape(5, -1)` reads them, and nothing in them can be anything but a number.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.trajectory import Trajectory

if TYPE_CHECKING:
    import pandas as pd

PLAN_COLUMNS: Final = ("frame", "time_s", "x", "y", "heading")
ROW_BYTES: Final = 8 * len(PLAN_COLUMNS)


def plan_table(plans: Sequence[Trajectory]) -> pd.DataFrame:
    """A row per pose of each plan."""
    import pandas as pd

    columns = _columns(plans)
    return pd.DataFrame({"frame": columns[0].astype(np.int64)} | dict(zip(PLAN_COLUMNS[1:], columns[1:], strict=True)))


def plans_of(table: pd.DataFrame) -> tuple[Trajectory, ...]:
    """The plans of a table; ValueError if it holds none that can be driven."""
    return _plans([table[name].to_numpy(np.float64) for name in PLAN_COLUMNS])


def plan_bytes(plans: Sequence[Trajectory]) -> bytes:
    """The plans to the bit."""
    return np.stack(_columns(plans)).astype("<f8").tobytes()


def plans_from(content: bytes) -> tuple[Trajectory, ...]:
    """What `plan_bytes` made; ValueError if it was not that."""
    if len(content) % ROW_BYTES:
        raise ValueError(f"{len(content)} bytes are not {len(PLAN_COLUMNS)} columns of numbers")
    columns = np.frombuffer(content, "<f8").reshape(len(PLAN_COLUMNS), -1).astype(np.float64)
    frame = columns[0]
    steps = np.diff(frame, prepend=-1.0)
    if not np.isin(steps, (0.0, 1.0)).all() or (len(frame) and frame[0] != 0.0):
        raise ValueError("the frames of its plans do not count up from 0")
    return _plans(list(columns))


def _columns(plans: Sequence[Trajectory]) -> list[Floats]:
    def stacked(name: str) -> Floats:
        return np.concatenate([getattr(plan, name) for plan in plans] or [np.zeros(0)])

    frame = np.repeat(np.arange(len(plans), dtype=np.float64), [len(plan) for plan in plans])
    return [frame, *(stacked(name) for name in ("time_s", "x_m", "y_m", "heading_rad"))]


def _plans(columns: Sequence[Floats]) -> tuple[Trajectory, ...]:
    frame = columns[0]
    split = np.searchsorted(frame, np.arange(int(frame[-1]) + 2 if len(frame) else 1))
    return tuple(Trajectory(*(column[a:b] for column in columns[1:])) for a, b in pairwise(split))
