from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from worlds import cars, curved_road, ego, ego_on, junction, mission, observation, pedestrians, signals, straight_road

from interplan_planners.common.frozen_world import IdmDecision
from interplan_planners.idm import IdmPlanner
from interplan_sumo.dynamics.lqr import follow
from interplan_sumo.maps.geopackage import read_map
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.geometry import Pose
from interplan_sumo.world.signals import Signals, SignalStatus
from interplan_sumo.world.trace import ActorTable, EgoTrack
from tests.planners.staging_planners import driven

GOLDEN = Path(os.environ.get("INTERPLAN_GOLDEN", Path(__file__).parents[1] / "golden")) / "nuplan_metrics"
ROAD = straight_road(lanes=2, length_m=400.0, limit_mps=13.4, cuts_m=((100.0, 110.0),))
STRAIGHT_ON = mission(ROAD, ("11", "21", "31"))
CROSSING = junction()
LEFT_TURN = mission(CROSSING, ("1", "14", "8"))


def started(job: Mission = STRAIGHT_ON, **options: Any) -> IdmPlanner:
    planner = IdmPlanner(**options)
    planner.start(job)
    return planner


def decide(state: EgoState, actors: Actors | None = None, lights: Signals | None = None) -> IdmDecision:
    planner = started()
    planner.plan(observation(state, actors, lights))
    assert planner.decision is not None
    return planner.decision


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["run_boulevard_idm_reactive", "run_cross_straight_idm_reactive", "run_lht_merge_idm_reactive"]
)
def test_a_whole_drive_agrees_with_nuplan(name: str) -> None:
    """150 steps of planner, tracker and bicycle through recorded traffic: the ego of nuPlan's planner, to 10 um."""
    folder = GOLDEN / "cases" / name
    about = json.loads((folder / "case.json").read_text())
    table = pd.read_csv(folder / "ego.csv.gz")
    table["time_us"] -= table["time_us"][0]
    wanted = EgoTrack.from_frame(table, PACIFICA)
    tracks = pd.read_csv(folder / "tracks.csv.gz", dtype={"track_token": str})
    actors = ActorTable.from_frame(tracks, len(wanted))
    lights = pd.read_csv(folder / "traffic_lights.csv.gz", dtype={"lane_connector_id": str})
    goal = about["mission_goal"]
    planner = started(
        Mission(
            read_map(GOLDEN / about["map"]["file"]),
            tuple(about["route_roadblock_ids"]),
            Pose(goal["x"], goal["y"], goal["heading"]),
        )
    )
    state = wanted.state(0)
    for frame in range(len(wanted) - 1):
        rows = lights[lights["frame"] == frame].sort_values("lane_connector_id")
        status = np.array([SignalStatus[s] for s in rows["status"]], dtype=np.int8)
        now = Signals(tuple(rows["lane_connector_id"]), status)
        plan = planner.plan(Observation(state.time_s, state, actors.at(frame), now))
        dt_s = (wanted.time_us[frame + 1] - wanted.time_us[frame]) * 1e-6
        state = follow(state, plan, float(dt_s))
        then = wanted.state(frame + 1)
        assert (state.x_m, state.y_m) == pytest.approx((then.x_m, then.y_m), abs=1e-5), frame
        assert state.vx_mps == pytest.approx(then.vx_mps, abs=1e-5), frame


def test_a_plan_is_now_and_sixteen_samples_of_half_a_second_on_the_path() -> None:
    plan = started().plan(observation(ego(20.0, 0.3, 10.0, time_s=2.0)))
    assert plan.time_s == pytest.approx(np.linspace(2.0, 10.0, 17))
    assert plan.y_m == pytest.approx(0.0)
    assert plan.x_m[:2] == pytest.approx([20.0, 25.0])


def test_samples_and_interval_are_options() -> None:
    plan = started(samples=4, sample_interval_s=0.25).plan(observation(ego(20.0)))
    assert plan.time_s == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0])


@pytest.mark.parametrize("name", ["target_speed_mps", "samples", "sample_interval_s", "max_deceleration_mps2"])
def test_senseless_options_are_refused_by_name(name: str) -> None:
    with pytest.raises(ValueError, match=f"{name} is 0, expected more than 0"):
        IdmPlanner(**{name: 0})


@pytest.mark.parametrize(("limit", "speed", "target"), [(13.4, 12.0, 13.4), (13.4, 15.0, 15.0), (None, 9.0, 10.0)])
def test_the_target_is_the_limit_or_the_higher_start_speed(limit: float | None, speed: float, target: float) -> None:
    road = straight_road(length_m=3000.0, limit_mps=limit)
    state = driven(started(mission(road, ("11",))), ego(20.0, 0.0, speed), 100)[-1]
    assert state.vx_mps == pytest.approx(target, rel=0.03)


