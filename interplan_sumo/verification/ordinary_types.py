"""Ordinary types: does a drive through a scene show what its type of nuPlan's challenge is named after?"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.trace import Trace

LEADER_M: Final = 40.0
"""A leader is nearer than this, bumper to bumper, and less than 2 m to the side."""
FOLLOWING_FRAMES: Final = 30
LONG_M: Final = 7.0
"""A vehicle beyond this length is a long one (nuPlan: 8 m; our lorries are 7.5 m and more)."""
TURN_RAD: Final = np.radians(50.0)
FELT_MPS2: Final = 1.5


def shows_its_type(scenario: Scenario, trace: Trace) -> bool:
    """Whether a drive through a scene has what the scene's family is named after; families that are no type have it."""
    shows = _SHOWS.get(scenario.family)
    return shows is None or shows(scenario, trace)


def _turned_rad(trace: Trace) -> float:
    headings = np.unwrap(trace.ego.heading_rad)
    return float(headings[-1] - headings[0])


def _leaders(trace: Trace) -> Floats:
    """(N, 3) gap (m), speed and length of the nearest vehicle ahead in each frame; inf where there is none."""
    ego, half_m = trace.ego, trace.shape.length_m / 2.0
    found = np.full((len(ego), 3), np.inf)
    for frame in range(len(ego)):
        actors = trace.actors.at(frame)
        dx, dy = actors.x_m - ego.x_m[frame], actors.y_m - ego.y_m[frame]
        cosine, sine = np.cos(ego.heading_rad[frame]), np.sin(ego.heading_rad[frame])
        gap_m = cosine * dx + sine * dy - half_m - actors.length_m / 2.0
        beside = np.abs(cosine * dy - sine * dx) < 2.0
        rows = np.flatnonzero((actors.kind == ActorKind.VEHICLE) & beside & (gap_m > -1.0) & (gap_m < LEADER_M))
        if len(rows):
            row = rows[np.argmin(gap_m[rows])]
            found[frame] = gap_m[row], actors.speed_mps[row], actors.length_m[row]
    return found


def _follows(least_length_m: float) -> Callable[[Scenario, Trace], bool]:
    def check(_scenario: Scenario, trace: Trace) -> bool:
        leaders = _leaders(trace)
        behind = np.isfinite(leaders[:, 0]) & (leaders[:, 2] >= least_length_m) & (trace.ego.vx_mps > 2.0)
        return int(behind.sum()) >= FOLLOWING_FRAMES

    return check


def _stops_behind(_scenario: Scenario, trace: Trace) -> bool:
    leaders = _leaders(trace)
    both = (trace.ego.vx_mps < 0.5) & (leaders[:, 1] < 0.5) & (leaders[:, 0] < 10.0)
    return bool(both[20:].any()) and float(trace.ego.vx_mps[0]) > 3.0


def _stands_in_traffic(_scenario: Scenario, trace: Trace) -> bool:
    leaders = _leaders(trace)
    return bool((trace.ego.vx_mps[:10] < 0.2).all() and (leaders[:10, 0] < 10.0).all() and (leaders[:5, 1] < 0.5).all())


def _crowded(_scenario: Scenario, trace: Trace) -> bool:
    frames = 0
    for frame in range(len(trace.ego)):
        actors = trace.actors.at(frame).within(float(trace.ego.x_m[frame]), float(trace.ego.y_m[frame]), 15.0)
        frames += int((actors.kind == ActorKind.VEHICLE).sum() >= 3)
    return frames >= 10


_SHOWS: Final[dict[str, Callable[[Scenario, Trace], bool]]] = {
    "starting_left_turn": lambda _, trace: _turned_rad(trace) > TURN_RAD,
    "starting_right_turn": lambda _, trace: _turned_rad(trace) < -TURN_RAD,
    "starting_straight_traffic_light_intersection_traversal": lambda _, trace: abs(_turned_rad(trace)) < TURN_RAD / 2,
    "stopping_with_lead": _stops_behind,
    "high_lateral_acceleration": lambda _, trace: bool(
        (np.abs(trace.ego.vx_mps * trace.ego.yaw_rate_radps) >= FELT_MPS2).any()
    ),
    "high_magnitude_speed": lambda _, trace: float(trace.ego.vx_mps.max()) > 15.0,
    "low_magnitude_speed": lambda _, trace: float(trace.ego.vx_mps[0]) < 2.0,
    "waiting_for_pedestrian_to_cross": lambda scenario, trace: bool(
        trace.ego.vx_mps.min() <= 0.6 * scenario.start_speed_mps
    ),
    "behind_long_vehicle": _follows(LONG_M),
    "stationary_in_traffic": _stands_in_traffic,
    "near_multiple_vehicles": _crowded,
    "following_lane_with_lead": _follows(0.0),
}
