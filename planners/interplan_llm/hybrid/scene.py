"""The scene as words can tell it: lanes and who is on them, what blocks them, who comes, lights, who may step out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import inf
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from interplan_planners.common.driven_route import DrivenRoute
from interplan_planners.common.forecast import constant_velocity
from interplan_planners.common.ground import Ground
from interplan_planners.common.lane_routes import LaneRoute
from interplan_planners.common.neighbours import STANDING_MPS, stands_for_good
from interplan_planners.common.occupancy import occupancy
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.geometry import Floats, wrap_angle
from interplan_sumo.world.signals import SignalStatus

AHEAD_M, BEHIND_M = 80.0, 40.0
"""How far along a lane others are told of (the published numbers)."""
LANE_HALF_WIDTH_M = 1.0
"""Whose box comes this near to a lane's centre line is on it."""
CLEARANCE_M: Final = 0.35
"""Kept to what is passed; the tracker cuts a decimetre off a shift."""
ONE_BLOCK_M = 14.0
"""Things that stand nearer to one another than this, along the road, are passed in one go."""
LIGHT_M = 60.0
"""A car that stands this near before a light that is not green is waiting for it."""
QUEUE_M = 10.0
"""A car that stands this near behind another that waits is waiting, too."""
ONCOMING_M, ONCOMING_COS, ONCOMING_ASIDE_M = 150.0, -0.7, 6.0
WALKER_AHEAD_M, WALKER_ASIDE_M = 60.0, 10.0
LARGE_M = 7.0
"""From this length on a standing vehicle hides who steps out before it."""

Side = Literal["left", "right"]
_KINDS: Final = {
    ActorKind.VEHICLE: "vehicle",
    ActorKind.PEDESTRIAN: "pedestrian",
    ActorKind.BICYCLE: "bicycle",
    ActorKind.TRAFFIC_CONE: "cones",
    ActorKind.BARRIER: "barrier",
    ActorKind.CZONE_SIGN: "construction sign",
    ActorKind.GENERIC_OBJECT: "object",
}


@dataclass(frozen=True, slots=True)
class Other:
    """Somebody who moves along a lane, before or behind the ego."""

    kind: str
    gap_m: float
    """From bumper to bumper; 0 beside the ego."""
    speed_mps: float
    """Along the lane."""


@dataclass(frozen=True, slots=True)
class BlockedLane:
    """What stands for good in a lane, as one group."""

    kind: str
    """Of the first of it."""
    gap_m: float
    """From the ego's front bumper; 0 beside the ego."""
    start_m: float
    end_m: float
    """Arc lengths of the lane's way."""
    passes: tuple[tuple[Side, float], ...]
    """On which sides the ego can get by on drivable ground, and the offset (left positive) of its centre there; the
    smaller shift first."""
    against_traffic: bool
    """Whether the first of these leads over a lane of the other direction."""


@dataclass(frozen=True, eq=False)
class LaneView:
    """One lane from the ego on, and who is on it."""

    way: LaneRoute
    index: int
    """Of its block on the route."""
    changes_needed: int | None
    """Lane changes from here to the goal lane; None where none lead there."""
    arc_m: float
    """Of the ego's centre on the way."""
    left_m: float
    """How far left of the way's line the ego is."""
    ahead: Other | None
    behind: Other | None
    blocked: BlockedLane | None


@dataclass(frozen=True, slots=True)
class Oncoming:
    """The next vehicle that comes towards the ego."""

    gap_m: float
    speed_mps: float
    """Its own."""
    closing_mps: float
    """Of both together."""

    @property
    def meets_in_s(self) -> float:
        return self.gap_m / self.closing_mps if self.closing_mps > 0.1 else inf


@dataclass(frozen=True, slots=True)
class Walker:
    """A pedestrian near the lane ahead."""

    ahead_m: float
    aside_m: float
    """From the lane's centre line, left positive."""
    towards_mps: float
    """How fast the way to the lane's centre line shrinks."""


@dataclass(frozen=True, slots=True)
class Occluder:
    """A long vehicle that stands beside the lane, a bus at a stop perhaps: who steps out before it is seen late."""

    ahead_m: float
    side: Side


@dataclass(frozen=True, eq=False)
class DecisionScene:
    """One instant, for a decision."""

    time_s: float
    speed_mps: float
    limit_mps: float
    goal_m: float
    """Along the own way to where the goal is abreast, or to where the way leaves the route."""
    current: LaneView
    left: LaneView | None
    right: LaneView | None
    oncoming: Oncoming | None
    light: tuple[Literal["red", "yellow"], float] | None
    """The next light on the own way that is not green, and metres to it."""
    walkers: tuple[Walker, ...]
    covers: tuple[Occluder, ...]


