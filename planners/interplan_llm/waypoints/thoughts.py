"""Thoughts by rules: what matters in a drive that is known, and what its driver did, in the manner of GPT-Driver."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from interplan_llm.waypoints.answers import trajectory
from interplan_llm.waypoints.form import STEP_S
from interplan_llm.waypoints.prompt import NAMES, places_of, told_rows, velocities_of
from interplan_sumo.planner import Observation
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.ego import PACIFICA, EgoShape, EgoState
from interplan_sumo.world.geometry import Floats, Ints

NEAR_AHEAD_M, NEAR_ASIDE_M = 3.0, 1.0
"""An object matters if its forecast comes nearer than this to the car's future, box to box (published)."""
MOST_OBJECTS: Final = 3
"""As many are named; twelve words hold no more."""
STANDS_MPS: Final = 0.5
SAME_SPEED_MPS: Final = 0.5
QUICK_FACTOR: Final = 2.0
"""Speeds that differ by less are the same; those that differ by more than the factor changed quickly (published)."""
FORWARD_M, LANE_CHANGE_M = 2.0, 4.0
"""Sideways in the end: less is straight on, less is a lane change, more is a turn (published)."""
TURNED_RAD: Final = 0.25
"""Who ends up turned by more than this turns, however little to the side."""
BESIDE_M: Final = 2.0
"""What is farther to the side than this is called left or right."""


def thoughts(observation: Observation, places: Floats, shape: EgoShape = PACIFICA) -> str:
    """What matters and what is done, in at most twelve words; places (16, 2) are the car's future in its own frame."""
    return f"{_objects(observation, places, shape)} {_action(observation.ego.vx_mps, places)}"


def notable(observation: Observation, places: Floats, shape: EgoShape = PACIFICA) -> Ints:
    """Rows of the actors, of those that are told of, that come near if they keep their velocity; soonest first."""
    rows = np.concatenate(told_rows(observation))
    near = _near(observation, rows, places, shape)
    found = np.flatnonzero(near.any(axis=0))
    return rows[found[np.argsort(near[:, found].argmax(axis=0), kind="stable")]]


def _near(observation: Observation, rows: Ints, places: Floats, shape: EgoShape) -> NDArray[np.bool_]:
    """(17, N) whether boxes of actors are near the car's at each step, the present included."""
    future = trajectory(places, EgoState(0.0, 0.0, 0.0, 0.0))
    after_s = np.arange(len(future.time_s))[:, None, None] * STEP_S
    apart = places_of(observation, rows) + after_s * velocities_of(observation, rows)
    apart = apart - np.stack((future.x_m, future.y_m), axis=1)[:, None, :]
    cos, sin = np.cos(future.heading_rad)[:, None], np.sin(future.heading_rad)[:, None]
    ahead_m = np.abs(cos * apart[..., 0] + sin * apart[..., 1])
    aside_m = np.abs(cos * apart[..., 1] - sin * apart[..., 0])
    turned_rad = observation.actors.heading_rad[rows] - observation.ego.heading_rad - future.heading_rad[:, None]
    along, across = np.abs(np.cos(turned_rad)), np.abs(np.sin(turned_rad))
    long_m, wide_m = observation.actors.length_m[rows] / 2, observation.actors.width_m[rows] / 2
    ahead_m -= shape.length_m / 2 + along * long_m + across * wide_m
    aside_m -= shape.width_m / 2 + along * wide_m + across * long_m
    return (ahead_m < NEAR_AHEAD_M) & (aside_m < NEAR_ASIDE_M)


def _objects(observation: Observation, places: Floats, shape: EgoShape) -> str:
    rows = notable(observation, places, shape)
    wheres = [_where(x_m, y_m) for x_m, y_m in places_of(observation, rows).tolist()]
    kinds = [NAMES[ActorKind(kind)] for kind in observation.actors.kind[rows].tolist()]
    told = list(dict.fromkeys(f"{kind} {where}" for kind, where in zip(kinds, wheres, strict=True)))
    return f"Mind {', '.join(told[:MOST_OBJECTS])}." if told else "Nothing comes near."


def _where(x_m: float, y_m: float) -> str:
    if abs(y_m) > BESIDE_M:
        return "left" if y_m > 0.0 else "right"
    return "ahead" if x_m > 0.0 else "behind"


def _action(speed_mps: float, places: Floats) -> str:
    """What becomes of the speed by the end of the places, and where they lead."""
    last_m = places[-1] - places[-2]
    speed, way = _speed(speed_mps, float(np.hypot(*last_m)) / STEP_S), _way(places)
    return f"{speed}." if speed == "Stand" else f"{speed}, {way}."


def _speed(now_mps: float, then_mps: float) -> str:
    if then_mps < STANDS_MPS:
        return "Stand" if now_mps < STANDS_MPS else "Stop"
    if abs(then_mps - now_mps) <= SAME_SPEED_MPS:
        return "Keep speed"
    if then_mps > now_mps:
        return "Accelerate quickly" if then_mps > QUICK_FACTOR * now_mps else "Accelerate"
    return "Decelerate quickly" if QUICK_FACTOR * then_mps < now_mps else "Decelerate"


def _way(places: Floats) -> str:
    aside_m = float(places[-1, 1])
    if abs(aside_m) < FORWARD_M:
        return "forward"
    side = "left" if aside_m > 0.0 else "right"
    turned_rad = float(trajectory(places, EgoState(0.0, 0.0, 0.0, 0.0)).heading_rad[-1])
    turns = abs(aside_m) >= LANE_CHANGE_M or abs(turned_rad) > TURNED_RAD
    return f"turn {side}" if turns else f"change lane {side}"
