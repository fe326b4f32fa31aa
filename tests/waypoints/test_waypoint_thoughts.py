"""Thoughts by rules: what is notable, what was done, and that it fits into a few words."""

from __future__ import annotations

import numpy as np
import pytest
from worlds import cars, ego, observation, pedestrians, together

from interplan_llm.waypoints.form import POINTS, answer_text
from interplan_llm.waypoints.thoughts import notable, thoughts
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import Floats

HALF_LENGTH_M, HALF_WIDTH_M = PACIFICA.length_m / 2, PACIFICA.width_m / 2


def future(*speeds_mps: float, aside_m: float = 0.0) -> Floats:
    """(16, 2) places straight ahead at these speeds, the last of them kept; `aside_m` is reached in the middle."""
    speeds = [*speeds_mps, *[speeds_mps[-1]] * POINTS][:POINTS]
    x_m = 0.5 * np.cumsum(speeds)
    return np.stack((x_m, aside_m * np.clip(np.arange(POINTS) / 8, 0.0, 1.0)), axis=1)


def found(actors: Actors, speed_mps: float = 10.0) -> list[int]:
    return notable(observation(ego(0.0, 0.0, speed_mps), actors), future(speed_mps)).tolist()


def said(places: Floats, speed_mps: float = 10.0, actors: Actors | None = None) -> str:
    return thoughts(observation(ego(0.0, 0.0, speed_mps), actors), places)


@pytest.mark.parametrize(("gap_m", "near"), [(2.9, True), (3.1, False)])
def test_a_car_is_notable_whose_forecast_comes_within_three_metres_ahead(gap_m: float, near: bool) -> None:
    ahead = cars((HALF_LENGTH_M + 2.4 + gap_m, 0.0, 10.0))
    assert found(ahead) == ([0] if near else [])


@pytest.mark.parametrize(("gap_m", "near"), [(0.9, True), (1.1, False)])
def test_a_thing_is_notable_that_is_passed_within_a_metre(gap_m: float, near: bool) -> None:
    cone = cars((40.0, HALF_WIDTH_M + 0.2 + gap_m), kind=ActorKind.TRAFFIC_CONE, length_m=0.4, width_m=0.4)
    assert found(cone) == ([0] if near else [])


@pytest.mark.parametrize(
    ("actors", "notable_rows"),
    [
        (cars((40.0, 0.0, 5.0)), [0]),  # is caught up with
        (cars((40.0, 0.0, 10.0)), []),
        (cars((45.0, 0.0), (25.0, 0.0)), [1, 0]),  # what comes near first comes first
        (cars((55.0, 0.0)), []),  # is not told of
        (cars((30.0, 5.0, 0.0, np.pi / 2), length_m=12.0, width_m=2.5), [0]),  # boxes count as they are turned
        (cars((30.0, 5.0, 0.0, 0.0), length_m=12.0, width_m=2.5), []),
    ],
)
def test_what_is_notable(actors: Actors, notable_rows: list[int]) -> None:
    assert found(actors) == notable_rows


def test_frames_of_the_map_do_not_matter() -> None:
    here = observation(ego(0.0, 0.0, 10.0), cars((40.0, 0.0, 5.0)))
    there = observation(ego(100.0, 50.0, 10.0, heading_rad=np.pi / 2), cars((100.0, 90.0, 5.0, np.pi / 2)))
    assert thoughts(here, future(10.0)) == thoughts(there, future(10.0))


def test_objects_are_named_with_where_they_are_now() -> None:
    crossing = pedestrians((20.0, -6.0, 2.0, np.pi / 2))
    assert said(future(8.0), 8.0, crossing) == "Mind pedestrian right. Keep speed, forward."
    assert said(future(10.0), 10.0, cars((25.0, 0.0))) == "Mind vehicle ahead. Keep speed, forward."
    assert said(future(5.0), 5.0, cars((-10.0, 0.0, 9.0))) == "Mind vehicle behind. Keep speed, forward."
    assert said(future(10.0)) == "Nothing comes near. Keep speed, forward."


@pytest.mark.parametrize(
    ("now_mps", "then_mps", "action"),
    [
        (0.4, 0.4, "Stand."),
        (0.6, 0.4, "Stop, forward."),
        (10.0, 10.4, "Keep speed, forward."),
        (10.0, 10.6, "Accelerate, forward."),
        (10.0, 19.9, "Accelerate, forward."),
        (10.0, 20.1, "Accelerate quickly, forward."),
        (10.0, 9.6, "Keep speed, forward."),
        (10.0, 9.4, "Decelerate, forward."),
        (10.0, 5.1, "Decelerate, forward."),
        (10.0, 4.9, "Decelerate quickly, forward."),
    ],
)
def test_speed_now_and_then_make_the_first_half_of_an_action(now_mps: float, then_mps: float, action: str) -> None:
    assert said(future(then_mps), now_mps) == f"Nothing comes near. {action}"


@pytest.mark.parametrize(
    ("aside_m", "way"),
    [
        (1.9, "forward"),
        (2.1, "change lane left"),
        (-2.1, "change lane right"),
        (3.9, "change lane left"),
        (4.1, "turn left"),
        (-4.1, "turn right"),
    ],
)
def test_how_far_aside_it_leads_makes_the_second(aside_m: float, way: str) -> None:
    assert said(future(10.0, aside_m=aside_m)) == f"Nothing comes near. Keep speed, {way}."


def test_who_ends_up_turned_turns_however_little_to_the_side() -> None:
    places = future(4.0)
    places[-2:] = places[-3] + [[1.4, 1.4], [2.8, 2.8]]
    assert said(places, 4.0).endswith("turn left.")


def test_the_longest_thoughts_fit_into_an_answer() -> None:
    kinds = (ActorKind.BICYCLE, ActorKind.PEDESTRIAN, ActorKind.BARRIER, ActorKind.CZONE_SIGN)
    walls = [
        cars((8.0 + k, y), kind=kind, length_m=0.5, width_m=0.5, prefix=kind.name)
        for k, (kind, y) in enumerate(zip(kinds, (0.0, 2.1, -2.1, 0.0), strict=True))
    ]
    places = future(20.0, 6.0, aside_m=-3.0)
    text = thoughts(observation(ego(0.0, 0.0, 13.0), together(*walls)), places)
    assert text.count(",") == 3
    assert text.endswith("Decelerate quickly, change lane right.")
    assert answer_text(text, places)
