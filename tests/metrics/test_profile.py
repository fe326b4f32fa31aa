"""Profiles as data: what a file says is what scores, and what cannot be used is told in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from interplan_sumo.errors import InputError, UnknownNameError
from interplan_sumo.metrics.metric import METRICS, MetricResult, failure_words, informative_metrics, metric
from interplan_sumo.metrics.profile import PROFILES, Term, find_profile, keep_profile, row_metrics, stored_profile

MINE = """
needs_scenario: false
honours_exemptions: true
gates:
  - {metric: no_collision}
weights:
  - {metric: nuplan_progress, as: progress, weight: 5}
  - {metric: driving_direction, weight: 1, when: lane_blocked}
"""


def file_of(folder: Path, text: str, name: str = "mine.yaml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_a_file_says_what_is_judged_and_with_what_weight(tmp_path: Path):
    profile = find_profile(str(file_of(tmp_path, MINE)))
    assert profile.terms == (
        Term("no_collision"),
        Term("nuplan_progress", "progress", weight=5.0),
        Term("driving_direction", when="lane_blocked", weight=1.0),
    )
    assert (profile.needs_scenario, profile.honours_exemptions) == (False, True)
    assert find_profile(profile) is profile


def test_files_that_say_something_else_have_another_name(tmp_path: Path):
    name = find_profile(file_of(tmp_path, MINE)).name
    assert name.startswith("mine@")
    assert find_profile(file_of(tmp_path, f"# a remark\n{MINE}")).name == name
    assert find_profile(file_of(tmp_path, MINE.replace("5}", "4}"))).name != name
    assert find_profile(file_of(tmp_path, MINE.replace("exemptions: true", "exemptions: false"))).name != name


def test_a_run_folder_keeps_the_profile_of_a_file(tmp_path: Path):
    profile = find_profile(file_of(tmp_path, MINE))
    (tmp_path / "mine.yaml").unlink()
    keep_profile(profile, tmp_path)
    assert stored_profile(profile.name, tmp_path) == profile
    assert stored_profile("nuplan", tmp_path) == find_profile("nuplan")


@pytest.mark.parametrize(
    ("said", "instead", "problem"),
    [
        ("no_collision", "no_colision", r"no metric .*Did you mean 'no_collision'\? - at `gates\[0\]`"),
        ("{metric: no_collision}", "{metrik: no_collision}", r"unknown field `metrik` - at `gates\[0\]`"),
        (
            "{metric: no_collision}",
            "{metric: no_collision, weight: 2}",
            "no_collision needs a weight among the weights",
        ),
        ("{metric: no_collision}", "{metric: no_collision, as: progress}", "progress stands 2 times"),
        ("weight: 5", "weight: 0", r"Expected `float` > 0.0 - at `weights\[0\].weight`"),
        ("weight: 5", "weight: .inf", "Expected `float` <= 1000000.0"),
        ("weight: 5", "weight: .nan", "Expected `float` > 0.0"),
        (", weight: 5", "", "progress needs a weight among the weights"),
        ("lane_blocked", "lane_bloked", "no condition .*Did you mean 'lane_blocked'"),
        ("needs_scenario: false", "", "missing required field `needs_scenario`"),
        ("needs_scenario", "\tneeds_scenario", "line 2: this is not YAML"),
        (MINE, "", "Expected `object`, got `null`"),
        (MINE, "!!python/object/apply:os.getcwd []", "line 1: this is not YAML: could not determine a constructor"),
        (MINE, "2026-13-45", "month must be in"),
        (MINE, "[" * 1000, "maximum recursion depth"),
    ],
)
def test_a_file_that_cannot_be_used_is_told_in_one_line(tmp_path: Path, said: str, instead: str, problem: str):
    path = file_of(tmp_path, MINE.replace(said, instead, 1))
    with pytest.raises(InputError, match=problem) as caught:
        find_profile(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_or_no_text_and_an_unknown_profile_are_told(tmp_path: Path):
    with pytest.raises(InputError, match=r"none\.yaml: No such file"):
        find_profile(str(tmp_path / "none.yaml"))
    (tmp_path / "bytes.yml").write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match=r"bytes\.yml: 'utf-8' codec"):
        find_profile(tmp_path / "bytes.yml")
    with pytest.raises(UnknownNameError, match="Did you mean 'nuplan'"):
        find_profile("nuplann")


def test_every_metric_has_a_column_of_its_own_in_rows():
    columns = row_metrics()
    assert len(columns) == len(set(columns))
    assert {term.name for name in PROFILES for term in find_profile(name).terms} < set(columns)
    assert set(informative_metrics()) == {"diagnostics", "lane_crossings"} < set(columns)


def test_a_metric_speaks_for_itself_and_a_missing_one_by_its_name():
    @metric(title="Smooth ride")
    def smoothness(_: object) -> MetricResult:
        return MetricResult(0.5)

    assert (smoothness.title, smoothness.failure, smoothness.informative) == ("Smooth ride", "Smooth ride", False)
    assert METRICS["driving_direction"].title == "driving direction"
    assert failure_words("driving_direction") == "wrong direction"
    assert failure_words("not_installed_here") == "not installed here"
