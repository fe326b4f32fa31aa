"""What stands in whose way: the footprint of a lane, and cars that hang out of the lane they have moved to."""

from __future__ import annotations

from dataclasses import replace
from math import pi

import numpy as np
import pytest
import shapely
from networks import LANE_Y, two_way_road

from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.store import find_map, load_roads
from interplan_sumo.simulation.agent_kinematics import bodies
from interplan_sumo.simulation.agent_registry import AgentSnapshot
from interplan_sumo.simulation.blockage_neighbours import BlockageNeighbours
from interplan_sumo.simulation.lane_change_overhang import LaneChangeOverhang
from interplan_sumo.simulation.lane_footprint import keeps_clear, lanes_overlapped
from interplan_sumo.simulation.lane_polygons import body_ring
from interplan_sumo.simulation.network import HALF_FOOTPRINT_M, read_network
from interplan_sumo.simulation.obstacles import LaneBlockage, blockages
from interplan_sumo.simulation.vehicle_types import VehicleType
from interplan_sumo.tiny_worlds import cars

NETWORK = two_way_road()
CAR = VehicleType("car", length_m=4.6, width_m=1.85)
FAR_AWAY = ((900.0, 0.0), (905.0, 0.0), (905.0, 2.0), (900.0, 2.0))
"""An ego in nobody's way."""


@pytest.mark.parametrize(("left_m", "in_the_way"), [(HALF_FOOTPRINT_M + 0.01, False), (HALF_FOOTPRINT_M - 0.01, True)])
def test_a_box_is_in_the_way_if_a_car_on_the_centre_line_would_touch_it(left_m: float, in_the_way: bool) -> None:
    box = shapely.box(60.0, LANE_Y[0] + left_m, 160.0, LANE_Y[0] + left_m + 0.3)
    spans = lanes_overlapped(NETWORK, box)
    assert ("e0_0" in spans) == in_the_way
    if in_the_way:
        assert spans["e0_0"] == pytest.approx((60.0, 160.0))


def test_lanes_that_are_left_out_are_not_reached() -> None:
    box = shapely.box(100.0, LANE_Y[0], 102.0, LANE_Y[1])
    assert set(lanes_overlapped(NETWORK, box)) == {"e0_0", "e0_1"}
    assert set(lanes_overlapped(NETWORK, box, besides={"e0_0"})) == {"e0_1"}


@pytest.mark.parametrize("in_junctions", [False, True])
def test_a_box_that_keeps_clear_overlaps_no_lane_and_most_that_overlap_none_keep_clear(in_junctions: bool) -> None:
    network, rng = read_network(find_map("hazelwood").network), np.random.default_rng(7)
    lanes, free, clear = list(network.lanes.values()), 0, 0
    for number in rng.integers(len(lanes), size=1000):
        lane = lanes[number]
        there = lane.plain_line.pose_at(rng.uniform(0.0, lane.line.length_m))
        x, y = there.x_m + rng.normal(0.0, 2.0), there.y_m + rng.normal(0.0, 2.0)
        heading, own = there.heading_rad + rng.normal(0.0, 0.3), network.continuations(lane.id)
        ring = body_ring(x, y, heading, 4.6, 1.85)
        (box,) = bodies(np.array([[x, y, heading]]), 4.6, 1.85)
        assert np.array(ring) == pytest.approx(shapely.get_coordinates(box)[:4])
        found = lanes_overlapped(network, box, own, in_junctions=in_junctions)
        is_clear = keeps_clear(network, ring, own, in_junctions=in_junctions)
        assert not (found and is_clear)
        free, clear = free + (not found), clear + is_clear
    assert clear > 0.9 * free > 100


