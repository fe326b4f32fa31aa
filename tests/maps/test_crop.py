"""Crops: whole roads, links that lead somewhere, nothing lost inside the circle."""

from __future__ import annotations

import math
from functools import cache

import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_sumo.errors import MapError
from interplan_sumo.maps.crop import crop
from interplan_sumo.maps.rules import schema_problems
from interplan_sumo.world.roads import Roads
from tests.maps.road_worlds import GridPlan, grid_city

PLAN = GridPlan(columns=5, rows=4, lanes=2, spacing_m=60.0)
X_M, Y_M = PLAN.origin_m


@cache
def city() -> Roads:
    return grid_city(PLAN)


@settings(max_examples=10)
@given(x_m=st.floats(0.0, 240.0), y_m=st.floats(0.0, 180.0), radius_m=st.floats(60.0, 150.0))
def test_a_crop_is_whole_and_consistent(x_m: float, y_m: float, radius_m: float) -> None:
    part = crop(city(), [(X_M + x_m, Y_M + y_m)], radius_m)
    assert schema_problems(part) == []
    circle = shapely.Point(X_M + x_m, Y_M + y_m).buffer(radius_m * 0.999, quad_segs=64)
    for id_, lane in city().lanes.items():
        if lane.polygon.intersects(circle):
            assert part.lanes[id_] is lane
    for id_, connector in city().connectors.items():
        assert (id_ in part.connectors) == (connector.from_lane_id in part.lanes and connector.to_lane_id in part.lanes)
    for block in part.roadblocks.values():
        assert block.lane_ids == city().roadblocks[block.id].lane_ids
        part.outgoing_roadblocks(block.id)
        part.incoming_roadblocks(block.id)
    for area in city().walkways:
        if area.polygon.intersects(circle):
            assert area in part.walkways
    for segment in city().road_segments:
        assert (segment in part.road_segments) or not any(
            segment.polygon.contains(lane.polygon.centroid) for lane in part.lanes.values()
        )


def test_a_small_circle_on_a_road_takes_both_lanes_of_its_direction_only() -> None:
    lane = next(iter(city().lanes.values()))
    x_m, y_m = lane.centerline.pose_at(10.0).x_m, lane.centerline.pose_at(10.0).y_m
    part = crop(city(), [(x_m, y_m)], 1.0)
    assert set(part.lanes) == set(city().roadblocks[lane.roadblock_id].lane_ids)
    assert part.connectors == {}
    assert part.left_of(part.roadblocks[lane.roadblock_id].lane_ids[1]) is lane
    assert len(part.road_segments) == 1


@pytest.mark.parametrize(("extra_m", "lanes"), [(-0.01, 0), (0.01, 2)])
def test_a_lane_counts_from_the_point_where_it_reaches_into_the_circle(extra_m: float, lanes: int) -> None:
    place = shapely.Point(X_M - 300.0, Y_M)
    nearest = min(city().lanes.values(), key=lambda lane: lane.polygon.distance(place))
    radius = nearest.polygon.distance(place) + extra_m
    if lanes:
        assert nearest.id in crop(city(), [(place.x, place.y)], radius).lanes
    else:
        with pytest.raises(MapError, match=r"map grid: no lane within .* m of"):
            crop(city(), [(place.x, place.y)], radius)


def test_stop_lines_that_a_light_names_stay() -> None:
    part = crop(city(), [(X_M + 60.0, Y_M + 60.0)], 40.0)
    named = {stop for connector in part.connectors.values() for stop in connector.stop_line_ids}
    assert named
    assert named <= set(part.stop_lines)


@pytest.mark.parametrize("radius_m", [0.0, -1.0, math.inf, math.nan])
def test_a_radius_is_positive(radius_m: float) -> None:
    with pytest.raises(ValueError, match="positive radius"):
        crop(city(), [(X_M, Y_M)], radius_m)
