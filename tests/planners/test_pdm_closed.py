from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from worlds import cars, curved_road, ego, ego_on, junction, mission, observation, pedestrians, straight_road

from interplan_planners.common.ground import Ground
from interplan_planners.common.paths import DrivingPath, shifted
from interplan_planners.common.pdm import PdmCorridor, PdmDecision, PdmMotion, PdmSettings
from interplan_planners.common.red_lights import RedLights
from interplan_planners.common.route_search import lanes_of_route
from interplan_planners.pdm_closed import PdmClosedPlanner, PdmClosedSettings
from interplan_sumo.dynamics.lqr import follow
from interplan_sumo.plan_check import check_plan
from interplan_sumo.planner import Mission
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.trajectory import Trajectory
from tests.planners.staging_planners import driven

ROAD = straight_road(lanes=2, length_m=500.0, limit_mps=12.0, cuts_m=((300.0, 310.0),))
STRAIGHT_ON = mission(ROAD, ("11", "21", "31"))
WIDE = straight_road(lanes=3, length_m=500.0, limit_mps=12.0)
CROSSING = junction()


def started(job: Mission = STRAIGHT_ON, **options: Any) -> PdmClosedPlanner:
    planner = PdmClosedPlanner(PdmClosedSettings(**options))
    planner.start(job)
    return planner


def decide(state: EgoState, actors: Actors | None = None, planner: PdmClosedPlanner | None = None) -> PdmDecision:
    planner = planner or started()
    plan = planner.plan(observation(state, actors))
    check_plan(plan, state, state.time_s)
    assert planner.decision is not None
    return planner.decision


def rear_axle(plan: Trajectory) -> Floats:
    d = PACIFICA.rear_axle_to_center_m
    return np.stack((plan.x_m - d * np.cos(plan.heading_rad), plan.y_m - d * np.sin(plan.heading_rad)), axis=1)


def test_fifteen_proposals_of_four_seconds_make_a_plan_of_eight() -> None:
    planner = started()
    plan = planner.plan(observation(ego(50.0, 0.0, 8.0, time_s=3.0)))
    assert plan.time_s == pytest.approx(3.0 + 0.1 * np.arange(81))
    assert planner.decision is not None
    assert planner.decision.drives.x_m.shape == (15, 41)


def test_the_rear_axle_is_put_on_the_centre_line() -> None:
    road = curved_road(radius_m=40.0, run_in_m=80.0, limit_mps=8.0)
    planner = started(mission(road, ("11",)), lateral_offsets_m=(0.0,))
    _, left_m = road["11"].centerline.project(rear_axle(planner.plan(observation(ego_on(road, "11", 60.0, 8.0)))))
    assert left_m == pytest.approx(0.0, abs=1e-9)


def test_on_a_free_road_it_takes_the_limit_in_the_middle() -> None:
    decision = decide(ego(50.0, 0.0, 12.0))
    assert decision.best == 4
    assert decision.scores.total[4] == 1.0


