"""CrossSections: parallel lanes as cross-sections."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_sumo.maps.importers.cross_sections import SPACING_M, CrossSections, bridge, cells, largest, sound
from interplan_sumo.world.geometry import Floats

lines = st.lists(st.tuples(st.floats(0.5, 30.0), st.floats(-0.4, 0.4)), min_size=2, max_size=8)


def boundary(steps: list[tuple[float, float]], left_m: float) -> Floats:
    """A line that goes east by steps and swerves a little, moved to the left."""
    x = np.concatenate(([0.0], np.cumsum([step for step, _ in steps])))
    y = np.concatenate(([0.0], [swerve for _, swerve in steps])) + left_m
    return np.stack((x, y), axis=1)


def straight(*left_m: float, length_m: float = 20.0) -> CrossSections:
    return CrossSections.of([np.array([[0.0, y], [length_m, y]]) for y in left_m])


@settings(max_examples=30)
@given(lines, lines)
def test_every_vertex_of_a_boundary_stays_and_spacing_is_bounded(
    left: list[tuple[float, float]], right: list[tuple[float, float]]
) -> None:
    """Up to a centimetre: vertices that nearly coincide are one."""
    boundaries = boundary(left, 4.0), boundary(right, 0.0)
    band = CrossSections.of(boundaries)
    for k, line in enumerate(boundaries):
        drawn = shapely.LineString(band.across[:, k])
        assert shapely.distance(drawn, shapely.points(line)).max() < 0.02
        assert np.hypot(*np.diff(band.across[:, k], axis=0).T).max() <= SPACING_M + 0.02


@settings(max_examples=30)
@given(lines, st.floats(0.05, 0.95))
def test_a_ribbon_cut_in_two_covers_what_it_did(steps: list[tuple[float, float]], share: float) -> None:
    band = CrossSections.of((boundary(steps, 3.0), boundary(steps, 0.0)))
    cut_m = share * band.length_m
    first, second = band.cut(0.0, cut_m), band.cut(cut_m, band.length_m)
    assert first.length_m + second.length_m == pytest.approx(band.length_m, abs=0.03)
    assert np.allclose(first.across[-1], second.across[0])
    area = first.polygon().area + second.polygon().area
    assert area == pytest.approx(band.polygon().area, rel=1e-3, abs=0.05)


def test_neighbours_share_their_boundary_exactly_wherever_they_are_cut() -> None:
    bend = np.linspace(0.0, 1.2, 30)
    band = CrossSections.of(
        [np.stack((r * np.sin(bend), r * (1 - np.cos(bend)) - r), axis=1) for r in (20.0, 23.5, 27.0)]
    )
    segment = band.cut(3.217, 17.9)
    assert np.array_equal(segment.boundary(1).points, segment.lane(0).boundary(1).points)
    assert np.array_equal(segment.lane(0).boundary(1).points, segment.lane(1).boundary(0).points)
    assert shapely.area(shapely.intersection(segment.polygon(0), segment.polygon(1))) < 1e-9


@pytest.mark.parametrize("gap_m", [0.4, -0.4])
def test_ends_that_nearly_meet_are_welded_half_way(gap_m: float) -> None:
    one = straight(1.5, -1.5)
    both = one.joined(CrossSections(one.across + np.array((20.0 + gap_m, 0.0))))
    assert both.length_m == pytest.approx(40.0 + gap_m)
    assert (np.diff(both.across[:, 0, 0]) > 0.0).all()
    assert 20.0 + gap_m / 2.0 == pytest.approx(both.across[np.argmin(abs(both.across[:, 0, 0] - 20.0)), 0, 0], abs=0.01)


def test_joined_ribbons_have_one_cross_section_at_the_seam() -> None:
    one = straight(1.5, -1.5)
    two = CrossSections(one.across + np.array((20.0, 0.0)))
    both = one.joined(two)
    assert len(both.across) == len(one.across) + len(two.across) - 1
    assert both.length_m == pytest.approx(40.0)
    apart = one.joined(CrossSections(two.across + np.array((0.7, 0.0))))
    assert len(apart.across) == len(one.across) + len(two.across)


def test_a_moved_ribbon_ends_where_it_shall_and_is_spread_between() -> None:
    moved = straight(1.5, -1.5).moved(np.array([0.0, 0.4]), np.array([0.0, -0.2]))
    assert moved.middles[0, 0] == pytest.approx((0.0, 0.4))
    assert moved.middles[-1, 0] == pytest.approx((20.0, -0.2))
    assert abs(moved.middles[len(moved.middles) // 2, 0, 1] - 0.1) < 0.03


def test_a_bridge_leaves_and_arrives_straight() -> None:
    after = CrossSections(straight(1.0, -1.0).across + np.array((50.0, 6.0)))
    curve = bridge(straight(1.5, -1.5), after)
    assert curve.middles[0, 0] == pytest.approx((20.0, 0.0))
    assert curve.middles[-1, 0] == pytest.approx((50.0, 6.0))
    headings = curve.centerline().segment_heading_rad
    assert abs(headings[0]) < 0.05
    assert abs(headings[-1]) < 0.05
    widths = np.hypot(*(curve.across[:, 0] - curve.across[:, 1]).T)
    assert widths[0] == pytest.approx(3.0, abs=0.01)
    assert widths[-1] == pytest.approx(2.0, abs=0.01)


def test_the_centre_line_has_even_steps_of_less_than_a_metre() -> None:
    line = straight(1.5, -1.5, length_m=7.3).centerline()
    assert np.allclose(np.diff(line.arc_m), 7.3 / 9)


@pytest.mark.parametrize(("length_m", "count"), [(0.4, 1), (1.4, 1), (1.6, 2), (20.0, 20)])
def test_cells_are_about_as_long_as_asked_for(length_m: float, count: int) -> None:
    polygons, stations = cells(straight(3.0, 0.0, -3.0, length_m=length_m), 1.0)
    assert polygons.shape == (count, 2)
    assert len(stations) == count + 1
    assert shapely.area(polygons).sum() == pytest.approx(6.0 * length_m)


def test_a_surface_whose_boundaries_cross_keeps_its_largest_part() -> None:
    crossed = shapely.Polygon([(0, 1), (10, 1), (10, -1), (7, 2), (0, -1)])
    assert not crossed.is_valid
    assert sound(crossed).is_valid
    parts = shapely.GeometryCollection([shapely.Point(0, 0), shapely.box(0, 0, 1, 1), shapely.box(2, 0, 5, 1)])
    assert largest(parts).equals(shapely.box(2, 0, 5, 1))
    assert largest(shapely.Point(0, 0)).is_empty


def test_a_line_without_length_is_refused() -> None:
    with pytest.raises(ValueError, match="two distinct points"):
        CrossSections.of((np.zeros((3, 2)), np.array([[0.0, 0.0], [1.0, 0.0]])))
