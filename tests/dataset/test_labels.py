"""Labels: futures in the frame of the present, and the way through the lane graph."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from worlds import cars, drive, drive_along, drive_through, junction, straight_road

from interplan_sumo.dataset.labels import Futures, GraphWay
from interplan_sumo.features.frame import EgoFrame
from interplan_sumo.features.lane_graph import lane_graph
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.geometry import Polyline, Pose

REAR_M = 1.461  # PACIFICA's rear axle behind its centre


def test_the_future_of_the_ego_begins_a_step_ahead_in_its_present_frame() -> None:
    trace = drive(*(5.0,) * 100, start=Pose(10.0, 20.0, pi / 2))
    future = Futures(trace).ego(10, EgoFrame.of(trace.ego.state(10)))
    np.testing.assert_allclose(future[:, 0], 0.5 * np.arange(1, 81), atol=1e-9)
    np.testing.assert_allclose(future[:, 1:3], 0.0, atol=1e-9)
    assert (future[:, 3] == 1.0).all()


def test_turning_left_ends_left_with_a_positive_yaw() -> None:
    poses = np.array([(0.0, 0.0, 0.0), (1.0, 0.2, 0.3)])
    trace = drive_through(poses, np.array((10.0, 10.0)))
    future = Futures(trace).ego(0, EgoFrame.of(trace.ego.state(0)))
    expected = (1.0 - REAR_M * np.cos(0.3) + REAR_M, 0.2 - REAR_M * np.sin(0.3), 0.3, 1.0)
    np.testing.assert_allclose(future[0], expected, atol=1e-9)


def test_after_the_end_of_the_drive_there_is_no_future() -> None:
    trace = drive(*(5.0,) * 50)
    future = Futures(trace).ego(10, EgoFrame.of(trace.ego.state(10)))
    assert future[:, 3].tolist() == [1.0] * 39 + [0.0] * 41
    assert (future[39:] == 0.0).all()


def test_agents_are_followed_by_name_also_where_they_are_gone_for_a_while() -> None:
    frames = [cars((10.0, 3.0), (20.0 + k, -3.0, 10.0)) for k in range(5)]
    frames[2] = cars((10.0, 3.0))  # the second one is missing
    frames[4] = Actors.none()
    trace = drive(*(0.0,) * 5, actors=frames)
    table = Futures(trace).agents(0, ("car01", "car00"), EgoFrame.of(trace.ego.state(0)))
    assert table[0, :5, 3].tolist() == [1.0, 0.0, 1.0, 0.0, 0.0]
    np.testing.assert_allclose(table[0, [0, 2], 0], (21.0 + REAR_M, 23.0 + REAR_M))
    np.testing.assert_allclose(table[1, :3, :3], ((10.0 + REAR_M, 3.0, 0.0),) * 3, atol=1e-12)
    assert (table[2:] == 0.0).all()


def test_a_straight_drive_visits_the_nodes_of_its_lane_in_order() -> None:
    roads = straight_road(lanes=2, length_m=100.0, cuts_m=((40.0, 60.0),))
    trace = drive(*(10.0,) * 70, start=Pose(5.0, -3.5, 0.0))
    nodes, edges = GraphWay(roads, trace).at(0)
    # Nodes of lane 12: 2 (to 20 m) and 3 (to 40 m), of connector 22: 5, of lane 32: 8 and 9.
    assert list(dict.fromkeys(nodes.tolist())) == [2, 3, 5, 8, -1]
    assert nodes[16] == 2  # the rear axle is at 5 - 1.461 + 16 m
    assert nodes[17] == 3
    assert lane_graph(roads).edges[edges].tolist() == [[2, 3], [3, 5], [5, 8]]
    assert (nodes[70:] == -1).all()


def test_a_lane_change_takes_a_proximal_edge() -> None:
    roads = straight_road(lanes=2, length_m=100.0)
    line = Polyline(np.array(((10.0, -3.5), (30.0, -3.5), (60.0, 0.0), (95.0, 0.0))))
    way = GraphWay(roads, drive_along(line, *(10.0,) * 80))
    graph = lane_graph(roads)
    _, edges = way.at(0)
    lanes = graph.node_lane_ids[graph.edges[edges]]
    assert (lanes[:, 0] != lanes[:, 1]).sum() == 1
    assert lanes[0].tolist() == [12, 12]
    assert lanes[-1].tolist() == [11, 11]


@pytest.mark.parametrize(
    ("chain", "connector"), [(("1", "14", "8"), 14), (("1", "12", "6"), 12), (("1", "13", "7"), 13)]
)
def test_where_connectors_lie_on_each_other_the_one_that_leads_on_is_taken(
    chain: tuple[str, ...], connector: int
) -> None:
    roads = junction()
    line = Polyline(np.concatenate([roads[lane].centerline.points for lane in chain]))
    way = GraphWay(roads, drive_along(line, *(8.0,) * 140, start_m=20.0))
    lanes = lane_graph(roads).node_lane_ids[way.nodes]
    assert list(dict.fromkeys(lanes.tolist())) == [1, connector, int(chain[-1])]


@pytest.mark.parametrize(
    ("left_m", "turned_rad", "found"),
    [(1.99, 0.0, True), (2.01, 0.0, False), (0.0, pi / 8 - 0.01, True), (0.0, pi / 8 + 0.01, False)],
)
def test_two_metres_or_an_eighth_of_a_half_turn_off_a_node_is_off_it(
    left_m: float, turned_rad: float, found: bool
) -> None:
    trace = drive(*(0.0,) * 3, start=Pose(50.0, left_m + REAR_M * np.sin(turned_rad), turned_rad))
    nodes, edges = GraphWay(straight_road(length_m=100.0), trace).at(0)
    assert (nodes[0] >= 0) == found
    assert not len(edges)
