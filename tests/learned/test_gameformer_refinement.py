"""GameFormer's reference paths and its refinement by hand: where it goes, what of it is taken, and how fast."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

from interplan_learned.gameformer.candidates import JOINS_M, CandidatePaths, joined
from interplan_learned.gameformer.inputs import PLAN_STEP_S
from interplan_learned.gameformer.occupancy import taken
from interplan_learned.gameformer.reference import (
    BEND_PER_M,
    LOOKED_AT_M,
    ROOM_M,
    ReferencePath,
    ReferencePaths,
    largest_curvature,
    reference_path,
)
from interplan_learned.gameformer.refinement import LEAST_MPS2, MOST_MPS2, SpeedTask, refined_speeds
from interplan_learned.scene import AGENT_CHANNELS
from interplan_planners.common.paths import DrivingPath
from interplan_sumo import tiny_worlds
from interplan_sumo.features.frame import EgoFrame
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import Floats, Polyline, Pose
from interplan_sumo.world.roads import StopLine, StopLineKind

AHEAD_S: Floats = PLAN_STEP_S * np.arange(1, 81, dtype=np.float64)
WIDTH_M = 2.0
NOBODY = np.zeros((80, 120), dtype=np.bool_)


def task(
    planned_m: Floats, cap_mps: float = 13.0, cells: np.ndarray = NOBODY, speed_mps: float = 8.0, push_mps2: float = 0.0
) -> SpeedTask:
    return SpeedTask(
        planned_m=planned_m, cap_mps=np.full(80, cap_mps), taken=cells, speed_mps=speed_mps,
        acceleration_mps2=push_mps2, front_m=PACIFICA.front_m,
    )  # fmt: skip


def gained_mps2(speeds: Floats, speed_mps: float) -> Floats:
    return np.diff(speeds, prepend=speed_mps) / PLAN_STEP_S


def road(length_m: float = 120.0) -> DrivingPath:
    return DrivingPath(Polyline(np.array(((0.0, 0.0), (length_m, 0.0)))).resampled(0.5))


def one_step(what: SpeedTask) -> tuple[float, float]:
    """Speed and acceleration after a step of the refined motion."""
    speed = float(refined_speeds(what)[0])
    return speed, (speed - what.speed_mps) / PLAN_STEP_S


def test_on_a_free_road_it_reaches_the_cap_smoothly_and_stays_there() -> None:
    np.testing.assert_allclose(refined_speeds(task(13.0 * AHEAD_S, speed_mps=13.0)), 13.0, atol=1e-6)
    speed_mps, push_mps2, gained = 8.0, 0.0, []
    for _ in range(150):
        planned = np.cumsum(np.minimum(speed_mps + AHEAD_S, 13.0)) * PLAN_STEP_S
        speed_mps, push_mps2 = one_step(task(planned, speed_mps=speed_mps, push_mps2=push_mps2))
        gained.append(push_mps2)
    assert speed_mps == pytest.approx(13.0, abs=0.1)
    assert -0.5 < min(gained) < max(gained) < 1.5


def test_a_lower_cap_is_slower_and_it_ends_near_where_the_network_wants_to_be() -> None:
    slower = refined_speeds(task(8.0 * AHEAD_S, cap_mps=3.0))
    faster = refined_speeds(task(8.0 * AHEAD_S, cap_mps=15.0))
    assert slower.sum() < 80 * 8.0 < faster.sum()
    for speeds in (slower, faster):
        assert abs(speeds.sum() * PLAN_STEP_S - 64.0) < 3.5


def test_plans_that_rush_or_brake_too_hard_are_held_to_the_limits() -> None:
    rushed = refined_speeds(task(np.cumsum(np.minimum(4.0 * AHEAD_S, 13.0)) * PLAN_STEP_S, speed_mps=0.0))
    assert gained_mps2(rushed, 0.0).max() < MOST_MPS2 + 0.3
    stopped = refined_speeds(task(np.cumsum(np.maximum(10.0 - 8.0 * AHEAD_S, 0.0)) * PLAN_STEP_S, speed_mps=10.0))
    assert gained_mps2(stopped, 10.0).min() > LEAST_MPS2 - 0.3
    assert stopped.min() >= 0.0


@pytest.mark.slow
@pytest.mark.parametrize(("speed_mps", "rear_m"), [(8.0, 40.0), (3.0, 12.0)])
def test_it_stops_three_to_four_metres_behind_a_standing_car(speed_mps: float, rear_m: float) -> None:
    at_m, push_mps2, gained = 0.0, 0.0, []
    for _ in range(120):
        cells = NOBODY.copy()
        cells[:, max(int(rear_m - at_m - 3.0), 0) : int(np.ceil(rear_m - at_m + 4.8))] = True
        planned = max(speed_mps, 1.0) * AHEAD_S  # the network would drive on
        speed_mps, push_mps2 = one_step(task(planned, 13.0, cells, speed_mps, push_mps2))
        at_m += speed_mps * PLAN_STEP_S
        gained.append(push_mps2)
    assert speed_mps == pytest.approx(0.0, abs=0.01)
    assert 3.0 <= rear_m - at_m - PACIFICA.front_m <= 4.0
    assert min(gained) > LEAST_MPS2


def test_what_the_plan_has_passed_by_then_does_not_hold_it_up() -> None:
    behind = NOBODY.copy()
    behind[20:, :10] = True  # somebody crosses behind the ego two seconds from now
    free = refined_speeds(task(8.0 * AHEAD_S))
    np.testing.assert_array_equal(refined_speeds(task(8.0 * AHEAD_S, cells=behind)), free)
    ahead = NOBODY.copy()
    ahead[20:, 26:] = True
    held = refined_speeds(task(8.0 * AHEAD_S, cells=ahead))
    held_m, free_m = (float(speeds[:30].sum()) * PLAN_STEP_S + PACIFICA.front_m for speeds in (held, free))
    assert held_m < 26.2 < free_m


def agent(x_m: float, y_m: float, length_m: float = 5.0) -> tuple[np.ndarray, np.ndarray]:
    """A standing car and where it will be, at 2 Hz."""
    row = np.zeros((1, len(AGENT_CHANNELS)))
    for name, value in (("x", x_m), ("y", y_m), ("length", length_m), ("width", WIDTH_M), ("vehicle", 1.0)):
        row[0, AGENT_CHANNELS.index(name)] = value
    return row, np.tile((x_m, y_m), (1, 16, 1))


def cells_of(
    agents: np.ndarray, futures: np.ndarray, red: list[Polyline] | None = None, path: DrivingPath | None = None
) -> np.ndarray:
    return taken(path or road(), agents, futures, red or [], PACIFICA.width_m)


def test_a_standing_car_takes_its_length_and_three_metres_behind_it() -> None:
    cells = cells_of(*agent(30.6, 0.0))
    np.testing.assert_array_equal(np.flatnonzero(cells[0]), np.arange(25, 34))  # 30.6 - 2.5 - 3 to 30.6 + 2.5
    assert (cells == cells[0]).all()


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_car_beside_the_path_is_in_the_way_up_to_thirty_centimetres_from_the_ego(side: float) -> None:
    reach_m = (WIDTH_M + PACIFICA.width_m) / 2.0 + 0.3
    assert cells_of(*agent(30.0, side * (reach_m - 0.01))).any()
    assert not cells_of(*agent(30.0, side * (reach_m + 0.01))).any()


def test_who_is_behind_the_ego_is_left_out_as_are_empty_rows_and_beyond_its_end_the_path_is_taken() -> None:
    assert not cells_of(*agent(-1.0, 0.0)).any()
    assert not cells_of(*agent(30.0, 0.0, length_m=0.0)).any()
    cells = cells_of(*agent(-1.0, 0.0), path=road(39.7))
    np.testing.assert_array_equal(np.flatnonzero(cells[0]), np.arange(40, 120))


def test_a_car_that_crosses_is_in_the_way_only_when_it_is_there() -> None:
    row, futures = agent(30.0, -10.0)
    futures[0, :, 1] = -10.0 + 2.5 * np.arange(1, 17)  # 5 m/s to the left: on the path after 2 s
    seconds = AHEAD_S[cells_of(row, futures).any(axis=1)]
    reach_s = ((WIDTH_M + PACIFICA.width_m) / 2.0 + 0.3) / 5.0
    assert seconds[0] == pytest.approx(2.0 - reach_s, abs=0.1)
    assert seconds[-1] == pytest.approx(2.0 + reach_s, abs=0.1)


def test_futures_at_ten_hertz_are_taken_as_they_are() -> None:
    row, futures = agent(20.0, 0.0)
    often = np.zeros((1, 80, 2))
    often[0, :, 0] = futures[0, :, 0] = 20.0
    often[0, :, 0] += 6.0 * AHEAD_S
    futures[0, :, 0] += 3.0 * np.arange(1, 17)
    np.testing.assert_array_equal(cells_of(row, often), cells_of(row, futures))


def test_a_red_light_takes_its_connector_unless_the_rear_axle_is_on_it() -> None:
    def red(start_m: float, left_m: float = 0.0) -> np.ndarray:
        line = Polyline(np.array(((start_m, left_m), (start_m + 20.0, left_m))))
        return np.flatnonzero(cells_of(*agent(-1.0, 0.0), red=[line])[0])

    np.testing.assert_array_equal(red(30.2), np.arange(30, 51))
    assert red(30.0, left_m=0.6).size == 0  # another turn from the same lane
    assert red(-5.0).size == 0


BESIDE_M = tiny_worlds.LANE_WIDTH_M


def mission(lanes: int = 1, limit_mps: float | None = 15.0) -> Mission:
    return tiny_worlds.mission(tiny_worlds.straight_road(lanes, limit_mps=limit_mps), ["11"])


def at(x_m: float, y_m: float = 0.0, speed_mps: float = 8.0, actors: Actors | None = None) -> Observation:
    """The rear axle at a place, heading along the road."""
    return tiny_worlds.observation(tiny_worlds.ego(x_m + PACIFICA.rear_axle_to_center_m, y_m, speed_mps), actors)


def found(where: Mission, observation: Observation) -> ReferencePath:
    path = ReferencePaths(where).at(observation)
    assert path is not None
    return path


def test_a_join_leaves_along_the_ego_and_arrives_along_the_way() -> None:
    way = tiny_worlds.straight_road().lanes["11"].centerline
    line = Polyline(joined(Pose(20.0, 2.0, 0.3), way, 20.0, 10.0))
    start, end = line.pose_at(0.0), line.pose_at(line.project_point(31.0, 0.0)[0])
    assert (start.x_m, start.y_m) == pytest.approx((20.0, 2.0))
    assert start.heading_rad == pytest.approx(0.3, abs=0.1)
    assert (end.y_m, end.heading_rad) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert line.points[-1, 0] == pytest.approx(140.0)  # 120 m of the way


def test_each_way_is_joined_at_several_distances() -> None:
    paths = CandidatePaths(mission(lanes=2))
    here = Pose(30.0, 0.0, 0.0)
    under = paths.block_under(here)
    assert under is not None
    candidates = paths.of(here, *under)
    assert [each.lanes for each in candidates] == [("11",)] * len(JOINS_M) + [("12",)] * len(JOINS_M)
    assert candidates[-1].beside_m == pytest.approx(BESIDE_M)
    np.testing.assert_allclose([each.length_m for each in candidates], 170.0)


@pytest.mark.parametrize(("left_m", "joins"), [(21.0, 4), (19.0, 3), (6.0, 1), (2.0, 1), (0.5, 0)])
def test_near_the_end_of_the_route_there_are_fewer_joins(left_m: float, joins: int) -> None:
    paths = CandidatePaths(mission())
    here = Pose(200.0 - left_m, 0.0, 0.0)
    under = paths.block_under(here)
    assert under is not None
    assert len(paths.of(here, *under)) == joins
    assert (ReferencePaths(mission()).at(at(200.0 - left_m)) is None) is (joins == 0)


def test_off_the_route_there_is_no_path() -> None:
    edge_m = tiny_worlds.LANE_WIDTH_M / 2.0
    paths = ReferencePaths(mission())
    assert paths.at(at(30.0, edge_m + 4.9)) is not None
    assert paths.at(at(30.0, edge_m + 5.1)) is None


def test_ways_stay_on_the_route_at_a_junction() -> None:
    roads = tiny_worlds.junction()
    paths = CandidatePaths(tiny_worlds.mission(roads, ["1", "14", "8"]))
    start = roads["1"].centerline.pose_at(40.0)
    under = paths.block_under(start)
    assert under is not None
    assert {each.lanes for each in paths.of(start, *under)} == {("1", "14", "8")}


def test_without_anything_in_the_way_it_stays_in_its_lane() -> None:
    path = found(mission(lanes=3), at(30.0, -BESIDE_M)).path
    assert path.length_m == pytest.approx(120.0, abs=0.1)
    np.testing.assert_allclose(path.line.points[:, 1], 0.0, atol=1e-6)


@pytest.mark.parametrize(("lane_y_m", "left_m"), [(-BESIDE_M, BESIDE_M), (0.0, -BESIDE_M)])
def test_it_goes_around_a_standing_car_through_the_neighbour_lane(lane_y_m: float, left_m: float) -> None:
    where = mission(lanes=2)
    path = found(where, at(30.0, lane_y_m, actors=tiny_worlds.cars((50.0, lane_y_m)))).path
    assert path.line.pose_at(60.0).y_m == pytest.approx(left_m, abs=0.01)


@pytest.mark.parametrize(("spare_m", "stays"), [(0.1, True), (-0.1, False)])
def test_it_follows_a_car_that_drives_unless_it_is_already_close(spare_m: float, stays: bool) -> None:
    rear_m = 30.0 + LOOKED_AT_M / 2.0 + ROOM_M + PACIFICA.width_m / 2.0 + spare_m
    cars = tiny_worlds.cars((rear_m + 2.4, 0.0, 1.0), length_m=4.8)
    path = found(mission(lanes=2), at(30.0, actors=cars)).path
    assert (abs(path.line.pose_at(60.0).y_m) < 0.1) is stays


@pytest.mark.parametrize(("lanes", "speed_mps", "stays"), [(4, 3.0, True), (4, 3.1, False), (3, 3.0, False)])
def test_in_slow_traffic_on_a_wide_road_it_does_not_go_around(lanes: int, speed_mps: float, stays: bool) -> None:
    path = found(mission(lanes), at(30.0, speed_mps=speed_mps, actors=tiny_worlds.cars((50.0, 0.0)))).path
    assert (abs(path.line.pose_at(60.0).y_m) < 0.1) is stays


@pytest.mark.parametrize(("x_m", "stays"), [(41.0, True), (39.0, False)])
def test_near_a_traffic_light_it_does_not_go_around(x_m: float, stays: bool) -> None:
    roads = tiny_worlds.straight_road(2, 300.0, cuts_m=((100.0, 120.0),))
    light = StopLine("1", shapely.box(99.0, -5.0, 100.0, 2.0), StopLineKind.TRAFFIC_LIGHT)
    connectors = {lane: replace(each, stop_line_ids=("1",)) for lane, each in roads.connectors.items()}
    lit = replace(roads, connectors=connectors, stop_lines={"1": light})
    where = tiny_worlds.mission(lit, ["11", "21", "31"])
    path = found(where, at(x_m, actors=tiny_worlds.cars((x_m + 20.0, 0.0)))).path
    assert (abs(path.line.pose_at(60.0).y_m) < 0.1) is stays


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(("radius_m", "is_sharp"), [(8.0, True), (13.0, False)])
def test_from_a_sharp_bend_on_three_metres_per_second_are_aimed_at(
    side: float, radius_m: float, is_sharp: bool
) -> None:
    line = tiny_worlds.curved_road(radius_m, side * 1.5, run_in_m=30.0).lanes["11"].centerline
    assert (largest_curvature(line) > BEND_PER_M) is is_sharp
    path = reference_path(line.points, EgoFrame(0.0, 0.0, 0.0), 12.0)
    assert set(path.cap_mps.tolist()) == ({3.0, 12.0} if is_sharp else {12.0})
    if is_sharp:
        bend_m = float(path.path.line.arc_m[path.cap_mps < 12.0][0])
        assert bend_m == pytest.approx(30.0, abs=2.5)
        assert path.cap_at(np.array((0.0, bend_m + 0.01, 500.0))).tolist() == [12.0, 3.0, 3.0]


@pytest.mark.parametrize(("limit_mps", "cap_mps"), [(None, 13.0), (10.0, 10.0), (25.0, 15.0), (1.0, 3.0)])
def test_the_cap_is_the_limit_within_bounds(limit_mps: float | None, cap_mps: float) -> None:
    assert set(found(mission(limit_mps=limit_mps), at(30.0)).cap_mps.tolist()) == {cap_mps}


def test_the_path_is_in_the_ego_frame() -> None:
    ego = tiny_worlds.ego(30.0, 1.0, 5.0, heading_rad=0.2)
    path = found(mission(), tiny_worlds.observation(ego)).path.line
    start, later = path.pose_at(0.0), path.pose_at(60.0)
    assert (start.x_m, start.y_m) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert start.heading_rad == pytest.approx(0.0, abs=0.1)
    assert later.heading_rad == pytest.approx(-0.2, abs=1e-3)  # the road turns right, seen from the ego
    assert EgoFrame.of(ego).to_map(np.array((later.x_m, later.y_m, 0.0)))[1] == pytest.approx(0.0, abs=1e-6)
