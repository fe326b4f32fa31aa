"""What a metric returns."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class MetricResult:
    """One metric of one drive."""

    score: float | None
    """0 to 1; None where the metric informs only, or cannot be judged."""
    detail: Mapping[str, Any] = field(default_factory=dict)
    """Figures behind the score; plain numbers, texts, lists and dicts once through `plain`."""
    series: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    """Signals with one value per frame, for plots and debugging."""
    reason: str | None = None
    """One sentence where points are lost: what, when, with whom."""

    def as_json(self) -> dict[str, Any]:
        """Plain data without the series."""
        return {"score": plain(self.score), "detail": plain(self.detail), "reason": self.reason}


def plain(value: Any) -> Any:
    """The same value in JSON's types; numbers that are not finite become None."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


def extremes(values: NDArray[np.float64]) -> dict[str, float | None]:
    """Largest, smallest, mean and 90th percentile (closest observation, nuPlan's choice); None without values."""
    if not len(values):
        return {"max": None, "min": None, "mean": None, "p90": None}
    return {
        "max": float(values.max()),
        "min": float(values.min()),
        "mean": float(values.mean()),
        "p90": float(np.percentile(values, 90, method="closest_observation")),
    }
