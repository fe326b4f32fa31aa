"""The last hand on a network from netconvert: exact shapes, our right of way, nothing that varies between runs.

netconvert numbers the links and makes the internal lanes. What it works out
from the order of the arms around a node (who crosses whom, who goes first) is
replaced by what the geometry says.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Container, Mapping
from xml.etree.ElementTree import Element, tostring

import numpy as np

from interplan_sumo.errors import MapError
from interplan_sumo.maps.edges import LaneStretch
from interplan_sumo.maps.narrow_streets import narrow_streets
from interplan_sumo.maps.network import NetworkIds, SumoPiece
from interplan_sumo.maps.network_plan import NetworkPlan, opposite_lanes
from interplan_sumo.maps.plain_xml import shape_text
from interplan_sumo.maps.program_elements import program_element
from interplan_sumo.maps.right_of_way import CLEAR_VIEW_M, BuiltLink, Key, set_right_of_way, text_of

SHORTEST_LANE_M = 0.1
"""SUMO's smallest lane length."""
_NEEDLESS = ("shape", "contPos", "speed", "length", "customShape", "customLength", "uncontrolled")


def finish(plan: NetworkPlan, root: Element) -> NetworkIds:
    """Correct the network in place and return its id map; MapError where netconvert did not follow the plan."""
    ways = _ways(plan, root)
    pieces = _lay_lanes(plan, root, ways)
    _add_lights(plan, root, ways)
    set_right_of_way(plan, root, ways)
    narrow = narrow_streets(plan)
    _add_opposites(plan, root, narrow)
    _mark_narrow(root, narrow)
    _let_queue(root)
    _strip(plan, root)
    return NetworkIds(
        origin_m=plan.origin_m,
        driving_side=plan.roads.driving_side,
        pieces={lane: tuple(sorted(found, key=lambda p: (p.start_m, p.end_m))) for lane, found in pieces.items()},
        links={
            connector: (node, index)
            for node, program in plan.programs.items()
            for index, connector in enumerate(program.links)
            if connector in pieces
        }
        | {connector: link for connector, link in plan.controls.links.items() if connector in pieces},
    )


def network_text(root: Element) -> str:
    """The network as a document."""
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="unicode").rstrip() + "\n"


def _ways(plan: NetworkPlan, root: Element) -> dict[Key, BuiltLink]:
    lanes = {text_of(lane, "id"): lane for lane in root.iterfind("edge/lane")}
    connections: dict[Key, Element] = {}
    for connection in root.iterfind("connection"):
        start, end, from_lane, to_lane = (text_of(connection, name) for name in ("from", "to", "fromLane", "toLane"))
        if not start.startswith(":"):
            connections[start, end, from_lane, to_lane] = connection
    ways: dict[Key, BuiltLink] = {}
    for link in plan.links:
        connection = connections.pop(link.key, None)
        if connection is None:
            raise MapError(f"netconvert dropped the way from {link.from_edge} to {link.to_edge} at {link.node}")
        lane = lanes.get(connection.get("via", ""))
        if lane is None:
            raise MapError(f"netconvert made no lane for the way from {link.from_edge} to {link.to_edge}")
        ways[link.key] = BuiltLink(link, connection, lane)
    if connections:
        start, end, *_ = next(iter(connections))
        raise MapError(f"netconvert added a way from {start} to {end} that the map does not have")
    return ways


# --- shapes and lengths ------------------------------------------------------------------------


