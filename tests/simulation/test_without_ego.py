"""Without the ego: what agents say they would do is what they do in a twin of the step from which the ego is taken."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import cos, sin

import pytest

from interplan_sumo.maps.store import load_roads
from interplan_sumo.scenario.route import route_centerline
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.ego_proxy import EGO
from interplan_sumo.simulation.setup import open_sumo_traffic, start_state
from interplan_sumo.simulation.sumo import DT_S, sumo
from interplan_sumo.simulation.sumo_traffic import SumoTraffic
from interplan_sumo.world.ego import EgoState
from tests.quick import few
from tests.scenes import scene
from tests.simulation.rude_egos import Driver, Wish, driven

SCENE = scene("lane_change_htd/1")
BESIDE_M = 3.5 if load_roads(SCENE.map).left_of(SCENE.start.lane) is not None else -3.5
STEPS = 60


@dataclass(frozen=True)
class Braking:
    """An agent that brakes in the step after a frame."""

    frame: int
    name: str
    mps2: float
    without_ego_mps2: float | None
    """What it says it would have chosen instead; None: it was not asked."""


def rude(scenario: Scenario, wish: Driver) -> list[EgoState]:
    roads = load_roads(scenario.map)
    return driven(route_centerline(roads, scenario), start_state(scenario, roads), wish, STEPS)


def cutting_in(_time_s: float, _arc_m: float) -> Wish:
    """At once into the lane beside, and slowly on."""
    return Wish(BESIDE_M, 6.0)


def step(traffic: SumoTraffic, egos: list[EgoState], frame: int) -> None:
    traffic.react(egos[frame])
    traffic.place_ego(egos[frame + 1])
    traffic.advance()


def speeds(traffic: SumoTraffic) -> dict[str, float]:
    return {name: sumo.vehicle.getSpeed(name) for name in traffic._agents.names}


def brakings(scenario: Scenario, egos: list[EgoState], least_mps2: float) -> list[Braking]:
    """All hard braking of a drive."""
    found: list[Braking] = []
    with open_sumo_traffic(scenario, load_roads(scenario.map)) as traffic:
        for frame in range(STEPS):
            before = speeds(traffic)
            step(traffic, egos, frame)
            asked = traffic.observe().ax_without_ego or {}
            for name, now in speeds(traffic).items():
                mps2 = (before.get(name, now) - now) / DT_S
                if mps2 >= least_mps2:
                    token = traffic._agents.token_of(name)
                    found.append(Braking(frame, name, mps2, asked.get(token)))
    return found


def in_a_twin(scenario: Scenario, egos: list[EgoState], each: Braking) -> float:
    """What the agent does in the same step if the ego is taken away before it, in m/s2."""
    with open_sumo_traffic(scenario, load_roads(scenario.map)) as traffic:
        for frame in range(each.frame):
            step(traffic, egos, frame)
        before = sumo.vehicle.getSpeed(each.name)
        sumo.vehicle.remove(EGO)
        for name in traffic._agents.names:
            sumo.vehicle.setSpeed(name, -1.0)
            sumo.vehicle.setSpeedMode(name, 31)
            for of in ("carFollowModel", "junctionModel"):
                sumo.vehicle.setParameter(name, f"{of}.ignoreIDs", "")
        sumo.simulationStep()
        return (sumo.vehicle.getSpeed(each.name) - before) / DT_S


def stopping(time_s: float, _arc_m: float) -> Wish:
    """At 10 m/s for a second, then to a stand."""
    return Wish(0.0, 0.0 if time_s > 1.0 else 10.0)


@pytest.mark.parametrize("wish", few([cutting_in, stopping], 1))
def test_who_is_forced_to_brake_does_not_in_a_twin_without_the_ego(wish: Driver):
    egos = rude(SCENE, wish)
    forced = [each for each in brakings(SCENE, egos, 3.0) if each.without_ego_mps2 is not None]
    assert forced
    for each in forced[:: max(1, len(forced) // 4)]:
        assert each.without_ego_mps2 == pytest.approx(in_a_twin(SCENE, egos, each), abs=0.6)
        assert each.mps2 + (each.without_ego_mps2 or 0.0) >= 0.5


def test_who_brakes_for_others_is_not_laid_to_the_ego():
    off_the_road = [
        replace(each, x_m=each.x_m - 500.0 * sin(each.heading_rad), y_m=each.y_m + 500.0 * cos(each.heading_rad))
        for each in rude(SCENE, lambda _t, _a: Wish())
    ]
    found = brakings(SCENE, off_the_road, 1.0)
    assert found
    assert [each for each in found if each.without_ego_mps2 is not None] == []
