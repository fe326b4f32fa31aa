"""PDM's internal score: nuPlan's metrics on drives that have not happened yet, for many of them at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from interplan_planners.common.comfort import comfortable
from interplan_planners.common.contacts import Contacts, boxes_touch, contacts
from interplan_planners.common.forecast import Forecast
from interplan_planners.common.ground import Ground, Under
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
    where: Places
    """At the states that were looked at."""


@dataclass(frozen=True, eq=False)
class Places:
    """Where the ego is at each state of N drives."""

    off_road: NDArray[np.bool_]
    """(N, T) with a corner off the drivable area."""
    off_route: NDArray[np.bool_]
    """(N, T) with its centre on no lane of the route."""
    _x_m: Floats  # (4, N T) of the corners
    _y_m: Floats  # (4, N T)
    _under: Under  # (4, N T)
    _drives: SimulatedDrives
    _ground: Ground
    _shape: EgoShape

    def farther_off_road(self, than_m: float) -> NDArray[np.bool_]:
        """(N, T) with a corner farther than this from the drivable area."""
        off = ~self._under.drivable
        off[off] = self._ground.farther(self._x_m[off], self._y_m[off], than_m)
        return np.asarray(off.any(axis=0)).reshape(self.off_road.shape)

    def straddles(self, pose: Ints) -> NDArray[np.bool_]:
        """(C,) whether it is in several lanes and in none entirely, at some of the states, counted through all."""
        return self._ground.straddles(self._under.sets.T[pose])

    def in_intersection(self, pose: Ints) -> NDArray[np.bool_]:
        """(C,) whether its rear axle is in an intersection, at some of the states."""
        heading = self._drives.heading_rad.ravel()[pose]
        behind_m = self._shape.rear_axle_to_center_m
        x_m = self._drives.x_m.ravel()[pose] - behind_m * np.cos(heading)
        y_m = self._drives.y_m.ravel()[pose] - behind_m * np.sin(heading)
        return self._ground.under(x_m, y_m).in_intersection


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
    touched = _touched(looked, ahead_s, forecast, shape, ignore)
    fault_score, collision_s = _collisions(looked, ahead_s, forecast, where, shape, touched)
    danger_s = _dangers(looked, ahead_s, forecast, where, shape, touched)
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
        total, fault_score, drivable, direction, progress, time_to_collision, comfort, progress_m, collision_s,
        danger_s, where,
    )  # fmt: skip


def places(drives: SimulatedDrives, ground: Ground, shape: EgoShape = PACIFICA) -> Places:
    """Where the ego is at each state of each drive."""
    x_m, y_m = _corners_and_center(drives, shape)
    under = ground.under(x_m, y_m)
    corners, center = (Under(sets, under.facts) for sets in (under.sets[:4], under.sets[4]))
    off_road, off_route = (
        np.asarray(~on).reshape(drives.x_m.shape) for on in (corners.drivable.all(axis=0), center.on_route)
    )
    return Places(off_road, off_route, x_m[:4], y_m[:4], corners, drives, ground, shape)


def _corners_and_center(drives: SimulatedDrives, shape: EgoShape) -> tuple[Floats, Floats]:
    """(5, N T) x and y of front left, rear left, rear right, front right corner and centre at each state."""
    cos, sin = np.cos(drives.heading_rad).ravel(), np.sin(drives.heading_rad).ravel()
    x_m, y_m = drives.x_m.ravel(), drives.y_m.ravel()
    at_x, at_y = np.empty((5, cos.size)), np.empty((5, cos.size))
    for i, (along, across) in enumerate(((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0))):
        along_m, across_m = along * shape.length_m / 2, across * shape.width_m / 2
        at_x[i] = x_m + cos * along_m - sin * across_m
        at_y[i] = y_m + sin * along_m + cos * across_m
    at_x[4], at_y[4] = x_m, y_m
    return at_x, at_y


def _first(found: Contacts, states: int, actors: int) -> Contacts:
    """The first contact of each drive with each actor; `states` poses per drive."""
    _, first = np.unique(found.pose // states * actors + found.actor, return_index=True)
    return Contacts(found.pose[first], found.actor[first])


def _touched(
    drives: SimulatedDrives,
    ahead_s: Floats,
    forecast: Forecast,
    shape: EgoShape,
    ignore: NDArray[np.bool_] | None,
) -> Contacts:
    """Contacts of the ego if it goes straight on from each state for each of `LOOK_AHEAD_S`: a pose each."""
    look = np.array(LOOK_AHEAD_S)
    shape_3 = (*drives.x_m.shape, len(look))
    way_m = np.abs(drives.vx_mps)[..., None] * look
    x_m = drives.x_m[..., None] + way_m * np.cos(drives.heading_rad)[..., None]
    y_m = drives.y_m[..., None] + way_m * np.sin(drives.heading_rad)[..., None]
    times_s = (ahead_s[:, None] + look).ravel()
    return contacts(
        x_m.reshape(len(drives), -1), y_m.reshape(len(drives), -1),
        np.broadcast_to(drives.heading_rad[..., None], shape_3).reshape(len(drives), -1),
        times_s, forecast, shape, ignore,
    )  # fmt: skip


def _collisions(
    drives: SimulatedDrives,
    ahead_s: Floats,
    forecast: Forecast,
    where: Places,
    shape: EgoShape,
    touched: Contacts,
) -> tuple[Floats, Floats]:
    """(N,) score and time of the first at-fault collision. Only the first contact with an actor is judged."""
    states, steps = len(ahead_s), len(LOOK_AHEAD_S)
    now = touched.pose % steps == 0  # looks nowhere ahead
    hit = _first(Contacts(touched.pose[now] // steps, touched.actor[now]), states, len(forecast))
    drive, state = np.divmod(hit.pose, states)
    other_instant = forecast.instant(ahead_s)[state]
    other_x, other_y, bearing_cos = _bearing(drives, hit.pose, hit.actor, other_instant, forecast, shape)
    ego_moves = np.abs(drives.vx_mps.ravel()[hit.pose]) > STANDING_MPS
    is_agent = forecast.is_agent[hit.actor]
    stopped = ~is_agent | (np.abs(forecast.speed_mps[hit.actor, other_instant]) <= STANDING_MPS)
    behind = bearing_cos < BEHIND_COS
    front = _front_touches(drives, hit.pose, hit.actor, other_x, other_y, other_instant, forecast, shape)
    loose = where.straddles(hit.pose) | where.off_road.ravel()[hit.pose]
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
    touched: Contacts,
) -> Floats:
    """(N,) time at which the ego, going straight on for up to 0.9 s, would first touch what it must not.

    Only the first such contact with an actor is judged: one that does not
    count then, because the actor is not ahead, never does. Who is ahead is asked
    of both as they are at that state, as in nuPlan's metric; PDM's code looks
    where the actor will be at the contact, which blames the ego for whoever
    comes from behind.
    """
    states, steps = len(ahead_s), len(LOOK_AHEAD_S)
    moving = np.abs(drives.vx_mps).ravel()[touched.pose // steps] >= STANDING_EGO_MPS
    hit = _first(Contacts(touched.pose[moving], touched.actor[moving]), states * steps, len(forecast))
    pose = hit.pose // steps
    _, _, bearing_cos = _bearing(drives, pose, hit.actor, forecast.instant(ahead_s)[pose % states], forecast, shape)
    loose = where.straddles(pose) | where.off_road.ravel()[pose] | where.in_intersection(pose)
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
