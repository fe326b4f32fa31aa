"""Agreement with the published table: whom it compares, and how near."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import pytest
from report.rows import drive, stored

from interplan_sumo.report.paper_comparison import CELLS, COUNTERPARTS, agreement, published_rows
from interplan_sumo.report.table import ResultsTable, make_table
from interplan_sumo.report.table_formats import as_json, as_markdown

FAMILY = {"ltd": "lane_change_ltd", "mtd": "lane_change_mtd", "htd": "lane_change_htd"}
PUBLISHED = {str(row["planner"]): row for row in published_rows()}


def like_published(
    *names: str, change: Callable[[float], float] = float, lacking: str = "", suite: str = "interplan==1", **run: Any
) -> ResultsTable:
    """A table in which our planners score what the published ones did, changed; one may lack its first family."""
    drives = [
        drive(f"{FAMILY.get(key, key)}/0", change(float(PUBLISHED[name][key] or 0.0)) / 100.0,
              planner=COUNTERPARTS[name])
        for name in names
        for key in (CELLS[1:] if name == lacking else CELLS)
    ]  # fmt: skip
    return make_table([stored(*drives, suite=suite, **run)])


def test_the_published_figures_agree_with_themselves() -> None:
    found = agreement(like_published("IDM", "PDM-Open", "PDM-Closed", "GC-PGP"))
    assert found is not None
    assert found.planners == ("GC-PGP", "PDM-Open", "IDM", "PDM-Closed")
    assert found.rank_correlation == pytest.approx(1.0)
    assert found.mean_cell_difference == pytest.approx(0.0)


def test_points_more_leave_the_order_and_show_in_the_cells_and_the_opposite_order_is_told() -> None:
    more = agreement(like_published("IDM", "PDM-Open", "PDM-Closed", change=lambda points: points + 7.0))
    turned = agreement(like_published("IDM", "PDM-Open", "PDM-Closed", change=lambda points: 100.0 - points))
    assert more is not None
    assert turned is not None
    assert (more.rank_correlation, more.mean_cell_difference) == pytest.approx((1.0, 7.0))
    assert turned.rank_correlation == pytest.approx(-1.0)


def test_two_planners_and_another_suite_are_not_held_against_the_paper() -> None:
    assert agreement(like_published("IDM", "PDM-Closed")) is None
    assert agreement(like_published("IDM", "PDM-Open", "PDM-Closed", suite="smoke==1")) is None


def test_a_planner_with_changed_traffic_or_a_missing_type_does_not_count() -> None:
    names = "IDM", "PDM-Open", "PDM-Closed"
    assert agreement(like_published(*names, lacking="PDM-Open")) is None
    assert agreement(like_published(*names, overrides={"density": "high"})) is None


def test_equal_totals_have_no_order() -> None:
    found = agreement(like_published("IDM", "PDM-Open", "PDM-Closed", change=lambda _: 50.0))
    assert found is not None
    assert found.rank_correlation is None
    assert "no order" in found.sentence()


def test_reports_with_the_published_rows_say_how_near_they_come() -> None:
    table = like_published("IDM", "PDM-Open", "PDM-Closed")
    assert as_json(table, paper=True)["paper"]["agreement"]["rank_correlation"] == pytest.approx(1.0)
    assert re.search(r"3 planners in both: rank correlation 1\.00", as_markdown(table, paper=True))
    assert "planners in both" not in as_markdown(table)
