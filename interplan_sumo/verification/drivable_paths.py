"""Drivable paths: lane paths with swerves around what stands on them, and how fast each place can be driven."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.metrics.time_to_collision import overlap_span_s
from interplan_sumo.scenario.kinds import SLOW_KINDS, SLOW_SIZES_M
from interplan_sumo.verification.corridor import GRID_M, FrenetCorridor, LanePath, smoothed
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import Floats, Pose, box_corners

Side = Literal["left", "right"]

HALF_LENGTH_M, HALF_WIDTH_M = PACIFICA.length_m / 2.0, PACIFICA.width_m / 2.0
REAR_CELLS = round(PACIFICA.rear_axle_to_center_m / GRID_M)
NUDGE_M = 1.5
"""Up to this lateral offset one keeps to the own lane."""
SAME_SWERVE_M = 25.0
"""Obstacles nearer to one another along the road are passed in one swerve."""
TOUCH_M = 0.1
"""Room beside the ego's box that the tracker may need."""
SWAY_M = 0.2
"""Room beside what it goes straight on to, should it head a little off its path."""
LOOKAHEAD_S = 1.15
"""A standing obstacle straight ahead is kept this far away; the metric asks for more than 0.95 s."""
OFF_ROAD_M = 0.1
"""A corner may be this far off the drivable area; the metric's limit is 0.3 m."""
LATERAL_MPS2 = 2.0
YAW_RATE_RADPS = 0.6
YAW_ACCELERATION_RADPS2 = 0.8
"""Well inside nuPlan's bounds of comfort (4.89, 0.95, 1.93)."""
CENTRE_M = 0.05
"""The ego's centre keeps this far from lanes of the opposite direction."""
BEND_ROOM_M = (0.15, 0.3, 0.45, 0.6)
"""More clearance to try: in a bend a box takes more than its width, and points at what it is about to pass."""
CRAWL_MPS = 1.5
"""A path with a swerve that allows no more somewhere asks for more room."""
FIRST_S, FIRST_BRAKING_MPS2 = 1.0, 3.0
"""An ego that begins too fast for its place holds its speed for so long, then brakes this hard."""
ASTRIDE_M = 0.1
"""From this offset on who comes towards the ego may take it to be in the way."""
SWERVING_M = 0.3
"""From this offset on the ego is taken to be out of its lane."""


@dataclass(frozen=True, slots=True)
class Swerve:
    """How obstacles are passed."""

    over: Side | None = None
    """The side on which one leaves the lane to pass what a nudge does not pass; None: such a lane path is closed."""
    clearance_m: float = 0.4
    ramp_m: float = 28.0
    """Length of the move out, and of the move back."""
    haste: float = 1.0
    """How much more than in calm driving one is pressed to the side in bends."""
    beside_m: tuple[float, float] | None = None
    """From where to where, from the start on, one drives beside slow vehicles; None: one stays behind them."""


@dataclass(frozen=True, slots=True, eq=False)
class DrivablePath:
    """A lane path as it is driven, on the corridor's grid of G arcs."""

    lane_path: LanePath
    left_m: Floats
    """(G,) offset of the driven line; not a number where the lane path does not exist."""
    cap_mps: Floats
    """(G,) highest speed: limit, bends, and standing obstacles straight ahead."""
    closed: NDArray[np.bool_]
    """(G,) where the ego's box would touch an obstacle or leave the road, or where there is no lane path."""
    swerving: NDArray[np.bool_]
    """(G,) where the driven line leaves the lane."""

    @property
    def over(self) -> NDArray[np.bool_]:
        """(G,) where it swerves by more than a nudge, from the first step aside to the last."""
        aside_m = np.abs(np.nan_to_num(self.left_m - self.lane_path.left_m))
        return (aside_m > ASTRIDE_M) & bool((aside_m > NUDGE_M).any())


def drivable_path(corridor: FrenetCorridor, lane_path: LanePath, swerve: Swerve) -> DrivablePath:
    """The path along a lane, the swerve around each group of obstacles included; with more room where that helps."""
    tried = [_drivable_path(corridor, lane_path, swerve)]
    if not tried[0].swerving.any():
        return tried[0]
    for more_m in BEND_ROOM_M:
        if _slowest_mps(tried[-1]) >= CRAWL_MPS:
            return tried[-1]
        tried.append(_drivable_path(corridor, lane_path, replace(swerve, clearance_m=swerve.clearance_m + more_m)))
    return max(tried, key=_slowest_mps)


def _slowest_mps(path: DrivablePath) -> float:
    """The lowest speed that a path allows anywhere; -1 if it is closed there."""
    allowed = np.where(path.closed, -1.0, path.cap_mps)
    return float(allowed[np.isfinite(path.left_m)].min())


