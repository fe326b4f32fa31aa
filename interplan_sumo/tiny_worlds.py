"""Tiny worlds: roads, actors, drives and observations small enough to check in the head.

The conformance suite drives planners on them, and so may anyone's own tests.
Ids can be read: on a road, block 1 is the first roadblock, 2 the connector
after it, 3 the next roadblock, and lane "32" is the second lane from the left
of block 3; on a junction, lane "1" comes in on arm 1, "7" goes out on arm 3
and connector "13" joins arm 1 to arm 3.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import shapely

from interplan_sumo.planner import Mission, Observation, Past
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import PACIFICA, EgoShape, EgoState
from interplan_sumo.world.geometry import Floats, Polyline, Pose
from interplan_sumo.world.roads import (
    Area,
    Connector,
    DrivingSide,
    Intersection,
    IntersectionKind,
    Lane,
    Roadblock,
    Roads,
    StopLine,
    StopLineKind,
    Turn,
)
from interplan_sumo.world.signals import Signals, SignalStatus
from interplan_sumo.world.trace import ActorTable, EgoTrack, Trace
from interplan_sumo.world.trajectory import Trajectory

LANE_WIDTH_M = 3.5
CRS = "EPSG:32632"
DT_S = 0.1

# --- roads ---------------------------------------------------------------------------------------


def straight_road(
    lanes: int = 1,
    length_m: float = 200.0,
    limit_mps: float | None = 15.0,
    cuts_m: Sequence[tuple[float, float]] = (),
    driving_side: DrivingSide = "right",
) -> Roads:
    """A road from the origin towards +x; the centre line of the leftmost lane is the x axis.

    Each cut (start, end) makes the piece between two arc lengths a connector.
    """
    return road_along(Polyline(np.array(((0.0, 0.0), (length_m, 0.0)))), lanes, limit_mps, cuts_m, driving_side)


def curved_road(
    radius_m: float = 40.0,
    angle_rad: float = np.pi / 2,
    run_in_m: float = 40.0,
    lanes: int = 1,
    limit_mps: float | None = 10.0,
    cuts_m: Sequence[tuple[float, float]] = (),
) -> Roads:
    """A road from the origin towards +x that bends left (right for a negative angle) and runs on straight."""
    bend = _arc(np.array((run_in_m, 0.0)), 0.0, radius_m, angle_rad)
    out = bend[-1] + run_in_m * np.array((np.cos(angle_rad), np.sin(angle_rad)))
    return road_along(Polyline(np.vstack(((0.0, 0.0), bend, out))), lanes, limit_mps, cuts_m)


def road_along(
    line: Polyline,
    lanes: int = 1,
    limit_mps: float | None = 15.0,
    cuts_m: Sequence[tuple[float, float]] = (),
    driving_side: DrivingSide = "right",
) -> Roads:
    """A one-way road of parallel lanes; `line` is the centre line of the leftmost one.

    Each cut (start, end) makes the piece between two arc lengths of `line` a
    connector.
    """
    ends = [0.0, *(m for cut in cuts_m for m in cut), line.length_m]
    lane_table: dict[str, Lane] = {}
    connectors: dict[str, Connector] = {}
    blocks: dict[str, Roadblock] = {}
    intersections: list[Intersection] = []
    segments: list[Area] = []
    arc_m = line.resampled(1.0).arc_m
    arc_m = np.sort(np.concatenate([arc_m[np.abs(arc_m[:, None] - ends).min(axis=1) > 0.05], ends]))
    cut_line = Polyline(line.poses_at(arc_m)[:, :2])
    cuts = np.searchsorted(arc_m, ends)

    def piece(k: int, left_m: float) -> Polyline:
        return Polyline(_offset(cut_line, left_m).points[cuts[k] : cuts[k + 1] + 1])

    for k in range(len(ends) - 1):
        block_id, is_connector = str(k + 1), k % 2 == 1
        ids = tuple(f"{block_id}{i + 1}" for i in range(lanes))
        for i, lane_id in enumerate(ids):
            centre, left, right = (piece(k, (side / 2 - i) * LANE_WIDTH_M) for side in (0, 1, -1))
            centre, polygon = centre.resampled(1.0), _band(left, right)  # the outer side of a bend is longer
            if is_connector:
                connectors[lane_id] = Connector(
                    lane_id, block_id, f"{k}{i + 1}", f"{k + 2}{i + 1}", centre, polygon, left, right, limit_mps,
                    Turn.STRAIGHT,
                )  # fmt: skip
            else:
                lane_table[lane_id] = Lane(lane_id, block_id, i, centre, polygon, left, right, limit_mps)
        surface = _band(piece(k, LANE_WIDTH_M / 2), piece(k, (0.5 - lanes) * LANE_WIDTH_M))
        if is_connector:
            blocks[block_id] = Roadblock(block_id, surface, ids, True, str(k), str(k + 2), f"{block_id}00")
            intersections.append(Intersection(f"{block_id}00", surface, IntersectionKind.PASS_THROUGH))
        else:
            blocks[block_id] = Roadblock(block_id, surface, ids)
            segments.append(Area(block_id, surface))
    return Roads(
        "tiny_road", CRS, driving_side, lane_table, connectors, blocks,
        intersections=tuple(intersections), road_segments=tuple(segments),
    )  # fmt: skip


def junction(
    arm_m: float = 60.0,
    limit_mps: float | None = 12.0,
    driving_side: DrivingSide = "right",
    half_size_m: float = 12.0,
) -> Roads:
    """A crossing with traffic lights at the origin: four arms, one lane in and one lane out each.

    Arms are 1 west, 2 south, 3 east, 4 north. Lane "1" comes in from the west,
    "7" goes out to the east, connector "13" leads from one to the other; every
    roadblock has the id of its only lane. Stop line "1" holds lane "1".
    """
    side = 1.0 if driving_side == "right" else -1.0
    angles = (np.pi, -np.pi / 2, 0.0, np.pi / 2)
    starts: list[Floats] = []
    lane_table: dict[str, Lane] = {}
    connectors: dict[str, Connector] = {}
    blocks: dict[str, Roadblock] = {}
    stop_lines: dict[str, StopLine] = {}
    segments: list[Area] = []
    for arm, angle in enumerate(angles):
        outward = np.array((np.cos(angle), np.sin(angle)))
        shift = side * LANE_WIDTH_M / 2 * np.array((-outward[1], outward[0]))
        inner, outer = half_size_m * outward, (half_size_m + arm_m) * outward
        starts.append(inner + shift)
        for lane_id, ends in (
            (str(arm + 1), (outer + shift, inner + shift)),
            (str(arm + 5), (inner - shift, outer - shift)),
        ):
            line = Polyline(np.array(ends)).resampled(1.0)
            centre, left, right, polygon = _strip(line)
            lane_table[lane_id] = Lane(lane_id, lane_id, 0, centre, polygon, left, right, limit_mps)
            blocks[lane_id] = Roadblock(lane_id, polygon, (lane_id,))
            segments.append(Area(lane_id, polygon))
        mouth = _strip(Polyline(np.array((inner + shift + 1.0 * outward, inner + shift))))[3]
        stop_lines[str(arm + 1)] = StopLine(str(arm + 1), mouth, StopLineKind.TRAFFIC_LIGHT)
    for a, entering in enumerate(angles):
        for b, leaving in enumerate(angles):
            if a == b:
                continue
            turn_rad = float(np.arctan2(np.sin(leaving - entering - np.pi), np.cos(leaving - entering - np.pi)))
            heading = entering + np.pi
            if abs(turn_rad) < 0.1:
                step = 2 * half_size_m * np.array((np.cos(heading), np.sin(heading)))
                points, turn = np.array((starts[a], starts[a] + step)), Turn.STRAIGHT
            else:
                radius_m = half_size_m + side * np.sign(turn_rad) * LANE_WIDTH_M / 2
                points = _arc(starts[a], heading, radius_m, turn_rad)
                turn = Turn.LEFT if turn_rad > 0 else Turn.RIGHT
            centre, left, right, polygon = _strip(Polyline(points).resampled(1.0))
            connector_id, from_id, to_id = f"{a + 1}{b + 1}", str(a + 1), str(b + 5)
            connectors[connector_id] = Connector(
                connector_id, connector_id, from_id, to_id, centre, polygon, left, right, limit_mps, turn, (from_id,)
            )
            blocks[connector_id] = Roadblock(connector_id, polygon, (connector_id,), True, from_id, to_id, "100")
    area = shapely.box(-half_size_m, -half_size_m, half_size_m, half_size_m)
    return Roads(
        "tiny_junction", CRS, driving_side, lane_table, connectors, blocks,
        intersections=(Intersection("100", area, IntersectionKind.TRAFFIC_LIGHT),),
        stop_lines=stop_lines, road_segments=tuple(segments),
    )  # fmt: skip


def _arc(start: Floats, heading_rad: float, radius_m: float, angle_rad: float) -> Floats:
    """Points at most 1 m apart on a circle; a positive angle bends left."""
    side = np.sign(angle_rad)
    centre = start + side * radius_m * np.array((-np.sin(heading_rad), np.cos(heading_rad)))
    count = max(2, int(np.ceil(radius_m * abs(angle_rad))) + 1)
    bearing = heading_rad - side * np.pi / 2 + np.linspace(0.0, angle_rad, count)
    return centre + radius_m * np.stack((np.cos(bearing), np.sin(bearing)), axis=1)


def _offset(line: Polyline, left_m: float) -> Polyline:
    """The line moved sideways, vertex by vertex."""
    tangent = np.gradient(line.points, axis=0)
    tangent /= np.hypot(tangent[:, 0], tangent[:, 1])[:, None]
    return Polyline(line.points + left_m * np.stack((-tangent[:, 1], tangent[:, 0]), axis=1))


def _strip(centre: Polyline) -> tuple[Polyline, Polyline, Polyline, shapely.Polygon]:
    """A centre line with its left boundary, right boundary and lane polygon."""
    left, right = _offset(centre, LANE_WIDTH_M / 2), _offset(centre, -LANE_WIDTH_M / 2)
    return centre, left, right, _band(left, right)


def _band(left: Polyline, right: Polyline) -> shapely.Polygon:
    return shapely.Polygon(np.vstack((left.points, right.points[::-1])))


# --- ego, actors, signals ------------------------------------------------------------------------


def ego(
    x_m: float = 0.0, y_m: float = 0.0, speed_mps: float = 0.0, heading_rad: float = 0.0, time_s: float = 0.0
) -> EgoState:
    """An ego with its box centre at a point, driving straight."""
    return EgoState(time_s, x_m, y_m, heading_rad, vx_mps=speed_mps)


def ego_on(roads: Roads, lane_id: str, arc_m: float, speed_mps: float = 0.0, time_s: float = 0.0) -> EgoState:
    """An ego with its box centre on a lane's centre line."""
    pose = roads[lane_id].centerline.pose_at(arc_m)
    return ego(pose.x_m, pose.y_m, speed_mps, pose.heading_rad, time_s)


