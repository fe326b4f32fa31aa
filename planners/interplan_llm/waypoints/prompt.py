"""The question for waypoints: what there is to see, in the car's own frame, and the form of the answer."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from interplan_llm.models.protocol import Message
from interplan_planners.common.route_correction import corrected_route
from interplan_planners.common.route_search import LaneFinder
from interplan_planners.common.ways import Ways
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.geometry import Floats

STEP_S: Final = 0.5
POINTS: Final = 16
"""Eight seconds (the published numbers)."""
NEAREST, WITHIN_M = 5, 50.0
"""So many agents, and so many things that stand for ever, are told of (published)."""
PAST_S = (2.0, 1.5, 1.0, 0.5)
LINE_M = (5.0, 10.0, 20.0, 30.0, 45.0, 60.0)
"""Points of the lane's centre line that are told, along it."""

SYSTEM: Final = (
    "You drive a car. Positions are in metres in the car's frame: x to the front, y to the left, the car at (0, 0); "
    "speeds in m/s. You are told what is around, how the car moves, and where it shall go. First say in one or two "
    "short sentences what matters and what you do. Then give the 16 places (x, y) where the centre of the car shall "
    "be every 0.5 s from now on. Hit nothing, keep to the road, drive smoothly, reach the goal. Answer with JSON: "
    '{"thoughts": "...", "waypoints": [[x, y], ...]}'
)
SCHEMA: Final[dict[str, Any]] = {
    "type": "object",
    "properties": {
        "thoughts": {"type": "string", "maxLength": 240},
        "waypoints": {
            "type": "array",
            "minItems": POINTS,
            "maxItems": POINTS,
            "items": {"type": "array", "minItems": 2, "maxItems": 2, "items": {"type": "number"}},
        },
    },
    "required": ["thoughts", "waypoints"],
    "additionalProperties": False,
}
_NAMES: Final = {
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
        self._ways: Ways | None = None

    def messages(self, seen: Observation) -> tuple[Message, Message]:
        """The question about a step."""
        ego = seen.ego
        agents = _told(seen, seen.actors.kind <= ActorKind.BICYCLE, moving=True)
        static = _told(seen, seen.actors.kind > ActorKind.BICYCLE, moving=False)
        lines = [
            f"Agents: {agents or 'none'}.",
            f"Things in the way: {static or 'none'}.",
            f"Car: speed {ego.vx_mps:.1f}, acceleration {ego.ax_mps2:.1f}, yaw rate {ego.yaw_rate_radps:.2f} rad/s.",
            f"Car's past, every 0.5 s: {_past(seen)}.",
            *self._way(seen),
        ]
        return Message("system", SYSTEM), Message("user", "\n".join(lines))

    def _way(self, seen: Observation) -> list[str]:
        """Mission goal, and where the own lane leads."""
        ego, roads = seen.ego, self._mission.roads
        if self._ways is None:
            route = corrected_route(roads, self._mission.route, ego.pose)
            self._lanes = LaneFinder(roads, route)
            self._ways = Ways(self._mission, route, fallback_limit_mps=15.0)
        index, lane_id = self._lanes.at(ego.x_m, ego.y_m, ego.heading_rad)
        way = self._ways.from_lane(index, lane_id)
        arc_m, _ = way.path.line.project_point(ego.x_m, ego.y_m)
        limit_mps = float(way.limit_mps[min(int(arc_m), len(way.limit_mps) - 1)])
        told = [f"Speed limit {limit_mps:.1f}. Goal: {self._goal(lane_id)}, {way.room_m - arc_m:.0f} m ahead."]
        if self._centerline:
            arcs = np.array([m for m in LINE_M if arc_m + m <= way.path.length_m])
            if arcs.size:
                poses = way.path.line.poses_at(arc_m + arcs)
                told.append(f"Lane ahead: {_places(_in_frame(seen, poses[:, 0], poses[:, 1]))}.")
        return told

    def _goal(self, lane_id: str) -> str:
        """forward, left or right: the side on which fewer lane changes are left."""
        assert self._ways is not None
        needed = self._ways.changes_needed
        here = needed.get(lane_id)
        roads = self._mission.roads
        for side, lane in (("left", roads.left_of(lane_id)), ("right", roads.right_of(lane_id))):
            if lane is not None and lane.id in needed and (here is None or needed[lane.id] < here):
                return side
        return "forward"


def _told(seen: Observation, group: Any, *, moving: bool) -> str:
    """The nearest of a group: class, place and, where they move, velocity in the car's frame."""
    actors, ego = seen.actors, seen.ego
    away = np.hypot(actors.x_m - ego.x_m, actors.y_m - ego.y_m)
    near = np.flatnonzero(group & (away < WITHIN_M))
    near = near[np.argsort(away[near], kind="stable")[:NEAREST]]
    places = _in_frame(seen, actors.x_m[near], actors.y_m[near])
    velocities = _velocities(seen, actors, near)
    told: list[str] = []
    for row, (x_m, y_m), (vx, vy) in zip(near.tolist(), places.tolist(), velocities.tolist(), strict=True):
        text = f"{_NAMES[ActorKind(int(actors.kind[row]))]} at ({x_m:.1f}, {y_m:.1f})"
        told.append(f"{text} moving ({vx:.1f}, {vy:.1f})" if moving else text)
    return "; ".join(told)


def _velocities(seen: Observation, actors: Actors, rows: Any) -> Floats:
    cos, sin = np.cos(seen.ego.heading_rad), np.sin(seen.ego.heading_rad)
    vx, vy = actors.vx_mps[rows], actors.vy_mps[rows]
    return np.stack((cos * vx + sin * vy, cos * vy - sin * vx), axis=1) + 0.0


def _past(seen: Observation) -> str:
    egos = seen.past.egos
    steps = [round(ago / 0.1) for ago in PAST_S]
    rows = [egos[-k] for k in steps if k <= len(egos)]
    if not rows:
        return "unknown"
    return _places(_in_frame(seen, np.array([e.x_m for e in rows]), np.array([e.y_m for e in rows])))


def _in_frame(seen: Observation, x_m: Floats, y_m: Floats) -> Floats:
    """(N, 2) places in the car's frame."""
    cos, sin = np.cos(seen.ego.heading_rad), np.sin(seen.ego.heading_rad)
    dx, dy = x_m - seen.ego.x_m, y_m - seen.ego.y_m
    return np.stack((cos * dx + sin * dy, cos * dy - sin * dx), axis=1)


def _places(places: Floats) -> str:
    return " ".join(f"({x_m:.1f}, {y_m:.1f})" for x_m, y_m in (np.round(places, 1) + 0.0).tolist())
