"""The traffic of a segment at its start: as the city was, with room for the ego, and nobody inside anybody else."""

from __future__ import annotations

import numpy as np
import pytest

from interplan_sumo.endurance.city import City, city_state
from interplan_sumo.endurance.city_traffic import AROUND_M, NearTraffic, open_trip
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
