"""Shared ground: lanes that overlap keep their centre lines, and share what they have in common along its middle."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import shapely

from interplan_sumo.maps.importers.cross_sections import SPACING_M, largest, sound
from interplan_sumo.maps.rules import overlapping
from interplan_sumo.world.geometry import Floats, Polyline
from interplan_sumo.world.roads import DrivingSide, Lane

_SAME_LINE_M = 0.3
"""Centre lines so close to each other are one: each direction keeps the side on which one drives."""
_BESIDE_M = 15.0
"""Further than any lane is wide."""
_BEYOND_M = 3.0
"""How far the divide reaches beyond the lane that it follows."""
_GAP_M = 0.002
_LEAST_SHARE = 0.1
"""A lane of which less would be left keeps to itself, for `clipped` to decide."""


def divided(lanes: Mapping[str, Lane], side: DrivingSide) -> dict[str, shapely.Polygon]:
    """The surfaces of lanes that overlap, each without the far side of the middle between their centre lines."""
    ids = list(lanes)
    shapes = np.array([lanes[id_].polygon for id_ in ids], dtype=object)
    found: dict[str, shapely.Polygon] = {}
    for i, j, _ in sorted(overlapping(shapes)):
        one, other = lanes[ids[i]], lanes[ids[j]]
        middle, offset_m = _between(one.centerline, other.centerline)
        if abs(offset_m) < _SAME_LINE_M:
            against = not one.centerline.runs_with(_part_near(other.centerline, one.centerline))
            if not against:
                continue  # twins that do not part: no line divides them
            offset_m = -1.0 if side == "right" else 1.0
        beyond = shapely.buffer(middle, -np.sign(offset_m) * _BESIDE_M, single_sided=True, join_style="mitre")
        within = shapely.buffer(middle, np.sign(offset_m) * _BESIDE_M, single_sided=True, join_style="mitre")
        grown = _GAP_M / 2.0
        for lane, foe, away in ((one, other, beyond), (other, one, within)):
            before = found.get(lane.id, lane.polygon)
            common = shapely.intersection(shapely.buffer(foe.polygon, grown), shapely.buffer(away, grown))
            rest = sound(largest(shapely.difference(before, common)))
            if rest.area > _LEAST_SHARE * lane.polygon.area:
                found[lane.id] = rest
    return found


def _between(line: Polyline, other: Polyline) -> tuple[shapely.LineString, float]:
    """The middle between a line and another beside it, and how far the line lies to the left of that in the mean.

    The middle runs with `line`, and on beyond its ends.
    """
    count = max(2, int(np.ceil(line.length_m / SPACING_M)))
    poses = line.poses_at(np.linspace(0.0, line.length_m, count))
    places = shapely.points(poses[:, :2])
    foe = other.linestring
    shapely.prepare(foe)  # else each place is held against every vertex: minutes for two motorways on the same ground
    near = shapely.get_coordinates(shapely.shortest_line(foe, places))[::2]
    normal = np.stack((-np.sin(poses[:, 2]), np.cos(poses[:, 2])), axis=1)
    beside_m = ((near - poses[:, :2]) * normal).sum(axis=1)  # across only: beyond its end the other line lies behind
    points: Floats = poses[:, :2] + normal * beside_m[:, None] / 2.0
    ends = np.stack((np.cos(poses[[0, -1], 2]), np.sin(poses[[0, -1], 2])), axis=1) * _BEYOND_M
    points = np.concatenate((points[:1] - ends[:1], points, points[-1:] + ends[1:]))
    return shapely.LineString(points), -float(np.median(beside_m)) / 2.0


def _part_near(other: Polyline, line: Polyline) -> Polyline:
    """The part of a line that lies beside another one."""
    arcs = sorted(float(shapely.line_locate_point(other.linestring, shapely.Point(p))) for p in line.points[[0, -1]])
    return other.between(*arcs) if arcs[1] - arcs[0] > SPACING_M else other
