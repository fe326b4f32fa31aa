"""Markings: the painted lines of a map, as pictures and replays draw them."""

from __future__ import annotations

import numpy as np
import shapely

from interplan_sumo.world.geometry import Polyline, wrap_angle
from interplan_sumo.world.roads import Roads


def markings(roads: Roads, area: shapely.Geometry) -> dict[str, list[Polyline]]:
    """Boundaries of lanes in an area: `dashed` between lanes, `solid` at the edges, `middle` between the directions."""
    found: dict[str, list[Polyline]] = {"dashed": [], "solid": [], "middle": []}
    for block in roads.roadblocks.values():
        if block.is_connector or not shapely.intersects(area, block.polygon):
            continue
        lanes = [roads.lanes[i] for i in block.lane_ids]
        found["dashed"] += [lane.right_boundary for lane in lanes[:-1]]
        for line, side in ((lanes[0].left_boundary, 1.0), (lanes[-1].right_boundary, -1.0)):
            found["middle" if _borders_on_oncoming(roads, line, side) else "solid"].append(line)
    return found


def _borders_on_oncoming(roads: Roads, line: Polyline, side: float) -> bool:
    """Whether a lane of opposite direction lies just beyond the middle of a boundary."""
    arc_m = line.length_m / 2.0
    there, heading_rad = line.pose_at(arc_m, 0.6 * side), line.pose_at(arc_m).heading_rad
    for lane_id in roads.lanes_at(there.x_m, there.y_m):
        other = roads[lane_id].centerline
        other_rad = other.pose_at(other.project_point(there.x_m, there.y_m)[0]).heading_rad
        if abs(wrap_angle(other_rad - heading_rad)) > np.pi / 2.0:
            return True
    return False
