"""Tracks: everybody who moves in a drive, placed frame by frame beside the lanes of SUMO's network."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from math import cos, sin
from typing import Final

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.batch.stored_drive import StoredDrive
from interplan_sumo.errors import InputError
from interplan_sumo.report import scenario_drawing as drawing
from interplan_sumo.report.sumo_gui.xml import colour, tag
from interplan_sumo.simulation.agent_kinematics import navigation_deg
from interplan_sumo.simulation.ego_proxy import EGO
from interplan_sumo.simulation.network import NetworkLane, SumoNetwork
from interplan_sumo.simulation.sumo import DT_S
from interplan_sumo.world.actors import ActorKind

FARTHEST_LANE_M: Final = 60.0
"""Road users are put beside a lane within this distance: SUMO shows nobody who is far from all of them."""
END_M: Final = 0.1
"""Nobody is put nearer to the end of a lane: rounded, the place could lie beyond it."""
WRONG_WAY_M: Final = 5.0
"""So much nearer must a lane of the other direction be to be preferred."""

_Kind = tuple[ActorKind, str, float, float]
"""What has a type of its own: kind, behaviour, length and width."""


@dataclass(frozen=True, slots=True)
class _Placed:
    """A road user in one frame, in SUMO's frame and beside one of its lanes."""

    name: str
    kind: str
    x_m: float
    """Of the middle of the front bumper."""
    y_m: float
    heading_rad: float
    speed_mps: float
    lane: NetworkLane
    position_m: float

    def at_end_of(self, lane: NetworkLane) -> _Placed:
        """The same at the end of a lane."""
        end = lane.line.pose_at(lane.line.length_m)
        return _Placed(self.name, self.kind, end.x_m, end.y_m, end.heading_rad, 10.0, lane, lane.length_m)

    def tag(self) -> str:
        return tag(
            "vehicle", id=self.name, type=self.kind, x=f"{self.x_m:.3f}", y=f"{self.y_m:.3f}",
            angle=f"{navigation_deg(self.heading_rad):.3f}", speed=f"{self.speed_mps:.3f}", lane=self.lane.id,
            pos=f"{self.position_m:.2f}",
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Tracks:
    """A drive beside the network that it was driven on; vehicle types by kind, behaviour and size."""

    drive: StoredDrive
    network: SumoNetwork
    origin_m: tuple[float, float]
    """Of SUMO's frame, in the map's."""
    colours: Mapping[str, str]
    """By behaviour."""
    standing: NDArray[np.bool_]
    """(R,) which rows of the actors belong to what never moves and is nobody's car."""
    types: dict[_Kind, str] = field(default_factory=dict["_Kind", str])
    _edges: dict[str, str] = field(default_factory=dict[str, str])
    """The edge that each road user was put beside last, not counting those inside junctions."""
    _onward: dict[str, frozenset[str]] = field(default_factory=dict[str, "frozenset[str]"])
    """The edges that can be reached from an edge."""

    @classmethod
    def of(
        cls, drive: StoredDrive, network: SumoNetwork, origin_m: tuple[float, float], standing: NDArray[np.bool_]
    ) -> Tracks:
        names = {str(name) for name in drive.trace.actors.behaviour if name}
        tracks = cls(drive, network, origin_m, drawing.behaviour_colours(names), standing)
        for row in np.flatnonzero(~standing):
            tracks.types.setdefault(tracks.kind_of(int(row)), f"type{len(tracks.types)}")
        return tracks

    def kind_of(self, row: int) -> _Kind:
        actors = self.drive.trace.actors
        size = round(float(actors.length_m[row]), 2), round(float(actors.width_m[row]), 2)
        return ActorKind(int(actors.kind[row])), str(actors.behaviour[row]), *size

    def type_tags(self) -> Iterator[str]:
        """What everybody looks like. How they drive does not matter: they are moved."""
        shape = self.drive.trace.shape
        yield _vehicle_type(EGO, drawing.EGO, "passenger/sedan", shape.length_m, shape.width_m)
        for (kind, behaviour, length_m, width_m), name in self.types.items():
            paint = self.colours[behaviour] if behaviour else drawing.STANDING
            if kind is ActorKind.PEDESTRIAN:
                yield _vehicle_type(name, drawing.PERSON, "pedestrian", length_m, width_m)
            else:
                yield _vehicle_type(name, paint, _looks(kind, length_m), length_m, width_m)

    def track_tags(self) -> Iterator[str]:
        """Every frame in SUMO's terms: front bumpers, angles clockwise from north, and the lane next to each.

        Whoever has gone is put at the end of the lane, where SUMO takes cars off the road.
        Recorded road users farther than FARTHEST_LANE_M from all lanes are left out.
        """
        trace = self.drive.trace
        actors, ego, moves = trace.actors, trace.ego, ~self.standing
        before: dict[str, _Placed] = {}
        for frame in range(len(trace)):
            rows = actors.rows(frame)
            moving = [row for row in range(rows.start, rows.stop) if moves[row]]
            here = {each.name: each for row in moving if (each := self._placed_actor(row)) is not None}
            pose = float(ego.x_m[frame]), float(ego.y_m[frame]), float(ego.heading_rad[frame])
            driven = self._placed(EGO, EGO, *pose, trace.shape.length_m, max(0.0, float(ego.vx_mps[frame])))
            if driven is None:
                raise InputError(
                    f"{self.drive.scenario.id}: the ego goes farther than {FARTHEST_LANE_M:g} m from all lanes, "
                    "where SUMO shows nobody; replay this drive as a page"
                )
            here[EGO] = driven
            yield f'<timestep time="{frame * DT_S:.2f}">'
            yield from (each.tag() for each in here.values())
            yield from (self._leaving(each).tag() for name, each in before.items() if name not in here)
            yield "</timestep>"
            before = here

    def _leaving(self, each: _Placed) -> _Placed:
        """At the end of the lane, or of the one that the way through a junction leads to."""
        ways = self.network.ways_through(each.lane.id) if each.lane.internal else ()
        return each.at_end_of(self.network.lanes[ways[0].to_lane] if ways else each.lane)

    def _placed_actor(self, row: int) -> _Placed | None:
        actors = self.drive.trace.actors
        pose = float(actors.x_m[row]), float(actors.y_m[row]), float(actors.heading_rad[row])
        speed_mps = float(np.hypot(actors.vx_mps[row], actors.vy_mps[row]))
        kind = self.types[self.kind_of(row)]
        return self._placed(str(actors.ids[row]), kind, *pose, float(actors.length_m[row]), speed_mps)

    def _placed(
        self, name: str, kind: str, x_m: float, y_m: float, heading_rad: float, length_m: float, speed_mps: float
    ) -> _Placed | None:
        """From the middle of a body in the map to the middle of its front bumper in SUMO; None far from all lanes."""
        x_m += length_m / 2.0 * cos(heading_rad) - self.origin_m[0]
        y_m += length_m / 2.0 * sin(heading_rad) - self.origin_m[1]
        beside = self._lane(name, x_m, y_m, heading_rad)
        if beside is None:
            return None
        lane, position_m = beside
        return _Placed(
            name, kind, x_m, y_m, heading_rad, speed_mps, lane, max(0.0, min(position_m, lane.length_m - END_M))
        )

    def _lane(self, name: str, x_m: float, y_m: float, heading_rad: float) -> tuple[NetworkLane, float] | None:
        """The lane beside a front bumper, and the place on it: of its direction if about as near, and on a route.

        SUMO makes a route of the edges of all frames: each must be reachable from the one before.
        """
        before = self._edges.get(name)
        best: tuple[float, NetworkLane, float] | None = None
        for piece, away_m in self.network.pieces_around(x_m, y_m, FARTHEST_LANE_M):
            if best is not None and away_m > best[0]:
                break
            lane = piece.lane
            if before is None if lane.internal else not self._leads(before, lane.edge):
                continue
            arc_m, left_m = piece.plain_line.project(x_m, y_m)
            against = cos(piece.plain_line.heading_at(arc_m) - heading_rad) < 0.0
            cost_m = abs(left_m) + (WRONG_WAY_M if against else 0.0)
            if best is None or cost_m < best[0]:
                best = cost_m, lane, piece.start_m + arc_m
        if best is None:
            return None
        if not best[1].internal:
            self._edges[name] = best[1].edge
        return best[1], best[1].position_of(best[2])

    def _leads(self, before: str | None, edge: str) -> bool:
        """Whether one can drive from an edge to another; from nowhere to all."""
        if before is None or before == edge:
            return True
        if before not in self._onward:
            found, open_ends = set[str](), [before]
            while open_ends:
                for lane in self.network.edges[open_ends.pop()]:
                    fresh = {self.network.lanes[link.to_lane].edge for link in self.network.links[lane]} - found
                    found |= fresh
                    open_ends += fresh
            self._onward[before] = frozenset(found)
        return edge in self._onward[before]


def _vehicle_type(name: str, paint: str, looks: str, length_m: float, width_m: float) -> str:
    return tag(
        "vType", id=name, vClass="ignoring", guiShape=looks, length=f"{length_m:g}", width=f"{width_m:g}",
        color=colour(paint), minGap="0", maxSpeed="1000000",
    )  # fmt: skip


def _looks(kind: ActorKind, length_m: float) -> str:
    """SUMO's name for a shape like this."""
    if kind is ActorKind.BICYCLE:
        return "bicycle"
    sizes = ((3.0, "motorcycle"), (6.0, "passenger/sedan"), (10.0, "truck"), (15.0, "bus"))
    return next((looks for up_to_m, looks in sizes if length_m < up_to_m), "truck/semitrailer")
