"""The formats: the same figures for programs, spreadsheets, documents and people."""

from __future__ import annotations

import csv
import io

import pytest
from msgspec.structs import replace
from rich.console import Console

from interplan_sumo.report.page.figures import best_figure
from interplan_sumo.report.paper_comparison import published_rows
from interplan_sumo.report.table import ResultsTable, make_table
from interplan_sumo.report.table_formats import as_csv, as_json, as_markdown, as_text
from interplan_sumo.report.text import points_text
from tests.report.rows import drive, stored

FAMILY_KEYS = ("construction", "accident", "jaywalker", "nudge", "overtake", "ltd", "mtd", "htd")


def table() -> ResultsTable:
    return make_table(
        [
            stored(
                drive("nudge/0", 1.0),
                drive("nudge/1", 0.0, no_collision=0.0, no_collision_because="drove into vehicle 7 at 3.0 s"),
                drive("overtake/0", 0.0, fault=("planner", "plan() raised ValueError")),
            )
        ]
    )


def incomplete() -> ResultsTable:
    return make_table(
        [stored(drive("nudge/0", 1.0), drive("nudge/1", None, fault=("timeout", "killed")), missing=("nudge/2",))]
    )


def text(found: ResultsTable, **options: bool) -> str:
    console = Console(file=io.StringIO(), width=200)
    console.print(as_text(found, **options))
    return console.file.getvalue()  # type: ignore[attr-defined]


def test_json_has_the_documented_fields() -> None:
    report = as_json(table())
    assert (report["suite"], report["profile"], report["complete"]) == ("smoke==1", "interplan-paper", True)
    (row,) = report["rows"]
    assert {"planner", "interplan", *FAMILY_KEYS, "driv", "goal", "no_col", "scenarios", "faults"} <= row.keys()
    assert (row["interplan"], row["nudge"], row["overtake"], row["jaywalker"]) == (33.3333, 50.0, 0.0, None)
    assert row["faults"] == {"planner": 1}
    assert row["fault_list"] == [
        {"scenario_id": "overtake/0", "seed": 0, "class": "planner", "message": "plan() raised ValueError"}
    ]


def test_why_has_a_sentence_for_everything_that_cost_points() -> None:
    half = drive("nudge/0", 0.5, no_collision=0.5, no_collision_because="drove into standing traffic cone 3 at 2.0 s")
    two = drive("nudge/1", 0.0, no_collision=0.0, drivable_area=0.0)
    nothing = drive("nudge/2", 0.0, progress=0.0, lane_changes=0.0)
    (row,) = as_json(make_table([stored(half, two, nothing, drive("nudge/3", 0.9, progress=0.8))]), why=True)["rows"]
    assert "nudge/1, idm, seed 0: at-fault collision (100 points): drove into vehicle 7 at 3.0 s" in text(
        table(), why=True
    )
    assert [(entry["scenario_id"], entry["reason"]) for entry in row["why"]] == [
        ("nudge/0", "at-fault collision (50 points): drove into standing traffic cone 3 at 2.0 s"),
        ("nudge/1", "at-fault collision (50 points)"),
        ("nudge/1", "drivable area left (50 points)"),
        ("nudge/2", "little progress (56 points)"),
        ("nudge/2", "goal lane missed (44 points)"),
        ("nudge/3", "little progress (11 points)"),
    ]


def test_details_are_every_drive_with_what_it_lost() -> None:
    (row,) = as_json(table())["rows"]
    assert [(d["scenario_id"], d["score"], d["lost"]) for d in row["drives"]] == [
        ("nudge/0", 100.0, []),
        ("nudge/1", 0.0, ["at-fault collision (100 points): drove into vehicle 7 at 3.0 s"]),
        ("overtake/0", 0.0, ["planner fault: plan() raised ValueError"]),
    ]
    shown = text(table(), details=True)
    assert "100.0  nudge/0, idm, seed 0: nothing lost" in shown
    assert "  0.0  nudge/1, idm, seed 0: at-fault collision" in shown
    assert "    -  nudge/1, idm, seed 0: timeout fault: killed" in text(incomplete(), details=True)


def test_text_lists_faults_and_leaves_out_columns_that_nobody_has() -> None:
    shown = text(table())
    assert "overtake/0, idm, seed 0: planner fault: plan() raised ValueError" in shown
    assert "Nudge" in shown
    assert "Jayw." not in shown
    assert "nudge 2, overtake 1" in shown


def test_a_narrow_terminal_gets_a_column_per_planner() -> None:
    found = make_table([stored(*(drive(f"{family}/0", 1.0) for family in ("nudge", "overtake", "lane_change_ltd")))])
    for width in (200, 40):
        console = Console(file=io.StringIO(), width=width)
        console.print(as_text(found, width=width))
        lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
        assert max(map(len, lines)) <= width
        assert any("idm" in line and "100" in line for line in lines) == (width == 200)
        assert any("No-Col." in line and "100" in line for line in lines) == (width == 40)


