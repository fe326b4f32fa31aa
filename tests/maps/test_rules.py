"""The rules of nuPlan's schema: each is found broken, with layer and id, and not otherwise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely

from interplan_sumo.maps.problem import MapProblem
from interplan_sumo.maps.rules import MAX_OVERLAP_M, MAX_SPACING_M, overlapping, schema_problems
from interplan_sumo.world.geometry import Polyline
from interplan_sumo.world.roads import Roads
from tests.maps.road_worlds import GridPlan, grid_city
from tests.yardstick import at_most

CITY = grid_city(GridPlan(columns=2, rows=2, lanes=2, spacing_m=60.0))
LANE, OTHER = list(CITY.lanes.values())[:2]
WAY = next(iter(CITY.connectors.values()))
BLOCK = CITY.roadblocks[LANE.roadblock_id]
GROUP = CITY.roadblocks[WAY.roadblock_id]


def test_a_sound_city_breaks_no_rule() -> None:
    assert schema_problems(CITY) == []
    assert schema_problems(grid_city(GridPlan(columns=1, rows=3, lanes=3, side="left", rotation_rad=2.0))) == []


def lane(**changes: Any) -> Roads:
    return replace(CITY, lanes=dict(CITY.lanes) | {LANE.id: replace(LANE, **changes)})


def connector(**changes: Any) -> Roads:
    return replace(CITY, connectors=dict(CITY.connectors) | {WAY.id: replace(WAY, **changes)})


def block(which: str, **changes: Any) -> Roads:
    return replace(CITY, roadblocks=dict(CITY.roadblocks) | {which: replace(CITY.roadblocks[which], **changes)})


BROKEN: list[tuple[Callable[[], Roads], str]] = [
    (lambda: lane(id="77777"), f"lanes_polygons 77777: filed under the id {LANE.id}"),
    (
        lambda: replace(CITY, crosswalks=(replace(CITY.crosswalks[0], id="zebra"),)),
        "crosswalks zebra: the id is not a positive whole number",
    ),
    (
        lambda: replace(CITY, carparks=(replace(CITY.carparks[0], id="0"),)),
        "carpark_areas 0: the id is not a positive whole number",
    ),
    (
        lambda: replace(CITY, carparks=(replace(CITY.carparks[0], id="07"),)),
        "carpark_areas 07: the id is not a positive whole number",
    ),
    (
        lambda: replace(CITY, walkways=(CITY.walkways[0], CITY.walkways[0])),
        f"walkways {CITY.walkways[0].id}: 2 areas of this id",
    ),
    (
        lambda: lane(roadblock_id=GROUP.id),
        f"lanes_polygons {LANE.id}: its block {GROUP.id} is a lane_group_connectors row",
    ),
    (
        lambda: block(BLOCK.id, lane_ids=(OTHER.id,)),
        f"lanes_polygons {LANE.id}: its lane_groups_polygons {BLOCK.id} does not list it",
    ),
    (
        lambda: lane(index=5),
        f"lane_groups_polygons {BLOCK.id}: its lanes {LANE.id}, {OTHER.id} have the places [5, 1]; "
        "they must rise from the left",
    ),
    (
        lambda: block(GROUP.id, intersection_id="99999"),
        f"lane_group_connectors {GROUP.id}: lies in intersection 99999, which does not exist",
    ),
    (
        lambda: block(GROUP.id, to_id=None),
        f"lane_group_connectors {GROUP.id}: leads to roadblock None, which does not exist",
    ),
    (
        lambda: connector(to_lane_id=WAY.from_lane_id),
        f"lane_group_connectors {GROUP.id}: its connector {WAY.id} leads from roadblock {GROUP.from_id} "
        f"to {GROUP.from_id}",
    ),
    (
        lambda: block(BLOCK.id, polygon=shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)])),
        f"lane_groups_polygons {BLOCK.id}: its polygon is not valid (Self-intersection[0.5 0.5])",
    ),
    (
        lambda: block(BLOCK.id, polygon=shapely.Polygon()),
        f"lane_groups_polygons {BLOCK.id}: its polygon is not valid (empty)",
    ),
    (lambda: connector(speed_limit_mps=-1.0), f"lane_connectors {WAY.id}: a speed limit of -1.0 m/s"),
    (
        lambda: lane(left_boundary=LANE.right_boundary, right_boundary=LANE.left_boundary),
        f"lanes_polygons {LANE.id}: its left boundary is not on the left of its right one in the direction of travel",
    ),
    (
        lambda: lane(centerline=Polyline(LANE.centerline.points[::-1])),
        f"lanes_polygons {LANE.id}: its centre line runs against its boundaries",
    ),
    (
        lambda: block(BLOCK.id, polygon=next(b for b in CITY.roadblocks.values() if b.id != BLOCK.id).polygon),
        f"lane_groups_polygons {BLOCK.id}: overlaps ",
    ),
]


@pytest.mark.parametrize(("make", "message"), BROKEN, ids=[message for _, message in BROKEN])
def test_a_broken_rule_is_named(make: Callable[[], Roads], message: str) -> None:
    problems = [str(problem) for problem in schema_problems(make())]
    assert any(problem.startswith(message) for problem in problems), problems


def test_vertices_may_be_a_little_further_apart_than_written_files_have_them() -> None:
    start = LANE.centerline.points[0]
    rest = LANE.centerline.points[2:]

    def with_gap(gap_m: float) -> list[MapProblem]:
        second = start + np.array((gap_m, 0.0))
        return schema_problems(lane(centerline=Polyline(np.concatenate(([start, second], rest)))))

    assert with_gap(MAX_SPACING_M - 0.01) == []
    assert any(
        f"vertices of its centre line lie {MAX_SPACING_M + 0.01:.2f} m apart" in p.message for p in with_gap(1.51)
    )


@pytest.mark.parametrize(("gap_m", "problems"), [(0.29, 0), (0.31, 1)])
def test_a_joint_may_gape_less_than_nuplan_bridges(gap_m: float, problems: int) -> None:
    line = WAY.centerline
    points = line.points.copy()
    points[0] -= np.array((np.cos(line.segment_heading_rad[0]), np.sin(line.segment_heading_rad[0]))) * gap_m
    found = schema_problems(connector(centerline=Polyline(points)))
    assert len(found) == problems
    assert all(f"lane_connectors {WAY.id}: a gap of {gap_m:.2f} m to lane {WAY.from_lane_id}" in str(p) for p in found)


@pytest.mark.parametrize(("depth_m", "pairs"), [(MAX_OVERLAP_M * 0.9, 0), (MAX_OVERLAP_M * 1.1, 1)])
def test_overlaps_thinner_than_a_drawing_tolerance_are_none(depth_m: float, pairs: int) -> None:
    boxes = np.array([shapely.box(0, 0, 50, 3), shapely.box(0, 3 - depth_m, 50, 6), shapely.box(0, 6, 50, 9)])
    assert len(overlapping(boxes)) == pairs


@pytest.mark.parametrize(("depth_m", "pairs"), [(MAX_OVERLAP_M * 0.8, 0), (MAX_OVERLAP_M * 1.2, 1)])
def test_lanes_of_many_vertices_overlap_as_plain_ones_do(depth_m: float, pairs: int) -> None:
    """Two of 8 km on the same ground took a second each time that they were held against each other."""
    at_m = np.linspace(0.0, 8000.0, 9000)
    bend_m = 40.0 * np.sin(at_m / 500.0)

    def lane(right_m: float) -> shapely.Polygon:
        edges = [np.stack((at_m, bend_m + right_m + left_m), axis=1) for left_m in (0.0, 3.0)]
        return shapely.Polygon(np.concatenate((edges[0], edges[1][::-1])))

    with at_most(33):
        found = overlapping(np.array([lane(0.0), lane(3.0 - depth_m), lane(6.0)]))
    assert [(one, other) for one, other, _ in found] == [(0, 1)] * pairs
    assert all(width_m == pytest.approx(depth_m, rel=0.2) for *_, width_m in found)


def test_connectors_may_overlap() -> None:
    crossroads = grid_city(GridPlan(columns=3, rows=3, lanes=1, spacing_m=60.0))
    assert overlapping(np.array([connector.polygon for connector in crossroads.connectors.values()]))
    assert schema_problems(crossroads) == []
