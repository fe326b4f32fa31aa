"""Diagnostics: figures beside the score."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_sumo.metrics.diagnostics import (
    LARGEST_ANGLE_RAD,
    LONGEST_GAP_M,
    diagnostics,
    distances_m,
    hardest_braking,
)
from interplan_sumo.world.actors import Actors
from tests.metrics.staging import drive_at, facts_of
from tests.worlds import cars, drive, straight_road

ROAD = straight_road(lanes=3, length_m=600.0)
CONTACT_M = (5.176 + 4.8) / 2


def detail(actors: Actors | list[Actors] | None, *, x_m: object = 50.0, speed_mps: object = 10.0):
    return diagnostics(facts_of(drive_at(x_m, 0.0, speed_mps, actors=actors), ROAD)).detail


def test_the_nearest_approach_is_between_boxes():
    found = detail(cars((80.0, 0.0), (50.0, -3.5)))["distance_m"]
    assert found["least"] == pytest.approx(3.5 - (2.297 + 2.0) / 2)
    assert found["track"] == "car01"


@settings(max_examples=30)
@given(
    st.lists(
        st.tuples(st.floats(0.0, 100.0), st.floats(-30.0, 30.0), st.floats(0.0, 9.0), st.floats(-3.2, 3.2)),
        min_size=1,
        max_size=12,
    )
)
def test_skipping_far_rows_does_not_change_the_nearest_distance(places: list[tuple[float, float, float, float]]):
    facts = facts_of(drive_at([45.0, 55.0], actors=cars(*places)), ROAD)
    actors = facts.trace.actors
    boxes = np.concatenate([facts.trace.actors.at(k).polygons for k in range(2)])
    egos = np.asarray(shapely.polygons(facts.corners))[actors.frame]
    exact = shapely.distance(egos, boxes)
    for frame in range(2):
        rows = actors.rows(frame)
        assert distances_m(facts)[rows].min() == exact[rows].min()


def test_time_to_collision_at_true_velocities_has_no_steps_and_no_horizon():
    assert detail(cars((50.0 + CONTACT_M + 123.4, 0.0)))["time_to_collision_s"]["least"] == pytest.approx(12.34)
    reversing = cars((50.0 + CONTACT_M + 10.0, 0.0, -10.0))
    assert detail(reversing)["time_to_collision_s"]["least"] == pytest.approx(0.5)
    assert detail(cars((50.0 + CONTACT_M + 10.0, 0.0, 11.0)))["time_to_collision_s"] is None
    faster_behind = cars((50.0 - CONTACT_M - 6.0, 0.0, 12.0))
    assert detail(faster_behind)["time_to_collision_s"]["least"] == pytest.approx(3.0)


def test_waiting_counts_the_steps_that_end_at_rest_and_names_the_longest():
    speeds = [*[0.05] * 5, *[3.0] * 5, *[0.0] * 8, *[3.0] * 3]
    waited = detail(None, x_m=np.full(21, 50.0), speed_mps=speeds)["waiting"]
    assert waited["total_s"] == pytest.approx(1.2)
    assert waited["longest"] == pytest.approx({"duration_s": 0.8, "time_s": 0.9})
    assert detail(None, x_m=np.full(31, 50.0), speed_mps=0.0501)["waiting"] == {"total_s": 0.0, "longest": None}


def test_planner_times_are_summed_up():
    trace = replace(drive(*[10.0] * 5), plan_wall_s=np.array([0.01, 0.02, 0.03, 0.04, 0.5]))
    planner = diagnostics(facts_of(trace, ROAD)).detail["planner_s"]
    assert (planner["p50"], planner["max"]) == (0.03, 0.5)
    assert diagnostics(facts_of(replace(trace, plan_wall_s=np.zeros(0)), ROAD)).detail["planner_s"] is None


def test_jerk_percentiles_need_a_few_frames():
    assert detail(None, x_m=[50.0, 51.0])["jerk_mps3"] is None
    assert detail(None, x_m=50.0 + np.arange(20.0))["jerk_mps3"]["max"] == 0.0


def behind(*speeds_mps: float, y_m: float = 0.0, between: tuple[float, float] | None = None) -> list[Actors]:
    """A car 20 m behind the ego's centre, one speed per frame, and perhaps another one."""
    others = [] if between is None else [(between[0], between[1], 10.0)]
    return [cars((30.0, y_m, speed), *others) for speed in speeds_mps]


def braking(actors: list[Actors], *, heading_rad: float = 0.0):
    return hardest_braking(facts_of(drive_at(np.full(len(actors), 50.0), heading_rad=heading_rad, actors=actors), ROAD))


def test_the_hardest_braking_of_a_follower_is_named():
    found = braking(behind(10.0, 9.9, 9.5, 9.3))
    assert found is not None
    assert found["deceleration_mps2"] == pytest.approx(4.0)
    assert found["time_s"] == pytest.approx(0.2)
    assert found["gap_m"] == pytest.approx(20.0 - CONTACT_M)


TURNED = {off: LARGEST_ANGLE_RAD + off for off in (-0.01, 0.01)}


@pytest.mark.parametrize(
    ("x_m", "y_m", "heading_rad", "follows"),
    [
        *((50.0 - CONTACT_M - LONGEST_GAP_M - off, 0.0, 0.0, off < 0.0) for off in TURNED),  # it is near,
        *((50.0 - 15.0 * np.cos(a), -15.0 * np.sin(a), a, off < 0.0) for off, a in TURNED.items()),  # drives our way,
        (50.0 - 15.0 * np.cos(0.3), -15.0 * np.sin(0.3), 0.3, True),
        *((30.0, (2.297 + 2.0) / 2 + off, 0.0, off < 0.0) for off in TURNED),  # and has some of the ego in its way
    ],
)
def test_a_follower_is_near_drives_our_way_and_has_the_ego_in_its_way(
    x_m: float, y_m: float, heading_rad: float, follows: bool
):
    assert (braking([cars((x_m, y_m, speed, heading_rad)) for speed in (10.0, 9.0)]) is not None) == follows


def test_only_a_follower_counts():
    assert braking(behind(10.0, 9.0, y_m=-3.5)) is None
    assert braking(behind(9.0, 10.0)) is None
    assert braking([cars((70.0, 0.0, speed, np.pi)) for speed in (10.0, 9.0)], heading_rad=0.0) is None


def test_whoever_drives_between_takes_the_blame():
    assert braking(behind(10.0, 9.0, between=(40.0, 0.0))) is None
    assert braking(behind(10.0, 9.0, between=(40.0, -3.5))) is not None


def test_lane_and_offset_are_kept_per_frame():
    series = diagnostics(facts_of(drive_at([50.0, 51.0, 52.0], [0.4, -3.9, 90.0]), ROAD)).series
    assert series["lane"].tolist() == ["11", "12", ""]
    np.testing.assert_allclose(series["offset_m"], [0.4, -0.4, np.nan], atol=1e-9)
