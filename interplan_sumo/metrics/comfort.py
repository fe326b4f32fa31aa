"""Comfort: did accelerations, jerks and turning stay inside what passengers accept?"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from interplan_sumo.metrics.circumstances import ego_doing
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.metric import MetricResult, metric
from interplan_sumo.world.geometry import Floats

BOUNDS: dict[str, tuple[float, float]] = {
    "longitudinal_acceleration_mps2": (-4.05, 2.40),
    "lateral_acceleration_mps2": (-4.89, 4.89),
    "jerk_mps3": (-8.37, 8.37),
    "longitudinal_jerk_mps3": (-4.13, 4.13),
    "yaw_rate_radps": (-0.95, 0.95),
    "yaw_acceleration_radps2": (-1.93, 1.93),
}
"""nuPlan's limits; every frame of every signal must lie strictly inside."""


def roughest_frame(_: Facts, result: MetricResult) -> int:
    """Where a signal is farthest beyond its bounds, in widths of them."""
    return int(np.argmax(np.max(list(_excess(result.series).values()), axis=0)))


@metric(failure="uncomfortable", lost_at=roughest_frame)
def comfort(facts: Facts) -> MetricResult:
    """1 if all six signals stay inside their bounds on every frame, else 0.

    A drive too short to have such signals scores 1.
    """
    signals = facts.comfort_signals
    inside = {name: bool(((values > low) & (values < high)).all()) for name, values, low, high in _bounded(signals)}
    detail = {name: {**extremes(values), "within": inside[name]} for name, values in signals.items()}
    score = 1.0 if all(inside.values()) else 0.0
    return MetricResult(score, detail, signals, None if score else _reason(facts, signals))


def extremes(values: Floats) -> dict[str, float | None]:
    """Largest, smallest, mean and 90th percentile (closest observation, nuPlan's choice); None without values."""
    if not len(values):
        return {"max": None, "min": None, "mean": None, "p90": None}
    return {
        "max": float(values.max()),
        "min": float(values.min()),
        "mean": float(values.mean()),
        "p90": float(np.percentile(values, 90, method="closest_observation")),
    }


def _excess(signals: Mapping[str, Floats]) -> dict[str, Floats]:
    """How far beyond its bounds each signal is, in widths of them; negative inside."""
    return {n: np.maximum(low - v, v - high) / (high - low) for n, v, low, high in _bounded(signals)}


def _bounded(signals: Mapping[str, Floats]) -> list[tuple[str, Floats, float, float]]:
    return [(name, values, *BOUNDS[name]) for name, values in signals.items()]


def _reason(facts: Facts, signals: dict[str, Floats]) -> str:
    excess = _excess(signals)
    worst = max(excess, key=lambda name: float(excess[name].max()))
    frame = int(np.argmax(excess[worst]))
    name, _, unit = worst.rpartition("_")
    units = {"mps2": "m/s2", "mps3": "m/s3", "radps": "rad/s", "radps2": "rad/s2"}
    low, high = BOUNDS[worst]
    return (
        f"{name.replace('_', ' ')} of {signals[worst][frame]:.2f} {units[unit]} at {facts.time_s[frame]:.1f} s, "
        f"allowed {low:g} to {high:g}; the ego was {ego_doing(facts, frame)}"
    )
