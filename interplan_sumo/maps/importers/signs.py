"""Lights and signs of an imported map: which connectors they hold for, and the stop lines that stand for them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import shapely

from interplan_sumo.maps.importers.connector_paths import ConnectorPath, SegmentSurfaces
from interplan_sumo.maps.importers.cross_sections import largest, sound
from interplan_sumo.maps.importers.source import SourceMap
from interplan_sumo.world.geometry import Polyline
from interplan_sumo.world.roads import Connector, Lane, StopLine, StopLineKind

STOP_LINE_M = 0.5
"""A stop line reaches this far before and behind the end of its lanes, so that it touches their connectors."""
_INSET = 0.03  # share of the lane's width that it stays away from the next lane
_HALF_WIDTH_M = 0.25  # of a stop line that the file draws as a mere line


@dataclass(frozen=True, slots=True)
class ConnectorControls:
    """What holds for the connectors of a map, by their ids."""

    lights: Mapping[str, tuple[str, ...]]
    """The file's lights that one passes on the connector."""
    signs: Mapping[str, StopLineKind]
    """STOP_SIGN or YIELD at its beginning."""


def controls(source: SourceMap, ground: SegmentSurfaces, ways: Mapping[str, ConnectorPath]) -> ConnectorControls:
    """The lights and signs of every connector: those of the ends of lanes that it passes."""
    signs_at_end = {lane.id: lane.sign_at_end for lane in source.lanes.values() if lane.sign_at_end is not None}
    for line in source.stop_lines:
        if line.kind in (StopLineKind.STOP_SIGN, StopLineKind.YIELD):
            for lane in line.lane_ids:
                if lane in source.lanes and not source.lanes[lane].in_intersection:
                    signs_at_end.setdefault(lane, line.kind)
    lights: dict[str, tuple[str, ...]] = {}
    signs: dict[str, StopLineKind] = {}
    for id_, path in ways.items():
        left, entered = _ends_passed(ground, path)
        passed = [light for lane in left for light in source.lanes[lane].lights_at_end]
        passed += [light for lane in entered for light in source.lanes[lane].lights_at_start]
        if passed:
            lights[id_] = tuple(dict.fromkeys(passed))
        kinds = [signs_at_end[lane] for lane in left if lane in signs_at_end]
        if kinds:
            signs[id_] = min(kinds)  # STOP_SIGN is the stricter and the smaller
    return ConnectorControls(lights, signs)


def _ends_passed(ground: SegmentSurfaces, path: ConnectorPath) -> tuple[list[str], list[str]]:
    """Lanes of the file whose end, and those whose start, lies on a way, its own ends included."""
    left: list[str] = []
    entered: list[str] = []
    for node in (path.start, *path.parts, path.end):
        section, segment = ground.sections[node.section], ground.segment(node)
        column = section.columns[node.lane]
        for row, source_id in enumerate(column):
            begin_m, end_m = section.seams_m[row], section.seams_m[row + 1]
            inside_end = segment.start_m < end_m <= segment.end_m + 1e-6
            inside_start = segment.start_m - 1e-6 <= begin_m < segment.end_m
            if inside_end and (node != path.start or end_m >= segment.end_m - 1e-6) and node != path.end:
                left.append(source_id)
            if inside_start and (node != path.end or begin_m <= segment.start_m + 1e-6) and node != path.start:
                entered.append(source_id)
    return left, entered


def place(
    source: SourceMap, found: ConnectorControls, lanes: Mapping[str, Lane], connectors: Mapping[str, Connector]
) -> tuple[dict[str, StopLine], dict[str, Connector]]:
    """Stop lines at the ends of lanes, with the file's other ones, and the connectors that now name theirs."""
    stop_lines: dict[str, StopLine] = {}
    under_light: dict[tuple[str, tuple[str, ...]], list[str]] = defaultdict(list)
    for id_, lights in found.lights.items():
        under_light[lanes[connectors[id_].from_lane_id].roadblock_id, lights].append(id_)
    lines_of: dict[str, tuple[str, ...]] = {}
    for (_, _lights), ids in under_light.items():
        line = _across(str(len(stop_lines) + 1), _leaving(ids, lanes, connectors), StopLineKind.TRAFFIC_LIGHT)
        stop_lines[line.id] = line
        lines_of |= dict.fromkeys(ids, (line.id,))
    under_sign: dict[tuple[str, StopLineKind], list[str]] = defaultdict(list)
    for id_, kind in found.signs.items():
        if id_ not in found.lights:
            under_sign[lanes[connectors[id_].from_lane_id].roadblock_id, kind].append(id_)
    for (_, kind), ids in under_sign.items():
        line = _across(str(len(stop_lines) + 1), _leaving(ids, lanes, connectors), kind)
        stop_lines[line.id] = line
    placed = (StopLineKind.TRAFFIC_LIGHT, StopLineKind.STOP_SIGN, StopLineKind.YIELD)
    for drawn in source.stop_lines:
        if drawn.kind not in placed or not drawn.lane_ids:
            band = shapely.buffer(shapely.LineString(drawn.points), _HALF_WIDTH_M, cap_style="flat")
            kind = drawn.kind if drawn.kind not in placed else StopLineKind.UNKNOWN
            line = StopLine(str(len(stop_lines) + 1), sound(largest(band)), kind)
            if not line.polygon.is_empty:
                stop_lines[line.id] = line
    renamed = {
        id_: replace(connector, stop_line_ids=lines_of[id_]) if id_ in lines_of else connector
        for id_, connector in connectors.items()
    }
    return stop_lines, renamed


def _leaving(
    ids: Sequence[str], lanes: Mapping[str, Lane], connectors: Mapping[str, Connector]
) -> list[tuple[Lane, Connector]]:
    """The lanes that connectors leave, from left to right, each once with one of its connectors."""
    by_lane = {connectors[id_].from_lane_id: connectors[id_] for id_ in reversed(ids)}
    return sorted(((lanes[lane], c) for lane, c in by_lane.items()), key=lambda pair: pair[0].index)


def _across(id_: str, leaving: Sequence[tuple[Lane, Connector]], kind: StopLineKind) -> StopLine:
    """A band across lanes at their end."""
    bands: list[shapely.Geometry] = []
    for lane, connector in leaving:
        corners = [
            *_edge(lane, connector, left=True),
            *reversed(_edge(lane, connector, left=False)),
        ]
        bands.append(sound(shapely.Polygon(corners)))
    shape = shapely.convex_hull(shapely.union_all(bands))
    if not isinstance(shape, shapely.Polygon):  # a lane that ends in a point
        shape = shapely.buffer(leaving[0][0].centerline.linestring.interpolate(-STOP_LINE_M), STOP_LINE_M)
    return StopLine(id_, sound(shape), kind)


def _edge(lane: Lane, connector: Connector, *, left: bool) -> list[tuple[float, float]]:
    """Two points on one side of a lane, before and behind its end, a little inside."""

    def at(line: Polyline, arc_m: float) -> tuple[float, float]:
        pose = line.pose_at(arc_m)
        return pose.x_m, pose.y_m

    def inset(own: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
        return own[0] + _INSET * (other[0] - own[0]), own[1] + _INSET * (other[1] - own[1])

    sides = (lane.left_boundary, lane.right_boundary) if left else (lane.right_boundary, lane.left_boundary)
    ahead = (connector.left_boundary, connector.right_boundary)
    ahead = ahead if left else ahead[::-1]
    before = inset(*(at(line, line.length_m - STOP_LINE_M) for line in sides))
    behind = inset(*(at(line, min(STOP_LINE_M, line.length_m)) for line in ahead))
    return [before, behind]
