"""What no vehicle may ever do, stated from physics alone, and every place where a recorded drive does it.

Nothing here comes from the simulation: not a constant, not a helper. All
frames are the map frame in metres and radians, boxes given by their centres.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DT_S = 0.1
TOLERANCE_MPS2 = 0.05
"""Above emergencyDecel and accel."""
SLIP_DEG = 10.0
SLIPPING_MPS = 1.0
"""A body slower than this has no direction of motion to speak of."""
OVERLAP_M = 0.05
SIGHT_M = 100.0
REAR_AXLE = 0.2
"""Of the length, ahead of the rear bumper; a few long vehicles have it at 0.25."""
REAR_AXLE_FORWARD = 0.25
WHEELBASE = 0.6
"""Of the length: 2.76 m in a car of 4.6 m."""
FULL_LOCK_RAD = np.radians(40.0)
TURN_SLACK_RAD = np.radians(0.5)
"""Per step: what rounding and SUMO's angular resolution may add."""
JUMP_M = 0.6
"""The centre may be this far from where its velocity takes it: the turn of the body about its front."""
STRETCH = 0.15
"""SUMO scales the lanes of an edge to one length: on the outer lane of a bend a car covers this much more."""
MAP_END_M = 30.0
"""A vehicle that goes this near to where a road ends, or comes where one begins, does so with the map."""
STANDING_MPS = 0.5
STILL = 1e-6
"""In metres and radians per step: less is no motion."""
SEES_S = 4.0
"""Whoever has stood in a lane for so long is seen by everybody in it, whatever its type."""
IN_THE_WAY_M, ALIGNED_RAD = 1.2, 0.5
ERRORS, EIDM_ERROR = 4.0, 0.04
"""Standard deviations of an EIDM driver's error, nobody errs by more; and its `sigmaerror` where a type says none."""


@dataclass(frozen=True, slots=True)
class Violation:
    """One thing that cannot be, at one frame of one drive."""

    kind: str
    frame: int
    agent: str
    value: float
    detail: str = ""


@dataclass(frozen=True, slots=True)
class Body:
    """What SUMO says of one agent's type."""

    type_id: str
    accel_mps2: float
    emergency_decel_mps2: float


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One instant: everybody's boxes, and the ego's."""

    ids: tuple[str, ...]
    x_m: Array
    y_m: Array
    heading_rad: Array
    length_m: Array
    width_m: Array
    speed_mps: Array
    """As shown to a planner."""
    sumo_mps: Array
    """As SUMO has it; nan for what is no vehicle of SUMO's."""
    ego: tuple[float, float, float, float, float]
    """x, y, heading, length, width."""


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """Frames as arrays over time and actors: (T, N), nan where one is absent."""

    ids: tuple[str, ...]
    x_m: Array
    y_m: Array
    heading_rad: Array
    speed_mps: Array
    sumo_mps: Array
    length_m: Array  # (N,)
    width_m: Array  # (N,)
    ego: Array  # (T, 5)

    @classmethod
    def of(cls, frames: Sequence[Frame]) -> Drive:
        ids = tuple(sorted({name for frame in frames for name in frame.ids}))
        column = {name: i for i, name in enumerate(ids)}
        wide = np.full((5, len(frames), len(ids)), np.nan)
        size = np.zeros((2, len(ids)))
        for k, frame in enumerate(frames):
            at = [column[name] for name in frame.ids]
            parts = (frame.x_m, frame.y_m, frame.heading_rad, frame.speed_mps, frame.sumo_mps)
            for rows, values in zip(wide, parts, strict=True):
                rows[k, at] = values
            size[0, at], size[1, at] = frame.length_m, frame.width_m
        x, y, heading, shown, sumo = wide
        return cls(ids, x, y, heading, shown, sumo, size[0], size[1], np.array([frame.ego for frame in frames]))

    @property
    def there(self) -> NDArray[np.bool_]:
        """(T, N) who is there when."""
        return ~np.isnan(self.x_m)

    @property
    def states(self) -> tuple[Array, ...]:
        """Everybody's place, heading and speed, (T, N) each."""
        return self.x_m, self.y_m, self.heading_rad, self.speed_mps

    def point(self, behind_front: Any) -> tuple[Array, Array]:
        """(T, N) the point on each one's axis this share of its length behind its front bumper."""
        along = self.length_m * (0.5 - behind_front)
        return self.x_m + along * np.cos(self.heading_rad), self.y_m + along * np.sin(self.heading_rad)

    def corners(self, k: int, rows: Any) -> Array:
        """(M, 4, 2) boxes at frame `k`."""
        sizes = np.stack((self.length_m[rows], self.width_m[rows]), axis=1)
        return corners_of(self.x_m[k, rows], self.y_m[k, rows], self.heading_rad[k, rows], sizes)


