"""Replay: given ego states placed one after the other in the traffic of a scenario."""

from __future__ import annotations

import numpy as np

from interplan_sumo.maps.store import load_roads
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.episode import DT_S
from interplan_sumo.simulation.setup import open_traffic, start_state
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.signals import Signals
from interplan_sumo.world.trace import ActorTable, EgoTrack, Trace


def replay(scenario: Scenario, track: EgoTrack, *, seed: int = 0) -> Trace:
    """The episode in which the ego moves as given, up to the last state or the last frame of the scenario.

    It begins with the scenario's own first state, exactly: a stored one is rounded.
    The closed loop, but for the ego's next state: it is taken from the table
    and not from a plan, so the trace holds no plans. TrafficError if SUMO fails.
    """
    frames = min(len(track), round(scenario.duration_s / DT_S))
    roads = load_roads(scenario.map, scenario.maps_beside)
    states = [start_state(scenario, roads), *(track.state(k) for k in range(1, frames))]
    actors: list[Actors] = []
    signals: list[Signals] = []
    with open_traffic(scenario, roads, seed=seed) as traffic:
        behaviours = dict(traffic.behaviours)
        for k in range(frames):
            scene = traffic.observe()
            actors.append(scene.actors)
            signals.append(scene.signals)
            if k + 1 < frames:
                traffic.react(states[k])
                traffic.place_ego(states[k + 1])
                traffic.advance()
        behaviours |= traffic.behaviours  # vehicles may have entered meanwhile
    return Trace(EgoTrack.of(states), ActorTable.of(actors, behaviours), tuple(signals), (), np.zeros(0))


def first_frame(scenario: Scenario, *, seed: int = 0) -> Trace:
    """A trace of the first frame only."""
    roads = load_roads(scenario.map, scenario.maps_beside)
    return replay(scenario, EgoTrack.of([start_state(scenario, roads)]), seed=seed)
