"""Makers and slow, plain counterparts for the tests of the planners' toolbox."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from interplan_planners.common.forecast import Forecast, constant_velocity
from interplan_sumo.dynamics.batch import SimulatedDrives, follow_all
from interplan_sumo.tiny_worlds import ego
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.geometry import Polyline, box_polygons


def wavy_line(length_m: float = 160.0, sway_m: float = 12.0) -> Polyline:
    """A line that bends both ways; no bend is narrower than 15 m."""
    x = np.linspace(0.0, length_m, int(2 * length_m))
    return Polyline(np.stack((x, sway_m * np.sin(x / 25.0)), axis=1)).resampled(1.0)


def crowd(rng: np.random.Generator, count: int, line: Polyline, spread_m: float = 6.0) -> Forecast:
    """Actors of all sizes around a line, each going straight on; every fourth stands."""
    at = line.poses_at(rng.uniform(0.0, line.length_m, count))
    heading = at[:, 2] + rng.normal(0.0, 0.5, count)
    speed = np.where(np.arange(count) % 4 == 0, 0.0, rng.uniform(0.5, 12.0, count))
    kinds = rng.choice([0, 0, 0, 1, 2, 3], count).astype(np.int8)
    length = np.where(kinds == 0, rng.uniform(3.5, 13.0, count), rng.uniform(0.5, 2.0, count))
    width = np.where(kinds == 0, rng.uniform(1.6, 2.6, count), 0.6)
    x_m, y_m = at[:, 0] + rng.normal(0.0, spread_m, count), at[:, 1] + rng.normal(0.0, spread_m, count)
    ids = tuple(f"a{i:04d}" for i in range(count))
    actors = Actors(ids, kinds, x_m, y_m, heading, length, width, speed * np.cos(heading), speed * np.sin(heading))
    return constant_velocity(actors, horizon_s=6.0)


def polygons_at(forecast: Forecast, instant: int) -> NDArray[np.object_]:
    """(A,) boxes of a forecast as shapely polygons."""
    x_m, y_m, heading_rad = (c[:, instant] for c in (forecast.x_m, forecast.y_m, forecast.heading_rad))
    return box_polygons(x_m, y_m, heading_rad, forecast.length_m, forecast.width_m)


def ego_boxes(drives: SimulatedDrives) -> NDArray[np.object_]:
    """(N, T) boxes of drives as shapely polygons."""
    x_m, y_m, heading_rad = (c.ravel() for c in (drives.x_m, drives.y_m, drives.heading_rad))
    length_m, width_m = (np.full(x_m.size, size) for size in (PACIFICA.length_m, PACIFICA.width_m))
    return box_polygons(x_m, y_m, heading_rad, length_m, width_m).reshape(drives.x_m.shape)


def drives_along(
    line: Polyline, start: EgoState, speeds_mps: list[float], left_m: list[float], steps: int
) -> SimulatedDrives:
    """Drives at constant speeds on lines parallel to a line, from where the start projects on it."""
    arc_m, _ = line.project_point(start.x_m, start.y_m)
    ahead = arc_m + 0.1 * np.arange(steps + 1)[None, :] * np.array(speeds_mps)[:, None]
    poses = line.poses_at(ahead.ravel()).reshape(len(speeds_mps), steps + 1, 3)
    left = np.array(left_m)[:, None]
    x_m, y_m = poses[..., 0] - left * np.sin(poses[..., 2]), poses[..., 1] + left * np.cos(poses[..., 2])
    return follow_all(start, x_m, y_m, poses[..., 2])


def straight_drives(*speeds_mps: float, x_m: float = 20.0, y_m: float = 0.0, steps: int = 40) -> SimulatedDrives:
    """Drives along +x that hold their speeds; the ego starts at the first of them."""
    line = Polyline(np.array(((x_m, y_m), (x_m + 400.0, y_m))))
    return drives_along(line, ego(x_m, y_m, speeds_mps[0]), list(speeds_mps), [0.0] * len(speeds_mps), steps)
