"""How the foresight planner keeps its place on a way that crosses itself."""

from __future__ import annotations

import pytest
from worlds import ego, ego_on, mission

from interplan_planners.foresight.candidate_paths import RUN_IN_M
from interplan_planners.foresight.manoeuvres import Manoeuvres
from interplan_sumo.world.ego import PACIFICA
from tests.planners.staging_planners import LOOP, LOOP_LANES, foresee

ROUND = mission(LOOP, LOOP_LANES, goal_arc_m=100.0)


@pytest.mark.parametrize("off_m", [-0.2, 0.2])
def test_where_its_way_crosses_itself_it_knows_on_which_pass_it_is(off_m: float) -> None:
    """It stands with its rear axle on the line beyond the goal, and beside its own."""
    at = ego(95.0 + PACIFICA.rear_axle_to_center_m, off_m)
    states = foresee(mission(LOOP, LOOP_LANES[:7], goal_arc_m=40.0), at, seconds=5.0)
    assert states[-1].x_m > at.x_m + 5.0
    assert abs(states[-1].y_m) < 3.0


@pytest.mark.slow
def test_it_goes_all_the_way_round_and_across() -> None:
    states = foresee(ROUND, ego_on(LOOP, "11", 10.0, 8.0), seconds=45.0)
    assert states[-1].y_m < -40.0
    assert states[-1].x_m == pytest.approx(95.0, abs=0.5)


@pytest.mark.parametrize(("arc_m", "first", "whole"), [(95.0, "11", False), (150.0, "31", False), (185.0, "51", True)])
def test_a_base_ends_where_its_way_comes_back_to_itself_and_goes_on_once_that_is_behind(
    arc_m: float, first: str, whole: bool
) -> None:
    manoeuvres = Manoeuvres(ROUND, ego_on(LOOP, "11", 10.0, 8.0), 13.0, 3.6)
    base = manoeuvres.base(0, "11")
    assert not base.whole
    assert base.line.length_m == pytest.approx(RUN_IN_M + 263.0 - 8.0, abs=3.0)
    onward = manoeuvres.onward(base, RUN_IN_M + arc_m)
    assert (onward.way.lanes[0], onward.whole) == (first, whole)
