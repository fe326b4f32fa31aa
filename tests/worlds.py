"""Tiny worlds for the tests, most of which live in the package, so that the conformance suite uses the same ones."""

from __future__ import annotations

from math import cos, sin

from interplan_sumo.scenario.recorded_parts import ReplayedKind, ReplayedTrack
from interplan_sumo.simulation.replayed import ReplayedTraffic
from interplan_sumo.tiny_worlds import (
    CRS,
    DT_S,
    LANE_WIDTH_M,
    cars,
    curved_road,
    drive,
    drive_along,
    drive_through,
    ego,
    ego_on,
    junction,
    mission,
    observation,
    pedestrians,
    road_along,
    signals,
    straight_plan,
    straight_road,
    together,
)
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.geometry import Polyline

__all__ = [
    "CRS",
    "DT_S",
    "LANE_WIDTH_M",
    "cars",
    "curved_road",
    "drive",
    "drive_along",
    "drive_through",
    "ego",
    "ego_on",
    "junction",
    "mission",
    "observation",
    "pedestrians",
    "replayed",
    "road_along",
    "rolling",
    "signals",
    "straight_plan",
    "straight_road",
    "together",
]


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
