"""The table: means per family and over all, never over what is missing."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from interplan_sumo.batch.records import PlannerRecord, Shard
from interplan_sumo.batch.run_folder import StoredRun
from interplan_sumo.errors import RunFolderError
from interplan_sumo.report.table import Cell, make_table
from tests.report.rows import drive, stored


def values(*args: object, **kwargs: object) -> dict[str, float | None]:
    (line,) = make_table([stored(*args, **kwargs)]).lines  # type: ignore[arg-type]
    return {key: cell.value for key, cell in line.cells.items()}


def test_a_family_is_the_mean_of_its_scenarios_and_the_total_the_mean_of_all() -> None:
    found = values(drive("nudge/0", 1.0), drive("nudge/1", 0.5), drive("overtake/0", 0.0))
    assert (found["nudge"], found["overtake"], found["interplan"]) == (75.0, 0.0, 50.0)
    assert (found["jaywalker"], found["driv"]) == (None, None)  # without scenarios there is no figure


def test_a_family_that_is_not_installed_has_a_column_of_its_name_after_ours() -> None:
    table = make_table([stored(drive("parking/0", 0.5), drive("nudge/0", 1.0))])
    (line,) = table.lines
    assert (line.cells["parking"].value, line.cells["interplan"].value) == (50.0, 75.0)
    titles = [column.title for column in table.columns]
    assert titles[titles.index("HTD") : titles.index("Driv.")] == ["HTD", "parking"]
    assert "parking" not in [column.key for column in make_table([stored(drive("nudge/0", 1.0))]).columns]


def test_a_shard_that_no_drive_falls_into_is_named_but_reported_beside_the_others() -> None:
    first = stored(drive("nudge/0", 0.5))
    parts = [
        StoredRun(each.path, replace(first.manifest, shard=Shard(n, 2)), rows)
        for n, each, rows in ((1, first, first.rows), (2, first, {}))
    ]
    with pytest.raises(RunFolderError, match="asks for no drive \\(shard 2/2 of a run of 1 drive\\)"):
        make_table(parts[1:])
    (line,) = make_table(parts).lines
    assert line.cells["nudge"].value == 50.0


def test_driving_goal_and_collisions_are_judged_over_the_lane_changes_only() -> None:
    found = values(
        drive("lane_change_ltd/0", 0.8, lane_changes=0.5),
        drive("lane_change_htd/0", 0.0, drivable_area=0.0, no_collision=0.0),
        drive("nudge/0", 0.0, drivable_area=0.0),
    )
    assert (found["driv"], found["goal"], found["no_col"]) == (50.0, 50.0, 50.0)
    assert (found["ltd"], found["mtd"], found["htd"]) == (80.0, None, 0.0)


def test_a_planner_fault_is_a_zero_in_every_figure() -> None:
    row = drive("lane_change_ltd/0", 0.0, fault=("planner", "raised"))
    found = values(row)
    assert (found["interplan"], found["driv"], found["goal"], found["no_col"]) == (0.0, 0.0, 0.0, 0.0)
    table = make_table([stored(row)])
    assert table.complete
    assert table.lines[0].faults == {"planner": 1}


def test_a_missing_row_leaves_its_family_and_the_total_without_a_figure() -> None:
    table = make_table([stored(drive("nudge/0", 1.0), drive("overtake/0", 1.0), missing=("nudge/1",))])
    (line,) = table.lines
    assert not table.complete
    assert line.cells["interplan"].value is None
    assert (line.cells["nudge"].done, line.cells["nudge"].asked) == (1, 2)
    assert line.cells["overtake"].value == 100.0
    assert line.missing == (("nudge/1", "idm", 0),)


@pytest.mark.parametrize("fault", ["timeout", "traffic", "harness"])
def test_a_fault_that_is_not_the_planners_leaves_the_table_incomplete(fault: str) -> None:
    table = make_table([stored(drive("nudge/0", None, fault=(fault, "lost")), drive("nudge/1", 1.0))])
    assert not table.complete
    assert table.lines[0].cells["nudge"].value is None


def test_a_missing_drive_counts_in_the_family_that_another_seed_tells() -> None:
    held = replace(drive("mine/0", 1.0, seed=1), family="nudge")
    (line,) = make_table([stored(held)]).lines
    assert (line.cells["nudge"].done, line.cells["nudge"].asked) == (1, 2)


def test_the_interval_is_over_scenarios_and_seeds_of_a_scenario_are_one_figure() -> None:
    scores = (1.0, 0.0, 0.5, 0.8, 0.2)
    once = [drive(f"nudge/{n}", score) for n, score in enumerate(scores)]
    again = [drive(f"nudge/{n}", score, seed=seed) for n, score in enumerate(scores) for seed in range(3)]
    first, second = (make_table([stored(*rows)]).lines[0].cells["nudge"] for rows in (once, again))
    assert first.interval == second.interval
    assert first.interval is not None
    assert first.interval[0] < 30.0
    assert first.interval[1] > 70.0
    assert make_table([stored(*again[:3])]).lines[0].cells["nudge"].interval is None  # of one scenario


def test_scenarios_are_drawn_again_within_their_families() -> None:
    rows = [drive(f"{family}/{n}", score) for family, score in (("nudge", 0.9), ("overtake", 0.1)) for n in range(10)]
    rows += [drive(f"{family}/{n}", s) for family, s in (("nudge", 0.95), ("overtake", 0.15)) for n in (10, 11)]
    interval = make_table([stored(*rows)]).lines[0].cells["interplan"].interval
    assert interval is not None
    assert interval[1] - interval[0] < 4.0  # drawn over all of them: 33


def test_lane_changes_at_the_same_places_in_other_densities_make_no_interval_narrower() -> None:
    scores = [drive(f"lane_change_ltd/{n}", score) for n, score in enumerate((1.0, 0.0, 0.5, 0.8, 0.2))]
    denser = [replace(row, family=family, scenario_id=f"{family}/{n}") for n, row in enumerate(scores)
              for family in ("lane_change_mtd", "lane_change_htd")]  # fmt: skip
    one, three = (
        make_table([stored(*rows)]).lines[0].cells["interplan"].interval for rows in (scores, scores + denser)
    )
    assert one is not None
    assert three == pytest.approx(one)


def test_lines_are_told_apart_by_the_scenarios_that_they_share() -> None:
    hard = [0.1 * (n % 8) for n in range(24)]
    rows = [drive(f"nudge/{n}", h, planner="a") for n, h in enumerate(hard)]
    rows += [drive(f"nudge/{n}", h + 0.1 + 0.01 * (n % 3), planner="b") for n, h in enumerate(hard)]
    rows += [drive(f"nudge/{n}", h + 0.11 * (n % 2), planner="c") for n, h in enumerate(hard)]
    standing = make_table([stored(*rows)]).standing
    assert (standing.column, standing.best, standing.behind, standing.alike) == ("interplan", 1, [0, 2], [])
    span = standing.detectable["interplan"]
    assert span.paired
    assert span.least < 1.0 < span.greatest < 5.0
    own = [stored(*rows[:24]), stored(*(drive(f"nudge/{n + 50}", h + 0.1) for n, h in enumerate(hard)), path="runs/b")]
    standing = make_table(own).standing
    assert (standing.best, standing.behind, standing.alike) == (1, [], [0])  # scenarios of their own: 23 points wide
    own[1] = stored(drive("nudge/50", 1.0), path="runs/b")  # a single one, of which nobody knows how much it varies
    assert make_table(own).standing.best is None
    assert not standing.detectable["interplan"].paired
    assert standing.detectable["interplan"].least > 15.0


def test_lines_with_rows_missing_stand_nowhere() -> None:
    rows = [drive(f"nudge/{n}", 0.1 * n, planner=name) for n in range(8) for name in ("idm", "b")]
    standing = make_table([stored(*rows, missing=("nudge/9",))]).standing
    assert (standing.drives, standing.best, standing.alike, standing.behind) == ({1: 8}, None, [], [])


def test_official_and_overridden_rows_are_never_mixed() -> None:
    official = stored(drive("nudge/0", 1.0))
    dense = stored(drive("nudge/0", 0.0), overrides={"density": "high"}, path="runs/b")
    first, second = make_table([official, dense]).lines
    assert (first.label, first.official, first.cells["nudge"].value) == ("idm", True, 100.0)
    assert (second.label, second.official, second.cells["nudge"].value) == ("idm [density=high]", False, 0.0)


@pytest.mark.parametrize("what", ["suite", "suite_hash", "profile", "traffic_version"])
def test_runs_that_cannot_be_compared_are_refused(what: str) -> None:
    with pytest.raises(RunFolderError, match=f"runs/b has {what.replace('_', ' ')} other"):
        make_table([stored(drive("nudge/0", 1.0)), stored(drive("nudge/0", 1.0), path="runs/b", **{what: "other"})])  # type: ignore[arg-type]


def test_a_profile_that_does_not_judge_lane_changes_has_no_goal_figure() -> None:
    row = drive("lane_change_ltd/0", 1.0)
    metrics = {name: metric for name, metric in row.metrics.items() if name != "lane_changes"}
    row = replace(row, metrics=metrics, weights={})
    found = values(row)
    assert found["goal"] is None
    assert found["driv"] == 100.0


# --- ordinary driving beside it ----------------------------------------------------------------


def ordinary(*rows: object, path: str = "runs/o", **manifest: object) -> StoredRun:
    return stored(*rows, path=path, **({"suite": "common==1", "suite_hash": "2"} | manifest))  # type: ignore[arg-type]


def test_ordinary_driving_has_its_column_and_is_no_part_of_the_total() -> None:
    rare = stored(drive("nudge/0", 0.4), drive("nudge/0", 0.4, seed=1))
    table = make_table([ordinary(drive("changing_lane/0", 0.9)), rare])
    (line,) = table.lines
    assert (line.cells["ordinary"].value, line.cells["interplan"].value, line.cells["nudge"].value) == (90, 40, 40)
    assert (line.label, line.scenarios, line.seeds) == ("idm", 1, 2)
    assert (table.suite, table.ordinary_suite) == ("smoke==1", "common==1")
    assert [row.scenario_id for row in line.rows] == ["nudge/0", "nudge/0", "changing_lane/0"]


def test_a_run_of_ordinary_driving_alone_has_no_total() -> None:
    table = make_table([ordinary(drive("changing_lane/0", 0.9), drive("changing_lane/1", 0.7))])
    (line,) = table.lines
    assert (line.cells["ordinary"].value, line.cells["interplan"].value, line.scenarios) == (80.0, None, 2)
    assert (table.suite, table.ordinary_suite) == ("common==1", None)


def test_lines_are_in_the_order_of_the_runs_and_a_planner_may_lack_one() -> None:
    first = ordinary(drive("changing_lane/0", 0.9, planner="b"), drive("changing_lane/0", 0.8, planner="a"))
    second = stored(*(drive("nudge/0", 0.1, planner=name) for name in "abc"))
    found = [(line.label, line.cells["ordinary"].value) for line in make_table([first, second]).lines]
    assert found == [("b", 90.0), ("a", 80.0), ("c", None)]


def test_changed_traffic_finds_no_ordinary_run_of_the_official_one() -> None:
    runs = [stored(drive("nudge/0", 1.0), overrides={"density": "high"}), ordinary(drive("changing_lane/0", 0.9))]
    found = {
        line.label: (line.cells["interplan"].value, line.cells["ordinary"].value) for line in make_table(runs).lines
    }
    assert found == {"idm [density=high]": (100.0, None), "idm": (None, 90.0)}


def test_a_planner_that_was_edited_between_two_runs_has_a_line_for_each() -> None:
    def of(version: str) -> dict[str, PlannerRecord]:
        return {"idm": PlannerRecord(version, {})}

    for version, lines in (("one", 1), ("two", 2)):
        rare = stored(drive("nudge/0", 0.5), planners=of("one"))
        assert (
            len(make_table([rare, ordinary(drive("following_lane_with_lead/0", 1.0), planners=of(version))]).lines)
            == lines
        )


def test_two_runs_of_a_kind_are_told_apart_and_paired_with_nothing() -> None:
    runs = [stored(drive("nudge/0", 1.0), path=f"runs/{name}") for name in "ab"]
    lines = make_table([*runs, ordinary(drive("changing_lane/0", 0.9))]).lines
    assert [(line.label, line.cells["ordinary"].value) for line in lines] == [
        ("idm (a)", None),
        ("idm (b)", None),
        ("idm (o)", 90.0),
    ]


def test_what_is_missing_of_ordinary_driving_leaves_the_total_as_it_is() -> None:
    lost = drive("changing_lane/0", None, fault=("traffic", "lost"))
    table = make_table([stored(drive("nudge/0", 1.0)), ordinary(lost)])
    (line,) = table.lines
    assert not table.complete
    assert (line.cells["interplan"].value, line.cells["ordinary"].value) == (100.0, None)
    assert line.missing == (("changing_lane/0", "idm", 0),)


def test_what_is_missing_of_scenes_made_for_a_map_is_missing_of_their_family() -> None:
    (line,) = make_table([stored(drive("strip.nudge/0", 1.0, family="nudge"), missing=("strip.nudge/1",))]).lines
    assert line.cells["nudge"] == Cell(None, None, 1, 2)
    (line,) = make_table([stored(missing=("strip.changing_lane/1",))]).lines
    assert line.cells["ordinary"].asked == 1


def test_runs_of_ordinary_driving_must_agree_as_others_must() -> None:
    runs = [stored(drive("nudge/0", 1.0)), ordinary(drive("changing_lane/0", 0.9))]
    with pytest.raises(RunFolderError, match="runs/p has suite hash 3, runs/o has 2"):
        make_table([*runs, ordinary(drive("changing_lane/0", 0.9), path="runs/p", suite_hash="3")])
    with pytest.raises(RunFolderError, match="has profile nuplan"):
        make_table([runs[0], ordinary(drive("changing_lane/0", 0.9), profile="nuplan")])
    with pytest.raises(RunFolderError, match="has scoring version 2, runs/a has None; report them separately"):
        make_table([runs[0], ordinary(drive("changing_lane/0", 0.9), versions={"scoring": "2"})])


def test_done_unsafe_and_the_papers_score_stand_where_they_are_judged() -> None:
    safe = drive("nudge/0", 0.25, done=False, unsafe=False, beside={"interplan-paper": 0.8})
    raced = drive("nudge/1", 0.0, done=True, unsafe=True, beside={"interplan-paper": 0.6})
    table = make_table([stored(safe, raced, drive("nudge/2", 0.0, fault=("planner", "plan() raised")))])
    (line,) = table.lines
    told = {column.key: line.cells[column.key].value for column in table.columns if column.optional}
    assert told == pytest.approx({"done_share": 100 / 3, "unsafe_share": 200 / 3, "paper_score": 140 / 3})
    assert all(table.asked(column) for column in table.columns if column.optional)
    unjudged = make_table([stored(drive("nudge/0", 0.5))])
    assert not any(unjudged.asked(column) for column in unjudged.columns if column.optional)
