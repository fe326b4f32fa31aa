"""Scene: the nearest agents, lanes, crosswalks and route lanes as small arrays, for networks that look at all of it.

What GameFormer and DTPP are given. `scene_inputs` works on arrays of the schema
as well as on those that `thinned` has left of them, with the same result.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.features.schema import HISTORY_FRAMES, channel_index
from interplan_sumo.features.view import Arrays

FIELDS: Final = (
    "ego_history", "agents", "lanes", "lanes_valid", "crosswalks", "crosswalks_valid", "route_lanes",
    "route_lanes_valid",
)  # fmt: skip
"""Of the schema; training reads `agent_futures`, too."""
BEHIND_M: Final = 6.0
"""Agents whose centre lies further behind the rear axle are left out, as published."""
EGO_CHANNELS: Final = ("x", "y", "yaw", "vx", "vy", "ax", "ay")
AGENT_CHANNELS: Final = ("x", "y", "yaw", "vx", "vy", "yaw_rate", "length", "width", "vehicle", "pedestrian", "bicycle")
LANE_CHANNELS: Final = ("x", "y", "yaw", "light_green", "light_yellow", "light_red", "light_none")

_SEEN = [channel_index("agents", name) for name in AGENT_CHANNELS[:8]]
_CAR, _LONG = channel_index("agents", "is_car"), channel_index("agents", "is_long_vehicle")
_OTHERS = [channel_index("agents", name) for name in ("is_pedestrian", "is_bicycle")]
_LENGTH = channel_index("agents", "length")
_LANE = [channel_index("lanes", name) for name in LANE_CHANNELS]
_EGO = [channel_index("ego_history", name) for name in EGO_CHANNELS]
_VALID = 3  # channel of `agent_futures`


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneSize:
    """How much of the scene a network is given."""

    radius_m: float
    """Agents, lanes and crosswalks that stay further away are left out; of the route the nearest pieces are shown."""
    frames: int
    """Of the last 2 s, equally spaced, the present included: 21 are all of them, 11 every second one."""
    agents: int
    lanes: int
    lane_points: int
    """Per lane and route lane."""
    crosswalks: int
    crosswalk_points: int
    """At most 20, which is what the schema has."""
    route_lanes: int
    future_steps: int
    """Of the next 8 s, equally spaced: 80 are all of them, 16 every fifth one."""


def thinned(arrays: Arrays, size: SceneSize) -> Arrays:
    """The same arrays with the agents, lanes, points and frames that `scene_inputs` and `scene_futures` look at.

    In new memory, so that the large ones can go. What is thinned already stays
    as it is; the ego's own and all other arrays stay whole.
    """
    made = dict(arrays)
    rows, kept = _nearest_agents(arrays["agents"], size)
    agents = np.take_along_axis(arrays["agents"], rows[..., None, None], axis=1) * kept[..., None, None]
    made["agents"] = agents[:, :, _spread(agents.shape[2], size.frames)].astype(np.float32)
    if "agent_futures" in arrays:
        futures = np.take_along_axis(arrays["agent_futures"], rows[..., None, None], axis=1) * kept[..., None, None]
        made["agent_futures"] = _steps(futures, size)
    for name, count in (("lanes", size.lanes), ("route_lanes", size.route_lanes)):
        made[name] = arrays[name][:, :count][:, :, _spread(arrays[name].shape[2], size.lane_points)]
        made[f"{name}_valid"] = arrays[f"{name}_valid"][:, :count].copy()
    around = np.arange(size.crosswalk_points) * arrays["crosswalks"].shape[2] // size.crosswalk_points
    made["crosswalks"] = arrays["crosswalks"][:, : size.crosswalks][:, :, around]
    made["crosswalks_valid"] = arrays["crosswalks_valid"][:, : size.crosswalks].copy()
    return made


def scene_inputs(arrays: Arrays, size: SceneSize) -> Arrays:
    """What the network sees, float32, in the ego frame; rows that do not exist are 0.

    | array | shape | channels |
    |---|---|---|
    | `ego` | (B, frames, 7) | `EGO_CHANNELS`: pose, velocity and acceleration of the rear axle, oldest first |
    | `agents` | (B, agents, frames, 11) | `AGENT_CHANNELS`: the nearest first; 0 where one was not seen yet |
    | `lanes` | (B, lanes, lane_points, 7) | `LANE_CHANNELS`: pieces of at most 50 m, the nearest first |
    | `crosswalks` | (B, crosswalks, crosswalk_points, 3) | x, y, yaw along the outline |
    | `route_lanes` | (B, route_lanes, lane_points, 3) | x, y, yaw of the route's pieces, the nearest first |
    """
    small = thinned(arrays, size)
    agents, lanes, crosswalks = small["agents"], small["lanes"], small["crosswalks"]
    vehicle = agents[..., _CAR, None] + agents[..., _LONG, None]
    onward = np.roll(crosswalks, -1, axis=2) - crosswalks
    yaw = np.arctan2(onward[..., 1], onward[..., 0])[..., None]
    found = {
        "ego": small["ego_history"][:, _spread(HISTORY_FRAMES, size.frames)][..., _EGO],
        "agents": np.concatenate((agents[..., _SEEN], vehicle, agents[..., _OTHERS]), axis=-1),
        "lanes": _near(lanes[..., _LANE], size),
        "crosswalks": _near(np.concatenate((crosswalks, yaw), axis=-1), size),
        "route_lanes": small["route_lanes"],
    }
    return {name: np.asarray(values, dtype=np.float32) for name, values in found.items()}


def scene_futures(arrays: Arrays, size: SceneSize) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Where everyone will be: poses (B, 1 + agents, future_steps, 3) in the ego frame, and whether they are known.

    Row 0 is the ego's rear axle, the others are box centres in the order of `scene_inputs`.
    """
    ego = _steps(arrays["ego_future"][:, None], size)
    together = np.concatenate((ego, thinned(arrays, size)["agent_futures"]), axis=1)
    return together[..., :_VALID], together[..., _VALID] > 0.5


def _nearest_agents(agents: NDArray[Any], size: SceneSize) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """(B, agents) rows of the schema's agents (B, N, F, 13), the nearest first, and whether there is one."""
    now = agents[:, :, -1]
    x, y = now[..., 0], now[..., 1]
    fits = (now[..., _LENGTH] > 0.0) & (x >= -BEHIND_M) & (np.hypot(x, y) <= size.radius_m)
    rows = np.argsort(~fits, axis=1, kind="stable")[:, : size.agents]
    return rows, np.take_along_axis(fits, rows, axis=1)


def _near(lines: NDArray[Any], size: SceneSize) -> NDArray[Any]:
    """Lines (B, N, points, C) without those that stay outside the radius."""
    distance_m = np.hypot(lines[..., 0], lines[..., 1]).min(axis=-1)
    return lines * (distance_m <= size.radius_m)[..., None, None]


def _spread(have: int, wanted: int) -> NDArray[np.int64]:
    """Places (wanted,) of so many rows, the first and the last among them; all of them where there are as many."""
    return np.rint(np.linspace(0, have - 1, wanted)).astype(np.int64)


def _steps(futures: NDArray[Any], size: SceneSize) -> NDArray[np.float32]:
    """The last of every so many frames (B, N, F, 4) of the future."""
    every = futures.shape[2] // size.future_steps
    return futures[:, :, every - 1 :: every].astype(np.float32)
