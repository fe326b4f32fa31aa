"""The interPlan paper's IDM+MOBIL as its code has it, faults included, so that the paper's row can be compared."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import cos, hypot, sin

import numpy as np
import shapely

from interplan_planners.common.corridor import Corridor
from interplan_planners.common.frozen_world import FrozenObstacle, IdmDecision, obstacles, roll_out
from interplan_planners.common.idm_policy import IdmDriver, idm_step
from interplan_planners.common.paths import braking_plan, centerline
from interplan_planners.common.route_search import lane_chain, lanes_of_route, starting_lane
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import Polyline, Pose, box_corners, wrap_angle
from interplan_sumo.world.roads import Lane, Roads
from interplan_sumo.world.trajectory import Trajectory

FARTHEST_FROM_PATH_M = 2.0
"""Beyond this the ego has lost its path; a plan from the path would be a teleport."""
# nuPlan's IDM planner: 16 samples of 0.5 s, actors within 40 m.
SAMPLES, STEP_S, RADIUS_M = 16, 0.5, 40.0
DRIVER = IdmDriver(target_speed_mps=10.0)
"""nuPlan's IDM planner; the target speed holds where the map knows no limit."""
POLITENESS, THRESHOLD_MPS2 = 0.5, 0.2
SETTLED_M, SETTLED_RAD = 0.5, 0.1
"""On the objective lane: the centre this near to its line, and turned no more."""
STRAIGHT_ON_S, ACROSS_S, LEAST_ACROSS_M = 0.5, 1.0, 1.0
"""The path of a change: straight on, then a straight line to a point this far ahead on the new lane."""
SPACING_M = 0.5
SLOW_MPS = 1.0
"""A change whose way is barred by something slower is given up."""
PHANTOM_AHEAD_M = 10.0
SWEEP_S = 3.0
"""How far other cars are carried on to see whether they follow."""
TOUCHING_BRAKING_GAP_M = 1.0
"""Below this gap on the new lane the ego is taken to brake as hard as it can."""


@dataclass(frozen=True, slots=True, eq=False)
class _Lead:
    gap_m: float
    speed_mps: float


