"""Whom the foresight planner would make brake where it comes into their lane: who comes towards it, or is beside it."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from worlds import cars, ego, ego_on, junction, mission, observation, straight_road, together

from interplan_planners.common.neighbours import moved
from interplan_planners.foresight.costs import FORCED, speed_costs
from interplan_planners.foresight.manoeuvres import Manoeuvres
from interplan_planners.foresight.prediction import STEP_S, Prediction
from interplan_planners.foresight.scene import PlanningScene
from interplan_planners.foresight.speeds import NO_CAP, Drafts
from interplan_planners.foresight.st_obstacles import occupied_base, staged
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import PACIFICA
from tests.planners.staging_planners import foresee
from tests.quick import few

WIDTH_M = 3.5
TWO_WAY = junction(arm_m=300.0, limit_mps=10.0)
"""Along lane "1" x grows from -312 m, lane "5" is beside it, and the middle of the road at y = 0."""
PARKED_M = 90.0 - 312.0


@pytest.mark.slow
@pytest.mark.parametrize("met_m", few([0.0, -10.0, 10.0], 1))
def test_its_side_does_not_reach_over_the_middle_of_the_road_while_somebody_comes(met_m: float) -> None:
    """There is room for both beside what stands, but for less than drivers take it for."""
    parked, start = cars((PARKED_M, -WIDTH_M / 2 - 0.9)), ego_on(TWO_WAY, "1", 45.0, 9.0)
    comes = cars((PARKED_M + met_m + 6.0 * 8.0, WIDTH_M / 2, 8.0, pi), prefix="comes")
    states = foresee(mission(TWO_WAY, ("1",), goal_arc_m=250.0), start, together(parked, comes), seconds=20.0)
    left_m = np.array([state.y_m + 0.5 * PACIFICA.width_m * np.cos(state.heading_rad) for state in states])
    ahead_m = np.array([comes.x_m[0] - 8.0 * state.time_s - state.x_m for state in states])
    assert left_m.max() > 0.3
    assert left_m[(ahead_m > 0.0) & (ahead_m < 15.0)].max() < 0.15
    assert states[-1].x_m > PARKED_M + 20.0


TWO = straight_road(lanes=2, length_m=400.0, limit_mps=16.0)
EGO_MPS = 2.0


def cost_of_entering(front_m: float, their_mps: float) -> float:
    """More than on a free road: of a change to the left at 2 m/s, with somebody there when the ego's side comes over.

    Their front is so far before the ego's rear then.
    """
    start, no = ego(60.0, -WIDTH_M, EGO_MPS), np.zeros(1, np.bool_)
    task = mission(TWO, ("11",), goal_arc_m=300.0)
    manoeuvres = Manoeuvres(task, start, 13.0, 3.6)

    def cost(others: Actors) -> tuple[float, float]:
        seen = observation(start, others)
        traffic = Prediction(TWO).traffic(seen, PACIFICA, 8.0)
        scene = PlanningScene(seen, PACIFICA, traffic, *(no[: len(others)],) * 3)
        options, _ = manoeuvres.options(scene, manoeuvres.here(start))
        (way,) = (option.candidate for option in options if option.candidate.kind == "change")
        assert way.new is not None
        arc_m, _ = way.path.line.project_point(scene.axle.x_m, scene.axle.y_m)
        new_m, _ = way.new.line.project_point(scene.axle.x_m, scene.axle.y_m)
        beside = moved(occupied_base(way.new, traffic, PACIFICA, (new_m - 60.0, new_m + 90.0)), arc_m - new_m)
        stage = staged(way, arc_m, way.limit_mps, (), scene, no[: len(others)], 90.0, beside)
        s = (arc_m + EGO_MPS * STEP_S * np.arange(41.0))[None]
        drafts = Drafts(no.astype(np.int64), ((),), (NO_CAP,), no, s, np.full_like(s, EGO_MPS), np.zeros((1, 40)))
        return float(speed_costs([stage], drafts, PACIFICA, 16.0, 0.0)[0]), (stage.enters_m[1] - arc_m) / EGO_MPS

    free, over_s = cost(Actors.none())
    rear_m = 60.0 + EGO_MPS * over_s - 0.5 * PACIFICA.length_m
    return cost(cars((rear_m + front_m - 2.4 - their_mps * over_s, 0.0, their_mps)))[0] - free


@pytest.mark.parametrize(("front_m", "brakes"), [(-48.0, False), (4.5, True), (9.0, False)])
def test_whoever_has_its_front_beside_the_ego_when_that_comes_over_has_to_brake(front_m: float, brakes: bool) -> None:
    assert (cost_of_entering(front_m, 12.0) >= FORCED) == brakes
