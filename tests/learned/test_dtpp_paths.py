"""DTPP's reference paths by hand: which lanes they follow, where they lead, and which come first."""

from __future__ import annotations

import numpy as np
import pytest

from interplan_learned.dtpp.paths import LOOKED_AT_M, PATHS, POINTS, path_cost, reference_paths, sampled_path
from interplan_sumo.features.schema import channel_index
from interplan_sumo.features.view import Arrays
from interplan_sumo.world.ego import PACIFICA

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
