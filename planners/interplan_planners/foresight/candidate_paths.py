"""Candidate paths: for the rear axle, that keep a lane, change it, or pass something with an offset and come back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import atan, atan2, cos, exp, hypot, inf, pi, sin, sqrt, tan
from typing import Literal

import numpy as np

from interplan_planners.common.lane_routes import LaneRoute
from interplan_planners.common.paths import DrivingPath
from interplan_planners.foresight.prediction import straightest
from interplan_sumo.world.geometry import Floats, Polyline, Pose, wrap_angle
from interplan_sumo.world.roads import Roads

RUN_IN_M = 12.0
"""A base begins this far before its first lane, so that a car that enters it is on it with all of its length."""
RUN_OUT_M = 120.0
"""And goes on this far beyond its last one, so that a plan does not end where the route does."""
HELD_M, HELD_PER_CHANGE_M = 8.0, 14.0
"""Before the end of a lane that leaves the route there should be this much room for a change, and for each one more."""
CHANGED_FROM_M = 12.0
"""From a lane that is shorter nobody changes: who waited on it for a gap would be in the junction behind."""
RETURNS_M, APART_M, PROBE_M = 8.0, 40.0, 2.0
"""A base ends where its line comes this near to what lies the second behind it along the line, looked for this finely:
on a long way that crosses itself nobody could tell on which pass the ego is."""
SPACING_M = 1.0
LOCK_MPS = 2.0
"""How fast the ego is with its wheel at the stop."""
UNBENT_M = 5.0
"""Over this distance the tracker straightens a wheel that was turned to the stop."""
LATERAL_MPS2 = 2.0
"""How much bends are felt at most."""
BRAKING_MPS2 = 1.3
"""With which the ego slows down for bends and lower limits."""
BEND_WINDOW_M = 4.0
STEEPEST_RAD = 0.5
BACK_SHARE = 0.6
"""Of the way back: from there on nothing of the ego is in the oncoming lane any more."""
IN_LANE = 0.8
"""Share of a change after which all of the ego is in the new lane."""
DRAWN_M = 2.6
"""The drawn point lies this far before the rear axle: between the axles, so that neither end swings out much."""
CENTER_M = 1.46
"""The box centre's place, whose lane says what the limit is; nuPlan's car."""
SLOW_BEFORE_M = 40.0
"""Who passes something is slow no farther than this before it."""
BEYOND_M = 240.0
"""How far a candidate goes on after its last piece; it is given up for its base before."""
TIGHTEST_M, LOCK_M = 5.5, 4.4
"""No candidate bends more than with the first radius; one that sets off from a standstill may with the second, that of
the wheel at its stop (Chrysler Pacifica, 12.1 m from kerb to kerb)."""

Kind = Literal["keep", "change", "pass"]


@dataclass(frozen=True, slots=True, eq=False)
class Base:
    """The line of a way, with a straight run-in before it, and what it allows."""

    way: LaneRoute
    index: int
    """Of the way's first block on the route."""
    path: DrivingPath
    limit_mps: Floats
    """(S,) for each metre of the path, what the law allows."""
    room_m: float
    """Arc length up to which lane changes for the goal are of use and possible."""
    ends_m: float
    """Arc length of the goal, or where the way leaves the route."""
    beyond: tuple[tuple[str, float], ...]
    """Lanes and connectors that the line follows beyond its way, and where each begins on it."""
    held_m: float
    """Arc length at which the front waits for a gap, where the way leaves the route; infinite where it does not."""
    whole: bool = True
    """Whether the line goes as far as the way; else it ends where it comes back to itself."""

    @property
    def line(self) -> Polyline:
        return self.path.line

    def place(self, arc_m: float) -> int:
        """Number of the way's lane at an arc length."""
        return max(int(np.searchsorted(self.way.starts_m, arc_m - RUN_IN_M, side="right")) - 1, 0)

    def lane_at(self, arc_m: float) -> tuple[int, str]:
        """Index on the route and id of the lane or connector at an arc length."""
        place = self.place(arc_m)
        return self.index + place, self.way.lanes[place]

    def lane_end_m(self, arc_m: float) -> float:
        """Where the lane ends that is at an arc length."""
        place = self.place(arc_m)
        starts = self.way.starts_m
        way_m = self.line.length_m - RUN_OUT_M if self.whole else RUN_IN_M + self.way.path.line.length_m
        last_m = self.beyond[0][1] if self.beyond else way_m
        return float(starts[place + 1]) + RUN_IN_M if place + 1 < len(starts) else last_m