class PublishedMobil:
    """nuPlan's IDM on a path that MOBIL changes; a planner like any other.

    What it does wrong, and what is kept:

    - the accelerations that followers have now are divided by a time in
      microseconds, so that they count as 0;
    - there is no safety criterion: a change may make a follower brake at will;
    - cars are carried on with a velocity that is turned by their heading once
      more, so that followers are found only on roads that head east;
    - the change is a straight line across, one second of travel long, after
      half a second straight on: a swerve;
    - a change that is given up for an obstacle leaves the objective lane at the
      neighbour, so that no other change is tried before the next roadblock;
    - red lights do not bar a change;
    - the way to the goal is no part of the incentive: lanes that need more
      changes are ruled out, that is all.

    If a change that the route needs is refused, from the next step on a phantom
    car 10 m ahead slows the ego the more, the less of the lane is left; it also
    makes the next lane look better.
    """

    def __init__(self) -> None:
        self.decision: IdmDecision | None = None

    def start(self, mission: Mission) -> None:
        self._mission = mission
        self._route_lanes = lanes_of_route(mission.roads, mission.route)
        self._costs = lane_costs(mission.roads, mission.route, mission.goal)
        self._corridor: Corridor | None = None
        self._objective = ""
        self._block = -1
        self._pushes = False
        self.decision = None

    def plan(self, observation: Observation) -> Trajectory:
        ego, shape = observation.ego, self._mission.shape
        index, lane_id = starting_lane(self._mission.roads, self._mission.route, ego, shape)
        if self._corridor is None:
            self._follow(index, lane_id, ego)
        if index != self._block:  # a new roadblock: whatever was wanted on the last one is over
            self._block, self._objective = index, lane_id
        corridor = self._corridor
        lane = self._mission.roads.lanes.get(lane_id)
        phantom = None
        if corridor is not None and lane is not None and self._pushes:
            phantom = self._phantom(lane, ego, corridor.path)
        self._pushes = False
        if corridor is not None and lane is not None and self._settled(ego):
            self._pushes = self._decide(observation, index, lane, corridor, phantom)
        corridor = self._corridor
        progress_m, left_m = corridor.path.project_point(ego.x_m, ego.y_m) if corridor is not None else (0.0, np.inf)
        if corridor is None or abs(left_m) > FARTHEST_FROM_PATH_M:
            self.decision = None
            return braking_plan(ego, self._driver.max_deceleration_mps2, SAMPLES * STEP_S, STEP_S)
        found = obstacles(observation, corridor, self._mission.roads, self._route_lanes, shape, RADIUS_M)
        if phantom is not None:
            found.append(phantom)
        plan, self.decision = roll_out(ego, progress_m, found, corridor.path, self._driver, SAMPLES, STEP_S, shape)
        return plan

    def _follow(self, index: int, lane_id: str, ego: EgoState, start: Polyline | None = None) -> None:
        """Take the path from a lane on, after `start` if there is one, and a target speed anew."""
        roads = self._mission.roads
        limit_mps = roads[lane_id].speed_limit_mps or DRIVER.target_speed_mps
        self._driver = replace(DRIVER, target_speed_mps=max(limit_mps, abs(ego.speed_mps)))
        line = centerline(roads, lane_chain(roads, self._mission.route, index, lane_id))
        if start is not None:
            joins_m = line.project_point(*start.points[-1].tolist())[0]
            rest = line.points[line.arc_m > joins_m + SPACING_M]
            line = Polyline(np.concatenate((start.points, rest)))
        self._corridor = Corridor(line, self._mission.shape.width_m / 2)

    def _settled(self, ego: EgoState) -> bool:
        line = self._mission.roads[self._objective].centerline
        arc_m, left_m = line.project_point(ego.x_m, ego.y_m)
        turned = wrap_angle(line.pose_at(arc_m).heading_rad - ego.heading_rad)
        return abs(left_m) <= SETTLED_M and abs(turned) <= SETTLED_RAD

    # --- MOBIL ---------------------------------------------------------------------------------

    def _decide(
        self, observation: Observation, index: int, lane: Lane, corridor: Corridor, phantom: FrozenObstacle | None
    ) -> bool:
        """Change the path if a neighbour is worth it; whether one is needed and none is."""
        roads, ego = self._mission.roads, observation.ego
        cost = self._costs.get(lane.id, 0)
        neighbours = [n for n in (roads.left_of(lane.id), roads.right_of(lane.id)) if n is not None]
        allowed = [n for n in neighbours if self._costs.get(n.id, 0) <= cost]
        if not allowed:
            return False
        weighed = [(self._incentive(observation, index, n, corridor, phantom), n) for n in allowed]
        incentive, best = max(weighed, key=lambda pair: pair[0])
        if incentive >= THRESHOLD_MPS2:
            self._objective = best.id  # even if the change is given up now
            way = _swerve(best, ego)
            if not self._barred(observation, way):
                self._follow(index, best.id, ego, way)
            return False
        return any(self._costs.get(n.id, 0) < cost for n in allowed)

    def _incentive(
        self, observation: Observation, index: int, lane: Lane, corridor: Corridor, phantom: FrozenObstacle | None
    ) -> float:
        roads, ego, shape = self._mission.roads, observation.ego, self._mission.shape
        there = Corridor(centerline(roads, lane_chain(roads, self._mission.route, index, lane.id)), shape.width_m / 2)
        old, new = self._lead(observation, corridor, phantom), self._lead(observation, there)
        if new.gap_m <= 0.0:
            return 0.0
        speed_mps = max(ego.speed_mps, 0.0)
        before = self._change_of_speed(speed_mps, old)
        after = self._change_of_speed(speed_mps, new)
        if new.gap_m < TOUCHING_BRAKING_GAP_M:
            after = -self._driver.max_deceleration_mps2
        arc_m, _ = there.path.project_point(ego.x_m, ego.y_m)
        others = 0.0
        new_follower = self._follower(observation, there.path.pose_at(arc_m))
        if new_follower is not None:  # its acceleration now counts as 0
            gap_m, follower_mps = new_follower
            others += self._change_of_speed(follower_mps, _Lead(gap_m, speed_mps))
        old_follower = self._follower(observation, ego.pose)
        if old_follower is not None:
            gap_m, follower_mps = old_follower
            freed = _Lead(gap_m + shape.length_m + old.gap_m, old.speed_mps)
            others += self._change_of_speed(follower_mps, freed)
        return after - before + POLITENESS * others

    def _change_of_speed(self, speed_mps: float, lead: _Lead) -> float:
        """Acceleration over one Euler step of the planner."""
        _, later_mps = idm_step(self._driver, speed_mps, lead.gap_m, lead.speed_mps, STEP_S)
        return (later_mps - speed_mps) / STEP_S

    def _lead(self, observation: Observation, corridor: Corridor, phantom: FrozenObstacle | None = None) -> _Lead:
        ego, shape = observation.ego, self._mission.shape
        arc_m, _ = corridor.path.project_point(ego.x_m, ego.y_m)
        pose = corridor.path.pose_at(arc_m)
        box = shapely.Polygon(box_corners(pose.x_m, pose.y_m, pose.heading_rad, shape.length_m, shape.width_m)[0])
        found = obstacles(observation, corridor, self._mission.roads, self._route_lanes, shape, RADIUS_M)
        ahead = [o for o in found if any(end >= arc_m for _, end in o.occupied_m)]
        ahead += [phantom] if phantom is not None else []
        if not ahead:
            return _Lead(corridor.path.length_m - arc_m - shape.length_m / 2, 0.0)
        gaps_m = shapely.distance(box, [o.shape for o in ahead])
        first = int(np.argmin(gaps_m))
        along_mps = ahead[first].speed_mps * cos(ahead[first].heading_rad - pose.heading_rad)
        return _Lead(float(gaps_m[first]), along_mps)

    def _follower(self, observation: Observation, pose: Pose) -> tuple[float, float] | None:
        """Gap and speed of the nearest car behind whose box, carried on, meets the ego's at a pose, carried on."""
        ego, actors, shape = observation.ego, observation.actors, self._mission.shape
        c, s = cos(pose.heading_rad), sin(pose.heading_rad)
        dx, dy = actors.x_m - pose.x_m, actors.y_m - pose.y_m
        behind = (dx * c + dy * s < 0.0) & (np.hypot(dx, dy) < RADIUS_M) & (actors.kind == 0)
        rows = np.flatnonzero(behind)
        if not rows.size:
            return None
        here = box_corners(pose.x_m, pose.y_m, pose.heading_rad, shape.length_m, shape.width_m)[0]
        way_m = max(ego.speed_mps, 0.0) * SWEEP_S
        own = shapely.convex_hull(shapely.multipoints(np.concatenate((here, here + way_m * np.array((c, s))))))
        turn_c, turn_s = np.cos(actors.heading_rad[rows]), np.sin(actors.heading_rad[rows])
        vx, vy = actors.vx_mps[rows], actors.vy_mps[rows]
        # the velocity is global already; turning it once more is the published fault
        carried = SWEEP_S * np.stack((turn_c * vx - turn_s * vy, turn_s * vx + turn_c * vy), axis=1)
        corners = actors.corners[rows]
        swept = np.concatenate((corners, corners + carried[:, None, :]), axis=1)
        meets = np.flatnonzero(shapely.intersects(shapely.convex_hull(shapely.multipoints(swept)), own))
        if not meets.size:
            return None
        gaps_m = shapely.distance(actors.polygons[rows[meets]], shapely.Polygon(here))
        nearest = int(np.argmin(gaps_m))
        return float(gaps_m[nearest]), float(actors.speed_mps[rows[meets[nearest]]])

    def _barred(self, observation: Observation, way: Polyline) -> bool:
        """Whether something slow stands where the ego would pass over."""
        actors, shape = observation.actors, self._mission.shape
        slow = np.flatnonzero(actors.speed_mps < SLOW_MPS)
        return bool(slow.size) and bool(Corridor(way, shape.width_m / 2).occupied_m(actors.polygons[slow]))

    def _phantom(self, lane: Lane, ego: EgoState, path: Polyline) -> FrozenObstacle:
        """A car 10 m ahead on the path that is the slower, the less of the lane is left where it is."""
        shape = self._mission.shape
        pose = path.pose_at(path.project_point(ego.x_m, ego.y_m)[0] + PHANTOM_AHEAD_M)
        left_m = lane.centerline.length_m - lane.centerline.project_point(pose.x_m, pose.y_m)[0]
        speed_mps = self._driver.target_speed_mps * left_m / lane.centerline.length_m
        corners = box_corners(pose.x_m, pose.y_m, pose.heading_rad, shape.length_m, shape.width_m)[0]
        return FrozenObstacle("phantom", shapely.Polygon(corners), speed_mps, pose.heading_rad, (), leads=True)


