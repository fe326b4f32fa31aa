"""Which lanes of the file a connector leads over, and which lights and ways through junctions lie on it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from interplan_sumo.maps.importers.record import LaneOrigin
from interplan_sumo.maps.importers.source import SourceLane, SourceMap, SourceSignal
from interplan_sumo.world.roads import Roads

START, END = 1e-4, 1.0 - 1e-4
"""Shares of a lane of the file up to which, and from which on, a stretch holds its start and its end."""


@dataclass(frozen=True, slots=True)
class ConnectorChain:
    """The lanes of the file along a connector, in driving order."""

    lanes: tuple[str, ...]
    """The last of the lane before it, its own, and the first of the lane behind it, each once in a row."""
    left: frozenset[str]
    """Those whose end lies on it."""
    entered: frozenset[str]
    """Those whose start lies on it."""

    def holds(self, way: Sequence[str]) -> bool:
        """Whether a way through a junction begins on the connector: its lane, or the joint of its two lanes."""
        if len(way) == 1:
            return way[0] in self.entered
        return way[0] in self.left and (way[0], way[-1]) in set(pairwise(self.lanes))


def connector_chains(roads: Roads, origins: Mapping[str, Sequence[LaneOrigin]]) -> dict[str, ConnectorChain]:
    """The chain of every connector that came from the file."""
    found: dict[str, ConnectorChain] = {}
    for id_, connector in roads.connectors.items():
        before, after = origins.get(connector.from_lane_id), origins.get(connector.to_lane_id)
        if not before or not after:
            continue
        own = origins.get(id_, ())
        rows = (before[-1], *own, after[0])
        lanes = [row.source_id for row in rows]
        found[id_] = ConnectorChain(
            tuple(lane for k, lane in enumerate(lanes) if k == 0 or lane != lanes[k - 1]),
            frozenset(row.source_id for row in rows[:-1] if row.to_share >= END),
            frozenset(row.source_id for row in rows[1:] if row.from_share <= START),
        )
    return found


def lights_passed(
    chain: ConnectorChain, lanes: Mapping[str, SourceLane], only: Mapping[str, SourceSignal]
) -> list[str]:
    """The lights on a connector, in driving order; `only` has those that hold for some ways, with their controllers."""
    found: dict[str, None] = {}
    steps = frozenset(pairwise(chain.lanes))
    for lane in chain.lanes:
        if lane not in lanes:
            continue
        lights = (
            *(lanes[lane].lights_at_start if lane in chain.entered else ()),
            *(lanes[lane].lights_at_end if lane in chain.left else ()),
        )
        found |= {light: None for light in lights if light not in only or only[light].ways[light] & steps}
    return list(found)


def lights_by_way(source: SourceMap) -> dict[str, SourceSignal]:
    """Lights that hold for some ways out of their lane only, with their controllers."""
    return {light: signal for signal in source.signals for light in signal.ways}


def connectors_by_way(source: SourceMap, chains: Mapping[str, ConnectorChain]) -> dict[tuple[str, ...], list[str]]:
    """Way through a junction of the file -> the connectors that lead over it."""
    by_lane: dict[str, list[str]] = defaultdict(list)
    for id_, chain in chains.items():
        for lane in chain.entered | chain.left:
            by_lane[lane].append(id_)
    return {
        way.lanes: [id_ for id_ in by_lane.get(way.lanes[0], ()) if chains[id_].holds(way.lanes)]
        for junction in source.junctions
        for way in junction.ways
    }
