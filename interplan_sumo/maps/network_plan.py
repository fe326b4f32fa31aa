"""The plan of a SUMO network: what edges, nodes, links and signal programs a map calls for."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from interplan_sumo.maps import junctions, signals_plan
from interplan_sumo.maps.controls import MapControls
from interplan_sumo.maps.edges import Edge, LaneGroup, LaneStretch, lane_group
from interplan_sumo.maps.junction_rules import ruled
from interplan_sumo.maps.junctions import Junction, end_port, start_port
from interplan_sumo.maps.signals_plan import Program
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import USUAL_LIMIT_MPS, Roads

STRAIGHTENED_M = 0.002
"""Shapes drop vertices that lie this close to the line without them: a fifth of the promised fidelity."""
_ORIGIN_GRID_M = 100.0
_BESIDE_M = 4.5
"""Inner lanes further apart than this have a median or a turn lane between them."""
_LENGTH_SHARE = 0.02
"""SUMO counts positions on the other lane from its far end: edges that differ by more stay strangers."""
_END_M = 2.0


@dataclass(frozen=True, slots=True)
class Link:
    """One SUMO connection to be: a connector, or the way across a cut (`connector_id` is None)."""

    node: str
    from_edge: str
    from_lane: int
    to_edge: str
    to_lane: int
    stretch: LaneStretch
    connector_id: str | None = None

    @property
    def key(self) -> tuple[str, str, str, str]:
        """What names a connection in SUMO's files."""
        return self.from_edge, self.to_edge, str(self.from_lane), str(self.to_lane)


@dataclass(frozen=True, eq=False)
class NetworkPlan:
    """A network to be, in map coordinates."""

    roads: Roads
    origin_m: tuple[float, float]
    groups: Mapping[str, LaneGroup]
    """By roadblock."""
    links: tuple[Link, ...]
    junctions: Mapping[str, Junction]
    """By node; nodes at cuts and loose ends have none."""
    programs: Mapping[str, Program]
    """Of ours, by node; the traffic light has the node's id."""
    controls: MapControls
    """What the map took over from its file: lights with the programs of the file, and right of way."""

    @cached_property
    def edges(self) -> tuple[Edge, ...]:
        return tuple(edge for group in self.groups.values() for edge in group.edges)

    def points(self, stretch: LaneStretch) -> Floats:
        """(N, 2) the shape of a stretch, origin shifted, without needless vertices."""
        if stretch not in self._shapes:
            self._shapes[stretch] = self._drawn(stretch)
        return self._shapes[stretch]

    @cached_property
    def _shapes(self) -> dict[LaneStretch, Floats]:
        return {}

    def _drawn(self, stretch: LaneStretch) -> Floats:
        line = self.roads[stretch.lane_id].centerline.between(stretch.start_m, stretch.end_m)
        thin = shapely.simplify(line.linestring, STRAIGHTENED_M, preserve_topology=False)
        points = shapely.get_coordinates(thin) if not thin.is_empty else line.points
        return points - np.array(self.origin_m)

    def limit_mps(self, lane_id: str) -> float:
        """The speed limit, or what stands in for one that the map does not know."""
        lane = self.roads[lane_id]
        if lane.speed_limit_mps is not None and lane.speed_limit_mps > 0.0:
            return lane.speed_limit_mps
        if lane_id in self.roads.lanes:
            return USUAL_LIMIT_MPS
        connector = self.roads.connectors[lane_id]
        return min(self.limit_mps(connector.from_lane_id), self.limit_mps(connector.to_lane_id))