@dataclass(frozen=True, slots=True, eq=False)
class CandidatePath:
    """A path to drive, and what it is for."""

    kind: Kind
    base: Base
    """What it keeps to, changes to, or passes beside and comes back to."""
    path: DrivingPath
    limit_mps: Floats
    """(S,) for each metre of the path: the law, bends, and braking in time for both."""
    leaves_m: float = 0.0
    """Arc length of the path where the lateral move begins."""
    settles_m: float = 0.0
    """Arc length where it is done: all of the ego in the new lane, or back in the old one."""
    offset_m: float = 0.0
    """Of a pass: to the left of the base."""
    beside_m: tuple[float, float] = (0.0, 0.0)
    """Of a pass: arc lengths of the path between which it is off the base by all of the offset."""
    oncoming: bool = False
    """Whether the ego's centre leaves the lanes of its direction."""
    around: tuple[str, ...] = ()
    """Of a pass: what it passes."""
    over_m: float = inf
    """Of a pass: where the front bumper must stop at the latest so that nothing of the ego is in the oncoming lane."""
    late: bool = False
    """Of a pass: whether the front is beside what it passes before all of the offset is reached."""
    old: Base | None = None
    """Of a change: what it leaves."""
    new: Base | None = None
    """The lane of the same direction that it enters, if it does."""
    merged_m: float = 0.0
    """Arc length of the path from which on all of the ego is in that lane."""

    @property
    def back_m(self) -> float:
        """Of a pass: arc length from which on nothing of the ego is in the oncoming lane any more."""
        return self.beside_m[1] + BACK_SHARE * (self.settles_m - self.beside_m[1])

    def returning(self) -> CandidatePath:
        """A pass that is beside what it passes: the lane that it enters next is its own again."""
        beside_m = self.beside_m[1]
        return replace(self, new=self.base, merged_m=beside_m + IN_LANE * (self.settles_m - beside_m))


def base_of(roads: Roads, way: LaneRoute, index: int, changes: int, fallback_limit_mps: float) -> Base:
    """The base of a way that starts on block `index` of the route, and ends so many lane changes from its goal."""
    points = way.path.line.points
    heading = float(way.path.line.segment_heading_rad[0])
    before = points[0] - RUN_IN_M * np.array((np.cos(heading), np.sin(heading)))
    run_in = np.linspace(before, points[0], int(RUN_IN_M), endpoint=False)
    beyond, run_out = _run_out(roads, way.lanes[-1])
    every = Polyline(np.concatenate((run_in, points, run_out)))
    line = _until_it_returns(every)
    metres = np.arange(int(line.length_m) + 1, dtype=np.float64)
    by_lane = np.array([lawful_mps(roads, lane_id, fallback_limit_mps) for lane_id in way.lanes])
    at = np.searchsorted(way.starts_m, metres - RUN_IN_M, side="right") - 1
    limit_mps = by_lane[np.clip(at, 0, len(by_lane) - 1)]
    starts_m = RUN_IN_M + way.path.line.length_m
    placed = tuple((lane_id, starts_m + after_m) for lane_id, after_m in beyond)
    ends_m = way.room_m + RUN_IN_M
    room_m = ends_m if way.arrives else _last_change_m(roads, way) + RUN_IN_M
    held_m = inf if way.arrives else room_m - HELD_M - HELD_PER_CHANGE_M * (max(changes, 1) - 1)
    return Base(way, index, DrivingPath(line), limit_mps, room_m, ends_m, placed, held_m, line is every)


