"""Why points were lost: what is said, and what is too little to speak of."""

from __future__ import annotations

import pytest

from interplan_sumo.report.failure_reasons import lost_points, why_lost
from tests.report.rows import drive


@pytest.mark.parametrize(("progress", "said"), [(0.9996, []), (0.9994, ["little progress"]), (1.0, [])])
def test_a_loss_that_no_table_shows_is_not_spoken_of(progress: float, said: list[str]) -> None:
    assert lost_points(drive("nudge/0", 0.99, progress=progress)) == said


def test_a_zero_has_a_reason_and_gates_come_before_weighted_metrics() -> None:
    both = drive("nudge/0", 0.0, no_collision=0.0, progress=0.5)
    assert lost_points(both) == ["at-fault collision", "little progress"]
    assert why_lost(drive("nudge/0", 0.0)) == ["every weighted metric is zero"]
    assert why_lost(drive("nudge/0", 0.0, drivable_area=0.0)) == ["drivable area left"]
    assert why_lost(drive("nudge/0", 0.5, progress=0.5)) == []
    assert why_lost(drive("nudge/0", 0.0, fault=("planner", "plan() raised"))) == ["planner fault: plan() raised"]
