"""Replay: given ego states in the traffic of a scenario; and the reference drive that progress is judged against."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from interplan_sumo.errors import ScenarioError
from interplan_sumo.maps.store import load_roads
from interplan_sumo.planner import load_planner
from interplan_sumo.scenario.route import goal_arc_m, route_centerline
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.episode import DT_S, drive
from interplan_sumo.simulation.setup import open_traffic, start_state
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.signals import Signals
from interplan_sumo.world.trace import ActorTable, EgoTrack, Trace

DRIVER = "idm"
"""The lawful driver whom nothing special hinders."""


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
    without_ego: list[Mapping[str, float]] = []
    with open_traffic(scenario, roads, seed=seed) as traffic:
        behaviours = dict(traffic.behaviours)
        for k in range(frames):
            scene = traffic.observe()
            actors.append(scene.actors)
            signals.append(scene.signals)
            without_ego += [] if scene.ax_without_ego is None else [scene.ax_without_ego]
            if k + 1 < frames:
                traffic.react(states[k])
                traffic.place_ego(states[k + 1])
                traffic.advance()
        behaviours |= traffic.behaviours  # vehicles may have entered meanwhile
    others = ActorTable.of(actors, behaviours, without_ego if len(without_ego) == frames else None)
    return Trace(EgoTrack.of(states), others, tuple(signals), (), np.zeros(0))


def first_frame(scenario: Scenario) -> Trace:
    """A trace of the first frame only."""
    roads = load_roads(scenario.map, scenario.maps_beside)
    return replay(scenario, EgoTrack.of([start_state(scenario, roads)]))


def reference_drive(scenario: Scenario) -> Trace:
    """The IDM driver in the same traffic, without obstacles and jaywalkers; ScenarioError if that fails."""
    bare = replace(scenario, obstacles=(), jaywalkers=(), occluder=None, perception="full")
    episode = drive(bare, load_planner(DRIVER))
    if episode.trace is None or episode.fault is not None:
        reason = episode.fault.message if episode.fault is not None else "nothing was recorded"
        raise ScenarioError(f"{scenario.id}: the reference driver cannot drive it: {reason}")
    return episode.trace


def route_distance_m(roads: Roads, scenario: Scenario, track: EgoTrack) -> float:
    """How far a drive gets along the scenario's route, up to the goal."""
    line, goal_m = route_centerline(roads, scenario), goal_arc_m(roads, scenario)
    first, last = (line.project_point(float(track.x_m[k]), float(track.y_m[k]))[0] for k in (0, -1))
    return min(last, goal_m) - min(first, goal_m)
