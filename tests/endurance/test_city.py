"""A city that never empties: the number of its vehicles is held, out of the ego's sight, and nobody is taken away."""

from __future__ import annotations

from itertools import count
from math import hypot

import numpy as np
import pytest

from interplan_sumo.endurance.city import City, state_of, step
from interplan_sumo.endurance.saturation import flow_density_curves, saturation_per_km
from interplan_sumo.maps.store import maps
from interplan_sumo.simulation.flow import OUT_OF_SIGHT_M, OnTheRoad
from interplan_sumo.simulation.vehicle_types import vehicle_type_file
from interplan_sumo.world.ego import EgoState

CITY = City("back_bay", 2.0, vehicle_type_file("mixed"))


def test_an_empty_city_fills_and_stays_filled() -> None:
    with CITY.empty(np.random.default_rng(0)) as traffic:
        for _ in range(150):
            step(traffic)
        assert len(traffic.agents.names) >= 0.9 * CITY.vehicles
        state = state_of(traffic, CITY.network)
    assert 0.6 * CITY.vehicles <= len(state.spawns) <= CITY.vehicles
    programs = CITY.network.lights
    assert state.lights.phases.keys() == programs.phases.keys()
    assert all(set(state.lights.states(light)) == set(programs.states(light)) for light in programs.phases)
    for each in state.spawns:
        assert each.route[0] == CITY.network.lanes[each.lane].edge
        assert not CITY.network.lanes[each.lane].internal


def test_nobody_enters_in_the_ego_s_sight_and_nobody_is_sent_away() -> None:
    flow = CITY.flow(np.random.default_rng(1), map(str, count()))
    nobody = OnTheRoad((), (), (), np.zeros(0), np.zeros(0), (), np.zeros(0), np.zeros(0))
    x_m, y_m = CITY.network.lanes[sorted(CITY.demand.lanes)[0]].line.points[0].tolist()
    ego = EgoState(0.0, x_m, y_m, 0.0)
    entered = [flow.changes(nobody, ego, (0.0, 0.0), lambda _: True) for _ in range(20)]
    assert sum(len(each.entering) for each in entered) > 20
    assert not any(each.leaving for each in entered)
    for each in entered:
        for _, spawn in each.entering:
            lane = CITY.network.lanes[spawn.lane]
            at = lane.plain_line.pose_at(lane.arc_of(spawn.position_m - spawn.driver.length_m / 2.0))
            assert hypot(at.x_m - x_m, at.y_m - y_m) >= OUT_OF_SIGHT_M - 0.5


def test_routes_end_where_the_map_does_and_pass_no_road_twice() -> None:
    flow = CITY.flow(np.random.default_rng(2), map(str, count()))
    ways = [flow.route_from(lane, flow._arrivals[0]) for lane in sorted(CITY.demand.lanes)[:40]]
    ends = [all(not CITY.network.links[lane] for lane in CITY.network.edges[way[-1]]) for way in ways]
    assert np.mean(ends) >= 0.9
    assert np.mean([len(set(way)) == len(way) for way in ways]) >= 0.9


def test_every_shipped_district_has_been_measured() -> None:
    curves = flow_density_curves()
    assert curves.keys() == maps().keys()
    for curve in curves.values():
        assert curve.density_per_km[0] <= curve.saturation_per_km <= curve.density_per_km[-1]
        assert len(curve.flow_per_hour) == len(curve.density_per_km)
    assert min(each.saturation_per_km for each in curves.values()) <= saturation_per_km("somebody_s_town")
    assert saturation_per_km("one_north") == pytest.approx(curves["one_north"].saturation_per_km)