def violations(
    drive: Drive,
    bodies: Mapping[str, Body],
    *,
    standing: frozenset[str] = frozenset(),
    walking: frozenset[str] = frozenset(),
    map_begins: Array | None = None,
    map_ends: Array | None = None,
) -> list[Violation]:
    """All violations of one drive but those that need a twin. `bodies` are the agents, by id."""
    found = [*braking_and_pushing(drive, bodies), *slips(drive, bodies), *turns(drive, bodies), *jumps(drive, bodies)]
    found += overlaps(drive, standing, walking, bodies)
    found += drives_into_the_ego(drive, bodies)
    found += comings_and_goings(drive, bodies, map_begins, map_ends)
    numbers = (drive.x_m, drive.y_m, drive.heading_rad, drive.speed_mps)
    for k, i in np.argwhere(drive.there & ~np.all([np.isfinite(each) for each in numbers], axis=0)):
        found.append(Violation("not_finite", int(k), drive.ids[i], 0.0))
    return sorted(found, key=lambda each: (each.kind, each.frame, each.agent))


def braking_and_pushing(drive: Drive, bodies: Mapping[str, Body]) -> Iterator[Violation]:
    """Speeds that brakes and engine cannot bring about: those that SUMO has, and those shown where they differ."""
    for source, speed in (("", drive.sumo_mps), ("_shown", drive.speed_mps)):
        change = np.diff(speed, axis=0) / DT_S
        for i, name in enumerate(drive.ids):
            body = bodies.get(name)
            if body is None:
                continue
            rates = change[:, i]
            if source:  # only what SUMO's own speeds do not say already
                rates = np.where(np.isclose(rates, np.diff(drive.sumo_mps[:, i]) / DT_S), np.nan, rates)
            for k in np.flatnonzero(rates < -body.emergency_decel_mps2 - TOLERANCE_MPS2):
                detail = f"{speed[k, i]:.2f} to {speed[k + 1, i]:.2f} m/s, emergencyDecel {body.emergency_decel_mps2:g}"
                yield Violation(f"braking{source}", int(k) + 1, name, float(-rates[k]), detail)
            for k in np.flatnonzero(rates > body.accel_mps2 + TOLERANCE_MPS2):
                detail = f"{speed[k, i]:.2f} to {speed[k + 1, i]:.2f} m/s, accel {body.accel_mps2:g}"
                yield Violation(f"acceleration{source}", int(k) + 1, name, float(rates[k]), detail)


def slip_deg(drive: Drive, axle: float) -> Array:
    """(T - 1, N) angle between where a rear axle goes and where its body points, degrees; nan when (almost) standing.

    `axle` is its share of the length ahead of the rear bumper. The body points half way between both frames, so a
    body that turns on a circle about its rear axle does not slip.
    """
    x, y = drive.point(1.0 - axle)
    turned = _wrapped(np.diff(drive.heading_rad, axis=0))
    heading = drive.heading_rad[:-1] + turned / 2.0
    off = np.abs(_wrapped(np.arctan2(np.diff(y, axis=0), np.diff(x, axis=0)) - heading))
    moves = np.minimum(drive.speed_mps[:-1], drive.speed_mps[1:]) > SLIPPING_MPS
    return np.where(moves, np.degrees(off), np.nan)


