"""Roads: the lane graph, where things are, and links that must hold."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from worlds import junction, straight_road

from interplan_sumo.world.roads import Roads

ROAD = straight_road(lanes=3, length_m=300.0, cuts_m=((100.0, 104.0), (200.0, 204.0)))


def test_left_is_geometrically_left() -> None:
    left, middle, right = ROAD.roadblocks["1"].lane_ids
    assert ROAD.left_of(middle) is ROAD.lanes[left]
    assert ROAD.right_of(middle) is ROAD.lanes[right]
    assert ROAD.left_of(left) is None
    assert ROAD.right_of(right) is None
    assert ROAD.lanes[left].centerline.points[0, 1] > ROAD.lanes[right].centerline.points[0, 1]


def test_lanes_follow_one_another_through_connectors() -> None:
    lane = ROAD.roadblocks["1"].lane_ids[0]
    (connector,) = ROAD.outgoing(lane)
    (following,) = ROAD.outgoing(connector)
    assert ROAD[following].roadblock_id == "3"
    assert ROAD.incoming(following) == (connector,)
    assert ROAD.incoming(connector) == (lane,)
    assert ROAD.left_of(connector) is None
    assert ROAD.outgoing_roadblocks("1") == ("2",)
    assert ROAD.incoming_roadblocks("3") == ("2",)
    assert ROAD.route_through((lane, connector, following)) == ("1", "2", "3")


def test_a_point_lies_on_one_lane_and_a_point_on_a_lane_line_on_none() -> None:
    assert ROAD.lanes_at(50.0, 0.0) == (ROAD.roadblocks["1"].lane_ids[0],)
    assert ROAD.lanes_at(50.0, -1.75) == ()
    assert ROAD.at(102.0, 0.0) == (ROAD.roadblocks["2"].lane_ids[0],)
    assert ROAD.at(50.0, 50.0) == ()


def test_the_nearest_lane_is_found_from_off_the_road() -> None:
    assert ROAD.nearest_lane(50.0, 30.0) == ROAD.roadblocks["1"].lane_ids[0]
    assert ROAD.lanes_near(50.0, 30.0, 5.0) == ()
    assert ROAD.lanes_near(50.0, 0.0, 2.0) == ROAD.roadblocks["1"].lane_ids[:2]


def test_drivable_area_and_the_distance_to_it() -> None:
    assert ROAD.drivable([[50.0, 0.0], [50.0, 40.0]]).tolist() == [True, False]
    inside, outside = ROAD.distance_to_drivable_m([[50.0, 0.0], [50.0, 11.75]])
    assert inside == 0.0
    assert outside == pytest.approx(10.0)


def test_a_junction_offers_several_ways() -> None:
    crossing = junction()
    ways = [lane for lane in crossing.lanes if len(crossing.outgoing(lane)) > 1]
    assert ways
    middle = np.mean([crossing[c].centerline.points.mean(axis=0) for c in crossing.connectors], axis=0)
    assert crossing.in_intersection(*middle)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"roadblocks": {}}, "roadblock 1, which does not exist"),
        ({"lanes": {}}, "which does not exist"),
        ({"connectors": {}}, "which does not exist"),
    ],
)
def test_a_broken_link_is_named(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(ROAD, **change)


def test_a_map_without_lanes_has_no_nearest_lane() -> None:
    empty = Roads("none", "EPSG:32632", "right", {}, {}, {})
    with pytest.raises(ValueError, match="no lanes"):
        empty.nearest_lane(0.0, 0.0)
    assert empty.distance_to_drivable_m([[0.0, 0.0]]).tolist() == [np.inf]