def driving(yaw_rad: float, turned_rad: float, speed_mps: float) -> AgentSnapshot:
    """A car whose front is on the centre line of lane 1 and whose rear trails towards lane 0."""
    return AgentSnapshot(
        names=("a",),
        rows={"a": 0},
        front_x=np.array([100.0]),
        front_y=np.array([LANE_Y[1]]),
        heading_rad=np.array([yaw_rad]),
        speed_mps=np.array([speed_mps]),
        turned_rad={0: turned_rad},
        displaced=frozenset(),
        lanes=lambda _: ["e0_1"],
        positions_m=lambda _: [100.0],
        choice=lambda _: (),
    )


def test_the_rear_of_a_car_that_came_slowly_from_the_next_lane_is_in_the_way_there() -> None:
    bodies = LaneChangeOverhang(NETWORK, {"a": CAR})
    now = driving(0.5, 0.01, 1.0)
    assert bodies.candidates(now) == [0]
    ((name, coverage),) = bodies.coverage([0], ["e0_1"], now)
    assert name == "a"
    assert set(coverage) == {"e0_0"}
    assert 95.0 < coverage["e0_0"].start_m < coverage["e0_0"].end_m < 100.0
    assert coverage["e0_0"].speed_mps == pytest.approx(np.cos(0.5))
    assert bodies.candidates(driving(0.5, 0.0, 0.0)) == [0]  # until it has come straight
    assert bodies.coverage([0], ["e0_1"], driving(0.05, 0.0, 1.0)) == []
    assert bodies.candidates(driving(0.05, 0.0, 1.0)) == []


@pytest.mark.parametrize(("length_m", "own"), [(6.4, False), (12.0, True)])
def test_in_a_turn_the_rear_of_a_long_vehicle_is_in_the_way_in_its_own_lane_too(length_m: float, own: bool) -> None:
    """SUMO bends its body along the lane: those behind would stop where its corner is."""
    bodies = LaneChangeOverhang(NETWORK, {"a": replace(CAR, length_m=length_m, width_m=2.55)})
    now = driving(0.15, 0.01, 1.0)
    assert bodies.candidates(now) == [0]
    behind = [spans["e0_1"] for _, spans in bodies.coverage([0], ["e0_1"], now) if "e0_1" in spans]
    assert [each.start_m for each in behind] == (
        [pytest.approx(100.0 - length_m * np.cos(0.15), abs=0.5)] if own else []
    )


@pytest.mark.parametrize(("turned_rad", "speed_mps"), [(0.003, 1.0), (0.01, 7.5), (2 * pi - 0.003, 1.0)])
def test_a_car_that_hardly_turns_or_drives_fast_overhangs_nothing(turned_rad: float, speed_mps: float) -> None:
    assert LaneChangeOverhang(NETWORK, {"a": CAR}).candidates(driving(0.5, turned_rad, speed_mps)) == []


@pytest.mark.parametrize(("x_m", "aside_m", "displaced", "waits"), [
    (104.8, 0.0, True, True), (105.0, 0.0, True, False), (104.8, 2.1, True, False), (104.8, 0.0, False, False),
    (99.9, 1.0, True, False),
])  # fmt: skip
def test_a_car_that_is_elsewhere_than_where_sumo_has_it_waits_for_whom_it_stands_behind(
    x_m: float, aside_m: float, displaced: bool, waits: bool
) -> None:
    """It needs 0.15 m and 0.11 m at 1 m/s, ahead of 100 m; the other one is 4.6 m long."""
    alone = driving(0.0, 0.0, 1.0)
    both = alone._replace(
        names=("a", "b"), front_x=np.array([100.0, x_m + 0.06]), front_y=LANE_Y[1] + np.array([0.0, aside_m]),
        heading_rad=np.zeros(2), speed_mps=np.array([1.0, 0.0]), displaced=frozenset([0] if displaced else []),
    )  # fmt: skip
    found = LaneChangeOverhang(NETWORK, {"a": CAR, "b": CAR}).faces_somebody(both, FAR_AWAY, 0.1)
    assert found == ([0] if waits else [])


