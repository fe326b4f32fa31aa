"""The goal line: what is worked out once for a long way ahead says the same as the nearest point of the route."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from interplan_sumo.scenario.route import GoalLine
from interplan_sumo.world.geometry import Polyline

COORDINATES = st.tuples(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0))
SHARES = st.floats(0.0, 1.0)


@given(
    st.lists(COORDINATES, min_size=2, max_size=6, unique_by=lambda p: (round(p[0]), round(p[1]))),
    SHARES,
    st.lists(COORDINATES, min_size=2, max_size=5),
)
def test_on_any_way_beside_any_route_it_is_passed_where_the_nearest_point_of_the_route_lies_beyond(
    corners: list[tuple[float, float]], share: float, way: list[tuple[float, float]]
) -> None:
    line = Polyline(np.array(corners))
    goal_m = share * line.length_m
    goal = GoalLine(line, goal_m)
    for start, end in pairwise(way):
        for x, y in np.linspace(start, end, 20).tolist():
            arc_m, _ = line.project_point(x, y)
            if abs(arc_m - goal_m) > 1e-6:
                assert goal.is_passed(x, y) == (arc_m > goal_m)


def test_a_route_that_comes_back_beside_its_start_is_not_passed_there_by_one_who_starts() -> None:
    line = Polyline(np.array([(0.0, 0.0), (100.0, 0.0), (100.0, 4.0), (0.0, 4.0)]))
    goal = GoalLine(line, 150.0)
    assert not goal.is_passed(0.0, 1.9)
    assert goal.is_passed(0.0, 2.1)
    assert not goal.is_passed(0.0, 1.9)