def _last_change_m(roads: Roads, way: LaneRoute) -> float:
    """Where on a way that leaves the route the last lane ends from which one can change; its end if there is none."""
    ends_m = [*way.starts_m[1:].tolist(), way.room_m]
    for lane_id, start_m, end_m in reversed(list(zip(way.lanes, way.starts_m.tolist(), ends_m, strict=True))):
        beside = roads.left_of(lane_id) or roads.right_of(lane_id)
        if beside is not None and end_m - start_m > CHANGED_FROM_M:
            return end_m
    return way.room_m


def _until_it_returns(line: Polyline) -> Polyline:
    """A line, or as much of it as does not come back to itself."""
    arcs = np.arange(0.0, line.length_m, PROBE_M)
    x_m, y_m, _ = line.poses_at(arcs).T
    apart = round(APART_M / PROBE_M)
    for j in range(apart, len(arcs)):
        if (np.hypot(x_m[: j - apart] - x_m[j], y_m[: j - apart] - y_m[j]) < RETURNS_M).any():
            return line.between(0.0, float(arcs[j]))
    return line


def _run_out(roads: Roads, lane_id: str) -> tuple[list[tuple[str, float]], Floats]:
    """Where to go on after the last lane of a way: the straightest way, then straight on.

    The lanes and connectors of that way with the distance from the last lane to each, and points (N, 2).
    """
    lanes: list[tuple[str, float]] = []
    points: list[Floats] = []
    length_m, here = 0.0, lane_id
    while length_m < RUN_OUT_M and roads.outgoing(here):
        here = straightest(roads, roads.outgoing(here))
        lanes.append((here, length_m))
        points.append(roads[here].centerline.points)
        length_m += roads[here].centerline.length_m
    last = roads[here].centerline
    heading = float(last.segment_heading_rad[-1])
    ahead = np.arange(1.0, RUN_OUT_M + 1.0)[:, None] * np.array((np.cos(heading), np.sin(heading)))
    return lanes, np.concatenate((*points, last.points[-1] + ahead))


def lawful_mps(roads: Roads, lane_id: str, fallback_mps: float) -> float:
    """The limit of a lane; of a connector the highest of the lanes that it joins (nuPlan's rule)."""
    if lane_id in roads.lanes:
        return roads[lane_id].speed_limit_mps or fallback_mps
    ends = (*roads.incoming(lane_id), *roads.outgoing(lane_id))
    known = [limit for i in ends if (limit := roads[i].speed_limit_mps)]
    return max(known) if known else fallback_mps


def kept(base: Base) -> CandidatePath:
    """Stay on the line of a base: its drawn point does."""
    line = base.line
    points, arcs = towed(line.points, float(line.segment_heading_rad[0])), line.arc_m
    return CandidatePath("keep", base, *_drivable(base, points, arcs))


def returned(base: Base, axle: Pose, curvature_per_m: float, length_m: float) -> CandidatePath:
    """Come (back) to the line of a base from a pose beside it, over a length."""
    path, limits, ends = _beside(base, axle, curvature_per_m, [(length_m, 0.0)])
    return CandidatePath("keep", base, path, limits, ends[0], ends[1])


def unbent(base: Base, axle: Pose, curvature_per_m: float, over_m: float) -> CandidatePath:
    """Set off slowly with a turned wheel: first to an offset from the line of a base, so as not to cut its bend."""
    pieces = [(UNBENT_M, over_m), (2.0 * UNBENT_M, 0.0)]
    at_m, _ = base.line.project_point(axle.x_m, axle.y_m)
    path, limits, ends = _beside(base, axle, curvature_per_m, pieces, (LOCK_MPS, at_m - DRAWN_M, at_m + 2.5 * UNBENT_M))
    return CandidatePath("keep", base, path, limits, ends[0], ends[-1])


