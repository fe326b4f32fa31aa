"""Map lines: the lanes, stop lines and crosswalks of a map as polylines, cut and sampled once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import ceil

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.features.frame import EgoFrame, nearest
from interplan_sumo.features.schema import LANE_POINTS, LINE_POINTS, PIECE_M, RADIUS_M
from interplan_sumo.world.geometry import Floats, Ints, Polyline
from interplan_sumo.world.roads import USUAL_LIMIT_MPS, LaneLike, Roads


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """P pieces of lanes and connectors, by lane id and then in driving order."""

    lane: Ints
    """(P,) row of the lane in `MapLines.lane_ids`."""
    start_m: Floats
    """(P,) arc length of the first point on the lane."""
    poses: Floats
    """(P, 50, 3) x, y, heading."""
    half_width_m: Floats
    """(P, 50)"""
    left: Floats
    """(P, 20, 2)"""
    right: Floats
    """(P, 20, 2)"""


@dataclass(frozen=True, slots=True, eq=False)
class Outlines:
    """A areas of one kind, in map order."""

    points: Floats
    """(A, 20, 2) equally spaced along the outline, counter-clockwise."""
    tree: shapely.STRtree
    """Of their polygons."""


@dataclass(frozen=True, slots=True, eq=False)
class MapLines:
    """A map in its own frame. Ids are integers; connectors are lanes here, too."""

    lane_ids: Ints
    """(L,) in increasing order."""
    limit_mps: Floats
    """(L,)"""
    pieces: Pieces
    tree: shapely.STRtree
    """Of the pieces' centre lines."""
    stop_lines: Outlines
    crosswalks: Outlines

    def pieces_near(self, frame: EgoFrame, count: int, among: NDArray[np.bool_] | None = None) -> Ints:
        """The `count` nearest pieces within `RADIUS_M`, the nearest first; `among` (P,) leaves some out."""
        return _near(self.tree, frame, count, among)


@lru_cache(maxsize=8)
def map_lines(roads: Roads) -> MapLines:
    """The lines of a map, from a small cache: the first call takes a second or two."""
    lanes: list[LaneLike] = sorted((*roads.lanes.values(), *roads.connectors.values()), key=lambda lane: int(lane.id))
    counts = [max(1, ceil(lane.centerline.length_m / PIECE_M - 1e-9)) for lane in lanes]
    cut = [_cut(lane, count) for lane, count in zip(lanes, counts, strict=True)]
    arc_m, poses, half_width, left, right = (np.concatenate(column) for column in zip(*cut, strict=True))
    pieces = Pieces(np.repeat(np.arange(len(lanes)), counts), arc_m[:, 0], poses, half_width, left, right)
    return MapLines(
        np.array([int(lane.id) for lane in lanes], dtype=np.int64),
        np.array([USUAL_LIMIT_MPS if lane.speed_limit_mps is None else lane.speed_limit_mps for lane in lanes]),
        pieces,
        shapely.STRtree(np.asarray(shapely.linestrings(poses[..., :2]))),
        _outlines([line.polygon for line in roads.stop_lines.values()]),
        _outlines([area.polygon for area in roads.crosswalks]),
    )


def areas_near(outlines: Outlines, frame: EgoFrame, count: int) -> Floats:
    """(up to `count`, 20, 2) outlines within `RADIUS_M` in the ego frame, the nearest first."""
    return frame.points(outlines.points[_near(outlines.tree, frame, count)])


def _near(tree: shapely.STRtree, frame: EgoFrame, count: int, among: NDArray[np.bool_] | None = None) -> Ints:
    point = shapely.Point(frame.x_m, frame.y_m)
    rows = tree.query(point, predicate="dwithin", distance=RADIUS_M)
    if among is not None:
        rows = rows[among[rows]]
    distance_m = shapely.distance(tree.geometries[rows], point)
    return rows[nearest(distance_m, rows, count)]


def _cut(lane: LaneLike, count: int) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """A lane in K equal pieces: (K, 50) arcs, (K, 50, 3) poses, (K, 50) half widths, twice (K, 20, 2) boundaries."""
    line = lane.centerline
    ends_m = np.linspace(0.0, line.length_m, count + 1)
    arc_m = np.linspace(ends_m[:-1], ends_m[1:], LANE_POINTS, axis=1)
    poses = line.poses_at(arc_m.ravel())
    half_width = sum(np.abs(side.project(poses[:, :2])[1]) for side in (lane.left_boundary, lane.right_boundary)) / 2.0
    ends = line.poses_at(ends_m)[:, :2]
    left, right = (_boundary(side, ends) for side in (lane.left_boundary, lane.right_boundary))
    return arc_m, poses.reshape(count, LANE_POINTS, 3), np.reshape(half_width, (count, LANE_POINTS)), left, right


def _boundary(side: Polyline, ends: Floats) -> Floats:
    """(P, 20, 2) a boundary, cut beside the ends (P + 1, 2) of pieces; all of it is used."""
    cuts_m, _ = side.project(ends)
    cuts_m[0], cuts_m[-1] = 0.0, side.length_m
    arc_m = np.linspace(cuts_m[:-1], cuts_m[1:], LINE_POINTS, axis=1)
    return side.poses_at(arc_m.ravel())[:, :2].reshape(len(ends) - 1, LINE_POINTS, 2)


def _outlines(polygons: list[shapely.Polygon]) -> Outlines:
    rings = [Polyline(np.asarray(shapely.orient_polygons(each).exterior.coords)[:, :2]) for each in polygons]
    shares = np.linspace(0.0, 1.0, LINE_POINTS, endpoint=False)
    points = [ring.poses_at(shares * ring.length_m)[:, :2] for ring in rings]
    return Outlines(np.array(points).reshape(-1, LINE_POINTS, 2), shapely.STRtree(polygons))
