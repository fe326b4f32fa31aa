"""From the JSON of an answer to a trajectory. Nothing is evaluated; what no car can do is refused."""

from __future__ import annotations

from typing import Any

import numpy as np

from interplan_llm.models.protocol import ModelFailure, Reply
from interplan_llm.waypoints.form import POINTS, STEP_S
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import Floats, wrap_angle
from interplan_sumo.world.trajectory import Trajectory

FASTEST_MPS = 60.0
STANDS_M = 0.1
"""A step shorter than this has no direction."""
FARTHEST_OFF_M = 2.0
"""A plan is moved along with a car that falls farther behind it: the benchmark refuses plans 2.5 m off."""


def waypoints(reply: Reply) -> Floats:
    """(16, 2) places in the car's frame; ModelFailure (`parse`) that says what is wrong with them."""
    try:
        return _places(reply.data)
    except ValueError as error:
        raise ModelFailure("parse", str(error), latency_s=reply.latency_s, reply=reply) from None


def _places(data: Any) -> Floats:
    rows = data.get("waypoints") if isinstance(data, dict) else None
    if not isinstance(rows, list) or len(rows) != POINTS:
        found = f"{len(rows)}" if isinstance(rows, list) else "no list"
        raise ValueError(f"{found} of waypoints, expected {POINTS}")
    for k, row in enumerate(rows):
        if not (isinstance(row, list) and len(row) == 2 and all(_number(value) for value in row)):
            raise ValueError(f"waypoint {k} is not a pair of numbers")
    places = np.array(rows, dtype=np.float64)
    steps_m = np.hypot(*np.diff(np.vstack(((0.0, 0.0), places)), axis=0).T)
    if steps_m.max() > FASTEST_MPS * STEP_S:
        worst = int(steps_m.argmax())
        raise ValueError(f"waypoint {worst} asks for {steps_m[worst] / STEP_S:.1f} m/s, over {FASTEST_MPS:.0f}")
    return places


def trajectory(places: Floats, ego: EgoState) -> Trajectory:
    """A plan from the ego's pose through places (16, 2) in its frame, 0.5 s apart."""
    cos, sin = np.cos(ego.heading_rad), np.sin(ego.heading_rad)
    whole = np.vstack(((0.0, 0.0), places))
    x_m, y_m = ego.x_m + cos * whole[:, 0] - sin * whole[:, 1], ego.y_m + sin * whole[:, 0] + cos * whole[:, 1]
    time_s = ego.time_s + np.linspace(0.0, STEP_S * POINTS, POINTS + 1)
    headings = np.concatenate(([ego.heading_rad], _headings(np.diff(x_m), np.diff(y_m), ego.heading_rad)))
    return Trajectory(time_s, x_m, y_m, np.unwrap(headings))


def kept_up_with(plan: Trajectory, ego: EgoState) -> Trajectory:
    """The plan, moved as little as needed for the car to be within 2 m of where it should be now.

    A model may ask for what no car can do; the tracker does what it can of it.
    """
    place = plan.at(ego.time_s)
    dx_m, dy_m = ego.x_m - place.x_m, ego.y_m - place.y_m
    away_m = float(np.hypot(dx_m, dy_m))
    if away_m <= FARTHEST_OFF_M:
        return plan
    share = 1.0 - FARTHEST_OFF_M / away_m
    return Trajectory(plan.time_s, plan.x_m + share * dx_m, plan.y_m + share * dy_m, plan.heading_rad)


def _headings(dx_m: Floats, dy_m: Floats, heading_rad: float) -> Floats:
    """(N,) the direction of each step; what hardly moves, or goes back, keeps the heading before it."""
    found: list[float] = []
    for dx, dy in zip(dx_m.tolist(), dy_m.tolist(), strict=True):
        if np.hypot(dx, dy) > STANDS_M:
            direction = float(np.arctan2(dy, dx))
            if abs(float(wrap_angle(direction - heading_rad))) <= np.pi / 2:
                heading_rad = direction
        found.append(heading_rad)
    return np.array(found)


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
