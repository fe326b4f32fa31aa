"""nuPlan's numbers and ours: microseconds and seconds, rear axle and box centre, how much past a planner is given."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from interplan_sumo.dynamics.rear_axle import rear_axles_of
from interplan_sumo.planner import Observation
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import EgoShape, EgoState
from interplan_sumo.world.geometry import Floats, Ints
from interplan_sumo.world.trajectory import Trajectory

START_US = 10_000_000
"""nuPlan's time when a scenario begins: its time points may not be negative, and the past comes before the start."""
STEP_US = 100_000
"""What nuPlan's controller samples a plan at."""
SAMPLES = 22
"""What nuPlan's history buffer holds: 2 s and one sample more, the present included."""


def time_us(time_s: float) -> int:
    """nuPlan's time for a time since the scenario's start."""
    return START_US + round(time_s * 1e6)


def grid_us(start_us: int, end_us: int) -> Ints:
    """(K,) times every 0.1 s from the start of a plan on, as nuPlan's controller samples it.

    The end is among them only if it lies on the grid, or if nothing else does.
    """
    times = np.arange(start_us, end_us + 1, STEP_US)
    return times if len(times) > 1 else np.array((start_us, end_us))


def center_trajectory(rear_axle: Floats, shape: EgoShape, start_us: int = START_US) -> Trajectory:
    """A plan from rows (K, 5) of time in us, rear axle x and y in m, heading in rad, forward speed in m/s.

    `start_us` is the time that becomes 0 s. ValueError as `Trajectory` raises it.
    """
    time, rear_x_m, rear_y_m, heading_rad, speed_mps = rear_axle.T
    ahead_m = shape.rear_axle_to_center_m
    return Trajectory(
        time_s=(time - start_us) * 1e-6,
        x_m=rear_x_m + ahead_m * np.cos(heading_rad),
        y_m=rear_y_m + ahead_m * np.sin(heading_rad),
        heading_rad=heading_rad,
        speed_mps=speed_mps,
    )


def rear_axle_rows(plan: Trajectory, shape: EgoShape, start_us: int = START_US) -> Floats:
    """The way back: rows (K, 5) as `center_trajectory` takes them, times in whole microseconds.

    A plan without speeds gets those of its own steps.
    """
    x_m, y_m = rear_axles_of(plan.x_m, plan.y_m, plan.heading_rad, shape)
    speed_mps = plan.speed_mps
    if speed_mps is None:
        along = np.diff(x_m) * np.cos(plan.heading_rad[:-1]) + np.diff(y_m) * np.sin(plan.heading_rad[:-1])
        steps = along / np.diff(plan.time_s)
        speed_mps = np.append(steps, steps[-1])
    return np.column_stack((start_us + np.rint(plan.time_s * 1e6), x_m, y_m, plan.heading_rad, speed_mps))


def samples(observation: Observation, dt_s: float) -> list[tuple[EgoState, Actors]]:
    """The last `SAMPLES` instants, oldest first, the present last.

    What the past of an observation does not reach is its oldest sample moved
    back at constant velocity.
    """
    known = [*zip(observation.past.egos, observation.past.actors, strict=True), (observation.ego, observation.actors)][
        -SAMPLES:
    ]
    ego, actors = known[0]
    missing = range(SAMPLES - len(known), 0, -1)
    return [(_ego_before(ego, k * dt_s), _actors_before(actors, k * dt_s)) for k in missing] + known


def _ego_before(ego: EgoState, ago_s: float) -> EgoState:
    back_m = ego.speed_mps * ago_s
    x_m, y_m = ego.x_m - back_m * float(np.cos(ego.heading_rad)), ego.y_m - back_m * float(np.sin(ego.heading_rad))
    return replace(ego, time_s=ego.time_s - ago_s, x_m=x_m, y_m=y_m)


def _actors_before(actors: Actors, ago_s: float) -> Actors:
    return replace(actors, x_m=actors.x_m - ago_s * actors.vx_mps, y_m=actors.y_m - ago_s * actors.vy_mps)


def sorted_rows(ids: Sequence[str]) -> list[int]:
    """The rows of `ids` in the order of their texts, of equal ones the first only: `Actors` wants them so."""
    first: dict[str, int] = {}
    for row, id_ in enumerate(ids):
        first.setdefault(id_, row)
    return [first[id_] for id_ in sorted(first)]
