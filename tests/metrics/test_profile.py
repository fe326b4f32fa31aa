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
        Term("no_collision", "no_collision"),
        Term("progress", "nuplan_progress", 5.0),
        Term("driving_direction", "driving_direction", 1.0, "lane_blocked"),
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
        ("{metric: no_collision}", "{metric: no_colision}", "line 5: no metric .*Did you mean 'no_collision'"),
        ("{metric: no_collision}", "{metric: [1]}", r"line 5: no metric named '\[1\]'"),
        ("{metric: no_collision}", "{metrik: no_collision}", "line 5: no field named 'metrik'. Did you mean 'metric'"),
        ("{metric: no_collision}", "{metric: no_collision, weight: 2}", "line 5: no field named 'weight'"),
        ("{metric: no_collision}", "no_collision", "found 'no_collision' in place of a gate; docs/metrics.md"),
        ("{metric: no_collision}", "{as: x}", "line 5: a gate has no metric"),
        ("{metric: no_collision}", "{metric: no_collision, as: progress}", "line 2: progress stands 2 times"),
        ("as: progress", "as: my progress", "line 7: as is 'my progress', expected a word"),
        ("as: progress", "as: 3", "line 7: as is 3, expected a word"),
        ("weight: 5", "weight: 0", "line 7: the weight of progress is 0, expected a number above 0"),
        ("weight: 5", "weight: .inf", "line 7: the weight of progress is inf"),
        ("weight: 5", "weight: true", "line 7: the weight of progress is True"),
        ("weight: 5", "weight: five", "line 7: the weight of progress is 'five'"),
        (", weight: 5", "", "line 7: a weighted term has no weight"),
        ("weight: 5", "weight: 5, weight: 6", "line 7: this is not YAML: a key stands twice"),
        ("lane_blocked", "lane_bloked", "line 8: no condition .*Did you mean 'lane_blocked'"),
        ("needs_scenario: false", "needs_scenario: 0", "line 2: needs_scenario is 0, expected true or false"),
        ("needs_scenario: false", "", "a profile has no needs_scenario"),
        ("gates:\n  -", "gates:", "line 2: gates is no list of terms"),
        ("needs_scenario", "\tneeds_scenario", "line 2: this is not YAML"),
        (MINE, "", "found 'None' in place of a profile"),
        (MINE, "needs_scenario: true\nhonours_exemptions: true\n", "line 1: there are no weights"),
        (MINE, "!!python/object/apply:os.getcwd []", "line 1: this is not YAML: could not determine a constructor"),
        (MINE, "2026-13-45", "this is not YAML: month must be in"),
        (MINE, "[" * 1000, "lists inside lists"),
    ],
)
def test_a_file_that_cannot_be_used_is_told_in_one_line(tmp_path: Path, said: str, instead: str, problem: str):
    path = file_of(tmp_path, MINE.replace(said, instead, 1))
    with pytest.raises(InputError, match=problem) as caught:
        find_profile(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_or_no_text_is_told(tmp_path: Path):
    with pytest.raises(InputError, match=r"none\.yaml: No such file"):
        find_profile(str(tmp_path / "none.yaml"))
    path = tmp_path / "bytes.yml"
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match=r"bytes\.yml is no text in UTF-8"):
        find_profile(path)


def test_an_unknown_profile_names_the_nearest():
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