class SceneObserver:
    """Looks at a drive as scenes; one instance serves one episode."""

    def __init__(self, mission: Mission, fallback_limit_mps: float) -> None:
        self.mission = mission
        self._fallback_limit_mps = fallback_limit_mps
        self._route: DrivenRoute | None = None

    @cached_property
    def free_ground(self) -> Ground:
        """What lies where for who has to use a lane of the other direction: every lane will do."""
        roads = self.mission.roads
        return Ground(roads, (*roads.lanes, *roads.connectors))

    @property
    def route(self) -> DrivenRoute:
        """The route from where the ego began, once there was a first scene."""
        assert self._route is not None
        return self._route

    def scene(self, observation: Observation) -> DecisionScene:
        """What can be said of a step."""
        ego, roads = observation.ego, self.mission.roads
        route = self._route = self._route or DrivenRoute(self.mission, ego.pose, self._fallback_limit_mps)
        ways, (index, lane_id) = route.ways, route.lane_at(ego.pose)
        here = _Sight(observation, self.mission, route.ground)
        current = here.view(ways.from_lane(index, lane_id), index, ways.changes_needed.get(lane_id))
        beside = [
            None if lane is None else here.view(ways.from_lane(index, lane.id), index, ways.changes_needed.get(lane.id))
            for lane in (roads.left_of(lane_id), roads.right_of(lane_id))
        ]
        metre = min(int(current.arc_m), len(current.way.limit_mps) - 1)
        return DecisionScene(
            observation.time_s,
            max(ego.speed_mps, 0.0),
            float(current.way.limit_mps[metre]),
            current.way.room_m - current.arc_m,
            current,
            beside[0],
            beside[1],
            here.oncoming(current),
            here.light(current),
            here.walkers(current),
            here.covers(current),
        )