def slips(drive: Drive, bodies: Mapping[str, Body]) -> Iterator[Violation]:
    """Bodies that slide sideways: each spell of it once, at its worst."""
    rear, forward = slip_deg(drive, REAR_AXLE), slip_deg(drive, REAR_AXLE_FORWARD)
    for i, name in enumerate(drive.ids):
        if name not in bodies:
            continue
        for kind, here in (("side_slip", rear[:, i]), ("side_slip_at_0.25", forward[:, i])):
            for first, last in _spells(here > SLIP_DEG):
                k = first + int(np.argmax(here[first:last]))
                detail = f"{forward[k, i]:.1f} at 0.25, {last - first} frames, {drive.speed_mps[k, i]:.1f} m/s"
                yield Violation(kind, k + 1, name, float(here[k]), detail)


def turns(drive: Drive, bodies: Mapping[str, Body]) -> Iterator[Violation]:
    """Bodies that turn more than full lock turns them over the way that their rear axle went."""
    x, y = drive.point(1.0 - REAR_AXLE)
    way = np.hypot(np.diff(x, axis=0), np.diff(y, axis=0))
    turned = np.abs(_wrapped(np.diff(drive.heading_rad, axis=0)))
    sharpest = np.tan(FULL_LOCK_RAD) / (WHEELBASE * drive.length_m)
    over = turned - way * sharpest - TURN_SLACK_RAD
    for i, name in enumerate(drive.ids):
        if name not in bodies:
            continue
        for first, last in _spells(over[:, i] > 0.0):
            k = first + int(np.argmax(over[first:last, i]))
            detail = f"{np.degrees(turned[k, i]):.1f} deg over {way[k, i]:.2f} m, {last - first} frames"
            yield Violation("turn", k + 1, name, float(np.degrees(over[k, i])), detail)


def jumps(drive: Drive, bodies: Mapping[str, Body]) -> Iterator[Violation]:
    """Bodies that are elsewhere than their speed takes them."""
    fast = np.maximum(drive.speed_mps[:-1], drive.speed_mps[1:])
    way = np.hypot(np.diff(drive.x_m, axis=0), np.diff(drive.y_m, axis=0))
    over = way - (1.0 + STRETCH) * DT_S * fast - JUMP_M
    for k, i in np.argwhere(over > 0.0):
        if drive.ids[i] in bodies:
            detail = f"at {fast[k, i]:.2f} m/s"
            yield Violation("jump", int(k) + 1, drive.ids[i], float(way[k, i]), detail)


def overlaps(
    drive: Drive, standing: frozenset[str], walking: frozenset[str], bodies: Mapping[str, Body]
) -> Iterator[Violation]:
    """Pairs of boxes in one another, each encounter once, at its deepest; not two things that were placed so.

    Pedestrians yield to nobody: one that walks into a car that stands, or that could not stop any more when it set
    out, is its own affair.
    """
    placed = np.array([name in standing for name in drive.ids], dtype=bool)
    walks = np.array([name in walking for name in drive.ids], dtype=bool)
    reach = float((drive.length_m + drive.width_m).max(initial=0.0))
    open_: dict[tuple[int, int], tuple[int, float, int, int]] = {}
    for k in range(len(drive.x_m)):
        rows = np.flatnonzero(~np.isnan(drive.x_m[k]))
        x, y = drive.x_m[k, rows], drive.y_m[k, rows]
        near = np.hypot(x[:, None] - x, y[:, None] - y) < reach
        first, second = (rows[part] for part in np.nonzero(np.triu(near, 1)))
        free = ~(placed[first] & placed[second])
        first, second = first[free], second[free]
        depth = _depth_m(drive.corners(k, first), drive.corners(k, second))
        now = set[tuple[int, int]]()
        for i, j, deep in zip(first.tolist(), second.tolist(), depth.tolist(), strict=True):
            if deep <= OVERLAP_M or (walks[i] and walks[j]):
                continue
            if walks[i] or walks[j]:
                walker, car = (i, j) if walks[i] else (j, i)
                if drive.speed_mps[k, car] < STANDING_MPS or _set_out_too_late(drive, walker, car, k, bodies):
                    continue
            began, worst, at, _ = open_.get((i, j), (k, 0.0, k, k))
            open_[i, j] = (began, deep, k, k) if deep > worst else (began, worst, at, k)
            now.add((i, j))
        for pair in [pair for pair in open_ if pair not in now]:
            yield _overlap(drive, pair, open_.pop(pair), standing, walking)
    for pair, seen in open_.items():
        yield _overlap(drive, pair, seen, standing, walking)


