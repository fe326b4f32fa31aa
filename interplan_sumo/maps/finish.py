"""The last hand on a network from netconvert: exact shapes, our right of way, nothing that varies between runs.

netconvert numbers the links, makes internal lanes and splits them where a car
waits inside a junction. What it works out from the order of the arms around a
node (who crosses whom, who goes first) is replaced by what the geometry says.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import cast
from xml.etree.ElementTree import Element, tostring

import numpy as np

from interplan_sumo.errors import MapError
from interplan_sumo.maps.edges import Stretch
from interplan_sumo.maps.junctions import Sign
from interplan_sumo.maps.network import NetworkIds, SumoPiece
from interplan_sumo.maps.network_plan import Link, NetworkPlan
from interplan_sumo.maps.opposite import opposite_lanes
from interplan_sumo.maps.plain_xml import shape_text

SHORTEST_LANE_M = 0.1
"""SUMO's smallest lane length."""
_CLEAR_VIEW_M = 100.0  # where paths only merge, drivers see each other from afar
_NEEDLESS = ("shape", "contPos", "speed", "length", "customShape", "customLength", "uncontrolled")


@dataclass(frozen=True, slots=True)
class _Way:
    """A link as netconvert built it: its connection, and the internal lanes that it runs over."""

    link: Link
    connection: Element
    lanes: tuple[Element, ...]


def finish(plan: NetworkPlan, root: Element) -> NetworkIds:
    """Correct the network in place and return its id map; MapError where netconvert did not follow the plan."""
    ways = _ways(plan, root)
    pieces = _lay_lanes(plan, root, ways)
    _set_priorities(plan, root, ways)
    _add_opposites(plan, root)
    _strip(plan, root)
    return NetworkIds(
        origin_m=plan.origin_m,
        driving_side=plan.roads.driving_side,
        pieces={lane: tuple(sorted(found, key=lambda p: (p.start_m, p.end_m))) for lane, found in pieces.items()},
        links={
            connector: (node, index)
            for node, program in plan.programs.items()
            for index, connector in enumerate(program.links)
        },
    )


def network_text(root: Element) -> str:
    """The network as a document."""
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="unicode") + "\n"


def _text(element: Element, name: str) -> str:
    value = element.get(name)
    if value is None:
        raise MapError(f"netconvert wrote a <{element.tag}> without {name}")
    return value


def _ways(plan: NetworkPlan, root: Element) -> dict[tuple[str, str, str, str], _Way]:
    lanes = {_text(lane, "id"): lane for lane in root.iterfind("edge/lane")}
    connections: dict[tuple[str, str, str, str], Element] = {}
    onward: dict[str, Element] = {}
    for connection in root.iterfind("connection"):
        start, end, from_lane, to_lane = (_text(connection, name) for name in ("from", "to", "fromLane", "toLane"))
        if start.startswith(":"):
            onward[f"{start}_{from_lane}"] = connection
        else:
            connections[start, end, from_lane, to_lane] = connection
    ways: dict[tuple[str, str, str, str], _Way] = {}
    for link in plan.links:
        connection = connections.pop(link.key, None)
        if connection is None:
            raise MapError(f"netconvert dropped the way from {link.from_edge} to {link.to_edge} at {link.node}")
        chain: list[Element] = []
        via = connection.get("via")
        while via is not None:
            chain.append(lanes[via])
            via = onward[via].get("via")
        if not chain:
            raise MapError(f"netconvert made no lane for the way from {link.from_edge} to {link.to_edge}")
        ways[link.key] = _Way(link, connection, tuple(chain))
    if connections:
        start, end, *_ = next(iter(connections))
        raise MapError(f"netconvert added a way from {start} to {end} that the map does not have")
    return ways


# --- shapes and lengths ------------------------------------------------------------------------


