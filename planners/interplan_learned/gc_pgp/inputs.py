"""Inputs: what of a sample GC-PGP keeps, and what its network is given, from arrays of the schema and a map's nodes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_learned.gc_pgp.local_graph import NONE, MapNodes, local_graph, off_and_turned, start_nodes
from interplan_learned.gc_pgp.sizes import PAST, PAST_STEP_S, Dimensions
from interplan_sumo.features.frame import EgoFrame
from interplan_sumo.features.schema import channel_index
from interplan_sumo.features.view import Arrays
from interplan_sumo.world.geometry import Floats, wrap_angle

FIELDS: Final = (
    "origin", "ego_history", "ego_history_valid", "agents", "lanes", "lanes_valid", "lane_ids",
    "stop_lines", "stop_lines_valid", "crosswalks", "crosswalks_valid",
)  # fmt: skip
POLICY_INPUTS: Final = (
    "ego", "agents", "agents_valid", "nodes", "nodes_valid", "near_agents", "adjacent", "edges", "edge_kinds",
)  # fmt: skip
"""What the graph `policy` is given, in order."""
NEAR_M: Final = 10.0
"""Agents so close to a node may attend to it (PGP's)."""
_GRAPH: Final = (
    "node_origin", "node_poses", "node_marks", "node_red", "node_on_route", "node_valid", "edges", "edge_kinds",
)  # fmt: skip
_RED, _ON_ROUTE = channel_index("lanes", "light_red"), channel_index("lanes", "on_route")
_PEDESTRIAN, _VALID = channel_index("agents", "is_pedestrian"), channel_index("agents", "valid")
_FAR_M = 1e3


def kept(arrays: Arrays, nodes: Sequence[MapNodes], size: Dimensions) -> Arrays:
    """What `inputs` needs of samples (their arrays, and for each its map's nodes), with the lane graph around the ego.

    Of M = `size.nodes` rows and P = `size.points`: `node_origin` (S, 3) the map
    pose of the frame that `node_poses` (S, M, P, 3) are in, `node_marks`
    (S, M, P, 2) whether there is a stop line, a crosswalk, `node_red` (S, M) its
    light, `node_on_route` (S, M), `node_valid` (S, M), `edges` (S, M, EDGES) rows
    that edges lead to, NONE where there is none, and `edge_kinds`; and
    `node_rows` (S, M) rows of the map's nodes. `agents` keeps fewer rows and frames.
    """
    graphs = [_around(arrays, row, each, size) for row, each in enumerate(nodes)]
    return {
        **{name: arrays[name] for name in ("origin", "ego_history", "ego_history_valid")},
        "agents": arrays["agents"][:, : size.agents, PAST],
        **{name: np.stack([graph[name] for graph in graphs]) for name in (*_GRAPH, "node_rows")},
    }


def inputs(held: Arrays) -> Arrays:
    """What the network and the traversals are given, from `kept`; B samples, A agents, M nodes, P points.

    `ego` (B, 6, 5) x, y, speed, acceleration, yaw rate over the past second;
    `agents` (B, A, 6, 6) the same and whether it is a pedestrian, `agents_valid`
    (B, A); `nodes` (B, M, P, 6) x, y, yaw, stop line, crosswalk, red light,
    `nodes_valid` (B, M); `near_agents` (B, M, A) who may attend to a node;
    `adjacent` (B, M, M) nodes that share an edge, and each with itself; `edges`
    (B, M, EDGES) and `edge_kinds`; `allowed` (B, M, EDGES) edges that stay on
    the route; `starts` (B, M) and `allowed_starts`, those on the route if there
    are any. All in the ego frame.
    """
    poses, valid = _in_ego_frame(held), held["node_valid"]
    agents_valid = held["agents"][:, :, -1, _VALID] > 0.5
    off_m, turned_rad = off_and_turned(poses)
    starts = start_nodes(np.where(valid, off_m, np.inf), turned_rad)
    on_route = starts & held["node_on_route"]
    edges = held["edges"].astype(np.int64)
    red = np.broadcast_to(held["node_red"][..., None, None], (*poses.shape[:3], 1))
    features = np.concatenate((poses, held["node_marks"], red), axis=-1) * valid[..., None, None]
    features = features.astype(np.float32)
    return {
        "ego": _ego(held["ego_history"], held["ego_history_valid"]),
        "agents": _agents(held["agents"]),
        "agents_valid": agents_valid,
        "nodes": features,
        "nodes_valid": valid,
        "near_agents": _near(features, held["agents"][:, :, -1]) & valid[..., None] & agents_valid[:, None],
        "adjacent": _adjacent(edges),
        "edges": edges,
        "edge_kinds": held["edge_kinds"].astype(np.int64),
        "allowed": _on_route(edges, held["node_on_route"]),
        "starts": starts,
        "allowed_starts": np.where(on_route.any(axis=1, keepdims=True), on_route, starts),
    }


# --- kept ----------------------------------------------------------------------------------------


def _around(arrays: Arrays, row: int, nodes: MapNodes, size: Dimensions) -> Arrays:
    """The lane graph around the ego of one sample."""
    origin = arrays["origin"][row]
    lanes, known = arrays["lanes"][row, :, 0], arrays["lanes_valid"][row]
    ids = arrays["lane_ids"][row]
    route_ids, red_ids = (ids[known & (lanes[:, channel] > 0.5)] for channel in (_ON_ROUTE, _RED))
    frame = EgoFrame(*origin.tolist())
    graph = local_graph(nodes, frame, ids[known], route_ids, size.nodes)
    poses, lane_ids = frame.poses(nodes.poses[graph.rows]), nodes.lane_ids[graph.rows]
    return {
        "node_origin": origin,
        "node_poses": _filled(poses.astype(np.float32), size.nodes),
        "node_marks": _filled(_marks(arrays, row, poses), size.nodes),
        "node_red": _filled(np.isin(lane_ids, red_ids), size.nodes),
        "node_on_route": _filled(np.isin(lane_ids, route_ids), size.nodes),
        "node_valid": np.arange(size.nodes) < len(graph.rows),
        "edges": _filled(graph.targets.astype(np.int16), size.nodes, NONE),
        "edge_kinds": _filled(graph.kinds, size.nodes),
        "node_rows": _filled(graph.rows.astype(np.int32), size.nodes, NONE),
    }


def _marks(arrays: Arrays, row: int, poses: Floats) -> NDArray[np.bool_]:
    """(M, P, 2) whether a stop line and a crosswalk lie within half a point's spacing."""
    if not len(poses):
        return np.zeros((0, poses.shape[1], 2), dtype=np.bool_)
    points = np.asarray(shapely.points(poses[..., :2].reshape(-1, 2)))
    reach_m = np.hypot(*(poses[:, 1, :2] - poses[:, 0, :2]).T) / 2.0
    marks = np.zeros((*poses.shape[:2], 2), dtype=np.bool_)
    for k, name in enumerate(("stop_lines", "crosswalks")):
        areas = shapely.polygons(arrays[name][row][arrays[f"{name}_valid"][row]].astype(np.float64))
        reach = np.repeat(reach_m, poses.shape[1])
        found, _ = shapely.STRtree(areas).query(points, predicate="dwithin", distance=reach)
        marks.reshape(-1, 2)[found, k] = True
    return marks


def _filled(values: NDArray[Any], count: int, empty: int = 0) -> NDArray[Any]:
    table = np.full((count, *values.shape[1:]), empty, dtype=values.dtype)
    table[: len(values)] = values
    return table


# --- inputs --------------------------------------------------------------------------------------


def _in_ego_frame(held: Arrays) -> Floats:
    """(B, M, P, 3) node poses in the frame of `origin`, which is another than theirs where the start was perturbed."""
    there, here = held["node_origin"], held["origin"]
    poses = held["node_poses"].astype(np.float64)
    moved = there - here
    c, s = np.cos(here[:, 2]), np.sin(here[:, 2])
    shift_x, shift_y = c * moved[:, 0] + s * moved[:, 1], c * moved[:, 1] - s * moved[:, 0]
    turn = moved[:, 2, None, None]
    c, s = np.cos(turn), np.sin(turn)
    x, y = poses[..., 0], poses[..., 1]
    yaw = np.where(turn == 0.0, poses[..., 2], wrap_angle(poses[..., 2] + turn))
    return np.stack((c * x - s * y + shift_x[:, None, None], s * x + c * y + shift_y[:, None, None], yaw), axis=-1)


def _ego(history: NDArray[Any], valid: NDArray[np.bool_]) -> NDArray[np.float32]:
    """(B, 6, 5); rows that are not known are 0."""
    seen = history[:, PAST].astype(np.float64)
    c, s = np.cos(seen[..., 2]), np.sin(seen[..., 2])
    forward = [c * seen[..., k] + s * seen[..., k + 1] for k in (3, 5)]
    table = np.stack((seen[..., 0], seen[..., 1], *forward, seen[..., 7]), axis=-1)
    return (table * valid[:, PAST, None]).astype(np.float32)


def _agents(agents: NDArray[Any]) -> NDArray[np.float32]:
    """(B, A, 6, 6); the acceleration is the change of speed since the row before, 0 where that is not known."""
    seen = agents.astype(np.float64)
    speed, valid = np.hypot(seen[..., 3], seen[..., 4]), seen[..., _VALID] > 0.5
    gained = np.zeros_like(speed)
    gained[..., 1:] = np.diff(speed, axis=-1) / PAST_STEP_S * (valid[..., 1:] & valid[..., :-1])
    columns = (seen[..., 0], seen[..., 1], speed, gained, seen[..., 5], seen[..., _PEDESTRIAN])
    return (np.stack(columns, axis=-1) * valid[..., None]).astype(np.float32)


def _near(nodes: NDArray[np.float32], agents: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(B, M, A) whether agents (B, A, C) are close to a point of nodes (B, M, P, C)."""
    x, y = (nodes[:, :, None, :, k] - agents[:, None, :, None, k] for k in (0, 1))
    return (x * x + y * y).min(axis=-1) <= NEAR_M**2


def _adjacent(edges: NDArray[np.int64]) -> NDArray[np.bool_]:
    count = edges.shape[1]
    held = np.zeros((len(edges), count, count + 1), dtype=np.bool_)
    np.put_along_axis(held, edges, True, axis=-1)  # NONE falls into the last column
    held = held[..., :count]
    return held | held.transpose(0, 2, 1) | np.eye(count, dtype=np.bool_)


def _on_route(edges: NDArray[np.int64], on_route: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(B, M, EDGES) whether an edge leads to a node on the route."""
    rows = np.arange(len(edges))[:, None, None]
    return on_route[rows, edges] & (edges != NONE)
