"""Staged merges: an ego slides from beside a follower's lane into it; when does the follower react, and how hard?"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import Literal

import numpy as np
import shapely

from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.store import find_map, load_roads
from interplan_sumo.simulation.lane_chains import continued_route
from interplan_sumo.simulation.network import SumoNetwork, read_network
from interplan_sumo.simulation.spawning import Spawn
from interplan_sumo.simulation.sumo import DT_S
from interplan_sumo.simulation.sumo_traffic import SumoTraffic, TrafficSetup
from interplan_sumo.simulation.traffic import EgoPresence
from interplan_sumo.simulation.vehicle_types import VehicleTypes
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.geometry import Floats, Polyline
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.signals import SignalStatus

SiteKind = Literal["straight", "curved", "connector"]
REACTION_MPS2 = 0.1
"""A reaction is an acceleration this much below that of the identical run without an ego."""
LEAST_LIMIT_MPS = 11.0
"""Sites are on roads on which the follower may drive as fast as it is meant to."""
BEGIN_S = 1.0
AFTER_S = 2.0
"""How long a merge is watched after its end."""


@dataclass(frozen=True)
class Site:
    """A chain of lanes and connectors to merge into."""

    map: str
    kind: SiteKind
    lanes: tuple[str, ...]
    middle_m: float
    """Where along the chain the ego is half way across."""


@dataclass(frozen=True)
class Merge:
    """One merge. The gap is from bumper to bumper when the ego begins to slide."""

    site: Site
    gap_m: float
    duration_s: float = 6.0
    ego_mps: float = 8.0
    follower_mps: float = 10.0
    from_left: bool = False
    chance_seed: int = 0
    """For what the follower decides by chance."""


@dataclass(frozen=True)
class Outcome:
    """What the follower did. None: it never reacted."""

    reaction_s: float | None
    """Since the ego began to slide."""
    overlap: float | None
    """Share of the ego's box in the follower's lane when it reacted."""
    hardest_mps2: float
    """Hardest braking, positive."""
    least_gap_m: float
    """Smallest gap while any of the ego is in the follower's lane and ahead of it."""
    stays_behind: bool


@cache
def sites(name: str, kind: SiteKind, length_m: float = 150.0) -> list[Site]:
    """Where merges of a kind can be staged on a map, in the map's order."""
    roads = load_roads(name)
    found: list[Site] = []
    for lane in roads.lanes:
        chain = _chain(roads, lane, length_m)
        line = _line(roads, chain)
        slowest_mps = min(roads[each].speed_limit_mps or 0.0 for each in chain)
        if line.length_m < length_m or slowest_mps < LEAST_LIMIT_MPS:
            continue
        first_m = roads[lane].centerline.length_m
        if kind == "connector":
            across_m = roads[chain[1]].centerline.length_m if len(chain) > 1 else 0.0
            middle_m = first_m + across_m / 2.0
            fits = across_m > 10.0 and 80.0 < middle_m < line.length_m - 60.0
        else:
            middle_m = 80.0
            bend = np.ptp(np.unwrap(line.poses_at(np.arange(50.0, 110.0, 2.0))[:, 2]))
            fits = first_m >= 125.0 and (bend < 0.03 if kind == "straight" else bend > 0.15)
        if fits:
            found.append(Site(name, kind, tuple(chain), middle_m))
    return found


def _chain(roads: Roads, lane: str, length_m: float) -> list[str]:
    """The lane and its straightest successors."""
    chain, driven_m = [lane], roads[lane].centerline.length_m
    while driven_m < length_m and roads.outgoing(chain[-1]):
        ways = roads.outgoing(chain[-1])
        bends = [abs(float(np.ptp(np.unwrap(roads[way].centerline.vertex_heading_rad)))) for way in ways]
        connector = ways[int(np.argmin(bends))]
        chain += [connector, *roads.outgoing(connector)]
        driven_m += sum(roads[each].centerline.length_m for each in chain[-2:])
    return chain


def _line(roads: Roads, chain: list[str] | tuple[str, ...]) -> Polyline:
    line = roads[chain[0]].centerline
    for each in chain[1:]:
        line = line.joined(roads[each].centerline)
    return line


def egos(merge: Merge, line: Polyline, width_m: float) -> list[EgoState]:
    """The ego at each step: beside the line by a lane's width, then across in a smooth step, then on the line."""
    steps = round((BEGIN_S + merge.duration_s + AFTER_S) / DT_S)
    side = width_m if merge.from_left else -width_m
    start_m = merge.site.middle_m - merge.ego_mps * (BEGIN_S + merge.duration_s / 2.0)
    times = DT_S * np.arange(-1, steps + 2)
    done = np.clip((times - BEGIN_S) / merge.duration_s, 0.0, 1.0)
    offsets = side * (1.0 - done * done * (3.0 - 2.0 * done))
    poses = [line.pose_at(start_m + merge.ego_mps * t, float(left)) for t, left in zip(times, offsets, strict=True)]
    states: list[EgoState] = []
    for t, before, after in zip(times[1:], poses, poses[1:], strict=False):
        dx, dy = after.x_m - before.x_m, after.y_m - before.y_m
        speed = float(np.hypot(dx, dy)) / DT_S
        states.append(EgoState(float(t), after.x_m, after.y_m, float(np.arctan2(dy, dx)), vx_mps=speed))
    return states