def cars(
    *places: tuple[float, ...],
    kind: ActorKind = ActorKind.VEHICLE,
    length_m: float = 4.8,
    width_m: float = 2.0,
    prefix: str = "car",
) -> Actors:
    """Actors from (x, y), (x, y, speed) or (x, y, speed, heading) of their box centres; ids car00, car01, ..."""
    rows = np.array([(*place, *(0.0,) * (4 - len(place))) for place in places], dtype=np.float64).reshape(-1, 4)
    x_m, y_m, speed_mps, heading_rad = rows.T
    count = len(rows)
    digits = max(2, len(str(count - 1)))  # so that ids sort as they count
    return Actors(
        tuple(f"{prefix}{i:0{digits}d}" for i in range(count)),
        np.full(count, kind, dtype=np.int8),
        x_m, y_m, heading_rad, np.full(count, length_m), np.full(count, width_m),
        speed_mps * np.cos(heading_rad), speed_mps * np.sin(heading_rad),
    )  # fmt: skip


def pedestrians(*places: tuple[float, ...]) -> Actors:
    """Pedestrians, 0.7 m square, placed as `cars` are; ids ped00, ped01, ..."""
    return cars(*places, kind=ActorKind.PEDESTRIAN, length_m=0.7, width_m=0.7, prefix="ped")


