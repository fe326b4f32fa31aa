"""How like streets a map is: the figures in which drawn districts and surveyed cities can be compared.

`python -m tools.map_yardsticks MAP...` prints a table; a map is a shipped name or a folder.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isnan
from typing import Literal

import numpy as np
import shapely

from interplan_sumo.maps.junctions import Sets, Sign, end_port, junction_groups, lane_signs, start_port
from interplan_sumo.maps.store import find_map, load_roads
from interplan_sumo.world.geometry import Polyline
from interplan_sumo.world.roads import Connector, Roads

RADIUS_STEP_M = 2.0
"""Distance of the three points through which circles are laid."""
STRAIGHT_M = 1000.0
"""Greater radii are printed as straight."""
SHORTEST_LANE_M = 5.0
"""Shorter lanes are stubs, whose widths and radii say nothing."""
SHARED_M2 = 1.0
ONE_JUNCTION_M = 10.0
"""Places joined by roadblocks that are shorter are one junction, as are those whose connectors share ground."""
DRIVEWAY_M = 60.0
"""A way off a junction that ends after less, away from the edge of the map, is a driveway."""
EDGE_M = 15.0
"""What ends this close to the outline of the map was cut off by it."""

JunctionKind = Literal["signalled", "signed", "driveway", "unmarked"]
KINDS: tuple[JunctionKind, ...] = ("signalled", "signed", "driveway", "unmarked")


@dataclass(frozen=True, slots=True)
class Yardsticks:
    """What was measured on one map; percentiles are (10th, 50th, 90th)."""

    name: str
    lane_km: float
    """Of all lanes and connectors: where one ends and the other begins differs from source to source."""
    branching: int
    """Junctions in which a roadblock leads into more than one other."""
    per_lane_km: float
    smallest_radius_m: tuple[float, float]
    """5th and 50th percentile of the lanes' tightest radii."""
    connectors_per_exit_lane: float
    """How many ways a lane offers at its end, on average over those that end in a branching junction."""
    block_length_m: tuple[float, float, float]
    """From one branching junction to the next along a road, in the direction of travel."""
    lane_width_m: tuple[float, float, float]
    """Area over length, over the metres of all lanes."""
    shares: Mapping[JunctionKind, float]
    """Of the branching junctions, adding up to 1."""
    idle_intersections: int
    """Polygons of the layer `intersections` where nothing branches, merges or crosses."""


def tightest_radius_m(line: Polyline) -> float:
    """Radius of the circle through points 2 m apart, the smallest along the line (nuPlan's way); infinite if short."""
    if line.length_m < 2.0 * RADIUS_STEP_M + 0.5:
        return float("inf")
    arc = np.arange(0.0, line.length_m - 2.0 * RADIUS_STEP_M, 0.5)
    a, b, c = (line.poses_at(arc + k * RADIUS_STEP_M)[:, :2] for k in range(3))
    sides = np.hypot(*(b - a).T) * np.hypot(*(c - b).T) * np.hypot(*(c - a).T)
    area = np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2.0
    return float((sides / np.maximum(4.0 * area, 1e-12)).min())


def yardsticks(roads: Roads) -> Yardsticks:
    """All figures of a map."""
    node_of, members = _places(roads)
    branching = {node for node, found in members.items() if _branches(roads, found)}
    lanes = list(roads.lanes.values())
    whole = [lane for lane in lanes if lane.centerline.length_m >= SHORTEST_LANE_M]
    length_m = np.array([lane.centerline.length_m for lane in whole])
    lane_km = sum(lane.centerline.length_m for lane in (*lanes, *roads.connectors.values())) / 1000.0
    leaving = [
        len(ways)
        for lane in lanes
        if (ways := roads.outgoing(lane.id)) and node_of[end_port(lane.roadblock_id)] in branching
    ]
    radii = [tightest_radius_m(lane.centerline) for lane in whole]
    widths = np.array([lane.polygon.area for lane in whole]) / length_m
    kinds = _kinds(roads, node_of, {node: members[node] for node in sorted(branching)})
    return Yardsticks(
        name=roads.name,
        lane_km=lane_km,
        branching=len(branching),
        per_lane_km=len(branching) / lane_km,
        smallest_radius_m=(_percentile(radii, 5), _percentile(radii, 50)),
        connectors_per_exit_lane=float(np.mean(leaving)) if leaving else 0.0,
        block_length_m=_spread(_block_lengths_m(roads, node_of, branching)),
        lane_width_m=_spread(np.repeat(widths, np.ceil(length_m).astype(int)).tolist()),
        shares={kind: list(kinds.values()).count(kind) / max(1, len(kinds)) for kind in KINDS},
        idle_intersections=sum(_idle(roads, area.id) for area in roads.intersections),
    )


