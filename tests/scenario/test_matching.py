"""Matching: recorded paths follow connected lanes, through junctions and lane changes, however noisy they are."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_sumo.scenario.matching import REACH_M, matched_path, matches
from interplan_sumo.tiny_worlds import junction, straight_road
from interplan_sumo.world.roads import Roads
from tests.scenario.made_recordings import poses_along, turn_through

CUT = straight_road(lanes=2, length_m=120.0, cuts_m=((50.0, 60.0),))
"""Lanes 11 and 12, connectors 21 and 22, lanes 31 and 32."""


def is_connected(roads: Roads, chain: tuple[str, ...]) -> bool:
    for here, there in pairwise(chain):
        beside = {lane.id for lane in (roads.left_of(here), roads.right_of(here)) if lane is not None}
        if there not in roads.outgoing(here) and there not in beside:
            return False
    return True


def test_a_straight_path_follows_its_lane_and_connector() -> None:
    path = matched_path(CUT, poses_along(((20.0, 0.3), (100.0, 0.3)), 10.0, 80))
    assert path is not None
    assert path.chain == ("11", "21", "31")
    assert path.is_whole
    assert (path.first.lane, path.first.arc_m, path.first.left_m) == ("11", pytest.approx(20.0), pytest.approx(0.3))
    assert path.last.arc_m == pytest.approx(39.0)


def test_a_lane_change_is_a_step_to_the_neighbour() -> None:
    path = matched_path(CUT, poses_along(((10.0, 0.0), (20.0, 0.0), (40.0, -3.5), (100.0, -3.5)), 10.0, 95))
    assert path is not None
    assert path.chain == ("11", "12", "22", "32")


def test_a_standing_car_is_on_the_nearest_lane() -> None:
    path = matched_path(CUT, poses_along(((20.0, -3.0),), 0.0, 30))
    assert path is not None
    assert path.chain == ("12",)


@pytest.mark.parametrize(("y_m", "found"), [(REACH_M - 0.01, True), (REACH_M + 0.01, False)])
def test_a_lane_is_matched_up_to_its_reach(y_m: float, found: bool) -> None:
    assert bool(matches(CUT, np.array((20.0, y_m, 0.0)))) is found


@pytest.mark.parametrize(("turned_deg", "found"), [(59.0, True), (61.0, False), (180.0, False)])
def test_a_lane_is_matched_only_by_who_heads_its_way(turned_deg: float, found: bool) -> None:
    assert bool(matches(CUT, np.array((20.0, 0.0, np.radians(turned_deg))))) is found


def test_a_path_beside_all_lanes_is_none_and_one_that_leaves_them_is_followed_up_to_there() -> None:
    assert matched_path(CUT, poses_along(((20.0, 30.0), (60.0, 30.0)), 10.0, 40)) is None
    path = matched_path(CUT, poses_along(((20.0, 0.0), (40.0, 0.0), (40.0, 60.0)), 10.0, 70))
    assert path is not None
    assert not path.is_whole
    assert path.chain == ("11",)
    assert path.last.arc_m == pytest.approx(40.0, abs=1.1)


CROSSING = junction()


@pytest.mark.parametrize("connector", sorted(CROSSING.connectors))
def test_every_turn_of_a_junction_is_told_apart_from_the_others(connector: str) -> None:
    way = CROSSING.connectors[connector]
    path = matched_path(CROSSING, turn_through(CROSSING, connector))
    assert path is not None
    assert path.chain == (way.from_lane_id, connector, way.to_lane_id)


@settings(max_examples=40)
@given(
    connector=st.sampled_from(sorted(CROSSING.connectors)),
    off_m=st.floats(-1.2, 1.2),
    seed=st.integers(0, 2**32 - 1),
)
def test_noise_never_breaks_the_chain(connector: str, off_m: float, seed: int) -> None:
    poses = turn_through(CROSSING, connector).copy()
    rng = np.random.default_rng(seed)
    poses[:, 0] -= off_m * np.sin(poses[:, 2])
    poses[:, 1] += off_m * np.cos(poses[:, 2])
    poses += rng.normal(0.0, (0.15, 0.15, 0.05), poses.shape)
    path = matched_path(CROSSING, poses)
    assert path is not None
    assert is_connected(CROSSING, path.chain)
    assert len(set(path.chain)) == len(path.chain)
