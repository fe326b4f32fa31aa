"""Comparing two runs: paired drives, intervals, reasons, and what cannot be compared."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from msgspec import structs
from rich.console import Console

from interplan_sumo.batch.run_folder import StoredRun
from interplan_sumo.errors import InputError, RunFolderError, UnknownNameError
from interplan_sumo.report.compare import TIE, Comparison, RunComparison, compare_runs
from interplan_sumo.report.compare_formats import comparison_json, comparison_text
from tests.report.rows import drive, stored


def compare(*args: object, **named: object) -> Comparison:
    """Of one pair of planners."""
    (found,) = compare_runs(*args, **named).pairs  # type: ignore[arg-type]
    return found


def printed(found: RunComparison) -> str:
    console = Console(width=200)
    with console.capture() as captured:
        console.print(comparison_text(found))
    return captured.get()


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
    assert found.overall.interval == compare(a, stored(drive("nudge/0", 0.6), drive("nudge/1", 0.0))).overall.interval


def test_a_single_scenario_has_no_interval_and_nothing_in_common_has_no_difference():
    a = stored(*(drive("nudge/0", 0.0, seed=seed) for seed in range(2)))
    b = stored(*(drive("nudge/0", 0.5 * seed, seed=seed) for seed in range(2)))
    found = compare(a, b)
    assert (found.overall.difference, found.overall.interval, found.adjusted_p) == (25.0, None, None)
    assert "One scenario or none says nothing about others." in printed(compare_runs(a, b))
    apart = compare_runs(a, stored(drive("nudge/1", 0.5)))
    assert apart.pairs[0].overall.difference is None
    assert comparison_json(apart)["overall"]["a"] is None


def scores(name: str, more: float, *, count: int = 12, planner: str = "idm") -> StoredRun:
    """Scores that differ much between scenarios, and by about `more` from a run of the same planner with 0."""
    rows = [drive(f"nudge/{n}", 0.05 * n + more * (0.9 + 0.02 * n), planner=planner) for n in range(count)]
    return stored(*rows, path=f"runs/{name}")


def test_better_is_who_differs_by_more_than_chance():
    assert compare(scores("a", 0.0), scores("b", 0.1)).better == "b"
    assert compare(scores("a", 0.1), scores("b", 0.0)).better == "a"
    assert compare(scores("a", 0.0), scores("b", 0.0)).better is None
    assert compare(scores("a", 0.0, count=5), scores("b", 0.1, count=5)).better is None  # too few, however equal
    noisy = stored(
        *(drive(f"nudge/{n}", 0.05 * n + (0.3 if n % 2 else -0.05 * min(n, 4))) for n in range(12)), path="runs/b"
    )
    found = compare(scores("a", 0.0), noisy)
    assert (found.overall.difference or 0.0) > 5.0
    assert found.better is None
    assert found.overall.interval is not None
    assert found.overall.interval[0] < 0.0 < found.overall.interval[1]
    assert (found.overall.least_detectable_difference or 0.0) > 10.0


def test_planners_that_both_runs_hold_are_paired_with_themselves():
    def run(path: str, *more: float) -> StoredRun:
        rows = [
            r
            for name, m in zip(("idm", "y", "z"), more, strict=False)
            for r in scores("", m, planner=name).rows.values()
        ]
        return stored(*rows, path=path)

    found = compare_runs(run("runs/old", 0.0, 0.0), run("runs/new", 0.1, 0.0, 0.3))
    assert [(pair.a, pair.b, pair.better) for pair in found.pairs] == [
        ("old: idm", "new: idm", "b"),
        ("old: y", "new: y", None),
    ]
    assert found.pairs[0].adjusted_p == pytest.approx(2 * (found.pairs[0].overall.p_value or 0.0))  # of two pairs
    assert (found.only_a, found.only_b, found.complete) == ((), ("z",), True)
    text = printed(found)
    assert "Only in b: z" in text
    assert text.count("b is better (") == 1
    assert text.count("Not to be told apart (") == 1
    report = json.loads(json.dumps(comparison_json(found), allow_nan=False))
    assert [pair["b"] for pair in report["pairs"]] == ["new: idm", "new: y"]
    assert report["only"] == {"a": [], "b": ["z"]}
    (one,) = compare_runs(run("runs/old", 0.0, 0.0), run("runs/new", 0.1, 0.0), "idm", "y").pairs
    assert (one.a, one.b) == ("old: idm", "new: y")


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
        ("suite_hash", "2", "their scenes are not the same"),
        ("traffic_version", 3, "the traffic drives otherwise since"),
        ("profile", "nuplan", "--profile NAME scores both again"),
        ("versions", {"scoring": "2"}, "runs/after has 2; --profile NAME scores both again"),
    ],
)
def test_different_suites_profiles_and_versions_are_refused(what: str, value: object, words: str):
    with pytest.raises(RunFolderError, match=words):
        compare(before(), replace(after(), manifest=structs.replace(after().manifest, **{what: value})))


def test_equal_differences_leave_room_for_scenes_that_differ_otherwise():
    a, b = ([drive(f"nudge/{n}", score, unsafe=False) for n in range(10)] for score in (0.5, 0.6))
    found = compare(stored(*a), stored(*b)).overall
    assert found.interval == pytest.approx((10.0 - 0.3085 * 110.0, 10.0 + 0.3085 * 90.0), abs=0.1)
    assert found.unsafe_interval == pytest.approx((-30.85, 30.85), abs=0.1)
    assert found.p_value is not None
    assert found.p_value > 0.05


def test_a_planner_is_named_where_it_is_not_clear_which():
    both = stored(drive("nudge/0", 0.5), drive("nudge/0", 0.9, planner="mine"))
    assert compare(both, both, "idm", "mine").overall.difference == pytest.approx(40.0)
    assert compare(both, before()).a == "a: idm"
    assert compare(both, both, planner_a="mine").overall.difference == 0.0
    with pytest.raises(InputError, match=r"holds 2 planners \(idm, mine\); name one: --planner-a"):
        compare(both, both)
    with pytest.raises(UnknownNameError, match=r"no planner in runs/a named 'mini'\. Did you mean 'mine'"):
        compare(both, both, planner_b="mini", planner_a="idm")


def test_the_json_is_plain_and_the_text_says_the_same():
    found = compare_runs(before(), after())
    report = json.loads(json.dumps(comparison_json(found), allow_nan=False))
    assert report["overall"]["difference"] == -20.0
    assert report["overall"]["wins"] == 1
    assert len(report["overall"]["interval"]) == 2
    assert report["changes"][0]["difference"] == -100.0
    text = printed(found)
    assert "-20.0" in text
    assert "at-fault collision: drove into vehicle v1" in text
    assert "INCOMPLETE" not in text


def test_who_is_unsafe_more_often_is_not_called_better():
    def run(name: str, more: float, unsafe: int | None) -> StoredRun:
        rows = [
            structs.replace(row, unsafe=None if unsafe is None else n < unsafe)
            for n, row in enumerate(scores(name, more).rows.values())
        ]
        return stored(*rows, path=f"runs/{name}")

    for of_a, of_b, better in ((2, 2, "b"), (3, 2, "b"), (None, None, "b"), (2, 3, None)):
        found = compare_runs(run("a", 0.0, of_a), run("b", 0.1, of_b))
        assert (found.pairs[0].scores_more, found.pairs[0].better) == ("b", better)
    assert found.pairs[0].overall.unsafe_b == 25.0
    low, high = comparison_json(found)["overall"]["unsafe_interval"]
    assert low < 100.0 / 12 < high
    assert "b scores more but is unsafe more often" in printed(found)
    assert comparison_json(found)["better"] is None
