"""Did the streets of a file stay streets, and where they were? The lanes of an imported map against the file's."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.maps.importers.lane_segments import JOINT_M
from interplan_sumo.maps.importers.lines import mean_length_m
from interplan_sumo.maps.importers.record import LaneOrigin
from interplan_sumo.maps.importers.source import SourceLane, SourceMap
from interplan_sumo.maps.problem import MapProblem
from interplan_sumo.maps.rules import lane_layer
from interplan_sumo.world.geometry import Floats, Polyline, hausdorff_m, wrap_angle
from interplan_sumo.world.roads import LaneLike, Roads

MAX_DEVIATION_M, P99_DEVIATION_M = 0.35, 0.2
"""No centre line outside intersections lies further from the file's, nor one vertex in a hundred of all together."""
MAX_LOST_SHARE = 0.03
"""So much of the streets of a file that names its intersections may become connectors."""
STUB_M, MAX_STUB_SHARE = 5.0, 0.02
"""So many of the lanes may be shorter than a car, unless the file's are, too."""
_STEP_M = 0.25
_REACH_M = 3.0
_SAME_WAY_RAD = np.radians(45.0)
_ALIKE_M = 0.05
_DRAWING_M = 0.01


@dataclass(frozen=True, slots=True)
class Deviation:
    """How far the vertices of some centre lines lie from those of the file that run the same way."""

    p50: float
    p99: float
    max: float

    @classmethod
    def of(cls, found_m: Iterable[Floats]) -> Deviation:
        """0 where there are none."""
        values = np.concatenate([np.zeros(0), *found_m])
        if not values.size:
            return cls(0.0, 0.0, 0.0)
        return cls(*(float(value) for value in (*np.percentile(values, (50, 99)), values.max())))


@dataclass(frozen=True, slots=True)
class StreetReport:
    """What became of the streets of a file: of its lanes outside what it calls intersections."""

    names_intersections: bool
    """Whether the file tells which lanes lie in intersections; if not, all count as streets, and no bar holds."""
    street_km: float
    lost_share: float
    """Of the length of these lanes what lies in no lane of the map: it became connectors."""
    stubs: int
    """Lanes of the map shorter than a car that are cut from longer ones of the file."""
    stub_share: float
    """Of all lanes."""
    deviation_m: Deviation
    """Of centre lines outside intersections."""
    junction_deviation_m: Deviation
    """Of the others, which are drawn so that a car can follow."""


def compare_streets(
    roads: Roads, origins: Mapping[str, Sequence[LaneOrigin]], source: SourceMap, file: str
) -> tuple[StreetReport, tuple[MapProblem, ...]]:
    """The streets of an imported map against those of its file, and what misses a bar."""
    knows = any(lane.in_intersection for lane in source.lanes.values())
    street_m, lost_m = _lost(roads, source)
    stubs = [key for key in roads.lanes if _is_stub(roads.lanes[key], origins.get(key, ()), source.lanes)]
    on_streets, within = _deviations(roads, origins, source, knows=knows)
    report = StreetReport(
        names_intersections=knows,
        street_km=street_m / 1000.0,
        lost_share=lost_m / street_m if street_m > 0.0 else 0.0,
        stubs=len(stubs),
        stub_share=len(stubs) / max(1, len(roads.lanes)),
        deviation_m=Deviation.of(on_streets.values()),
        junction_deviation_m=Deviation.of(within.values()),
    )
    return report, tuple(_problems(report, stubs, on_streets, roads, file))


def _problems(
    report: StreetReport, stubs: Sequence[str], on_streets: Mapping[str, Floats], roads: Roads, file: str
) -> Iterable[MapProblem]:
    for key, off_m in on_streets.items():
        if off_m.max() > MAX_DEVIATION_M:
            said = f"its centre line lies up to {off_m.max():.2f} m off the file's"
            yield MapProblem("deviation", lane_layer(roads[key]), key, said)
    if report.deviation_m.p99 > P99_DEVIATION_M:
        said = f"one vertex in a hundred lies {report.deviation_m.p99:.2f} m or more off the file's centre lines"
        yield MapProblem("deviation", "file", file, said)
    if report.names_intersections and report.lost_share > MAX_LOST_SHARE:
        said = f"{report.lost_share:.1%} of its streets became connectors"
        yield MapProblem("street", "file", file, said)
    if report.names_intersections and report.stub_share > MAX_STUB_SHARE:
        for key in stubs:
            length_m = roads.lanes[key].centerline.length_m
            said = f"is {length_m:.1f} m long, cut from a longer lane of the file"
            yield MapProblem("street", lane_layer(roads[key]), key, said)


