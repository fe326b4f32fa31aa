"""Whole worlds turned and shifted: roads, missions and observations as somebody sees them who chose other axes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely

from interplan_sumo.planner import Mission, Observation, Past
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import Floats, Polyline, Pose, wrap_angle
from interplan_sumo.world.roads import Roads


@dataclass(frozen=True)
class Move:
    """A turn about the origin, then a shift."""

    turn_rad: float
    x_m: float
    y_m: float

    def points(self, xy: Floats) -> Floats:
        c, s = np.cos(self.turn_rad), np.sin(self.turn_rad)
        return np.asarray(xy) @ np.array(((c, s), (-s, c))) + (self.x_m, self.y_m)

    def mission(self, mission: Mission) -> Mission:
        goal = mission.goal
        x, y = self.points(np.array((goal.x_m, goal.y_m)))
        pose = Pose(float(x), float(y), float(wrap_angle(goal.heading_rad + self.turn_rad)))
        return replace(mission, roads=self.roads(mission.roads), goal=pose)

    def observation(self, observation: Observation) -> Observation:
        past = Past(tuple(map(self.ego, observation.past.egos)), tuple(map(self.actors, observation.past.actors)))
        return replace(observation, ego=self.ego(observation.ego), actors=self.actors(observation.actors), past=past)

    def ego(self, ego: EgoState) -> EgoState:
        x, y = self.points(np.array((ego.x_m, ego.y_m)))
        heading = float(wrap_angle(ego.heading_rad + self.turn_rad))
        return replace(ego, x_m=float(x), y_m=float(y), heading_rad=heading)

    def actors(self, actors: Actors) -> Actors:
        x, y = self.points(np.stack((actors.x_m, actors.y_m), axis=1)).T
        vx, vy = Move(self.turn_rad, 0.0, 0.0).points(np.stack((actors.vx_mps, actors.vy_mps), axis=1)).T
        heading = wrap_angle(actors.heading_rad + self.turn_rad)
        return replace(actors, x_m=x, y_m=y, heading_rad=heading, vx_mps=vx, vy_mps=vy)

    def roads(self, roads: Roads) -> Roads:
        return replace(
            roads,
            lanes=self._all(roads.lanes),
            connectors=self._all(roads.connectors),
            roadblocks=self._all(roads.roadblocks),
            stop_lines=self._all(roads.stop_lines),
            crosswalks=tuple(map(self._moved, roads.crosswalks)),
            intersections=tuple(map(self._moved, roads.intersections)),
            road_segments=tuple(map(self._moved, roads.road_segments)),
        )

    def _all(self, table: Any) -> Any:
        return {name: self._moved(each) for name, each in table.items()}

    def _moved(self, thing: Any) -> Any:
        changed: dict[str, Any] = {"polygon": shapely.transform(thing.polygon, self.points)}
        for name in ("centerline", "left_boundary", "right_boundary"):
            if hasattr(thing, name):
                changed[name] = Polyline(self.points(getattr(thing, name).points))
        return replace(thing, **changed)
