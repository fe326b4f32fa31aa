"""PDM's internal score: nuPlan's metrics on drives that have not happened yet, for many of them at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from interplan_planners.common.comfort import comfortable
from interplan_planners.common.contacts import Contacts, boxes_touch, contacts
from interplan_planners.common.forecast import Forecast
from interplan_planners.common.ground import Ground
from interplan_planners.common.paths import DrivingPath
from interplan_sumo.dynamics.batch import SimulatedDrives
from interplan_sumo.world.ego import PACIFICA, EgoShape
from interplan_sumo.world.geometry import Floats, Ints

STANDING_EGO_MPS = 0.005
"""Below this the ego endangers nobody (PDM)."""
STANDING_MPS = 0.05
"""At most this, an ego or an actor has stopped, for the question of fault (nuPlan)."""
AHEAD_COS, BEHIND_COS = float(np.cos(np.radians(30.0))), float(np.cos(np.radians(150.0)))
"""Within 30 degrees of the heading is ahead, beyond 150 behind; from the rear axle to the actor's centre (nuPlan)."""
STATIC_COLLISION_SCORE = 0.5
LOOK_AHEAD_S = (0.0, 0.3, 0.6, 0.9)
WRONG_WAY_M = (2.0, 6.0)
"""Metres off the route's lanes: below the first 1, below the second 0.5, else 0."""
LEAST_PROGRESS_M = 0.1
"""If no drive makes more progress than this, progress says nothing."""


@dataclass(frozen=True, slots=True)
class Weights:
    """How much each part counts; PDM's values."""

    progress: float = 5.0
    time_to_collision: float = 5.0
    comfort: float = 2.0


@dataclass(frozen=True, eq=False)
class Scores:
    """Scores of N drives, and what they are made of; each (N,)."""

    total: Floats
    """Product of the first three, times the weighted mean of the last three."""
    no_collision: Floats
    """1, 0 for an at-fault collision with an agent, 0.5 with something static."""
    drivable_area: Floats
    driving_direction: Floats
    progress: Floats
    """Relative to the drive that gets farthest with a product above 0."""
    time_to_collision: Floats
    comfort: Floats
    progress_m: Floats
    collision_s: Floats
    """Time from now of the first at-fault collision; inf if there is none."""
    danger_s: Floats
    """Time from now at which the time to collision first falls short; inf if it never does."""


@dataclass(frozen=True, eq=False)
class Places:
    """Where the ego is at each state of N drives; (N, T) each."""

    straddles: NDArray[np.bool_]
    """In several lanes and in none entirely."""
    off_road: NDArray[np.bool_]
    """With a corner off the drivable area."""
    off_route: NDArray[np.bool_]
    """With its centre on no lane of the route."""
    in_intersection: NDArray[np.bool_]
    """With its rear axle."""


def score(
    drives: SimulatedDrives,
    forecast: Forecast,
    ground: Ground,
    line: DrivingPath,
    shape: EgoShape = PACIFICA,
    weights: Weights = Weights(),
    ignore: NDArray[np.bool_] | None = None,
    every: int = 1,
) -> Scores:
    """PDM's score of each drive against a forecast; progress is measured along `line` by the box centre.

    The forecast should reach 0.9 s beyond the drives. `ignore` (A,) leaves
    actors out (PDM: whatever touches the ego now). Red lights are no matter of
    the score: the drives are expected to respect them. `every` n-th state is
    looked at for contacts, dangers and places (PDM: each).
    """
    looked = drives if every == 1 else drives.thinned(every)
    where = places(looked, ground, shape)
    ahead_s = looked.time_s - looked.time_s[0]
    fault_score, collision_s = _collisions(looked, ahead_s, forecast, where, shape, ignore)
    danger_s = _dangers(looked, ahead_s, forecast, where, shape, ignore)
    drivable = np.where(where.off_road.any(axis=1), 0.0, 1.0)
    direction = _direction(looked, where)
    ends_x, ends_y = drives.x_m[:, (0, -1)].ravel(), drives.y_m[:, (0, -1)].ravel()
    arc_m = line.project(ends_x, ends_y)[0].reshape(-1, 2)
    progress_m = arc_m[:, 1] - arc_m[:, 0]
    gates = fault_score * drivable * direction
    best_m = float((progress_m * gates).max())
    progress = np.clip(progress_m / best_m, 0.0, 1.0) if best_m > LEAST_PROGRESS_M else (gates > 0.0).astype(np.float64)
    time_to_collision = np.isinf(danger_s).astype(np.float64)
    comfort = comfortable(drives).astype(np.float64)
    parts = weights.progress * progress + weights.time_to_collision * time_to_collision + weights.comfort * comfort
    total = gates * parts / (weights.progress + weights.time_to_collision + weights.comfort)
    return Scores(
        total, fault_score, drivable, direction, progress, time_to_collision, comfort, progress_m, collision_s, danger_s
    )