def network_plan(roads: Roads, controls: MapControls) -> NetworkPlan:
    """The network that a map calls for.

    A node all of whose lit connectors have a program of the map's file follows
    it; else all of them get one of ours.
    """
    controls = controls.within(roads.connectors)
    together = [rules.connectors for rules in controls.junctions if rules.meets_known]
    nodes, members = junctions.junction_groups(roads, together)
    groups = {
        block.id: lane_group(roads, block, nodes[start_port(block.id)], nodes[end_port(block.id)])
        for block in roads.roadblocks.values()
        if not block.is_connector and block.lane_ids
    }
    signs = junctions.lane_signs(roads)
    meetings = {node: junctions.junction(roads, found, signs) for node, found in members.items()}
    meetings = ruled(meetings, controls.junctions)
    lit = [node for node, meeting in meetings.items() if not controls.links.keys() >= set(meeting.lit_ids)]
    ours = {id_ for node in lit for id_ in meetings[node].lit_ids}
    controls = controls.lighting({id_ for id_ in controls.links if roads.connectors[id_].has_traffic_light} - ours)
    programs = {node: signals_plan.program(roads, meetings[node], k) for k, node in enumerate(sorted(lit))}
    links = [
        Link(join.node, join.from_edge, join.from_lane, join.to_edge, join.to_lane, join.stretch)
        for group in groups.values()
        for join in group.joins
    ]
    taken: set[tuple[str, str]] = set()
    for node, meeting in meetings.items():
        for connector in meeting.connectors:
            if (connector.from_lane_id, connector.to_lane_id) in taken:
                continue  # SUMO knows one connection between two lanes; `maps check` lists the other as missing
            taken.add((connector.from_lane_id, connector.to_lane_id))
            start = groups[roads.lanes[connector.from_lane_id].roadblock_id].last[connector.from_lane_id]
            end = groups[roads.lanes[connector.to_lane_id].roadblock_id].first[connector.to_lane_id]
            whole = LaneStretch(connector.id, 0.0, connector.centerline.length_m)
            links.append(Link(node, *start, *end, whole, connector.id))
    points = np.concatenate([lane.centerline.points for lane in roads.lanes.values()])
    origin = np.floor(points.min(axis=0) / _ORIGIN_GRID_M) * _ORIGIN_GRID_M
    corner = float(origin[0]), float(origin[1])
    return NetworkPlan(roads, corner, groups, tuple(links), meetings, programs, controls)


def node_points(plan: NetworkPlan) -> dict[str, Floats]:
    """(N, 2) per node, all points that its shape must hold: lane ends and paths, origin shifted."""
    found: dict[str, list[Floats]] = defaultdict(list)
    for edge in plan.edges:
        for stretch in edge.lanes:
            points = plan.points(stretch)
            found[edge.from_node].append(points[:1])
            found[edge.to_node].append(points[-1:])
    for link in plan.links:
        found[link.node].append(plan.points(link.stretch))
    return {node: np.concatenate(parts) for node, parts in found.items()}


def opposite_lanes(plan: NetworkPlan) -> dict[str, str]:
    """SUMO lane -> the lane of the oncoming direction beside it, both ways.

    Only where the two edges cover the same stretch of road from end to end.
    """
    inner = [(f"{edge.id}_{len(edge.lanes) - 1}", edge, plan.points(edge.lanes[-1])) for edge in plan.edges]
    inner = [item for item in inner if item[1].lanes[-1].length_m > 4 * _END_M]
    if not inner:
        return {}
    middles = np.array([shapely.LineString(points).interpolate(0.5, normalized=True) for _, _, points in inner])
    tree = shapely.STRtree([shapely.LineString(points) for _, _, points in inner])
    found: dict[str, str] = {}
    for i, j in zip(*tree.query(middles, predicate="dwithin", distance=_BESIDE_M), strict=True):
        a, b = inner[int(i)], inner[int(j)]
        if i < j and a[0] not in found and b[0] not in found:
            lengths = a[1].lanes[-1].length_m, b[1].lanes[-1].length_m
            if abs(lengths[0] - lengths[1]) > _LENGTH_SHARE * min(lengths):
                continue
            ends = (a[2][0] - b[2][-1], a[2][-1] - b[2][0])
            along = a[2][-1] - a[2][0]
            if all(np.hypot(*end) < _BESIDE_M + _END_M for end in ends) and float(along @ (b[2][-1] - b[2][0])) < 0.0:
                found[a[0]], found[b[0]] = b[0], a[0]
    return found
