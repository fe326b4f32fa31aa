from __future__ import annotations

import numpy as np
import pytest
from worlds import (
    LANE_WIDTH_M,
    cars,
    curved_road,
    drive,
    drive_along,
    ego_on,
    junction,
    mission,
    observation,
    pedestrians,
    signals,
    straight_road,
    together,
)

from interplan_sumo.world.roads import Roads, Turn
from interplan_sumo.world.signals import SignalStatus

ROADS = [
    straight_road(lanes=3, cuts_m=((60.0, 75.0), (120.0, 130.0))),
    curved_road(lanes=2, radius_m=20.0, cuts_m=((50.0, 60.0),)),
    curved_road(lanes=2, radius_m=30.0, angle_rad=-np.pi / 3),
    junction(),
    junction(driving_side="left"),
]


@pytest.mark.parametrize("roads", ROADS)
def test_connectors_begin_and_end_where_their_lanes_do(roads: Roads) -> None:
    for connector in roads.connectors.values():
        before, after = roads[connector.from_lane_id].centerline, roads[connector.to_lane_id].centerline
        assert connector.centerline.points[0] == pytest.approx(before.points[-1], abs=1e-9)
        assert connector.centerline.points[-1] == pytest.approx(after.points[0], abs=1e-9)


@pytest.mark.parametrize("roads", ROADS)
def test_lanes_keep_the_promises_of_a_map(roads: Roads) -> None:
    lanes = [*roads.lanes.values()]
    for lane in (*lanes, *roads.connectors.values()):
        assert lane.polygon.is_valid
        assert np.diff(lane.centerline.arc_m).max() <= 1.0 + 1e-9
        assert lane.left_boundary.project_point(*lane.centerline.points[1])[1] == pytest.approx(-LANE_WIDTH_M / 2, 1e-2)
    for i, lane in enumerate(lanes):
        assert all(lane.polygon.intersection(other.polygon).area < 1e-6 for other in lanes[i + 1 :])
    inside = np.concatenate([lane.centerline.points[1:-1] for lane in lanes])
    assert roads.drivable(inside).all()


def test_a_road_is_numbered_by_block_and_lane_from_the_left() -> None:
    roads = ROADS[0]
    assert roads.roadblocks["3"].lane_ids == ("31", "32", "33")
    assert roads.outgoing("12") == ("22",)
    right = roads.right_of("11")
    assert right is not None
    assert right.id == "12"
    assert right.centerline.points[0] == pytest.approx((0.0, -LANE_WIDTH_M))


@pytest.mark.parametrize(("roads", "short"), [(ROADS[3], Turn.RIGHT), (ROADS[4], Turn.LEFT)])
def test_the_near_turn_of_a_junction_is_short_on_either_driving_side(roads: Roads, short: Turn) -> None:
    lengths = {c.turn: c.centerline.length_m for c in roads.connectors.values()}
    assert min(lengths, key=lengths.__getitem__) is short
    assert roads.connectors["13"].turn is Turn.STRAIGHT
    assert all(c.has_traffic_light for c in roads.connectors.values())


def test_actors_are_sorted_however_many_there_are() -> None:
    crowd = together(cars(*((float(i), 0.0) for i in range(101))), pedestrians((5.0, 5.0, 1.0, np.pi)))
    assert len(crowd) == 102
    assert (crowd.vx_mps[-1], crowd.length_m[-1]) == pytest.approx((-1.0, 0.7))


def test_a_drive_covers_its_speeds() -> None:
    trace = drive(10.0, 9.0, 9.0, actors=cars((30.0, 0.0)))
    assert trace.ego.x_m == pytest.approx([0.0, 1.0, 1.9])
    assert trace.ego.ax_mps2 == pytest.approx([0.0, -10.0, 0.0])
    assert len(trace.actors) == len(trace.plans) == 3


def test_a_drive_along_a_bend_turns() -> None:
    line = ROADS[1]["11"].centerline
    trace = drive_along(line, *[5.0] * 80, start_m=35.0)
    assert trace.ego.yaw_rate_radps[20] == pytest.approx(5.0 / 20.0, rel=0.02)


def test_missions_and_observations_are_made_in_one_line() -> None:
    roads = ROADS[3]
    job = mission(roads, ("1", "13", "7"))
    assert job.route == ("1", "13", "7")
    assert job.goal.x_m == pytest.approx(67.0)
    seen = observation(ego_on(roads, "1", 10.0, 5.0), signals=signals(red=("13",), green=("24",)))
    assert seen.signals.with_status(SignalStatus.RED) == {"13"}
    assert (len(seen.actors), seen.past.egos) == (0, ())
