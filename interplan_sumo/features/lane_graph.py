"""Lane graph: a map's lanes and how they hang together, as integer tables; and PGP's nodes and edges on them."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import lru_cache
from itertools import pairwise
from math import ceil, pi
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.world.geometry import Floats, Ints, Polyline, wrap_angle
from interplan_sumo.world.roads import Connector, Lane, Roads

NODE_M: Final = 20.0
"""A node is a piece of a lane of at most this length (PGP's)."""
PROXIMAL_M: Final = 4.0
PROXIMAL_RAD: Final = pi / 4
PROXIMAL_CENTRES_M: Final = 20.0
"""Nodes are proximal if they come closer, turn less from each other and have their middles closer than this (PGP's)."""
SUCCESSOR, PROXIMAL = 0, 1


@dataclass(frozen=True, slots=True, eq=False)
class LaneGraph:
    """L lanes (connectors among them) by increasing id, and N nodes by lane and then in driving order.

    All ids are those of the map, 0 is none; poses are in the map frame.
    """

    lane_ids: Ints
    """(L,)"""
    is_connector: NDArray[np.bool_]
    """(L,)"""
    has_light: NDArray[np.bool_]
    """(L,)"""
    roadblock_ids: Ints
    """(L,)"""
    left_ids: Ints
    """(L,) neighbour lane of the same direction, geometrically on the left."""
    right_ids: Ints
    """(L,)"""
    length_m: Floats
    """(L,)"""
    limit_mps: Floats
    """(L,) not a number where the map knows none."""
    successors: Ints
    """(S, 2) ids of a lane and of one that follows it, sorted."""
    point_starts: Ints
    """(L + 1,) centre-line points of lane i are rows point_starts[i] to point_starts[i + 1] of `points`."""
    points: Floats
    """(P, 2)"""
    node_lane_ids: Ints
    """(N,)"""
    node_stretches_m: Floats
    """(N, 2) arc length on the lane where it begins and ends."""
    node_poses: Floats
    """(N, 3) x, y, heading of its middle."""
    edges: Ints
    """(E, 2) nodes, sorted: from, to."""
    edge_kinds: NDArray[np.int8]
    """(E,) 0 successor, 1 proximal."""

    def tables(self) -> dict[str, NDArray[np.generic]]:
        """All arrays by name."""
        return {each.name: getattr(self, each.name) for each in fields(self)}


@lru_cache(maxsize=8)
def lane_graph(roads: Roads) -> LaneGraph:
    """The graph of a map, from a small cache."""
    lanes = sorted((*roads.lanes.values(), *roads.connectors.values()), key=lambda lane: int(lane.id))
    ids = [lane.id for lane in lanes]
    counts = [max(1, ceil(lane.centerline.length_m / NODE_M - 1e-9)) for lane in lanes]
    ends_m = [np.linspace(0.0, lane.centerline.length_m, n + 1) for lane, n in zip(lanes, counts, strict=True)]
    stretches = np.concatenate([np.stack((m[:-1], m[1:]), axis=1) for m in ends_m])
    middles = [lane.centerline.poses_at((m[:-1] + m[1:]) / 2.0) for lane, m in zip(lanes, ends_m, strict=True)]
    poses = np.concatenate(middles)
    poses[:, 2] = wrap_angle(poses[:, 2])
    lines = [
        lane.centerline.between(*m).linestring for lane, ms in zip(lanes, ends_m, strict=True) for m in pairwise(ms)
    ]
    first = dict(zip(ids, np.concatenate(([0], np.cumsum(counts)[:-1])).tolist(), strict=True))
    last = {lane: first[lane] + n - 1 for lane, n in zip(ids, counts, strict=True)}
    follows = {(node, node + 1) for lane in ids for node in range(first[lane], last[lane])}
    follows |= {(last[lane], first[after]) for lane in ids for after in roads.outgoing(lane)}
    edges = sorted(
        [(*pair, SUCCESSOR) for pair in follows] + [(*pair, PROXIMAL) for pair in _proximal(lines, poses, follows)]
    )
    edge_table = np.array(edges, dtype=np.int64).reshape(-1, 3)
    return LaneGraph(
        lane_ids=_ids(ids),
        is_connector=np.array([isinstance(lane, Connector) for lane in lanes]),
        has_light=np.array([isinstance(lane, Connector) and lane.has_traffic_light for lane in lanes]),
        roadblock_ids=_ids([lane.roadblock_id for lane in lanes]),
        left_ids=_ids([_id(roads.left_of(lane)) for lane in ids]),
        right_ids=_ids([_id(roads.right_of(lane)) for lane in ids]),
        length_m=np.array([lane.centerline.length_m for lane in lanes]),
        limit_mps=np.array([np.nan if lane.speed_limit_mps is None else lane.speed_limit_mps for lane in lanes]),
        successors=np.array(
            sorted((int(lane), int(after)) for lane in ids for after in roads.outgoing(lane)), dtype=np.int64
        ).reshape(-1, 2),
        point_starts=np.cumsum([0, *(len(lane.centerline.points) for lane in lanes)]),
        points=np.concatenate([lane.centerline.points for lane in lanes]),
        node_lane_ids=np.repeat(_ids(ids), counts),
        node_stretches_m=stretches,
        node_poses=poses,
        edges=edge_table[:, :2],
        edge_kinds=edge_table[:, 2].astype(np.int8),
    )


def node_lines(roads: Roads, graph: LaneGraph) -> list[Polyline]:
    """The centre line of each node."""
    return [
        roads[str(lane)].centerline.between(*stretch)
        for lane, stretch in zip(graph.node_lane_ids.tolist(), graph.node_stretches_m.tolist(), strict=True)
    ]


def _proximal(lines: list[shapely.LineString], poses: Floats, follows: set[tuple[int, int]]) -> list[tuple[int, int]]:
    """Pairs of nodes side by side, both ways round."""
    one, other = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=PROXIMAL_M)
    apart = poses[one] - poses[other]
    near = np.hypot(apart[:, 0], apart[:, 1]) < PROXIMAL_CENTRES_M
    along = np.abs(wrap_angle(apart[:, 2])) < PROXIMAL_RAD
    kept = near & along & (one != other)
    pairs = zip(one[kept].tolist(), other[kept].tolist(), strict=True)
    return [pair for pair in pairs if pair not in follows and pair[::-1] not in follows]


def _ids(ids: list[str]) -> Ints:
    return np.array([int(each) for each in ids], dtype=np.int64)


def _id(lane: Lane | None) -> str:
    return "0" if lane is None else lane.id
