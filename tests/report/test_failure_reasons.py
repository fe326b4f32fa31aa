"""Why points were lost: what is said, and what is too little to speak of."""

from __future__ import annotations

import pytest

from interplan_sumo.report.failure_reasons import lost_points
from tests.report.rows import drive


@pytest.mark.parametrize(("progress", "said"), [(0.9992, []), (0.999, ["little progress (0.1 points)"]), (1.0, [])])
def test_a_loss_that_no_table_shows_is_not_spoken_of(progress: float, said: list[str]) -> None:
    assert lost_points(drive("nudge/0", 0.99, progress=progress)) == said


def test_everything_that_cost_points_is_told_gates_first() -> None:
    both = drive("nudge/0", 0.36, no_collision=0.5, progress=0.5)
    assert lost_points(both) == ["at-fault collision (50 points)", "little progress (14 points)"]
    assert lost_points(drive("nudge/0", 0.0, fault=("planner", "plan() raised"))) == ["planner fault: plan() raised"]


def test_beside_a_gate_at_zero_nothing_else_costs_anything() -> None:
    found = lost_points(drive("nudge/0", 0.0, drivable_area=0.0, no_collision=0.0, progress=0.5))
    assert found == ["at-fault collision (50 points)", "drivable area left (50 points)"]