def _lay_lanes(plan: NetworkPlan, root: Element, ways: dict[Key, BuiltLink]) -> dict[str, list[SumoPiece]]:
    """Give every SUMO lane the exact shape of the stretch that it follows."""
    pieces: dict[str, list[SumoPiece]] = defaultdict(list)
    lanes = {text_of(lane, "id"): lane for lane in root.iterfind("edge/lane")}

    def lay(lane: Element, stretch: LaneStretch, length_m: float) -> None:
        lane.set("shape", shape_text(plan.points(stretch)))
        lane.set("length", f"{max(SHORTEST_LANE_M, length_m):.3f}")
        pieces[stretch.lane_id].append(SumoPiece(text_of(lane, "id"), stretch.start_m, stretch.end_m))

    for edge in plan.edges:
        mean_m = float(np.mean([stretch.length_m for stretch in edge.lanes]))
        for index, stretch in enumerate(edge.lanes):
            lane = lanes[f"{edge.id}_{index}"]
            lane.set("speed", _speed(plan, stretch.lane_id))
            lay(lane, stretch, mean_m)
    for way in ways.values():
        stretch = way.link.stretch
        way.lane.set("speed", _speed(plan, stretch.lane_id))
        lay(way.lane, stretch, stretch.length_m)
    return pieces


def _speed(plan: NetworkPlan, lane_id: str) -> str:
    return f"{plan.limit_mps(lane_id):.4f}"


# --- lights of the map's file ------------------------------------------------------------------


def _add_lights(plan: NetworkPlan, root: Element, ways: Mapping[Key, BuiltLink]) -> None:
    """Put in the programs that the map took over, and tie their connections to them."""
    used: set[str] = set()
    lit: set[str] = set()
    for way in ways.values():
        link = plan.controls.links.get(way.link.connector_id or "")
        if link is not None:
            way.connection.set("tl", link[0])
            way.connection.set("linkIndex", str(link[1]))
            used.add(link[0])
            lit.add(way.link.node)
    at = next((k for k, element in enumerate(root) if element.tag in ("tlLogic", "junction")), len(root))
    added = [program_element(key, each) for key in sorted(used) for each in plan.controls.signals[key]]
    root[at:at] = added
    for element in root.iterfind("junction"):
        if element.get("id") in lit:
            element.set("type", "traffic_light")


# --- the rest ----------------------------------------------------------------------------------


def _mark_narrow(root: Element, narrow: Mapping[str, str]) -> None:
    """Name the oncoming edge on the same ground, and give both one length: SUMO counts positions from either end.

    Who comes onto it looks whether somebody comes towards it only where its link has to yield.
    """
    for connection in root.iterfind("connection"):
        enters = connection.get("to") in narrow and connection.get("from") not in narrow
        if enters and connection.get("state") == "M" and connection.get("tl") is None:
            connection.set("state", "m")
            connection.set("visibility", f"{CLEAR_VIEW_M:g}")
    edges = {text_of(edge, "id"): edge for edge in root.iterfind("edge")}
    for here, there in narrow.items():
        edges[here].set("bidi", there)
        lane, oncoming = (edges[name].findall("lane")[0] for name in (here, there))
        mean_m = (float(text_of(lane, "length")) + float(text_of(oncoming, "length"))) / 2
        for each in (lane, oncoming):
            each.set("length", f"{mean_m:.3f}")


def _let_queue(root: Element) -> None:
    """Who has the right of way without a light need not keep the junction clear.

    SUMO's cars would stop before it for a last car beyond that touches its brakes, however fast that drives.
    """
    for connection in root.iterfind("connection"):
        if connection.get("state") == "M" and connection.get("tl") is None:
            connection.set("keepClear", "0")


def _add_opposites(plan: NetworkPlan, root: Element, narrow: Container[str]) -> None:
    """Name the oncoming lane of inner lanes, and give both edges one length, on which SUMO insists.

    On narrow streets there is no lane beside one's own to overtake on.
    """
    edges = {text_of(edge, "id"): edge for edge in root.iterfind("edge")}
    for lane_id, opposite_id in opposite_lanes(plan).items():
        if lane_id.rpartition("_")[0] in narrow:
            continue
        here, there = (edges[name.rpartition("_")[0]].findall("lane") for name in (lane_id, opposite_id))
        here[-1].append(Element("neigh", {"lane": opposite_id}))
        mean_m = (float(text_of(here[0], "length")) + float(text_of(there[0], "length"))) / 2
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
