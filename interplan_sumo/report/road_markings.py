"""Road markings: the painted lines of a map, the stop bars of traffic lights, and what these show when."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import shapely

from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.geometry import Floats, Polyline, wrap_angle
from interplan_sumo.world.roads import Connector, Roads
from interplan_sumo.world.signals import SignalStatus
from interplan_sumo.world.trace import Trace


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


def goal_line(roads: Roads, scenario: Scenario) -> Floats:
    """(2, 2) the ends of the line across the lanes at the goal."""
    pose = scenario.goal.pose(roads)
    block = roads.roadblocks[roads[scenario.goal.lane].roadblock_id]
    lanes = [roads[lane_id] for lane_id in block.lane_ids]
    ends = [lanes[0].left_boundary.linestring, lanes[-1].right_boundary.linestring]
    here = shapely.Point(pose.x_m, pose.y_m)
    return np.concatenate([shapely.get_coordinates(shapely.shortest_line(here, end))[1:] for end in ends])


def stop_bars(roads: Roads, area: shapely.Geometry) -> dict[str, Floats]:
    """Of every connector with a traffic light whose way meets an area: the ends (2, 2) of its bar, the left one first.

    Connectors from one lane share the bar across its end, in the order in which they fan out, the leftmost first.
    """
    by_lane: dict[str, list[Connector]] = {}
    for connector in roads.connectors.values():
        if connector.has_traffic_light and shapely.intersects(area, connector.centerline.linestring):
            by_lane.setdefault(connector.from_lane_id, []).append(connector)
    found: dict[str, Floats] = {}
    for lane_id, connectors in by_lane.items():
        lane = roads.lanes[lane_id]
        left, right = lane.left_boundary.points[-1], lane.right_boundary.points[-1]
        heading_rad = float(lane.centerline.segment_heading_rad[-1])
        connectors.sort(key=lambda connector: -_bearing_rad(connector, heading_rad))
        for i, connector in enumerate(connectors):
            shares = np.array((i, i + 1))[:, None] / len(connectors)
            found[connector.id] = left + shares * (right - left)
    return found


def _bearing_rad(connector: Connector, heading_rad: float) -> float:
    """Where a connector leads, seen along the heading of the lane that it leaves; left positive."""
    away = connector.centerline.points[-1] - connector.centerline.points[0]
    return float(wrap_angle(np.arctan2(away[1], away[0]) - heading_rad))


def signal_changes(trace: Trace, connectors: Iterable[str]) -> dict[str, list[tuple[int, int]]]:
    """Of each connector that shows anything its changes: the frame, and the status from then on."""
    wanted = frozenset(connectors)
    found: dict[str, list[tuple[int, int]]] = {}
    for frame, seen in enumerate(trace.signals):
        for connector, status in zip(seen.connector_ids, seen.status.tolist(), strict=True):
            changes = found.setdefault(connector, []) if connector in wanted else None
            if changes is not None and (not changes or changes[-1][1] != status):
                changes.append((frame, status))
    return found


def status_at(changes: Sequence[tuple[int, int]], frame: int) -> SignalStatus:
    """The status of a connector in a frame, from its changes; unknown before the first."""
    return next((SignalStatus(status) for since, status in reversed(changes) if since <= frame), SignalStatus.UNKNOWN)
