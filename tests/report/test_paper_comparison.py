"""Agreement with the published table: whom it compares, and how near."""

from __future__ import annotations

import re

import pytest
from report.rows import drive, stored

from interplan_sumo.report.paper_comparison import CELLS, COUNTERPARTS, agreement, published_rows
from interplan_sumo.report.table import ResultsTable, make_table
from interplan_sumo.report.table_formats import as_json, as_markdown

FAMILY = {"ltd": "lane_change_ltd", "mtd": "lane_change_mtd", "htd": "lane_change_htd"}
PUBLISHED = {str(row["planner"]): row for row in published_rows()}


def like_published(*names: str, more: float = 0.0, suite: str = "interplan==1", turned: bool = False) -> ResultsTable:
    """A table in which our planners score what the published ones did, or so many points more, or less for more."""
    drives = [
        drive(f"{FAMILY.get(key, key)}/0", _score(name, key, more, turned), planner=COUNTERPARTS[name])
        for name in names
        for key in CELLS
    ]
    return make_table([stored(*drives, suite=suite)])


def _score(name: str, key: str, more: float, turned: bool) -> float:
    points = float(PUBLISHED[name][key] or 0.0)
    return ((100.0 - points) if turned else points + more) / 100.0


def test_the_published_figures_agree_with_themselves() -> None:
    found = agreement(like_published("IDM", "PDM-Open", "PDM-Closed", "GC-PGP"))
    assert found is not None
    assert found.planners == ("GC-PGP", "PDM-Open", "IDM", "PDM-Closed")
    assert found.rank_correlation == pytest.approx(1.0)
    assert found.mean_cell_difference == pytest.approx(0.0)


def test_points_more_leave_the_order_and_show_in_the_cells_and_the_opposite_order_is_told() -> None:
    more = agreement(like_published("IDM", "PDM-Open", "PDM-Closed", more=7.0))
    turned = agreement(like_published("IDM", "PDM-Open", "PDM-Closed", turned=True))
    assert more is not None
    assert turned is not None
    assert (more.rank_correlation, more.mean_cell_difference) == pytest.approx((1.0, 7.0))
    assert turned.rank_correlation == pytest.approx(-1.0)


def test_two_planners_and_another_suite_are_not_held_against_the_paper() -> None:
    assert agreement(like_published("IDM", "PDM-Closed")) is None
    assert agreement(like_published("IDM", "PDM-Open", "PDM-Closed", suite="smoke==1")) is None


def test_a_planner_with_changed_traffic_or_a_missing_type_does_not_count() -> None:
    names = "IDM", "PDM-Open", "PDM-Closed"
    rows = [
        drive(f"{FAMILY.get(key, key)}/0", 0.5, planner=COUNTERPARTS[name])
        for name in names
        for key in (CELLS if name != "PDM-Open" else CELLS[1:])
    ]
    assert agreement(make_table([stored(*rows, suite="interplan==1")])) is None
    assert agreement(make_table([stored(*rows, suite="interplan==1", overrides={"density": "high"})])) is None


def test_equal_totals_have_no_order() -> None:
    rows = [
        drive(f"{FAMILY.get(key, key)}/0", 0.5, planner=COUNTERPARTS[name])
        for name in ("IDM", "PDM-Open", "PDM-Closed")
        for key in CELLS
    ]
    found = agreement(make_table([stored(*rows, suite="interplan==1")]))
    assert found is not None
    assert found.rank_correlation is None
    assert "no order" in found.sentence()


def test_reports_with_the_published_rows_say_how_near_they_come() -> None:
    table = like_published("IDM", "PDM-Open", "PDM-Closed")
    assert as_json(table, paper=True)["paper"]["agreement"]["rank_correlation"] == pytest.approx(1.0)
    assert re.search(r"3 planners in both: rank correlation 1\.00", as_markdown(table, paper=True))
    assert "planners in both" not in as_markdown(table)
