"""GC-PGP by hand: the lane graph around an ego, traversals of it, the route mask, clusters and headings."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import pi

import numpy as np
import pytest
from hypothesis import given as any_of
from hypothesis import strategies as st

from interplan_learned.driving import one_sample
from interplan_learned.gc_pgp.inputs import POLICY_INPUTS, inputs, kept
from interplan_learned.gc_pgp.local_graph import NONE, local_graph, nodes_of, off_and_turned, start_nodes
from interplan_learned.gc_pgp.plans import chances, chosen, clusters, means, ranks, sampled, with_headings
from interplan_learned.gc_pgp.sizes import EDGES, PATH_NODES, SIZES
from interplan_sumo import tiny_worlds
from interplan_sumo.features.frame import EgoFrame
from interplan_sumo.features.lane_graph import PROXIMAL, SUCCESSOR
from interplan_sumo.features.view import Arrays, EgoView
from interplan_sumo.planner import Observation
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import wrap_angle
from interplan_sumo.world.roads import Roads

COMPACT = SIZES["compact"]
AHEAD_M = PACIFICA.rear_axle_to_center_m


def two_lanes() -> Roads:
    """100 m towards +x: nodes 0 to 4 on the x axis, 5 to 9 on the lane to the right, 20 m each."""
    return tiny_worlds.straight_road(lanes=2, length_m=100.0)


def rear_at(x_m: float, y_m: float, speed_mps: float = 5.0, heading_rad: float = 0.0) -> Observation:
    """Seen by an ego with its rear axle at a point."""
    x_m, y_m = x_m + AHEAD_M * np.cos(heading_rad), y_m + AHEAD_M * np.sin(heading_rad)
    return tiny_worlds.observation(tiny_worlds.ego(x_m, y_m, speed_mps, heading_rad, time_s=2.0))


def held(roads: Roads, lanes: list[str], observation: Observation) -> Arrays:
    arrays = EgoView(tiny_worlds.mission(roads, lanes)).arrays(observation)
    return kept(one_sample(arrays), [nodes_of(roads, COMPACT.points)], COMPACT)


def rows_of(found: Arrays) -> list[int]:
    return found["node_rows"][0, found["node_valid"][0]].tolist()


def named_edges(found: Arrays, node: int) -> dict[int, int]:
    """Nodes of the map that edges out of one lead to, and the kinds of these."""
    rows = rows_of(found)
    row = rows.index(node)
    pairs = zip(found["edges"][0, row].tolist(), found["edge_kinds"][0, row].tolist(), strict=True)
    return {rows[target]: kind for target, kind in pairs if target != NONE}


def test_nodes_come_by_the_edges_it_takes_to_get_there_on_and_to_the_lane_beside() -> None:
    found = held(two_lanes(), ["11"], rear_at(30.0, 0.0))
    # 1 is under the ego; 6 beside it, 2 ahead; 7, 3; 8, 4; 9; behind and out of reach: 0, 5
    assert rows_of(found) == [1, 6, 2, 7, 3, 8, 4, 9, 0, 5]
    assert not found["node_valid"][0, 10:].any()
    assert (found["edges"][0, 10:] == NONE).all()
    assert named_edges(found, 1) == {2: SUCCESSOR, 6: PROXIMAL}
    assert named_edges(found, 7) == {8: SUCCESSOR, 2: PROXIMAL}
    assert named_edges(found, 4) == {9: PROXIMAL}  # the road ends
    adjacent = inputs(found)["adjacent"][0]
    rows = rows_of(found)
    one = rows.index(1)
    assert {rows[row] for row in np.flatnonzero(adjacent[one])} == {0, 1, 2, 6}
    np.testing.assert_array_equal(adjacent, adjacent.T)


def test_where_there_is_no_room_lanes_of_the_route_and_nodes_that_can_be_reached_stay() -> None:
    roads = two_lanes()
    graph = local_graph(
        nodes_of(roads, 10), EgoFrame(30.0, 0.0, 0.0), np.array([11, 12]), np.array([11, 12]), count=3
    )  # fmt: skip
    assert graph.rows.tolist() == [1, 6, 2]
    assert graph.targets[0, :2].tolist() == [2, 1]
    assert (graph.targets[1, :2] == [NONE, 0]).all()  # on to 7, which is gone; back to 1
    graph = local_graph(nodes_of(roads, 10), EgoFrame(30.0, 0.0, 0.0), np.array([11, 12]), np.array([12]), count=4)
    assert graph.rows.tolist() == [6, 7, 8, 9]


def test_the_window_ends_80_m_ahead_and_20_m_behind() -> None:
    roads = tiny_worlds.straight_road(length_m=200.0)
    assert rows_of(held(roads, ["11"], rear_at(100.0, 0.0))) == [4, 5, 6, 7, 8, 9, 3]  # 9 begins 80 m ahead
    assert 9 not in rows_of(held(roads, ["11"], rear_at(99.0, 0.0)))


@pytest.mark.parametrize(
    ("left_m", "turned_rad", "starts"), [(-2.9, 0.0, True), (-3.1, 0.0, False), (0.0, 0.78, True), (0.0, 0.79, False)]
)
def test_traversals_start_within_3_m_and_45_degrees(left_m: float, turned_rad: float, starts: bool) -> None:
    frame = EgoFrame(10.0, left_m, turned_rad)
    poses = frame.poses(np.stack((np.linspace(0.0, 20.0, 10), np.zeros(10), np.zeros(10)), axis=1))
    other = poses + np.array((0.0, 50.0, 0.0))
    off_m, turned = off_and_turned(np.stack((other, poses)))
    np.testing.assert_allclose((off_m[1], turned[1]), (abs(left_m), turned_rad), atol=1e-9)
    close = (off_m <= 3.0) & (turned <= pi / 4)
    assert bool(close[1]) is starts
    assert start_nodes(off_m, turned).tolist() == [False, True]  # the nearest one where none is close enough


def test_points_of_nodes_are_in_the_ego_frame_also_when_it_starts_elsewhere() -> None:
    found = inputs(held(two_lanes(), ["11"], rear_at(30.0, 0.0)))["nodes"][0]
    np.testing.assert_allclose(found[0, (0, -1), :3], ((-10.0, 0.0, 0.0), (10.0, 0.0, 0.0)), atol=1e-5)
    np.testing.assert_allclose(found[1, 0, :3], (-10.0, -3.5, 0.0), atol=1e-5)
    turned = inputs(held(two_lanes(), ["11"], rear_at(30.0, 0.0, heading_rad=pi / 2)))["nodes"][0]
    under = np.abs(turned[:, 0, :2] - (0.0, 10.0)).sum(axis=1).argmin()  # node 1 begins to the left
    np.testing.assert_allclose(turned[under, -1, :3], (0.0, -10.0, -pi / 2), atol=1e-5)
    roads = tiny_worlds.curved_road(radius_m=50.0)
    nodes = nodes_of(roads, COMPACT.points)
    found = held(roads, ["11"], rear_at(30.0, 0.0, heading_rad=0.2))
    found["origin"] = np.array([[31.0, -0.5, 3.0]])
    moved = inputs(found)["nodes"][0, found["node_valid"][0], :, :3]
    wanted = EgoFrame(31.0, -0.5, 3.0).poses(nodes.poses[rows_of(found)])
    np.testing.assert_allclose(moved[..., :2], wanted[..., :2], atol=1e-4)
    np.testing.assert_allclose(wrap_angle(moved[..., 2] - wanted[..., 2]), 0.0, atol=1e-5)


def test_lights_stop_lines_and_the_route_mark_nodes() -> None:
    roads = tiny_worlds.junction()
    seen = replace(rear_at(-50.0, -1.75), signals=tiny_worlds.signals(red=["13"], green=["14"]))
    found = held(roads, ["1", "13", "7"], seen)
    given = inputs(found)
    rows = rows_of(found)
    nodes = nodes_of(roads, COMPACT.points)
    lanes = nodes.lane_ids[rows]
    red, on_route = found["node_red"][0, : len(rows)], found["node_on_route"][0, : len(rows)]
    assert set(lanes[red].tolist()) == {13}
    assert set(lanes[on_route].tolist()) == {1, 13, 7}
    last = [row for row, lane in enumerate(lanes) if lane == 1][-1]  # its end is the stop line
    assert given["nodes"][0, last, :, 3].tolist() == [0.0] * 9 + [1.0]
    assert not given["nodes"][0, ..., 4].any()  # no crosswalks
    edges, allowed = given["edges"][0, last], given["allowed"][0, last]
    assert {int(lanes[edge]): bool(ok) for edge, ok in zip(edges, allowed, strict=True) if edge != NONE} == {
        12: False, 13: True, 14: False,
    }  # fmt: skip


def test_on_the_way_into_a_turn_traversals_start_on_the_route() -> None:
    found = held(tiny_worlds.junction(), ["1", "13", "7"], rear_at(-8.0, -1.75))
    given = inputs(found)
    lanes = nodes_of(tiny_worlds.junction(), COMPACT.points).lane_ids[rows_of(found)]
    starts, allowed = (set(lanes[given[name][0, : len(lanes)]].tolist()) for name in ("starts", "allowed_starts"))
    assert starts == {12, 13, 14}  # all three connectors begin there
    assert allowed == {13}
    found["node_on_route"][:] = False  # astray: any start is as good
    astray = inputs(found)
    np.testing.assert_array_equal(astray["allowed_starts"], astray["starts"])


def test_the_ego_is_told_every_second_frame_of_the_past_second() -> None:
    found = held(two_lanes(), ["11"], rear_at(30.0, 0.0))
    history = found["ego_history"]
    history[0] = 0.0
    history[0, :, 0] = np.arange(-20, 1)
    history[0, 10, 1:8] = (1.0, pi / 2, 0.0, 6.0, -0.5, 2.0, 0.1)  # it drove to the left, faster and faster
    found["ego_history_valid"][:] = True
    ego = inputs(found)["ego"][0]
    np.testing.assert_array_equal(ego[:, 0], (-10.0, -8.0, -6.0, -4.0, -2.0, 0.0))
    np.testing.assert_allclose(ego[0], (-10.0, 1.0, 6.0, 2.0, 0.1), rtol=1e-6)
    found["ego_history_valid"][0, :-1] = False
    assert not inputs(found)["ego"][0, :-1].any()


def test_agents_tell_speed_and_acceleration_and_who_walks() -> None:
    seen = replace(
        rear_at(30.0, 0.0),
        actors=tiny_worlds.together(tiny_worlds.cars((38.0, 2.0, 6.0, pi)), tiny_worlds.pedestrians((60.0, 20.0))),
    )
    found = held(two_lanes(), ["11"], seen)
    found["agents"][0, 0, -2] = found["agents"][0, 0, -1]
    found["agents"][0, 0, -2, 3] = -5.0  # 1 m/s slower 0.2 s ago
    given = inputs(found)
    np.testing.assert_allclose(given["agents"][0, 0, -1], (8.0, 2.0, 6.0, 5.0, 0.0, 0.0), atol=1e-5)
    assert not given["agents"][0, 0, 0].any()  # not seen so long
    assert given["agents"][0, 1, -1, 5] == 1.0
    assert given["agents_valid"][0].tolist() == [True, True] + [False] * 14
    rows = rows_of(found)
    near = {node: given["near_agents"][0, row].nonzero()[0].tolist() for row, node in enumerate(rows)}
    assert near[1] == near[2] == near[6] == [0]
    assert near[4] == near[3] == []  # 22 m away; the pedestrian 20 m beside


def test_off_every_road_all_is_empty_but_finite() -> None:
    found = held(two_lanes(), ["11"], rear_at(900.0, 900.0))
    given = inputs(found)
    assert not given["nodes_valid"].any()
    assert not given["starts"].any()
    assert all(np.isfinite(given[name].astype(np.float64)).all() for name in POLICY_INPUTS)
    assert given["edges"].shape == (1, COMPACT.nodes, EDGES)
    assert not start_nodes(np.full(3, np.inf), np.zeros(3)).any()
    assert start_nodes(np.zeros(0), np.zeros(0)).shape == (0,)


# 0 -> 1 -> 3 and 0 -> 2 -> 3; 3 is the end of the road
FORK = np.array([[[1, 2], [3, NONE], [3, NONE], [NONE, NONE]]])
OPEN = FORK != NONE
START = np.array([[True, False, False, False]])
NEVER = -1e9


def scores(first: float = 0.0, second: float = 0.0, end: float = NEVER) -> np.ndarray:
    """Of the edges out of each node, alike for all, and of the end there."""
    return np.broadcast_to(np.array((first, second, end)), (1, 4, 3))


def paths(found: np.ndarray) -> list[list[int]]:
    return [[node for node in path if node != NONE] for path in found[0].tolist()]


def draws(count: int = 200, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).random((1, count, PATH_NODES))


def test_chances_are_those_of_the_edges_that_there_are() -> None:
    found = chances(scores(np.log(3.0), 0.0, 0.0), OPEN)
    np.testing.assert_allclose(found[0, 0], (0.6, 0.2, 0.2))
    np.testing.assert_allclose(found[0, 1], (0.75, 0.0, 0.25))
    np.testing.assert_allclose(found[0, 3], (0.0, 0.0, 1.0))  # only the end is left


def test_traversals_follow_edges_to_the_end_of_the_road_by_their_chances() -> None:
    found = paths(sampled(chances(scores(np.log(3.0)), OPEN), FORK, START, draws(2000)))
    assert {tuple(path) for path in found} == {(0, 1, 3), (0, 2, 3)}
    assert 0.72 < np.mean([path[1] == 1 for path in found]) < 0.78


def test_a_traversal_ends_where_it_chooses_to_and_a_circle_after_sixteen_nodes() -> None:
    found = paths(sampled(chances(scores(end=50.0), OPEN), FORK, START, draws(10)))
    assert found == [[0]] * 10
    circle = np.array([[[1], [0]]])
    chance = chances(np.array([[[0.0, NEVER], [0.0, NEVER]]]), circle != NONE)
    (path,) = paths(sampled(chance, circle, np.array([[True, False]]), draws(1)))
    assert path == [0, 1] * 8


def test_starts_are_alike_and_without_one_a_traversal_is_empty() -> None:
    starts = np.array([[True, False, True, False]])
    first = sampled(chances(scores(), OPEN), FORK, starts, draws(1000))[0, :, 0]
    assert set(first.tolist()) == {0, 2}
    assert 450 < np.count_nonzero(first == 0) < 550
    assert (sampled(chances(scores(), OPEN), FORK, ~START & START, draws(5)) == NONE).all()


@any_of(st.integers(0, 1000))
def test_every_step_is_an_open_edge(seed: int) -> None:
    rng = np.random.default_rng(seed)
    edges = rng.integers(NONE, 8, (1, 8, 4))
    allowed = (edges != NONE) & (rng.random((1, 8, 4)) < 0.7)
    starts = rng.random((1, 8)) < 0.3
    found = sampled(chances(rng.normal(0, 3, (1, 8, 5)), allowed), edges, starts, rng.random((1, 30, PATH_NODES)))
    for path in paths(found):
        assert not path or starts[0, path[0]]
        for here, ahead in pairwise(path):
            assert ahead in edges[0, here][allowed[0, here]]


def straight(*ends_m: tuple[float, float]) -> np.ndarray:
    """(1, T, 16, 2) trajectories to some ends."""
    return np.linspace(0.0, 1.0, 17)[1:, None] * np.array(ends_m)[None, :, None]


def test_trajectories_to_the_same_end_are_of_one_kind_with_its_mean_and_count() -> None:
    kind = clusters(straight((60.0, 0.0), (61.0, 0.0), (30.0, 30.0), (59.0, 0.0), (31.0, 30.0)), 2)[0]
    assert kind[0] == kind[1] == kind[3] != kind[2] == kind[4]
    found, held = means(straight((60.0, 0.0), (62.0, 0.0), (0.0, 8.0)), np.array([[0, 0, 2]]), 3)
    assert held.tolist() == [[2, 0, 1]]
    np.testing.assert_allclose(found[0, :, -1], ((61.0, 0.0), (0.0, 0.0), (0.0, 8.0)))


def test_the_smaller_of_the_cheapest_pair_gets_the_worst_rank_and_empty_ones_come_last() -> None:
    # 1 and 2 m apart: 0 and 1 merge first (5 * 2 / 7 * 1), 1 is lost; then 0 and 2; 3, far and small, is left to last
    places = np.array(((0.0,), (1.0,), (3.0,), (40.0,)))
    assert ranks(places, np.array([5, 2, 4, 3])).tolist() == [1, 4, 3, 2]
    assert ranks(np.array(((0.0,), (0.0,), (9.0,))), np.array([1, 0, 2])).tolist() == [2, 3, 1]
    assert ranks(np.zeros((3, 1)), np.array([0, 4, 0]))[1] == 1


def test_the_mode_ranked_first_is_the_plan_also_where_all_are_alike() -> None:
    ends = [(50.0 + 0.1 * k, 0.0) for k in range(20)] + [(20.0, 20.0 + 0.1 * k) for k in range(5)]
    np.testing.assert_allclose(chosen(straight(*ends), 2)[0, -1], (50.95, 0.0), atol=1e-9)
    np.testing.assert_allclose(chosen(straight(*[(10.0, 1.0)] * 7), 6)[0, -1], (10.0, 1.0))


def test_headings_follow_the_points_and_left_is_positive_and_a_stop_keeps_the_heading() -> None:
    angle = np.linspace(0.0, 1.2, 17)[1:]
    poses = with_headings(30.0 * np.stack((np.sin(angle), 1.0 - np.cos(angle)), axis=1))
    np.testing.assert_allclose(poses[:, 2], angle, atol=0.01)
    np.testing.assert_allclose(with_headings(poses[:, :2] * (1.0, -1.0))[:, 2], -angle, atol=0.01)
    points = np.concatenate((np.linspace(1.0, 8.0, 8)[:, None] * (1.0, 0.2), np.full((8, 2), (8.01, 1.55))))
    poses = with_headings(points)
    np.testing.assert_array_equal(poses[8:, 2], poses[7, 2])
    np.testing.assert_allclose(poses[7, 2], np.arctan(0.2), atol=0.02)


def test_a_car_that_ends_where_it_began_stands() -> None:
    for end_m, stands in ((0.19, True), (0.49, True), (0.51, False)):
        poses = with_headings(np.linspace(0.0, 1.0, 17)[1:, None] * (end_m, 0.0))
        assert (not poses.any()) is stands
    assert not with_headings(np.linspace(0.0, 1.0, 17)[1:, None] * (-5.0, 3.0)).any()  # it cannot drive backwards
    assert not with_headings(np.linspace(0.0, 1.0, 17)[1:, None] * (0.19, 3.0)).any()
    assert with_headings(np.linspace(0.0, 1.0, 17)[1:, None] * (0.21, 3.0)).any()
