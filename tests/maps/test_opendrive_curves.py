"""Reference lines of OpenDRIVE: each kind ends where it does on paper, and samples stay within a centimetre."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_sumo.maps.importers.lines import mean_length_m
from interplan_sumo.maps.importers.opendrive import curves
from interplan_sumo.maps.importers.opendrive.curves import Curve
from interplan_sumo.maps.importers.opendrive.reader import read_opendrive
from interplan_sumo.maps.importers.opendrive.stretches import CHORD_M
from interplan_sumo.world.frame import UNPLACED_ORIGIN_M
from tests.maps.opendrive_files import geometry, lane, road, section, written, xodr


def end(curve: Curve, length_m: float) -> tuple[float, float, float]:
    points, heading = curve(np.array([length_m]))
    return float(points[0, 0]), float(points[0, 1]), float(heading[0])


PARABOLA_M = 5.0 * (math.sqrt(2.0) + math.asinh(1.0))  # of v = u^2 / 20 from u = 0 to 10


@pytest.mark.parametrize(
    ("curve", "length_m", "expected"),
    [
        (curves.line(), 100.0, (100.0, 0.0, 0.0)),
        (curves.arc(0.01), 50.0 * math.pi, (100.0, 100.0, math.pi / 2.0)),
        (curves.arc(-0.02), 50.0 * math.pi, (0.0, -100.0, -math.pi)),
        # x = L (1 - t^2/10 + t^4/216 - t^6/9360), y = L (t/3 - t^3/42 + t^5/1320) with t = 1/2, the angle turned
        (curves.spiral(0.0, 1.0 / 60.0, 60.0), 60.0, (58.51726, 9.82285, 0.5)),
        (curves.spiral(0.01, 0.01, 50.0 * math.pi), 50.0 * math.pi, (100.0, 100.0, math.pi / 2.0)),
        (curves.spiral(1.0 / 60.0, 0.0, 60.0), 60.0, (56.06305, 19.43430, 0.5)),
        (curves.graph((0.0, 0.75, 0.0, 0.0), 50.0), 50.0, (40.0, 30.0, math.atan(0.75))),
        (curves.graph((0.0, 0.0, 0.05, 0.0), PARABOLA_M), PARABOLA_M, (10.0, 5.0, math.pi / 4.0)),
        (curves.cubic((0, 100, 0, 0), (0, 0, 50, 0), 1.0, 114.8), 114.8, (100.0, 50.0, math.pi / 4.0)),
        (curves.cubic((0, 1, 0, 0), (0, 0, 0.005, 0), 20.0, 20.0), 20.0, (20.0, 2.0, math.atan(0.2))),
    ],
    ids=["line", "arc", "right", "spiral", "even spiral", "opening", "slope", "parabola", "normalized", "arcLength"],
)
def test_each_kind_of_curve_ends_where_it_does_on_paper(
    curve: Curve, length_m: float, expected: tuple[float, float, float]
) -> None:
    assert end(curve, length_m) == pytest.approx(expected, abs=2e-4)


def test_a_spiral_that_winds_up_without_end_is_none() -> None:
    with pytest.raises(ValueError, match="winds up"):
        curves.spiral(0.0, 1e6, 1000.0)


curvatures = st.floats(-0.1, 0.1)


@settings(max_examples=40, deadline=None)
@given(start=curvatures, finish=curvatures, length_m=st.floats(1.0, 300.0))
def test_a_spiral_is_as_long_as_it_says_and_turned_backwards_the_same(
    start: float, finish: float, length_m: float
) -> None:
    points, heading = curves.spiral(start, finish, length_m)(np.linspace(0.0, length_m, 4001))
    assert np.hypot(*np.diff(points, axis=0).T).sum() == pytest.approx(length_m, rel=1e-5)
    back, _ = curves.spiral(-finish, -start, length_m)(np.array([length_m]))
    turn = heading[-1] + math.pi
    returned = points[-1] + [
        back[0, 0] * math.cos(turn) - back[0, 1] * math.sin(turn),
        back[0, 0] * math.sin(turn) + back[0, 1] * math.cos(turn),
    ]
    assert returned == pytest.approx([0.0, 0.0], abs=1e-6)


@settings(max_examples=25, deadline=None)
@given(start=curvatures, finish=curvatures, widening=st.floats(-0.02, 0.1), length_m=st.floats(5.0, 80.0))
def test_edges_of_lanes_are_drawn_within_a_centimetre(
    tmp_path_factory: pytest.TempPathFactory, start: float, finish: float, widening: float, length_m: float
) -> None:
    plan = geometry(f'<spiral curvStart="{start}" curvEnd="{finish}"/>', length_m)
    text = xodr(road("1", section(lane(-1, width=[(0.0, 4.0, widening, 1e-4, -1e-6)])), plan=plan))
    source = read_opendrive(written(tmp_path_factory.mktemp("curve"), text))
    at = np.linspace(0.0, length_m, 2000)
    points, heading = curves.spiral(start, finish, length_m)(at)
    width = 4.0 + widening * at + 1e-4 * at**2 - 1e-6 * at**3
    outer = points + width[:, None] * np.stack((np.sin(heading), -np.cos(heading)), axis=1)
    for exact, drawn in ((points, source.lanes["1/0/-1"].left), (outer, source.lanes["1/0/-1"].right)):
        line = shapely.LineString(drawn - UNPLACED_ORIGIN_M)
        assert shapely.distance(line, shapely.points(exact)).max() <= CHORD_M


def test_a_straight_road_needs_few_points_and_a_bend_is_as_long_as_on_paper(tmp_path: Path) -> None:
    bend = geometry('<arc curvature="0.01"/>', 50.0 * math.pi, 100.0, (100, 0, 0))
    source = read_opendrive(written(tmp_path, xodr(road("1", plan=geometry() + bend))))
    lane_ = source.lanes["1/0/-1"]
    assert len(lane_.left) < 80
    assert (lane_.left[:, 0] - UNPLACED_ORIGIN_M[0] < 99.0).sum() == 6
    assert mean_length_m(lane_.left, lane_.right) == pytest.approx(100.0 + 0.5 * math.pi * 101.75, rel=1e-4)