def _set_out_too_late(drive: Drive, walker: int, car: int, k: int, bodies: Mapping[str, Body]) -> bool:
    """Whether a car that a pedestrian touches at frame `k` could not stop before its way when it set out."""
    body, moving = bodies.get(drive.ids[car]), np.flatnonzero(drive.speed_mps[: k + 1, walker] > 0.0)
    if body is None or not len(moving) or np.isnan(drive.x_m[moving[0], car]):
        return False
    began = int(moving[0])
    ends = [(drive.x_m[at, walker], drive.y_m[at, walker]) for at in (began, -1)]
    way_m = float(np.hypot(ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]))
    x, y, heading = (np.array([each]) for each in (*np.mean(ends, axis=0), drive.heading_rad[began, walker]))
    crossed = corners_of(x, y, heading, np.array([[way_m + drive.length_m[walker], drive.width_m[walker]]]))
    gone_m, before = 0.0, began
    for at in range(began, k + 1):
        gone_m += float(np.hypot(*(part[at, car] - part[before, car] for part in (drive.x_m, drive.y_m))))
        before = at
        if _depth_m(drive.corners(at, [car]), crossed)[0] > 0.0:
            break
    mps = float(drive.speed_mps[began, car])
    return gone_m < mps * DT_S + mps * mps / (2.0 * body.emergency_decel_mps2)


def drives_into_the_ego(drive: Drive, bodies: Mapping[str, Body]) -> Iterator[Violation]:
    """Agents that touch an ego that has stood in their way for long enough to see it and stop."""
    moved = np.concatenate(([True], np.abs(np.diff(drive.ego[:, :3], axis=0)).max(axis=1) > STILL))
    since = np.maximum.accumulate(np.where(moved, np.arange(len(moved)), 0))
    for i, name in enumerate(drive.ids):
        if name not in bodies:
            continue
        reach = float(np.hypot(drive.length_m[i] + drive.ego[0, 3], drive.width_m[i] + drive.ego[0, 4])) / 2.0
        near = np.hypot(drive.x_m[:, i] - drive.ego[:, 0], drive.y_m[:, i] - drive.ego[:, 1]) < reach
        touches = np.array([bool(each) and _touches_ego(drive, k, i) for k, each in enumerate(near)], dtype=bool)
        for first, _ in _spells(touches):
            seen = int(since[first]) + round(SEES_S / DT_S)
            mps = drive.speed_mps[seen, i] if seen < first else np.nan
            if not (np.isfinite(mps) and _is_in_the_way(drive, seen, i) and _is_in_the_way(drive, first - 1, i)):
                continue
            went = np.hypot(np.diff(drive.x_m[seen : first + 1, i]), np.diff(drive.y_m[seen : first + 1, i])).sum()
            if went > mps * DT_S + mps**2 / (2.0 * bodies[name].emergency_decel_mps2):
                detail = f"at {drive.speed_mps[first - 1, i]:.1f} m/s, the ego stands since frame {int(since[first])}"
                yield Violation("drives_into_ego", first, name, float(drive.speed_mps[first - 1, i]), detail)


def _touches_ego(drive: Drive, k: int, i: int) -> bool:
    x, y, heading, length, width = (drive.ego[k, j : j + 1] for j in range(5))
    ego = corners_of(x, y, heading, np.stack((length, width), axis=1))
    return float(_depth_m(drive.corners(k, [i]), ego)[0]) > OVERLAP_M


def _is_in_the_way(drive: Drive, k: int, i: int) -> bool:
    """Whether the ego's middle is straight ahead of an agent, and points its way."""
    dx, dy = drive.ego[k, 0] - drive.x_m[k, i], drive.ego[k, 1] - drive.y_m[k, i]
    along, across = np.cos(drive.heading_rad[k, i]), np.sin(drive.heading_rad[k, i])
    aligned = abs(_wrapped(drive.ego[k, 2] - drive.heading_rad[k, i])) < ALIGNED_RAD
    return bool(aligned and dx * along + dy * across > 0.0 and abs(dy * along - dx * across) < IN_THE_WAY_M)