def test_an_incomplete_run_has_no_total_and_what_is_missing_is_named() -> None:
    report = as_json(incomplete())
    (row,) = report["rows"]
    assert (report["complete"], row["interplan"], row["nudge"]) == (False, None, None)
    assert [missing["scenario_id"] for missing in row["missing"]] == ["nudge/1", "nudge/2"]
    shown = text(incomplete())
    for said in ("INCOMPLETE: 2 jobs have no score", "(1/3)", "nudge/2, idm, seed 0", "timeout fault: killed"):
        assert said in shown


def test_csv_reads_back() -> None:
    (row,) = csv.DictReader(io.StringIO(as_csv(table())))
    assert (row["planner"], row["nudge"], row["jaywalker"], row["faults"]) == ("idm", "50.0", "", "1")


def test_markdown_is_one_table_with_twelve_columns() -> None:
    head, rule, line, *_ = as_markdown(table()).splitlines()
    assert head.count("|") == rule.count("|") == line.count("|") == 14
    assert "| idm | 33 [0, 100] |" in line


def test_the_published_rows_stand_beside_ours_on_request() -> None:
    assert "PDM-Closed (paper)" in as_markdown(table(), paper=True)
    assert "PDM-Closed (paper)" in as_csv(table(), paper=True)
    assert "PDM-Closed (paper)" in text(table(), paper=True)
    assert len(as_json(table(), paper=True)["paper"]["rows"]) == 14


def with_ordinary() -> ResultsTable:
    common = stored(drive("changing_lane/0", 0.9), path="runs/o", suite="common==1", suite_hash="2")
    return make_table([stored(drive("nudge/0", 0.4)), common])


def test_ordinary_driving_is_the_first_column_where_there_is_any_and_in_json_always() -> None:
    head, _, line, *_ = as_markdown(with_ordinary()).splitlines()
    assert head.startswith("| planner | Ordinary | interPlan |")
    assert line.startswith("| idm | 90 | 40 |")
    assert "Ordinary" not in as_markdown(table())
    assert "Ordinary is the mean over ordinary driving (suite common==1; scenarios: 1)." in text(with_ordinary())
    report, without = as_json(with_ordinary()), as_json(table())
    assert (report["ordinary_suite"], report["rows"][0]["ordinary"]) == ("common==1", 90.0)
    assert (without["ordinary_suite"], without["rows"][0]["ordinary"]) == (None, None)


def test_the_published_rows_have_val14_there_where_it_was_driven() -> None:
    lines = as_markdown(with_ordinary(), paper=True).splitlines()
    assert any(line.startswith("| PDM-Closed (paper) | 92 | 42 |") for line in lines)
    assert any(line.startswith("| HybridLLM Llama-7B (paper) | - | 53 |") for line in lines)
    assert "| idm | - | 33 [0, 100] |" in as_markdown(table(), paper=True)
    rows = as_json(table(), paper=True)["paper"]["rows"]
    assert {row["planner"]: row["ordinary"] for row in rows}["LLMWaypoints GPT-3.5"] is None


def test_each_published_total_is_the_mean_of_its_eight_families() -> None:
    # To one point, as printed; the rounded columns of GPT-3.5 in the paper give 39.1 where it prints 40.
    for row in published_rows():
        figures = [float(row[key] or 0.0) for key in ("interplan", *FAMILY_KEYS)]
        assert figures[0] == pytest.approx(sum(figures[1:]) / 8, abs=1.0), row["planner"]


def asking(queries: int, **fallbacks: int) -> ResultsTable:
    row = drive("nudge/0", 1.0, planner_report={"queries": queries, "fallbacks": fallbacks})
    return make_table([stored(row)])


def test_questions_to_a_language_model_are_told_with_the_share_in_vain() -> None:
    found = asking(50, parse=1, timeout=1)
    assert "idm asked a language model 50 times, 4.0 % without a usable answer." in text(found)
    assert (as_json(found)["rows"][0]["questions"], as_json(found)["rows"][0]["unanswered"]) == (50, 2)
    assert "language model" not in text(table())
    assert "questions" not in as_json(table())["rows"][0]


# --- what the figures can tell apart ---


def three() -> ResultsTable:
    hard = [0.08 * n for n in range(10)]
    return make_table(
        [
            stored(
                *(drive(f"{f}/{n}", h, planner="a") for f in ("nudge", "overtake") for n, h in enumerate(hard)),
                *(drive(f"{f}/{n}", h + 0.02 * (n % 3) - 0.02 * (n == 2), planner="b")
                  for f in ("nudge", "overtake") for n, h in enumerate(hard)),
                *(drive(f"{f}/{n}", h + 0.2 + 0.01 * (n % 2), planner="c")
                  for f in ("nudge", "overtake") for n, h in enumerate(hard)),
            )
        ]
    )  # fmt: skip


def test_json_has_intervals_the_least_detectable_difference_and_all_pairs() -> None:
    report = as_json(three())
    low, high = report["rows"][0]["ci"]["interplan"]
    assert low < report["rows"][0]["interplan"] < high
    assert 0.0 < report["least_detectable_difference"] < 3.0
    comparison = report["comparison"]
    assert (comparison["column"], comparison["best"], comparison["not_told_apart_from_best"]) == ("interplan", "c", [])
    assert [(pair["a"], pair["b"], pair["paired"], pair["scenarios"]) for pair in comparison["pairs"]] == [
        ("a", "b", True, 20), ("a", "c", True, 20), ("b", "c", True, 20),
    ]  # fmt: skip
    assert {"interplan", "nudge", "overtake"} <= comparison["least_detectable_differences"].keys()
    assert as_json(make_table([stored(drive("nudge/0", 1.0))]))["least_detectable_difference"] is None


