"""Circumstances: who or what held the ego up, in words."""

from __future__ import annotations

import pytest

from interplan_sumo.metrics.circumstances import CLOSE_M, held_up_by
from interplan_sumo.world.actors import Actors
from tests.metrics.staging import drive_at, facts_of
from tests.worlds import cars, straight_road

ROAD = straight_road(lanes=2, length_m=200.0)
SIDES_M = 2.297 / 2 + 2.0 / 2
"""Half the ego's width and half a car's."""


@pytest.mark.parametrize(
    ("others", "said"),
    [
        (cars((60.0, 0.0)), "behind standing vehicle car00, 5.0 m ahead"),
        (cars((52.0, SIDES_M + 0.4)), "behind standing vehicle car00"),
        (cars((49.0, SIDES_M + 0.4)), "beside standing vehicle car00, 0.4 m away"),
        (cars((49.0, -SIDES_M - CLOSE_M + 0.1)), "beside standing vehicle car00, 0.9 m away"),
        (cars((49.0, -SIDES_M - CLOSE_M - 0.05)), "with nobody within 20 m ahead in its way"),
        (cars((44.0, 0.0)), "with nobody within 20 m ahead in its way"),
        (cars((60.0, 0.0), (49.0, SIDES_M + 0.4)), "behind standing vehicle car00"),
    ],
)
def test_who_is_ahead_is_named_or_else_who_is_close_beside(others: Actors, said: str) -> None:
    assert held_up_by(facts_of(drive_at(50.0, speed_mps=0.0, actors=others), ROAD), 0).startswith(said)
