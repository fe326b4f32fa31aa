"""interPlan's scenarios on nuPlan's logs: what a name asks for, made of the ego's place and the map."""

from __future__ import annotations

from dataclasses import replace
from math import hypot
from typing import Final

import numpy as np

from interplan_sumo.errors import ScenarioError
from interplan_sumo.scenario.matching import matches
from interplan_sumo.scenario.original import UNNAMED_POLICY, Original, Point, PublishedWalk
from interplan_sumo.scenario.original_goal import way_to_goal
from interplan_sumo.scenario.recorded import DECIMALS_M, RecordedScene, ego_scene, floored_m
from interplan_sumo.scenario.recorded_lights import with_recorded_lights
from interplan_sumo.scenario.scenario import (
    Density,
    Jaywalker,
    LanePosition,
    Obstacle,
    ObstacleKind,
    PlacedVehicle,
    Scenario,
    TrafficDemand,
)
from interplan_sumo.scenario.surroundings import obstacle_at, place_at
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import wrap_angle
from interplan_sumo.world.recording import Recording
from interplan_sumo.world.roads import Lane, Roads

FAMILY: Final = "interplan"
"""In ids; the family of a scenario is that of its type."""
DURATION_S: Final = 30.0
BUS_M: Final = (7.456, 2.079)
"""Length and width of interPlan's bus."""
CROSSING_S: Final = 15.0
"""How long interPlan's pedestrians are meant to take for their way."""
SLOWEST_MPS: Final = 0.1
"""Whoever walks more slowly than this stands: the workers of construction zones take 15 s for a metre."""
KERB_REACH_M: Final = 40.0
"""Pedestrians may begin this far from the next centre line."""
LANE_REACH_M: Final = 3.0
"""A single car begins at most this far beside the centre line that it is put on."""


def original_scene(
    original: Original, recording: Recording, roads: Roads, exempt: tuple[str, ...] = ()
) -> RecordedScene:  # fmt: skip
    """The scenario of a name, with notes on what interPlan has and this one has not; `exempt` as its family has it.

    The recording begins at the scenario's token. As in interPlan everyone that
    was recorded is left out; start, speed, lights and, where no goal is named,
    the way are those of the log. ScenarioError if it cannot be staged.
    """
    bare, _, _, notes = ego_scene(
        recording, roads, ego_id=None, at_s=0.0, agents="sumo", goal_m=PACIFICA.length_m + 0.1, duration_s=DURATION_S
    )
    if original.letters.goal is not None:
        route, goal = way_to_goal(original, roads, bare.start, bare.route, DURATION_S)
        bare, unfit = with_recorded_lights(replace(bare, route=route, goal=goal), recording, roads, 0)
        notes = (unfit,) if unfit else ()
    said = list(notes)
    scenario = replace(
        bare,
        id=f"{roads.name}.{FAMILY}/{original.name}",
        family=original.family,
        obstacles=_obstacles(original, roads),
        jaywalkers=_jaywalkers(original, roads, said),
        vehicles=_moving(original, roads, said),
        traffic=_traffic(original, roads, bare, said),
        exempt=exempt,
    )
    scenario.check(roads)
    return RecordedScene(scenario, (), tuple(said))


def _obstacles(original: Original, roads: Roads) -> tuple[Obstacle, ...]:
    """Cars, buses, cones, and people who as good as stand."""
    size = (PACIFICA.length_m, PACIFICA.width_m) if original.letters.keep_logged == 0 else (None, None)
    found = [_obstacle(original, roads, "car", pose, size) for pose in original.cars]
    found += [_obstacle(original, roads, "bus", pose, BUS_M) for pose in original.buses]
    found += [_obstacle(original, roads, "cone", (*point, 0.0)) for point in original.cones]
    found += [_obstacle(original, roads, "worker", (*walk.start, 0.0)) for walk in original.walks if _stands(walk)]
    return tuple(found)


def _obstacle(
    original: Original, roads: Roads, kind: ObstacleKind, pose: tuple[float, float, float],
    size_m: tuple[float, float] | tuple[None, None] = (None, None),
) -> Obstacle:  # fmt: skip
    found = obstacle_at(roads, kind, np.array(pose), size_m)
    if found is None:
        raise ScenarioError(f"{original.name}: the {kind} at {_said(pose)} stands beside no lane of map {roads.name}")
    return found


def _speed_mps(walk: PublishedWalk) -> float:
    return hypot(walk.end[0] - walk.start[0], walk.end[1] - walk.start[1]) / CROSSING_S


def _stands(walk: PublishedWalk) -> bool:
    return _speed_mps(walk) < SLOWEST_MPS


def _jaywalkers(original: Original, roads: Roads, notes: list[str]) -> tuple[Jaywalker, ...]:
    found: list[Jaywalker] = []
    for walk in original.walks:
        if _stands(walk):
            continue
        ends = [place_at(roads, *point, KERB_REACH_M) for point in (walk.start, walk.end)]
        if ends[0] is None or ends[1] is None:
            raise ScenarioError(f"{original.name}: the pedestrian at {_said(walk.start)} walks beside no lane")
        found.append(Jaywalker(ends[0], ends[1], round(_speed_mps(walk), DECIMALS_M)))
        if walk.begins_at_step is not None:
            notes.append(f"the pedestrian at {_said(walk.start)} begins when the ego is near, not at a step")
    return tuple(found)


def _moving(original: Original, roads: Roads, notes: list[str]) -> tuple[PlacedVehicle, ...]:
    """Single cars on the nearest lane that they stand on; interPlan gives them no heading."""
    found: list[PlacedVehicle] = []
    for x_m, y_m, speed_mps in original.moving:
        lanes = [lane for lane in roads.lanes_near(x_m, y_m, LANE_REACH_M) if isinstance(roads[lane], Lane)]
        beside = {lane: roads[lane].centerline.project_point(x_m, y_m) for lane in lanes}
        near = min(beside, key=lambda lane: (abs(beside[lane][1]), lane), default=None)
        if near is None or abs(beside[near][1]) > LANE_REACH_M:
            notes.append(f"the single car at {_said((x_m, y_m))} is left out: it is on no lane")
        else:
            found.append(PlacedVehicle(LanePosition(near, floored_m(beside[near][0])), round(speed_mps, DECIMALS_M)))
    return tuple(found)


def _traffic(original: Original, roads: Roads, bare: Scenario, notes: list[str]) -> TrafficDemand:
    density = original.letters.density
    if density == "none":
        return TrafficDemand()
    oncoming: Density = "none"
    for point in original.filled_at:
        if _comes_against(roads, bare, point):
            oncoming = density
        else:
            notes.append(f"the road at {_said(point)} is not filled: it does not run against the ego's")
    return TrafficDemand(density, original.letters.policy or UNNAMED_POLICY, oncoming)


def _comes_against(roads: Roads, bare: Scenario, point: Point) -> bool:
    """Whether the lane at a point runs against the ego's road beside it."""
    lanes = roads.lanes_at(*point) or (roads.nearest_lane(*point),)
    line = roads[lanes[0]].centerline
    heading_rad = line.pose_at(line.project_point(*point)[0]).heading_rad
    against = np.array((*point, float(wrap_angle(heading_rad + np.pi))))
    route = set(bare.route)
    return any(roads[match.lane].roadblock_id in route for match in matches(roads, against, KERB_REACH_M))


def _said(point: tuple[float, ...]) -> str:
    return f"({point[0]:.2f}, {point[1]:.2f})"