def test_offsets_and_fractions_are_options() -> None:
    planner = started(lateral_offsets_m=(0.0, 0.5), speed_fractions=(0.5, 1.0), proposal_horizon_s=2.0, horizon_s=3.0)
    decision = decide(ego(50.0, 0.0, 8.0), planner=planner)
    assert decision.drives.x_m.shape == (4, 21)
    assert decision.drives.y_m[3, -1] > 0.2


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"fallback_limit_mps": 0.0}, "fallback_limit_mps is 0.0, expected more than 0"),
        ({"speed_fractions": (0.5, -1.0)}, r"speed_fractions\[1\] is -1.0, expected more than 0"),
        ({"speed_fractions": ()}, "speed_fractions must hold a number"),
        ({"lateral_offsets_m": ()}, "lateral_offsets_m must hold a number"),
        ({"horizon_s": 2.0}, "horizon_s is 2.0, expected at least proposal_horizon_s"),
    ],
)
def test_senseless_options_are_refused(option: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        PdmClosedPlanner(PdmClosedSettings(**option))


def test_it_nudges_around_what_leaves_a_metre_to_spare() -> None:
    """A car half beside the lane: the middle line is barred, a metre to the left is not."""
    parked = cars((110.0, -5.4), width_m=1.9)
    state = driven(started(mission(WIDE, ("12",))), ego(75.0, -3.5, 10.0), 60, parked)[-1]
    assert state.x_m > 120.0


def test_it_cannot_pass_what_fills_the_lane() -> None:
    state = driven(started(), ego(80.0, 0.0, 8.0), 80, cars((110.0, 0.0)))[-1]
    assert state.vx_mps < 0.3
    assert state.x_m + PACIFICA.length_m / 2 < 110.0 - 2.4


def test_it_sees_a_pedestrian_coming() -> None:
    """Who will be on the lane when the ego gets there is braked for before being on it."""
    states = driven(started(), ego(50.0, 0.0, 10.0), 40, pedestrians((85.0, -5.0, 1.4, np.pi / 2)))
    assert states[21].vx_mps < 9.0  # the walker is still 2.2 m beside the middle of the lane
    assert states[-1].x_m + PACIFICA.length_m / 2 < 85.0


def test_what_touches_the_ego_now_is_ignored() -> None:
    decision = decide(ego(50.0, 0.0, 8.0), cars((54.5, 0.0)))
    assert decision.scores.no_collision[decision.best] == 1.0
    assert not decision.braking


@pytest.mark.parametrize(("speed", "braking"), [(4.9, True), (5.1, False)])
def test_the_emergency_brake_works_up_to_five_metres_per_second(speed: float, braking: bool) -> None:
    wall = cars(*((54.0, y_m, 0.0, np.pi / 2) for y_m in (-4.0, 0.0, 4.0)), length_m=6.0)
    planner = started()
    plan = planner.plan(observation(ego(50.0, 0.0, speed), wall))
    assert planner.decision is not None
    assert planner.decision.braking is braking
    if braking:
        after = follow(ego(50.0, 0.0, speed), plan, 0.1)
        assert after.ax_mps2 == pytest.approx(-4.05 / 3.0, abs=0.05)  # a third passes the lag in the first step


def test_far_from_every_path_it_brakes_straight_on() -> None:
    planner = started()
    planner.plan(observation(ego(50.0, 0.0, 8.0)))
    plan = planner.plan(observation(ego(50.0, -7.5, 8.0, heading_rad=0.3)))
    assert planner.decision is None
    assert plan.heading_rad == pytest.approx(0.3)


@pytest.mark.parametrize(("blocked", "best"), [(False, 1), (True, 0)])
def test_what_a_path_is_worth_decides_between_drives_that_score(blocked: bool, best: int) -> None:
    """Not for one that scores nothing: somebody a little to the side stands too near to stop."""
    state, shape = ego(50.0, -0.5, 8.0), PACIFICA
    actors = cars((59.0, -2.7)) if blocked else Actors.none()
    ground, lights = Ground(ROAD, lanes_of_route(ROAD, ("1",))), RedLights(ROAD, ("11",), shape.width_m / 2)
    middle = DrivingPath(ROAD["11"].centerline)
    paths = [middle, DrivingPath(shifted(middle.line, -1.0))]
    corridor = PdmCorridor(paths, middle, ground, lights, 12.0, (0.0, 0.3))
    _, decision = PdmMotion(PdmSettings(), shape).plan(observation(state, actors), corridor)
    _, plain = PdmMotion(PdmSettings(), shape).plan(observation(state, actors), replace(corridor, worth=()))
    assert decision is not None
    assert plain is not None
    assert (plain.best // 5, decision.best // 5) == (0, best)
    assert (decision.scores.total == plain.scores.total).all()


def test_static_objects_count_half() -> None:
    decision = decide(ego(50.0, 0.0, 12.0), cars((64.0, 0.0), kind=ActorKind.BARRIER))
    assert set(decision.scores.no_collision.tolist()) <= {0.5, 1.0}
    assert 0.5 in decision.scores.no_collision


def test_paths_are_fixed_at_the_start_unless_they_are_to_be_rebuilt() -> None:
    for rebuild, on_lane in ((False, 0.0), (True, -3.5)):
        planner = started(mission(WIDE, ("11",)), rebuild=rebuild, lateral_offsets_m=(0.0,))
        planner.plan(observation(ego(50.0, 0.0, 8.0)))
        plan = planner.plan(observation(ego(60.0, -1.9, 8.0)))
        assert rear_axle(plan)[-1, 1] == pytest.approx(on_lane)


def test_a_route_that_begins_elsewhere_is_corrected() -> None:
    late = Mission(ROAD, ("3",), STRAIGHT_ON.goal)
    state = driven(started(late), ego(270.0, 0.0, 10.0), 35)[-1]
    assert state.x_m > 300.0