class _Sight:
    """One observation, along lanes."""

    def __init__(self, observation: Observation, mission: Mission, ground: Ground) -> None:
        self.seen = observation
        self.mission = mission
        self.ground = ground
        self.now = constant_velocity(observation.actors, 0.0)
        self.stands = stands_for_good(observation)

    def view(self, way: LaneRoute, index: int, changes_needed: int | None) -> LaneView:
        ego, shape, actors = self.seen.ego, self.mission.shape, self.seen.actors
        arc_m, left_m = way.path.line.project_point(ego.x_m, ego.y_m)
        half_m = shape.length_m / 2
        on = occupancy(way.path, LANE_HALF_WIDTH_M, self.now, (arc_m - BEHIND_M, arc_m + AHEAD_M))
        still = self._stays(way, arc_m)
        movers = [i for i, row in enumerate(on.rows.tolist()) if not still[row]]
        front, rear = arc_m + half_m, arc_m - half_m
        centers = np.where(np.isnan(on.center_m[:, 0]), 0.5 * (on.near_m[:, 0] + on.far_m[:, 0]), on.center_m[:, 0])
        ahead = min((i for i in movers if centers[i] > arc_m), key=lambda i: on.near_m[i, 0], default=None)
        behind = max((i for i in movers if centers[i] <= arc_m), key=lambda i: on.far_m[i, 0], default=None)

        def other(i: int | None, gap_m: float) -> Other | None:
            if i is None:
                return None
            kind = _KINDS[ActorKind(int(actors.kind[on.rows[i]]))]
            return Other(kind, max(gap_m, 0.0), float(on.speed_mps[i, 0]))

        return LaneView(
            way,
            index,
            changes_needed,
            arc_m,
            left_m,
            other(ahead, float(on.near_m[ahead, 0]) - front if ahead is not None else inf),
            other(behind, rear - float(on.far_m[behind, 0]) if behind is not None else inf),
            self._blockage(way, arc_m, still),
        )

    def _stays(self, way: LaneRoute, arc_m: float) -> NDArray[np.bool_]:
        """(A,) who stands for good; a car that waits for a light, or behind one that does, is not among them."""
        still = self.stands.copy()
        actors = self.seen.actors
        vehicles = still & (actors.kind == ActorKind.VEHICLE)
        stop_m = self._light_m(way, arc_m, (SignalStatus.RED, SignalStatus.YELLOW))
        if not vehicles.any() or stop_m == inf:
            return still
        on = occupancy(way.path, LANE_HALF_WIDTH_M, self.now, (arc_m - BEHIND_M, arc_m + AHEAD_M))
        from_front = sorted(
            (i for i, row in enumerate(on.rows.tolist()) if vehicles[row]), key=lambda i: -on.near_m[i, 0]
        )
        head_m = stop_m
        reach_m = LIGHT_M
        for i in from_front:
            far_m = float(on.far_m[i, 0])
            if far_m > stop_m + 1.0:
                continue
            if head_m - far_m > reach_m:
                break
            still[on.rows[i]] = False
            head_m, reach_m = float(on.near_m[i, 0]), QUEUE_M
        return still

    def _blockage(self, way: LaneRoute, arc_m: float, still: NDArray[np.bool_]) -> BlockedLane | None:
        """The first group of things on the way that stand where the ego would have to drive."""
        shape, actors = self.mission.shape, self.seen.actors
        half_m = shape.length_m / 2
        strip_m = shape.width_m / 2 + 0.1
        on = occupancy(way.path, strip_m, self.now, (arc_m - half_m, arc_m + AHEAD_M), ignore=~still)
        order = np.argsort(on.near_m[:, 0], kind="stable").tolist()
        if not order:
            return None
        group = [order[0]]
        end_m = float(on.far_m[order[0], 0])
        for i in order[1:]:
            if on.near_m[i, 0] - end_m > ONE_BLOCK_M:
                break
            group.append(i)
            end_m = max(end_m, float(on.far_m[i, 0]))
        start_m = float(on.near_m[group[0], 0])
        corners = actors.corners[on.rows[group]].reshape(-1, 2)
        _, sides = way.path.project(corners[:, 0], corners[:, 1], (start_m - 10.0, end_m + 10.0))
        need_m = shape.width_m / 2 + CLEARANCE_M
        offsets = {"left": float(sides.max()) + need_m, "right": float(sides.min()) - need_m}
        stretch = np.arange(start_m - half_m, end_m + half_m + 1.0, 2.0)
        passes: list[tuple[Side, float, bool]] = []
        for side in ("left", "right"):
            drivable, against = self._ground_at(way, stretch, offsets[side])
            if drivable and self._free(way, max(start_m, arc_m - half_m), end_m, offsets[side], still):
                passes.append((side, offsets[side], against))
        passes.sort(key=lambda each: abs(each[1]))
        kind = _KINDS[ActorKind(int(actors.kind[on.rows[group[0]]]))]
        return BlockedLane(
            "stopped vehicle" if kind == "vehicle" else kind,
            max(start_m - arc_m - half_m, 0.0),
            start_m,
            end_m,
            tuple((side, offset) for side, offset, _ in passes),
            bool(passes) and passes[0][2],
        )

    def _ground_at(self, way: LaneRoute, arcs_m: Floats, offset_m: float) -> tuple[bool, bool]:
        """Whether a car with its centre at an offset is on drivable ground, and whether it leaves the route's lanes."""
        poses = way.path.line.poses_at(np.clip(arcs_m, 0.0, way.path.length_m))
        left = np.stack((-np.sin(poses[:, 2]), np.cos(poses[:, 2])), axis=1)
        half_m = self.mission.shape.width_m / 2
        across = np.array((offset_m - half_m, offset_m, offset_m + half_m))
        places = poses[:, None, :2] + across[:, None] * left[:, None, :]
        under = self.ground.under(places[..., 0], places[..., 1])
        return bool(under.drivable.all()), not under.on_route[:, 1].all()

    def _free(self, way: LaneRoute, start_m: float, end_m: float, offset_m: float, still: NDArray[np.bool_]) -> bool:
        """Whether nothing stands where the ego would pass."""
        line = way.path.line
        arcs = np.arange(max(start_m, 0.0), min(end_m, line.length_m) + 1.0, 1.0)
        poses = line.poses_at(np.clip(arcs, 0.0, line.length_m))
        x_m, y_m = poses[:, 0] - offset_m * np.sin(poses[:, 2]), poses[:, 1] + offset_m * np.cos(poses[:, 2])
        actors, reach_m = self.seen.actors, self.mission.shape.width_m / 2
        for row in np.flatnonzero(still).tolist():
            cos, sin = np.cos(actors.heading_rad[row]), np.sin(actors.heading_rad[row])
            dx, dy = x_m - actors.x_m[row], y_m - actors.y_m[row]
            along = np.maximum(np.abs(cos * dx + sin * dy) - actors.length_m[row] / 2, 0.0)
            aside = np.maximum(np.abs(cos * dy - sin * dx) - actors.width_m[row] / 2, 0.0)
            if (np.hypot(along, aside) < reach_m).any():
                return False
        return True

    def oncoming(self, current: LaneView) -> Oncoming | None:
        actors, path = self.seen.actors, current.way.path
        rows = np.flatnonzero((actors.kind == ActorKind.VEHICLE) & (actors.speed_mps > STANDING_MPS))
        if not rows.size:
            return None
        arc, off = path.project(actors.x_m[rows], actors.y_m[rows])
        turned = np.cos(actors.heading_rad[rows] - np.interp(arc, path.line.arc_m, path.line.vertex_heading_rad))
        gap = arc - actors.length_m[rows] / 2 - current.arc_m - self.mission.shape.length_m / 2
        comes = (turned < ONCOMING_COS) & (gap > 0.0) & (gap < ONCOMING_M) & (np.abs(off) < ONCOMING_ASIDE_M)
        comes &= (arc > 0.0) & (arc < path.length_m)
        if not comes.any():
            return None
        nearest = int(np.argmin(np.where(comes, gap, inf)))
        speed = float(actors.speed_mps[rows[nearest]])
        return Oncoming(float(gap[nearest]), speed, speed + max(self.seen.ego.speed_mps, 0.0))

    def light(self, current: LaneView) -> tuple[Literal["red", "yellow"], float] | None:
        front_m = current.arc_m + self.mission.shape.length_m / 2
        reds = self._light_m(current.way, front_m, (SignalStatus.RED,))
        yellows = self._light_m(current.way, front_m, (SignalStatus.YELLOW,))
        if min(reds, yellows) == inf:
            return None
        return ("red", reds - front_m) if reds <= yellows else ("yellow", yellows - front_m)

    def _light_m(self, way: LaneRoute, after_m: float, status: tuple[SignalStatus, ...]) -> float:
        """Arc length at which the first connector of a way begins that shows one of some lights; inf without one."""
        shown = {c for s in status for c in self.seen.signals.with_status(s)}
        starts = zip(way.lanes, way.starts_m.tolist(), strict=True)
        return min((start for lane, start in starts if lane in shown and start > after_m), default=inf)

    def walkers(self, current: LaneView) -> tuple[Walker, ...]:
        """Pedestrians and cyclists beside or on the lane ahead, nearest first."""
        actors, path = self.seen.actors, current.way.path
        rows = np.flatnonzero(actors.kind == ActorKind.PEDESTRIAN)
        if not rows.size:
            return ()
        arc, off = path.project(actors.x_m[rows], actors.y_m[rows])
        ahead = arc - current.arc_m - self.mission.shape.length_m / 2
        heading = np.interp(arc, path.line.arc_m, path.line.vertex_heading_rad)
        drift = actors.vy_mps[rows] * np.cos(heading) - actors.vx_mps[rows] * np.sin(heading)
        near = (ahead > 0.0) & (ahead < WALKER_AHEAD_M) & (np.abs(off) < WALKER_ASIDE_M)
        found = [
            Walker(float(ahead[i]), float(off[i]), float(-np.sign(off[i]) * drift[i]))
            for i in np.flatnonzero(near).tolist()
        ]
        return tuple(sorted(found, key=lambda walker: walker.ahead_m))

    def covers(self, current: LaneView) -> tuple[Occluder, ...]:
        """Long vehicles that stand beside the own lane ahead, nearest first."""
        actors, path = self.seen.actors, current.way.path
        rows = np.flatnonzero(self.stands & (actors.kind == ActorKind.VEHICLE) & (actors.length_m >= LARGE_M))
        if not rows.size:
            return ()
        arc, off = path.project(actors.x_m[rows], actors.y_m[rows])
        ahead = arc + actors.length_m[rows] / 2 - current.arc_m - self.mission.shape.length_m / 2
        turned = wrap_angle(actors.heading_rad[rows] - np.interp(arc, path.line.arc_m, path.line.vertex_heading_rad))
        beside = (ahead > 0.0) & (ahead < WALKER_AHEAD_M) & (np.abs(off) > LANE_HALF_WIDTH_M)
        beside &= (np.abs(off) < ONCOMING_ASIDE_M) & (np.abs(np.sin(turned)) < 0.5)
        nearest = sorted(np.flatnonzero(beside).tolist(), key=lambda i: ahead[i])
        return tuple(Occluder(float(ahead[i]), "left" if off[i] > 0.0 else "right") for i in nearest)
