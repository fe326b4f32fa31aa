"""Tracks answer as polylines do, to the bit."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_sumo.simulation.plain_polyline import PlainPolyline
from interplan_sumo.world.geometry import Polyline

COORDINATE = st.floats(-200.0, 200.0)
POINT = st.tuples(COORDINATE, COORDINATE)
LINE = st.lists(POINT, min_size=2, max_size=9, unique=True)


def polyline(points: list[tuple[float, float]]) -> Polyline | None:
    apart = np.hypot(*np.diff(np.array(points), axis=0).T).min() > 1e-3
    return Polyline(np.array(points)) if apart else None


@settings(max_examples=100)
@given(points=LINE, at=POINT, between_m=st.none() | st.tuples(st.floats(-10, 300), st.floats(0, 100)))
def test_projections_are_those_of_a_polyline(
    points: list[tuple[float, float]], at: tuple[float, float], between_m: tuple[float, float] | None
) -> None:
    line = polyline(points)
    if line is None:
        return
    stretch = (between_m[0], sum(between_m)) if between_m is not None else None
    assert PlainPolyline(line).project(*at, stretch) == line.project_point(*at, stretch)


@settings(max_examples=100)
@given(points=LINE, share=st.floats(-0.2, 1.2))
def test_poses_are_those_of_a_polyline(points: list[tuple[float, float]], share: float) -> None:
    line = polyline(points)
    if line is None:
        return
    assert PlainPolyline(line).pose_at(share * line.length_m) == line.pose_at(share * line.length_m)
