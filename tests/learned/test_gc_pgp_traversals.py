"""GC-PGP between its networks: traversals, the route mask, clusters and their ranks, headings."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from interplan_learned.gc_pgp.clusters import chosen, clusters, means, ranks
from interplan_learned.gc_pgp.headings import with_headings
from interplan_learned.gc_pgp.local_graph import NONE
from interplan_learned.gc_pgp.sizes import PATH_NODES
from interplan_learned.gc_pgp.traversals import chances, sampled

# 0 -> 1 -> 3 and 0 -> 2 -> 3; 3 is the end of the road
EDGES = np.array([[[1, 2], [3, NONE], [3, NONE], [NONE, NONE]]])
OPEN = EDGES != NONE
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
    found = paths(sampled(chances(scores(np.log(3.0)), OPEN), EDGES, START, draws(2000)))
    assert {tuple(path) for path in found} == {(0, 1, 3), (0, 2, 3)}
    assert 0.72 < np.mean([path[1] == 1 for path in found]) < 0.78


def test_a_traversal_ends_where_it_chooses_to_and_a_circle_after_sixteen_nodes() -> None:
    found = paths(sampled(chances(scores(end=50.0), OPEN), EDGES, START, draws(10)))
    assert found == [[0]] * 10
    circle = np.array([[[1], [0]]])
    chance = chances(np.array([[[0.0, NEVER], [0.0, NEVER]]]), circle != NONE)
    (path,) = paths(sampled(chance, circle, np.array([[True, False]]), draws(1)))
    assert path == [0, 1] * 8


def test_starts_are_alike_and_without_one_a_traversal_is_empty() -> None:
    starts = np.array([[True, False, True, False]])
    first = sampled(chances(scores(), OPEN), EDGES, starts, draws(1000))[0, :, 0]
    assert set(first.tolist()) == {0, 2}
    assert 450 < np.count_nonzero(first == 0) < 550
    assert (sampled(chances(scores(), OPEN), EDGES, ~START & START, draws(5)) == NONE).all()


@given(st.integers(0, 1000))
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
