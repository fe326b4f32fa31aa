"""Whether signal programs are sane: every light-controlled connector served, nobody sent into another's path."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from itertools import pairwise

from interplan_sumo.maps.junctions import path_conflicts
from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.network_links import CheckedLink, NetworkSummary
from interplan_sumo.maps.problem import MapProblem
from interplan_sumo.maps.schema import CONNECTORS
from interplan_sumo.world.roads import Connector, Roads

SHORTEST_YELLOW_S = 2.5
"""Shorter ones cannot be obeyed at the speeds of a town."""
_LETTERS = frozenset("Ggyr")


def light_problems(roads: Roads, ids: NetworkIds, network: NetworkSummary) -> list[MapProblem]:
    """One for each fault: a connector without its light, a path that never gets green, conflicting greens."""
    problems: list[MapProblem] = []
    by_start = {way.via[0]: way for way in network.links if way.via}
    groups: dict[str, list[tuple[Connector, CheckedLink]]] = defaultdict(list)
    for connector in roads.connectors.values():
        pieces = ids.pieces.get(connector.id)
        way = by_start.get(pieces[0].sumo_lane) if pieces else None
        if way is None:
            continue  # reported as missing
        named = ids.links.get(connector.id)
        if way.light != named:
            said = f"has the light {way.light} in the network, {named} in the id map"
            problems.append(MapProblem("light", CONNECTORS, connector.id, said))
        elif connector.has_traffic_light != (named is not None):
            said = f"has {'no' if named is None else 'a'} light in the network only"
            problems.append(MapProblem("light", CONNECTORS, connector.id, said))
        elif named is not None:
            groups[named[0]].append((connector, way))
    for light, members in groups.items():
        phases = network.lights.get(light)
        if phases is None:
            problems.append(MapProblem("light", "light", light, "has no program"))
        elif any(way.light is not None and way.light[1] >= len(state) for _, way in members for _, state in phases):
            problems.append(MapProblem("light", "light", light, "has states shorter than its links"))
        elif any(set(state) - _LETTERS for _, state in phases):
            said = f"shows letters other than {', '.join(sorted(_LETTERS))}"
            problems.append(MapProblem("light", "light", light, said))
        else:
            problems += _program_problems(roads, network, light, members, phases)
    return problems


def _program_problems(
    roads: Roads,
    network: NetworkSummary,
    light: str,
    members: Sequence[tuple[Connector, CheckedLink]],
    phases: Sequence[tuple[float, str]],
) -> Iterator[MapProblem]:
    connectors = [connector for connector, _ in members]
    index = [way.light[1] if way.light else 0 for _, way in members]
    conflicts = path_conflicts(roads, connectors)
    for i, (connector, way) in enumerate(members):
        letters = [state[index[i]] for _, state in phases]
        if not any(letter in "Gg" for letter in letters):
            yield MapProblem("light", "light", light, f"connector {connector.id} never gets green")
        for (_, before), (seconds, after) in pairwise((*phases, phases[0])):
            if before[index[i]] in "Gg" and after[index[i]] == "r":
                said = f"connector {connector.id} turns from green to red without yellow"
                yield MapProblem("light", "light", light, said)
            if after[index[i]] == "y" and seconds < SHORTEST_YELLOW_S:
                yield MapProblem("light", "light", light, f"connector {connector.id} has {seconds:g} s of yellow")
        for j in range(i):
            if conflicts[i, j]:
                pairs = {(state[index[i]], state[index[j]]) for _, state in phases}
                faults = sorted(pair for pair in pairs if _collide(network, pair, (way, members[j][1])))
                if faults:
                    shown = " and ".join(faults[0])
                    said = f"connectors {connector.id} and {connectors[j].id} meet and both show {shown}"
                    yield MapProblem("light", "light", light, said)


def _collide(network: NetworkSummary, letters: tuple[str, str], ways: tuple[CheckedLink, CheckedLink]) -> bool:
    """Whether two paths that meet are both open and neither must yield; a path that runs out ("y") yields like "g"."""
    if not all(letter in "Ggy" for letter in letters) or letters == ("y", "y"):
        return False
    one, other = ways
    return not (
        (letters[0] in "gy" and other.link in network.yields[one.node].get(one.link, frozenset()))
        or (letters[1] in "gy" and one.link in network.yields[other.node].get(other.link, frozenset()))
    )
