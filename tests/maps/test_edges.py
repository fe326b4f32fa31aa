"""Lane groups become edges whose lanes stay side by side, and nothing of a lane is lost."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_sumo.maps.edges import CUT_M, MISALIGNED_M, LaneGroup, lane_group
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import DrivingSide, Roads
from tests.maps.road_worlds import beside, small_roads, straight


def group(
    lines: list[Floats], side: DrivingSide = "right", start: str = "a", end: str = "b"
) -> tuple[Roads, LaneGroup]:
    roads = small_roads({"1": lines}, side=side)
    return roads, lane_group(roads, roads.roadblocks["1"], start, end)


def assert_whole(roads: Roads, found: LaneGroup) -> None:
    """Edges and cuts together cover every lane once, in order, and fit together."""
    for lane in roads.lanes.values():
        stretches = [s for e in found.edges for s in e.lanes if s.lane_id == lane.id]
        stretches += [j.stretch for j in found.joins if j.stretch.lane_id == lane.id]
        stretches.sort(key=lambda s: s.start_m)
        assert stretches[0].start_m == 0.0
        assert stretches[-1].end_m == pytest.approx(lane.centerline.length_m)
        for a, b in pairwise(stretches):
            assert a.end_m == pytest.approx(b.start_m)
        assert all(s.length_m > 0.0 for s in stretches)
    assert all(edge.from_node != edge.to_node for edge in found.edges)
    edges = {edge.id: edge for edge in found.edges}
    assert len(edges) == len(found.edges)
    for join in found.joins:
        assert edges[join.from_edge].to_node == join.node == edges[join.to_edge].from_node
        assert edges[join.from_edge].lanes[join.from_lane].end_m == pytest.approx(join.stretch.start_m)


def test_parallel_lanes_are_one_edge_numbered_from_the_kerb() -> None:
    lines = [beside(straight((0, 0), (100, 0)), 3.5 * k) for k in range(3)]
    assert [s.lane_id for s in group(lines, "right")[1].edges[0].lanes] == ["12", "11", "10"]
    assert [s.lane_id for s in group(lines, "left")[1].edges[0].lanes] == ["10", "11", "12"]


@pytest.mark.parametrize("length_m", [0.1, 0.199, 0.2, 0.41, 3.0])
def test_a_lane_that_comes_back_to_its_junction_is_two_edges_however_short(length_m: float) -> None:
    roads, found = group([straight((0, 0), (length_m, 0))], start="a", end="a")
    assert len(found.edges) == 2
    assert_whole(roads, found)


def test_a_bend_after_a_straight_is_cut_where_the_lanes_would_drift_apart() -> None:
    angle = np.linspace(0.0, np.pi / 2, 40)
    bend = np.stack((100 + 20 * np.sin(angle), 20 - 20 * np.cos(angle)), axis=1)
    lines = [beside(np.concatenate((straight((0, 0), (100, 0)), bend[1:])), 3.5 * k) for k in range(3)]
    roads, found = group(lines)
    assert len(found.edges) > 1
    assert_whole(roads, found)
    cross_sections = [edge.lanes[0].end_m for edge in found.edges[:-1]]
    assert any(abs(at - 100.0) < 6.0 for at in cross_sections)
    # along each edge, equal shares of the lanes lie beside one another
    for edge in found.edges:
        for a, b in zip(edge.lanes, edge.lanes[1:], strict=False):
            for share in np.linspace(0.0, 1.0, 9):
                poses = [roads.lanes[s.lane_id].centerline.pose_at(s.start_m + share * s.length_m) for s in (a, b)]
                along = np.array([np.cos(poses[0].heading_rad), np.sin(poses[0].heading_rad)])
                apart = along @ np.array([poses[1].x_m - poses[0].x_m, poses[1].y_m - poses[0].y_m])
                assert abs(apart) < 2 * MISALIGNED_M


def test_a_plain_arc_needs_no_cut() -> None:
    angle = np.linspace(0.0, np.pi / 2, 60)
    arc = np.stack((40 * np.sin(angle), 40 - 40 * np.cos(angle)), axis=1)
    assert len(group([beside(arc, 3.5 * k) for k in range(2)])[1].edges) == 1


def test_slightly_ragged_ends_are_spread_over_a_taper() -> None:
    lines = [straight((0, 0), (200, 0)), straight((3, -3.5), (200, -3.5))]
    roads, found = group(lines)
    assert_whole(roads, found)
    assert len(found.edges) == 2
    lengths = [s.length_m for s in found.edges[0].lanes]
    assert max(lengths) / min(lengths) < 1.06
    assert found.edges[1].lanes[0].length_m == pytest.approx(found.edges[1].lanes[1].length_m, abs=0.01)


def test_a_lane_that_begins_or_ends_far_beyond_the_others_has_edges_of_its_own_there() -> None:
    lines = [straight((0, 0), (105, 0)), straight((0, -3.5), (92, -3.5)), straight((25, -7), (80, -7))]
    roads, found = group(lines)
    assert_whole(roads, found)
    common = [edge for edge in found.edges if len(edge.lanes) == 3]
    assert len(common) == 1
    assert {s.start_m for s in common[0].lanes} == {0.0, 25.0 + CUT_M / 2}
    assert found.first["12"] == (common[0].id, 0)
    assert found.first["10"][0] != common[0].id


def test_lanes_that_never_run_side_by_side_are_edges_of_their_own() -> None:
    roads, found = group([straight((0, 0), (40, 0)), straight((60, -3.5), (90, -3.5))])
    assert_whole(roads, found)
    assert all(len(edge.lanes) == 1 for edge in found.edges)


@settings(max_examples=25)
@given(
    st.integers(1, 5),
    st.floats(5.0, 200.0),
    st.lists(st.floats(0.0, 30.0), min_size=10, max_size=10),
    st.sampled_from(["a", "b"]),
)
def test_nothing_is_lost_whatever_the_ends(count: int, length_m: float, ragged: list[float], end: str) -> None:
    lines = [straight((ragged[k], -3.5 * k), (ragged[k] + length_m + ragged[5 + k], -3.5 * k)) for k in range(count)]
    roads, found = group(lines, end=end)
    assert_whole(roads, found)
