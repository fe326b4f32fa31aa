"""Closed plans: what PDM-Closed plans in each sample, made from the sample, its drive's route and its map.

A sample holds nearly all that PDM-Closed looks at: the ego's state, the 30
nearest agents and the 20 nearest static objects, lights within 100 m. Each
sample is the first step of an episode, so that the centre line begins in the
lane where the ego is.
"""

from __future__ import annotations

from functools import cache, partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from interplan_learned.pdm_hybrid.planner import closed_poses
from interplan_planners.pdm_closed import PdmClosedPlanner
from interplan_sumo.dataset import folder as layout
from interplan_sumo.dataset.columns import Columns
from interplan_sumo.dataset.drives import map_hash
from interplan_sumo.dataset.reading import Dataset
from interplan_sumo.dynamics.rear_axle import center_of
from interplan_sumo.errors import InputError, UnknownNameError
from interplan_sumo.features.frame import EgoFrame
from interplan_sumo.features.schema import STEP_S, channel_index
from interplan_sumo.maps.store import find_map, load_roads
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import PACIFICA, EgoShape, EgoState
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.signals import Signals

FIELDS: Final = (
    "origin", "ego_history", "ego_history_valid", "agents", "static_objects", "lanes", "lanes_valid", "lane_ids",
    "drive", "tick",
)  # fmt: skip
"""Of the schema: what the plans are made from."""

_CLASSES = slice(channel_index("agents", "is_car"), channel_index("agents", "valid"))
_KINDS = np.array((ActorKind.VEHICLE, ActorKind.VEHICLE, ActorKind.PEDESTRIAN, ActorKind.BICYCLE), dtype=np.int8)
_LIGHTS = slice(channel_index("lanes", "light_green"), channel_index("lanes", "light_none"))


def closed_plans(columns: Columns, dataset: Dataset) -> NDArray[np.float32]:
    """(S, POSES, 3) `pdm_hybrid.closed_poses` of PDM-Closed's plans for samples with `FIELDS`.

    Maps are those in the data set's folder `maps`, else the shipped ones; InputError where there is none of that
    name, or another one than the data were made on.
    """

    roads_of = cache(partial(_roads, dataset))

    @cache
    def mission(drive: int) -> Mission:
        about = dataset.drives[drive]
        roads = roads_of(about.map)
        # PDM-Closed does not look at the goal: the end of the goal's lane stands in for it
        line = roads[about.goal_lane].centerline
        return Mission(roads, tuple(about.route), line.pose_at(line.length_m))

    planner = PdmClosedPlanner()
    plans: list[NDArray[np.float32]] = []
    for row, drive in enumerate(columns["drive"].tolist()):
        planner.start(mission(drive))
        plan = planner.plan(observation(columns, row))
        plans.append(closed_poses(plan, _frame(columns, row), PACIFICA))
    return np.array(plans)


def observation(columns: Columns, row: int, shape: EgoShape = PACIFICA) -> Observation:
    """What the planner saw in a sample, without the past; actors are numbered, nearest first, static ones last."""
    frame = _frame(columns, row)
    ego = _ego(columns, row, frame, shape)
    agents, statics = columns["agents"][row, :, -1], columns["static_objects"][row]
    actors = _actors(agents.astype(np.float64), statics.astype(np.float64), frame)
    return Observation(ego.time_s, ego, actors, _signals(columns, row))


def _frame(columns: Columns, row: int) -> EgoFrame:
    return EgoFrame(*columns["origin"][row].tolist())


def _ego(columns: Columns, row: int, frame: EgoFrame, shape: EgoShape) -> EgoState:
    before, now = columns["ego_history"][row, -2:].astype(np.float64).tolist()
    vx, vy, ax, ay, yaw_rate, steer, steer_rate = now[3:]  # in the ego frame, which is the body's now
    x_m, y_m = center_of(frame.x_m, frame.y_m, frame.heading_rad, shape)
    yaw_acceleration = (yaw_rate - before[7]) / STEP_S if columns["ego_history_valid"][row, -2] else 0.0
    return EgoState(
        STEP_S * int(columns["tick"][row]), x_m, y_m, frame.heading_rad, vx, vy, ax, ay, steer, steer_rate, yaw_rate,
        yaw_acceleration,
    )  # fmt: skip


def _actors(agents: Floats, statics: Floats, frame: EgoFrame) -> Actors:
    """From the present rows of `agents` (A, 13) and of `static_objects` (N, 6)."""
    agents, statics = agents[agents[:, -1] > 0.5], statics[statics[:, -1] > 0.5]
    kinds = np.concatenate((_KINDS[agents[:, _CLASSES].argmax(axis=1)], statics[:, -1].astype(np.int8)))
    x_m, y_m, heading_rad = frame.to_map(np.concatenate((agents[:, :3], statics[:, :3]))).T
    length_m, width_m = np.concatenate((agents[:, 6:8], statics[:, 3:5])).T
    velocities = np.pad(agents[:, 3:5], ((0, len(statics)), (0, 1)))
    vx_mps, vy_mps, _ = EgoFrame(0.0, 0.0, frame.heading_rad).to_map(velocities).T
    ids = tuple([f"{number:02d}" for number in range(len(kinds))])
    return Actors(ids, kinds, x_m, y_m, heading_rad, length_m, width_m, vx_mps, vy_mps)


def _signals(columns: Columns, row: int) -> Signals:
    lights = columns["lanes"][row, :, 0, _LIGHTS]
    shown = columns["lanes_valid"][row] & (lights > 0.5).any(axis=1)
    ids = map(str, columns["lane_ids"][row, shown].tolist())
    status = dict(sorted(zip(ids, lights[shown].argmax(axis=1).tolist(), strict=True)))
    return Signals(tuple(status), np.array(list(status.values()), dtype=np.int8))


def _roads(dataset: Dataset, name: str) -> Roads:
    beside = dataset.folder / layout.MAPS
    try:
        files = find_map(name, beside)
    except UnknownNameError:
        raise InputError(
            f"{dataset.folder} was made on the map {name!r}, which is none of the shipped ones; put its folder, "
            f"with a map.gpkg in it, into {beside}"
        ) from None
    if map_hash(files) != dataset.manifest.maps[name].map_sha256:
        raise InputError(f"{files.folder} is not the map that {dataset.folder} was made on; export the data again")
    return load_roads(name, beside)
