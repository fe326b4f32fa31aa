"""Local demand: how dense the traffic of a scenario is meant to be on each road, and which lanes it may use.

On the ego's own way and where the lanes that the scenario fills go on, it is
the scenario's density; on the lanes beside them of the opposite direction, the
scenario's oncoming density; on all others it is sparse: the scenario says nothing
of them, and side streets carry less than the road that one drives on. Where a
density is none, nobody drives, and no route leads there.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate

import numpy as np
import shapely

from interplan_sumo.scenario.scenario import LARGEST_GAP_M, SMALLEST_GAP_M, TrafficDemand
from interplan_sumo.simulation.network import SumoNetwork

STRAIGHT_ON = 3.0
"""So many times more vehicles go straight on than turn into a road of equal density."""
OPPOSITE_M = 25.0
"""Lanes of opposite heading within this distance to the side belong to the same road."""
POINTS_M = 10.0
"""Lanes are compared at points this far apart."""
LEAST_ROAD_M = 0.01
"""Shorter edges are the cuts between the parts of a lane."""


@dataclass(frozen=True, slots=True)
class LocalDemand:
    """How dense the traffic is meant to be, edge by edge."""

    largest_gap_m: Mapping[str, float]
    """Of the edges on which traffic is wanted."""
    on_own_road: frozenset[str]
    """Those of them for which the scenario itself gives the density."""
    lanes: frozenset[str]
    """Normal lanes that agents may use: from each one can go on for good, or to where the map ends."""

    def mean_gap_m(self, edge: str) -> float:
        """From centre to centre; where no traffic is wanted, as where it is sparse."""
        return (SMALLEST_GAP_M + self.largest_gap_m.get(edge, LARGEST_GAP_M["sparse"])) / 2.0


def local_demand(
    network: SumoNetwork, demand: TrafficDemand, own: Collection[str], oncoming: Collection[str]
) -> LocalDemand:
    """The demand on all edges; `own` are those of the ego's way and road, `oncoming` opposite ones known beforehand."""
    mine = frozenset(own)
    against = frozenset((*oncoming, *(each for edge in own for each in opposite_edges(network).get(edge, ())))) - mine
    gaps: dict[str, float] = {}
    for edge in network.edges:
        density = demand.density if edge in mine else demand.oncoming if edge in against else "sparse"
        if density != "none":
            gaps[edge] = LARGEST_GAP_M[density]
    return LocalDemand(gaps, (mine | against) & gaps.keys(), _lasting(network, gaps))


def _lasting(network: SumoNetwork, edges: Iterable[str]) -> frozenset[str]:
    """The lanes of some edges that do not only lead to where these edges, but not the map, end."""
    lanes = {lane for edge in edges for lane in network.edges[edge]}
    while True:
        stuck = {
            lane for lane in lanes if network.links[lane] and not any(w.to_lane in lanes for w in network.links[lane])
        }
        if not stuck:
            return frozenset(lanes)
        lanes -= stuck


@lru_cache(maxsize=16)
def opposite_edges(network: SumoNetwork) -> Mapping[str, frozenset[str]]:
    """For each edge those that run beside it in the opposite direction for at least half of its length."""
    edges = [edge for edge, lanes in network.edges.items() if network.lanes[lanes[0]].line.length_m >= LEAST_ROAD_M]
    lines = [network.lanes[network.edges[edge][-1]].line.resampled(POINTS_M) for edge in edges]
    owner = np.repeat(np.arange(len(edges)), [len(line.points) for line in lines])
    points = np.concatenate([line.points for line in lines])
    heading = np.concatenate([line.poses_at(line.arc_m)[:, 2] for line in lines])
    places = [shapely.Point(*point) for point in points.tolist()]
    here, there = shapely.STRtree(places).query(places, predicate="dwithin", distance=OPPOSITE_M)
    forward = np.stack((np.cos(heading), np.sin(heading)), axis=1)
    along = np.abs(((points[there] - points[here]) * forward[here]).sum(axis=1))
    facing = (np.cos(heading[there] - heading[here]) < np.cos(np.radians(150.0))) & (along <= POINTS_M)
    pairs = np.unique(np.stack((here[facing], owner[there[facing]])), axis=1)
    counts: dict[tuple[int, int], int] = {}
    for point, other in pairs.T.tolist():
        key = (int(owner[point]), other)
        counts[key] = counts.get(key, 0) + 1
    found: dict[str, set[str]] = {}
    for (edge, other), count in counts.items():
        if 2 * count >= min(len(lines[edge].points), len(lines[other].points)):
            found.setdefault(edges[edge], set()).add(edges[other])
    return {edge: frozenset(others) for edge, others in found.items()}


def agent_route(
    network: SumoNetwork, demand: LocalDemand, lane: str, length_m: float, rng: np.random.Generator
) -> tuple[str, ...]:
    """SUMO edges that an agent drives from a normal lane on, without changing lane; at junctions it may turn.

    At least `length_m` long but where the map ends. Chances are as the
    densities of the roads, so that those that turn off a road are replaced by
    those that turn into it. No edge is driven on twice where it can be helped.
    Who is placed where no traffic is wanted drives on all the same.
    """
    here = network.lanes[lane]
    route, driven_m = [here.edge], here.length_m
    while driven_m < length_m:
        ways = [way for way in network.links[here.id] if way.to_lane in demand.lanes or here.id not in demand.lanes]
        if not ways:
            break
        fresh = [way for way in ways if network.lanes[way.to_lane].edge not in route] or ways
        if len(fresh) > 1:
            shares = [
                (STRAIGHT_ON if way.direction == "s" else 1.0) / demand.mean_gap_m(network.lanes[way.to_lane].edge)
                for way in fresh
            ]
            at = rng.random() * sum(shares)
            fresh = [way for way, upto in zip(fresh, accumulate(shares), strict=True) if at < upto] or fresh[-1:]
        here = network.lanes[fresh[0].to_lane]
        driven_m += here.length_m
        route.append(here.edge)
    return tuple(route)