def places(drives: SimulatedDrives, ground: Ground, shape: EgoShape = PACIFICA) -> Places:
    """Where the ego is at each state of each drive."""
    cos, sin = np.cos(drives.heading_rad), np.sin(drives.heading_rad)
    # front left, rear left, rear right, front right, centre, rear axle
    along = np.array((1.0, -1.0, -1.0, 1.0, 0.0, 0.0)) * shape.length_m / 2
    along[5] = -shape.rear_axle_to_center_m
    across = np.array((1.0, 1.0, -1.0, -1.0, 0.0, 0.0)) * shape.width_m / 2
    under = ground.under(
        drives.x_m[..., None] + cos[..., None] * along - sin[..., None] * across,
        drives.y_m[..., None] + sin[..., None] * along + cos[..., None] * across,
    )
    straddles = ground.straddles(under.sets[..., :4].reshape(-1, 4)).reshape(drives.x_m.shape)
    return Places(
        straddles,
        np.asarray(~under.drivable[..., :4].all(axis=-1)),
        ~under.on_route[..., 4],
        under.in_intersection[..., 5],
    )


def _first(found: Contacts, states: int, actors: int) -> Contacts:
    """The first contact of each drive with each actor; `states` poses per drive."""
    _, first = np.unique(found.pose // states * actors + found.actor, return_index=True)
    return Contacts(found.pose[first], found.actor[first])


def _collisions(
    drives: SimulatedDrives,
    ahead_s: Floats,
    forecast: Forecast,
    where: Places,
    shape: EgoShape,
    ignore: NDArray[np.bool_] | None,
) -> tuple[Floats, Floats]:
    """(N,) score and time of the first at-fault collision. Only the first contact with an actor is judged."""
    states = len(ahead_s)
    hit = _first(
        contacts(drives.x_m, drives.y_m, drives.heading_rad, ahead_s, forecast, shape, ignore), states, len(forecast)
    )
    drive, state = np.divmod(hit.pose, states)
    other_x, other_y, bearing_cos = _bearing(
        drives, hit.pose, hit.actor, forecast.instant(ahead_s)[state], forecast, shape
    )
    ego_moves = np.abs(drives.vx_mps.ravel()[hit.pose]) > STANDING_MPS
    is_agent = forecast.is_agent[hit.actor]
    other_instant = forecast.instant(ahead_s)[state]
    stopped = ~is_agent | (np.abs(forecast.speed_mps[hit.actor, other_instant]) <= STANDING_MPS)
    behind = bearing_cos < BEHIND_COS
    front = _front_touches(drives, hit.pose, hit.actor, other_x, other_y, other_instant, forecast, shape)
    loose = (where.straddles | where.off_road).ravel()[hit.pose]
    at_fault = ego_moves & (stopped | (~behind & (front | loose)))
    fault_score, collision_s = np.ones(len(drives)), np.full(len(drives), np.inf)
    np.minimum.at(fault_score, drive[at_fault], np.where(is_agent[at_fault], 0.0, STATIC_COLLISION_SCORE))
    np.minimum.at(collision_s, drive[at_fault], ahead_s[state[at_fault]])
    return fault_score, collision_s


def _dangers(
    drives: SimulatedDrives,
    ahead_s: Floats,
    forecast: Forecast,
    where: Places,
    shape: EgoShape,
    ignore: NDArray[np.bool_] | None,
) -> Floats:
    """(N,) time at which the ego, going straight on for up to 0.9 s, would first touch what it must not.

    Only the first such contact with an actor is judged: one that does not
    count then, because the actor is not ahead, never does. Who is ahead is asked
    of both as they are at that state, as in nuPlan's metric; PDM's code looks
    where the actor will be at the contact, which blames the ego for whoever
    comes from behind.
    """
    look = np.array(LOOK_AHEAD_S)
    states, steps = len(ahead_s), len(LOOK_AHEAD_S)
    shape_3 = (len(drives), states, steps)
    way_m = np.abs(drives.vx_mps)[..., None] * look
    x_m = drives.x_m[..., None] + way_m * np.cos(drives.heading_rad)[..., None]
    y_m = drives.y_m[..., None] + way_m * np.sin(drives.heading_rad)[..., None]
    times_s = (ahead_s[:, None] + look).ravel()
    found = contacts(
        x_m.reshape(len(drives), -1), y_m.reshape(len(drives), -1),
        np.broadcast_to(drives.heading_rad[..., None], shape_3).reshape(len(drives), -1),
        times_s, forecast, shape, ignore,
    )  # fmt: skip
    moving = np.abs(drives.vx_mps).ravel()[found.pose // steps] >= STANDING_EGO_MPS
    hit = _first(Contacts(found.pose[moving], found.actor[moving]), states * steps, len(forecast))
    pose = hit.pose // steps
    _, _, bearing_cos = _bearing(drives, pose, hit.actor, forecast.instant(ahead_s)[pose % states], forecast, shape)
    loose = (where.straddles | where.off_road | where.in_intersection).ravel()[pose]
    counts = (bearing_cos > AHEAD_COS) | (loose & (bearing_cos >= BEHIND_COS))
    drive, state = np.divmod(pose[counts], states)
    danger_s = np.full(len(drives), np.inf)
    np.minimum.at(danger_s, drive, ahead_s[state])
    return danger_s


def _direction(drives: SimulatedDrives, where: Places) -> Floats:
    """(N,) driving-direction score from the metres that the centre travels off the route's lanes."""
    step_m = np.hypot(np.diff(drives.x_m, axis=1), np.diff(drives.y_m, axis=1))
    wrong_m = (step_m * where.off_route[:, 1:]).sum(axis=1)
    return np.where(wrong_m < WRONG_WAY_M[0], 1.0, np.where(wrong_m < WRONG_WAY_M[1], 0.5, 0.0))


def _bearing(
    drives: SimulatedDrives, pose: Ints, actor: Ints, instant: Ints, forecast: Forecast, shape: EgoShape
) -> tuple[Floats, Floats, Floats]:
    """(C,) way from the ego's centre to an actor's in x and y; cosine of the angle at which the rear axle sees it."""
    heading = drives.heading_rad.ravel()[pose]
    cos, sin = np.cos(heading), np.sin(heading)
    other_x = forecast.x_m[actor, instant] - drives.x_m.ravel()[pose]
    other_y = forecast.y_m[actor, instant] - drives.y_m.ravel()[pose]
    from_axle_x, from_axle_y = other_x + shape.rear_axle_to_center_m * cos, other_y + shape.rear_axle_to_center_m * sin
    distance_m = np.maximum(np.hypot(from_axle_x, from_axle_y), 1e-9)
    return other_x, other_y, (from_axle_x * cos + from_axle_y * sin) / distance_m


def _front_touches(
    drives: SimulatedDrives,
    pose: Ints,
    actor: Ints,
    other_x: Floats,
    other_y: Floats,
    instant: Ints,
    forecast: Forecast,
    shape: EgoShape,
) -> NDArray[np.bool_]:
    """(C,) whether the front bumper, a box without length, touches the actor."""
    heading = drives.heading_rad.ravel()[pose]
    half_m = shape.length_m / 2
    return boxes_touch(
        other_x - half_m * np.cos(heading), other_y - half_m * np.sin(heading), heading,
        forecast.heading_rad[actor, instant], 0.0, shape.width_m, forecast.length_m[actor], forecast.width_m[actor],
    )  # fmt: skip
