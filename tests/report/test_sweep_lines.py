"""The table of a sweep: figures that can be checked in the head, what is incomplete, and plots that are drawn."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.records import Row
from interplan_sumo.batch.sweep import Combination, Parameter, Result, SweepRun
from interplan_sumo.errors import InputError
from interplan_sumo.report import sweep_plot
from interplan_sumo.report.sweep_formats import sweep_csv, sweep_json, sweep_text
from interplan_sumo.report.sweep_lines import HARD_BRAKING_MPS2, MEASURES, SweepLine, idle_parameters, sweep_lines
from interplan_sumo.report.sweep_page import change_panels, measure_panels, sweep_page
from interplan_sumo.report.sweep_plot import plot_sweep, why_no_plot
from tests.records import metric
from tests.report.rows import drive, stored

FAMILY = "lane_change_mtd"
REACT = Parameter("interplan.reactOverlap", ("0", "1"))
DENSITY = Parameter("density", ("low", "high"))


def drove(
    index: int,
    score: float | None = 1.0,
    *,
    braking: float | None = None,
    at_fault: int = 0,
    contacts: int = 0,
    family: str = FAMILY,
    **changes: Any,
) -> Row:
    """One drive with what a sweep looks at; `contacts` are all, at fault or not."""
    row = drive(f"{family}/{index}", score, **changes)
    if not row.fault:
        row.metrics["no_collision"].detail.update(at_fault=at_fault, contacts=[{}] * max(contacts, at_fault))
        behind = None if braking is None else {"deceleration_mps2": braking}
        row.metrics["diagnostics"] = metric(None, {"braking_behind": behind})
    return row


def result(
    rows: Sequence[Row],
    setting: Mapping[str, str] | None = None,
    *,
    asked: int | None = None,
    failure: str | None = None,
    planner: str = "idm",
    **values: str,
) -> Result:
    """A combination with these rows, of scenarios 0 to `asked` - 1."""
    seeds = 1 + max((row.seed for row in rows), default=0)
    ids = tuple(dict.fromkeys(row.scenario_id for row in rows))
    if asked is not None:
        ids = tuple(f"{FAMILY}/{index}" for index in range(asked))
    part = SweepRun(RunOptions((planner,), seeds=seeds), ids)
    return Result(Combination({**(setting or {}), **values}, (part,)), (stored(*rows),) if rows else (), failure)


def two_by_two() -> list[SweepLine]:
    return sweep_lines(
        [
            result([drove(0, 0.5 * (d == "low")), drove(1, 1.0)], {"density": d, "interplan.reactOverlap": r})
            for d in DENSITY.values
            for r in REACT.values
        ]
    )


def printed(parameters: Sequence[Parameter], lines: Sequence[SweepLine]) -> str:
    console = Console(width=200, file=io.StringIO())
    console.print(sweep_text(parameters, lines))
    return console.file.getvalue()  # type: ignore[attr-defined]


def mean(line: SweepLine, key: str) -> float:
    found = line.means[key]
    assert found is not None
    return found.value


def test_who_is_not_judged_for_lane_changes_has_no_share_of_goal_lanes() -> None:
    goal_lane = next(each for each in MEASURES if each.key == "goal_lane")
    told = drove(0, lane_changes=1.0)
    told.metrics["lane_changes"].detail["goal"] = True
    assert goal_lane.value(told) == 100.0
    del told.metrics["lane_changes"]
    assert goal_lane.value(told) is None
    assert goal_lane.value(drove(0, 0.0, fault=("planner", "it failed"))) == 0.0


def test_figures_are_means_over_scenarios() -> None:
    rows = [
        drove(0, 1.0, braking=2.0),
        drove(1, 0.0, at_fault=1, lane_changes=0.0, braking=6.0),
        drove(2, 0.5, contacts=1),
        drove(3, 0.5, braking=0.0),
    ]
    (line,) = sweep_lines([result(rows, tau="1")])
    assert {key: mean(line, key) for key in line.means} == {
        "score": 50.0,
        "goal_reached": 75.0,
        "goal_lane": 75.0,
        "at_fault_collisions": 25.0,
        "collisions": 50.0,
        "hard_braking_behind": 25.0,
        "braking_behind_mps2": 2.0,
    }
    braking = line.means["braking_behind_mps2"]
    assert braking is not None
    assert braking.highest == 6.0
    assert braking.interval is not None
    assert braking.interval[0] <= 2.0 <= braking.interval[1]


@pytest.mark.parametrize(
    ("braking", "hard"), [(HARD_BRAKING_MPS2, 0.0), (HARD_BRAKING_MPS2 + 0.01, 100.0), (None, 0.0)]
)
def test_braking_is_hard_beyond_what_is_comfortable(braking: float | None, hard: float) -> None:
    (line,) = sweep_lines([result([drove(0, braking=braking)], tau="1")])
    assert mean(line, "hard_braking_behind") == hard


def test_seeds_of_a_scenario_count_together_and_one_drive_has_no_interval() -> None:
    rows = [drove(0, 1.0, seed=0), drove(0, 1.0, seed=1), drove(1, 0.0, seed=0), drove(1, 0.5, seed=1)]
    (line,) = sweep_lines([result(rows, tau="1")])
    assert mean(line, "score") == pytest.approx(62.5)
    assert (line.scenarios, line.seeds, line.asked) == (2, 2, 4)
    for some in (rows[2:3], rows[2:]):
        (line,) = sweep_lines([result(some, tau="1")])
        assert line.means["score"] is not None
        assert line.means["score"].interval is None


def test_combinations_are_told_apart_by_the_scenarios_that_they_share() -> None:
    lines = sweep_lines(
        [
            result([drove(n, 0.08 * n + more * (1.0 + 0.01 * n)) for n in range(10)], tau=tau)
            for tau, more in (("1", 0.1), ("2", 0.0), ("3", 0.1001))
        ]
    )
    text = printed([Parameter("tau", ("1", "2", "3"))], lines)
    assert "Least detectable difference (80 % power, two-sided 5 %), paired scenario by scenario: score 0." in text
    assert "Best: tau=3, idm. It can be told apart from every other line" in text
    assert "Not to be told apart from it (paired bootstrap over scenarios, Holm over 1 pair): tau=3, idm." in printed(
        [], [lines[0], replace(lines[0], setting={"tau": "3"})]
    )


def test_a_planner_fault_is_a_zero_and_says_nothing_of_collisions() -> None:
    (line,) = sweep_lines([result([drove(0), drove(1, 0.0, fault=("planner", "raised"))], tau="1")])
    assert (mean(line, "score"), mean(line, "goal_lane"), mean(line, "goal_reached")) == (50.0, 50.0, 50.0)
    found = line.means["at_fault_collisions"]
    assert found is not None
    assert (found.value, found.drives) == (0.0, 1)
    assert line.faults == {"planner": 1}
    assert line.complete


def test_the_goal_lane_is_judged_in_lane_changes_only() -> None:
    (line,) = sweep_lines([result([drove(0, family="nudge")], tau="1")])
    assert line.means["goal_lane"] is None
    assert "goal lane" not in printed([Parameter("tau", ("1",))], [line])


def test_a_combination_with_missing_drives_has_no_means_and_is_named() -> None:
    lines = sweep_lines([result([drove(0)], tau="1", asked=2), result([], tau="2", asked=2, failure="out of fuel")])
    assert all(value is None for line in lines for value in line.means.values())
    text = printed([Parameter("tau", ("1", "2"))], lines)
    assert "1 of 2" in text
    assert f"no score: tau=1, idm, {FAMILY}/1 seed 0\n" in text.replace(" \n", "\n")
    assert f"no score: tau=2, idm, {FAMILY}/0 seed 0, {FAMILY}/1 seed 0: out of fuel" in text
    assert "INCOMPLETE" in text


def test_a_row_without_a_score_counts_as_missing() -> None:
    (line,) = sweep_lines([result([drove(0), drove(1, None, fault=("traffic", "SUMO gave up"))], tau="1")])
    assert [scenario for scenario, _, _ in line.missing] == [f"{FAMILY}/1"]
    assert line.faults == {"traffic": 1}
    assert line.failure == "traffic fault: SUMO gave up"


def test_a_parameter_that_changes_no_drive_is_named() -> None:
    lines = two_by_two()
    assert idle_parameters([DENSITY, REACT], lines) == ["interplan.reactOverlap"]
    assert "interplan.reactOverlap makes no difference" in printed([DENSITY, REACT], lines)
    braking = [result([drove(0, braking=float(tau))], tau=tau) for tau in ("1", "2")]
    assert idle_parameters([Parameter("tau", ("1", "2"))], sweep_lines(braking)) == []
    assert idle_parameters([Parameter("tau", ("1",))], sweep_lines([result([drove(0)], tau="1")])) == []


def test_equal_sweeps_give_equal_csv_with_a_row_per_combination() -> None:
    text = sweep_csv(two_by_two())
    assert text == sweep_csv(two_by_two())
    rows = list(csv.DictReader(io.StringIO(text)))
    assert [(row["density"], row["interplan.reactOverlap"]) for row in rows] == [
        ("low", "0"), ("low", "1"), ("high", "0"), ("high", "1"),
    ]  # fmt: skip
    assert rows[0]["score"] == "75.0000"
    assert rows[2]["score"] == "50.0000"
    assert rows[0]["score_low"] == "0.0000"  # of two scenarios
    assert rows[0]["braking_behind_mps2_max"] == "0.0000"
    assert "score_max" not in rows[0]


def test_json_has_every_measure_and_no_number_that_json_lacks() -> None:
    entries = sweep_json(two_by_two())
    json.dumps(entries, allow_nan=False)
    assert entries[0]["setting"] == {"density": "low", "interplan.reactOverlap": "0"}
    assert set(entries[0]["measures"]) == {measure.key for measure in MEASURES}
    assert entries[0]["measures"]["score"] == {
        "mean": 75.0, "interval": [0.0, 100.0], "scenarios": 2, "drives": 2,
    }  # fmt: skip


# --- changes ---


def tracks(*names: str) -> list[SweepLine]:
    """Ten scenes, each of which loses 20 to 29 points where perception is late."""
    lost = {"plain": 0.0, "late": 0.2}
    return sweep_lines(
        [result([drove(n, 0.9 - lost[name] * (1.0 + 0.05 * n)) for n in range(10)], track=name) for name in names]
    )


def test_changes_are_against_the_plain_track_wherever_it_stands_and_paired_by_scene() -> None:
    late, plain = tracks("late", "plain")
    assert plain.change is None
    assert late.change is not None
    assert late.change.value == pytest.approx(-24.5)
    assert late.change.interval is not None
    low, high = late.change.interval
    assert -29.0 <= low < -24.5 < high <= -20.0
    assert "-24.5 [-27, -22]" in printed([Parameter("track", ("late", "plain"))], [late, plain])
    assert sweep_json([late])[0]["change"]["score"] == pytest.approx(-24.5)
    assert next(csv.DictReader(io.StringIO(sweep_csv([late]))))["change"] == "-24.5000"


def test_without_a_plain_track_changes_are_against_the_first_value_and_of_one_scene_have_no_interval() -> None:
    lines = sweep_lines([result([drove(0, score)], tau=tau) for tau, score in (("1", 0.5), ("2", 0.7))])
    assert lines[0].change is None
    assert lines[1].change is not None
    assert (round(lines[1].change.value, 6), lines[1].change.interval) == (20.0, None)
    missing = sweep_lines([result([], tau="1", asked=1), result([drove(0)], tau="2")])
    assert [line.change for line in missing] == [None, None]


def test_the_page_has_a_curve_for_each_planner_with_its_fall_and_names_are_text() -> None:
    lines = [replace(line, planner=name) for name in ("idm", "<b>mine") for line in tracks("plain", "late")]
    parameter = Parameter("track", ("plain", "late"))
    text = sweep_page([parameter], lines, "interplan-sumo sweep")
    assert "<b>mine" not in text
    assert text.count("&lt;b&gt;mine") > 3
    assert text.count("<small>[") > 4  # intervals stand below their figures: a line fits a screen
    (panel,) = change_panels([parameter], lines)
    assert [(curve.name, len(curve.marks)) for curve in panel.planners] == [("idm", 2), ("<b>mine", 2)]
    assert [text for _, text in panel.upwards] == ["-40", "-20", "0"]
    plain, late = panel.planners[0].marks
    assert plain.hollow
    assert not late.hollow
    assert late.y > plain.y
    assert change_panels([parameter], lines[:1]) == []


def test_every_other_parameter_has_panels_of_its_own() -> None:
    titles = [panel.title for panel in measure_panels([DENSITY, REACT], two_by_two())]
    assert titles[:2] == ["score (0 to 100), density low", "score (0 to 100), density high"]


# --- plots ---


def test_equal_sweeps_of_words_or_numbers_give_equal_pictures(tmp_path: Path) -> None:
    lines = sweep_lines(
        [result([drove(0)], behaviour="mixed"), result([drove(0, 0.2)], behaviour="calm"),
         result([], behaviour="urban", asked=1)]
    )  # fmt: skip
    for name in ("a.png", "b.png"):
        plot_sweep([Parameter("behaviour", ("mixed", "calm", "urban"))], lines, tmp_path / name)
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_every_panel_has_the_scale_0_to_100_and_says_of_how_many_drives_it_is() -> None:
    from matplotlib.figure import Figure

    lines = sweep_lines([result([drove(n, score, seed=seed) for n in range(2) for seed in range(3)], tau=tau)
                         for tau, score in (("1", 0.99), ("2", 1.0))])  # fmt: skip
    axes, tau = Figure().add_subplot(), Parameter("tau", ("1", "2"))
    sweep_plot._curves(axes, MEASURES[0], tau, None, lines, ["idm"])
    assert axes.get_ylim() == (0.0, 100.0)
    sweep_plot._heat_map(axes, MEASURES[0], tau, Parameter("x", ("1",)), [])
    assert axes.images[0].get_clim() == (0.0, 100.0)
    assert sweep_plot._counted(MEASURES[0], lines) == "score (0 to 100)\nn = 2 scenarios, 6 drives"


@pytest.mark.slow
def test_two_parameters_of_several_planners_have_a_row_of_maps_for_each(tmp_path: Path) -> None:
    sizes: list[int] = []
    for planners in (("idm",), ("idm", "pdm")):
        lines = sweep_lines(
            [
                result([drove(0, 0.1 * number, planner=planner)], planner=planner, density=d, tau="1")
                for number, planner in enumerate(planners)
                for d in ("low", "high")
            ]
        )
        plot_sweep([DENSITY, Parameter("tau", ("1",))], lines, tmp_path / "sweep.png")
        sizes.append(int.from_bytes((tmp_path / "sweep.png").read_bytes()[20:24]))  # the height in the header
    assert sizes[1] == pytest.approx(1.5 * sizes[0])


def test_numbers_lie_along_the_axis_in_order_of_size() -> None:
    tau = Parameter("tau", ("10", "9"))
    assert sweep_plot._roles([tau, DENSITY]) == sweep_plot._roles([DENSITY, tau]) == (tau, DENSITY)
    assert sweep_plot.along_axis([DENSITY, REACT, tau]) == tau
    assert sweep_plot.along_axis([DENSITY]) == DENSITY
    assert sweep_plot.ordered_values(tau) == ["9", "10"]
    assert sweep_plot.ordered_values(DENSITY) == ["low", "high"]


def test_green_is_good_at_whichever_end_that_is() -> None:
    pytest.importorskip("matplotlib")
    by_key = {measure.key: sweep_plot._graded(measure) for measure in MEASURES}
    red, green = (179 / 255, 47 / 255)
    for key, at_most, at_least in (("score", green, red), ("at_fault_collisions", red, green)):
        assert by_key[key](1.0)[0] == pytest.approx(at_most, abs=0.01)
        assert by_key[key](0.0)[0] == pytest.approx(at_least, abs=0.01)


def test_no_plot_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    lines, one = two_by_two(), Parameter("tau", ("1",))
    nothing = sweep_lines([result([], density="low", asked=1)])
    assert why_no_plot([DENSITY, REACT], lines) is None
    assert "3 parameters are varied" in (why_no_plot([DENSITY, REACT, one], lines) or "")
    assert "no combination is complete" in (why_no_plot([DENSITY], nothing) or "")
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    assert "pip install 'interplan-sumo[plots]'" in (why_no_plot([DENSITY, REACT], lines) or "")


def test_a_picture_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot write"):
        plot_sweep([DENSITY], sweep_lines([result([drove(0)], density="low")]), tmp_path / "missing" / "sweep.png")
