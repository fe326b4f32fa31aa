"""Ways through the network: chains of lanes that are filled, routes, and the lanes that an agent has ahead of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise, takewhile

from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.simulation.network import NetworkLane, NetworkLink, SumoNetwork
from interplan_sumo.simulation.obstacles import LaneBlockage

LOOKAHEAD_M = 150.0
"""How far ahead of its lane an agent's corridor reaches."""


@dataclass(frozen=True, slots=True)
class ChainedLane:
    """A SUMO lane as a part of a chain of lanes that follow one another; the ego's projection is at 0 m."""

    lane: NetworkLane
    start_m: float
    link: NetworkLink | None
    """The way on that the chain takes."""

    @property
    def end_m(self) -> float:
        return self.start_m + self.lane.length_m


def chain_through(
    network: SumoNetwork, sumo_lane: str, fraction: float, used: set[str], upstream_m: float, downstream_m: float
) -> list[ChainedLane]:
    """The lane and what precedes and follows it straight on, from upstream to downstream; none of the lanes `used`."""
    here = network.lanes[sumo_lane]
    at_m = -fraction * here.length_m
    taken = set(used)
    if here.internal or here.id in taken:
        return []
    ahead: list[ChainedLane] = []
    start_m, lane = at_m, here
    while True:
        taken.add(lane.id)
        ways = network.links[lane.id]
        straight = [way for way in ways if way.direction == "s"]
        way = next(iter(straight or ways), None)
        ahead.append(ChainedLane(lane, start_m, way))
        start_m += lane.length_m
        if way is None or start_m > downstream_m or way.to_lane in taken:
            break
        for inner in way.via:
            ahead.append(ChainedLane(network.lanes[inner], start_m, None))
            start_m += network.lanes[inner].length_m
        lane = network.lanes[way.to_lane]
    return upstream_of(network, ahead[0], taken, upstream_m) + ahead


def upstream_of(network: SumoNetwork, first: ChainedLane, taken: set[str], upstream_m: float) -> list[ChainedLane]:
    """What precedes the first stretch of a chain straight on, from upstream on, as far as beyond -`upstream_m`.

    None of the lanes `taken`.
    """
    behind: list[ChainedLane] = []
    taken = taken | {first.lane.id}
    end_m, lane = first.start_m, first.lane
    while end_m > -upstream_m:
        ways = [way for way in network.incoming.get(lane.id, ()) if way.from_lane not in taken]
        straight = [way for way in ways if way.direction == "s"]
        if not straight:
            break
        way = straight[0]
        for inner in reversed(way.via):
            end_m -= network.lanes[inner].length_m
            behind.insert(0, ChainedLane(network.lanes[inner], end_m, None))
        lane = network.lanes[way.from_lane]
        taken.add(lane.id)
        end_m -= lane.length_m
        behind.insert(0, ChainedLane(lane, end_m, way))
    return behind


def closed_spans(chain: list[ChainedLane], blocked: tuple[LaneBlockage, ...]) -> list[tuple[float, float]]:
    """Blocked stretches along a chain."""
    starts = {stretch.lane.id: stretch.start_m for stretch in chain}
    return [(starts[b.lane] + b.start_m, starts[b.lane] + b.end_m) for b in blocked if b.lane in starts]


def way_ahead(network: SumoNetwork, lane: str, route: tuple[str, ...], reach_m: float) -> list[ChainedLane]:
    """The lanes, connectors among them, from a normal lane on along a route that begins there, without changing lane.

    The first one begins at 0 m. Ends beyond `reach_m`, or where one would have
    to change lane. Where several connectors lead on, it is the slowest of those
    from which the route goes on.
    """
    here, start_m, found = network.lanes[lane], 0.0, list[ChainedLane]()
    for after, then in zip((*route[1:], None), (*route[2:], None, None), strict=True):
        ways = [way for way in network.links[here.id] if network.lanes[way.to_lane].edge == after]
        lasting = [
            way for way in ways if any(network.lanes[on.to_lane].edge == then for on in network.links[way.to_lane])
        ]
        link = min(lasting or ways, key=lambda way: _slowest_mps(network, way), default=None)
        found.append(ChainedLane(here, start_m, link))
        start_m += here.length_m
        if link is None or start_m > reach_m:
            break
        for inner in link.via:
            found.append(ChainedLane(network.lanes[inner], start_m, None))
            start_m += network.lanes[inner].length_m
        here = network.lanes[link.to_lane]
    return found


