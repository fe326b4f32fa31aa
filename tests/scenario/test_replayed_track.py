"""Replayed tracks as data: checked, written and read without a loss, and no burden on scenarios without them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from interplan_sumo.errors import ScenarioError
from interplan_sumo.scenario.files import read_scenario, read_scenarios, scenario_text, write_scenario
from interplan_sumo.scenario.recorded_parts import ReplayedTrack
from interplan_sumo.scenario.scenario import Jaywalker, LanePosition, PlacedVehicle, Scenario, TrafficDemand
from tests.yardstick import at_most

PLACE = LanePosition("11", 20.0)
BARE = Scenario("tiny.recorded/0", "recorded", "tiny_road", PLACE, 5.0, LanePosition("31", 20.0), ("1", "2", "3"))


def replayed(steps: int = 3, id: str = "a", **changes: object) -> ReplayedTrack:
    values = tuple(0.125 * k for k in range(steps))
    whole = ReplayedTrack(id, "vehicle", 4.6, 1.85, 0, values, values, values, values, values)
    return replace(whole, **changes)  # type: ignore[arg-type]


def test_replays_are_part_of_the_hash_and_the_place_of_the_maps_is_not(tmp_path: Path) -> None:
    one = replace(BARE, replayed=(replayed(),))
    assert one.hash() != BARE.hash()
    assert one.hash() != replace(BARE, replayed=(replayed(x_m=(0.0, 0.125, 0.251)),)).hash()
    elsewhere = replace(one, maps_beside=tmp_path)
    assert (elsewhere, elsewhere.hash(), scenario_text(elsewhere)) == (one, one.hash(), scenario_text(one))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"kind": "tram"}, "replayed track 'a': kind is 'tram', expected one of vehicle"),
        ({"length_m": 0.0}, "length_m is 0.0, expected positive metres"),
        ({"first_step": -1}, "first_step is -1, expected 0 or more"),
        ({"x_m": ()}, "x_m is empty"),
        ({"vy_mps": (0.0, 0.0)}, "vy_mps has 2 numbers, expected 3"),
        ({"heading_rad": (0.0, 0.0, float("nan"))}, "heading_rad holds a number that is not finite"),
    ],
)
def test_a_track_that_cannot_be_names_its_column(changes: dict[str, object], said: str) -> None:
    with pytest.raises(ScenarioError, match="replayed track 'a'") as error:
        replayed(**changes)  # type: ignore[arg-type]
    assert said in str(error.value)


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("traffic.density", {"traffic": TrafficDemand(density="low")}),
        ("traffic.oncoming", {"traffic": TrafficDemand(oncoming="low")}),
        ("vehicles", {"vehicles": (PlacedVehicle(PLACE, 3.0),)}),
        ("jaywalkers", {"jaywalkers": (Jaywalker(PLACE, PLACE, 1.0),)}),
    ],
)
def test_replays_and_other_traffic_do_not_mix(name: str, changes: dict[str, object]) -> None:
    assert replace(BARE, **changes).replayed == ()  # type: ignore[arg-type]
    with pytest.raises(ScenarioError, match=f"replayed and {name} are both given"):
        replace(BARE, replayed=(replayed(),), **changes)  # type: ignore[arg-type]


def test_a_track_may_not_be_there_twice() -> None:
    with pytest.raises(ScenarioError, match="replayed holds track 'a' twice"):
        replace(BARE, replayed=(replayed(), replayed()))


def test_sixty_tracks_of_eleven_seconds_are_read_in_a_moment(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    column = [tuple(np.round(rng.uniform(-5e3, 5e3, 110), 3).tolist()) for _ in range(5)]
    tracks = tuple(ReplayedTrack(str(i), "vehicle", 4.6, 1.85, 0, *column) for i in range(60))
    write_scenario(replace(BARE, replayed=tracks), tmp_path / "scene.yaml")
    with at_most(167):
        read_scenario(tmp_path / "scene.yaml")


@pytest.mark.parametrize(("levels", "said"), [(90, "expected"), (110, "lists inside lists without end")])
def test_nesting_is_followed_only_so_deep(tmp_path: Path, levels: int, said: str) -> None:
    path = tmp_path / "deep.yaml"
    path.write_text("[" * levels + "]" * levels)
    with pytest.raises(ScenarioError, match=said):
        read_scenarios(path)


@pytest.mark.slow
def test_nesting_without_end_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "deep.yaml").write_text("[" * 200_000)
    with pytest.raises(ScenarioError, match=r"deep\.yaml: this is no scenario: lists inside lists without end$"):
        read_scenarios(tmp_path / "deep.yaml")


def test_scenarios_know_of_the_maps_beside_their_file(tmp_path: Path) -> None:
    write_scenario(BARE, tmp_path / "scene.yaml")
    assert read_scenario(tmp_path / "scene.yaml").maps_beside is None
    (tmp_path / "maps").mkdir()
    assert read_scenario(tmp_path / "scene.yaml").maps_beside == tmp_path.resolve() / "maps"
    (tmp_path / "scene.yaml").write_text(scenario_text(BARE) + "maps_beside: /\n")
    with pytest.raises(ScenarioError, match="there is no field maps_beside"):
        read_scenario(tmp_path / "scene.yaml")
