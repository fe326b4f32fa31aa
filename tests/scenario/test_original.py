"""interPlan's scenario names and modification details, as its published configuration has them."""

from __future__ import annotations

from itertools import permutations
from typing import Any

import pytest

from interplan_sumo.errors import ScenarioError
from interplan_sumo.families import original_names
from interplan_sumo.scenario.original import Letters, Original, PublishedWalk, parse_letters, read_original

TOKEN = "feb82815b92a5512"
CARS = {"type": "overtake_parked_vehicle", "config": "dh", "stopped_vehicle": [["5.5", "6", "1.29"]]}
WALKS = {"type": "jaywalking_pedestrian", "pedestrian": [["0", "1", "2", "3", "null"], ["0", "1", "2", "3", "50"]]}
DETAILS: dict[str, Any] = {
    "extra_agents_to_spawn": [["664418.07", "3997723.95", "0"], ["1", "2", "3", {"behavior": "cautious"}]],
    "goal": {"left": "664486.82, 3997505.52", "right": "null", "straight": "null"},
    "roadblock_locations_to_spawn_agents": [["10", "20"]],
    "special_scenario": {
        "0": CARS,
        "1": CARS | {"roadblock_locations_to_spawn_agents": []},
        "2": WALKS | {"stopped_bus": [["7", "8", "1.7"]]},
        "3": {"type": "approaching_construction_zone", "config": "gl", "cones": [["1", "2"], ["3", "4"]]},
        "4": {"type": "flying_saucer"},
        "5": {"type": "nudge_around_parked_vehicle", "pedestrian": "null", "cones": "", "stopped_vehicle": []},
        "6": WALKS | {"pedestrian": "everyone"},
        "7": WALKS | {"pedestrian": [["0", "1", "2", "3", "soon"]]},
    },
}


def read(name: str, details: dict[str, Any]) -> Original:
    return read_original(name, details, original_names())


def refused(name: str, details: dict[str, Any], said: str) -> None:
    with pytest.raises(ScenarioError) as error:
        read(name, details)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "letters", "family"),
    [
        ("dhgloc", Letters(density="high", goal="left", policy="conservative"), "lane_change_htd"),
        ("dlgrom", Letters(density="low", goal="right", policy="mixed"), "lane_change_ltd"),
        ("dmgsoa", Letters(density="medium", goal="straight", policy="assertive"), "lane_change_mtd"),
        ("dl", Letters(density="low"), "lane_change_ltd"),
    ],
)
def test_a_name_says_what_its_letters_say(name: str, letters: Letters, family: str) -> None:
    found = read(f"{TOKEN}-{name}", DETAILS)
    assert (found.token, found.letters, found.family) == (TOKEN, letters, family)


def test_the_order_of_the_letters_does_not_matter() -> None:
    found = {parse_letters("".join(order), "x") for order in permutations(("dh", "gl", "oc", "a0"))}
    assert found == {Letters(0, "high", "left", "conservative")}


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("", "this is no name of a scenario"),
        ("feb8-s0", "this is no name of a scenario"),
        (TOKEN, "this is no name of a scenario"),
        (f"{TOKEN}-dx", "'dx' is no modification"),
        (f"{TOKEN}-a2dh", "a2 keeps 2 times the traffic"),
        (f"{TOKEN}-gl", "nothing is left to drive"),
        (f"{TOKEN}-a1", "nothing is left to drive"),
        (f"{TOKEN}-s9", "have no special_scenario 9"),
        (f"{TOKEN}-s6", "pedestrian is no list"),
        (f"{TOKEN}-s7", "pedestrian holds ['soon'], expected 1 numbers"),
        (f"{TOKEN}-s4", "type is 'flying_saucer', expected one of approaching_construction_zone"),
    ],
)
def test_a_name_that_cannot_be_is_one_line(name: str, said: str) -> None:
    refused(name, DETAILS, said)


def test_a_hand_made_scenario_has_its_own_letters_instead() -> None:
    found = read(f"{TOKEN}-s0", DETAILS)
    assert found.letters == Letters(density="high", special=0)
    assert (found.family, found.cars) == ("overtake", ((5.5, 6.0, 1.29),))
    assert found.filled_at == ((10.0, 20.0),)
    assert read(f"{TOKEN}-s1", DETAILS).filled_at == ()  # an empty list overrides that of the token


def test_people_buses_and_cones_are_read_and_what_is_null_is_not_there() -> None:
    walkers = read(f"{TOKEN}-s2", DETAILS)
    assert walkers.walks == (PublishedWalk((0.0, 1.0), (2.0, 3.0)), PublishedWalk((0.0, 1.0), (2.0, 3.0), 50))
    assert walkers.buses == ((7.0, 8.0, 1.7),)
    works = read(f"{TOKEN}-s3", DETAILS)
    assert (works.cones, works.letters.goal) == (((1.0, 2.0), (3.0, 4.0)), "left")
    nothing = read(f"{TOKEN}-s5", DETAILS)
    assert (nothing.walks, nothing.cones, nothing.cars) == ((), (), ())


def test_goals_and_single_cars_come_with_traffic() -> None:
    found = read(f"{TOKEN}-dlgloa", DETAILS)
    assert found.goal_point == (664486.82, 3997505.52)
    assert found.moving == ((664418.07, 3997723.95, 0.0), (1.0, 2.0, 3.0))
    assert read(f"{TOKEN}-dlgroa", DETAILS).goal_point is None
    assert read(f"{TOKEN}-s3", DETAILS).moving == ()


@pytest.mark.parametrize(
    ("details", "said"),
    [
        ({"goal": {"left": "1"}}, "goal.left holds ['1'], expected 2 numbers"),
        ({"goal": {"left": "1, nan"}}, "goal.left holds ['1', ' nan'], expected 2 numbers"),
        ({"goal": {"left": {"x": "1"}}}, "expected 2 numbers"),
        ({"extra_agents_to_spawn": "many"}, "extra_agents_to_spawn is no list"),
        ({"extra_agents_to_spawn": [["1", "2"]]}, "expected 3 numbers"),
        ({"roadblock_locations_to_spawn_agents": ["1"]}, "expected 2 numbers"),
    ],
)
def test_details_that_cannot_be_are_one_line(details: dict[str, Any], said: str) -> None:
    refused(f"{TOKEN}-dlgloa", details, said)
