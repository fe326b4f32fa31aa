"""UrbanDriver's inputs, by hand: signs, frames, kinds, which lines are kept and what is masked."""

from __future__ import annotations

import numpy as np
import pytest
from tiny_dataset import empty_sample, samples_of

from interplan_learned.card import Size
from interplan_learned.urban_driver.planner import FIELDS, POINTS, SIZES, VEHICLE_CHANNELS, inputs, thinned
from interplan_sumo import tiny_worlds
from interplan_sumo.features.schema import channel_index
from interplan_sumo.features.view import Arrays, EgoView

COMPACT = SIZES["compact"]
FIRST = {name: sum(n for _, n in COMPACT.lines[:k]) for k, (name, _) in enumerate(COMPACT.lines)}
"""Row of `lines` in which a kind begins."""


def arrays() -> Arrays:
    """One sample without anything in it but an ego that stands."""
    made = empty_sample(*FIELDS)
    made["ego_history_valid"][:] = True
    return made


def lane(given: Arrays, row: int, left_m: float, on_route: bool = False, light: str = "light_none") -> None:
    """A straight lane of 3 m width towards +x, 49 m from beside the ego on."""
    along_m = np.linspace(0.0, 49.0, 50)
    piece = given["lanes"][0, row]
    piece[:, 0], piece[:, 1] = along_m, left_m
    piece[:, channel_index("lanes", light)] = 1.0
    piece[:, channel_index("lanes", "on_route")] = on_route
    given["lanes_valid"][0, row] = True
    for name, side_m in (("left_boundaries", 1.5), ("right_boundaries", -1.5)):
        given[name][0, row, :, 0], given[name][0, row, :, 1] = np.linspace(0.0, 49.0, POINTS), left_m + side_m


def agent(given: Arrays, row: int, ahead_m: float, kind: str = "is_car", frames: int = 21) -> None:
    """A road user that comes towards the ego at 5 m/s, seen for so many frames."""
    track = given["agents"][0, row, 21 - frames :]
    track[:, 0] = ahead_m + 0.5 * np.arange(frames)[::-1]
    track[:, 2], track[:, 3], track[:, 5], track[:, 6], track[:, 7] = np.pi, -5.0, 0.1, 4.8, 2.0
    track[:, channel_index("agents", kind)] = track[:, channel_index("agents", "valid")] = 1.0


def lines_of(given: Arrays, kind: str) -> np.ndarray:
    """The valid rows of a kind."""
    found, rows = inputs(given, "compact"), slice(FIRST[kind], FIRST[kind] + dict(COMPACT.lines)[kind])
    return found["lines"][0, rows][found["lines_valid"][0, rows]]


def test_the_past_is_five_poses_the_present_first_and_what_is_not_known_is_masked() -> None:
    given = arrays()
    given["ego_history"][0, :, 0] = np.arange(-20, 1)  # a metre per frame
    given["ego_history"][0, :, 1], given["ego_history"][0, :, 2] = 0.5, -0.1
    given["ego_history"][0, :, 3:] = 9.0  # velocities and the like are not looked at
    ego = inputs(given, "compact")["ego"][0]
    np.testing.assert_allclose(ego, [(x, 0.5, -0.1) for x in (0, -4, -8, -12, -16)], rtol=1e-6)
    given = arrays()
    given["ego_history"][0, :, 0] = 7.0
    given["ego_history_valid"][0, :12] = False
    found = inputs(given, "compact")
    assert found["ego_valid"][0].tolist() == [True, True, True, False, False]
    assert found["ego"][0, :, 0].tolist() == [7.0, 7.0, 7.0, 0.0, 0.0]


def test_vehicles_have_their_channels_and_what_was_not_seen_of_them_is_masked() -> None:
    given = arrays()
    agent(given, 0, 20.0, frames=9)
    found = inputs(given, "compact")
    assert found["vehicles_valid"][0, 0].tolist() == [True, True, True, False, False]
    vehicle = dict(zip(VEHICLE_CHANNELS, found["vehicles"][0, 0].T.tolist(), strict=True))
    assert vehicle["x"] == [20.0, 22.0, 24.0, 0.0, 0.0]
    now = [vehicle[name][0] for name in VEHICLE_CHANNELS]
    np.testing.assert_allclose(now, (20.0, 0.0, np.pi, -5.0, 0.0, 0.1, 4.8, 2.0), rtol=1e-6)
    assert not found["vehicles_valid"][0, 1:].any()


def test_only_vehicles_are_seen_and_no_more_than_there_is_room_for() -> None:
    given = arrays()
    kinds = ("is_pedestrian", "is_long_vehicle", "is_bicycle", "is_car")
    for row in range(24):
        agent(given, row, 5.0 + row, kinds[row % 4])
    found = inputs(given, "compact")
    assert found["vehicles"][0, :, 0, 0].tolist() == [*(5.0 + row for row in range(1, 24, 2)), *[0.0] * 4]
    for row in range(24, 30):
        agent(given, row, 5.0 + row)
    assert inputs(given, "compact")["vehicles_valid"].all()
    assert inputs(given, "compact")["vehicles"][0, -1, 0, 0] == 32.0


