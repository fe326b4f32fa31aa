"""Audit: what a scenario asks, whatever its family says, and what makes it unsound."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from worlds import cars, drive

from interplan_sumo.families.generate import Search
from interplan_sumo.maps.store import load_roads
from interplan_sumo.scenario.suite import DEFAULT_SUITE, find_suite
from interplan_sumo.verification.audit import asks, classes, noisy_objects, unsafe_agents
from interplan_sumo.world.actors import ActorKind, Actors

CLASS_OF = {"jaywalker": "jaywalkers"} | dict.fromkeys(
    ("lane_change_ltd", "lane_change_mtd", "lane_change_htd"), "lane changes"
)


@pytest.mark.slow
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


def at(x_m: float, heading_rad: float = 0.0, speed_mps: float = 0.0) -> Actors:
    return cars((x_m, 3.5, speed_mps, heading_rad))


@pytest.mark.parametrize(
    ("before", "after", "noisy"),
    [
        (at(20.0, 0.0, 10.0), at(21.0, 0.0, 10.0), False),  # as fast as it says
        (at(20.0, 0.0, 10.0), at(21.49, 0.0, 10.0), False),  # half a metre more
        (at(20.0, 0.0, 10.0), at(21.51, 0.0, 10.0), True),
        (at(20.0, 0.0, 10.0), at(20.51, 0.0, 10.0), False),  # or less
        (at(20.0, 0.0, 10.0), at(20.49, 0.0, 10.0), True),
        (at(20.0), at(20.0, 0.49), False),  # half a radian
        (at(20.0), at(20.0, 0.51), True),
        (cars(), cars((45.0, 0.0)), True),  # from nowhere beside the ego, or into nowhere
        (cars(), cars((60.0, 0.0)), False),
        (cars((45.0, 0.0)), cars(), True),
        (cars((60.0, 0.0)), cars(), False),
    ],
)
def test_an_object_that_jumps_spins_or_comes_from_nowhere_is_noisy(before: Actors, after: Actors, noisy: bool) -> None:
    assert bool(noisy_objects(drive(0.0, 0.0, actors=[before, after]))) is noisy


def test_people_on_foot_may_turn_back() -> None:
    before, after = at(20.0, 0.0), at(20.0, np.pi)
    assert noisy_objects(drive(0.0, 0.0, actors=[before, after]))
    on_foot = np.array([ActorKind.PEDESTRIAN], np.int8)
    walker = [replace(each, kind=on_foot) for each in (before, after)]
    assert noisy_objects(drive(0.0, 0.0, actors=walker)) == ()


def test_who_is_gone_for_some_frames_beside_the_ego_is_noisy() -> None:
    there, gone = cars((45.0, 0.0)), cars()
    assert noisy_objects(drive(0.0, 0.0, 0.0, actors=[there, there, there])) == ()
    said = noisy_objects(drive(0.0, 0.0, 0.0, actors=[there, gone, there]))
    assert [each.partition(" ")[2] for each in said] == [
        "appears beside the ego at 0.2 s", "vanishes beside the ego at 0.0 s",
    ]  # fmt: skip


def test_only_contacts_that_are_not_the_egos_fault_are_unsafe_agents() -> None:
    contacts = [{"track": "a", "time_s": 3.0, "at_fault": False}, {"track": "b", "time_s": 4.0, "at_fault": True}]
    assert unsafe_agents({"contacts": contacts}) == ("a ran into the ego at 3.0 s",)
    assert unsafe_agents({}) == ()
