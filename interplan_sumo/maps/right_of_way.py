"""Right of way in a network from netconvert: who crosses whom and who yields, as the plan says.

netconvert decides by the order of the arms around a node, which misleads at
dual carriageways, skewed arms and ramps. Its links and internal lanes stay; the
bits are replaced by what follows from geometry, signs and lights.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import cast
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.errors import MapError
from interplan_sumo.maps.junctions import Junction, JunctionApproach, Sign, brushing_m
from interplan_sumo.maps.network_plan import Link, NetworkPlan

Key = tuple[str, str, str, str]
"""What names a connection: from, to, fromLane, toLane."""

CLEAR_VIEW_M = 100.0
"""Where paths only merge, and at the ends of narrow streets, drivers see each other from afar."""


@dataclass(frozen=True, slots=True)
class BuiltLink:
    """A link as netconvert built it: its connection, and the internal lane that it runs over."""

    link: Link
    connection: Element
    lane: Element


@dataclass(frozen=True, slots=True)
class _Node:
    """The links of one node in SUMO's order, with the bits between them."""

    id: str
    ways: tuple[BuiltLink, ...]
    rows: tuple[int | None, ...]
    """Row of each link in the junction of the plan; None for the way across a cut."""
    junction: Junction | None
    foes: NDArray[np.bool_]
    response: NDArray[np.bool_]

    def sign(self, at: int) -> Sign:
        """What stands at the approach of a link."""
        row = self.rows[at]
        return Sign.NONE if self.junction is None or row is None else self._approach(row).sign

    def _approach(self, row: int) -> JunctionApproach:
        assert self.junction is not None
        return self.junction.approaches[self.junction.approach_of[row]]


def text_of(element: Element, name: str) -> str:
    """An attribute that netconvert always writes; MapError if it is not there."""
    value = element.get(name)
    if value is None:
        raise MapError(f"netconvert wrote a <{element.tag}> without {name}")
    return value


def set_right_of_way(plan: NetworkPlan, root: Element, ways: Mapping[Key, BuiltLink]) -> None:
    """Write requests, link states and junction types in place."""
    leaving: dict[str, list[BuiltLink]] = defaultdict(list)
    for connection in root.iterfind("connection"):  # SUMO numbers the links of a lane in the order of the file
        key = cast("Key", tuple(connection.get(name) for name in ("from", "to", "fromLane", "toLane")))
        if key in ways:
            leaving[f"{key[0]}_{key[2]}"].append(ways[key])
    for element in root.iterfind("junction"):
        if element.get("type") == "dead_end":
            continue
        node = _node(
            plan, text_of(element, "id"), [w for i in text_of(element, "incLanes").split() for w in leaving[i]]
        )
        _set_requests(element, node)
        if node.junction is not None and not node.junction.lit:
            element.set("type", node.junction.kind or _kind(node.junction))
        for at, way in enumerate(node.ways):
            way.connection.set("state", _state(node, at))
            if _only_merges(node, at):
                way.connection.set("visibility", f"{CLEAR_VIEW_M:g}")
            way.connection.extend(_brushes(node, at))


def _node(plan: NetworkPlan, id_: str, ways: Sequence[BuiltLink]) -> _Node:
    junction = plan.junctions.get(id_)
    bits = np.zeros((2, len(ways), len(ways)), dtype=np.bool_)
    rows: list[int | None] = [None] * len(ways)
    if junction is not None:
        row_of = {c.id: row for row, c in enumerate(junction.connectors)}
        rows = [None if way.link.connector_id is None else row_of[way.link.connector_id] for way in ways]
        at = [k for k, row in enumerate(rows) if row is not None]
        of = [row for row in rows if row is not None]
        for layer, matrix in zip(bits, (junction.conflicts, junction.yields), strict=True):
            layer[np.ix_(at, at)] = matrix[np.ix_(of, of)]
    return _Node(id_, tuple(ways), tuple(rows), junction, bits[0], bits[1])


def _set_requests(element: Element, node: _Node) -> None:
    requests = element.findall("request")
    if len(requests) != len(node.ways):
        raise MapError(f"netconvert made {len(requests)} links at {node.id}, the map has {len(node.ways)}")
    for at, request in enumerate(requests):
        request.set("index", str(at))
        request.set("response", _bits(node.response[at]))
        request.set("foes", _bits(node.foes[at]))
        request.set("cont", "0")


def _bits(row: NDArray[np.bool_]) -> str:
    """SUMO writes the last link first."""
    return "".join("1" if bit else "0" for bit in row[::-1])


def _kind(junction: Junction) -> str:
    if junction.all_way_stop:
        return "allway_stop"
    return "priority_stop" if any(a.sign is Sign.STOP for a in junction.approaches) else "priority"


def _state(node: _Node, at: int) -> str:
    """SUMO's letter for a link without a (working) light."""
    yields = bool(node.response[at].any())
    if node.ways[at].connection.get("tl") is not None:
        return "o" if yields else "O"
    row = node.rows[at]
    given = "" if node.junction is None or row is None else node.junction.letters.get(row, "")
    if given and given not in "oO" and not (given == "M" and yields):
        return given
    if node.sign(at) is Sign.STOP:
        return "w" if node.junction is not None and node.junction.all_way_stop and yields else "s"
    return "m" if yields else "M"


def _only_merges(node: _Node, at: int) -> bool:
    """Whether a link yields, without a sign, and only to paths into the same lane."""
    target = node.ways[at].link.to_edge, node.ways[at].link.to_lane
    ahead = np.flatnonzero(node.response[at])
    merges = all((node.ways[k].link.to_edge, node.ways[k].link.to_lane) == target for k in ahead)
    return bool(ahead.size) and merges and node.sign(at) is Sign.NONE


def _brushes(node: _Node, at: int) -> Iterator[Element]:
    """Conflicts that SUMO does not find: with paths that come too close without crossing."""
    row = node.rows[at]
    for k in np.flatnonzero(node.foes[at]):
        other = node.rows[int(k)]
        if node.junction is None or row is None or other is None:
            continue
        stretch = brushing_m(node.junction.connectors[row], node.junction.connectors[other])
        if stretch is not None:
            foe = node.ways[int(k)].connection
            ends = {name: text_of(foe, name) for name in ("from", "to", "fromLane", "toLane")}
            yield Element("conflict", {**ends, "startPos": f"{stretch[0]:.2f}", "endPos": f"{stretch[1]:.2f}"})