def _lay_lanes(
    plan: NetworkPlan, root: Element, ways: dict[tuple[str, str, str, str], _Way]
) -> dict[str, list[SumoPiece]]:
    """Give every SUMO lane the exact shape of the stretch that it follows."""
    pieces: dict[str, list[SumoPiece]] = defaultdict(list)
    lanes = {_text(lane, "id"): lane for lane in root.iterfind("edge/lane")}

    def lay(lane: Element, stretch: Stretch, length_m: float) -> None:
        lane.set("shape", shape_text(plan.points(stretch)))
        lane.set("length", f"{max(SHORTEST_LANE_M, length_m):.3f}")
        pieces[stretch.lane_id].append(SumoPiece(_text(lane, "id"), stretch.start_m, stretch.end_m))

    for edge in plan.edges:
        mean_m = float(np.mean([stretch.length_m for stretch in edge.lanes]))
        for index, stretch in enumerate(edge.lanes):
            lane = lanes[f"{edge.id}_{index}"]
            lane.set("speed", _speed(plan, stretch.lane_id))
            lay(lane, stretch, mean_m)
    for way in ways.values():
        whole = way.link.stretch
        lengths = [float(_text(lane, "length")) for lane in way.lanes]
        bounds = whole.start_m + np.cumsum([0.0, *lengths]) * (whole.length_m / sum(lengths))
        bounds[-1] = whole.end_m
        for lane, start_m, end_m in zip(way.lanes, bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
            lane.set("speed", _speed(plan, whole.lane_id))
            lay(lane, Stretch(whole.lane_id, start_m, end_m), end_m - start_m)
    return pieces


def _speed(plan: NetworkPlan, lane_id: str) -> str:
    return f"{plan.limit_mps(lane_id):.4f}"


# --- right of way ------------------------------------------------------------------------------


def _set_priorities(plan: NetworkPlan, root: Element, ways: dict[tuple[str, str, str, str], _Way]) -> None:
    """Write who crosses whom and who yields, as the junctions of the plan say."""
    leaving: dict[str, list[_Way]] = defaultdict(list)
    for connection in root.iterfind("connection"):  # SUMO numbers links in the order of the file
        key = cast("tuple[str, str, str, str]", tuple(connection.get(n) for n in ("from", "to", "fromLane", "toLane")))
        if key in ways:
            leaving[f"{key[0]}_{key[2]}"].append(ways[key])
    internal: dict[str, Element] = {}
    for element in root.iterfind("junction"):
        if element.get("type") == "internal":
            internal[_text(element, "id")] = element
    for element in root.iterfind("junction"):
        node = _text(element, "id")
        if element.get("type") not in ("internal", "dead_end"):
            order = [way for lane in _text(element, "incLanes").split() for way in leaving[lane]]
            _set_node(plan, element, node, order, internal)


def _set_node(plan: NetworkPlan, element: Element, node: str, order: list[_Way], internal: dict[str, Element]) -> None:
    requests = element.findall("request")
    if len(requests) != len(order):
        raise MapError(f"netconvert made {len(requests)} links at {node}, the map has {len(order)}")
    meeting = plan.junctions.get(node)
    row_of: dict[str, int] = {}
    if meeting is not None:
        row_of = {c.id: row for row, c in enumerate(meeting.connectors)}
        if node not in plan.programs:
            signs = {a.sign for a in meeting.approaches}
            kind = "allway_stop" if meeting.all_way_stop else "priority_stop" if Sign.STOP in signs else "priority"
            element.set("type", kind)
    rows = [None if w.link.connector_id is None else row_of[w.link.connector_id] for w in order]
    for index, (way, row) in enumerate(zip(order, rows, strict=True)):
        foes = [
            meeting is not None and row is not None and r is not None and bool(meeting.conflicts[row, r]) for r in rows
        ]
        response = [f and meeting is not None and bool(meeting.yields[row, r]) for f, r in zip(foes, rows, strict=True)]
        request = requests[index]
        request.set("index", str(index))
        request.set("foes", "".join("1" if bit else "0" for bit in reversed(foes)))
        request.set("response", "".join("1" if bit else "0" for bit in reversed(response)))
        request.set("cont", "1" if len(way.lanes) > 1 else "0")
        connection = way.connection
        sign = Sign.NONE
        if meeting is not None and row is not None:
            sign = meeting.approaches[meeting.approach_of[row]].sign
            if any(response) and not sign and _only_merges(way, order, response):
                connection.set("visibility", f"{_CLEAR_VIEW_M:g}")
        if connection.get("tl") is not None:
            state = "o" if any(response) else "O"
        elif meeting is not None and meeting.all_way_stop:
            state = "w" if any(foes) else "s"
        elif sign is Sign.STOP:
            state = "s"
        else:
            state = "m" if any(response) else "M"
        connection.set("state", state)
        if len(way.lanes) > 1:
            if meeting is None or row is None:
                raise MapError(f"netconvert made a waiting place at {node} where the map has none")
            facing = meeting.opposite.get(meeting.approach_of[row])
            foe_ways = [w for w, bit in zip(order, foes, strict=True) if bit]
            asked = [
                w.link
                for w, bit, r in zip(order, response, rows, strict=True)
                if bit and r is not None and meeting.approach_of[r] == facing
            ]
            waiting = internal[_text(way.lanes[1], "id")]
            first = _text(way.lanes[0], "id")
            waiting.set("incLanes", " ".join(dict.fromkeys((first, *(f"{k.from_edge}_{k.from_lane}" for k in asked)))))
            waiting.set("intLanes", " ".join(_text(w.lanes[0], "id") for w in foe_ways))


def _only_merges(way: _Way, order: list[_Way], response: list[bool]) -> bool:
    """Whether all that this link yields to are paths into the same lane."""
    target = (way.link.to_edge, way.link.to_lane)
    return all(
        (other.link.to_edge, other.link.to_lane) == target for other, bit in zip(order, response, strict=True) if bit
    )


# --- the rest ----------------------------------------------------------------------------------


def _add_opposites(plan: NetworkPlan, root: Element) -> None:
    """Name the oncoming lane of inner lanes, and give both edges one length, on which SUMO insists."""
    edges = {_text(edge, "id"): edge for edge in root.iterfind("edge")}
    for lane_id, opposite_id in opposite_lanes(plan).items():
        here, there = (edges[name.rpartition("_")[0]].findall("lane") for name in (lane_id, opposite_id))
        here[-1].append(Element("neigh", {"lane": opposite_id}))
        mean_m = (float(_text(here[0], "length")) + float(_text(there[0], "length"))) / 2
        for lane in (*here, *there):
            lane.set("length", f"{mean_m:.3f}")


def _strip(plan: NetworkPlan, root: Element) -> None:
    """Remove what the simulation does not read and what would tie the file to a machine or a moment."""
    for name in [name for name in root.attrib if name.startswith("{")]:
        del root.attrib[name]
    location = root.find("location")
    if location is not None:
        x_m, y_m = plan.origin_m
        location.set("netOffset", f"{-x_m:.2f},{-y_m:.2f}")
    for connection in root.iterfind("connection"):
        for name in _NEEDLESS:
            connection.attrib.pop(name, None)
    for element in (*root.iterfind("edge/lane"), *root.iterfind("junction")):
        element.attrib.pop("customShape", None)
    for edge in root.iterfind("edge"):
        edge.attrib.pop("shape", None)
    for element in root.iter():
        element.text = element.text.strip() or None if element.text else None
        element.tail = "\n"
    root.text = "\n"
