"""Labels: what came after each step: the futures of the ego and of others, and the way through the lane graph."""

from __future__ import annotations

from functools import lru_cache
from math import pi
from typing import Final

import numpy as np
import shapely

from interplan_sumo.features.frame import EgoFrame
from interplan_sumo.features.lane_graph import lane_graph, node_lines
from interplan_sumo.features.schema import AGENTS, FUTURE_FRAMES
from interplan_sumo.world.geometry import Floats, Ints, wrap_angle
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import Trace

NODE_WITHIN_M: Final = 2.0
NODE_WITHIN_RAD: Final = pi / 8
"""How far from a node's centre line, and turned from it, somebody on it may be (PGP's)."""
_EDGE_COST, _JUMP_COST = 1.0, 100.0
"""Of going to another node with and without an edge; each frame costs the metres off its node and radians turned."""


class Futures:
    """The futures in one drive."""

    def __init__(self, trace: Trace) -> None:
        x_m, y_m = trace.ego.rear_axle(trace.shape)
        self._ego = np.stack((x_m, y_m, trace.ego.heading_rad), axis=1)
        actors = trace.actors
        self._poses = np.stack((actors.x_m, actors.y_m, actors.heading_rad), axis=1)
        self._rows = [
            dict(
                zip(actors.ids[actors.rows(k)].tolist(), range(actors.rows(k).start, actors.rows(k).stop), strict=True)
            )
            for k in range(len(trace))
        ]

    def ego(self, frame: int, view: EgoFrame) -> Floats:
        """(80, 4) `ego_future` after a frame."""
        poses = self._ego[frame + 1 : frame + 1 + FUTURE_FRAMES]
        return _future(poses, np.arange(len(poses)), view)

    def agents(self, frame: int, ids: tuple[str, ...], view: EgoFrame) -> Floats:
        """(30, 80, 4) `agent_futures` of the agents with these ids, whether the ego sees them then or not."""
        table = np.zeros((AGENTS, FUTURE_FRAMES, 4))
        ahead = self._rows[frame + 1 : frame + 1 + FUTURE_FRAMES]
        for row, agent in enumerate(ids):
            places = [(step, at[agent]) for step, at in enumerate(ahead) if agent in at]
            if places:
                steps, rows = np.array(places).T
                table[row] = _future(self._poses[rows], steps, view)
        return table


def _future(poses: Floats, steps: Ints, view: EgoFrame) -> Floats:
    """(80, 4) poses (K, 3) of the map frame at steps (K,), 0 elsewhere."""
    table = np.zeros((FUTURE_FRAMES, 4))
    table[steps, :3] = view.poses(poses)
    table[steps, 3] = 1.0
    return table


class GraphWay:
    """The way of a whole drive through the lane graph: the chain of nodes that fits it best and jumps least."""

    def __init__(self, roads: Roads, trace: Trace) -> None:
        x_m, y_m = trace.ego.rear_axle(trace.shape)
        nodes = _nodes(roads)
        self._edges = nodes.edges
        self.nodes = _best_chain(nodes.at(x_m, y_m, trace.ego.heading_rad), nodes.edges)
        """(F,) node under the rear axle in each frame, -1 where there is none."""

    def at(self, frame: int) -> tuple[Ints, Ints]:
        """`expert_nodes` (81,) and `expert_edges` (any,) from a frame on."""
        nodes = np.full(FUTURE_FRAMES + 1, -1)
        ahead = self.nodes[frame : frame + FUTURE_FRAMES + 1]
        nodes[: len(ahead)] = ahead
        known = ahead[ahead >= 0]
        pairs = zip(known[:-1].tolist(), known[1:].tolist(), strict=True)
        edges = [self._edges[pair] for pair in pairs if pair in self._edges]
        return nodes, np.array(edges, dtype=np.int64)


class _Nodes:
    """The nodes of a map as lines to look things up on."""

    def __init__(self, roads: Roads) -> None:
        graph = lane_graph(roads)
        self.edges = {(one, other): number for number, (one, other) in enumerate(graph.edges.tolist())}
        """Number of the edge between two nodes."""
        self._lines = node_lines(roads, graph)
        self._tree = shapely.STRtree([line.linestring for line in self._lines])

    def at(self, x_m: Floats, y_m: Floats, heading_rad: Floats) -> list[dict[int, float]]:
        """For each of (F,) poses the nodes that hold it, with metres off their lines plus radians turned."""
        frames, nodes = self._tree.query(shapely.points(x_m, y_m), predicate="dwithin", distance=NODE_WITHIN_M)
        found: list[dict[int, float]] = [{} for _ in x_m]
        for frame, node in sorted(zip(frames.tolist(), nodes.tolist(), strict=True)):
            arc_m, left_m = self._lines[node].project_point(x_m[frame], y_m[frame])
            turned = abs(float(wrap_angle(self._lines[node].pose_at(arc_m).heading_rad - heading_rad[frame])))
            if turned <= NODE_WITHIN_RAD:
                found[frame][node] = abs(left_m) + turned
        return found


@lru_cache(maxsize=8)
def _nodes(roads: Roads) -> _Nodes:
    return _Nodes(roads)


def _best_chain(candidates: list[dict[int, float]], edges: dict[tuple[int, int], int]) -> Ints:
    """(F,) a node per frame, -1 without candidates, by dynamic programming; ties go to the lower node."""
    chain = np.full(len(candidates), -1)
    costs: dict[int, float] = {}
    came_from: list[dict[int, int]] = []
    for here in candidates:
        links: dict[int, int] = {}
        reached: dict[int, float] = {}
        for node, off in here.items():
            through = {one: cost + _step_cost(one, node, edges) for one, cost in costs.items()}
            links[node] = min(through, key=lambda one, through=through: (through[one], one), default=-1)
            reached[node] = off + through.get(links[node], 0.0)
        came_from.append(links)
        costs = reached or costs
    node = min(costs, key=lambda one: (costs[one], one), default=-1)
    for frame in range(len(candidates) - 1, -1, -1):
        if came_from[frame]:
            chain[frame] = node
            node = came_from[frame][node]
    return chain


def _step_cost(one: int, other: int, edges: dict[tuple[int, int], int]) -> float:
    return 0.0 if one == other else _EDGE_COST if (one, other) in edges else _JUMP_COST
