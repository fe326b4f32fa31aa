"""Goals of interPlan's scenarios: a point on a lane, or the way that turns to one side at every junction."""

from __future__ import annotations

from collections import deque
from math import pi
from typing import Final

from interplan_sumo.errors import ScenarioError
from interplan_sumo.scenario.original import GoalSide, Original, Point
from interplan_sumo.scenario.recorded import END_M, floored_m
from interplan_sumo.scenario.scenario import LanePosition
from interplan_sumo.world.geometry import wrap_angle
from interplan_sumo.world.roads import Lane, Roads

TURN_RAD: Final[dict[GoalSide, float]] = {"left": pi / 2.0, "straight": 0.0, "right": -pi / 2.0}
UNKNOWN_LIMIT_MPS: Final = 15.0
"""interPlan's, for lanes without a limit."""
FARTHEST_M: Final = 300.0
"""Goals beyond this from the ego are not looked for, as in interPlan."""
NEAR_M: Final = 20.0
"""A goal point this far from every lane is none."""


def way_to_goal(
    original: Original, roads: Roads, start: LanePosition, logged: tuple[str, ...], duration_s: float
) -> tuple[tuple[str, ...], LanePosition]:
    """Route and goal of a scenario whose name asks for a goal side.

    `logged` are the roadblocks that were driven: a way without a goal point
    has as many. ScenarioError if there is no such way.
    """
    if original.goal_point is not None:
        return _to_point(original.name, roads, start, original.goal_point)
    if original.letters.goal is None:
        raise ValueError(f"{original.name} asks for no goal")
    return _turning(original, roads, start, TURN_RAD[original.letters.goal], len(logged), duration_s)


def _to_point(name: str, roads: Roads, start: LanePosition, point: Point) -> tuple[tuple[str, ...], LanePosition]:
    """The fewest roadblocks to the lane at a point."""
    lane = _lane_at(name, roads, point)
    here = start.pose(roads)
    if abs(point[0] - here.x_m) > FARTHEST_M or abs(point[1] - here.y_m) > FARTHEST_M:
        raise ScenarioError(f"{name}: the goal {_said(point)} lies more than {FARTHEST_M:g} m from the ego")
    route = _fewest(roads, roads[start.lane].roadblock_id, roads[lane].roadblock_id)
    if route is None:
        raise ScenarioError(f"{name}: no way leads from lane {start.lane} to the goal {_said(point)} on lane {lane}")
    arc_m = roads[lane].centerline.project_point(*point)[0]
    return route, LanePosition(lane, floored_m(arc_m))


def _lane_at(name: str, roads: Roads, point: Point) -> str:
    """The lane that holds a point, else the nearest one."""
    inside = roads.lanes_at(*point)
    near = inside or [lane for lane in roads.lanes_near(*point, NEAR_M) if isinstance(roads[lane], Lane)]
    if not near:
        raise ScenarioError(f"{name}: no lane lies within {NEAR_M:g} m of the goal {_said(point)}; is this the map?")
    return min(near, key=lambda lane: (abs(roads[lane].centerline.project_point(*point)[1]), lane))


def _fewest(roads: Roads, first: str, last: str) -> tuple[str, ...] | None:
    """The shortest chain of roadblocks by number, breadth first."""
    before: dict[str, str | None] = {first: None}
    queue = deque([first])
    while queue:
        block = queue.popleft()
        if block == last:
            chain = [block]
            while (previous := before[chain[-1]]) is not None:
                chain.append(previous)
            return tuple(reversed(chain))
        for after in roads.outgoing_roadblocks(block):
            if after not in before:
                before[after] = block
                queue.append(after)
    return None


def _turning(
    original: Original, roads: Roads, start: LanePosition, turn_rad: float, count: int, duration_s: float
) -> tuple[tuple[str, ...], LanePosition]:
    """At every fork the roadblock that turns most nearly as wanted, as many as were driven, up to what is in reach.

    The goal is the end of the rightmost lane of the last roadblock that can be
    reached at the limits in the time of the scenario.
    """
    route = [roads[start.lane].roadblock_id]
    left_s = duration_s - _time_s(roads, route[0])
    while (len(route) < count or roads.roadblocks[route[-1]].is_connector) and (
        left_s > 0.0 or roads.roadblocks[route[-1]].is_connector
    ):
        ways = [block for block in roads.outgoing_roadblocks(route[-1]) if block not in route and _lanes(roads, block)]
        if not ways:
            break
        here_rad = _end_rad(roads, route[-1])
        route.append(
            min(ways, key=lambda block: (abs(float(wrap_angle(_end_rad(roads, block) - here_rad - turn_rad))), block))
        )
        left_s -= _time_s(roads, route[-1])
    while route and roads.roadblocks[route[-1]].is_connector:
        route.pop()
    if not route:
        raise ScenarioError(f"{original.name}: the ego starts on a connector that leads nowhere")
    lane = roads.roadblocks[route[-1]].lane_ids[-1]
    length_m = roads[lane].centerline.length_m
    return tuple(route), LanePosition(lane, floored_m(length_m - min(END_M, length_m / 2.0)))


def _lanes(roads: Roads, block: str) -> tuple[str, ...]:
    return roads.roadblocks[block].lane_ids


def _end_rad(roads: Roads, block: str) -> float:
    """The heading at the end of the first lane."""
    return float(roads[_lanes(roads, block)[0]].centerline.segment_heading_rad[-1])


def _time_s(roads: Roads, block: str) -> float:
    """How long the first lane takes at its limit."""
    lane = roads[_lanes(roads, block)[0]]
    return lane.centerline.length_m / (lane.speed_limit_mps or UNKNOWN_LIMIT_MPS)


def _said(point: Point) -> str:
    return f"({point[0]:.2f}, {point[1]:.2f})"