def together(*groups: Actors) -> Actors:
    """Several groups of actors as one."""
    ids = [i for group in groups for i in group.ids]
    order = sorted(range(len(ids)), key=ids.__getitem__)
    names = ("kind", "x_m", "y_m", "heading_rad", "length_m", "width_m", "vx_mps", "vy_mps")
    columns = {name: np.concatenate([getattr(group, name) for group in groups])[order] for name in names}
    return Actors(tuple(ids[i] for i in order), **columns)


def signals(red: Iterable[str] = (), green: Iterable[str] = (), yellow: Iterable[str] = ()) -> Signals:
    """The state of light-controlled connectors."""
    status = {
        **dict.fromkeys(red, SignalStatus.RED),
        **dict.fromkeys(green, SignalStatus.GREEN),
        **dict.fromkeys(yellow, SignalStatus.YELLOW),
    }
    ids = tuple(sorted(status))
    return Signals(ids, np.array([status[i] for i in ids], dtype=np.int8))


# --- what planners are given ---------------------------------------------------------------------


def mission(roads: Roads, lane_ids: Sequence[str], goal_arc_m: float | None = None) -> Mission:
    """A mission through a chain of lanes and connectors; the goal lies on the last, 5 m before its end by default."""
    line = roads[lane_ids[-1]].centerline
    goal = line.pose_at(max(0.0, line.length_m - 5.0) if goal_arc_m is None else goal_arc_m)
    return Mission(roads, roads.route_through(lane_ids), goal, dt_s=DT_S)


