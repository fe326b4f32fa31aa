"""People in the streets: they stand, cross when their moment has come, and are forgotten far from the ego."""

from __future__ import annotations

import numpy as np
import pytest

from interplan_sumo.endurance.street_people import FORGOTTEN_M, StreetPeople, Walker
from interplan_sumo.scenario.jaywalking import PedestrianWalk
from interplan_sumo.world.ego import PACIFICA, EgoState

ACROSS = PedestrianWalk(np.array([[0.0, -5.0], [0.0, 5.0]]), np.array([0.0]), np.array([10.0]), (0.9, 0.79), 0.0)


def people_with(walker: Walker, ego_x_m: float = 0.0) -> StreetPeople:
    people = StreetPeople(0.1)
    people.notice(EgoState(0.0, ego_x_m, 0.0, 0.0), PACIFICA)
    people.come(walker)
    assert people.advance()
    return people


def test_one_who_waits_stands_and_one_who_has_set_off_walks_to_the_other_side() -> None:
    walker = Walker("a", ACROSS)
    people = people_with(walker)
    assert people.observe().y_m.tolist() == [-5.0]
    assert len(people.standing((0.0, 0.0))) == 1
    assert not people.foreseen((0.0, 0.0))
    walker.walked_s = 0.0
    for _ in range(50):
        assert not people.advance()
    assert people.observe().y_m == pytest.approx([0.0])
    assert people.observe().vy_mps == pytest.approx([1.0])
    assert len(people.foreseen((0.0, 0.0))) == 1
    assert not people.standing((0.0, 0.0))
    for _ in range(60):
        people.advance()
    assert people.observe().y_m.tolist() == [5.0]


@pytest.mark.parametrize(("away_m", "stays"), [(FORGOTTEN_M - 2.0, True), (FORGOTTEN_M + 2.0, False)])
def test_who_is_expected_no_more_is_gone_once_it_is_out_of_sight(away_m: float, stays: bool) -> None:
    walker = Walker("a", ACROSS)
    people = people_with(walker, ego_x_m=away_m)
    assert not people.advance()  # it waits for the ego, however far that is
    walker.expected = False
    assert people.advance() is not stays
    assert len(people.there) == stays