def test_a_lane_has_twenty_points_and_its_light_and_boundaries_beside_it_without_one() -> None:
    given = arrays()
    lane(given, 0, -3.0, light="light_red")
    (piece,) = lines_of(given, "lanes")
    assert piece.shape == (POINTS, 6)
    assert (piece[0, 0], piece[-1, 0]) == (0.0, 49.0)
    assert np.diff(piece[:, 0]).max() <= 3.0
    assert np.unique(piece[:, 1:], axis=0).tolist() == [[-3.0, 0.0, 0.0, 1.0, 0.0]]  # y, green, yellow, red, none
    given = arrays()
    lane(given, 0, 2.0)
    for kind, y_m in (("left_boundaries", 3.5), ("right_boundaries", 0.5)):
        (line,) = lines_of(given, kind)
        assert np.unique(line[:, 1:], axis=0).tolist() == [[y_m, 0.0, 0.0, 0.0, 0.0]]


def test_lanes_of_the_route_are_shown_once_more_without_their_light() -> None:
    given = arrays()
    lane(given, 0, 0.0, on_route=True, light="light_green")
    lane(given, 1, -3.0)
    lane(given, 2, 3.0, on_route=True)
    assert lines_of(given, "lanes")[:, 0, 1].tolist() == [0.0, -3.0, 3.0]
    route = lines_of(given, "route_lanes")
    assert route[:, 0, 1].tolist() == [0.0, 3.0]
    assert not route[..., 2:].any()


@pytest.mark.parametrize(("left_m", "kept"), [(34.9, 1), (35.1, 0)])
def test_lines_further_than_35_m_away_are_left_out(left_m: float, kept: int) -> None:
    given = arrays()
    lane(given, 0, left_m, on_route=True)
    for kind in ("lanes", "left_boundaries", "right_boundaries", "route_lanes"):
        assert len(lines_of(given, kind)) == kept
    for kind in ("stop_lines", "crosswalks"):
        given[kind][0, 0], given[f"{kind}_valid"][0, 0] = (40.0, 40.0), True
        given[kind][0, 0, 7] = (0.0, -left_m)  # one corner is nearer
        assert len(lines_of(given, kind)) == kept


def test_of_more_lines_than_there_is_room_for_the_nearest_are_kept() -> None:
    given = arrays()
    for row in range(30):
        lane(given, row, float(row), on_route=row >= 15)
    assert lines_of(given, "lanes")[:, 0, 1].tolist() == list(range(COMPACT.lanes))
    assert lines_of(given, "route_lanes")[:, 0, 1].tolist() == list(range(15, COMPACT.pieces))


def test_empty_rows_are_zero_whatever_they_held() -> None:
    given = arrays()
    given["agents"][..., :8] = 1.0
    for name in ("lanes", "left_boundaries", "stop_lines"):
        given[name][:] = 1.0
    found = inputs(given, "compact")
    assert not found["lines"].any()
    assert not found["lines_valid"].any()
    assert not found["vehicles"].any()


@pytest.mark.parametrize(("size", "rows", "vehicles"), [("compact", 62, 16), ("published", 160, 30)])
def test_sizes_have_as_many_rows_as_they_say_and_thinned_samples_give_the_same(
    size: Size, rows: int, vehicles: int
) -> None:
    samples = samples_of("left", 8.0)
    less, found = thinned(samples, size), inputs(samples, size)
    assert found["lines"].shape[1:] == (rows, POINTS, 6)
    assert found["vehicles"].shape[1:] == (vehicles, 5, 8)
    for name, values in inputs(less, size).items():
        np.testing.assert_array_equal(values, found[name])
    for name, values in less.items():
        assert not np.shares_memory(values, samples[name]) or values.nbytes == samples[name].nbytes


def test_in_a_world_left_is_positive_and_the_light_is_that_of_its_connector() -> None:
    roads = tiny_worlds.junction()
    view = EgoView(tiny_worlds.mission(roads, ["1", "14", "8"]))  # from the west, to the north: a left turn
    seen = tiny_worlds.observation(
        tiny_worlds.ego_on(roads, "1", 55.0, 5.0),
        tiny_worlds.cars((-10.0, 1.75, 4.0, np.pi)),  # comes out of the junction, on our left
        tiny_worlds.signals(red=["13"], green=["14"]),
    )
    given = {name: values[None] for name, values in view.arrays(seen).items()}
    found = inputs(given, "compact")
    x, y, yaw, vx = found["vehicles"][0, 0, 0, :4]
    assert x > 0.0
    assert y == pytest.approx(3.5, abs=1e-5)
    assert abs(yaw) == pytest.approx(np.pi, abs=1e-5)
    assert vx == pytest.approx(-4.0, abs=1e-5)
    lanes = lines_of(given, "lanes")
    (red,) = lanes[lanes[:, 0, 4] == 1.0]
    (green,) = lanes[lanes[:, 0, 2] == 1.0]
    np.testing.assert_allclose(red[:, 1], 0.0, atol=1e-4)  # straight on
    assert green[-1, 1] > 10.0  # to the left
    assert len(lines_of(given, "stop_lines")) == 4
    assert any(np.allclose(green[:, :2], line[:, :2]) for line in lines_of(given, "route_lanes"))
