"""Where the points of a planner went: by reason, the costliest first, and all of them."""

from __future__ import annotations

import pytest

from interplan_sumo.report.costly import LEAST_COLUMN, OTHER, costs, where_points_went
from interplan_sumo.report.page.document import page
from interplan_sumo.report.table import ResultsTable, make_table
from interplan_sumo.report.table_formats import as_json
from tests.report.rows import drive, stored
from tests.report.test_table_formats import text


def table() -> ResultsTable:
    """Two planners: one hits somebody and is slow, one faults and leaves the road while it hits somebody."""
    return make_table(
        [
            stored(
                drive("nudge/0", 0.0, no_collision=0.0),
                drive("nudge/1", 1.0 - 5.0 / 9.0 * 0.2, progress=0.8),
                drive("nudge/0", 0.0, planner="pdm_closed", fault=("planner", "no plan")),
                drive("nudge/1", 0.0, planner="pdm_closed", no_collision=0.0, drivable_area=0.0),
            )
        ]
    )


def test_each_reason_has_what_it_took_of_each_planner_the_costliest_first() -> None:
    assert list(where_points_went(table().lines).items()) == [
        ("at-fault collision", [50.0, 25.0]),
        ("planner fault", [0.0, 50.0]),
        ("drivable area left", [0.0, 25.0]),
        ("little progress", [pytest.approx(100.0 / 18.0), 0.0]),
    ]


def test_with_the_mean_score_they_are_a_hundred() -> None:
    lines = table().lines
    for number, line in enumerate(lines):
        mean = line.cells["interplan"].value
        assert mean is not None
        taken = sum(points[number] for points in where_points_went(lines).values())
        assert round(mean + taken, 9) == 100.0


def test_what_took_little_of_everybody_shares_the_last_column() -> None:
    def slow(lost: float) -> ResultsTable:
        weighed = 0.01 * lost * 9.0 / 5.0
        return make_table([stored(drive("nudge/0", 1.0 - 0.01 * lost, progress=1.0 - weighed))])

    assert list(where_points_went(slow(LEAST_COLUMN + 0.01).lines)) == ["little progress"]
    assert list(where_points_went(slow(LEAST_COLUMN - 0.01).lines)) == [OTHER]
    assert not where_points_went(make_table([stored(drive("nudge/0", 1.0))]).lines)


def test_terminal_page_and_json_tell_them() -> None:
    shown = text(table(), why=True).partition("Where the points went")[2]
    assert "at-fault collision" in shown.splitlines()[2]
    assert shown.splitlines()[4].replace("│", " ").split() == ["idm", "50.0", "-", "-", "5.6"]
    html = page(table()).partition('id="went"')[2]
    assert html.index("at-fault collision") < html.index("planner fault") < html.index("drivable area left")
    assert [row["points_lost"] for row in as_json(table())["rows"]] == [
        {"no_collision": 50.0, "progress": 5.5556},
        {"planner": 50.0, "no_collision": 25.0, "drivable_area": 25.0},
    ]
    nothing = make_table([stored(drive("nudge/0", 1.0))])
    assert 'id="went"' not in page(nothing)
    assert "Where the points went" not in text(nothing, why=True)


def test_ordinary_driving_beside_rare_scenes_is_not_in_what_the_rare_ones_lost() -> None:
    rare = [drive("nudge/0", 0.0, no_collision=0.0), drive("nudge/1", 1.0)]
    ordinary = stored(
        drive("changing_lane/0", 0.0, drivable_area=0.0), path="runs/o", suite="common==1", suite_hash="2"
    )
    (line,) = make_table([stored(*rare), ordinary]).lines
    assert [(cost.reason, cost.points) for cost in costs(line)] == [("no_collision", 50.0)]
    (line,) = make_table([ordinary]).lines
    assert [(cost.reason, cost.points) for cost in costs(line)] == [("drivable_area", 100.0)]
