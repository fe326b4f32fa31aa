"""Slow vehicles: where the scenario puts them, no faster than it says, beside the middle, and nobody before them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from networks import stepped

from interplan_sumo.errors import ScenarioError
from interplan_sumo.maps.store import load_roads
from interplan_sumo.scenario.scenario import LanePosition, Obstacle, PlacedVehicle, Scenario, TrafficDemand, VehicleKind
from interplan_sumo.simulation.setup import open_traffic, start_state
from interplan_sumo.world.actors import ActorKind, Actors
from tests.scenes import scene

LTD = scene("lane_change_ltd/0")
ROADS = load_roads(LTD.map)
LANE = ROADS["402031"]
EMPTY = replace(LTD, id="test/slow", traffic=TrafficDemand("none"), start=LanePosition("402031", 20.0))


def seen(scenario: Scenario, steps: int) -> list[Actors]:
    ego = start_state(scenario, ROADS)
    with open_traffic(scenario, ROADS) as traffic:
        return list(stepped(traffic, lambda _: ego, steps))


@pytest.mark.parametrize(("kind", "left_m"), [("bicycle", -0.9), ("bicycle", 0.6), ("tractor", 0.0)])
def test_it_keeps_its_place_in_the_lane_and_never_drives_faster_than_it_starts(
    kind: VehicleKind, left_m: float
) -> None:
    vehicle = PlacedVehicle(LanePosition("402031", 100.0, left_m), 4.0, kind)
    drives = seen(replace(EMPTY, vehicles=(vehicle,)), 60)
    assert drives[0].kind[0] == (ActorKind.BICYCLE if kind == "bicycle" else ActorKind.VEHICLE)
    places = [LANE.centerline.project_point(float(each.x_m[0]), float(each.y_m[0])) for each in drives]
    assert places[0] == pytest.approx((100.0, left_m), abs=0.02)
    assert max(abs(aside_m - left_m) for _, aside_m in places) < 0.05
    assert max(float(each.speed_mps[0]) for each in drives) <= 4.0 + 1e-6
    assert places[-1][0] - places[0][0] == pytest.approx(5.9 * 4.0, abs=0.5)


def test_other_vehicles_start_on_the_centre_line() -> None:
    with pytest.raises(ScenarioError, match=r"vehicles\[0\]\.place\.left_m is 0\.5, expected 0"):
        replace(EMPTY, vehicles=(PlacedVehicle(LanePosition("402031", 100.0, 0.5), 4.0),))


def between(scenario: Scenario, far_m: float) -> int:
    """How many agents start on the ego's lane, ahead of it, up to a place."""
    (first,) = seen(scenario, 1)
    moving = np.flatnonzero(first.kind == ActorKind.VEHICLE).tolist()
    places = [LANE.centerline.project_point(float(first.x_m[row]), float(first.y_m[row])) for row in moving]
    return sum(21.0 < arc_m < far_m and abs(left_m) < 1.0 for arc_m, left_m in places)


@pytest.mark.parametrize("slow", [True, False])
def test_nobody_is_drawn_between_the_ego_and_what_stands_or_crawls_before_it(slow: bool) -> None:
    """It would stand there for good, in the ego's way; where nothing is in the way, somebody drives there."""
    dense = replace(EMPTY, traffic=TrafficDemand("high"))
    place = LanePosition("402031", 110.0)
    blocked = (
        replace(dense, vehicles=(PlacedVehicle(place, 4.0, "tractor"),))
        if slow
        else replace(dense, obstacles=(Obstacle(place),))
    )
    assert between(dense, 100.0) > 0
    assert between(blocked, 100.0) == 0
