"""Policy: what a learned policy sees and says, as arrays, and the planner that a policy becomes with them.

Everything is in the ego's frame: origin at the centre of its box, x ahead, y left, metres and radians.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.dynamics.rear_axle import rear_axle_of
from interplan_sumo.errors import InputError, PlannerError, UnknownNameError
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.scenario.route import goal_arc_m, route_centerline
from interplan_sumo.scenario.scenario import LanePosition, Scenario
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import EgoShape, EgoState
from interplan_sumo.world.geometry import Floats, wrap_angle
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.signals import SignalStatus
from interplan_sumo.world.trajectory import Trajectory

Arrays = NDArray[np.float32]
ObservationForm = Literal["vector", "dict"]
ActionForm = Literal["acceleration_steering", "trajectory"]

SIGHT_M: Final = 100.0
"""As far as planners see."""
ROUTE_SPACING_M: Final = 5.0
UNKNOWN_LIMIT_MPS: Final = 0.0
"""Stands where the map knows no limit."""


@dataclass(frozen=True, slots=True)
class FeatureBlock:
    """A part of what a policy sees: rows of equal columns."""

    name: str
    rows: int
    columns: Mapping[str, tuple[float, float]]
    """The bounds of each; what lies beyond is cut."""

    @property
    def bounds(self) -> tuple[Arrays, Arrays]:
        """Lowest and highest values (rows, columns)."""
        low, high = np.array(list(self.columns.values()), dtype=np.float32).T
        return np.tile(low, (self.rows, 1)), np.tile(high, (self.rows, 1))


_PLACE: Final = {"x_m": (-SIGHT_M, SIGHT_M), "y_m": (-SIGHT_M, SIGHT_M)}
_ANGLE: Final = (-np.pi, np.pi)
_SPEED: Final = (-60.0, 60.0)
OBSERVED: Final = (
    FeatureBlock(
        "ego",
        1,
        {
            "speed_mps": _SPEED,
            "acceleration_mps2": (-20.0, 20.0),
            "tire_angle_rad": _ANGLE,
            "yaw_rate_radps": (-10.0, 10.0),
            "left_of_route_m": (-SIGHT_M, SIGHT_M),
            "turned_from_route_rad": _ANGLE,
            "to_goal_m": (-SIGHT_M, 10.0 * SIGHT_M),
            "speed_limit_mps": (0.0, 60.0),
        },
    ),
    FeatureBlock("route", 16, {**_PLACE, "heading_rad": _ANGLE}),
    FeatureBlock(
        "actors",
        24,
        {
            **_PLACE,
            "heading_rad": _ANGLE,
            "vx_mps": _SPEED,
            "vy_mps": _SPEED,
            "length_m": (0.0, 30.0),
            "width_m": (0.0, 30.0),
            "is_vehicle": (0.0, 1.0),
            "is_person": (0.0, 1.0),
            "is_object": (0.0, 1.0),
        },
    ),
    FeatureBlock("light", 1, {"distance_m": (0.0, SIGHT_M), "is_red": (0.0, 1.0)}),
)
"""The ego; the route's line, 5 to 80 m ahead; the nearest actors, nearest first, rows of zeros where there are fewer;
the next light on the route that is red or yellow, else the end of sight and 0. Velocities are over ground."""

POSES: Final = 8
POSE_SPACING_S: Final = 0.5
_FARTHEST: Final = np.tile(np.array([240.0, 240.0, np.pi], dtype=np.float32), (POSES, 1))
ACTIONS: Final[Mapping[str, tuple[Arrays, Arrays]]] = {
    "acceleration_steering": (-np.ones(2, dtype=np.float32), np.ones(2, dtype=np.float32)),
    "trajectory": (-_FARTHEST, _FARTHEST),
}
"""Lowest and highest action of each form.

