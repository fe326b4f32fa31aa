"""Who follows whom in a recording, told from the motions alone: no map is needed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from interplan_sumo.realism.motion import Motion
from interplan_sumo.world.geometry import Floats, Ints, frozen, wrap_angle

FARTHEST_M: Final = 80.0
"""Whoever is farther ahead, bumper to bumper, is followed by nobody."""
OVERLAP_M: Final = 0.3
"""A leader's body lies at least so far, sideways, in the way that the follower's body will take."""
SAME_WAY_RAD: Final = np.radians(30.0)
"""A leader heads at most this far off the follower's way."""
SHORTEST_S: Final = 1.0
"""A shorter leadership is no episode."""
_SPACING_M: Final = 0.25
"""Between the points of a way."""


@dataclass(frozen=True, slots=True, eq=False)
class Following:
    """One vehicle behind another, without a break. Arrays (N,), evenly spaced in time, are made read-only."""

    follower: Motion
    leader: Motion
    time_s: Floats
    gap_m: Floats
    """From bumper to bumper along the follower's way."""
    speed_mps: Floats
    leader_speed_mps: Floats
    acceleration_mps2: Floats

    def __post_init__(self) -> None:
        for name in ("time_s", "gap_m", "speed_mps", "leader_speed_mps", "acceleration_mps2"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def step_s(self) -> float:
        return float(self.time_s[1] - self.time_s[0])


@dataclass(frozen=True, slots=True, eq=False)
class _Samples:
    """All vehicles on one time grid, one row per vehicle and step, sorted by vehicle and step."""

    motions: Sequence[Motion]
    start_s: float
    step_s: float
    vehicle: Ints
    step: Ints
    xy: Floats
    heading_rad: Floats
    speed_mps: Floats
    acceleration_mps2: Floats
    length_m: Floats = field(init=False)
    width_m: Floats = field(init=False)

    def __post_init__(self) -> None:
        for name in ("length_m", "width_m"):
            sizes = np.array([getattr(each.track, name) for each in self.motions])
            object.__setattr__(self, name, sizes[self.vehicle])


def followings(motions: Iterable[Motion], shortest_s: float = SHORTEST_S) -> list[Following]:
    """The episodes of continuous leadership among the vehicles, by follower and time.

    A vehicle's way is the one it took after, straight on from where its record
    ends. Its leader is the nearest vehicle on it.
    """
    vehicles = [each for each in motions if each.track.kind == "vehicle" and len(each.time_s) > 1]
    if len(vehicles) < 2:
        return []
    samples = _samples(vehicles)
    tree = KDTree(samples.xy)
    return [
        episode
        for follower in range(len(vehicles))
        for episode in _episodes(samples, *_leaders(samples, tree, follower), shortest_s)
    ]


def _samples(motions: Sequence[Motion]) -> _Samples:
    step_s = float(np.median([each.step_s for each in motions]))
    start_s = min(each.time_s[0] for each in motions)
    columns: list[Floats] = []
    for number, each in enumerate(motions):
        first, last = (each.time_s[[0, -1]] - start_s) / step_s
        steps = np.arange(np.ceil(first - 1e-3), np.floor(last + 1e-3) + 1.0)
        time_s = start_s + steps * step_s
        values = [np.interp(time_s, each.time_s, value) for value in (
            each.x_m, each.y_m, np.unwrap(each.heading_rad), each.speed_mps, each.acceleration_mps2
        )]  # fmt: skip
        columns.append(np.stack((np.full(len(steps), number), steps, *values)))
    vehicle, step, x_m, y_m, heading_rad, speed_mps, acceleration_mps2 = np.concatenate(columns, axis=1)
    return _Samples(
        motions,
        start_s,
        step_s,
        vehicle.astype(np.int64),
        step.astype(np.int64),
        np.stack((x_m, y_m), axis=1),
        heading_rad,
        speed_mps,
        acceleration_mps2,
    )


def _leaders(samples: _Samples, tree: KDTree, follower: int) -> tuple[Ints, Ints, Floats]:
    """Rows of a follower that has a leader, the rows of the leaders at the same steps, and the gaps."""
    begin, end = np.searchsorted(samples.vehicle, (follower, follower + 1))
    own = np.arange(begin, end)
    if not len(own):
        return own, own, np.zeros(0)
    points, tangent_rad, arc_m, own_arc_m = _way(samples, own)
    reach_m = FARTHEST_M + float(np.hypot(*np.ptp(samples.xy[own], axis=0))) / 2.0 + 20.0
    near = np.sort(np.array(tree.query_ball_point(samples.xy[own].mean(axis=0), reach_m), dtype=np.int64))
    near = near[(samples.vehicle[near] != follower)]
    near = near[(samples.step[near] >= samples.step[own[0]]) & (samples.step[near] <= samples.step[own[-1]])]
    near = near[_may_lead(samples, near, own, tangent_rad)]
    if not len(near):
        return near, near, np.zeros(0)
    at = np.asarray(
        KDTree(points).query(samples.xy[near], distance_upper_bound=samples.width_m.max())[1], dtype=np.int64
    )
    near, at = near[at < len(points)], at[at < len(points)]
    dx, dy = (samples.xy[near] - points[at]).T
    cos, sin = np.cos(tangent_rad[at]), np.sin(tangent_rad[at])
    aside_m = np.abs(dy * cos - dx * sin)
    behind = own[samples.step[near] - samples.step[own[0]]]
    ahead_m = arc_m[at] + dx * cos + dy * sin - own_arc_m[behind - own[0]]
    gap_m = ahead_m - (samples.length_m[near] + samples.length_m[behind]) / 2.0
    leads = (
        (ahead_m > 0.0)
        & (gap_m > 0.0)
        & (gap_m < FARTHEST_M)
        & (aside_m < (samples.width_m[near] + samples.width_m[behind]) / 2.0 - OVERLAP_M)
        & (np.abs(wrap_angle(samples.heading_rad[near] - tangent_rad[at])) < SAME_WAY_RAD)
    )
    near, behind, gap_m = near[leads], behind[leads], gap_m[leads]
    order = np.lexsort((gap_m, behind))
    nearest = order[np.append(True, np.diff(behind[order]) > 0)] if len(order) else order
    return behind[nearest], near[nearest], gap_m[nearest]


def _may_lead(samples: _Samples, near: Ints, own: Ints, tangent_rad: Floats) -> NDArray[np.bool_]:
    """Who is not too far away at its time, and heads somewhere along the way: most others need no closer look."""
    at_the_time = own[samples.step[near] - samples.step[own[0]]]
    apart_m = np.hypot(*(samples.xy[near] - samples.xy[at_the_time]).T)
    turns_rad = np.unwrap(tangent_rad)
    middle_rad, half_rad = (turns_rad.max() + turns_rad.min()) / 2.0, float(np.ptp(turns_rad)) / 2.0
    along = np.abs(wrap_angle(samples.heading_rad[near] - middle_rad)) < half_rad + SAME_WAY_RAD
    return (apart_m < FARTHEST_M + samples.length_m.max() + samples.width_m.max()) & (
        along | (half_rad + SAME_WAY_RAD >= np.pi)
    )


def _way(samples: _Samples, own: Ints) -> tuple[Floats, Floats, Floats, Floats]:
    """Points of a vehicle's way with tangents and arc lengths, and the arc of the vehicle itself at each row."""
    moved_m = np.append(0.0, np.cumsum(np.hypot(*np.diff(samples.xy[own], axis=0).T)))
    last = own[-1]
    heading_rad = samples.heading_rad[last]
    beyond_m = np.arange(_SPACING_M, FARTHEST_M + 30.0, _SPACING_M)
    straight = samples.xy[last] + beyond_m[:, None] * np.array((np.cos(heading_rad), np.sin(heading_rad)))
    arc_m = np.arange(0.0, moved_m[-1], _SPACING_M) if moved_m[-1] > 0.0 else np.zeros(1)
    taken = np.stack([np.interp(arc_m, moved_m, each) for each in samples.xy[own].T], axis=1)
    turned_rad = np.interp(arc_m, moved_m, np.unwrap(samples.heading_rad[own]))
    return (
        np.concatenate((taken, straight)),
        np.concatenate((turned_rad, np.full(len(beyond_m), heading_rad))),
        np.concatenate((arc_m, moved_m[-1] + beyond_m)),
        moved_m,
    )


def _episodes(samples: _Samples, behind: Ints, ahead: Ints, gap_m: Floats, shortest_s: float) -> Iterator[Following]:
    if not len(behind):
        return
    cut = np.flatnonzero((np.diff(behind) != 1) | (np.diff(samples.vehicle[ahead]) != 0)) + 1
    for rows in np.split(np.arange(len(behind)), cut):
        if len(rows) < 2 or (len(rows) - 1) * samples.step_s < shortest_s - 1e-6:
            continue
        own, led = behind[rows], ahead[rows]
        yield Following(
            samples.motions[int(samples.vehicle[own[0]])],
            samples.motions[int(samples.vehicle[led[0]])],
            samples.start_s + samples.step_s * samples.step[own].astype(np.float64),
            gap_m[rows],
            samples.speed_mps[own],
            samples.speed_mps[led],
            samples.acceleration_mps2[own],
        )
