"""Jobs and overrides: who drives what, and what the user changed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from interplan_sumo.batch.jobs import chosen, interleaved, jobs_for
from interplan_sumo.batch.overrides import Overrides
from interplan_sumo.batch.records import AppliedOverrides, keys_of
from interplan_sumo.errors import InputError, UnknownNameError
from interplan_sumo.scenario.scenario import PlacedVehicle, Scenario, TrafficDemand
from tests.batch.busy import PLAIN
from tests.records import asked


def scenario(name: str, density: str = "none", oncoming: str = "none") -> Scenario:
    demand = TrafficDemand(density, "mixed", oncoming)  # type: ignore[arg-type]
    return replace(PLAIN, id=name, family=name.partition("/")[0], traffic=demand)


PAIR = ["idm", "pdm"]
ALL = tuple(scenario(f"{family}/{n}") for family in ("nudge", "overtake") for n in range(3))


def test_jobs_are_every_planner_on_every_scenario_with_every_seed_once() -> None:
    jobs = jobs_for(ALL[:2], ["idm", "pdm", "idm"], 2)
    assert len({job.key for job in jobs}) == len(jobs) == 2 * 2 * 2


def test_every_beginning_of_a_run_resembles_the_whole() -> None:
    order = [job.key for job in interleaved(jobs_for(ALL, PAIR, 2))]
    assert set(order[:4]) == {(f"{family}/0", planner, 0) for family in ("nudge", "overtake") for planner in PAIR}
    assert [seed for _, _, seed in order] == [0] * 12 + [1] * 12
    assert set(order) == {job.key for job in jobs_for(ALL, PAIR, 2)}


def test_requests_that_overlap_ask_for_each_job_once() -> None:
    assert keys_of([asked("idm", "a b"), asked("idm pdm", "a", 2)]) == [
        ("a", "idm", 0), ("b", "idm", 0), ("a", "idm", 1), ("a", "pdm", 0), ("a", "pdm", 1),
    ]  # fmt: skip


def test_globs_choose_scenarios_in_suite_order() -> None:
    assert [s.id for s in chosen(ALL, ["overtake/[02]", "nudge/1"])] == ["nudge/1", "overtake/0", "overtake/2"]
    assert chosen(ALL, []) == ALL
    assert len(chosen(ALL, ["nudge/*"], limit=2)) == 2


def test_a_glob_that_matches_nothing_is_named_with_a_guess() -> None:
    with pytest.raises(UnknownNameError, match=r"no scenario named 'nuge/1'\. Did you mean 'nudge/1'\?"):
        chosen(ALL, ["nudge/*", "nuge/1"])


def test_density_and_behaviour_change_only_where_there_is_moving_traffic() -> None:
    high = Overrides("high")
    assert high.applied(scenario("a", "low")).traffic.density == "high"
    assert high.applied(scenario("a", "none")) == scenario("a", "none")
    oncoming_only = high.applied(scenario("a", "none", oncoming="low")).traffic
    assert (oncoming_only.density, oncoming_only.oncoming) == ("none", "high")
    assertive = Overrides(behaviour="assertive")
    assert assertive.applied(scenario("a", "low")).traffic.behaviour == "assertive"
    assert assertive.applied(scenario("a")).traffic.behaviour == "mixed"
    placed = replace(scenario("a"), vehicles=(PlacedVehicle(PLAIN.start, 5.0),))
    assert assertive.applied(placed).traffic == TrafficDemand(behaviour="assertive")
    assert high.applied(placed).traffic == placed.traffic


def test_a_vehicle_type_file_counts_by_name_and_content(tmp_path: Path) -> None:
    for folder, content in (("one", "same"), ("two", "same"), ("three", "other")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "my.xml").write_text(content)
    said = [Overrides(vehicle_types=tmp_path / f / "my.xml").canonical() for f in ("one", "two", "three")]
    assert said[0] == said[1] != said[2]
    assert str(said[0].traffic).startswith("my.xml sha256:")


def test_a_vehicle_type_file_that_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.xml"):
        Overrides(vehicle_types=tmp_path / "none.xml").canonical()


def test_no_override_is_official() -> None:
    assert not Overrides()
    assert Overrides().canonical() == AppliedOverrides()
