"""Whom the foresight planner cannot see: hidden behind others on the lane beside, and who comes while it pulls out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from worlds import cars, ego_on, junction, mission, observation, straight_road, together

from interplan_planners.foresight import ForesightPlanner
from interplan_planners.foresight.manoeuvres import Manoeuvres
from interplan_planners.foresight.prediction import STEP_S, Prediction
from interplan_planners.foresight.scene import PlanningScene
from interplan_planners.foresight.unseen import (
    CAR_LENGTH_M,
    CAR_WIDTH_M,
    CLEAR_M,
    HiddenPlaces,
    behind_others,
    comes_next,
    fronts_then,
    hidden_places,
)
from interplan_sumo.simulation.occlusion import hidden
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.geometry import Floats
from tests.planners.staging_planners import foresee
from tests.worlds import unmoved

WIDTH_M = 3.5
TWO = straight_road(lanes=2, length_m=500.0, limit_mps=12.0)
TO_THE_LEFT = mission(TWO, ("11",), goal_arc_m=400.0)
HALF_M, HALF_WIDTH_M = PACIFICA.length_m / 2, PACIFICA.width_m / 2


def places(start: EgoState, actors: Actors) -> Floats:
    """Fronts of cars that may be hidden on the left lane, by x."""
    seen, no = observation(start, actors), np.zeros(len(actors), np.bool_)
    scene = PlanningScene(seen, PACIFICA, Prediction(TWO).traffic(seen, PACIFICA, 8.0), no, no, no)
    base = Manoeuvres(TO_THE_LEFT, start, 13.0, 3.6).base(0, "11")
    axle_m, _ = base.line.project_point(scene.axle.x_m, scene.axle.y_m)
    found = hidden_places(scene, base, axle_m)
    assert found.speed_mps == pytest.approx(0.9 * 12.0)
    return found.front_m + scene.axle.x_m - axle_m


# --- where somebody may be hidden ------------------------------------------------------------------


def test_on_an_empty_road_nobody_is_hidden_and_behind_a_long_vehicle_in_ones_own_lane_the_lane_beside_is() -> None:
    start = ego_on(TWO, "12", 200.0, 3.0)
    assert not len(places(start, Actors.none()))
    lorry = cars((200.0 - 12.0, -WIDTH_M, 3.0), length_m=9.0)
    found = places(start, lorry)
    # its nearest corner is 7.5 m behind the ego's centre and 1 m to the side, the lane's far side 4.4 m
    assert len(found) > 8
    assert found.max() < 200.0 - 7.5 * 4.4
    assert found.min() > 200.0 - 100.0


def test_nobody_is_hidden_where_somebody_is_seen() -> None:
    start = ego_on(TWO, "12", 200.0, 3.0)
    lorry = cars((200.0 - 12.0, -WIDTH_M, 3.0), length_m=9.0)
    alone = places(start, lorry)
    seen_m = float(alone[3]) - CAR_LENGTH_M / 2
    left = places(start, together(lorry, cars((seen_m, 0.0, 8.0), prefix="seen")))
    assert len(left) < len(alone)
    assert (np.abs(left - CAR_LENGTH_M / 2 - seen_m) > (4.8 + CAR_LENGTH_M) / 2 + CLEAR_M - 1e-9).all()


@pytest.mark.slow
@settings(max_examples=60)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 12))
def test_whoever_is_taken_to_be_hidden_the_benchmark_hides(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    others = together(
        *(
            cars(
                (rng.uniform(-60.0, 60.0), rng.uniform(-9.0, 9.0), 5.0, rng.normal(0.0, 0.4)),
                length_m=rng.uniform(3.5, 12.0),
                prefix=f"other{i}",
            )
            for i in range(count)
        )
    )
    spots = rng.uniform(-80.0, 80.0, (40, 2))
    for x_m, y_m in spots.tolist():
        car = cars((x_m, y_m, 5.0), length_m=CAR_LENGTH_M, prefix="spot")
        car = replace(car, width_m=np.full(1, CAR_WIDTH_M))
        xs, ys = (
            np.append(car.corners[..., 0], x_m)[None],
            np.append(car.corners[..., 1], y_m)[None],
        )
        if behind_others(others, xs, ys, (0.0, 0.0)).all():
            everyone = together(others, car)
            row = np.array([everyone.ids.index(car.ids[0])])
            tall = np.flatnonzero(np.arange(len(everyone)) != row[0])
            assert hidden(everyone, row, tall, (0.0, 0.0))[0]


# --- where they will be ----------------------------------------------------------------------------

PLACES = HiddenPlaces(np.array([20.0, 60.0]), 10.0)


def then(at: list[int], near_m: float | None = None, mps: float = 5.0) -> tuple[Floats, Floats, Floats]:
    """Of two places, with somebody who is seen from the second on, or nobody."""
    time_s: Floats = STEP_S * np.arange(41, dtype=np.float64)
    rows: Floats = np.zeros((0, 41)) if near_m is None else (near_m + mps * time_s)[None]
    return fronts_then(PLACES, np.array(at), rows, rows + 2.4, np.full(rows.shape, mps))


def test_who_is_hidden_drives_on_and_stays_behind_who_is_seen() -> None:
    front_m, speed_mps, before_m = then([0, 10])
    assert front_m.tolist() == [[20.0, 60.0], [40.0, 80.0]]
    assert (speed_mps == 10.0).all()
    assert np.isinf(before_m).all()
    front_m, speed_mps, before_m = then([0, 20], near_m=40.0)  # ahead of the first place only
    assert front_m.tolist() == [[20.0, 60.0], [60.0 - CLEAR_M, 100.0]]
    assert speed_mps.tolist() == [[10.0, 10.0], [5.0, 10.0]]
    assert before_m[:, 0].tolist() == [42.4, 62.4]
    assert np.isinf(before_m[:, 1]).all()


def test_who_has_somebody_between_itself_and_the_ego_does_not_come_next() -> None:
    rear_m = np.array([50.0, 50.0])
    middle_m = 50.0 + HALF_M
    front_m = np.array([[40.0, middle_m - 0.1, middle_m + 0.1], [40.0, 40.0, 40.0]])
    before_m = np.array([[np.inf] * 3, [middle_m - 0.1, middle_m + 0.1, np.inf]])
    found: NDArray[np.bool_] = comes_next(front_m, before_m, rear_m, PACIFICA)
    assert found.tolist() == [[True, True, False], [False, True, True]]


# --- what it does about them -----------------------------------------------------------------------


def change_cost(waited_s: float, *, hides: bool) -> float:
    """Of a change to the left while it creeps, with a lorry behind the ego that hides the lane beside, or far away."""
    planner = ForesightPlanner()
    planner.start(TO_THE_LEFT)
    lorry = cars((200.0 - (12.0 if hides else 90.0), -WIDTH_M, 0.7), length_m=9.0)
    for k in range(round(waited_s / 0.2) + 1):
        planner.plan(unmoved(ego_on(TWO, "12", 200.0, 0.7, 0.2 * k), lorry))
    assert planner.decision is not None
    return min(cost for name, cost in planner.decision.options if name.startswith("change"))


@pytest.mark.slow
def test_to_go_over_before_who_may_be_hidden_costs_less_the_longer_the_ego_has_waited() -> None:
    at_once, later = (change_cost(waited_s, hides=True) for waited_s in (1.0, 6.0))
    assert at_once > change_cost(1.0, hides=False) + 2.0
    assert later == pytest.approx(change_cost(6.0, hides=False), abs=0.01)


@pytest.mark.slow
def test_where_a_lorry_hides_the_lane_beside_it_waits_for_four_seconds_before_it_reaches_over() -> None:
    def reaches_s(lorry_behind_m: float) -> float:
        lorry = cars((200.0 - lorry_behind_m, -WIDTH_M, 0.6), length_m=9.0)
        states = foresee(TO_THE_LEFT, ego_on(TWO, "12", 200.0, 0.7), lorry, seconds=9.0)
        return next(s.time_s for s in states if s.y_m + HALF_WIDTH_M > -WIDTH_M / 2)

    assert reaches_s(90.0) < 4.0 < reaches_s(12.0)


# --- on its own half -------------------------------------------------------------------------------

TWO_WAY = mission(junction(arm_m=300.0, limit_mps=10.0), ("1",), goal_arc_m=250.0)
MIDDLE_M = -WIDTH_M / 2


@pytest.mark.slow
def test_where_only_its_side_would_be_in_the_oncoming_lane_it_waits_on_its_own_half() -> None:
    """A car is parked at the road's edge, which the ego could pass with its centre on its own side; others come."""
    parked = cars((90.0 - 312.0, MIDDLE_M - 1.3))
    row = cars(*((x, WIDTH_M / 2 - 0.4, 8.0, np.pi) for x in np.arange(-240.0, 0.0, 25.0).tolist()), prefix="oncoming")
    states = foresee(TWO_WAY, ego_on(TWO_WAY.roads, "1", 40.0, 8.0), together(parked, row), seconds=10.0)
    assert max(s.y_m + HALF_WIDTH_M + HALF_M * np.sin(s.heading_rad) for s in states) < -0.3
