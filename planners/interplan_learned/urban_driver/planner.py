"""UrbanDriver's planner, and the vectors that its network is given."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from interplan_learned.card import Size
from interplan_learned.driving import one_sample, plan_through
from interplan_learned.network import load_network
from interplan_sumo.features.schema import LANE_POINTS, LINE_POINTS, channel_index
from interplan_sumo.features.view import Arrays, EgoView
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.trajectory import Trajectory

FIELDS: Final = (
    "ego_history", "ego_history_valid", "agents", "lanes", "lanes_valid", "left_boundaries", "right_boundaries",
    "stop_lines", "stop_lines_valid", "crosswalks", "crosswalks_valid",
)  # fmt: skip
RADIUS_M: Final = 35.0
"""Lines of the map that stay further away are left out, as published."""
FRAMES: Final = (20, 16, 12, 8, 4)
"""Of the 21 frames of a history, the present first: 0.4 s apart, what nuPlan's sampler makes of four in 1.5 s."""
POINTS: Final = LINE_POINTS
EGO_CHANNELS: Final = ("x", "y", "yaw")
VEHICLE_CHANNELS: Final = ("x", "y", "yaw", "vx", "vy", "yaw_rate", "length", "width")
LINE_CHANNELS: Final = ("x", "y", "light_green", "light_yellow", "light_red", "light_none")
"""Lights are those of `lanes`; all other lines have none of the four."""

_EGO = [channel_index("ego_history", name) for name in EGO_CHANNELS]
_VEHICLE = [channel_index("agents", name) for name in VEHICLE_CHANNELS]
_KINDS = [channel_index("agents", name) for name in ("is_car", "is_long_vehicle")]
_SEEN = channel_index("agents", "valid")
_LANE = [channel_index("lanes", name) for name in LINE_CHANNELS]
_ON_ROUTE = channel_index("lanes", "on_route")
_SPREAD = np.rint(np.linspace(0, LANE_POINTS - 1, POINTS)).astype(np.int64)
_AREAS: Final = ("stop_lines", "crosswalks")


@dataclass(frozen=True, slots=True, kw_only=True)
class UrbanDriverSize:
    """How much of what is around the ego the network is given."""

    vehicles: int
    pieces: int
    """The nearest pieces of lanes; all lanes, boundaries and route lanes are of these."""
    lanes: int
    """And as many left and right boundaries."""
    stop_lines: int
    crosswalks: int
    route_lanes: int

    @property
    def lines(self) -> tuple[tuple[str, int], ...]:
        """Kinds of map lines, in the order of the input `lines`, and how many rows each has there."""
        return (
            ("lanes", self.lanes), ("left_boundaries", self.lanes), ("right_boundaries", self.lanes),
            ("stop_lines", self.stop_lines), ("crosswalks", self.crosswalks), ("route_lanes", self.route_lanes),
        )  # fmt: skip


SIZES: Final[Mapping[Size, UrbanDriverSize]] = {
    "compact": UrbanDriverSize(vehicles=16, pieces=24, lanes=14, stop_lines=4, crosswalks=4, route_lanes=12),
    "published": UrbanDriverSize(vehicles=30, pieces=60, lanes=30, stop_lines=20, crosswalks=20, route_lanes=30),
}


class UrbanDriverPlanner:
    """What the vehicles did in the last 1.6 s and the map within 35 m give sixteen poses; nothing is checked or mended.

    Pedestrians, bicycles and cones it does not see, as published.
    """

    paper: ClassVar[str] = "Scheel et al. 2021"

    def __init__(self, weights: str = "urban_driver") -> None:
        """`weights` names shipped ones, or is a path to a model card."""
        self._network = load_network("urban_driver", weights)

    def start(self, mission: Mission) -> None:
        self._view = EgoView(mission)

    def plan(self, observation: Observation) -> Trajectory:
        given = inputs(one_sample(self._view.arrays(observation)), self._network.card.size)
        return plan_through(self._network.run(given)["poses"][0], self._view, observation)

    def report(self) -> dict[str, Any]:
        return self._network.about


