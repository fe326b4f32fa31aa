"""SUMO's plain XML: the four files that netconvert reads."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from xml.sax.saxutils import quoteattr

import numpy as np
import shapely

from interplan_sumo.maps.network_plan import Link, NetworkPlan, node_points
from interplan_sumo.world.geometry import Floats

_THIN_M = 0.001  # half the thickness of a node that has no area of its own


def plain_files(plan: NetworkPlan) -> dict[str, str]:
    """Text by netconvert option."""
    return {
        "node-files": _document("nodes", _nodes(plan)),
        "edge-files": _document("edges", _edges(plan)),
        "connection-files": _document("connections", _connections(plan)),
        "tllogic-files": _document("tlLogics", _lights(plan)),
    }


def shape_text(points: Floats) -> str:
    """Coordinates as SUMO writes them, to the millimetre."""
    rounded = np.round(points, 3) + 0.0
    return " ".join(f"{x:.3f},{y:.3f}" for x, y in rounded)


def _document(name: str, lines: Iterable[str]) -> str:
    return "\n".join(('<?xml version="1.0" encoding="UTF-8"?>', f"<{name}>", *lines, f"</{name}>", ""))


def _tag(name: str, attributes: Mapping[str, object], inner: str | None = None) -> str:
    text = " ".join(f"{key}={quoteattr(str(value))}" for key, value in attributes.items())
    return f"<{name} {text}/>" if inner is None else f"<{name} {text}>{inner}</{name}>"


def _nodes(plan: NetworkPlan) -> Iterable[str]:
    for node, points in sorted(node_points(plan).items()):
        hull = shapely.MultiPoint(points).convex_hull
        if hull.area < 4 * _THIN_M**2 or not isinstance(hull, shapely.Polygon):
            hull = hull.buffer(_THIN_M, quad_segs=1)
        center = hull.centroid
        attributes: dict[str, object] = {
            "id": node,
            "x": f"{center.x:.3f}",
            "y": f"{center.y:.3f}",
            "type": "traffic_light" if node in plan.programs else "priority",
            "shape": shape_text(shapely.get_coordinates(hull)),
        }
        if node in plan.programs:
            attributes["tl"] = node
        yield _tag("node", attributes)


def _edges(plan: NetworkPlan) -> Iterable[str]:
    for edge in plan.edges:
        lanes: list[str] = []
        for index, stretch in enumerate(edge.lanes):
            lane = plan.roads.lanes[stretch.lane_id]
            lanes.append(
                _tag(
                    "lane",
                    {
                        "index": index,
                        "speed": f"{plan.limit_mps(lane.id):.4f}",
                        "width": f"{lane.polygon.area / lane.centerline.length_m:.3f}",
                        "shape": shape_text(plan.points(stretch)),
                    },
                )
            )
        middle = edge.lanes[len(edge.lanes) // 2]
        yield _tag(
            "edge",
            {
                "id": edge.id,
                "from": edge.from_node,
                "to": edge.to_node,
                "numLanes": len(edge.lanes),
                "speed": f"{max(plan.limit_mps(s.lane_id) for s in edge.lanes):.4f}",
                "shape": shape_text(plan.points(middle)),
            },
            "".join(lanes),
        )


def _connections(plan: NetworkPlan) -> Iterable[str]:
    for link in plan.links:
        attributes = _ends(link)
        attributes["shape"] = shape_text(plan.points(link.stretch))
        attributes["speed"] = f"{plan.limit_mps(link.stretch.lane_id):.4f}"
        # No waiting places inside junctions: SUMO lets cars that are left there at the end of their green drive into
        # the cross traffic (measured: a collision every few minutes on a full crossing, none without).
        attributes["contPos"] = 0
        if link.node in plan.programs and not _is_lit(plan, link):
            attributes["uncontrolled"] = 1
        yield _tag("connection", attributes)
    leading_on = {link.from_edge for link in plan.links}
    for edge in plan.edges:
        if edge.id not in leading_on and edge.to_node in plan.junctions:
            yield _tag("connection", {"from": edge.id})  # leads nowhere: netconvert would guess a way


def _ends(link: Link) -> dict[str, object]:
    return {"from": link.from_edge, "to": link.to_edge, "fromLane": link.from_lane, "toLane": link.to_lane}


def _is_lit(plan: NetworkPlan, link: Link) -> bool:
    return link.connector_id is not None and plan.roads.connectors[link.connector_id].has_traffic_light


def _lights(plan: NetworkPlan) -> Iterable[str]:
    for node, program in sorted(plan.programs.items()):
        phases = "".join(_tag("phase", {"duration": f"{s:g}", "state": state}) for s, state in program.phases)
        head = {"id": node, "type": "static", "programID": "0", "offset": f"{program.offset_s:g}"}
        yield _tag("tlLogic", head, phases)
    for link in plan.links:
        if link.connector_id is not None and link.node in plan.programs and _is_lit(plan, link):
            index = plan.programs[link.node].links.index(link.connector_id)
            yield _tag("connection", {**_ends(link), "tl": link.node, "linkIndex": index})
