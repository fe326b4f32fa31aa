"""The question for waypoints: what there is to see, in the car's own frame."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from interplan_llm.models.protocol import Message
from interplan_planners.common.driven_route import DrivenRoute
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.geometry import Floats, Ints

NEAREST, WITHIN_M = 5, 50.0
"""So many agents, and so many things that stand for ever, are told of (published)."""
PAST_S = (2.0, 1.5, 1.0, 0.5)
LINE_M = (5.0, 10.0, 20.0, 30.0, 45.0, 60.0)
"""Points of the lane's centre line that are told, along it."""

SYSTEM: Final = (
    "You drive a car. Positions are in metres in the car's frame: x to the front, y to the left, the car at (0, 0); "
    "speeds in m/s. You are told what is around, how the car moves, and where it shall go. Hit nothing, keep to the "
    "road, drive smoothly, reach the goal. Answer with a JSON object of two properties: thoughts, in at most twelve "
    "words what matters and what you do; waypoints, a list of the 16 pairs [x,y] where the centre of the car shall be "
    "every 0.5 s from now on, with one decimal."
)

NAMES: Final = {
    ActorKind.VEHICLE: "vehicle",
    ActorKind.PEDESTRIAN: "pedestrian",
    ActorKind.BICYCLE: "bicycle",
    ActorKind.TRAFFIC_CONE: "cone",
    ActorKind.BARRIER: "barrier",
    ActorKind.CZONE_SIGN: "sign",
    ActorKind.GENERIC_OBJECT: "object",
}


class Prompter:
    """Puts what a planner sees into words; one instance serves one episode."""

    def __init__(self, mission: Mission, *, centerline: bool = True) -> None:
        """`centerline` adds points of the own lane, which GPT-Driver's prompt does without."""
        self._mission = mission
        self._centerline = centerline
        self._route: DrivenRoute | None = None

    def messages(self, observation: Observation) -> tuple[Message, Message]:
        """The question about a step."""
        ego = observation.ego
        agents, static = told_rows(observation)
        lines = [
            f"Agents: {_told(observation, agents, moving=True) or 'none'}.",
            f"Things in the way: {_told(observation, static, moving=False) or 'none'}.",
            f"Car: speed {ego.vx_mps:.1f}, acceleration {ego.ax_mps2:.1f}, yaw rate {ego.yaw_rate_radps:.2f} rad/s.",
            f"Car's past, every 0.5 s: {_past(observation)}.",
            *self._way(observation),
        ]
        return Message("system", SYSTEM), Message("user", "\n".join(lines))

    def _way(self, observation: Observation) -> list[str]:
        """Mission goal, and where the own lane leads."""
        ego = observation.ego
        self._route = self._route or DrivenRoute(self._mission, ego.pose, fallback_limit_mps=15.0)
        index, lane_id = self._route.lane_at(ego.pose)
        way = self._route.ways.from_lane(index, lane_id)
        arc_m, _ = way.path.line.project_point(ego.x_m, ego.y_m)
        limit_mps = float(way.limit_mps[min(int(arc_m), len(way.limit_mps) - 1)])
        told = [f"Speed limit {limit_mps:.1f}. Goal: {self._goal(lane_id)}, {way.room_m - arc_m:.0f} m ahead."]
        if self._centerline:
            arcs = np.array([m for m in LINE_M if arc_m + m <= way.path.length_m])
            if arcs.size:
                poses = way.path.line.poses_at(arc_m + arcs)
                told.append(f"Lane ahead: {_places(_in_frame(observation, poses[:, 0], poses[:, 1]))}.")
        return told

    def _goal(self, lane_id: str) -> str:
        """forward, left or right: the side on which fewer lane changes are left."""
        assert self._route is not None
        needed = self._route.ways.changes_needed
        here = needed.get(lane_id)
        roads = self._mission.roads
        for side, lane in (("left", roads.left_of(lane_id)), ("right", roads.right_of(lane_id))):
            if lane is not None and lane.id in needed and (here is None or needed[lane.id] < here):
                return side
        return "forward"


def told_rows(observation: Observation) -> tuple[Ints, Ints]:
    """Rows of the actors that are told of, nearest first: those that may move, and those that stand for ever."""
    return _nearest(observation, observation.actors.kind <= ActorKind.BICYCLE), _nearest(
        observation, observation.actors.kind > ActorKind.BICYCLE
    )


def places_of(observation: Observation, rows: Ints) -> Floats:
    """(N, 2) centres of actors in the car's frame."""
    return _in_frame(observation, observation.actors.x_m[rows], observation.actors.y_m[rows])


def velocities_of(observation: Observation, rows: Ints) -> Floats:
    """(N, 2) velocities of actors over the ground, along the axes of the car's frame, m/s."""
    cos, sin = np.cos(observation.ego.heading_rad), np.sin(observation.ego.heading_rad)
    vx, vy = observation.actors.vx_mps[rows], observation.actors.vy_mps[rows]
    return np.stack((cos * vx + sin * vy, cos * vy - sin * vx), axis=1) + 0.0


def _nearest(observation: Observation, group: NDArray[np.bool_]) -> Ints:
    away = np.hypot(observation.actors.x_m - observation.ego.x_m, observation.actors.y_m - observation.ego.y_m)
    near = np.flatnonzero(group & (away < WITHIN_M))
    return near[np.argsort(away[near], kind="stable")[:NEAREST]]


def _told(observation: Observation, rows: Ints, *, moving: bool) -> str:
    """Class, place and, where they move, velocity."""
    places, velocities = places_of(observation, rows).tolist(), velocities_of(observation, rows).tolist()
    told: list[str] = []
    for row, (x_m, y_m), (vx, vy) in zip(rows.tolist(), places, velocities, strict=True):
        text = f"{NAMES[ActorKind(int(observation.actors.kind[row]))]} at ({x_m:.1f}, {y_m:.1f})"
        told.append(f"{text} moving ({vx:.1f}, {vy:.1f})" if moving else text)
    return "; ".join(told)


def _past(observation: Observation) -> str:
    egos = observation.past.egos
    steps = [round(ago / 0.1) for ago in PAST_S]
    rows = [egos[-k] for k in steps if k <= len(egos)]
    if not rows:
        return "unknown"
    return _places(_in_frame(observation, np.array([e.x_m for e in rows]), np.array([e.y_m for e in rows])))


def _in_frame(observation: Observation, x_m: Floats, y_m: Floats) -> Floats:
    """(N, 2) places in the car's frame."""
    cos, sin = np.cos(observation.ego.heading_rad), np.sin(observation.ego.heading_rad)
    dx, dy = x_m - observation.ego.x_m, y_m - observation.ego.y_m
    return np.stack((cos * dx + sin * dy, cos * dy - sin * dx), axis=1)


def _places(places: Floats) -> str:
    return " ".join(f"({x_m:.1f}, {y_m:.1f})" for x_m, y_m in (np.round(places, 1) + 0.0).tolist())