def changed(old: Base, base: Base, axle: Pose, curvature_per_m: float, length_m: float) -> CandidatePath:
    """Change from one base to another over a length, from a pose."""
    path, limits, ends = _beside(base, axle, curvature_per_m, [(length_m, 0.0)])
    merged_m = ends[0] + IN_LANE * (ends[1] - ends[0])
    return CandidatePath("change", base, path, limits, ends[0], merged_m, old=old, new=base, merged_m=merged_m)


@dataclass(frozen=True, slots=True, eq=False)
class Bypass:
    """A way past something: to an offset between two arc lengths of the base, and back between two others."""

    offset_m: float
    out_m: tuple[float, float]
    back_m: tuple[float, float]
    around: tuple[str, ...]
    """Who is passed."""
    oncoming: bool
    over_share: float
    """Of the way out: up to there nothing of the ego is in the oncoming lane; infinite where it stays out of it."""
    most_mps: float
    """Allowed while beside."""
    new: Base | None
    """The lane of the same direction on which one is then."""
    late: bool = False
    """Whether the offset is reached beside it only: setting off from behind it, with the wheel at the stop."""


def passed(base: Base, axle: Pose, curvature_per_m: float, bypass: Bypass) -> CandidatePath | None:
    """The path of a bypass; None if there is no room for it."""
    offset_m, out_m, back_m = bypass.offset_m, bypass.out_m, bypass.back_m
    drawn = drawn_point(axle)
    at_m, left_m = base.line.project_point(drawn.x_m, drawn.y_m)
    wait_m = max(out_m[0] - at_m, 0.0)
    way_m = out_m[1] - at_m - wait_m
    if way_m < shortest_m(offset_m - left_m, LOCK_M):
        return None
    pieces = [(way_m, offset_m), (back_m[0] - out_m[1], offset_m), (back_m[1] - back_m[0], 0.0)]
    if wait_m > 0.5:
        # what is off the line now is brought back meanwhile
        pieces.insert(0, (wait_m, 0.0 if abs(left_m) < 0.3 or wait_m > 8.0 else left_m))
    slow = (bypass.most_mps, max(out_m[1] - 0.7 * way_m, back_m[0] - SLOW_BEFORE_M), back_m[0])
    if bypass.late:
        slow = (min(bypass.most_mps, LOCK_MPS), at_m - DRAWN_M, out_m[1])
    path, limits, ends = _beside(base, axle, curvature_per_m, pieces, slow)
    leaves_m = ends[1] if wait_m > 0.5 else ends[0]
    return CandidatePath(
        "pass", base, path, limits, leaves_m, ends[-1], offset_m, (ends[-3], ends[-2]), bypass.oncoming, bypass.around,
        leaves_m + bypass.over_share * (ends[-3] - leaves_m), bypass.late, new=bypass.new,
        merged_m=leaves_m + IN_LANE * (ends[-3] - leaves_m),
    )  # fmt: skip


def shortest_m(offset_m: float, radius_m: float = TIGHTEST_M) -> float:
    """The least length over which a car can move sideways by an offset, from straight ahead to straight ahead."""
    # the largest second derivative of the quintic is 5.77 offsets per squared length
    return max(sqrt(5.78 * abs(offset_m) * radius_m), 4.0)