def _overlap(
    drive: Drive, pair: tuple[int, int], seen: tuple[int, float, int, int], standing: frozenset[str],
    walking: frozenset[str],
) -> Violation:  # fmt: skip
    began, worst, at, last = seen
    names = tuple(drive.ids[i] for i in pair)
    speeds = ", ".join(f"{drive.speed_mps[began, i]:.1f}" for i in pair)
    kind = "overlap"
    if any(name in walking for name in names):
        kind = "overlap_pedestrian"
    elif any(name in standing for name in names):
        kind = "overlap_obstacle"
    return Violation(kind, began, "+".join(names), worst, f"deepest at {at}, until {last}, at first {speeds} m/s")


def comings_and_goings(
    drive: Drive, bodies: Mapping[str, Body], map_begins: Array | None, map_ends: Array | None
) -> Iterator[Violation]:
    """Agents that appear or leave in sight of the ego; at an end of the map under a name of its own."""
    there = drive.there
    for i, name in enumerate(drive.ids):
        if name not in bodies:
            continue
        frames = np.flatnonzero(there[:, i])
        for kind, k, edge in (("appears", frames[0], map_begins), ("leaves", frames[-1], map_ends)):
            if k == (0 if kind == "appears" else len(there) - 1):
                continue
            x, y = drive.x_m[k, i], drive.y_m[k, i]
            away_m = float(np.hypot(x - drive.ego[k, 0], y - drive.ego[k, 1]))
            if away_m >= SIGHT_M:
                continue
            at_edge = edge is not None and len(edge) > 0 and np.hypot(*(edge - (x, y)).T).min() < MAP_END_M
            yield Violation(f"{kind}{'_at_map_end' if at_edge else ''}", int(k), name, away_m, "m from the ego")
        gaps = frames[1:][np.diff(frames) > 1]
        for k in gaps:
            yield Violation("vanishes_and_returns", int(k), name, 0.0)


def erring(bodies: dict[str, Body], types: str) -> dict[str, Body]:
    """EIDM's drivers err by `sigmaerror` times `accel`, 2.2 times that with nobody near: the pedal goes so far, too."""
    if '"EIDM"' not in types:
        return bodies
    error = max((float(each) for each in re.findall(r'sigmaerror="([\d.]+)"', types)), default=EIDM_ERROR)
    most = 1.0 + 2.2 * ERRORS * error
    return {name: replace(body, accel_mps2=most * body.accel_mps2) for name, body in bodies.items()}


def _spells(on: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and one past the last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], on.astype(np.int8), [0])))).tolist()
    return [(a, b) for a, b in pairwise(edges)][::2]


def _wrapped(angle_rad: Any) -> Any:
    return (angle_rad + np.pi) % (2.0 * np.pi) - np.pi


def corners_of(x_m: Array, y_m: Array, heading_rad: Array, size_m: Array) -> Array:
    """(M, 4, 2) corners of boxes, in order around them; `size_m` (M, 2) is length and width."""
    signs = np.array(((1, 1), (-1, 1), (-1, -1), (1, -1))) / 2.0
    local = signs[None] * size_m[:, None, :]
    cosine, sine = np.cos(heading_rad)[:, None], np.sin(heading_rad)[:, None]
    x = x_m[:, None] + cosine * local[..., 0] - sine * local[..., 1]
    y = y_m[:, None] + sine * local[..., 0] + cosine * local[..., 1]
    return np.stack((x, y), axis=-1)


def _depth_m(one: Array, other: Array) -> Array:
    """(M,) how far boxes (M, 4, 2) must move to come apart; 0 or less if they are."""
    depth = np.full(len(one), np.inf)
    for box in (one, other):
        for side in (box[:, 1] - box[:, 0], box[:, 2] - box[:, 1]):
            axis = side / np.linalg.norm(side, axis=1, keepdims=True)
            a, b = (np.einsum("mij,mj->mi", corners, axis) for corners in (one, other))
            depth = np.minimum(depth, np.minimum(a.max(1), b.max(1)) - np.maximum(a.min(1), b.min(1)))
    return depth