`acceleration_steering` (2,): -1 brakes with 8 m/s2, 1 accelerates with 3 m/s2; -1 and 1 turn the wheels to 0.5 rad
right and left. `trajectory` (8, 3): x, y and heading of the box centre 0.5, 1.0, ... 4.0 s ahead.
"""
HARDEST_BRAKE_MPS2: Final = 8.0
HARDEST_PUSH_MPS2: Final = 3.0
LARGEST_TIRE_ANGLE_RAD: Final = 0.5
TOP_SPEED_MPS: Final = 40.0
HELD_S: Final = 2.0
"""So long the plan of an `acceleration_steering` holds both."""


class Senses:
    """Turns what a planner sees into arrays, for one episode."""

    def __init__(self, mission: Mission, first: Observation) -> None:
        """`first` is the observation at the start of the episode: it says in which lane that is."""
        self._mission = mission
        staged = _as_scenario(mission, first.ego)
        self.line = route_centerline(mission.roads, staged)
        self.goal_m = goal_arc_m(mission.roads, staged)
        on_route = (c for c in mission.roads.connectors.values() if c.roadblock_id in mission.route)
        self._light_m = {
            c.id: self.line.project_point(*c.centerline.points[0].tolist())[0] for c in on_route if c.has_traffic_light
        }

    def parts(self, observation: Observation) -> dict[str, Arrays]:
        """The parts of `OBSERVED` by name, each (rows, columns), cut to their bounds."""
        arc_m, left_m = self.line.project_point(observation.ego.x_m, observation.ego.y_m)
        values = {
            "ego": self._ego(observation.ego, arc_m, left_m),
            "route": self._route(observation.ego, arc_m),
            "actors": _actors(observation.ego, observation.actors),
            "light": self._light(observation, arc_m),
        }
        return {part.name: _within(values[part.name], part) for part in OBSERVED}

    def _ego(self, ego: EgoState, arc_m: float, left_m: float) -> Floats:
        turned_rad = wrap_angle(ego.heading_rad - self.line.pose_at(arc_m).heading_rad)
        limit_mps = speed_limit_mps(self._mission.roads, ego) or UNKNOWN_LIMIT_MPS
        return np.array(
            [
                ego.speed_mps, ego.ax_mps2, ego.tire_angle_rad, ego.yaw_rate_radps,
                left_m, turned_rad, self.goal_m - arc_m, limit_mps,
            ]
        )  # fmt: skip

    def _route(self, ego: EgoState, arc_m: float) -> Floats:
        rows = next(part.rows for part in OBSERVED if part.name == "route")
        poses = self.line.poses_at(arc_m + ROUTE_SPACING_M * np.arange(1, rows + 1))
        return np.column_stack((_seen_from(ego, poses[:, :2]), wrap_angle(poses[:, 2] - ego.heading_rad)))

    def _light(self, observation: Observation, arc_m: float) -> Floats:
        stopping = observation.signals.with_status(SignalStatus.RED) | observation.signals.with_status(
            SignalStatus.YELLOW
        )
        ahead = [at - arc_m for light, at in self._light_m.items() if light in stopping and at > arc_m]
        return np.array([min(ahead), 1.0]) if ahead and min(ahead) < SIGHT_M else np.array([SIGHT_M, 0.0])


def vector_of(parts: Mapping[str, Arrays]) -> Arrays:
    """The parts in the order of `OBSERVED`, row by row, as one vector."""
    return np.concatenate([parts[part.name].ravel() for part in OBSERVED])


def speed_limit_mps(roads: Roads, ego: EgoState) -> float | None:
    """The limit where the ego is, the highest of several; None where none is known."""
    limits = [roads[lane].speed_limit_mps for lane in roads.at(ego.x_m, ego.y_m)]
    return max((limit for limit in limits if limit is not None), default=None)


def plan_of(action: Any, ego: EgoState, form: ActionForm, shape: EgoShape) -> Trajectory:
    """The plan that an action stands for, in the precision of float32.

    InputError if it has not the form's shape, PlannerError if it holds a
    number that is not finite.
    """
    values = np.asarray(action, dtype=np.float32).astype(np.float64)
    expected = ACTIONS[form][0].shape
    if values.shape != expected:
        raise InputError(f"the action has shape {values.shape}, {form} has {expected}")
    if not np.isfinite(values).all():
        raise PlannerError("the action holds a number that is not finite")
    return _held(values, ego, shape) if form == "acceleration_steering" else _through(values, ego)


def _held(action: Floats, ego: EgoState, shape: EgoShape) -> Trajectory:
    """The ego's way under constant acceleration and tyre angle: an arc of the rear axle, never backwards."""
    push, turn = np.clip(action, -1.0, 1.0).tolist()
    acceleration = push * (HARDEST_PUSH_MPS2 if push > 0.0 else HARDEST_BRAKE_MPS2)
    curvature = np.tan(turn * LARGEST_TIRE_ANGLE_RAD) / shape.wheelbase_m
    ahead_s: Floats = np.linspace(0.0, HELD_S, round(HELD_S / 0.1) + 1)
    speed = np.clip(ego.speed_mps + acceleration * ahead_s, 0.0, TOP_SPEED_MPS)
    travelled_m = np.concatenate(([0.0], np.cumsum((speed[1:] + speed[:-1]) * 0.05)))
    heading = ego.heading_rad + curvature * travelled_m
    middle = (heading[1:] + heading[:-1]) / 2.0  # the chord of an arc points along the mean of the headings at its ends
    chord_m = np.diff(travelled_m) * np.sinc(np.diff(heading) / (2.0 * np.pi))
    rear_x, rear_y = rear_axle_of(ego.x_m, ego.y_m, ego.heading_rad, shape)
    x_m = rear_x + np.concatenate(([0.0], np.cumsum(chord_m * np.cos(middle))))
    y_m = rear_y + np.concatenate(([0.0], np.cumsum(chord_m * np.sin(middle))))
    ahead_m = shape.rear_axle_to_center_m
    x_m, y_m = x_m + ahead_m * np.cos(heading), y_m + ahead_m * np.sin(heading)
    return Trajectory(ego.time_s + ahead_s, x_m, y_m, heading, speed)