def _beside(
    base: Base,
    axle: Pose,
    curvature_per_m: float,
    pieces: Sequence[tuple[float, float]],
    slow: tuple[float, float, float] | None = None,
) -> tuple[DrivingPath, Floats, list[float]]:
    """A path from a pose, in pieces of a length along the base and an offset reached at its end, then on the base.

    Also its limits, and the arc lengths of the path where the pieces begin, the
    last one's end included. Pieces and offsets are those of the drawn point.
    `slow` is a speed that holds between two arc lengths of the base.
    """
    line = base.line
    drawn = drawn_point(axle)
    at_m, left_m = line.project_point(drawn.x_m, drawn.y_m)
    # the drawn point moves where the front wheels point
    towards = axle.heading_rad + atan(DRAWN_M * curvature_per_m)
    turned = float(wrap_angle(towards - line.pose_at(at_m).heading_rad))
    slope = tan(min(max(turned, -STEEPEST_RAD), STEEPEST_RAD))
    own = curvature_per_m / sqrt(1.0 + (DRAWN_M * curvature_per_m) ** 2)
    second = min(max((own - _bend(line, at_m)) * (1.0 + slope * slope) ** 1.5, -0.12), 0.12)

    joints = at_m + np.concatenate(([0.0], np.cumsum([length for length, _ in pieces])))
    end_m = min(float(joints[-1]), line.length_m - 1.0)
    arcs = np.concatenate((np.arange(at_m, end_m, SPACING_M), [end_m]))
    if len(arcs) > 1 and arcs[-1] - arcs[-2] < 0.05:
        arcs = np.delete(arcs, -2)
    offsets = np.zeros(len(arcs))
    begin = (left_m, slope, second)
    for i, (length_m, to_m) in enumerate(pieces):
        inside = (arcs >= joints[i]) & (arcs < joints[i + 1])
        offsets[inside] = quintic(arcs[inside] - joints[i], length_m, begin, to_m)
        begin = (to_m, 0.0, 0.0)
    later = line.arc_m[(line.arc_m > end_m + 0.3) & (line.arc_m < end_m + BEYOND_M)]
    arcs = np.concatenate((arcs, later))
    offsets = np.concatenate((offsets, np.zeros(len(later))))
    poses = line.poses_at(arcs)
    # headings belong to the middle of the segment ahead; normals are wanted at the vertices
    normal = np.interp(arcs - 0.5 * SPACING_M, line.arc_m, line.vertex_heading_rad)
    points = np.column_stack((poses[:, 0] - offsets * np.sin(normal), poses[:, 1] + offsets * np.cos(normal)))
    steps = points[1:] - points[:-1]
    forward = steps[:, 0] * np.cos(poses[:-1, 2]) + steps[:, 1] * np.sin(poses[:-1, 2]) > 0.02
    keep = np.concatenate(([True], forward))
    points, arcs = points[keep], arcs[keep]
    rear = towed(points, axle.heading_rad)
    behind = np.arange(-6.0, 0.0)
    before = np.column_stack(
        (axle.x_m + behind * np.cos(axle.heading_rad), axle.y_m + behind * np.sin(axle.heading_rad))
    )
    if len(rear) > 1:
        points, arcs = np.concatenate((before, rear)), np.concatenate((arcs[0] + behind, arcs))
    else:
        points, arcs = before, at_m + behind
    path, limits = _drivable(base, points, arcs, slow)
    return path, limits, np.interp(joints, arcs, _own_arcs_m(path, points)).tolist()


def drawn_point(axle: Pose) -> Pose:
    """The point of the car that is drawn along lines; the rear axle is towed behind it."""
    cos_h, sin_h = np.cos(axle.heading_rad), np.sin(axle.heading_rad)
    return Pose(axle.x_m + DRAWN_M * float(cos_h), axle.y_m + DRAWN_M * float(sin_h), axle.heading_rad)


