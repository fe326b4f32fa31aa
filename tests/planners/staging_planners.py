"""Makers and slow, plain counterparts for the tests of the planners' toolbox."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import pi

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_planners.common.forecast import Forecast, constant_velocity
from interplan_planners.foresight import ForesightPlanner
from interplan_sumo.dynamics.batch import SimulatedDrives, follow_all
from interplan_sumo.dynamics.lqr import follow
from interplan_sumo.plan_check import check_plan
from interplan_sumo.planner import Mission, Past, Planner
from interplan_sumo.tiny_worlds import ego, observation, road_along
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.geometry import Polyline, box_polygons
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.signals import Signals


def moved(actors: Actors, time_s: float) -> Actors:
    """Everybody some time later, each going on at its velocity."""
    x_m, y_m = actors.x_m + time_s * actors.vx_mps, actors.y_m + time_s * actors.vy_mps
    return replace(actors, x_m=x_m, y_m=y_m)


def driven(
    planner: Planner,
    start: EgoState,
    steps: int,
    actors: Actors | Callable[[float], Actors] | None = None,
    lights: Signals | None = None,
    *,
    may_touch: bool = False,
) -> list[EgoState]:
    """The states of a drive of a planner that has started; every plan is checked, and nobody is touched.

    Others keep their velocity, or are where `actors` says by time in seconds.
    """

    def others_at(time_s: float) -> Actors:
        return actors(time_s) if callable(actors) else moved(actors or Actors.none(), time_s)

    states = [start]
    before = [others_at(start.time_s - 0.1 * ago) for ago in range(20, 0, -1)]
    for _ in range(steps):
        state = states[-1]
        others = others_at(state.time_s)
        assert may_touch or not shapely.intersects(others.polygons, state.polygon(PACIFICA)).any(), state
        past = Past((state,) * 20, tuple(before))
        plan = planner.plan(observation(state, others, lights, past))
        check_plan(plan, state, state.time_s)
        states.append(follow(state, plan, 0.1, PACIFICA))
        before = [*before[1:], others]
    return states


def foresee(
    task: Mission,
    start: EgoState,
    actors: Actors | Callable[[float], Actors] | None = None,
    lights: Signals | None = None,
    seconds: float = 10.0,
) -> list[EgoState]:
    """The states of a drive of `foresight`, see `driven`."""
    planner = ForesightPlanner()
    planner.start(task)
    return driven(planner, start, round(10 * seconds), actors, lights)


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


def looping() -> Roads:
    """East along the x axis, once round to the left, and south across it at x = 95 m: 168 m from pass to pass."""
    turns = np.linspace(-0.5 * pi, pi, 60)
    loop = np.column_stack((120.0 + 25.0 * np.cos(turns), 25.0 + 25.0 * np.sin(turns)))
    line = Polyline(np.vstack(((0.0, 0.0), loop, (95.0, -200.0))))
    return road_along(line, 1, 12.0, ((40.0, 50.0), (108.0, 116.0), (180.0, 190.0), (272.0, 280.0)))


LOOP = looping()
LOOP_LANES = ("11", "21", "31", "41", "51", "61", "71", "81", "91")