def thinned(arrays: Arrays, size: Size) -> Arrays:
    """The same arrays with the agents, frames, rows and points that `inputs` looks at, which gives the same of them.

    In new memory, so that the large ones can go. What is thinned already stays
    as it is; the ego's own and all other arrays stay whole.
    """
    numbers, made = SIZES[size], dict(arrays)
    made["agents"] = _vehicles(arrays["agents"], numbers.vehicles)
    lanes = arrays["lanes"][:, : numbers.pieces]
    made["lanes"] = lanes[:, :, _SPREAD] if lanes.shape[2] == LANE_POINTS else lanes
    for name in ("lanes_valid", "left_boundaries", "right_boundaries"):
        made[name] = arrays[name][:, : numbers.pieces].copy()
    for name, count in numbers.lines:
        if name in _AREAS:
            made[name] = arrays[name][:, :count].copy()
            made[f"{name}_valid"] = arrays[f"{name}_valid"][:, :count].copy()
    return made


def inputs(arrays: Arrays, size: Size) -> Arrays:
    """What the network sees, in the ego frame, from arrays of the schema or those that `thinned` has left of them.

    | array | shape | what |
    |---|---|---|
    | `ego` | (B, 5, 3) | `EGO_CHANNELS` of the rear axle, the present first |
    | `vehicles` | (B, vehicles, 5, 8) | `VEHICLE_CHANNELS` of the nearest vehicles, the present first |
    | `lines` | (B, lines, 20, 6) | `LINE_CHANNELS` of the nearest of each kind, in the order of the size's `lines` |

    `ego_valid` (B, 5), `vehicles_valid` (B, vehicles, 5) and `lines_valid` (B, lines)
    tell what there is; all else is 0.
    """
    small = thinned(arrays, size)
    ego_valid = small["ego_history_valid"][:, list(FRAMES)]
    vehicles = small["agents"]
    lines, lines_valid = _lines(small, SIZES[size])
    return {
        "ego": small["ego_history"][:, list(FRAMES)][..., _EGO].astype(np.float32) * ego_valid[..., None],
        "ego_valid": ego_valid,
        "vehicles": vehicles[..., _VEHICLE].astype(np.float32),
        "vehicles_valid": vehicles[..., _SEEN] > 0.5,
        "lines": lines,
        "lines_valid": lines_valid,
    }


def _vehicles(agents: NDArray[Any], count: int) -> NDArray[np.float32]:
    """(B, count, 5, 13) the nearest vehicles of agents (B, N, 21 or 5, 13), the present first; empty rows are 0."""
    frames = list(FRAMES) if agents.shape[2] > len(FRAMES) else slice(None)
    recent = agents[:, :, frames]
    fits = recent[:, :, 0, _KINDS].any(axis=-1)
    rows = np.argsort(~fits, axis=1, kind="stable")[:, :count]
    kept = np.take_along_axis(recent, rows[..., None, None], axis=1)
    return kept.astype(np.float32) * np.take_along_axis(fits, rows, axis=1)[..., None, None]


def _lines(small: Arrays, size: UrbanDriverSize) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """`lines` and `lines_valid` of `inputs`, from thinned arrays."""
    lanes = small["lanes"]
    near = small["lanes_valid"] & _within(lanes)
    points = {
        "lanes": (lanes[..., _LANE], near),
        "left_boundaries": (small["left_boundaries"], near),
        "right_boundaries": (small["right_boundaries"], near),
        "route_lanes": (lanes[..., :2], near & (lanes[:, :, 0, _ON_ROUTE] > 0.5)),
        **{name: (small[name], small[f"{name}_valid"] & _within(small[name])) for name in _AREAS},
    }
    parts = [_nearest(*points[name], count) for name, count in size.lines]
    return np.concatenate([part for part, _ in parts], axis=1), np.concatenate([valid for _, valid in parts], axis=1)


def _within(lines: NDArray[Any]) -> NDArray[np.bool_]:
    """(B, N) whether a point of lines (B, N, P, C) is within the radius."""
    return np.hypot(lines[..., 0], lines[..., 1]).min(axis=-1) <= RADIUS_M


def _nearest(lines: NDArray[Any], fits: NDArray[np.bool_], count: int) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """The first `count` of lines (B, N, 20, C) that fit (B, N), as (B, count, 20, 6) with 0 where there is none."""
    rows = np.argsort(~fits, axis=1, kind="stable")[:, :count]
    valid = np.take_along_axis(fits, rows, axis=1)
    table = np.zeros((len(lines), rows.shape[1], POINTS, len(LINE_CHANNELS)), dtype=np.float32)
    table[..., : lines.shape[-1]] = np.take_along_axis(lines, rows[..., None, None], axis=1)
    return table * valid[..., None, None], valid
