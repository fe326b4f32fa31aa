"""Lane graph: lanes as integer tables, and the nodes and edges on them."""

from __future__ import annotations

import numpy as np
import pytest
from worlds import junction, straight_road

from interplan_sumo.features.lane_graph import PROXIMAL, SUCCESSOR, LaneGraph, lane_graph, node_lines

ROAD = straight_road(lanes=2, length_m=100.0, cuts_m=((40.0, 60.0),), limit_mps=None)


def edges(graph: LaneGraph, kind: int) -> set[tuple[int, int]]:
    return {(int(a), int(b)) for a, b in graph.edges[graph.edge_kinds == kind]}


def test_lanes_are_listed_by_id_with_their_neighbours_and_successors() -> None:
    graph = lane_graph(ROAD)
    assert graph.lane_ids.tolist() == [11, 12, 21, 22, 31, 32]
    assert graph.is_connector.tolist() == [False, False, True, True, False, False]
    assert graph.roadblock_ids.tolist() == [1, 1, 2, 2, 3, 3]
    assert graph.left_ids.tolist() == [0, 11, 0, 0, 0, 31]  # connectors have none
    assert graph.right_ids.tolist() == [12, 0, 0, 0, 32, 0]
    assert graph.successors.tolist() == [[11, 21], [12, 22], [21, 31], [22, 32]]
    np.testing.assert_allclose(graph.length_m, (40.0, 40.0, 20.0, 20.0, 40.0, 40.0))
    assert np.isnan(graph.limit_mps).all()
    second = graph.points[graph.point_starts[1] : graph.point_starts[2]]  # in the frame of the map
    np.testing.assert_allclose(second[[0, -1]], ((0.0, -3.5), (40.0, -3.5)), atol=1e-9)


@pytest.mark.parametrize(("length_m", "nodes"), [(20.0, 1), (20.1, 2), (40.0, 2), (41.0, 3)])
def test_a_node_is_at_most_twenty_metres_long(length_m: float, nodes: int) -> None:
    graph = lane_graph(straight_road(length_m=length_m))
    np.testing.assert_allclose(np.diff(graph.node_stretches_m, axis=1), length_m / nodes)
    assert len(graph.node_poses) == nodes


def test_nodes_follow_each_other_along_and_across_lanes() -> None:
    graph = lane_graph(ROAD)
    assert graph.node_lane_ids.tolist() == [11, 11, 12, 12, 21, 22, 31, 31, 32, 32]
    np.testing.assert_allclose(graph.node_poses[3], (30.0, -3.5, 0.0), atol=1e-9)
    assert edges(graph, SUCCESSOR) == {(0, 1), (1, 4), (4, 6), (6, 7), (2, 3), (3, 5), (5, 8), (8, 9)}


def test_nodes_beside_each_other_are_proximal_both_ways() -> None:
    side_by_side = {(0, 2), (1, 3), (4, 5), (6, 8), (7, 9)}
    # Middles 20 m apart along and 3.5 m across are too far; 3.5 m between the lines is less than 4 m.
    both = side_by_side | {(b, a) for a, b in side_by_side}
    assert edges(lane_graph(ROAD), PROXIMAL) == both


def test_oncoming_and_crossing_lanes_are_not_proximal() -> None:
    graph = lane_graph(junction())
    pairs = {(int(graph.node_lane_ids[a]), int(graph.node_lane_ids[b])) for a, b in edges(graph, PROXIMAL)}
    assert (1, 5) not in pairs
    assert (13, 24) not in pairs
    assert (13, 14) in pairs  # they part slowly from one another
    assert (12, 14) not in pairs  # a right and a left turn
    assert (graph.has_light == graph.is_connector).all()


def test_node_lines_are_the_pieces_of_the_centre_lines() -> None:
    graph = lane_graph(ROAD)
    for line, stretch in zip(node_lines(ROAD, graph), graph.node_stretches_m, strict=True):
        assert line.length_m == pytest.approx(stretch[1] - stretch[0])
