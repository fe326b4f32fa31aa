"""Recordings for tests: road users along straight lines, on the tiny roads or on shipped ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from interplan_sumo.tiny_worlds import CRS
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.recording import RecordedTrack, Recording
from interplan_sumo.world.roads import Roads

STEP_S = 0.1


def poses_along(points: Sequence[tuple[float, float]], speed_mps: float, steps: int) -> Floats:
    """(steps, 3) along a broken line at one speed, heading along it; standing still at its first point for speed 0."""
    line = np.array(points, dtype=np.float64)
    if len(line) == 1:
        return np.tile((*line[0], 0.0), (steps, 1))
    arc = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))))
    at = np.minimum(STEP_S * speed_mps * np.arange(steps), arc[-1] - 1e-9)
    segment = np.searchsorted(arc, at, side="right") - 1
    heading = np.arctan2(*np.diff(line, axis=0).T[::-1])
    return np.stack((np.interp(at, arc, line[:, 0]), np.interp(at, arc, line[:, 1]), heading[segment]), axis=1)


def track(
    id: str,
    poses: Floats,
    kind: ActorKind = ActorKind.VEHICLE,
    *,
    first_step: int = 0,
    size_m: tuple[float, float] = (4.6, 1.85),
    model: str = "car",
    step_s: float = STEP_S,
) -> RecordedTrack:
    """A track whose velocities are the differences of its positions."""
    moved = np.gradient(poses[:, :2], axis=0) / step_s if len(poses) > 1 else np.zeros((1, 2))
    return RecordedTrack(id, kind, *size_m, first_step, poses, moved, model)


def drives(id: str, x_m: float, y_m: float, speed_mps: float, steps: int = 50, **more: object) -> RecordedTrack:
    """A vehicle that moves towards +x."""
    return track(id, poses_along(((x_m, y_m), (x_m + 1000.0, y_m)), speed_mps, steps), **more)  # type: ignore[arg-type]


def stands(id: str, x_m: float, y_m: float, steps: int = 50, **more: object) -> RecordedTrack:
    """Somebody who stays where they are."""
    return track(id, poses_along(((x_m, y_m),), 0.0, steps), **more)  # type: ignore[arg-type]


def recording(*tracks: RecordedTrack, ego_id: str | None = "ego", crs: str = CRS, step_s: float = STEP_S) -> Recording:
    return Recording("made", crs, step_s, tuple(sorted(tracks, key=lambda each: each.id)), ego_id)


def turn_through(roads: Roads, connector: str) -> Floats:
    """Along the middle of the lane before, the connector and the lane behind."""
    way = roads.connectors[connector]
    lanes = (way.from_lane_id, connector, way.to_lane_id)
    return np.concatenate(
        [roads[lane].centerline.poses_at(np.arange(0.0, roads[lane].centerline.length_m, 0.8)) for lane in lanes]
    )
