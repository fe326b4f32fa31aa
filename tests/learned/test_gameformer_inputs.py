"""GameFormer's inputs and targets, by hand: which rows, signs, units, frames."""

from __future__ import annotations

import numpy as np
import pytest
from tiny_dataset import empty_sample

from interplan_learned.gameformer.inputs import SIZES, inputs
from interplan_learned.scene import AGENT_CHANNELS, FIELDS, LANE_CHANNELS, scene_futures, thinned
from interplan_sumo.features.schema import channel_index
from interplan_sumo.features.view import Arrays

SIZE = SIZES["compact"].scene
X, Y, LENGTH = (AGENT_CHANNELS.index(name) for name in ("x", "y", "length"))


@pytest.fixture
def given() -> Arrays:
    return empty_sample(*FIELDS, "agent_futures", "ego_future")


def put_agents(given: Arrays, *places: tuple[float, float], kind: str = "is_car") -> None:
    """Standing agents of increasing length, 1 m, 2 m ..., in the given order."""
    for row, (x_m, y_m) in enumerate(places):
        values = {"x": x_m, "y": y_m, "length": row + 1.0, "width": 2.0, kind: 1.0, "valid": 1.0}
        for name, value in values.items():
            given["agents"][0, row, :, channel_index("agents", name)] = value
        given["agent_futures"][0, row, :, 0] = x_m
        given["agent_futures"][0, row, :, 3] = 1.0


def test_of_the_ego_it_sees_pose_velocity_and_acceleration_at_five_hertz_oldest_first(given: Arrays) -> None:
    given["ego_history"][0] = np.arange(21)[:, None] + np.arange(10) / 100.0
    ego = inputs(given, "compact")["ego"][0]
    assert ego.shape == (11, 7)
    np.testing.assert_allclose(ego[:, 0], np.arange(0, 21, 2))
    np.testing.assert_allclose(ego[-1], 20.0 + np.arange(7) / 100.0, rtol=1e-6)
    assert inputs(given, "published")["ego"].shape == (1, 21, 7)


def test_of_agents_it_sees_the_nearest_that_are_not_far_behind(given: Arrays) -> None:
    put_agents(given, (3.0, 1.0), (-5.9, 0.0), (-6.1, 0.0), (8.0, -2.0), (0.0, 59.9), (0.0, 60.1))
    agents = inputs(given, "compact")["agents"][0]
    assert agents.shape == (8, 11, 11)
    assert agents[:, -1, LENGTH].tolist() == [1.0, 2.0, 4.0, 5.0, 0.0, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(agents[2, -1, [X, Y]], (8.0, -2.0))
    assert not agents[4:].any()


def test_an_agent_keeps_its_signs_and_its_past(given: Arrays) -> None:
    row = {"x": 10.0, "y": 3.0, "yaw": np.pi, "vx": -5.0, "vy": 0.5, "yaw_rate": -0.1, "length": 9.0, "width": 2.5}
    for name, value in {**row, "is_long_vehicle": 1.0, "valid": 1.0}.items():
        given["agents"][0, 0, 10:, channel_index("agents", name)] = value  # seen for a second
    agents = inputs(given, "compact")["agents"][0, 0]
    np.testing.assert_allclose(agents[-1], [*row.values(), 1.0, 0.0, 0.0], rtol=1e-6)
    np.testing.assert_array_equal(agents.any(axis=1), np.arange(11) >= 5)


@pytest.mark.parametrize(
    ("kind", "bits"),
    [("is_car", (1, 0, 0)), ("is_long_vehicle", (1, 0, 0)), ("is_pedestrian", (0, 1, 0)), ("is_bicycle", (0, 0, 1))],
)
def test_there_are_three_classes(given: Arrays, kind: str, bits: tuple[int, ...]) -> None:
    put_agents(given, (5.0, 0.0), kind=kind)
    np.testing.assert_array_equal(inputs(given, "compact")["agents"][0, 0, -1, -3:], bits)


def test_lanes_keep_both_ends_and_their_light_far_ones_are_left_out_and_the_route_is_shown_as_it_is(
    given: Arrays,
) -> None:
    for row, begins_m in enumerate((-20.0, 59.0, 61.0)):
        given["lanes"][0, row, :, 0] = begins_m + np.linspace(0.0, 49.0, 50)
        given["lanes"][0, row, :, 2] = 0.1
        given["lanes"][0, row, :, channel_index("lanes", "light_red")] = 1.0
        given["lanes_valid"][0, row] = True
    lanes = inputs(given, "compact")["lanes"][0]
    assert lanes.shape == (30, 10, 7)
    assert (lanes[0, 0, 0], lanes[0, -1, 0]) == (-20.0, 29.0)
    np.testing.assert_allclose(lanes[0, 3, 2:], (0.1, 0, 0, 1, 0), rtol=1e-6)
    assert LANE_CHANNELS[3:] == ("light_green", "light_yellow", "light_red", "light_none")
    assert lanes.any(axis=(1, 2)).tolist() == [True, True, *[False] * 28]
    given = empty_sample(*FIELDS, "agent_futures", "ego_future")
    given["route_lanes"][0, 0, :, 0] = np.linspace(70.0, 119.0, 50)
    route = inputs(given, "compact")["route_lanes"][0]
    assert route.shape == (10, 10, 3)
    assert (route[0, 0, 0], route[0, -1, 0]) == (70.0, 119.0)


def test_crosswalks_know_which_way_their_outline_runs(given: Arrays) -> None:
    corners = np.array(((10.0, -2.0), (14.0, -2.0), (14.0, 2.0), (10.0, 2.0), (10.0, -2.0)))
    given["crosswalks"][0, 0] = np.stack(
        [np.interp(np.arange(20) * 0.8, (0, 4, 8, 12, 16), corners[:, axis]) for axis in (0, 1)], axis=1
    )
    crosswalk = inputs(given, "compact")["crosswalks"][0, 0]
    assert crosswalk.shape == (10, 3)
    assert crosswalk[0].tolist() == [10.0, -2.0, 0.0]
    assert crosswalk[3, 2] == pytest.approx(np.pi / 2, abs=1e-6)  # 4.8 m along it: up the far side


def test_futures_belong_to_the_agents_in_the_order_of_the_inputs(given: Arrays) -> None:
    put_agents(given, (-7.0, 0.0), (9.0, 0.0), (12.0, 0.0))
    given["agent_futures"][0, 2, 40:] = 0.0  # leaves after 4 s
    given["ego_future"][0, :, 0] = np.arange(1, 81)
    given["ego_future"][0, :, 3] = 1.0
    futures, valid = scene_futures(given, SIZE)
    assert futures.shape == (1, 9, 16, 3)
    np.testing.assert_array_equal(futures[0, 0, :, 0], np.arange(5, 81, 5))  # every half second
    assert futures[0, 1:3, 0, 0].tolist() == [9.0, 12.0]
    assert valid[0].sum(axis=1).tolist() == [16, 16, 8, 0, 0, 0, 0, 0, 0]


def test_what_is_thinned_gives_the_same_and_holds_on_to_nothing(given: Arrays) -> None:
    rng = np.random.default_rng(0)
    for name, values in given.items():
        given[name] = rng.normal(0.0, 20.0, values.shape).astype(values.dtype)
    small = thinned(given, SIZE)
    for name, values in inputs(given, "compact").items():
        np.testing.assert_array_equal(inputs(small, "compact")[name], values)
    for name in ("agents", "agent_futures", "lanes", "crosswalks", "route_lanes", "lanes_valid"):
        assert not np.shares_memory(small[name], given[name]), name
    assert sum(values.nbytes for values in small.values()) < 30_000
