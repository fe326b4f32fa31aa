"""Listings: what planners are made of and where they were published, and what they see of scenarios."""

from __future__ import annotations

from dataclasses import replace
from importlib.metadata import EntryPoint, EntryPoints

import pytest

from interplan_sumo import planner, registry
from interplan_sumo.report.listings import planner_entries, scenario_details, suite_entries
from interplan_sumo.scenario.suite import find_scenario


def test_scenarios_say_what_planners_see_of_them() -> None:
    assert {entry["perception"] for entry in suite_entries("smoke==1")} == {"occluded"}
    noisy = replace(find_scenario("nudge/0"), perception="noisy")
    entry = scenario_details(noisy)
    assert (entry["perception"], entry["scenario"]["perception"]) == ("noisy", "noisy")


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
