"""Lanes that nuPlan's rules cannot bear are taken out with what hangs on them."""

from __future__ import annotations

from dataclasses import replace

import shapely

from interplan_sumo.maps.importers.build import build
from interplan_sumo.maps.importers.drop_invalid import drop_invalid
from interplan_sumo.maps.rules import schema_problems
from interplan_sumo.world.geometry import Polyline
from interplan_sumo.world.roads import Roads
from tests.maps.source_worlds import fork, junction_with_flags


def turned_round(roads: Roads, lane_id: str) -> Roads:
    """The roads with the boundaries of one lane against its traffic."""
    lane = roads.lanes[lane_id]
    against = replace(
        lane,
        left_boundary=Polyline(lane.left_boundary.points[::-1]),
        right_boundary=Polyline(lane.right_boundary.points[::-1]),
    )
    return replace(roads, lanes={**roads.lanes, lane_id: against})


def test_sound_roads_stay_as_they_are() -> None:
    roads = build(fork()).roads
    same, reasons = drop_invalid(roads)
    assert same is roads
    assert reasons == {}


def test_a_broken_lane_goes_with_its_connectors_blocks_and_intersection() -> None:
    made = build(junction_with_flags())
    (side,) = (k for k, rows in made.origins.items() if k in made.roads.lanes and rows[0].source_id == "side")
    left, reasons = drop_invalid(turned_round(made.roads, side))
    assert set(reasons) == {side}
    assert "left boundary" in reasons[side]
    assert side not in left
    assert len(left.connectors) == 1
    assert schema_problems(left) == []
    whole, _ = drop_invalid(turned_round(left, next(iter(left.lanes))))
    assert whole.connectors == {}
    assert whole.intersections == ()


def test_a_lane_of_which_others_leave_no_surface_is_taken_out() -> None:
    roads = build(fork()).roads
    lane = next(iter(roads.lanes.values()))
    sliver = shapely.buffer(lane.centerline.linestring, 0.001, cap_style="flat")
    left, reasons = drop_invalid(replace(roads, lanes={**roads.lanes, lane.id: replace(lane, polygon=sliver)}))
    assert reasons == {lane.id: "other lanes lie on all of it"}
    assert lane.id not in left