@pytest.mark.parametrize(("gap_m", "waits"), [(0.2, True), (0.4, False)])
def test_a_car_that_is_elsewhere_than_where_sumo_has_it_waits_for_the_ego_too(gap_m: float, waits: bool) -> None:
    alone = driving(0.0, 0.0, 1.0)._replace(front_x=np.array([100.0]), displaced=frozenset([0]))
    rear_m, beside_m = 100.0 + gap_m, LANE_Y[1] + 0.5
    ego = ((rear_m, beside_m), (rear_m + 5.0, beside_m), (rear_m + 5.0, beside_m + 2.0), (rear_m, beside_m + 2.0))
    found = LaneChangeOverhang(NETWORK, {"a": CAR}).faces_somebody(alone, ego, 0.1)
    assert found == ([0] if waits else [])


@pytest.mark.parametrize(("apart_m", "spans"), [(13.9, [(94.0, 124.8)]), (14.1, [(94.0, 110.0), (118.1, 125.0)])])
def test_stretches_that_two_obstacles_block_are_one_where_no_car_fits_between(
    apart_m: float, spans: list[tuple[float, float]]
) -> None:
    """Cars queue 6 m before each, and 8 m between what they block are too few for one."""
    standing = cars((105.0, LANE_Y[0]), (110.0 + apart_m + 0.45, LANE_Y[0]), length_m=10.0)
    standing = replace(standing, length_m=np.array([10.0, 0.9]))
    found = [(each.start_m, each.end_m) for each in blockages(NETWORK, standing, (0.0, 0.0))]
    assert found == [pytest.approx(span) for span in spans]


@pytest.mark.parametrize(("before_m", "starts_m"), [(12.0, 81.75), (25.0, 93.75)])
def test_what_stands_on_the_edge_of_a_lane_that_is_closed_soon_after_closes_it_too(
    before_m: float, starts_m: float
) -> None:
    """The first cone of a taper: whoever leaves the lane beside it would sweep over it."""
    edge_y = (LANE_Y[0] + LANE_Y[1]) / 2.0
    standing = cars((100.0, LANE_Y[0]), (100.0 - before_m, edge_y), length_m=0.5, width_m=0.5)
    found = blockages(NETWORK, standing, (0.0, 0.0))
    assert {each.lane for each in found} == {"e0_0"}
    assert min(each.start_m for each in found) == pytest.approx(starts_m)


def test_where_something_stands_inside_a_junction_the_lanes_that_lead_there_are_blocked_at_their_ends() -> None:
    roads, files = load_roads("one_north"), find_map("one_north")
    network, ids = read_network(files.network), NetworkIds.read(files.ids)
    connector = max(roads.connectors.values(), key=lambda each: each.centerline.length_m)
    middle = connector.centerline.pose_at(connector.centerline.length_m / 2.0)
    standing = cars((middle.x_m, middle.y_m, 0.0, middle.heading_rad))
    found = {each.lane: each for each in blockages(network, standing, ids.origin_m)}
    before, _ = ids.sumo_place(connector.from_lane_id, roads[connector.from_lane_id].centerline.length_m)
    assert found[before].end_m == pytest.approx(network.lanes[before].length_m)
    assert found[before].end_m - found[before].start_m < 1.1


@pytest.mark.parametrize(("x_m", "keeps"), [(115.0, False), (125.0, True), (210.0, True), (220.0, False)])
def test_beside_a_blockage_and_80_m_before_it_nobody_changes_into_its_lane(x_m: float, keeps: bool) -> None:
    neighbours = BlockageNeighbours(NETWORK, (LaneBlockage("e0_0", 200.0, 210.0),), {"a": CAR})
    here = driving(0.0, 0.0, 8.0)._replace(front_x=np.array([x_m]), positions_m=lambda names: [x_m] * len(names))
    near, itself = (here._replace(lanes=lambda names, lane=lane: [lane] * len(names)) for lane in ("e0_1", "e0_0"))
    assert neighbours.agents(near) == (frozenset("a") if keeps else frozenset())
    assert neighbours.agents(itself) == frozenset()