def test_under_the_table_stands_what_it_can_tell() -> None:
    said = " ".join(text(three()).split())
    assert "Brackets: 95 % interval for scenarios like these" in said
    assert "Least detectable difference (80 % power, two-sided 5 %), paired scenario by scenario: interPlan" in said
    assert "in a single family" in said
    assert "Best: c. It can be told apart from every other line (paired bootstrap over scenarios, Holm over 3" in said
    alone = " ".join(text(table()).split())
    assert "between lines on scenarios of their own: interPlan more than 100 points" in alone
    assert "Best:" not in alone
    few = make_table(
        [stored(*(drive(f"nudge/{n}", s, planner=name) for name, s in (("a", 0.1), ("b", 0.9)) for n in range(5)))]
    )
    said = " ".join(text(few).split())
    assert "Best: b. 5 scenarios are too few to tell lines apart among 1 pair, however much they differ." in said


def test_one_scene_compares_nobody() -> None:
    said = " ".join(text(make_table([stored(*(drive("nudge/0", 0.5, planner=name) for name in "ab"))])).split())
    assert "Scenarios at one place are too few to compare lines." in said
    assert "Holm" not in said


@pytest.mark.parametrize("width", [60, 80, 120, 200])
def test_many_lines_beside_the_papers_stand_in_several_tables_where_one_is_too_wide(width: int) -> None:
    rows = [drive(f"nudge/{n}", 0.5, planner=f"planner_{at}") for at in range(14) for n in range(2)]
    console = Console(file=io.StringIO(), width=width)
    console.print(as_text(make_table([stored(*rows)]), width=width, paper=True))
    lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    assert max(map(len, lines)) <= width
    tables = sum("planner_0 " in line for line in lines)
    assert tables == sum("PDM-Closed (paper)" in line for line in lines) == sum("planner  " in line for line in lines)
    assert (tables == 1) == (width == 200)


@pytest.mark.parametrize(("lines", "too_few"), [(4, False), (5, True)])
def test_where_scenes_are_too_few_for_so_many_lines_the_note_says_so(lines: int, too_few: bool) -> None:
    rows = [drive(f"nudge/{n}", 0.2 * at, planner=f"p{at}") for at in range(lines) for n in range(8)]
    said = " ".join(text(make_table([stored(*rows)])).split())
    words = "8 scenarios are too few to tell lines apart among 10 pairs, however much they differ; `compare` looks"
    assert (words in said) == too_few


def test_scenes_of_one_place_are_no_more_than_one_where_lines_are_told_apart() -> None:
    rows = [replace(drive(f"nudge/{n}", 0.2 * at, planner=f"p{at}"), site=f"tiny/{n // 2}")
            for at in range(2) for n in range(8)]  # fmt: skip
    said = " ".join(text(make_table([stored(*rows)])).split())
    assert "8 scenarios at 4 places are too few to tell lines apart among 1 pair, however much they differ." in said


def test_csv_has_the_bounds_beside_each_figure() -> None:
    (row, *_) = csv.DictReader(io.StringIO(as_csv(three())))
    assert float(row["nudge_low"]) < float(row["nudge"]) < float(row["nudge_high"])
    assert row["jaywalker_low"] == ""


@pytest.mark.parametrize(
    ("points", "said"),
    [
        (1e-5, "less than 0.1"),
        (0.099, "less than 0.1"),
        (0.1, "0.1"),
        (0.44, "0.4"),
        (7.4, "7"),
        (100.1, "more than 100"),
    ],
)
def test_a_difference_of_scores_is_told_as_exactly_as_it_matters(points: float, said: str) -> None:
    assert points_text(points) == said


def test_lines_of_different_drives_have_no_best() -> None:
    """The few drives of b have the higher mean, and are worse where both have driven."""
    a = stored(*(drive(f"nudge/{n}", 0.9 if n < 10 else 0.3, planner="a") for n in range(40)))
    b = stored(*(drive(f"nudge/{n}", 0.6 + 0.01 * n, planner="b") for n in range(10)), path="runs/b")
    found = make_table([a, b])
    said = " ".join(text(found).split())
    assert "No best: the lines have not driven the same (a 40 drives; b 10 drives); `compare` takes what" in said
    assert "Best:" not in said
    assert as_json(found)["comparison"]["best"] is None
    (pair,) = as_json(found)["comparison"]["pairs"]
    assert (pair["scenarios"], pair["difference"]) == (10, -25.5)
    assert all(best_figure(found, column) is None for column in found.columns)
    same = make_table([a, stored(*(drive(f"nudge/{n}", 0.5, planner="b") for n in range(40)), path="runs/b")])
    assert best_figure(same, next(column for column in same.columns if column.key == "nudge")) == 50.0
