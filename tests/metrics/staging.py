"""Tiny drives for the tests of the metrics: a scenario on a road, facts of a drive, and rigid motions of both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
import shapely

from interplan_sumo.metrics.facts import Facts
from interplan_sumo.scenario.scenario import Jaywalker, LanePosition, Obstacle, Scenario
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.geometry import Floats, Polyline
from interplan_sumo.world.roads import Area, Connector, Lane, Roadblock, Roads, StopLine
from interplan_sumo.world.trace import ActorTable, EgoTrack, Trace
from tests.worlds import LANE_WIDTH_M, drive_through

AnyLane = TypeVar("AnyLane", Lane, Connector)
AnyShape = TypeVar("AnyShape", Lane, Connector, Roadblock, StopLine, Area)
LINES = ("centerline", "left_boundary", "right_boundary")
AREAS = ("intersections", "crosswalks", "walkways", "carparks", "road_segments", "generic_drivable_areas")

NOBODY = EgoTrack.of([])
"""An expert that never was."""


def facts_of(trace: Trace, roads: Roads, expert: EgoTrack = NOBODY, scenario: Scenario | None = None) -> Facts:
    return Facts(trace, roads, expert, scenario)


def scenario_on(
    roads: Roads, start: tuple[str, float], goal: tuple[str, float], obstacles: tuple[Obstacle, ...] = (),
    jaywalkers: tuple[Jaywalker, ...] = (),
) -> Scenario:  # fmt: skip
    """A scenario through all roadblocks of a tiny road, in order."""
    return Scenario(
        "lane_change_ltd/0", "lane_change_ltd", roads.name, LanePosition(*start), 10.0, LanePosition(*goal),
        tuple(sorted(roads.roadblocks, key=int)), obstacles=obstacles, jaywalkers=jaywalkers,
    )  # fmt: skip


def drive_at(
    x_m: object,
    y_m: object = 0.0,
    speed_mps: object = 10.0,
    heading_rad: object = 0.0,
    actors: list[Actors] | Actors | None = None,
) -> Trace:
    """A drive through given positions of the box centre; whatever is a single number holds for all frames."""
    columns = np.broadcast_arrays(*(np.asarray(v, dtype=np.float64) for v in (x_m, y_m, heading_rad, speed_mps)))
    x, y, heading, speed = (np.array(np.atleast_1d(column)) for column in columns)
    return drive_through(np.column_stack((x, y, heading)), speed, actors)


def lane_y_m(index: int) -> float:
    """The centre line of a lane of `straight_road`, counted from the left."""
    return -index * LANE_WIDTH_M


# --- rigid motions -------------------------------------------------------------------------------

Move = Callable[[Floats], Floats]


def rotation(angle_rad: float, shift_m: tuple[float, float]) -> Move:
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)

    def move(xy: Floats) -> Floats:
        x, y = xy.T
        return np.column_stack((cos * x - sin * y + shift_m[0], sin * x + cos * y + shift_m[1]))

    return move


def moved_roads(roads: Roads, move: Move) -> Roads:
    """The same map elsewhere."""

    def at(old: AnyShape) -> AnyShape:
        return replace(old, polygon=shapely.transform(old.polygon, move))

    def along(old: AnyLane) -> AnyLane:
        lines = {name: Polyline(move(getattr(old, name).points)) for name in LINES}
        return replace(at(old), **lines)

    areas: dict[str, Any] = {name: tuple(map(at, getattr(roads, name))) for name in AREAS}
    return replace(
        roads,
        lanes={k: along(v) for k, v in roads.lanes.items()},
        connectors={k: along(v) for k, v in roads.connectors.items()},
        roadblocks={k: at(v) for k, v in roads.roadblocks.items()},
        stop_lines={k: at(v) for k, v in roads.stop_lines.items()},
        **areas,
    )


def _turned(heading_rad: Floats, move: Move) -> Floats:
    ends = np.column_stack((np.cos(heading_rad), np.sin(heading_rad)))
    ahead = move(ends) - move(np.zeros_like(ends))
    return np.arctan2(ahead[:, 1], ahead[:, 0])


def moved_track(track: EgoTrack, move: Move) -> EgoTrack:
    x, y = move(np.column_stack((track.x_m, track.y_m))).T
    return replace(track, x_m=x, y_m=y, heading_rad=_turned(track.heading_rad, move))


def moved_actors(actors: ActorTable, move: Move) -> ActorTable:
    x, y = move(np.column_stack((actors.x_m, actors.y_m))).T
    still = move(np.zeros((1, 2)))
    vx, vy = (move(np.column_stack((actors.vx_mps, actors.vy_mps))) - still).T
    return replace(actors, x_m=x, y_m=y, heading_rad=_turned(actors.heading_rad, move), vx_mps=vx, vy_mps=vy)


def moved_trace(trace: Trace, move: Move) -> Trace:
    return replace(trace, ego=moved_track(trace.ego, move), actors=moved_actors(trace.actors, move))
