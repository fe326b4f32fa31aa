"""The traffic of a segment at its start: as the city was, with room for the ego, and nobody inside anybody else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from interplan_sumo.endurance.city import City, city_state
from interplan_sumo.endurance.city_traffic import AROUND_M, NearTraffic, open_trip
from interplan_sumo.endurance.opportunities import RareOpportunity
from interplan_sumo.endurance.segment_plan import drawn_scenario
from interplan_sumo.endurance.trip import touches
from interplan_sumo.maps.store import load_roads
from interplan_sumo.simulation.setup import start_state
from interplan_sumo.simulation.vehicle_types import vehicle_type_file
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import penetration_m

CITY = City("back_bay", 6.0, vehicle_type_file("mixed"))


@pytest.mark.slow
def test_a_segment_begins_in_the_city_as_it_is_and_nobody_is_inside_anybody() -> None:
    roads = load_roads(CITY.map)
    rng = np.random.default_rng(0)
    trip = drawn_scenario("endure/0", roads, rng)
    trip, traffic, staging = open_trip(trip, roads, CITY, 0, rng, PACIFICA)
    with traffic:
        ego = start_state(trip, roads)
        actors = traffic.observe().actors
        assert len(actors) >= 0.9 * len(city_state(CITY, 0).spawns)
        assert not touches(ego, PACIFICA, actors)
        one, two = np.triu_indices(len(actors), 1)
        apart_m = np.hypot(actors.x_m[one] - actors.x_m[two], actors.y_m[one] - actors.y_m[two])
        one, two = one[apart_m < 20.0], two[apart_m < 20.0]
        assert penetration_m(actors.corners[one], actors.corners[two]).max() <= 0.05
        near = NearTraffic(traffic, ego).observe().actors
        assert set(near.ids) <= set(actors.ids)
        assert np.hypot(near.x_m - ego.x_m, near.y_m - ego.y_m).max() <= AROUND_M
    assert not staging.is_active


@pytest.mark.slow
def test_one_that_breaks_down_stands_for_half_a_minute_and_drives_on() -> None:
    roads = load_roads(CITY.map)
    rng = np.random.default_rng(1)
    trip = drawn_scenario("endure/1", roads, rng)
    trip, traffic, staging = open_trip(trip, roads, CITY, 0, rng, PACIFICA)
    with traffic:
        ego = start_state(replace(trip, start_speed_mps=0.0), roads)
        agents = traffic.agents
        dx = agents.front_x + CITY.ids.origin_m[0] - ego.x_m
        dy = agents.front_y + CITY.ids.origin_m[1] - ego.y_m
        ahead_m = dx * np.cos(ego.heading_rad) + dy * np.sin(ego.heading_rad)
        row = int(np.argmax(np.where(ahead_m > 30.0, agents.kinematics.speed_mps, -1.0)))
        name = agents.names[row]
        staging.begin(RareOpportunity("blocked_lane", agents.token_of(name), name), ego, agents)
        stood_s, moved_on = 0.0, False
        for step in range(600):
            staging.notice(replace(ego, time_s=0.1 * step))
            traffic.react(ego)
            traffic.place_ego(ego)
            traffic.advance()
            speed_mps = float(agents.kinematics.speed_mps[agents.rows[name]])
            stood_s += 0.1 if speed_mps == 0.0 else 0.0
            moved_on = stood_s > 0.0 and speed_mps > 1.0
            if moved_on:
                break
    assert moved_on
    assert 29.0 <= stood_s <= 50.0
    assert not staging.is_active
    assert staging.spans[0].ended_s is not None
