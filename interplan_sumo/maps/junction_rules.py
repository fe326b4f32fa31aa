"""Junctions under the rules of the file that the map came from: who meets whom, who yields."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import replace

from interplan_sumo.maps.controls import APART, OPEN, YIELDS, JunctionRules
from interplan_sumo.maps.junctions import Junction


def ruled(junctions: Mapping[str, Junction], rules: Iterable[JunctionRules]) -> dict[str, Junction]:
    """The junctions by node, with what the rules say in place of what geometry and signs do."""
    node_of = {connector.id: node for node, junction in junctions.items() for connector in junction.connectors}
    by_node: dict[str, list[JunctionRules]] = defaultdict(list)
    for each in rules:
        nodes = list(dict.fromkeys(node_of[connector] for connector in each.connectors))
        for node in nodes:
            ids = {connector for connector in each.connectors if node_of[connector] == node}
            by_node[node].append(each if len(nodes) == 1 else each.within(ids))
    return {
        node: _ruled(junction, by_node[node]) if node in by_node else junction for node, junction in junctions.items()
    }


def _ruled(junction: Junction, rules: Iterable[JunctionRules]) -> Junction:
    row_of = {connector.id: row for row, connector in enumerate(junction.connectors)}
    conflicts, yields = junction.conflicts.copy(), junction.yields.copy()
    letters: dict[int, str] = {}
    kinds: set[str] = set()
    for each in rules:
        rows = [row_of[connector] for connector in each.connectors]
        kinds.add(each.kind)
        for a, i in enumerate(rows):
            if each.letters[a]:
                letters.setdefault(i, each.letters[a])
            for j, rule in zip(rows, each.rules[a], strict=True):
                if i != j and rule != OPEN:
                    if each.meets_known:
                        conflicts[i, j] = rule != APART
                    yields[i, j] = conflicts[i, j] and rule == YIELDS
    kind = kinds.pop() if len(kinds) == 1 else ""
    all_way = kind == "allway_stop" if kind else junction.all_way_stop
    return replace(junction, conflicts=conflicts, yields=yields, all_way_stop=all_way, kind=kind, letters=letters)
