"""Recorded frames: everybody as shown and as SUMO has it, frame by frame, for `traffic_invariants` to look at."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import libsumo
import numpy as np

from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.store import find_map
from interplan_sumo.simulation.traffic import TrafficState
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.ego import PACIFICA, EgoState
from tests.simulation.traffic_invariants import Array, Body, Drive, Frame


class FrameRecorder:
    """Takes the frames of one drive, while SUMO runs in this process."""

    def __init__(self, map: str, maps_beside: Path | None = None) -> None:
        self.frames: list[Frame] = []
        self.bodies: dict[str, Body] = {}
        """What SUMO says of the type of each agent, by id."""
        self.sumo_names: dict[str, str] = {}
        """Whom SUMO calls how, by id."""
        self.walking: set[str] = set()
        """Pedestrians that are no agents of SUMO's."""
        self.standing: set[str] = set()
        """Whatever else is none."""
        self._origin_m = NetworkIds.read(find_map(map, maps_beside).ids).origin_m

    def note(self, state: TrafficState, ego: EgoState, agents: frozenset[str]) -> Frame:
        """Take one frame; of the ids that it shows `agents` are driven by SUMO."""
        actors = state.actors
        self._name(
            [row for row, name in enumerate(actors.ids) if name in agents and name not in self.sumo_names], state
        )
        names = self.sumo_names
        for name, kind in zip(actors.ids, actors.kind, strict=True):
            if name not in agents:
                (self.walking if kind == ActorKind.PEDESTRIAN else self.standing).add(name)
        sumo = [libsumo.vehicle.getSpeed(names[name]) if name in names else np.nan for name in actors.ids]
        frame = Frame(
            actors.ids, actors.x_m, actors.y_m, actors.heading_rad, actors.length_m, actors.width_m, actors.speed_mps,
            np.array(sumo), (ego.x_m, ego.y_m, ego.heading_rad, PACIFICA.length_m, PACIFICA.width_m),
        )  # fmt: skip
        self.frames.append(frame)
        return frame

    def drive(self) -> Drive:
        """All frames up to now."""
        return Drive.of(self.frames)

    def map_ends(self) -> tuple[Array, Array]:
        """(N, 2) where roads begin and (M, 2) where they end, asked of SUMO, in the map frame."""
        lane: Any = libsumo.lane
        lanes = [name for name in lane.getIDList() if not name.startswith(":")]
        follows = {name: [link[0] for link in lane.getLinks(name)] for name in lanes}
        fed = {after for all_after in follows.values() for after in all_after}
        begins = [lane.getShape(name)[0] for name in lanes if name not in fed]
        ends = [lane.getShape(name)[-1] for name in lanes if not follows[name]]
        begin_points, end_points = (np.array(each).reshape(-1, 2) + self._origin_m for each in (begins, ends))
        return begin_points, end_points

    def _name(self, rows: list[int], state: TrafficState) -> None:
        """Find out who is who in SUMO, by where it first is."""
        if not rows:
            return
        actors, vehicle = state.actors, libsumo.vehicle
        taken = set(self.sumo_names.values())
        free = [each for each in vehicle.getIDList() if each not in taken and each != "ego"]
        fronts = np.array([vehicle.getPosition(each) for each in free]).reshape(-1, 2) + self._origin_m
        for row in rows:
            reach_m = float(actors.length_m[row]) / 2.0
            front = np.array((np.cos(actors.heading_rad[row]), np.sin(actors.heading_rad[row]))) * reach_m
            away_m = np.hypot(*(fronts - (actors.x_m[row], actors.y_m[row]) - front).T)
            name = self.sumo_names[actors.ids[row]] = free[int(away_m.argmin())]
            self.bodies[actors.ids[row]] = Body(
                vehicle.getTypeID(name), vehicle.getAccel(name), vehicle.getEmergencyDecel(name)
            )
