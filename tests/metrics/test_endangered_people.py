"""Endangered people: nobody on foot or on a bicycle is missed by half a second at speed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from interplan_sumo.metrics.endangered_people import CLOSE_S, SLOW_MPS, endangered_people
from interplan_sumo.metrics.score import score_facts
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import Pose
from tests.metrics.staging import drive_at, facts_of, scenario_on
from tests.worlds import cars, drive, pedestrians, straight_road

ROAD = straight_road(lanes=2, length_m=400.0)
EGO_M = 50.0
FRONT_M = EGO_M + PACIFICA.length_m / 2
HALF_M = 0.35
"""Of a pedestrian."""


def score_past(actors: Actors, speed_mps: float = 10.0) -> float:
    """What an ego gets that has somebody around it for one frame."""
    score = endangered_people(facts_of(drive_at(EGO_M, 0.0, speed_mps, actors=actors), ROAD)).score
    assert score is not None
    return score


@pytest.mark.parametrize(("over_m", "score"), [(0.0, 0.0), (0.001, 1.0)])
def test_half_a_second_is_too_little_and_any_more_is_not(over_m: float, score: float):
    ahead_m = FRONT_M + HALF_M + CLOSE_S * 10.0 + over_m
    assert score_past(pedestrians((ahead_m, 0.0))) == score


@pytest.mark.parametrize(("speed_mps", "score"), [(SLOW_MPS, 1.0), (SLOW_MPS + 0.01, 0.0)])
def test_who_is_slow_endangers_nobody(speed_mps: float, score: float):
    assert score_past(pedestrians((FRONT_M + HALF_M + 1.0, 0.0)), speed_mps) == score


def test_people_who_step_into_the_way_count_and_those_who_are_never_on_it_do_not():
    beside_m = PACIFICA.width_m / 2 + HALF_M + 0.4
    assert score_past(pedestrians((FRONT_M + 1.0, beside_m, 1.4, -np.pi / 2))) == 0.0
    assert score_past(pedestrians((FRONT_M + 1.0, beside_m))) == 1.0
    assert score_past(pedestrians((FRONT_M + 1.0, beside_m, 1.4, np.pi / 2))) == 1.0
    assert score_past(pedestrians((EGO_M - PACIFICA.length_m / 2 - HALF_M - 0.1, 0.0, 1.4, 0.0))) == 1.0


@pytest.mark.parametrize(
    ("kind", "score"),
    [
        (ActorKind.PEDESTRIAN, 0.0),
        (ActorKind.BICYCLE, 0.0),
        (ActorKind.VEHICLE, 1.0),
        (ActorKind.TRAFFIC_CONE, 1.0),
    ],
)
def test_only_people_without_a_body_around_them_count(kind: ActorKind, score: float):
    assert score_past(cars((FRONT_M + 3.0, 0.0), kind=kind, length_m=1.8, width_m=0.65)) == score


def test_the_reason_names_who_it_was_and_when_the_time_was_shortest():
    ahead = pedestrians((FRONT_M + 4.0 + HALF_M, 0.0))
    trace = drive_at([EGO_M, EGO_M + 2.0, EGO_M + 3.0], speed_mps=[20.0, 20.0, SLOW_MPS], actors=ahead)
    facts = facts_of(trace, ROAD)
    result = endangered_people(facts)
    assert result.reason == "pedestrian ped00 was 0.1 s from being hit at 0.1 s; the ego was at 20.0 m/s"
    assert endangered_people.lost_at(facts, result) == 1


def test_under_the_strict_profile_it_is_unsafe_and_scores_nothing_though_nobody_was_hit():
    there, gone = pedestrians((FRONT_M + 3.0, 0.0)), pedestrians()
    start = Pose(EGO_M, 0.0, 0.0)
    expert = drive(*[10.0] * 202, start=start).ego
    scene = scenario_on(ROAD, ("11", EGO_M), ("11", EGO_M + 200.0))

    def sheet(first: Actors):
        trace = drive(*[10.0] * 202, start=start, actors=[first, *[gone] * 201])
        return score_facts(facts_of(trace, ROAD, expert, scene))

    raced = sheet(there)
    assert (raced.score, raced.done, raced.unsafe) == (0.0, True, True)
    assert raced.metrics["no_collision"].score == 1.0
    assert (sheet(gone).score, sheet(gone).unsafe) == (1.0, False)


@given(
    place=st.tuples(st.floats(-10.0, 20.0), st.floats(-3.0, 3.0)),
    heading_rad=st.floats(-np.pi, np.pi),
    speeds_mps=st.tuples(st.floats(0.0, 20.0), st.floats(0.0, 20.0)),
)
def test_before_people_who_stand_a_slower_ego_is_never_worse(
    place: tuple[float, float], heading_rad: float, speeds_mps: tuple[float, float]
):
    standing = pedestrians((EGO_M + place[0], place[1], 0.0, heading_rad))
    slow, fast = (score_past(standing, speed_mps) for speed_mps in sorted(speeds_mps))
    assert slow >= fast