def _drivable_path(corridor: FrenetCorridor, lane_path: LanePath, swerve: Swerve) -> DrivablePath:
    exists = np.isfinite(lane_path.left_m)
    aside = _asides(corridor, lane_path, swerve)
    left = lane_path.left_m + aside
    filled = np.where(exists, left, np.interp(corridor.arc_m, corridor.arc_m[exists], left[exists]))
    xy = corridor.points(filled)
    heading = headings_of(xy)
    body = held_back(heading)
    closed, straight_cap = _obstructed(corridor, xy, body, swerve.clearance_m)
    closed |= ~exists
    closed |= _off_road(corridor, xy, body, aside != 0.0)
    if "driving_direction" not in corridor.scenario.exempt:
        closed |= _against_traffic(corridor, xy, heading, np.abs(aside) > SWERVING_M)
    wanted = np.minimum(lane_path.limit_mps, _bend_cap_mps(xy, heading, swerve.haste))
    cap = np.minimum(np.maximum(wanted, _braking_mps(corridor)), straight_cap)
    return DrivablePath(lane_path, left, cap, closed, np.abs(aside) > SWERVING_M)


def headings_of(xy: Floats) -> Floats:
    """(G,) smooth headings along points (G, 2), not wrapped."""
    dx, dy = np.gradient(xy[:, 0]), np.gradient(xy[:, 1])
    return smoothed(np.unwrap(np.arctan2(dy, dx)), 2)


def held_back(values: Floats) -> Floats:
    """(G,) values at the rear axle for each place of the centre: the car heads where its rear axle goes."""
    return np.concatenate((np.repeat(values[:1], REAR_CELLS), values[:-REAR_CELLS]))


def blocked_by(
    corridor: FrenetCorridor, lane_path: LanePath, clearance_m: float, beside_m: tuple[float, float] | None = None
) -> list[tuple[float, float, float, float]]:
    """Groups of obstacles in the way: arcs from and to, and the offsets that pass them on the right and left.

    Slow vehicles take part with where one drives beside them, if anywhere.
    """
    boxes = [corridor.unrolled(corners)[:2] for corners in obstacle_corners(corridor)]
    if beside_m is not None:
        arcs_m = corridor.start_m + np.array(beside_m)[[0, 0, 1, 1]]
        for corners in slow_corners(corridor):
            left_m = corridor.unrolled(corners)[1]
            right, left = float(left_m.min()) - SWAY_M, float(left_m.max()) + SWAY_M
            boxes.append((arcs_m, np.array((right, left, right, left))))
    found: list[tuple[float, float, float, float]] = []
    half_m = HALF_WIDTH_M + clearance_m
    exists = np.isfinite(lane_path.left_m)
    arc_m, left_m = corridor.arc_m[exists], lane_path.left_m[exists]
    for arc, left in boxes:
        if arc.max() < arc_m[0] or arc.min() > arc_m[-1]:
            continue
        beside = left - np.interp(arc, arc_m, left_m)
        if beside.min() < half_m and beside.max() > -half_m:
            found.append(
                (float(arc.min()), float(arc.max()), float(beside.min()) - half_m, float(beside.max()) + half_m)
            )
    groups: list[tuple[float, float, float, float]] = []
    for one in sorted(found):
        if groups and one[0] - groups[-1][1] < SAME_SWERVE_M:
            last = groups[-1]
            groups[-1] = (last[0], max(last[1], one[1]), min(last[2], one[2]), max(last[3], one[3]))
        else:
            groups.append(one)
    return groups


def obstacle_corners(corridor: FrenetCorridor) -> list[Floats]:
    """The corners (4, 2) of every obstacle."""
    poses = [(each.pose(corridor.roads), each.size_m) for each in corridor.scenario.obstacles]
    return [box_corners(p.x_m, p.y_m, p.heading_rad, *size)[0] for p, size in poses]


def slow_corners(corridor: FrenetCorridor) -> list[Floats]:
    """The corners (4, 2) of every slow vehicle where it starts."""
    slow = [each for each in corridor.scenario.vehicles if each.kind in SLOW_KINDS]
    poses = [(each.place.pose(corridor.roads), SLOW_SIZES_M[each.kind]) for each in slow]
    return [box_corners(p.x_m, p.y_m, p.heading_rad, *size)[0] for p, size in poses]


def _asides(corridor: FrenetCorridor, lane_path: LanePath, swerve: Swerve) -> Floats:
    """(G,) how far the driven line leaves the lane path, left positive."""
    aside = np.zeros(len(corridor.arc_m))
    for first_m, last_m, right_m, left_m in blocked_by(corridor, lane_path, swerve.clearance_m, swerve.beside_m):
        offset_m = min(right_m, left_m, key=abs)
        if abs(offset_m) > NUDGE_M:
            if swerve.over is None:
                continue
            offset_m = left_m if swerve.over == "left" else right_m
        begin_m, end_m = first_m - HALF_LENGTH_M - 1.0, last_m + HALF_LENGTH_M + 0.5
        out_m = min(swerve.ramp_m, max(6.0, begin_m - corridor.start_m - 1.0))
        out = quintic((corridor.arc_m - (begin_m - out_m)) / out_m)
        back = quintic((corridor.arc_m - end_m) / swerve.ramp_m)
        bump = offset_m * (out - back)
        aside = np.where(np.abs(bump) > np.abs(aside), bump, aside)
    return aside