def measured(merge: Merge, types: VehicleTypes, blind: Floats | None = None) -> tuple[Outcome, Floats]:
    """The follower's outcome, and its speeds in the twin run without an ego, which may be handed in again."""
    roads = load_roads(merge.site.map)
    files = find_map(merge.site.map)
    network, ids = read_network(files.network), NetworkIds.read(files.ids)
    line = _line(roads, merge.site.lanes)
    first, at_m = ids.pieces[merge.site.lanes[0]][0].sumo_lane, merge.site.middle_m
    width_m = network.lanes[first].width_m
    driven = egos(merge, line, width_m)
    rear_m = at_m - merge.ego_mps * merge.duration_s / 2.0 - PACIFICA.length_m / 2.0
    front_m = rear_m - merge.gap_m - BEGIN_S * (merge.follower_mps)
    lane, fraction = ids.sumo_place(merge.site.lanes[0], front_m)
    place_m = fraction * network.lanes[lane].length_m
    driver = types.members[0]
    route = _edges(network, ids, merge.site.lanes)
    setup = TrafficSetup(
        network, ids, types, driven[0], route, spawns=(Spawn(lane, place_m, merge.follower_mps, driver, route),),
        tokens=("a",), presence=EgoPresence.ABSENT, chance_seed=merge.chance_seed,
    )  # fmt: skip
    if blind is None:
        blind, _, _ = _run(setup, driven)
    speeds, fronts, length_m = _run(replace(setup, presence=EgoPresence.DRIVES), driven)
    driven_on = {piece.sumo_lane for each in merge.site.lanes for piece in ids.pieces[each]}
    corridor = shapely.union_all([piece.polygon for each in driven_on for piece in network.lanes[each].pieces])
    boxes = [shapely.Polygon(ego.corners(PACIFICA) - ids.origin_m) for ego in driven[: len(speeds)]]
    overlaps = shapely.area(shapely.intersection(boxes, corridor)) / (PACIFICA.length_m * PACIFICA.width_m)
    both = min(len(blind), len(speeds))  # one of them may reach the end of its route
    slower = (np.diff(blind[:both]) - np.diff(speeds[:both])) / DT_S
    reacting = np.flatnonzero(slower >= REACTION_MPS2)
    reacted = int(reacting[0]) if len(reacting) else None
    ego_m = np.array([line.project_point(e.x_m, e.y_m)[0] for e in driven[: len(speeds)]])
    agent_m = np.array([line.project_point(x, y)[0] for x, y in fronts])
    gaps = ego_m - PACIFICA.length_m / 2.0 - agent_m
    behind = agent_m - length_m / 2.0 < ego_m
    relevant = gaps[(overlaps > 0.0) & behind]
    return Outcome(
        None if reacted is None else DT_S * reacted - BEGIN_S,
        None if reacted is None else float(overlaps[reacted]),
        float(-np.diff(speeds).min() / DT_S),
        float(relevant.min()) if len(relevant) else float("inf"),
        bool(gaps[-1] > 0.0),
    ), blind


def _edges(network: SumoNetwork, ids: NetworkIds, lanes: tuple[str, ...]) -> tuple[str, ...]:
    named = [network.lanes[piece.sumo_lane] for lane in lanes for piece in ids.pieces[lane]]
    edges = [lane.edge for lane in named if not lane.internal]
    edges = edges[:1] + [there for here, there in pairwise(edges) if there != here]
    last = [lane.id for lane in named if not lane.internal][-1]
    return (*edges, *(edge for edge in continued_route(network, last, 300.0)[1:] if edge not in edges))


def _run(setup: TrafficSetup, driven: list[EgoState]) -> tuple[Floats, list[tuple[float, float]], float]:
    """Speeds and front bumpers of the only agent at each step, and its length. All lights are green."""
    speeds: list[float] = []
    fronts: list[tuple[float, float]] = []
    with SumoTraffic(setup) as traffic:
        traffic.impose_signals(dict.fromkeys(setup.ids.links, SignalStatus.GREEN))
        for now, then in pairwise(driven):
            actors = traffic.observe().actors
            if not len(actors):
                break
            speeds.append(float(actors.speed_mps[0]))
            half_m = float(actors.length_m[0]) / 2.0
            heading = float(actors.heading_rad[0])
            fronts.append(
                (float(actors.x_m[0]) + half_m * np.cos(heading), float(actors.y_m[0]) + half_m * np.sin(heading))
            )
            traffic.react(now)
            traffic.place_ego(then)
            traffic.advance()
    return np.array(speeds), fronts, setup.spawns[0].driver.length_m