def test_with_nothing_ahead_the_end_of_the_path_is_the_lead() -> None:
    decision = decide(ego(20.0, 0.0, 10.0))
    assert decision.lead_id is None
    assert decision.gap_m == pytest.approx(399.0 - 20.0 - PACIFICA.length_m / 2)  # the last vertex is dropped


@pytest.mark.parametrize(
    ("ego_m", "car_m", "left_m", "seen"),
    [
        (20.0, 59.9, 0.0, True),  # up to forty metres
        (20.0, 60.1, 0.0, False),
        (20.0, 14.5, 0.0, False),  # right behind
        (20.0, 45.0, 2.1, True),  # reaches into the width of the ego
        (20.0, 45.0, 2.2, False),
        (380.0, 399.0 + 1.1 + 2.4, 0.0, True),  # half the ego's width and half a car beyond the end of the path
        (380.0, 399.0 + 1.2 + 2.4, 0.0, False),
    ],
)
def test_where_a_car_is_the_lead(ego_m: float, car_m: float, left_m: float, seen: bool) -> None:
    assert (decide(ego(ego_m), cars((car_m, left_m))).lead_id == "car00") is seen


def test_the_nearest_thing_is_the_lead_with_its_speed_along_the_path() -> None:
    decision = decide(ego(20.0), cars((55.0, 0.0, 3.0), (40.0, 0.5, 4.0, 0.5)))
    assert decision.lead_id == "car01"
    assert decision.lead_speed_mps == pytest.approx(4.0 * np.cos(0.5))
    assert decide(ego(20.0), cars((50.0, 0.0, 6.0, np.pi))).lead_speed_mps == pytest.approx(-6.0)


@pytest.mark.parametrize("kind", list(ActorKind))
def test_every_class_of_actor_can_be_the_lead_and_static_ones_stand(kind: ActorKind) -> None:
    decision = decide(ego(20.0), cars((45.0, 0.0, 5.0), kind=kind, length_m=1.0, width_m=1.0))
    assert (decision.lead_id, decision.lead_speed_mps) == ("car00", 0.0 if kind >= ActorKind.TRAFFIC_CONE else 5.0)


def test_something_that_overlaps_the_ego_is_the_lead_with_no_gap() -> None:
    decision = decide(ego(20.0, 1.0), pedestrians((21.0, 2.3)))
    assert (decision.lead_id, decision.gap_m) == ("ped00", 0.0)


@pytest.mark.parametrize("lights", [signals(red=("24", "42")), signals(green=("14",)), signals(yellow=("14",))])
def test_it_passes_other_lights(lights: Signals) -> None:
    state = driven(started(LEFT_TURN), ego_on(CROSSING, "1", 30.0, 8.0), 80, None, lights)[-1]
    assert state.y_m > 15.0


def test_where_its_lane_leaves_the_route_it_stops_at_the_end() -> None:
    job = Mission(CROSSING, ("1", "14", "7"), Pose(60.0, -1.75, 0.0))
    state = driven(started(job), ego_on(CROSSING, "1", 40.0, 8.0), 120)[-1]
    assert state.vx_mps < 0.2
    assert 8.0 < state.y_m < 12.0


def test_past_the_end_of_the_path_it_brakes_straight_on() -> None:
    planner = started()
    state = driven(planner, ego(398.0, 0.0, 8.0), 60)[-1]
    assert planner.decision is None
    assert state.vx_mps == pytest.approx(0.0, abs=0.05)
    assert 405.0 < state.x_m < 425.0


@pytest.mark.parametrize(("y_m", "lost"), [(1.99, False), (2.01, True)])
def test_two_metres_beside_the_path_it_is_lost(y_m: float, lost: bool) -> None:
    planner = started(mission(straight_road(length_m=200.0), ("11",)))
    plan = planner.plan(observation(ego(50.0, y_m, 9.0)))
    assert (planner.decision is None) is lost
    assert plan.y_m[0] == pytest.approx(y_m if lost else 0.0)


def test_on_a_bend_it_stays_on_the_centre_line() -> None:
    road = curved_road(radius_m=60.0, run_in_m=60.0, limit_mps=8.0)
    state = driven(started(mission(road, ("11",))), ego_on(road, "11", 10.0, 7.0), 150)[-1]
    arc_m, left_m = road["11"].centerline.project_point(state.x_m, state.y_m)
    assert arc_m > 80.0
    assert abs(left_m) < 0.3