def _percentile(values: Sequence[float], percent: float) -> float:
    """One of the values: infinite radii are nothing to interpolate with."""
    return float(np.percentile(values, percent, method="lower")) if values else float("nan")


def _spread(values: Sequence[float]) -> tuple[float, float, float]:
    return _percentile(values, 10), _percentile(values, 50), _percentile(values, 90)


def _blocks(roads: Roads, connector: Connector) -> tuple[str, str]:
    return roads.lanes[connector.from_lane_id].roadblock_id, roads.lanes[connector.to_lane_id].roadblock_id


def _places(roads: Roads) -> tuple[dict[str, str], dict[str, list[str]]]:
    """Roadblock end -> place where ways meet, and place -> its connectors.

    Surveyed maps have several connected groups of connectors on one crossing,
    a few metres of lane between them; all of them are one place here.
    """
    node_of, groups = junction_groups(roads)
    sets = Sets()
    for block in roads.roadblocks.values():
        if not block.is_connector:
            length_m = max(roads.lanes[lane].centerline.length_m for lane in block.lane_ids)
            ends = node_of[start_port(block.id)], node_of[end_port(block.id)]
            if length_m < ONE_JUNCTION_M and all(end in groups for end in ends):
                sets.join(*ends)
    names = [node for node, found in groups.items() for _ in found]
    grounds = np.array([roads.connectors[c].polygon for found in groups.values() for c in found], dtype=object)
    for one, other in zip(*shapely.STRtree(grounds).query(grounds, predicate="intersects"), strict=True):
        if names[one] != names[other] and shapely.area(shapely.intersection(grounds[one], grounds[other])) > SHARED_M2:
            sets.join(names[one], names[other])
    members: dict[str, list[str]] = {}
    for node, found in groups.items():
        members.setdefault(sets.find(node), []).extend(found)
    return {port: sets.find(node) for port, node in node_of.items()}, members


def _branches(roads: Roads, connector_ids: Iterable[str]) -> bool:
    ways = {_blocks(roads, roads.connectors[c]) for c in connector_ids}
    return len(ways) > len({before for before, _ in ways})


def _idle(roads: Roads, intersection_id: str) -> bool:
    """Whether the roadblock connectors of an intersection neither branch nor merge nor cross."""
    inside = [b for b in roads.roadblocks.values() if b.is_connector and b.intersection_id == intersection_id]
    befores, afters = {b.from_id for b in inside}, {b.to_id for b in inside}
    if min(len(befores), len(afters)) < len(inside):
        return False
    lines = [shapely.MultiLineString([roads.connectors[c].centerline.linestring for c in b.lane_ids]) for b in inside]
    return not any(shapely.crosses(one, other) for k, one in enumerate(lines) for other in lines[:k])


# --- along the roads -----------------------------------------------------------------------------


def _block_lengths_m(roads: Roads, node_of: Mapping[str, str], branching: set[str]) -> list[float]:
    """Lengths of the ways that start and end in branching junctions, without those junctions themselves."""
    found: list[float] = []
    for block in roads.roadblocks.values():
        if not block.is_connector and node_of[start_port(block.id)] in branching:
            length_m, last = _followed(roads, node_of, branching, block.id)
            if node_of[end_port(last)] in branching:
                found.append(length_m)
    return found


