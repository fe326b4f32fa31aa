"""Progress: forward motion along the route, beside the expert's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_sumo.errors import InputError
from interplan_sumo.metrics.expert_route import across_m, progress_per_frame, route_blocks
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.progress import (
    making_progress,
    progress,
    progress_ratio,
)
from interplan_sumo.world.geometry import Polyline, Pose
from tests.metrics.staging import drive_at, facts_of, lane_y_m, scenario_on
from tests.worlds import drive, straight_road

ROAD = straight_road(lanes=2, length_m=300.0, cuts_m=((100.0, 110.0),))
SCENARIO = scenario_on(ROAD, ("11", 20.0), ("31", 150.0))
"""The goal is at x = 260."""
EXPERT = drive_at([10.0, 260.0]).ego


def facts_between(ego_x: object, expert_x: object, *, ego_y: object = 0.0) -> Facts:
    expert = drive_at(expert_x).ego
    return facts_of(drive_at(ego_x, ego_y), ROAD, expert, SCENARIO)


@pytest.mark.parametrize(
    ("ego_m", "expert_m", "ratio"),
    [
        (50.0, 100.0, 0.5),
        (120.0, 100.0, 1.0),
        (0.0, 100.0, 0.02),
        (-2.0, 100.0, 0.02),
        (-2.0001, 100.0, 0.0),
        (0.0, 0.0, 1.0),
        (0.5, 1.9, 1.0),
        (1.0, 4.0, 0.5),
    ],
)
def test_both_distances_are_floored_and_driving_back_scores_nothing(ego_m: float, expert_m: float, ratio: float):
    assert progress_ratio(ego_m, expert_m) == pytest.approx(ratio)


@given(st.floats(-50.0, 500.0), st.floats(0.0, 100.0), st.floats(-10.0, 500.0))
def test_more_is_never_less(ego_m: float, more_m: float, expert_m: float):
    assert 0.0 <= progress_ratio(ego_m, expert_m) <= progress_ratio(ego_m + more_m, expert_m) <= 1.0


def test_the_lateral_position_does_not_matter():
    for y in (0.0, lane_y_m(1), 3.5, -30.0):
        assert progress(facts_between([20.0, 70.0], [20.0, 120.0], ego_y=y)).score == pytest.approx(0.5)


def test_what_lies_beyond_the_goal_counts_for_neither():
    assert progress(facts_between([20.0, 261.0], [20.0, 290.0])).score == 1.0
    assert progress(facts_between([20.0, 140.0], [20.0, 290.0])).score == pytest.approx(0.5)


def test_the_reason_names_both_distances():
    reason = progress(facts_between([20.0, 70.0], [20.0, 120.0])).reason
    assert str(reason).startswith("advanced 50.0 m along the route, the expert 100.0 m; ")
    reason = making_progress(facts_between([20.0, 21.0], [20.0, 120.0])).reason
    wanted = "less than 20% of the expert's way: advanced 1.0 m along the route, the expert 100.0 m; "
    assert str(reason).startswith(wanted)


def test_places_that_share_a_connector_with_the_one_before_are_no_change():
    places = (("11",), ("21", "22"), ("22",), ("32",))
    assert [b.lane_id for b in route_blocks(ROAD, places)] == ["11", "21", "32"]


def test_who_returns_to_an_earlier_roadblock_earns_nothing_there():
    blocks = route_blocks(ROAD, (("11",), ("21",), ("31",)))
    gained = progress_per_frame(blocks, np.array([[95.0, 0.0], [112.0, 0.0], [95.0, 0.0], [120.0, 0.0]]))
    np.testing.assert_allclose(gained, [0.0, 17.0, 0.0, 8.0], atol=1e-9)


def test_lines_that_join_are_crossed_by_the_length_of_those_between():
    lines = [
        Polyline(np.array(((a, 0.0), (b, 0.0)))) for a, b in ((0.0, 10.0), (10.0, 17.0), (17.0, 20.0), (20.0, 30.0))
    ]
    assert across_m(lines) == pytest.approx(10.0)
    assert across_m(lines[:2]) == pytest.approx(0.0)


@settings(max_examples=50)
@given(
    st.lists(st.floats(0.0, 15.0), min_size=2, max_size=15),
    st.lists(st.floats(0.0, 5.0), min_size=15, max_size=15),
    st.floats(-40.0, 40.0),
)
def test_faster_is_never_less_progress(speeds: list[float], more: list[float], beside_m: float):
    # not so in nuPlan's measure, where a pose on the edge of a roadblock earns nothing
    faster = [s + m for s, m in zip(speeds, more, strict=False)]
    slow, fast = (
        progress(facts_of(drive(*each, start=Pose(10.0, beside_m, 0.0), dt_s=1.0), ROAD, EXPERT, SCENARIO)).score
        for each in (speeds, faster)
    )
    assert slow is not None
    assert fast is not None
    assert fast >= slow - 1e-12


@pytest.mark.parametrize(
    ("speeds", "frame"),
    [
        ([9.0] * 5 + [0.0] * 12 + [9.0] * 5 + [0.49] * 15 + [9.0] * 3, 22),
        ([9.0] * 5 + [0.0] * 9 + [9.0] * 5, 18),
        ([9.0] * 5 + [-1.0] * 9, 5),
    ],
    ids=["the longest wait", "a wait of less than a second", "the farthest place"],
)
def test_points_are_lost_where_the_ego_stops_advancing(speeds: list[float], frame: int):
    facts = facts_of(drive(*speeds, start=Pose(20.0, 0.0, 0.0)), ROAD, EXPERT, SCENARIO)
    assert progress.lost_at(facts, progress(facts)) == frame


def test_interplans_progress_needs_the_scenario():
    with pytest.raises(InputError, match="profile nuplan"):
        progress(facts_of(drive_at([20.0, 70.0]), ROAD))