def towed(points: Floats, heading_rad: float) -> Floats:
    """(N, 2) the rear axle's way while the drawn point goes along points (N, 2); `heading_rad` is the car's at first.

    Along each straight piece the half angle's tangent between car and way
    fades exponentially, so that this is exact.
    """
    found = np.empty_like(points)
    heading = heading_rad
    rows: list[list[float]] = points.tolist()
    before_x, before_y = rows[0]
    found[0] = before_x - DRAWN_M * cos(heading), before_y - DRAWN_M * sin(heading)
    out: list[tuple[float, float]] = []
    for x, y in rows[1:]:
        dx, dy = x - before_x, y - before_y
        way = atan2(dy, dx)
        angle = (way - heading + pi) % (2.0 * pi) - pi
        if abs(angle) > 1e-7:
            fade = exp(-hypot(dx, dy) / DRAWN_M)
            heading = way - 2.0 * atan(tan(0.5 * min(max(angle, -2.0), 2.0)) * fade)
        else:
            heading = way
        out.append((x - DRAWN_M * cos(heading), y - DRAWN_M * sin(heading)))
        before_x, before_y = x, y
    found[1:] = out
    return found


def _own_arcs_m(path: DrivingPath, points: Floats) -> Floats:
    """(N,) arc lengths of a path's own points (N, 2), some of which it may have dropped as duplicates."""
    return path.line.arc_m if len(path.line.points) == len(points) else path.line.project(points)[0]


def _drivable(
    base: Base, points: Floats, arcs: Floats, slow: tuple[float, float, float] | None = None
) -> tuple[DrivingPath, Floats]:
    """A path through points (N, 2), whose drawn points are at arc lengths (N,) of the base, and its limits."""
    path = DrivingPath(Polyline(points))
    own = _own_arcs_m(path, points)
    on_base = np.interp(np.arange(int(path.length_m) + 1), own, arcs)
    center = np.clip((on_base - DRAWN_M + CENTER_M).astype(np.int64), 0, len(base.limit_mps) - 1)
    lawful = base.limit_mps[center]
    if slow is not None:
        most_mps, first_m, last_m = slow
        lawful = np.where((on_base > first_m) & (on_base < last_m), np.minimum(lawful, most_mps), lawful)
    return path, _limits(path.line, lawful)


def quintic(x_m: Floats, length_m: float, begin: tuple[float, float, float], end: float) -> Floats:
    """Values (N,) of the quintic from value, slope and second derivative `begin` to (`end`, 0, 0) over a length."""
    u = np.clip(x_m / length_m, 0.0, 1.0)
    p, v, a = begin[0] - end, begin[1] * length_m, begin[2] * length_m * length_m
    u3 = u * u * u
    return (
        end
        + p * (1.0 - u3 * (10.0 - 15.0 * u + 6.0 * u * u))
        + v * (u - u3 * (6.0 - 8.0 * u + 3.0 * u * u))
        + a * (0.5 * u * u - u3 * (1.5 - 1.5 * u + 0.5 * u * u))
    )


def _bend(line: Polyline, at_m: float) -> float:
    """Curvature of a line, left positive."""
    before, after = np.interp((at_m - 1.5, at_m + 1.5), line.arc_m, line.vertex_heading_rad)
    return float(after - before) / 3.0


def _limits(line: Polyline, lawful_mps: Floats) -> Floats:
    """(S,) for each metre of a line: the law, what bends allow, and what it takes to brake in time for both."""
    metres = np.arange(int(line.length_m) + 1, dtype=np.float64)
    lawful = lawful_mps[np.clip(metres.astype(np.int64), 0, len(lawful_mps) - 1)]
    before = np.interp(metres - BEND_WINDOW_M / 2, line.arc_m, line.vertex_heading_rad)
    after = np.interp(metres + BEND_WINDOW_M / 2, line.arc_m, line.vertex_heading_rad)
    bend = np.maximum(np.abs(after - before) / BEND_WINDOW_M, 1e-6)
    square = np.minimum(lawful * lawful, LATERAL_MPS2 / bend)
    ramp = 2.0 * BRAKING_MPS2 * metres
    return np.sqrt(np.maximum(np.minimum.accumulate((square + ramp)[::-1])[::-1] - ramp, 0.25))