def _followed(roads: Roads, node_of: Mapping[str, str], branching: set[str], block_id: str) -> tuple[float, str]:
    """Length from the start of a roadblock to the next branching junction or the end, and the last roadblock there."""
    length_m, seen = 0.0, set[str]()
    while True:
        seen.add(block_id)
        lines = [roads.lanes[lane].centerline.length_m for lane in roads.roadblocks[block_id].lane_ids]
        length_m += float(np.mean(lines))
        onward = roads.outgoing_roadblocks(block_id)
        if not onward or node_of[end_port(block_id)] in branching:
            return length_m, block_id
        joint = roads.roadblocks[onward[0]]
        length_m += float(np.mean([roads.connectors[c].centerline.length_m for c in joint.lane_ids]))
        assert joint.to_id is not None, "a roadblock connector leads to a roadblock"
        if joint.to_id in seen:
            return length_m, block_id
        block_id = joint.to_id


# --- kinds of junctions --------------------------------------------------------------------------


def _kinds(roads: Roads, node_of: Mapping[str, str], members: Mapping[str, Sequence[str]]) -> dict[str, JunctionKind]:
    """How each of the junctions is ruled; a driveway is none that a light or sign rules."""
    signs = lane_signs(roads)
    outline = shapely.boundary(shapely.union_all([lane.polygon for lane in roads.lanes.values()]).convex_hull)
    driveways: set[str] = set()
    for block in roads.roadblocks.values():
        if block.is_connector or roads.outgoing_roadblocks(block.id):
            continue
        line = roads.lanes[block.lane_ids[0]].centerline
        inside = shapely.distance(outline, shapely.Point(line.points[-1])) > EDGE_M
        if inside and line.length_m < DRIVEWAY_M:
            driveways.add(node_of[start_port(block.id)])
    found: dict[str, JunctionKind] = {}
    for node, connectors in members.items():
        ways = [roads.connectors[c] for c in connectors]
        if any(way.has_traffic_light for way in ways):
            found[node] = "signalled"
        elif any(signs.get(way.from_lane_id, Sign.NONE) is not Sign.NONE for way in ways):
            found[node] = "signed"
        else:
            found[node] = "driveway" if node in driveways else "unmarked"
    return found


def table(rows: Sequence[Yardsticks]) -> str:
    """One map a column, for a page of documentation."""

    def spread(values: Iterable[float], digits: int) -> str:
        return " / ".join("-" if isnan(value) else f"{value:.{digits}f}" for value in values)

    def radii(values: Iterable[float]) -> str:
        return " / ".join("straight" if value > STRAIGHT_M else spread((value,), 0) for value in values)

    lines: list[tuple[str, list[str]]] = [
        ("", [row.name for row in rows]),
        ("---", ["---"] * len(rows)),
        ("lane-km", [f"{row.lane_km:.1f}" for row in rows]),
        ("branching junctions per lane-km", [f"{row.per_lane_km:.2f}" for row in rows]),
        ("smallest radius of a lane, m, p5 / p50", [radii(row.smallest_radius_m) for row in rows]),
        ("connectors per exit lane", [f"{row.connectors_per_exit_lane:.2f}" for row in rows]),
        ("blocks, m, p10 / p50 / p90", [spread(row.block_length_m, 0) for row in rows]),
        ("lane width, m, p10 / p50 / p90", [spread(row.lane_width_m, 1) for row in rows]),
        (f"junctions, %: {', '.join(KINDS)}", [spread((100.0 * row.shares[k] for k in KINDS), 0) for row in rows]),
        ("intersections where nothing meets", [str(row.idle_intersections) for row in rows]),
    ]
    return "\n".join(f"| {' | '.join((name, *cells))} |" for name, cells in lines)


if __name__ == "__main__":
    print(table([yardsticks(load_roads(find_map(name).folder)) for name in sys.argv[1:]]))
