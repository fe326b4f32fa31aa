"""What ends a trip, and what of the state of the traffic is an opportunity."""

from __future__ import annotations

from math import inf, pi

import numpy as np
import pytest

from interplan_sumo.endurance.events import rare_at
from interplan_sumo.endurance.staged import LEFT_BEHIND_M, Breakdown, StagedSpan, with_released
from interplan_sumo.endurance.trip import Stretches, someone_before, touches
from interplan_sumo.simulation.agent_registry import AgentSnapshot
from interplan_sumo.tiny_worlds import cars
from interplan_sumo.world.ego import PACIFICA, EgoState

EGO = EgoState(0.0, 0.0, 0.0, 0.0, 5.0)
HALF_M = PACIFICA.length_m / 2.0


@pytest.mark.parametrize(
    ("x_m", "y_m", "heading_rad", "touched"),
    [(HALF_M + 2.3, 0.0, 0.0, True), (HALF_M + 2.5, 0.0, 0.0, False), (0.0, 3.0, 0.0, False), (3.0, 2.0, pi / 2, True)],
)
def test_a_contact_is_an_overlap_of_boxes(x_m: float, y_m: float, heading_rad: float, touched: bool) -> None:
    assert touches(EGO, PACIFICA, cars((x_m, y_m, heading_rad, 0.0))) is touched


@pytest.mark.parametrize(
    ("x_m", "y_m", "before"),
    [(HALF_M + 2.3 + 11.0, 0.0, True), (HALF_M + 2.3 + 13.0, 0.0, False), (10.0, 3.0, False), (-10.0, 0.0, False)],
)
def test_who_stands_close_ahead_in_the_ego_s_way_is_waited_for(x_m: float, y_m: float, before: bool) -> None:
    assert someone_before(EGO, PACIFICA, cars((x_m, y_m, 0.0, 0.0))) is before


def test_stretches_are_weighed_as_the_segment_was_there() -> None:
    driven = Stretches()
    driven.add(10.0, 1.0, 1.0)
    driven.add(20.0, 1.0, 0.5)
    assert (driven.metres, driven.seconds) == (30.0, 2.0)
    assert (driven.weighted_metres, driven.weighted_seconds) == (20.0, 1.5)


@pytest.mark.parametrize(
    ("time_s", "kind"), [(9.9, None), (10.0, "jaywalker"), (24.9, "jaywalker"), (25.1, None), (40.0, "cut_in")]
)
def test_what_happens_is_of_the_rare_event_that_was_under_way(time_s: float, kind: str | None) -> None:
    spans = [StagedSpan("jaywalker", 10.0, 20.0), StagedSpan("cut_in", 30.0)]
    assert rare_at(spans, time_s) == kind


@pytest.mark.parametrize(("ahead_m", "over"), [(LEFT_BEHIND_M - 1.0, False), (LEFT_BEHIND_M + 1.0, True)])
def test_one_that_has_broken_down_stands_until_the_ego_is_well_past_it(ahead_m: float, over: bool) -> None:
    zero = np.zeros(1)
    stands = AgentSnapshot(["a"], {"a": 0}, zero, zero, zero, zero, {}, frozenset(), list, lambda _: [], lambda _: ())
    act = Breakdown("a", (0.0, 0.0))
    assert act.step(stands, EgoState(0.0, ahead_m, 0.0, 0.0, 5.0)) == {"a": 0.0}
    assert act.is_over is over


def test_who_was_told_something_is_released_in_the_step_after() -> None:
    assert with_released({"a": 3.0}, {"a", "b"}) == {"a": 3.0, "b": inf}
    assert with_released({}, frozenset()) == {}