def quintic(share: Floats) -> Floats:
    """0 to 1 over shares 0 to 1, with neither slope nor curvature at the ends."""
    u = np.clip(share, 0.0, 1.0)
    return u * u * u * (10.0 + u * (6.0 * u - 15.0))


def _obstructed(
    corridor: FrenetCorridor, xy: Floats, heading: Floats, clearance_m: float
) -> tuple[NDArray[np.bool_], Floats]:
    """(G,) where the ego would touch an obstacle, and the speed at which one straight ahead is far enough away."""
    closed = np.zeros(len(xy), dtype=np.bool_)
    cap = np.full(len(xy), np.inf)
    for obstacle in corridor.scenario.obstacles:
        pose, size_m = obstacle.pose(corridor.roads), obstacle.size_m
        begin_m, cease_m = _straight_on_m(xy, heading, min(TOUCH_M, 0.5 * clearance_m), pose, size_m)
        closed |= (begin_m <= 0.0) & (cease_m >= 0.0)
        begin_m, cease_m = _straight_on_m(xy, heading, min(SWAY_M, 0.7 * clearance_m), pose, size_m)
        meets = (begin_m <= cease_m) & (cease_m >= 0.0)
        cap = np.where(meets, np.minimum(cap, np.maximum(begin_m, 0.0) / LOOKAHEAD_S), cap)
    return closed, cap


def _straight_on_m(
    xy: Floats, heading: Floats, room_m: float, pose: Pose, size_m: tuple[float, float]
) -> tuple[Floats, Floats]:
    """(G,) after how many metres straight on the ego, `room_m` wider on each side, begins and ceases to touch a box."""
    many = len(xy)
    grown_m = (PACIFICA.length_m + room_m, PACIFICA.width_m + 2.0 * room_m)
    return overlap_span_s(
        xy, heading, np.broadcast_to(grown_m, (many, 2)), np.stack((np.cos(heading), np.sin(heading)), axis=1),
        np.broadcast_to((pose.x_m, pose.y_m), (many, 2)), np.full(many, pose.heading_rad),
        np.broadcast_to(size_m, (many, 2)), np.zeros((many, 2)),
    )  # fmt: skip


def _off_road(corridor: FrenetCorridor, xy: Floats, heading: Floats, where: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(G,) where a corner of the ego's box leaves the road; looked at only where asked."""
    off = np.zeros(len(xy), dtype=np.bool_)
    rows = np.flatnonzero(where)
    if len(rows):
        corners = box_corners(xy[rows, 0], xy[rows, 1], heading[rows], PACIFICA.length_m, PACIFICA.width_m).reshape(
            -1, 2
        )
        distance = np.zeros(len(corners))
        outside = ~corridor.roads.drivable(corners)
        if outside.any():
            distance[outside] = corridor.roads.distance_to_drivable_m(corners[outside])
        off[rows] = (distance > OFF_ROAD_M).reshape(-1, 4).any(axis=1)
    return off


def _against_traffic(
    corridor: FrenetCorridor, xy: Floats, heading: Floats, where: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """(G,) where the centre of the ego is in a lane of the opposite direction; looked at only where asked."""
    against = np.zeros(len(xy), dtype=np.bool_)
    for row in np.flatnonzero(where).tolist():
        for side_m in (-CENTRE_M, CENTRE_M):
            x_m = float(xy[row, 0] - side_m * np.sin(heading[row]))
            y_m = float(xy[row, 1] + side_m * np.cos(heading[row]))
            for lane_id in corridor.roads.lanes_at(x_m, y_m):
                line = corridor.roads[lane_id].centerline
                along = line.pose_at(line.project_point(x_m, y_m)[0]).heading_rad
                against[row] |= bool(np.cos(along - heading[row]) < 0.0)
    return against


def _braking_mps(corridor: FrenetCorridor) -> Floats:
    """(G,) the speed that an ego still has that begins faster than its place allows."""
    start_mps = corridor.scenario.start_speed_mps
    braked_m = corridor.arc_m - corridor.start_m - FIRST_S * start_mps
    return np.sqrt(np.maximum(0.0, start_mps**2 - 2.0 * FIRST_BRAKING_MPS2 * np.maximum(0.0, braked_m)))


def _bend_cap_mps(xy: Floats, heading: Floats, haste: float) -> Floats:
    """(G,) speed at which a line is driven in comfort."""
    step_m = np.maximum(np.hypot(np.gradient(xy[:, 0]), np.gradient(xy[:, 1])), 0.1 * GRID_M)
    curvature = smoothed(np.gradient(heading) / step_m, 2)
    change = smoothed(np.gradient(curvature) / step_m, 2)
    with np.errstate(divide="ignore"):
        lateral = np.sqrt(haste * LATERAL_MPS2 / np.abs(curvature))
        turning = haste * YAW_RATE_RADPS / np.abs(curvature)
        steering = np.sqrt(haste * YAW_ACCELERATION_RADPS2 / np.abs(change))
    return np.minimum(np.minimum(lateral, turning), steering)
