"""DTPP by hand: its reference paths, speeds, leaves, parents, and the plan that scores choose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from interplan_learned.dtpp.inputs import BRANCH_CHANNELS, shown
from interplan_learned.dtpp.paths import LOOKED_AT_M, PATHS, POINTS, path_cost, reference_paths, sampled_path
from interplan_learned.dtpp.planner import plans
from interplan_learned.dtpp.sizes import SIZES, TreeSize
from interplan_learned.dtpp.tree import (
    ACCELERATION,
    CURVATURE,
    FIRST_STEPS,
    SPEED,
    STEP_S,
    TreeStart,
    best_parents,
    cubic_speeds,
    first_stage,
    second_stage,
    target_speeds,
)
from interplan_sumo.features.schema import channel_index
from interplan_sumo.features.view import Arrays
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import Floats

WIDE = TreeSize(branches=40, first_speeds=10, second_speeds=5, parents=5)


def road(left_m: float = 0.0) -> Floats:
    """A straight path so far to the left, begun there."""
    path = sampled_path(np.array(((0.0, 0.0), (120.0, 0.0))))
    path[:, 1] = left_m
    return path


def bend(radius_m: float) -> Floats:
    """A path that bends to the left, or with a negative radius to the right."""
    angle = np.linspace(0.0, 110.0 / abs(radius_m), 300)
    return sampled_path(radius_m * np.stack((np.sin(angle) * np.sign(radius_m), 1.0 - np.cos(angle)), axis=1))


def start(*paths: Floats, speed_mps: float = 0.0, push_mps2: float = 0.0, limit_mps: float = 12.0) -> TreeStart:
    held = np.zeros((1, 3, 121, 4))
    held[0, : len(paths)] = paths if paths else 0.0
    return TreeStart(
        paths=held, paths_valid=np.arange(3)[None] < len(paths), speed_mps=np.array([speed_mps]),
        acceleration_mps2=np.array([push_mps2]), limit_mps=np.array([limit_mps]),
    )  # fmt: skip


@pytest.mark.parametrize(("speed_mps", "limit_mps", "least", "most"), [
    (20.0, 40.0, 8.0, 27.2),  # 4 m/s2 of braking, 2.4 m/s2 of pushing
    (10.0, 40.0, 0.0, 17.2),  # nobody drives backwards
    (10.0, 13.0, 0.0, 13.0),
    (30.0, 13.0, 18.0, 18.0),  # much too fast: nothing but braking
])  # fmt: skip
def test_the_grid_lies_between_braking_and_the_limit(
    speed_mps: float, limit_mps: float, least: float, most: float
) -> None:
    grid = target_speeds(np.array([speed_mps]), np.array([limit_mps]), 3.0, 10)
    assert grid.shape == (1, 10)
    np.testing.assert_allclose(grid[0], np.linspace(least, most, 10))


def test_profiles_end_at_their_speed_without_acceleration_and_stand_rather_than_go_backwards() -> None:
    speeds = cubic_speeds(np.array(6.0), np.array(1.5), np.array(10.0), 300)
    rate = np.diff(speeds, prepend=6.0) / STEP_S
    assert rate[0] == pytest.approx(1.5, abs=0.01)
    assert speeds[-1] == pytest.approx(10.0)
    assert rate[-1] == pytest.approx(0.0, abs=0.01)
    half = cubic_speeds(np.array(0.0), np.array(0.0), np.array(8.0), 30)[14]
    assert half == pytest.approx(4.0)
    speeds = cubic_speeds(np.array(0.5), np.array(-4.0), np.array(0.0), 30)
    assert speeds.min() == 0.0
    assert speeds[-1] == 0.0


def test_leaves_reach_their_speeds_along_the_path_and_go_straight_on_beyond_it() -> None:
    leaves = first_stage(start(road()), WIDE)
    assert leaves.valid[0].tolist() == [True] * 10 + [False] * 30
    ends = leaves.motion[0, :10, -1]
    np.testing.assert_allclose(ends[:, SPEED], np.linspace(0.0, 7.2, 10))
    np.testing.assert_allclose(ends[:, 0], 1.5 * ends[:, SPEED], atol=0.02)  # half of speed times 3 s
    np.testing.assert_allclose(ends[:, 1], 0.0)
    assert not leaves.motion[0, 10:].any()
    leaves = first_stage(start(road(), speed_mps=50.0, limit_mps=50.0), WIDE)
    assert leaves.motion[0, 9, -1, 0] == pytest.approx(150.0)


@pytest.mark.parametrize("radius_m", [50.0, -50.0])
def test_leaves_turn_with_their_path(radius_m: float) -> None:
    leaves = first_stage(start(bend(radius_m), speed_mps=10.0), WIDE)
    driven_m = leaves.arc_m[0, 9, -1]
    x, y, yaw, *_ = leaves.motion[0, 9, -1]
    angle = driven_m / radius_m
    assert yaw == pytest.approx(angle, abs=0.01)
    assert (x, y) == pytest.approx((radius_m * np.sin(angle), radius_m * (1.0 - np.cos(angle))), abs=0.1)
    assert leaves.motion[0, 9, -1, CURVATURE] == pytest.approx(1.0 / radius_m, rel=0.05)


@pytest.mark.parametrize(("apart_m", "count"), [(0.49, 10), (0.51, 20)])
def test_leaves_that_end_within_half_a_metre_are_one(apart_m: float, count: int) -> None:
    leaves = first_stage(start(road(), road(apart_m)), WIDE)
    assert leaves.valid.sum() == count
    assert set(leaves.path[0, :count].tolist()) == set(range(count // 10))


def test_too_many_leaves_are_thinned_evenly() -> None:
    leaves = first_stage(start(road(), road(3.5)), replace(WIDE, branches=15))
    assert leaves.valid.all()
    assert np.bincount(leaves.path[0]).tolist() in ([7, 8], [8, 7])
    ends = leaves.motion[0, :, -1, SPEED]
    assert (ends[0], ends[-1]) == pytest.approx((0.0, 7.2))


def test_the_best_leaves_become_parents() -> None:
    scores = np.array([[1.0, 9.0, 5.0, 7.0]])
    valid = np.array([[True, False, True, True]])
    assert best_parents(scores, valid, 2).tolist() == [[3, 2]]
    assert best_parents(scores, valid & (scores > 6.0), 2).tolist() == [[3, -1]]


def test_children_go_on_from_their_parent_on_its_path() -> None:
    begin = start(road(), road(3.5), speed_mps=6.0)
    first = first_stage(begin, WIDE)
    parents = np.array([[14, 2, -1]])
    second = second_stage(begin, first, parents, WIDE)
    assert second.valid.sum() == 10
    assert second.parent[0, :10].tolist() == [14] * 5 + [2] * 5
    for child, parent in enumerate(second.parent[0, :10].tolist()):
        np.testing.assert_allclose(second.motion[0, child, :FIRST_STEPS], first.motion[0, parent])
        assert second.path[0, child] == first.path[0, parent]
    reached = first.motion[0, 14, -1, SPEED]
    np.testing.assert_allclose(second.motion[0, :5, -1, SPEED], np.linspace(0.0, min(reached + 12.0, 12.0), 5))
    assert np.abs(second.motion[0, :5, FIRST_STEPS, ACCELERATION]).max() < 0.5  # no jump from stage to stage


def test_the_network_sees_every_fifth_step_and_shares_of_effort() -> None:
    begin = start(bend(50.0), speed_mps=10.0, limit_mps=10.0)
    given = shown(first_stage(begin, SIZES["compact"].tree), begin, "compact")
    fastest = given["branches"][0, 9]
    assert fastest.shape == (16, len(BRANCH_CHANNELS))
    np.testing.assert_allclose(fastest[:6, 0], 50.0 * np.sin(np.arange(1, 7) / 10.0), atol=0.05)
    assert fastest[:, -1].tolist() == [1.0] * 6 + [0.0] * 10
    assert not fastest[6:].any()
    np.testing.assert_allclose(given["effort"][0, 9], (10.0 / 15.0, 0.0, 0.0, 2.0 / 5.0), atol=0.02)
    braking = given["effort"][0, 0]
    assert braking[0] == pytest.approx(5.0 / 15.0, abs=0.02)
    assert braking[1] == pytest.approx(10.0 / 3.0 / 4.0, abs=0.01)
    assert not given["effort"][0, 10:].any()


def test_the_plan_has_the_best_sum_of_both_stages() -> None:
    begin = start(road(), road(3.5), speed_mps=6.0)

    def to_the_left_at_six(branches: Arrays) -> np.ndarray:
        table = branches["branches"]
        last = np.maximum(table[..., -1].sum(axis=-1).astype(int) - 1, 0)
        ends = np.take_along_axis(table, last[..., None, None], axis=2)[:, :, 0]
        return ends[..., 1] - np.abs(ends[..., 3] - 6.0)

    (plan,) = plans(begin, to_the_left_at_six, "compact")
    assert plan.shape == (80, 3)
    assert plan[-1, 1] == pytest.approx(3.5)
    assert plan[-1, 0] == pytest.approx(48.0, abs=4.0)


def test_a_child_of_a_pruned_parent_is_never_driven() -> None:
    begin = start(road(), speed_mps=0.0)
    calls: list[np.ndarray] = []

    def slowly_then_fast(branches: Arrays) -> np.ndarray:
        calls.append(branches["branches"])
        ends = branches["branches"][:, :, 5 if len(calls) == 1 else 15, 0]
        return -100.0 * ends if len(calls) == 1 else ends

    (plan,) = plans(begin, slowly_then_fast, "compact")
    first, second = calls
    kept_m = np.sort(first[0, first[0, :, 0, -1] > 0.0, 5, 0])[: SIZES["compact"].tree.parents]
    children = second[0, second[0, :, 0, -1] > 0.0]
    assert {float(each) for each in children[:, 5, 0].round(3)} <= {float(each) for each in kept_m.round(3)}
    assert plan[29, 0] == pytest.approx(kept_m[0], abs=1e-6)


def test_without_a_path_the_plan_is_to_stop() -> None:
    stopped = plans(start(speed_mps=9.0), lambda branches: branches["effort"][..., 0], "compact")
    assert stopped.shape == (1, 80, 3)
    assert not stopped.any()


HALF_WIDTH_M = PACIFICA.width_m / 2.0
ON_ROUTE = channel_index("lanes", "on_route")


def lane(x_m: tuple[float, float], y_m: tuple[float, float], on_route: bool = True) -> np.ndarray:
    """A straight piece of a lane between two points."""
    piece = np.zeros((50, 11), dtype=np.float32)
    piece[:, 0], piece[:, 1] = np.linspace(*x_m, 50), np.linspace(*y_m, 50)
    piece[:, 2] = np.arctan2(y_m[1] - y_m[0], x_m[1] - x_m[0])
    piece[:, ON_ROUTE] = on_route
    return piece


def arrays(*lanes: np.ndarray, car: tuple[float, ...] = (), cone: tuple[float, ...] = ()) -> Arrays:
    """One sample with some lanes, maybe a car (x, y, speed) and a cone (x, y)."""
    made = {
        "lanes": np.zeros((1, 60, 50, 11), dtype=np.float32),
        "lanes_valid": np.zeros((1, 60), dtype=np.bool_),
        "agents": np.zeros((1, 30, 21, 13), dtype=np.float32),
        "static_objects": np.zeros((1, 20, 6), dtype=np.float32),
    }
    for row, piece in enumerate(lanes):
        made["lanes"][0, row], made["lanes_valid"][0, row] = piece, True
    if car:
        for name, value in zip(("x", "y", "vx", "length", "width", "is_car"), (*car, 4.0, 2.0, 1.0), strict=True):
            made["agents"][0, 0, -1, channel_index("agents", name)] = value
    if cone:
        made["static_objects"][0, 0] = (*cone, 0.0, 0.4, 0.4, 3.0)
    return made


def paths_of(given: Arrays) -> np.ndarray:
    """(K, POINTS, 4) those that exist, after which there are only empty rows."""
    paths, valid = reference_paths(given)
    assert paths.shape == (1, PATHS, POINTS, 4)
    assert not paths[~valid].any()
    return paths[0, valid[0]]


AHEAD = lane((-20.0, 30.0), (0.0, 0.0)), lane((30.0, 80.0), (0.0, 0.0))
LEFT = lane((-20.0, 30.0), (3.5, 3.5)), lane((30.0, 80.0), (3.5, 3.5))


def test_a_path_starts_at_the_rear_axle_and_has_a_point_every_metre_also_beyond_the_last_lane() -> None:
    (path,) = paths_of(arrays(*AHEAD))
    np.testing.assert_allclose(path[:, 0], np.arange(POINTS), atol=0.01)
    np.testing.assert_allclose(path[:, 1:], 0.0, atol=1e-6)


def test_a_neighbour_lane_to_the_left_is_reached_within_twenty_metres() -> None:
    own, left = paths_of(arrays(*LEFT, *AHEAD))
    np.testing.assert_allclose(own[:, 1], 0.0, atol=1e-6)
    assert left[0, 1] == 0.0
    assert (np.diff(left[:25, 1]) >= 0.0).all()
    np.testing.assert_allclose(left[22:80, 1], 3.5, atol=0.01)
    assert left[5, 2] > 0.0  # it turns left,
    assert left[3, 3] > 0.0 > left[15, 3]  # and then right


@pytest.mark.parametrize(("beside_m", "found"), [(3.99, 1), (4.01, 0), (-3.99, 1), (-4.01, 0)])
def test_lanes_nearer_than_four_metres_are_ways(beside_m: float, found: int) -> None:
    assert len(paths_of(arrays(lane((-25.0, 24.0), (beside_m, beside_m))))) == found


def test_oncoming_lanes_lanes_off_the_route_and_those_that_soon_end_beside_longer_ones_are_no_ways() -> None:
    assert len(paths_of(arrays(lane((80.0, -20.0), (0.0, 0.0))))) == 0
    assert len(paths_of(arrays(lane((-20.0, 80.0), (0.0, 0.0), on_route=False)))) == 0
    assert len(paths_of(arrays())) == 0
    dead_end = lane((-20.0, 20.0), (3.5, 3.5))
    assert len(paths_of(arrays(*AHEAD, dead_end))) == 1
    assert len(paths_of(arrays(dead_end))) == 1


def test_where_the_lane_forks_there_is_a_path_for_each_branch() -> None:
    left = lane((30.0, 70.0), (0.0, 20.0))
    found = paths_of(arrays(AHEAD[0], left, AHEAD[1]))
    assert sorted(float(path[60, 1].round(1)) for path in found) == [0.0, pytest.approx(13.4, abs=0.1)]


@pytest.mark.parametrize(("gap_m", "reach_y_m"), [(0.49, 7.6), (0.51, 0.0)])
def test_pieces_follow_each_other_where_ends_are_nearer_than_half_a_metre(gap_m: float, reach_y_m: float) -> None:
    bend = lane((30.0 + gap_m, 80.0), (0.0, 20.0))
    (path,) = paths_of(arrays(AHEAD[0], bend))
    assert path[50, 1] == pytest.approx(reach_y_m, abs=0.5)


def test_a_standing_car_or_a_cone_puts_a_path_behind_the_others_and_a_moving_car_does_not() -> None:
    for blocked in ({"car": (30.0, 0.0, 0.0)}, {"cone": (30.0, 0.0)}):
        first, second = paths_of(arrays(*AHEAD, *LEFT, **blocked))
        assert first[40, 1] == pytest.approx(3.5, abs=0.01)
        assert second[40, 1] == pytest.approx(0.0, abs=0.01)
    assert paths_of(arrays(*AHEAD, *LEFT, car=(30.0, 0.0, 2.0)))[0, 40, 1] == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize(("box", "cost"), [
    ((30.0, HALF_WIDTH_M + 0.99, 0.0, 4.0, 2.0), 12.0),
    ((30.0, -HALF_WIDTH_M - 0.99, 0.0, 4.0, 2.0), 12.0),
    ((30.0, HALF_WIDTH_M + 1.01, 0.0, 4.0, 2.0), 2.0),
    ((30.0, HALF_WIDTH_M + 1.01, np.pi / 2, 4.0, 2.0), 12.0),  # across the road it reaches further
    ((LOOKED_AT_M + 5.0, 0.0, 0.0, 4.0, 2.0), 2.0),
])  # fmt: skip
def test_a_path_costs_ten_for_what_stands_on_it_and_one_per_metre_beside_it(
    box: tuple[float, ...], cost: float
) -> None:
    path = sampled_path(np.array(((0.0, 0.0), (120.0, 0.0))))
    assert path_cost(path, 2.0, np.array([box])) == pytest.approx(cost)


def test_curvature_is_positive_to_the_left_and_costs_a_tenth() -> None:
    angle = np.linspace(0.0, 2.0, 200)
    path = sampled_path(40.0 * np.stack((np.sin(angle), 1.0 - np.cos(angle)), axis=1))
    np.testing.assert_allclose(path[2:75, 3], 1.0 / 40.0, rtol=0.05)
    np.testing.assert_allclose(path[1:75, 2], np.arange(1.0, 75.0) / 40.0, atol=0.01)
    assert path_cost(path, 0.0, np.zeros((0, 5))) == pytest.approx(0.1 / 40.0, rel=0.1)
