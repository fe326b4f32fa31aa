"""Tracks: the ego's and the agents' last two seconds, and what stands around."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.features.frame import EgoFrame, nearest
from interplan_sumo.features.schema import AGENTS, HISTORY_FRAMES, LONG_VEHICLE_M, STATIC_OBJECTS
from interplan_sumo.planner import Observation
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import EgoShape
from interplan_sumo.world.geometry import Floats, wrap_angle

_STATE = ("x_m", "y_m", "heading_rad", "vx_mps", "vy_mps", "length_m", "width_m")
_CAR, _VALID = 8, 12  # channels of `agents`: the first of four classes, and the last


def ego_history(observation: Observation, frame: EgoFrame, shape: EgoShape) -> tuple[Floats, NDArray[np.bool_]]:
    """`ego_history` and `ego_history_valid`."""
    egos = (*observation.past.egos[-(HISTORY_FRAMES - 1) :], observation.ego)
    table = np.array(
        [
            (e.x_m, e.y_m, e.heading_rad, e.vx_mps, e.vy_mps, e.ax_mps2, e.ay_mps2,
             e.yaw_rate_radps, e.tire_angle_rad, e.tire_rate_radps)
            for e in egos
        ]
    )  # fmt: skip
    heading = table[:, 2]
    toward = np.stack((np.cos(heading), np.sin(heading)), axis=1)
    history = np.zeros((HISTORY_FRAMES, 10))
    rows = history[HISTORY_FRAMES - len(egos) :]
    rows[:, :2] = frame.points(table[:, :2] - shape.rear_axle_to_center_m * toward)
    rows[:, 2] = frame.yaws(heading)
    for first in (3, 5):  # velocity, acceleration: of the car at each instant
        forward, left = table[:, first, None], table[:, first + 1, None]
        rows[:, first : first + 2] = frame.vectors(forward * toward + left * toward[:, ::-1] * (-1.0, 1.0))
    rows[:, 7:] = table[:, 7:]
    return history, np.arange(HISTORY_FRAMES) >= HISTORY_FRAMES - len(egos)


def nearest_agents(actors: Actors, frame: EgoFrame) -> tuple[str, ...]:
    """Ids of the agents that fill the rows of `agents`, in their order."""
    rows = np.flatnonzero(actors.kind <= ActorKind.BICYCLE)
    distance_m = np.hypot(actors.x_m[rows] - frame.x_m, actors.y_m[rows] - frame.y_m)
    return tuple(actors.ids[row] for row in rows[nearest(distance_m, rows, AGENTS)].tolist())


def agents(observation: Observation, frame: EgoFrame, dt_s: float) -> Floats:
    """`agents`: (30, 21, 13)."""
    ids = nearest_agents(observation.actors, frame)
    table = np.zeros((AGENTS, HISTORY_FRAMES, 13))
    if not ids:
        return table
    frames = (*observation.past.actors[-(HISTORY_FRAMES - 1) :], observation.actors)
    found, rows = _found(frames, ids)
    state = np.stack([np.concatenate([getattr(each, name) for each in frames]) for name in _STATE], axis=1)[rows]
    kind = np.concatenate([each.kind for each in frames])[rows]
    valid = np.zeros((len(ids), HISTORY_FRAMES), dtype=np.bool_)
    valid[:, HISTORY_FRAMES - len(frames) :] = found
    block = table[: len(ids), HISTORY_FRAMES - len(frames) :]
    block[..., :2] = frame.points(state[..., :2])
    block[..., 2] = frame.yaws(state[..., 2])
    block[..., 3:5] = frame.vectors(state[..., 3:5])
    block[..., 5] = _yaw_rate(state[..., 2], found, dt_s)
    block[..., 6:8] = state[..., 5:7]
    classes = np.select(
        [kind == ActorKind.PEDESTRIAN, kind == ActorKind.BICYCLE, state[..., 5] >= LONG_VEHICLE_M], [2, 3, 1], 0
    )
    block[..., _CAR:_VALID] = np.eye(4)[classes]
    table[: len(ids), :, _VALID] = 1.0
    table[: len(ids)] *= valid[..., None]
    return table


def _found(frames: tuple[Actors, ...], ids: tuple[str, ...]) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """(N, F) whether each is seen in each frame, and its row among those of all frames; row 0 where it is not."""
    rows = np.zeros((len(ids), len(frames)), dtype=np.int64)
    found = np.zeros((len(ids), len(frames)), dtype=np.bool_)
    before = 0
    for k, each in enumerate(frames):
        place = dict(zip(each.ids, range(len(each)), strict=True))
        at = np.array([place.get(i, -1) for i in ids])
        found[:, k] = at >= 0
        rows[:, k] = np.where(at >= 0, at + before, 0)
        before += len(each)
    return found, rows


def _yaw_rate(heading_rad: Floats, found: NDArray[np.bool_], dt_s: float) -> Floats:
    """(N, F) backward differences; forward ones where the frame before is missing, 0 where both are."""
    both = found[:, 1:] & found[:, :-1]
    turned = np.where(both, wrap_angle(np.diff(heading_rad, axis=1)), 0.0) / dt_s
    rate = np.zeros_like(heading_rad)
    rate[:, 1:] = turned
    rate[:, :-1] = np.where(np.pad(both, ((0, 0), (1, 0)))[:, :-1], rate[:, :-1], turned)
    return rate


def static_objects(actors: Actors, frame: EgoFrame) -> Floats:
    """`static_objects`: (20, 6)."""
    rows = np.flatnonzero(actors.kind > ActorKind.BICYCLE)
    distance_m = np.hypot(actors.x_m[rows] - frame.x_m, actors.y_m[rows] - frame.y_m)
    rows = rows[nearest(distance_m, rows, STATIC_OBJECTS)]
    table = np.zeros((STATIC_OBJECTS, 6))
    block = table[: len(rows)]
    block[:, :2] = frame.points(np.stack((actors.x_m[rows], actors.y_m[rows]), axis=1))
    block[:, 2] = frame.yaws(actors.heading_rad[rows])
    block[:, 3], block[:, 4], block[:, 5] = actors.length_m[rows], actors.width_m[rows], actors.kind[rows]
    return table