# --- what became connectors ------------------------------------------------------------------------


def _lost(roads: Roads, source: SourceMap) -> tuple[float, float]:
    """The length of the file's streets, and how much of it lies in no lane of the map."""
    surfaces = np.asarray(shapely.buffer([lane.polygon for lane in roads.lanes.values()], _DRAWING_M))
    shapely.prepare(surfaces)  # or every point costs as much as its lane has vertices
    tree = shapely.STRtree(surfaces)
    street_m = lost_m = 0.0
    for lane in source.lanes.values():
        if lane.in_intersection:
            continue
        length_m = mean_length_m(lane.left, lane.right)
        count = max(1, int(np.ceil(length_m / _STEP_M)))
        points = np.asarray(shapely.points(_middle(lane, (np.arange(count) + 0.5) / count)))
        here, there = tree.query(points)
        inside = np.zeros(count, dtype=np.bool_)
        inside[here[shapely.intersects(surfaces[there], points[here])]] = True
        street_m += length_m
        lost_m += length_m * float((~inside).mean())
    return street_m, lost_m


def _is_stub(lane: LaneLike, rows: Sequence[LaneOrigin], lanes: Mapping[str, SourceLane]) -> bool:
    if lane.centerline.length_m >= STUB_M:
        return False
    own = [lanes[row.source_id] for row in rows if row.source_id in lanes]
    return all(mean_length_m(each.left, each.right) > STUB_M + 2.0 * JOINT_M for each in own)


# --- where centre lines lie ------------------------------------------------------------------------


def _middle(lane: SourceLane, shares: Floats) -> Floats:
    """(N, 2) the points half-way between the boundaries of a lane, at shares of their lengths."""
    sides = [Polyline(points) for points in (lane.left, lane.right)]
    left, right = (side.poses_at(shares * side.length_m)[:, :2] for side in sides)
    return (left + right) / 2.0


def _middles(lane: SourceLane) -> list[Floats]:
    """The middle of a lane by the lengths of its boundaries, and by their vertices where that is something else."""
    length_m = mean_length_m(lane.left, lane.right)
    count = max(2, int(np.ceil(length_m / (2.0 * _STEP_M))) + 1)
    by_length = _middle(lane, np.linspace(0.0, 1.0, count))
    if len(lane.left) != len(lane.right):
        return [by_length]
    by_vertex = (lane.left + lane.right) / 2.0
    return [by_length] if hausdorff_m(by_length, by_vertex) < _ALIKE_M else [by_length, by_vertex]


def _deviations(
    roads: Roads, origins: Mapping[str, Sequence[LaneOrigin]], source: SourceMap, *, knows: bool
) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """How far every vertex of a centre line lies from the file's, by lane or connector: outside intersections, within.

    Compared with lines that run the same way; nothing is further than `_REACH_M`.
    """
    segments, heading_rad = _segments(source)
    tree = shapely.STRtree(segments)
    on_streets: dict[str, Floats] = {}
    within: dict[str, Floats] = {}
    for lane in (*roads.lanes.values(), *roads.connectors.values()):
        own = [source.lanes[row.source_id] for row in origins.get(lane.id, ()) if row.source_id in source.lanes]
        street = lane.id in roads.lanes or (knows and not any(each.in_intersection for each in own))
        points = np.asarray(shapely.points(lane.centerline.points))
        here, there = tree.query(points, predicate="dwithin", distance=_REACH_M)
        same = np.abs(wrap_angle(lane.centerline.vertex_heading_rad[here] - heading_rad[there])) < _SAME_WAY_RAD
        here, there = here[same], there[same]
        off_m = np.full(len(points), _REACH_M)
        np.minimum.at(off_m, here, shapely.distance(points[here], segments[there]))
        (on_streets if street and own else within)[lane.id] = off_m
    return on_streets, within


def _segments(source: SourceMap) -> tuple[NDArray[np.object_], Floats]:
    """The middles of all lanes of a file in segments, with the heading of each."""
    lines = [line for lane in source.lanes.values() for line in _middles(lane)]
    both = np.concatenate([np.stack((line[:-1], line[1:]), axis=1) for line in lines])
    along = both[:, 1] - both[:, 0]
    real = np.hypot(along[:, 0], along[:, 1]) > 1e-6
    return np.asarray(shapely.linestrings(both[real])), np.arctan2(along[real, 1], along[real, 0])
