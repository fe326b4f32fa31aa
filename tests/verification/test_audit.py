"""Audit: what a scenario asks, whatever its family says, and what makes it unsound."""

from __future__ import annotations

from dataclasses import replace

import pytest
from worlds import cars, drive

from interplan_sumo.families.generate import Search
from interplan_sumo.maps.store import load_roads
from interplan_sumo.scenario.suite import DEFAULT_SUITE, find_suite
from interplan_sumo.verification.audit import asks, classes, noisy_objects, unsafe_agents
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.trace import Trace

CLASS_OF = {"jaywalker": "jaywalkers"} | dict.fromkeys(
    ("lane_change_ltd", "lane_change_mtd", "lane_change_htd"), "lane changes"
)


def test_every_official_scenario_asks_what_its_family_is_named_after() -> None:
    for scenario in find_suite(DEFAULT_SUITE).scenarios:
        anonymous = replace(scenario, family="unknown")
        expected = CLASS_OF.get(scenario.family, scenario.family)
        assert asks(anonymous, load_roads(scenario.map)) == expected, scenario.id


@pytest.mark.parametrize("kind", ["following_lane_with_lead", "starting_left_turn", "traversing_pickup_dropoff"])
def test_ordinary_driving_asks_for_nothing_special(kind: str) -> None:
    roads = load_roads("hazelwood")
    assert asks(next(iter(Search(roads, kind, 1))), roads) == "basic driving"


def test_the_classes_are_each_named_once() -> None:
    assert len(set(classes())) == len(classes()) == 7


def trace_of(frames: list[Actors]) -> Trace:
    return drive(*[0.0] * len(frames), actors=frames)


def moving(x_m: float) -> Actors:
    return cars((x_m, 3.5, 10.0))


def test_an_object_that_moves_as_fast_as_it_says_is_quiet() -> None:
    assert noisy_objects(trace_of([moving(20.0), moving(21.0), moving(22.0)])) == ()


@pytest.mark.parametrize(("step_m", "noisy"), [(1.49, False), (1.51, True), (0.51, False), (0.49, True)])
def test_an_object_that_moves_half_a_metre_more_or_less_jumps(step_m: float, noisy: bool) -> None:
    assert bool(noisy_objects(trace_of([moving(20.0), moving(20.0 + step_m)]))) is noisy


@pytest.mark.parametrize(("turn_rad", "noisy"), [(0.49, False), (0.51, True)])
def test_an_object_that_turns_by_half_a_radian_spins(turn_rad: float, noisy: bool) -> None:
    frames = [cars((20.0, 3.5, 0.0, 0.0)), cars((20.0, 3.5, 0.0, turn_rad))]
    assert bool(noisy_objects(trace_of(frames))) is noisy


@pytest.mark.parametrize(("x_m", "noisy"), [(45.0, True), (60.0, False)])
def test_an_object_that_comes_from_nowhere_beside_the_ego_is_noisy(x_m: float, noisy: bool) -> None:
    nobody = cars()
    assert bool(noisy_objects(trace_of([nobody, cars((x_m, 0.0, 0.0, 0.0))]))) is noisy
    assert bool(noisy_objects(trace_of([cars((x_m, 0.0, 0.0, 0.0)), nobody]))) is noisy


def test_only_contacts_that_are_not_the_egos_fault_are_unsafe_agents() -> None:
    contacts = [{"track": "a", "time_s": 3.0, "at_fault": False}, {"track": "b", "time_s": 4.0, "at_fault": True}]
    assert unsafe_agents({"contacts": contacts}) == ("a ran into the ego at 3.0 s",)
    assert unsafe_agents({}) == ()
