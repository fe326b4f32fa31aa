"""The traffic of a segment at its start: as the city was, with room for the ego, and nobody inside anybody else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from interplan_sumo.endurance.city import City, city_state
from interplan_sumo.endurance.city_traffic import AROUND_M, NearTraffic, open_trip
from interplan_sumo.endurance.opportunities import RareOpportunity
from interplan_sumo.endurance.records import RareKind
from interplan_sumo.endurance.segment_plan import drawn_scenario
from interplan_sumo.endurance.trip import touches
from interplan_sumo.endurance.trip_way import TripWay
from interplan_sumo.maps.store import load_roads
from interplan_sumo.simulation.setup import start_state
from interplan_sumo.simulation.sumo import sumo
from interplan_sumo.simulation.vehicle_types import vehicle_type_file
from interplan_sumo.world.ego import PACIFICA, EgoState
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


@pytest.mark.slow
def test_a_red_light_runner_drives_on_over_red_and_others_wait() -> None:
    roads = load_roads(CITY.map)
    rng = np.random.default_rng(3)
    trip = drawn_scenario("endure/3", roads, rng)
    trip, traffic, staging = open_trip(trip, roads, CITY, 1, rng, PACIFICA)
    crossed, waited = "", 0
    with traffic:
        ego = start_state(replace(trip, start_speed_mps=0.0), roads)
        agents, runner = traffic.agents, ""
        for step in range(900):
            now = {name: _before_red(name) for name in agents.names}
            staging.notice(replace(ego, time_s=0.1 * step))
            if not runner:
                runner = next((name for name, state in now.items() if state is not None and 10.0 < state < 30.0), "")
                if runner:
                    staging.begin(RareOpportunity("red_light_runner", agents.token_of(runner), runner), ego, agents)
            traffic.react(ego)
            traffic.place_ego(ego)
            traffic.advance()
            inside = {name for name in agents.names if sumo.vehicle.getLaneID(name).startswith(":")}
            over = {name for name in inside if (now.get(name) or np.inf) < 3.0}
            crossed = crossed or ("runner" if runner in over else "")
            assert over <= {runner}
            waited += sum(state is not None and state < 5.0 for state in now.values())
            if crossed and not staging.is_active:
                break
    assert crossed == "runner"
    assert waited > 0
    assert staging.spans[0].kind == "red_light_runner"
    assert staging.runs_red() == frozenset()


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "number"), [("jaywalker", 0), ("door", 0), ("crosswalk", 1)])
def test_somebody_comes_into_sight_ahead_of_the_ego(kind: RareKind, number: int) -> None:
    """On its way, out of sight; who is at the kerb is seen by all from the next step on."""
    roads = load_roads(CITY.map)
    rng = np.random.default_rng(number)
    trip = drawn_scenario(f"endure/{number}", roads, rng)
    trip, traffic, staging = open_trip(trip, roads, CITY, 0, rng, PACIFICA)
    way = TripWay(trip, roads)
    with traffic:
        before = set(traffic.observe().actors.ids)
        poses = (way.line.poses_at(arc_m)[0].tolist() for arc_m in np.arange(0.0, way.line.length_m - 120.0, 5.0))
        egos = [EgoState(0.0, x_m, y_m, heading_rad, 8.0) for x_m, y_m, heading_rad in poses]
        looks = ((ego, each) for ego in egos for each in staging.look(ego, traffic.agents))
        ego, found = next((ego, each) for ego, each in looks if each.kind == kind)
        assert found.name == next(each.name for each in staging.look(ego, traffic.agents) if each.kind == kind)
        staging.begin(found, ego, traffic.agents)
        assert staging.look(ego, traffic.agents) == []  # nothing begins meanwhile
        staging.notice(ego)
        start = start_state(trip, roads)
        traffic.react(start)
        traffic.place_ego(start)
        traffic.advance()
        actors = traffic.observe().actors
        (new,) = set(actors.ids) - before
        row = actors.ids.index(new)
        away_m = float(np.hypot(actors.x_m[row] - ego.x_m, actors.y_m[row] - ego.y_m))
        assert 100.0 < away_m < 125.0
        assert not roads.drivable((float(actors.x_m[row]), float(actors.y_m[row])))[0]


def _before_red(name: str) -> float | None:
    """How far an agent that moves is from a red light that holds for it, and that it could stop at."""
    ahead = next(iter(sumo.vehicle.getNextTLS(name)), None)
    if ahead is None or ahead[3] not in "r" or sumo.vehicle.getSpeed(name) < 0.1:
        return None
    return float(ahead[2])
