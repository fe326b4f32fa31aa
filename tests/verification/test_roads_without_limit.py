"""Courses on maps without limits, and drives that begin beside the middle of their lane or inside a junction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from interplan_sumo.scenario.scenario import LanePosition, Scenario
from interplan_sumo.scenario.suite import find_scenario
from interplan_sumo.tiny_worlds import curved_road, junction
from interplan_sumo.verification.certificates import certify
from interplan_sumo.verification.corridor import WITHOUT_LIMIT_MPS, frenet_corridor
from interplan_sumo.verification.drivable_paths import LATERAL_MPS2, Swerve, drivable_path
from interplan_sumo.world.roads import Roads


def along(roads: Roads, start: str, goal: str, route: tuple[str, ...]) -> Scenario:
    goal_m = roads[goal].centerline.length_m - 5.0
    return Scenario("tiny/0", "tiny", roads.name, LanePosition(start, 3.0), 3.0, LanePosition(goal, goal_m), route)


def test_without_a_limit_a_bend_is_driven_at_what_is_comfortable() -> None:
    roads = curved_road(radius_m=20.0, limit_mps=None)
    found = frenet_corridor(along(roads, "11", "11", ("1",)), roads)
    cap_mps = drivable_path(found, found.lane_paths[0], Swerve()).cap_mps
    assert cap_mps.max() == WITHOUT_LIMIT_MPS
    assert cap_mps.min() == pytest.approx(np.sqrt(LATERAL_MPS2 * 20.0), rel=0.1)


def test_a_corridor_may_begin_inside_a_junction() -> None:
    roads = junction()
    path = next(iter(roads.connectors.values()))
    route = roads.route_through((path.id, path.to_lane_id))
    found = frenet_corridor(along(roads, path.id, path.to_lane_id, route), roads)
    assert found.lane_paths[found.start_path].lanes == (path.id, path.to_lane_id)
    assert found.lane_paths[found.start_path].at_goal


@pytest.mark.slow
def test_a_drive_that_begins_beside_the_middle_of_its_lane_is_found() -> None:
    scenario = find_scenario("lane_change_ltd/0")
    aside = replace(scenario, start=replace(scenario.start, left_m=0.45), start_speed_mps=6.0)
    verdict = certify(aside)
    assert verdict.certificate is not None, verdict.reason
    assert verdict.certificate.summary.score == pytest.approx(1.0, abs=0.02)
