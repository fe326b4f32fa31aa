"""Tiny worlds for the tests, most of which live in the package, so that the conformance suite uses the same ones."""

from __future__ import annotations

from math import cos, sin

from interplan_sumo.planner import Observation, Past
from interplan_sumo.scenario.recorded_parts import ReplayedKind, ReplayedTrack
from interplan_sumo.simulation.replayed import ReplayedTraffic
from interplan_sumo.tiny_worlds import *  # noqa: F403 - all of them, under one name with those below
from interplan_sumo.tiny_worlds import DT_S, observation
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import Polyline
from interplan_sumo.world.signals import Signals


def rolling(
    id: str, line: Polyline, arc_m: float = 0.0, speed_mps: float = 0.0, kind: ReplayedKind = "vehicle",
    size_m: tuple[float, float] = (4.6, 1.85),
) -> ReplayedTrack:  # fmt: skip
    """A road user that moves along a line at constant speed for 6 s."""
    poses = [line.pose_at(arc_m + speed_mps * DT_S * k) for k in range(60)]
    x_m, y_m, heading = zip(*((pose.x_m, pose.y_m, pose.heading_rad) for pose in poses), strict=True)
    vx, vy = (tuple(speed_mps * turn(each) for each in heading) for turn in (cos, sin))
    return ReplayedTrack(id, kind, *size_m, 0, x_m, y_m, heading, vx, vy)


def replayed(*tracks: ReplayedTrack) -> ReplayedTraffic:
    """Traffic of these tracks, seen under their own ids."""
    return ReplayedTraffic(tracks, [track.id for track in tracks], Actors.none())


def unmoved(ego: EgoState, actors: Actors | None = None, signals: Signals | None = None) -> Observation:
    """What a planner sees where nobody has moved for two seconds."""
    everyone = Actors.none() if actors is None else actors
    return observation(ego, everyone, signals, Past((ego,) * 20, (everyone,) * 20))
