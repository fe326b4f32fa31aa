"""Overlaps in plain floats: they equal shapely's, whatever the lane and the box."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st

from interplan_sumo.maps.store import find_map
from interplan_sumo.simulation import ego_locator
from interplan_sumo.simulation.lane_polygons import (
    ClipArea,
    Ring,
    area_m2,
    clipped,
    convex_parts_between,
    ego_ring,
    hull,
)
from interplan_sumo.simulation.network import NetworkLane, SumoNetwork, read_network
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.geometry import Polyline
from tests.quick import DISTRICTS

OFFSET_M = 1e-6
LEAST_SHARE = 1e-5
"""Below this share an overlap's ends are those of a sliver; only its share is compared."""


def lane(points: np.ndarray, width_m: float, name: str = "l_0") -> NetworkLane:
    line = Polyline(points)
    return NetworkLane(name, name[:-2], 0, line, 1.1 * line.length_m, width_m, 13.9, internal=False)


def network(*lanes: NetworkLane) -> SumoNetwork:
    return SumoNetwork(Path("none"), {each.id: each for each in lanes}, {}, {})


def overlaps(where: SumoNetwork, box: Ring) -> dict[str, tuple[float, float, float]]:
    """Share, start and end per lane, by the code that drives."""
    area = ClipArea.of(box)
    coverage = ego_locator.lane_coverage(where.pieces_near(area), area, (1.0, 0.0))
    return {name: (part.share, part.start_m, part.end_m) for name, part in coverage.items()}


def reference(where: SumoNetwork, box: Ring) -> dict[str, tuple[float, float, float]]:
    """The same by shapely."""
    polygon = shapely.Polygon(box)
    found: dict[str, tuple[float, float, float]] = {}
    for each in where.lanes.values():
        for piece in each.pieces:
            part = shapely.intersection(piece.polygon, polygon)
            share = part.area / polygon.area
            if share <= 1e-6:
                continue
            arcs, _ = piece.line.project(shapely.get_coordinates(part))
            start_m, end_m = (each.position_of(piece.start_m + float(arc)) for arc in (arcs.min(), arcs.max()))
            before = found.get(each.id, (0.0, start_m, end_m))
            found[each.id] = (before[0] + share, min(before[1], start_m), max(before[2], end_m))
    return found


def assert_equal_overlaps(where: SumoNetwork, box: Ring, offset_m: float = OFFSET_M) -> None:
    ours, theirs = overlaps(where, box), reference(where, box)
    for name in ours.keys() | theirs.keys():
        share, start_m, end_m = ours.get(name, (0.0, 0.0, 0.0))
        other_share, other_start_m, other_end_m = theirs.get(name, (0.0, 0.0, 0.0))
        assert share == pytest.approx(other_share, abs=1e-6), name
        if share > LEAST_SHARE:
            assert (start_m, end_m) == pytest.approx((other_start_m, other_end_m), abs=offset_m), name


def winding(turns_rad: list[float], steps_m: list[float]) -> np.ndarray:
    """The vertices of a line that turns between steps."""
    headings = np.cumsum([0.0, *turns_rad[1:]])
    steps = np.array(steps_m)[:, None] * np.stack((np.cos(headings), np.sin(headings)), axis=1)
    return np.concatenate((np.zeros((1, 2)), np.cumsum(steps, axis=0)))


def box(x_m: float, y_m: float, heading_rad: float) -> Ring:
    return ego_ring(EgoState(0.0, x_m, y_m, heading_rad), PACIFICA, (0.0, 0.0))


def box_beside(line: Polyline, share: float, left_m: float, turned_rad: float) -> Ring:
    pose = line.pose_at(share * line.length_m, left_m)
    return box(pose.x_m, pose.y_m, pose.heading_rad + turned_rad)


SEGMENTS = st.lists(st.tuples(st.floats(-0.5, 0.5), st.floats(0.5, 40.0)), min_size=1, max_size=12)
BESIDE = st.tuples(st.floats(0.0, 1.0), st.floats(-6.0, 6.0), st.floats(-3.2, 3.2))


@settings(max_examples=120)
@given(segments=SEGMENTS, width_m=st.floats(2.0, 6.0), beside=BESIDE)
def test_the_overlap_with_a_curve_is_shapelys(
    segments: list[tuple[float, float]], width_m: float, beside: tuple[float, float, float]
) -> None:
    turns, steps = zip(*segments, strict=True)
    each = lane(winding(list(turns), list(steps)), width_m)
    area = box_beside(each.line, *beside)
    ours, theirs = overlaps(network(each), area), reference(network(each), area)
    share, other = (found.get(each.id, (0.0,))[0] for found in (ours, theirs))
    assert share == pytest.approx(other, abs=1e-6)


