"""Traffic at the start: nobody overlaps, hits anybody soon or must brake hard; and the spawner keeps to it."""

from __future__ import annotations

from dataclasses import replace

import libsumo
import numpy as np
import pytest
from stages import ONE_LANE, TWO_LANES, staged
from worlds import cars, junction, straight_road

from interplan_sumo.maps.store import load_roads, maps
from interplan_sumo.scenario.constant_velocity import ego_held, first_contacts, held, lane_ahead, lanes_ahead
from interplan_sumo.scenario.scenario import LanePosition, Scenario, TrafficDemand
from interplan_sumo.simulation.network import read_network
from interplan_sumo.verification.traffic_checks import braking_problems, contact_problems, traffic_problems
from tests.quick import few

FRONT_M = 20.0 + 5.176 / 2.0
"""Of the ego, which drives at 10 m/s."""
HALF_CAR_M = 2.4

# --- who drives where ----------------------------------------------------------------------------


def test_the_lane_ahead_follows_the_route_and_else_goes_straight_on() -> None:
    crossing = junction()
    assert lane_ahead(crossing, "1", 0.0, 150.0).points[-1] == pytest.approx((72.0, -1.75))
    left = lane_ahead(crossing, "1", 0.0, 150.0, route=("1", "14", "8"))
    assert left.points[-1] == pytest.approx((1.75, 72.0))
    assert lane_ahead(crossing, "1", 10.0, 20.0).length_m == pytest.approx(50.0)


def test_where_one_cannot_go_straight_on_every_way_is_possible() -> None:
    crossing = junction()
    assert len(lanes_ahead(crossing, "1", 0.0, 150.0)) == 1
    bends = {i: c for i, c in crossing.connectors.items() if i != "13"}
    blocks = {i: b for i, b in crossing.roadblocks.items() if i != "13"}
    tee = replace(crossing, connectors=bends, roadblocks=blocks)
    assert len(lanes_ahead(tee, "1", 0.0, 150.0)) == 2


def test_who_leaves_the_map_is_gone_and_who_stands_beside_the_road_stays() -> None:
    road = straight_road(length_m=100.0)
    actors = cars((90.0, 0.0, 10.0), (50.0, 9.0, 0.0))
    (gone, left), (stays, at) = held(road, actors)
    assert (gone, stays) == (0, 1)
    assert left[5, 0] == pytest.approx(95.0)
    assert left[-1, 0] > 1e5
    assert at[-1, :2] == pytest.approx((50.0, 9.0))


def test_the_held_ego_stays_beside_the_middle_of_its_lane() -> None:
    poses = ego_held(staged(start=LanePosition("11", 20.0, 0.3)), ONE_LANE)
    assert poses[0, :2] == pytest.approx((20.0, 0.3))
    assert poses[-1, :2] == pytest.approx((50.0, 0.3))


def test_contacts_are_between_owners_only_and_first_ones() -> None:
    still = np.zeros((2, 3))
    coming = np.array(((5.0, 0.0, 0.0), (4.0, 0.0, 0.0)))
    size = np.full((3, 2), (4.6, 1.8))
    poses = np.stack((still, still, coming))
    assert first_contacts(poses, size, np.array((0, 0, 1))) == {(0, 1): 1}


# --- contacts and braking ------------------------------------------------------------------------


@pytest.mark.parametrize(("gap_m", "sound"), [(14.98, True), (14.92, False)])
def test_who_drives_slower_ahead_is_not_reached_within_3_s(gap_m: float, sound: bool) -> None:
    """5 m/s closing for 3 s; 5 cm are no contact yet."""
    actors = cars((FRONT_M + gap_m + HALF_CAR_M, 0.0, 5.0))
    found = contact_problems(staged(), ONE_LANE, actors, frozenset(actors.ids))
    assert (found == []) == sound
    if not sound:
        assert "the ego and the vehicle on lane 11" in found[0]
        assert "touch after 3.0 s if all hold lane and speed" in found[0]


def test_overlaps_are_named_and_those_of_standing_things_are_others_business() -> None:
    actors = cars((100.0, 0.0, 5.0), (104.7, 0.0, 5.0))
    (found,) = contact_problems(staged(), TWO_LANES, actors, frozenset(actors.ids))
    assert "overlap at the start, expected no more than 5 cm" in found
    assert contact_problems(staged(), TWO_LANES, actors, frozenset()) == []
    assert contact_problems(staged(), TWO_LANES, cars((100.0, 0.0), (104.76, 0.0)), frozenset(actors.ids)) == []


def test_crossing_traffic_is_seen() -> None:
    crossing = junction()
    scenario = replace(staged(), start=LanePosition("1", 55.0), goal=LanePosition("7", 50.0), route=("1", "13", "7"))
    from_the_south = cars((1.75, -19.0, 10.0, np.pi / 2))
    (found,) = contact_problems(scenario, crossing, from_the_south, frozenset(from_the_south.ids))
    assert "the ego and the vehicle on lane 2" in found


def test_the_first_step_is_milder_than_3_mps2_of_who_has_not_left_the_map() -> None:
    before = cars((50.0, 0.0, 10.0))
    assert braking_problems(ONE_LANE, before, cars((51.0, 0.0, 9.71))) == []
    (said,) = braking_problems(ONE_LANE, before, cars((51.0, 0.0, 9.69)))
    assert "the vehicle on lane 11 at 50.0 m (10.0 m/s) brakes with 3.1 m/s2 in the first step" in said
    assert braking_problems(ONE_LANE, cars((299.0, 0.0, 10.0)), cars()) == []


# --- on SUMO -------------------------------------------------------------------------------------


def test_an_empty_road_needs_no_sumo() -> None:
    assert traffic_problems(staged(map="nowhere"), ONE_LANE) == []


@pytest.mark.parametrize("name", few(["back_bay", "one_north", "hazelwood", "strip"], 1, 2))
def test_dense_traffic_near_junctions_is_safe_at_the_start(name: str) -> None:
    """Every tenth lane that is long enough, oncoming lanes full, whatever the lights show."""
    roads = load_roads(name)
    long = [lane for lane in roads.lanes.values() if lane.centerline.length_m > 90.0 and roads.outgoing(lane.id)]
    for lane in long[::10]:
        end_m = lane.centerline.length_m - 1.0
        scenario = Scenario(
            f"test/{lane.id}", "test", name, LanePosition(lane.id, 10.0), 5.0, LanePosition(lane.id, end_m),
            (lane.roadblock_id,), TrafficDemand("high", "mixed", "high"),
        )  # fmt: skip
        assert traffic_problems(scenario, roads) == []


@pytest.mark.parametrize("name", sorted(maps()))
def test_the_spawner_knows_the_lights_as_they_are_when_sumo_starts(name: str) -> None:
    network = read_network(maps()[name].network)
    libsumo.start(["sumo", "--net-file", str(network.path), "--no-step-log", "true", "--no-warnings", "true"])
    try:
        shown = {
            light: libsumo.trafficlight.getRedYellowGreenState(light) for light in libsumo.trafficlight.getIDList()
        }
    finally:
        libsumo.close()
    assert shown == network.lights.shown
