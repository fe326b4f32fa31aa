"""What shipped drivers do in the standard situations, and that a measure tells gentle drivers from rude ones."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest

from interplan_sumo.simulation.standard_situations import LANE_Y, SITUATIONS, Answer, answer
from interplan_sumo.simulation.vehicle_types import read_vehicle_types, vehicle_type_file

BY_NAME = {situation.name: situation for situation in SITUATIONS}


def answered(name: str, behaviour: str = "conservative") -> Answer:
    types = read_vehicle_types(vehicle_type_file(behaviour))
    return answer(BY_NAME[name], types, types.members[0])


def test_there_are_six_situations() -> None:
    assert list(BY_NAME) == ["following", "standstill", "cut_in", "merge", "oncoming", "junction"]


@pytest.mark.parametrize("name", list(BY_NAME))
def test_a_conservative_driver_answers_in_time_without_touching_the_ego(name: str) -> None:
    found = answered(name)
    assert found.reaction_s is not None
    assert found.reaction_s < 2.0
    assert 0.5 < found.hardest_mps2 < 5.0
    assert 0.5 < found.least_gap_m < inf
    assert found.recovery_s is not None


def test_an_assertive_driver_answers_a_merge_later_and_harder_than_a_conservative_one() -> None:
    gentle, rude = answered("merge"), answered("merge", "assertive")
    assert gentle.reaction_s is not None
    assert rude.reaction_s is not None
    assert rude.reaction_s > gentle.reaction_s + 1.0
    assert rude.hardest_mps2 > gentle.hardest_mps2 + 1.0
    assert rude.least_gap_m < gentle.least_gap_m


def test_behind_one_who_stops_a_driver_stands_at_its_own_gap() -> None:
    found = answered("standstill")
    assert found.gap_m[-1] == pytest.approx(1.0, abs=0.1)
    assert found.speed_mps[-1] < 0.1


def test_a_gap_is_measured_only_to_what_is_in_the_drivers_way() -> None:
    found = answered("cut_in")
    begins = round(10 * BY_NAME["cut_in"].at_s)
    in_the_way = np.flatnonzero(~np.isnan(found.gap_m))
    assert begins + 3 < in_the_way[0] < begins + 15
    assert 10.0 < found.gap_m[in_the_way[0]] < 15.5
    assert found.ego_mps[5] == pytest.approx(8.0)


def test_the_ego_ends_in_the_middle_of_the_lane_that_it_slides_into() -> None:
    for name, lane in (("cut_in", "in_1"), ("merge", "in_1"), ("oncoming", "in_2")):
        assert BY_NAME[name].ego(20.0)[1] == pytest.approx(LANE_Y[lane])
