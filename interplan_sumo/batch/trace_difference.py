"""Trace difference: where two traces of one drive part, and how far apart they come."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.trace import SEEN_COLUMNS, WITHOUT_EGO, Trace

POSITION_BAR_M = 1e-3
"""Positions this close count as those of one drive: across machines the last bits of a sum may differ."""
PER_UNIT = 1e6
"""Steps per metre, radian or second to which the trace hash rounds; what rounds to the same step is equal."""
NAMES = {
    "ego": (), "actors": ("track_token",), "signals": ("lane_connector_id",), "seen": ("track_token",),
    "plans": ("pose",),
}  # fmt: skip
"""What a row of each table is about, besides its frame; in the order in which one step makes them."""
POSITIONS = {"ego": ("center_x", "center_y"), "actors": ("x", "y"), "seen": ("x", "y"), "plans": ("x", "y")}
_NOT_COMPARED = ("frame", "plan_wall_s")
_BOTH, _NOW = "both", "_now"


@dataclass(frozen=True, slots=True)
class TraceDifference:
    """How a trace made again differs from the stored one."""

    frame: int
    """The first frame in which they differ; negative in what was seen before the start."""
    time_s: float
    what: str
    """What differs there: table, who, column, both values."""
    largest_m: float
    """Largest distance between the positions that both traces give the ego, an actor or a pose of a plan."""
    only_numbers: bool
    """Whether both have the same frames, actors, plans and lights, so that only numbers differ."""

    @property
    def within_bar(self) -> bool:
        """Whether it can be told from rounding at all."""
        return self.only_numbers and self.largest_m <= POSITION_BAR_M


def difference(stored: Trace, now: Trace) -> TraceDifference | None:
    """Where the trace made now parts from the stored one; None if all that is hashed agrees."""
    first: tuple[int, str] | None = None
    largest_m, only_numbers = 0.0, True
    tables, others = _numbered(stored), _numbered(now)
    for name, about in NAMES.items():
        keys = ["frame", *about]
        joined = tables[name].merge(others[name], how="outer", on=keys, suffixes=("", _NOW), indicator="held")
        joined = joined.sort_values(keys, kind="stable", ignore_index=True)
        columns = [c for c in tables[name].columns if c not in (*_NOT_COMPARED, *about)]
        unequal = {column: _unequal(joined[column], joined[column + _NOW]) for column in columns}
        alone = joined["held"].to_numpy() != _BOTH
        only_numbers &= not alone.any() and not any(
            unequal[c].any() for c in columns if not pd.api.types.is_numeric_dtype(joined[c])
        )
        if name in POSITIONS:
            largest_m = max(largest_m, _largest_distance_m(joined, POSITIONS[name]))
        differs = np.flatnonzero(np.logical_or.reduce([alone, *unequal.values()]))
        if len(differs) and (first is None or joined["frame"][differs[0]] < first[0]):
            row = int(differs[0])
            column = None if alone[row] else next(c for c in columns if unequal[c][row])
            first = int(joined["frame"][row]), _said(name, joined.iloc[row], column)
    if first is None:
        return None
    frame, what = first
    time_us, since = (stored if frame < len(stored) else now).ego.time_us, max(frame, 0)
    return TraceDifference(frame, round(float(time_us[since]) * 1e-6, 6), what, largest_m, only_numbers)


def _numbered(trace: Trace) -> dict[str, pd.DataFrame]:
    """The tables of a trace as the hash sees them, the poses of each plan numbered."""
    tables = trace.tables()
    tables["actors"] = tables["actors"].drop(columns=WITHOUT_EGO, errors="ignore")
    tables.setdefault("seen", tables["actors"].loc[:, list(SEEN_COLUMNS)].head(0))
    tables["plans"]["pose"] = tables["plans"].groupby("frame").cumcount()
    return tables


def _unequal(here: pd.Series[Any], there: pd.Series[Any]) -> NDArray[np.bool_]:
    """(K,) whether the values differ as the hash sees them."""
    if not pd.api.types.is_numeric_dtype(here):
        return (here != there).to_numpy(np.bool_)
    return _rounded(here) != _rounded(there)


def _rounded(values: pd.Series[Any]) -> Floats:
    return np.nan_to_num(np.round(values.to_numpy(np.float64) * PER_UNIT))


def _largest_distance_m(joined: pd.DataFrame, columns: tuple[str, str]) -> float:
    apart = [joined[c].to_numpy(np.float64) - joined[c + _NOW].to_numpy(np.float64) for c in columns]
    return float(np.nan_to_num(np.hypot(*apart)).max(initial=0.0))


def _said(table: str, row: pd.Series[Any], column: str | None) -> str:
    """One row in words: `actor 3f2a: x 12.5, now 12.6`."""
    who = " ".join([table.rstrip("s"), *(str(row[name]) for name in NAMES[table])])
    if column is None:
        return f"{who}: only {'stored' if row['held'] == 'left_only' else 'now'}"
    return f"{who}: {column} {_value(row[column])}, now {_value(row[column + _NOW])}"


def _value(value: Any) -> str:
    return f"{value:.6f}".rstrip("0").rstrip(".") if isinstance(value, int | float | np.number) else str(value)
