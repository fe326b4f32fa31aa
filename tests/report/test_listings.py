"""Listings: what planners are made of and where they were published, and what they see of scenarios."""

from __future__ import annotations

from dataclasses import replace
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import pytest

from interplan_sumo import planner, registry
from interplan_sumo.report.listings import file_details, file_entries, planner_entries, scenario_details, suite_entries
from interplan_sumo.scenario.certificates import FILE, Certificate, Summary, write_certificates
from interplan_sumo.scenario.files import write_scenarios
from interplan_sumo.scenario.suite import expert, find_scenario
from tests.commands import ran
from tests.scenes import scene


def test_scenarios_say_what_planners_see_of_them() -> None:
    assert {entry["perception"] for entry in suite_entries("smoke==1")} == {"occluded"}
    noisy = replace(find_scenario("nudge/0"), perception="noisy")
    entry = scenario_details(noisy)
    assert (entry["perception"], entry["scenario"]["perception"]) == ("noisy", "noisy")


def test_scenarios_of_a_file_or_folder_are_listed_with_the_certificates_beside_it(tmp_path: Path) -> None:
    proved, open_one = (replace(scene("nudge/0"), id=f"mine/{number}") for number in range(2))
    write_scenarios((proved, open_one), tmp_path / "scenarios.yaml")
    summary = Summary(proved.id, proved.hash(), 0.95, 100.0, 100.0, True, "0", ("foresight",))
    write_certificates(tmp_path / FILE, [Certificate(summary, expert(find_scenario("nudge/0")))])
    for place in (tmp_path, tmp_path / "scenarios.yaml"):
        first, second = file_entries(place)
        assert (first["id"], first["solved_by"], first["certificate"]["score"]) == ("mine/0", ("foresight",), 0.95)
        assert (second["id"], second["solved_by"], second["certificate"]) == ("mine/1", None, None)
    write_scenarios((replace(proved, start_speed_mps=proved.start_speed_mps - 1.0),), tmp_path / "scenarios.yaml")
    (changed,) = file_entries(tmp_path)
    assert changed["certificate"] is None


def test_details_of_a_file_have_the_certificate_beside_it_and_no_suite_that_has_another_scene(tmp_path: Path) -> None:
    official = find_scenario("nudge/0")
    edited = replace(official, start_speed_mps=official.start_speed_mps - 1.0)
    summary = Summary(edited.id, edited.hash(), 0.95, 100.0, 100.0, True, "0", ())
    write_certificates(tmp_path / FILE, [Certificate(summary, expert(official))])
    write_scenarios((edited,), tmp_path / "mine.yaml")
    (shown,) = file_details(tmp_path / "mine.yaml")
    assert (shown["certificate"]["score"], shown["solved_by"], shown["suites"]) == (0.95, (), [])
    assert "interplan==1" in scenario_details(official)["suites"]


def test_a_suite_of_hard_scenes_says_how_hard_they_are_and_no_other_does() -> None:
    assert {entry["difficulty"] for entry in suite_entries("interplan-hard==1")} == {0.6, 0.8, 1.0}
    assert all("difficulty" not in entry for entry in suite_entries("smoke==1"))
    everything = {entry["id"]: entry["difficulty"] for entry in suite_entries()}
    assert sum(hard is not None for hard in everything.values()) == 100
    assert everything["nudge/0"] is None


def test_a_list_that_cannot_be_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words, given in (("cannot read", (tmp_path,)), ("two lists", (tmp_path, "--suite", "smoke==1"))):
        code, _, err = ran(capsys, "scenarios", "list", *given)
        assert (code, words in err, err.count("\n")) == (2, True, 1)


class Published:
    paper = "Nobody 1999"

    def __init__(self, gap_m: float = 2.0) -> None: ...


class Plain:
    pass


class WithAMethodOfThatName:
    def paper(self) -> str:
        return "of its own"


def test_registered_planners_say_where_they_were_published() -> None:
    papers = {entry["name"]: entry["paper"] for entry in planner_entries()}
    assert papers["pdm_closed"] == "Dauner et al. 2023"
    assert papers["foresight"] is None


def test_a_planner_of_others_needs_no_paper(monkeypatch: pytest.MonkeyPatch) -> None:
    found = [EntryPoint(c.__name__, f"{__name__}:{c.__name__}", "g") for c in (Plain, Published, WithAMethodOfThatName)]
    broken = EntryPoint("absent", f"{__name__}:Absent", "g")
    monkeypatch.setattr(registry, "entry_points", lambda **_: EntryPoints([*found, broken]))
    monkeypatch.setattr(planner, "PLANNERS", registry.Registry("g", "planner"))
    entries = {entry["name"]: entry for entry in planner_entries()}
    assert (entries["Published"]["paper"], entries["Published"]["parameters"]) == ("Nobody 1999", {"gap_m": 2.0})
    assert [entries[name]["paper"] for name in ("Plain", "WithAMethodOfThatName", "absent")] == [None] * 3
    assert "Absent" in entries["absent"]["problem"]