def observation(
    ego: EgoState, actors: Actors | None = None, signals: Signals | None = None, past: Past | None = None
) -> Observation:
    """What a planner sees at the ego's time; whatever is left out is empty."""
    return Observation(
        ego.time_s,
        ego,
        Actors.none() if actors is None else actors,
        Signals.none() if signals is None else signals,
        Past() if past is None else past,
    )


# --- drives --------------------------------------------------------------------------------------


def drive(
    *speeds_mps: float,
    start: Pose = Pose(0.0, 0.0, 0.0),  # noqa: B008 - frozen
    actors: Sequence[Actors] | Actors | None = None,
    dt_s: float = DT_S,
    shape: EgoShape = PACIFICA,
) -> Trace:
    """A straight drive with one speed per frame; each step covers the speed at its start times `dt_s`.

    Actors are one per frame, or one that stays for all of them.
    """
    speed = np.asarray(speeds_mps, dtype=np.float64)
    arc_m = np.concatenate(([0.0], np.cumsum(speed[:-1] * dt_s)))
    poses = np.stack(
        (
            start.x_m + arc_m * np.cos(start.heading_rad),
            start.y_m + arc_m * np.sin(start.heading_rad),
            np.full_like(arc_m, start.heading_rad),
        ),
        axis=1,
    )
    return drive_through(poses, speed, actors, dt_s, shape)


def drive_along(
    line: Polyline,
    *speeds_mps: float,
    start_m: float = 0.0,
    actors: Sequence[Actors] | Actors | None = None,
    dt_s: float = DT_S,
    shape: EgoShape = PACIFICA,
) -> Trace:
    """A drive with the box centre on a line, one speed per frame, starting at an arc length of it."""
    speed = np.asarray(speeds_mps, dtype=np.float64)
    arc_m = start_m + np.concatenate(([0.0], np.cumsum(speed[:-1] * dt_s)))
    return drive_through(line.poses_at(arc_m), speed, actors, dt_s, shape)


def drive_through(
    poses: Floats,
    speeds_mps: Floats,
    actors: Sequence[Actors] | Actors | None = None,
    dt_s: float = DT_S,
    shape: EgoShape = PACIFICA,
) -> Trace:
    """A drive through centre poses (N, 3) with speeds (N,).

    Accelerations, yaw rates and yaw accelerations are backward differences, 0
    in the first frame. Every plan holds heading and speed for 1 s.
    """
    frames = len(poses)

    def rate(values: Floats) -> Floats:
        return np.concatenate(([0.0], np.diff(values) / dt_s))

    heading = np.unwrap(poses[:, 2])
    yaw_rate = rate(heading)
    none = np.zeros(frames)
    time_us = np.round(np.arange(frames) * dt_s * 1e6).astype(np.int64)
    track = EgoTrack(
        time_us, poses[:, 0], poses[:, 1], heading, speeds_mps, none, rate(speeds_mps), none, none, none, yaw_rate,
        rate(yaw_rate),
    )  # fmt: skip
    around = [Actors.none() if actors is None else actors] * frames if not isinstance(actors, Sequence) else actors
    plans = tuple(straight_plan(track.state(k)) for k in range(frames))
    return Trace(track, ActorTable.of(around), (Signals.none(),) * frames, plans, np.full(frames, 1e-3), shape)


def straight_plan(ego: EgoState, horizon_s: float = 1.0, step_s: float = 0.5) -> Trajectory:
    """Heading and speed held from now on."""
    ahead_s = np.linspace(0.0, horizon_s, round(horizon_s / step_s) + 1)
    travelled_m = ego.speed_mps * ahead_s
    return Trajectory(
        ego.time_s + ahead_s,
        ego.x_m + travelled_m * np.cos(ego.heading_rad),
        ego.y_m + travelled_m * np.sin(ego.heading_rad),
        np.full_like(ahead_s, ego.heading_rad),
    )