def lane_costs(roads: Roads, route: tuple[str, ...], goal: Pose) -> dict[str, int]:
    """For each lane of the route: how many lanes away the nearest is that leads on along the route.

    On the last block that is the lane of the goal (each, if none contains it).
    Where all lanes of a block lead on, each has the cost of the one it leads to.
    """
    costs: dict[str, int] = {}
    for i in range(len(route) - 1, -1, -1):
        block = roads.roadblocks[route[i]]
        lanes = block.lane_ids
        if i == len(route) - 1:
            leading = [lane for lane in lanes if roads[lane].polygon.contains(shapely.Point(goal.x_m, goal.y_m))]
            leading = leading or list(lanes)
        else:
            leading = [
                lane for lane in lanes if any(roads[out].roadblock_id == route[i + 1] for out in roads.outgoing(lane))
            ]
        here = {lane: min((abs(k - lanes.index(j)) for j in leading), default=0) for k, lane in enumerate(lanes)}
        if i + 1 < len(route) and not any(here.values()):
            for lane in lanes:
                next_costs = [costs[out] for out in roads.outgoing(lane) if out in costs]
                here[lane] = min(next_costs, default=0)
        costs |= here
    return costs


def _swerve(lane: Lane, ego: EgoState) -> Polyline:
    """Straight on, then straight over to the neighbour lane."""
    speed_mps = max(ego.speed_mps, 0.0)
    c, s = cos(ego.heading_rad), sin(ego.heading_rad)
    turn_x, turn_y = ego.x_m + STRAIGHT_ON_S * speed_mps * c, ego.y_m + STRAIGHT_ON_S * speed_mps * s
    arc_m, _ = lane.centerline.project_point(ego.x_m, ego.y_m)
    arrives = lane.centerline.pose_at(arc_m + max(ACROSS_S * speed_mps, LEAST_ACROSS_M))
    points = np.array(((ego.x_m, ego.y_m), (turn_x, turn_y), (arrives.x_m, arrives.y_m)))
    return Polyline(points[np.concatenate(([True], [hypot(*d) > 1e-6 for d in np.diff(points, axis=0)]))]).resampled(
        SPACING_M
    )
