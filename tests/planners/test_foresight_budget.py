"""Foresight on its fast budget: it plans less often, manages small worlds as well, and answers what is new at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from worlds import cars, ego, ego_on, junction, mission, observation, pedestrians, signals, straight_road, together

from interplan_planners.foresight import ForesightPlanner
from interplan_planners.foresight.foreseen import KEPT_S, NEW_M, Budget
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.signals import Signals
from interplan_sumo.world.trajectory import Trajectory
from tests.planners.staging_planners import driven, moved

WIDTH_M = 3.5
TWO = straight_road(lanes=2, length_m=400.0, limit_mps=12.0)
ROAD = mission(TWO, ("11",))
TWO_WAY = junction(arm_m=300.0, limit_mps=10.0)
START = ego(30.0, 0.0, 11.0)


class Counted:
    """A foresight planner that counts how often it plans anew."""

    def __init__(self, budget: Budget) -> None:
        self._planner = ForesightPlanner(budget=budget)
        self.plans: list[Trajectory] = []

    def start(self, mission: Mission) -> None:
        self._planner.start(mission)

    def plan(self, observation: Observation) -> Trajectory:
        plan = self._planner.plan(observation)
        if not self.plans or plan is not self.plans[-1]:
            self.plans.append(plan)
        return plan


def drive(
    task: Mission,
    start: EgoState,
    actors: Actors | Callable[[float], Actors] | None = None,
    seconds: float = 10.0,
    budget: Budget = "fast",
) -> tuple[list[EgoState], int]:
    """The states, and how many plans were made for them."""
    planner = Counted(budget)
    planner.start(task)
    return driven(planner, start, round(10 * seconds), actors), len(planner.plans)


@pytest.mark.slow
def test_where_nothing_new_comes_up_it_makes_a_fifth_of_the_plans() -> None:
    others = cars((70.0, 0.0, 9.0), (20.0, -WIDTH_M, 12.0))
    normal, fast = (drive(ROAD, START, others, budget=budget) for budget in ("normal", "fast"))
    assert normal[1] == 50
    assert fast[1] <= 12
    assert fast[0][-1].x_m == pytest.approx(normal[0][-1].x_m, abs=3.0)


def test_even_on_a_free_road_a_plan_has_its_end() -> None:
    _, plans = drive(ROAD, START, seconds=10.0)
    assert plans == np.ceil(10.0 / KEPT_S["fast"][0])


@pytest.mark.slow
def test_it_passes_a_parked_car_when_nobody_comes() -> None:
    task = mission(TWO_WAY, ("1",), goal_arc_m=250.0)
    oncoming = cars((170.0 - 312.0, WIDTH_M / 2, 10.0, np.pi), prefix="oncoming")
    others = together(cars((90.0 - 312.0, -WIDTH_M / 2)), oncoming)
    states, _ = drive(task, ego_on(TWO_WAY, "1", 40.0, 9.0), others, seconds=21.0)
    assert states[-1].x_m > 110.0 - 312.0
    assert states[-1].y_m == pytest.approx(-WIDTH_M / 2, abs=0.5)


def test_it_changes_to_the_goal_lane_behind_a_car_beside_it() -> None:
    beside = cars((21.0, -WIDTH_M, 12.0), (36.0, -WIDTH_M, 12.0), (51.0, -WIDTH_M, 12.0))
    states, _ = drive(mission(TWO, ("12",)), ego(20.0, 0.0, 12.0), beside, seconds=18.0)
    assert states[-1].y_m == pytest.approx(-WIDTH_M, abs=0.4)


def test_it_lets_somebody_cross_and_goes_on() -> None:
    def crossing(time_s: float) -> Actors:
        y = min(-6.0 + 1.4 * time_s, 8.0)
        return pedestrians((75.0, y, 1.4 if y < 8.0 else 0.0, np.pi / 2))

    states, _ = drive(ROAD, START, crossing, seconds=14.0)
    assert min(state.vx_mps for state in states) < 9.0
    assert states[-1].x_m > 100.0


def test_it_stops_behind_a_car_that_brakes_all_of_a_sudden() -> None:
    def braking(time_s: float) -> Actors:
        braked_s = min(max(time_s - 2.0, 0.0), 11.0 / 6.0)
        x_m = 60.0 + 11.0 * min(time_s, 2.0) + 11.0 * braked_s - 3.0 * braked_s**2
        return cars((x_m, 0.0, 11.0 - 6.0 * braked_s))

    states, _ = drive(mission(straight_road(lanes=1, length_m=400.0, limit_mps=12.0), ("11",)), START, braking)
    assert states[-1].vx_mps < 0.3


def next_plan(then: Actors, now: Actors, lights: Signals | None = None) -> bool:
    """Whether the next round makes a plan of its own."""
    planner = Counted("fast")
    planner.start(ROAD)
    planner.plan(observation(START, then))
    ahead = ego(32.2, 0.0, 11.0, time_s=0.2)
    planner.plan(observation(ahead, now, lights))
    return len(planner.plans) == 2


AHEAD = cars((60.0, 0.0, 11.0))


def test_who_is_seen_first_after_nobody_was_makes_a_new_plan() -> None:
    assert next_plan(Actors.none(), AHEAD)


@pytest.mark.parametrize(
    ("now", "anew"),
    [
        (moved(AHEAD, 0.2), False),
        (cars((62.2, 0.0, 4.0)), True),
        (cars((62.2, -0.8, 11.0)), False),
        (cars((62.2, -12.0, 11.0)), True),
        (together(moved(AHEAD, 0.2), cars((40.0, -WIDTH_M, 11.0), prefix="new")), True),
        (together(moved(AHEAD, 0.2), cars((45.0, -NEW_M - 5.0, 11.0), prefix="new")), False),
    ],
    ids=["as foreseen", "slower", "a little aside", "far aside", "somebody new", "somebody new far away"],
)
def test_a_plan_is_kept_as_long_as_the_others_are_where_they_were_to_be(now: Actors, anew: bool) -> None:
    assert next_plan(AHEAD, now) == anew


def test_a_light_that_changes_makes_a_new_plan() -> None:
    assert next_plan(AHEAD, moved(AHEAD, 0.2), signals(red=("99",)))
