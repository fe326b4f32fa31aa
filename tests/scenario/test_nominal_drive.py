"""The nominal drive: at the limit along the route, whatever is in the way."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from interplan_sumo.batch.custom_references import reservations
from interplan_sumo.scenario.certificates import FILE, Certificate, Summary, write_certificates
from interplan_sumo.scenario.files import write_scenarios
from interplan_sumo.scenario.nominal_drive import ACROSS_MPS2, BRAKES_MPS2, nominal_drive, reaches_goal
from interplan_sumo.scenario.scenario import LanePosition
from tests.batch.busy import PLAIN
from tests.metrics.staging import scenario_on
from tests.worlds import curved_road, straight_road

ROAD = straight_road(lanes=2, length_m=600.0)
SCENE = scenario_on(ROAD, ("11", 20.0), ("11", 320.0))


def test_it_drives_at_the_limit_and_ends_with_the_first_frame_past_the_goal_line():
    track = nominal_drive(ROAD, SCENE)
    assert track.vx_mps.max() == 15.0
    assert track.x_m[-2] <= 320.0 < track.x_m[-1]
    assert reaches_goal(ROAD, SCENE, track)
    assert np.hypot(np.diff(track.x_m), np.diff(track.y_m)) == pytest.approx(track.vx_mps[1:] * 0.1)


def test_one_that_cannot_come_so_far_lasts_a_frame_longer_than_the_scenario():
    far = replace(SCENE, goal=LanePosition("11", 590.0))
    track = nominal_drive(ROAD, far)
    assert len(track) == 301
    assert not reaches_goal(ROAD, far, track)


def test_it_comes_over_to_the_goal_lane():
    track = nominal_drive(ROAD, replace(SCENE, goal=LanePosition("12", 320.0)))
    assert (track.y_m[0], track.y_m[-1]) == pytest.approx((0.0, -3.5), abs=0.01)
    assert np.abs(np.diff(track.y_m)).max() < 0.15


def test_bends_and_lower_limits_are_met_slowly_enough():
    road = curved_road(radius_m=20.0, limit_mps=14.0, run_in_m=60.0)
    scene = scenario_on(road, ("11", 5.0), ("11", 140.0))
    track = nominal_drive(road, replace(scene, start_speed_mps=14.0))
    assert (track.vx_mps * np.abs(track.yaw_rate_radps)).max() < 1.3 * ACROSS_MPS2
    assert np.diff(track.vx_mps).min() >= -BRAKES_MPS2 * 0.1 - 1e-9


def test_a_goal_out_of_reach_is_told(tmp_path: Path):
    hasty = replace(PLAIN, id="mine/1", duration_s=2.0)
    write_scenarios((PLAIN, hasty), tmp_path / "mine.yaml")
    (line,) = reservations((PLAIN, hasty), [str(tmp_path / "mine.yaml")])
    assert line.startswith("mine/1: at the limit the goal line takes more than 2 s")


def test_scenes_without_a_certificate_are_told_where_others_have_one(tmp_path: Path):
    scenes = (PLAIN, replace(PLAIN, id="mine/1"), replace(PLAIN, id="mine/2"))
    write_scenarios(scenes, tmp_path / "mine.yaml")
    summaries = [Summary(PLAIN.id, PLAIN.hash(), 0.95, 150.0, 148.5, True, "0" * 64)]
    summaries.append(Summary("mine/1", "of another scene", 0.95, 150.0, 148.5, True, "0" * 64))
    track = nominal_drive(ROAD, SCENE)
    write_certificates(tmp_path / FILE, [Certificate(summary, track) for summary in summaries])
    (line,) = reservations(scenes, [str(tmp_path / "mine.yaml")])
    assert line.startswith("2 of 3 scenarios have no certificate, such as mine/1: nobody is known to solve them")
    assert reservations(scenes[:1], [str(tmp_path / "mine.yaml")]) == []
