"""Reference: how far a lawful driver gets whom nothing special hinders. Certificates are judged against it."""

from __future__ import annotations

from dataclasses import replace

from interplan_sumo.errors import ScenarioError
from interplan_sumo.planner import load_planner
from interplan_sumo.scenario.route import goal_arc_m, route_centerline
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.episode import drive
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import EgoTrack, Trace

DRIVER = "idm"


def reference_drive(scenario: Scenario) -> Trace:
    """The IDM driver in the same traffic, without obstacles and jaywalkers; ScenarioError if that fails."""
    bare = replace(scenario, obstacles=(), jaywalkers=(), occluder=None)
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
