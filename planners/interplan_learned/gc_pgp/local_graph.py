"""Local graph: the nodes of a map's lane graph around an ego, where its traversals may lead."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from math import pi
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from interplan_learned.gc_pgp.sizes import EDGES, PATH_NODES
from interplan_sumo.features.frame import EgoFrame
from interplan_sumo.features.lane_graph import SUCCESSOR, lane_graph
from interplan_sumo.world.geometry import Floats, Ints, Polyline, wrap_angle
from interplan_sumo.world.roads import Roads

AHEAD_M: Final = (-20.0, 80.0)
LEFT_M: Final = (-50.0, 50.0)
"""The window in the ego frame (PGP's)."""
START_M: Final = 3.0
START_RAD: Final = pi / 4
"""A traversal starts on a node so close to the ego and turned so little from it (PGP's)."""
NONE: Final = -1
_FAR = 1 << 16


@dataclass(frozen=True, slots=True, eq=False)
class MapNodes:
    """All N nodes of a map, in the map frame, each with its edges."""

    poses: Floats
    """(N, P, 3) x, y, heading, equally spaced from the node's beginning to its end."""
    lane_ids: Ints
    """(N,)"""
    targets: Ints
    """(N, EDGES) nodes that edges lead to: successors first, then proximal ones by distance; NONE beyond the last."""
    kinds: NDArray[np.int8]
    """(N, EDGES) 0 successor, 1 proximal; 0 beyond the last."""


@dataclass(frozen=True, slots=True, eq=False)
class LocalGraph:
    """The nodes around one ego; at most `count` rows."""

    rows: Ints
    """(M,) of `MapNodes`; first those on the route that can be reached, then others that can, then the rest."""
    targets: Ints
    """(M, EDGES) places in `rows`, NONE where there is no edge, or none to a node in here."""
    kinds: NDArray[np.int8]
    """(M, EDGES)"""


def map_nodes(tables: Mapping[str, NDArray[Any]], points: int) -> MapNodes:
    """The nodes of a map from `LaneGraph.tables()`, as a dataset holds them too."""
    starts, lines = tables["point_starts"].tolist(), tables["points"]
    lane_rows = {lane: row for row, lane in enumerate(tables["lane_ids"].tolist())}
    poses = np.zeros((len(tables["node_poses"]), points, 3))
    polylines: dict[int, Polyline] = {}
    for node, (lane, (start_m, end_m)) in enumerate(
        zip(tables["node_lane_ids"].tolist(), tables["node_stretches_m"].tolist(), strict=True)
    ):
        if lane not in polylines:
            row = lane_rows[lane]
            polylines[lane] = Polyline(lines[starts[row] : starts[row + 1]])
        poses[node] = polylines[lane].poses_at(np.linspace(start_m, end_m, points))
    targets, kinds = _edges_by_node(tables)
    return MapNodes(poses, tables["node_lane_ids"], targets, kinds)


@lru_cache(maxsize=8)
def nodes_of(roads: Roads, points: int) -> MapNodes:
    """The nodes of a map, from a small cache."""
    return map_nodes(lane_graph(roads).tables(), points)


def local_graph(nodes: MapNodes, frame: EgoFrame, lane_ids: Ints, route_lane_ids: Ints, count: int) -> LocalGraph:
    """The nodes in the window on the lanes `lane_ids`, the ones that matter most if there are more than `count`.

    `route_lane_ids` are those of the lanes that belong to the route. Ties go by node.
    """
    rows = np.flatnonzero(np.isin(nodes.lane_ids, lane_ids))
    poses = frame.poses(nodes.poses[rows])
    inside = _between(poses[..., 0], AHEAD_M) & _between(poses[..., 1], LEFT_M)
    kept = inside.any(axis=1)
    rows, poses = rows[kept], poses[kept]
    off_m, turned_rad = off_and_turned(poses)
    targets = _renumbered(nodes.targets[rows], rows, len(nodes.lane_ids))
    hops = _hops(targets, start_nodes(off_m, turned_rad))
    off_route = ~np.isin(nodes.lane_ids[rows], route_lane_ids)
    unreached = hops == _FAR
    best = np.lexsort((rows, np.rint(off_m * 1e3), hops, off_route & ~unreached, unreached))[:count]
    return LocalGraph(rows[best], _renumbered(targets[best], best, len(rows)), nodes.kinds[rows[best]])


def off_and_turned(poses: NDArray[Any]) -> tuple[Floats, Floats]:
    """(...,) metres from the ego to nodes, and radians that they are turned against it there; poses (..., P, 3)."""
    here, step = poses[..., :-1, :2].astype(np.float64), np.diff(poses[..., :2].astype(np.float64), axis=-2)
    length = np.maximum((step**2).sum(axis=-1), 1e-9)
    along = np.clip(-(here * step).sum(axis=-1) / length, 0.0, 1.0)
    off_m = np.hypot(*np.moveaxis(here + along[..., None] * step, -1, 0))
    nearest = off_m.argmin(axis=-1)[..., None]
    yaw = np.take_along_axis(poses[..., 2], nearest + (np.take_along_axis(along, nearest, -1) > 0.5), -1)
    return np.take_along_axis(off_m, nearest, -1)[..., 0], np.abs(wrap_angle(yaw.astype(np.float64)))[..., 0]


def start_nodes(off_m: Floats, turned_rad: Floats) -> NDArray[np.bool_]:
    """(..., M) nodes on which a traversal may start; where none is close enough, the nearest one.

    `off_m` is infinite for rows without a node; without any node there is no start.
    """
    close = (off_m <= START_M) & (turned_rad <= START_RAD)
    if not off_m.shape[-1]:
        return close
    nearest = np.arange(off_m.shape[-1]) == off_m.argmin(axis=-1)[..., None]
    return np.where(close.any(axis=-1, keepdims=True), close, nearest & np.isfinite(off_m))


def _edges_by_node(tables: Mapping[str, NDArray[Any]]) -> tuple[Ints, NDArray[np.int8]]:
    edges, kinds, middles = tables["edges"], tables["edge_kinds"], tables["node_poses"]
    apart = middles[edges[:, 0], :2] - middles[edges[:, 1], :2]
    far_m = np.where(kinds == SUCCESSOR, 0.0, np.hypot(apart[:, 0], apart[:, 1]))
    order = np.lexsort((edges[:, 1], np.rint(far_m * 1e3), kinds, edges[:, 0]))
    edges, kinds = edges[order], kinds[order]
    first = np.searchsorted(edges[:, 0], np.arange(len(middles)))
    place = np.arange(len(edges)) - first[edges[:, 0]]
    kept = place < EDGES
    targets = np.full((len(middles), EDGES), NONE, dtype=np.int64)
    held = np.zeros((len(middles), EDGES), dtype=np.int8)
    targets[edges[kept, 0], place[kept]] = edges[kept, 1]
    held[edges[kept, 0], place[kept]] = kinds[kept]
    return targets, held


def _renumbered(targets: Ints, rows: Ints, count: int) -> Ints:
    """Targets among `count` nodes as places in `rows`; NONE where they are not among them."""
    place = np.full(count + 1, NONE, dtype=np.int64)  # the last one is where NONE points to
    place[rows] = np.arange(len(rows))
    return place[targets]


def _hops(targets: Ints, starts: NDArray[np.bool_]) -> Ints:
    """(M,) edges that lead from a start to each node, `_FAR` where none do."""
    hops = np.where(starts, 0, _FAR)
    front = np.flatnonzero(starts)
    for hop in range(1, PATH_NODES):
        ahead = np.unique(targets[front])
        front = ahead[(ahead != NONE) & (hops[ahead] == _FAR)]
        hops[front] = hop
    return hops


def _between(values: Floats, ends: tuple[float, float]) -> NDArray[np.bool_]:
    return (values >= ends[0]) & (values <= ends[1])
