"""Golden values: where they lie, how near ours must be, and how a stored value is compared with ours."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

SHIPPED = Path(__file__).parent / "golden"
GOLDEN = Path(os.environ.get("INTERPLAN_GOLDEN") or SHIPPED)
"""Holds any of nuplan_metrics, nuplan_controller and nuplan_idm; INTERPLAN_GOLDEN names another folder."""
TOLERANCE = 1e-6


@dataclass(frozen=True)
class Pair:
    """A stored value beside ours; both (K,) arrays of floats, or anything that is compared by ==."""

    what: str
    expected: Any
    got: Any

    @property
    def count(self) -> int:
        """How many values are compared: numbers of an array, entries of a list, else one."""
        return len(self.expected) if isinstance(self.expected, np.ndarray | list | dict) else 1

    @property
    def difference(self) -> float:
        """Largest absolute difference; infinite if shapes, kinds or exact things differ."""
        if not isinstance(self.expected, np.ndarray):
            return 0.0 if self.expected == self.got else float("inf")
        if not isinstance(self.got, np.ndarray) or self.expected.shape != self.got.shape:
            return float("inf")
        same = (self.expected == self.got) | (np.isnan(self.expected) & np.isnan(self.got))
        if same.all():
            return 0.0
        gap = np.abs(self.expected[~same] - self.got[~same])
        return float("inf") if np.isnan(gap).any() else float(gap.max())


def floats(value: Any) -> np.ndarray:
    """Numbers of a stored file or of ours as (K,); None, which stands for no number, becomes nan."""
    return np.array([np.nan if v is None else float(v) for v in np.atleast_1d(np.asarray(value, dtype=object))])
