"""Why: one sentence for every zero and for every lost point."""

from __future__ import annotations

from interplan_sumo.batch.records import Row
from interplan_sumo.metrics.metric import METRICS, failure_words
from interplan_sumo.metrics.score import points_lost

LEAST_LOSS = 0.0005
"""What costs less, of a score of 1, is nothing that a table shows."""


def lost_points(row: Row) -> list[str]:
    """A sentence for the fault, or for each judged metric that cost points, gates first.

    Where gates are at 0 only they are told: with any of them the rest is worth nothing.
    """
    if row.fault:
        return [fault_sentence(row)]
    cost = points_lost(row.judged, row.gates, row.weights)
    return [metric_sentence(row, name, points) for name, points in cost.items() if points >= 100.0 * LEAST_LOSS]


def fault_sentence(row: Row) -> str:
    """Whose fault, and what happened."""
    return f"{row.fault.kind} fault: {row.fault.message}" if row.fault else ""


def metric_sentence(row: Row, name: str, points: float | None = None) -> str:
    """What a metric of the row says about the points it lost, and how many these are."""
    reason = row.metrics[name].reason
    title = failure_words(name) if points is None else with_points(failure_words(name), points)
    return f"{title}: {reason}" if reason else title


def with_points(words: str, points: float) -> str:
    """Words about a loss with what it cost of the 100 points."""
    return f"{words} ({points:.{0 if points >= 9.95 else 1}f} points)"


def metric_title(name: str) -> str:
    """What a metric is called on pages; the words of its name if it is not installed here."""
    return METRICS[name].title if name in METRICS else name.replace("_", " ")