def limits_and_turns(
    way: Sequence[ChainedLane], from_m: float
) -> tuple[list[tuple[float, float]], list[tuple[float, str]]]:
    """How far from a place on a way each lane after the first begins, and its limit; each junction, and its direction.

    Directions are SUMO's letters.
    """
    limits = [(part.start_m - from_m, part.lane.limit_mps) for part in way[1:]]
    return limits, [(part.end_m - from_m, part.link.direction) for part in way if part.link is not None]


def _slowest_mps(network: SumoNetwork, way: NetworkLink) -> float:
    return min((network.lanes[inner].limit_mps for inner in way.via), default=network.lanes[way.to_lane].limit_mps)


def continued_route(network: SumoNetwork, lane: str, length_m: float) -> tuple[str, ...]:
    """SUMO edges from a normal lane on, without changing lane: straight on, else the first way; no edge twice."""
    here = network.lanes[lane]
    route, driven_m = [here.edge], here.length_m
    while driven_m < length_m:
        ways = network.links[here.id]
        way = next((way for way in ways if way.direction == "s"), next(iter(ways), None))
        if way is None or network.lanes[way.to_lane].edge in route:
            break
        here = network.lanes[way.to_lane]
        driven_m += here.length_m
        route.append(here.edge)
    return tuple(route)


def ego_sumo_route(network: SumoNetwork, ids: NetworkIds, lanes: tuple[str, ...]) -> tuple[str, ...]:
    """SUMO edges along a chain of lanes and connectors of the map, and straight on behind its end.

    Streets may lead back: a route that goes round a block ends before it meets itself.
    """
    edges: list[str] = []
    for lane_id in lanes:
        here = [network.lanes[piece.sumo_lane] for piece in ids.pieces[lane_id]]
        along = dict.fromkeys(lane.edge for lane in here if not lane.internal)
        while edges and edges[-1] in along:  # a lane beside the one before, on the same edges
            edges.pop()
        edges += along
    last = next(p.sumo_lane for p in reversed(ids.pieces[lanes[-1]]) if not network.lanes[p.sumo_lane].internal)
    return (*edges, *takewhile(lambda edge: edge not in edges, continued_route(network, last, 500.0)[1:]))


def corridor(
    network: SumoNetwork, lane: str, route: tuple[str, ...], choice: Callable[[], Sequence[str]] = tuple
) -> dict[str, float]:
    """The lanes that an agent on `lane` will drive on along `route`, with the distance to the start of each.

    Where a lane leads to several of the next edge it is the one that is in the
    agent's `choice`, which is asked for only then, else the first. Ends where
    the agent must change lane first. An agent inside a junction has the rest
    of the junction and the lane behind it in its corridor.
    """
    found = {lane: 0.0}
    here = network.lanes[lane]
    distance_m = here.length_m
    if here.internal:
        link = _link_through(network, lane, route)
        if link is None:
            return found
        inner = link.via[link.via.index(lane) + 1 :]
    else:
        link = _link_onward(network, lane, route, choice)
        inner = link.via if link is not None else ()
    while link is not None and distance_m < LOOKAHEAD_M + here.length_m:
        for name in inner:
            found[name] = distance_m
            distance_m += network.lanes[name].length_m
        found[link.to_lane] = distance_m
        distance_m += network.lanes[link.to_lane].length_m
        link = _link_onward(network, link.to_lane, route, choice)
        inner = link.via if link is not None else ()
    return found


def _link_onward(
    network: SumoNetwork, lane: str, route: tuple[str, ...], choice: Callable[[], Sequence[str]]
) -> NetworkLink | None:
    edge = network.lanes[lane].edge
    if edge not in route[:-1]:
        return None
    following = route[route.index(edge) + 1]
    ways = [way for way in network.links[lane] if network.lanes[way.to_lane].edge == following]
    if len(ways) > 1:
        chosen = choice()
        ways.sort(key=lambda way: way.to_lane not in chosen)
    return ways[0] if ways else None


def _link_through(network: SumoNetwork, internal: str, route: tuple[str, ...]) -> NetworkLink | None:
    pairs = set(pairwise(route))
    for way in network.ways_through(internal):
        if (network.lanes[way.from_lane].edge, network.lanes[way.to_lane].edge) in pairs:
            return way
    return None