@settings(max_examples=80)
@example(bend_rad=0.03125, count=25, width_m=3.0, beside=(0.0282889, 0.0, 0.03125))
@given(bend_rad=st.floats(-0.06, 0.06), count=st.integers(1, 30), width_m=st.floats(2.5, 4.5), beside=BESIDE)
def test_where_a_road_lies_under_the_box_is_shapelys_too(
    bend_rad: float, count: int, width_m: float, beside: tuple[float, float, float]
) -> None:
    each = lane(winding([bend_rad] * count, [2.0] * count), width_m)  # a radius of 33 m and more
    apart_m = abs(bend_rad) * width_m / 2.0  # of the two nearest points of a place on the bisector of a bend
    assert_equal_overlaps(network(each), box_beside(each.line, *beside), OFFSET_M + apart_m)


def test_the_quick_way_for_a_box_inside_one_lane_gives_what_the_whole_way_gives() -> None:
    each = lane(winding([0.05] * 10, [2.0] * 10), 4.5)
    for share in (0.3, 0.5, 0.7):
        area, here_m = box_beside(each.line, share, 0.2, 0.02), each.position_of(share * each.line.length_m)
        quick = ego_locator.coverage_of_one_lane(each, here_m, area, (8.0, 1.0))
        clip = ClipArea.of(area)
        whole = ego_locator.lane_coverage(network(each).pieces_near(clip), clip, (8.0, 1.0))
        assert quick is not None
        assert tuple(quick[each.id]) == pytest.approx(tuple(whole[each.id]), abs=1e-9)


@pytest.mark.parametrize("turn_rad", [2.2, 2.8, 3.1])
def test_a_hairpin_whose_sides_cross_is_taken_as_its_hull(turn_rad: float) -> None:
    each = lane(winding([0.0, turn_rad, 0.0], [6.0, 1.0, 6.0]), 3.5)
    assert {tile.segment for piece in each.pieces for tile in piece.convex_parts} == {None}
    rng = np.random.default_rng(0)
    for x_m, y_m, heading_rad in rng.uniform((-2, -6, -3), (9, 6, 3), (50, 3)):
        assert_equal_overlaps(network(each), box(x_m, y_m, heading_rad))


def test_an_area_that_is_neither_a_row_of_tiles_nor_convex_is_cut_into_triangles() -> None:
    left = np.array([[0.0, 1.0], [3.0, -0.5], [6.0, 1.0]])
    right = np.array([[0.0, -1.0], [5.0, -1.0], [6.0, -1.0]])
    outline = shapely.Polygon(np.concatenate((left, right[::-1])))
    tiles = convex_parts_between(left, right, outline)
    assert len(tiles) > 1
    area = ClipArea.of(((1.0, -2.0), (4.5, -2.0), (4.5, 2.0), (1.0, 2.0)))
    ours = sum(abs(area_m2(part)) for _, part in area.on(tiles))
    assert ours == pytest.approx(shapely.intersection(outline, shapely.Polygon(area.ring)).area)


@pytest.mark.parametrize("name", DISTRICTS)
def test_overlaps_on_the_shipped_maps_are_shapelys(name: str) -> None:
    where = read_network(find_map(name).network)
    rng = np.random.default_rng(1)
    pieces, tree = where.pieces
    for _ in range(60):
        piece = pieces[int(rng.integers(len(pieces)))]
        area = box_beside(piece.line, rng.uniform(), rng.uniform(-4.0, 4.0), rng.normal(0.0, 0.5))
        near = [pieces[i].lane for i in tree.query(shapely.Polygon(area))]
        here = SumoNetwork(where.path, {each.id: each for each in near}, {}, {})
        assert {k: v[0] for k, v in overlaps(where, area).items()} == pytest.approx(
            {k: v[0] for k, v in overlaps(here, area).items()}
        )
        assert_equal_overlaps(here, area)


@settings(max_examples=100)
@given(points=st.lists(st.tuples(st.floats(-50, 50), st.floats(-50, 50)), min_size=3, max_size=12, unique=True))
def test_the_hull_is_shapelys(points: list[tuple[float, float]]) -> None:
    theirs = shapely.convex_hull(shapely.MultiPoint(points))
    if theirs.area > 1e-3:
        ours = hull(points)
        assert area_m2(ours) == pytest.approx(theirs.area)


def test_areas_that_share_an_edge_only_do_not_overlap() -> None:
    unit = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
    assert clipped(unit, [(1.0, 0.0, -1.0)]) == ()  # x >= 1
    assert area_m2(clipped(unit, [(1.0, 0.0, -0.75)])) == pytest.approx(0.25)


def test_a_point_on_the_line_between_two_lanes_lies_in_both() -> None:
    left = lane(np.array([[0.0, 1.75], [50.0, 1.75]]), 3.5, "a_0")
    right = lane(np.array([[0.0, -1.75], [50.0, -1.75]]), 3.5, "b_0")
    holding = {each.id for each in (left, right) for piece in each.pieces if piece.holds(20.0, 0.0)}
    assert holding == {"a_0", "b_0"}