def _through(action: Floats, ego: EgoState) -> Trajectory:
    """From the ego's pose through the poses of the action."""
    ahead_s: Floats = np.linspace(0.0, POSES * POSE_SPACING_S, POSES + 1)
    x, y, turned = np.concatenate((np.zeros((1, 3)), action)).T
    cos, sin = np.cos(ego.heading_rad), np.sin(ego.heading_rad)
    return Trajectory(
        ego.time_s + ahead_s, ego.x_m + cos * x - sin * y, ego.y_m + sin * x + cos * y, ego.heading_rad + turned
    )


class PolicyPlanner:
    """A policy as a planner, so that `run` scores it: it sees and says what it does in the environment."""

    def __init__(
        self,
        policy: Callable[[Any], Any],
        observation: ObservationForm = "vector",
        action: ActionForm = "acceleration_steering",
    ) -> None:
        """`policy` gives the action for an observation, in the forms that the environment has for these names."""
        for what, given, known in (("observation", observation, ("vector", "dict")), ("action", action, ACTIONS)):
            if given not in known:
                raise UnknownNameError(what, given, known)
        self._policy = policy
        self._observation = observation
        self._action: ActionForm = action

    def start(self, mission: Mission) -> None:
        """As `Planner.start`."""
        self._mission = mission
        self._senses: Senses | None = None

    def plan(self, observation: Observation) -> Trajectory:
        """As `Planner.plan`; PlannerError for an action that holds a number that is not finite."""
        self._senses = self._senses or Senses(self._mission, observation)
        parts = self._senses.parts(observation)
        action = self._policy(parts if self._observation == "dict" else vector_of(parts))
        return plan_of(action, observation.ego, self._action, self._mission.shape)


def _as_scenario(mission: Mission, start: EgoState) -> Scenario:
    """What the route's line is made from, as far as a planner knows it."""
    return Scenario(
        id="mission/0",
        family="mission",
        map=mission.roads.name,
        start=LanePosition(_lane_of(mission, start.x_m, start.y_m), 0.0),
        start_speed_mps=0.0,
        goal=_goal_place(mission),
        route=mission.route,
    )


def _lane_of(mission: Mission, x_m: float, y_m: float) -> str:
    """The lane of the route at a point, else the nearest one."""
    roads = mission.roads
    here = [lane for lane in roads.at(x_m, y_m) if roads[lane].roadblock_id in mission.route]
    return here[0] if here else roads.nearest_lane(x_m, y_m)


def _goal_place(mission: Mission) -> LanePosition:
    lane = _lane_of(mission, mission.goal.x_m, mission.goal.y_m)
    arc_m, _ = mission.roads[lane].centerline.project_point(mission.goal.x_m, mission.goal.y_m)
    return LanePosition(lane, arc_m)


def _actors(ego: EgoState, actors: Actors) -> Floats:
    """The nearest ones as rows of the part `actors`."""
    part = next(part for part in OBSERVED if part.name == "actors")
    away = _seen_from(ego, np.column_stack((actors.x_m, actors.y_m)))
    nearest = np.argsort(np.hypot(*away.T), kind="stable")[: part.rows]
    cos, sin = np.cos(ego.heading_rad), np.sin(ego.heading_rad)
    kind = actors.kind[nearest]
    is_vehicle, is_object = kind == ActorKind.VEHICLE, kind > ActorKind.BICYCLE
    kinds = np.stack((is_vehicle, ~(is_vehicle | is_object), is_object), axis=1).astype(np.float64)
    vx, vy = actors.vx_mps[nearest], actors.vy_mps[nearest]
    rows = np.column_stack(
        (
            away[nearest], wrap_angle(actors.heading_rad[nearest] - ego.heading_rad),
            cos * vx + sin * vy, cos * vy - sin * vx, actors.length_m[nearest], actors.width_m[nearest],
            kinds,
        )
    )  # fmt: skip
    return np.concatenate((rows, np.zeros((part.rows - len(rows), len(part.columns)))))


def _seen_from(ego: EgoState, xy: Floats) -> Floats:
    """Points (N, 2) of the map in the ego's frame."""
    dx, dy = xy[:, 0] - ego.x_m, xy[:, 1] - ego.y_m
    cos, sin = np.cos(ego.heading_rad), np.sin(ego.heading_rad)
    return np.column_stack((cos * dx + sin * dy, cos * dy - sin * dx))


def _within(values: Floats, part: FeatureBlock) -> Arrays:
    """Values as the part's rows, cut to its bounds."""
    low, high = part.bounds
    return np.clip(values.reshape(low.shape).astype(np.float32), low, high)
