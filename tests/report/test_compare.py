"""Comparing two runs: paired drives, intervals, reasons, and what cannot be compared."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs
from rich.console import Console

from interplan_sumo.batch.run_folder import StoredRun
from interplan_sumo.errors import InputError, RunFolderError, UnknownNameError
from interplan_sumo.report import compare as report_compare
from interplan_sumo.report.compare import TIE, compare, mean_interval
from interplan_sumo.report.compare_formats import comparison_json, comparison_text
from interplan_sumo.report.table import RESAMPLES
from tests.report.rows import drive, stored


def before() -> StoredRun:
    return stored(drive("nudge/0", 0.5), drive("nudge/1", 0.2), drive("overtake/0", 1.0), path="runs/before")


def after() -> StoredRun:
    crashed = drive("overtake/0", 0.0, no_collision=0.0, no_collision_because="drove into vehicle v1 at 3.0 s")
    return stored(drive("nudge/0", 0.9), drive("nudge/1", 0.2), crashed, path="runs/after")


def test_the_difference_is_b_less_a_paired_on_scenario_and_seed():
    found = compare(before(), after())
    assert (found.a, found.b) == ("before: idm", "after: idm")
    assert found.overall.difference == pytest.approx(100.0 * (0.4 + 0.0 - 1.0) / 3)
    assert (found.overall.a, found.overall.b) == pytest.approx((170.0 / 3, 110.0 / 3))
    assert (found.overall.wins, found.overall.losses, found.overall.ties) == (1, 1, 1)
    assert found.families["nudge"].difference == pytest.approx(20.0)
    assert found.families["overtake"].interval is None
    assert found.complete


def test_what_changed_most_comes_first_with_the_reason_of_the_worse():
    changes = compare(before(), after()).changes
    assert [c.scenario_id for c in changes] == ["overtake/0", "nudge/0", "nudge/1"]
    assert changes[0].reason == "b: at-fault collision: drove into vehicle v1 at 3.0 s"
    assert changes[2].reason == ""


def test_only_what_the_other_did_better_is_a_reason():
    a = stored(drive("nudge/0", 0.5, progress=0.5, lane_changes=0.5))
    b = stored(drive("nudge/0", 0.4, progress=0.5, lane_changes=0.25))
    assert compare(a, b).changes[0].reason == "b: goal lane missed"


def test_a_fault_of_the_planner_is_a_zero_and_the_reason():
    failed = stored(drive("nudge/0", 0.0, fault=("planner", "ValueError: no")))
    (change,) = compare(failed, stored(drive("nudge/0", 0.7))).changes
    assert (change.winner, change.reason) == ("b", "a: planner fault: ValueError: no")
    (change,) = compare(stored(drive("nudge/0", 0.7, progress=0.5)), failed).changes
    assert (change.winner, change.reason) == ("a", "b: planner fault: ValueError: no")


@pytest.mark.parametrize(("more", "winner"), [(0.9 * TIE, "tie"), (1.1 * TIE, "b"), (-1.1 * TIE, "a")])
def test_scores_that_agree_within_the_bar_are_tied(more: float, winner: str):
    (change,) = compare(stored(drive("nudge/0", 0.5)), stored(drive("nudge/0", 0.5 + more))).changes
    assert change.winner == winner


def test_seeds_of_a_scenario_weigh_as_one_scenario():
    a = stored(*(drive("nudge/0", 0.0, seed=seed) for seed in range(3)), drive("nudge/1", 0.0))
    b = stored(*(drive("nudge/0", 0.6, seed=seed) for seed in range(3)), drive("nudge/1", 0.0))
    found = compare(a, b)
    assert found.overall.difference == pytest.approx(30.0)
    assert (found.overall.scenarios, found.overall.drives) == (2, 4)
    assert found.overall.interval == pytest.approx((0.0, 60.0))


def test_of_a_single_scenario_the_seeds_are_drawn_again_and_nothing_in_common_has_no_difference():
    a = stored(*(drive("nudge/0", 0.0, seed=seed) for seed in range(2)))
    b = stored(*(drive("nudge/0", 0.5 * seed, seed=seed) for seed in range(2)))
    assert compare(a, b).overall.interval == pytest.approx((0.0, 50.0))
    found = compare(a, stored(drive("nudge/1", 0.5)))
    assert found.overall.difference is None
    assert comparison_json(found)["overall"]["a"] is None


def test_drives_without_a_score_on_one_side_are_named_and_left_out():
    b = stored(
        drive("nudge/0", 0.9), drive("overtake/0", None, fault=("traffic", "SUMO gave up")), missing=("jaywalker/0",)
    )
    found = compare(before(), b)
    assert not found.complete
    assert found.missing_a == (("jaywalker/0", 0),)
    assert found.missing_b == (("nudge/1", 0), ("overtake/0", 0), ("jaywalker/0", 0))
    assert found.overall.drives == 1
    assert found.overall.difference == pytest.approx(40.0)


@pytest.mark.parametrize(
    ("what", "value", "words"),
    [
        ("suite", "common==1", "has suite smoke==1"),
        ("suite_hash", "2", "the suite has changed in between"),
        ("traffic_version", 3, "the traffic drives otherwise since"),
        ("profile", "nuplan", "--profile NAME scores both again"),
    ],
)
def test_different_suites_and_profiles_are_refused(what: str, value: object, words: str):
    with pytest.raises(RunFolderError, match=words):
        compare(before(), replace(after(), manifest=structs.replace(after().manifest, **{what: value})))


def test_different_scoring_versions_are_refused():
    a, b = (stored(drive("nudge/0", 0.5, scoring_version=version)) for version in (1, 2))
    with pytest.raises(RunFolderError, match="different scoring versions"):
        compare(a, b)


def test_a_planner_is_named_where_it_is_not_clear_which():
    both = stored(drive("nudge/0", 0.5), drive("nudge/0", 0.9, planner="mine"))
    assert compare(both, both, "idm", "mine").overall.difference == pytest.approx(40.0)
    assert compare(both, before()).a == "a: idm"
    assert compare(both, both, planner_a="mine").overall.difference == 0.0
    with pytest.raises(InputError, match=r"holds 2 planners \(idm, mine\); name one: --planner-a"):
        compare(both, both)
    with pytest.raises(UnknownNameError, match=r"no planner in runs/a named 'mini'\. Did you mean 'mine'"):
        compare(both, both, planner_b="mini", planner_a="idm")


def test_the_interval_holds_the_mean_is_reproducible_and_shrinks_with_more_scenarios():
    rng = np.random.default_rng(7)
    few, many = rng.normal(10.0, 5.0, 20), rng.normal(10.0, 5.0, 2000)
    interval = mean_interval(few)
    assert interval is not None
    low, high = interval
    assert low < few.mean() < high
    assert mean_interval(few) == (low, high)
    assert high - low == pytest.approx(2 * 1.96 * few.std() / np.sqrt(20), rel=0.1)
    narrow = mean_interval(many)
    assert narrow is not None
    assert narrow[1] - narrow[0] < 0.2 * (high - low)
    assert mean_interval(np.array([3.0, 3.0])) == (3.0, 3.0)
    assert mean_interval(np.array([3.0])) is None
    assert RESAMPLES >= 1000


def test_the_json_is_plain_and_the_text_says_the_same():
    found = compare(before(), after())
    report = json.loads(json.dumps(comparison_json(found), allow_nan=False))
    assert report["overall"]["difference"] == -20.0
    assert report["overall"]["wins"] == 1
    assert len(report["overall"]["interval"]) == 2
    assert report["changes"][0]["difference"] == -100.0
    console = Console(width=200)
    with console.capture() as captured:
        console.print(comparison_text(found))
    text = captured.get()
    assert "-20.0" in text
    assert "at-fault collision: drove into vehicle v1" in text
    assert "INCOMPLETE" not in text


def test_over_many_values_the_interval_is_the_one_that_bootstrap_means_tend_to(monkeypatch: pytest.MonkeyPatch) -> None:
    values = np.arange(200.0) % 17
    drawn = mean_interval(values)
    monkeypatch.setattr(report_compare, "MANY_DRIVES", 199)
    computed = mean_interval(values)
    assert drawn is not None
    assert drawn != computed
    assert computed == pytest.approx(drawn, abs=0.05)
