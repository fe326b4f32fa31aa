"""Why: one sentence for every zero and for every lost point."""

from __future__ import annotations

from interplan_sumo.batch.records import Row
from interplan_sumo.metrics.metric import METRICS, failure_words

LEAST_LOSS = 0.0005
"""A metric that loses less, of 1, lost nothing that a table shows."""


def why_lost(row: Row) -> list[str]:
    """A sentence for the fault, for each gate that took points, or for a score of zero without any; else nothing."""
    if row.fault:
        return [fault_sentence(row)]
    lost = [metric_sentence(row, name) for name in row.gates if row.judged[name] < 1.0]
    return lost or (["every weighted metric is zero"] if row.score == 0.0 else [])


def lost_points(row: Row) -> list[str]:
    """A sentence for the fault, or for each judged metric that lost points, gates first."""
    if row.fault:
        return [fault_sentence(row)]
    return [metric_sentence(row, name) for name, score in row.judged.items() if score < 1.0 - LEAST_LOSS]


def fault_sentence(row: Row) -> str:
    """Whose fault, and what happened."""
    return f"{row.fault.kind} fault: {row.fault.message}" if row.fault else ""


def metric_sentence(row: Row, name: str) -> str:
    """What a metric of the row says about the points it lost."""
    title = failure_words(name)
    reason = row.metrics[name].reason
    return f"{title}: {reason}" if reason else title


def metric_title(name: str) -> str:
    """What a metric is called on pages; the words of its name if it is not installed here."""
    return METRICS[name].title if name in METRICS else name.replace("_", " ")
