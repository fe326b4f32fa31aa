"""The Intelligent Driver Model for many proposals at once: how far each gets along its path behind whoever leads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from interplan_planners.common.idm_policy import IdmDriver, IdmLaw
from interplan_planners.common.occupancy import StripOccupancy
from interplan_planners.common.ragged import stacked
from interplan_sumo.world.geometry import Floats, Ints

_AT_THE_END = 1e300
"""Farther than all, but a number."""


@dataclass(frozen=True, eq=False)
class Rollout:
    """N proposals over T steps; the first column is now."""

    progress_m: Floats  # (N, T + 1) arc length on the proposal's path
    speed_mps: Floats  # (N, T + 1)


@dataclass(frozen=True, eq=False)
class ProposalPath:
    """One path as a roll-out sees it: its end and who is on it."""

    length_m: float
    occupied: StripOccupancy
    standing_m: Sequence[tuple[float, float]] = ()
    """Stretches that stay occupied by something that stands, such as connectors that show red."""
    limit_mps: Floats | None = None
    """(S,) a speed limit for each metre of the path; None: only the target speed counts."""


@dataclass(frozen=True, eq=False)
class RolloutStart:
    """N proposals before the first step."""

    track_of: Ints  # (N,)
    progress_m: Floats  # (N,) arc length on the track
    speed_mps: ArrayLike  # (N,), or one for all


@dataclass(frozen=True, eq=False)
class RolloutClock:
    """The steps of a roll-out."""

    instants: Ints  # (T + 1,) for each step the column of the occupancies
    step_s: float = 0.1
    lead_every: int = 2
    """The lead is looked for at every so many-th step."""


def roll_out(
    tracks: Sequence[ProposalPath],
    start: RolloutStart,
    target_mps: Floats,
    driver: IdmDriver,
    bumpers_m: tuple[float, float],
    clock: RolloutClock,
    most_mps2: Floats | None = None,
) -> Rollout:
    """N proposals, each on its track, towards target speeds: (N,) or, to change over time, (N, T).

    `bumpers_m` is how far the ego's front reaches before and its rear behind
    the point that progresses. The lead is the nearest of those on the path
    whose centres are ahead of that point; without one the end of the path is a
    standing lead, half a car's length early. `most_mps2`, (T,) or (N, T), caps
    the accelerations.
    """
    target = np.asarray(target_mps, dtype=np.float64)
    (front_m, rear_m), track_of = bumpers_m, start.track_of
    end_m = np.array([track.length_m for track in tracks])[track_of] - 0.5 * (front_m + rear_m)
    run = _Run(tracks, start, end_m, front_m, target, driver, clock, most_mps2)
    return _one(run) if len(track_of) == 1 else _many(run)


@dataclass(frozen=True, slots=True, eq=False)
class _Run:
    """What a roll-out is made of."""

    tracks: Sequence[ProposalPath]
    start: RolloutStart
    end_m: Floats
    """(N,) the lead that stands for the end of the path; a gap to it is measured from the middle of the car, any other
    from its front bumper."""
    front_m: float
    target_mps: Floats
    driver: IdmDriver
    clock: RolloutClock
    most_mps2: Floats | None


def _many(run: _Run) -> Rollout:
    """All proposals at once, step after step."""
    start, clock, track_of, target = run.start, run.clock, run.start.track_of, run.target_mps
    steps, count = len(clock.instants) - 1, len(track_of)
    limits = _limits(run.tracks)
    leads = _Leads(run.tracks, track_of, run.end_m, run.front_m)
    law = IdmLaw.many(run.driver, count)
    progress = np.array(start.progress_m, dtype=np.float64)
    speed = np.maximum(np.broadcast_to(start.speed_mps, (count,)), 0.0)
    columns = (progress_m_at, speed_at) = np.empty((steps + 1, count)), np.empty((steps + 1, count))
    progress_m_at[0], speed_at[0] = progress, speed
    step_s, nothing, wanted = np.full(count, clock.step_s), np.zeros(count), target
    lead_m, lead_mps = run.end_m, nothing
    instants = clock.instants.tolist()
    for k in range(1, steps + 1):
        if (k - 1) % clock.lead_every == 0:
            lead_m, lead_mps = leads.ahead_of(progress, instants[k])
        if target.ndim > 1:
            wanted = target[:, k - 1]
        within = wanted
        if limits is not None:
            metre = np.minimum(progress.astype(np.int64), limits.shape[1] - 1)
            within = np.minimum(wanted, limits[track_of, metre])
        acceleration = law.acceleration_mps2(speed, within, lead_m - progress, lead_mps)
        if run.most_mps2 is not None:
            acceleration = np.minimum(acceleration, run.most_mps2[..., k - 1])
        progress = np.add(progress, step_s * speed, progress_m_at[k])
        speed = np.maximum(speed + step_s * acceleration, nothing, out=speed_at[k])
    return Rollout(*(np.ascontiguousarray(column.T) for column in columns))


def _one(run: _Run) -> Rollout:
    """One proposal, without numpy: what `_many` does, to the last bit."""
    clock, front_m, step_s = run.clock, run.front_m, run.clock.step_s
    track = run.tracks[int(run.start.track_of[0])]
    steps = len(clock.instants) - 1
    near, center, lead_speed = (table[0].tolist() for table in _tables([track]))
    limit = None if track.limit_mps is None else track.limit_mps.tolist()
    targets = run.target_mps.ravel().tolist() if run.target_mps.ndim > 1 else run.target_mps.tolist() * steps
    most = [np.inf] * steps if run.most_mps2 is None else run.most_mps2.ravel().tolist()
    law = IdmLaw.one(run.driver)
    (progress,), (end_m,) = run.start.progress_m.tolist(), run.end_m.tolist()
    speed = max(float(np.broadcast_to(run.start.speed_mps, (1,))[0]), 0.0)
    progress_m, speed_mps = [progress], [speed]
    lead_m, lead_mps = end_m, 0.0
    for k, instant in enumerate(clock.instants.tolist()[1:]):
        if k % clock.lead_every == 0:
            first, nearest = -1, np.inf
            for j, (reach_m, center_m) in enumerate(zip(near[instant], center[instant], strict=True)):
                if center_m > progress and reach_m < nearest:
                    first, nearest = j, reach_m
            lead_m, lead_mps = (end_m, 0.0) if first < 0 else (nearest - front_m, lead_speed[instant][first])
        wanted = targets[k]
        if limit is not None:
            wanted = min(wanted, limit[min(int(progress), len(limit) - 1)])
        acceleration = min(law.acceleration_mps2(speed, wanted, lead_m - progress, lead_mps), most[k])
        progress, speed = progress + step_s * speed, max(speed + step_s * acceleration, 0.0)
        progress_m.append(progress)
        speed_mps.append(speed)
    return Rollout(np.array([progress_m]), np.array([speed_mps]))


class _Leads:
    """Who is ahead on the tracks of N proposals; the end of the track stands behind them all."""

    def __init__(self, tracks: Sequence[ProposalPath], track_of: Ints, end_m: Floats, front_m: float) -> None:
        near, center, speed = _tables(tracks)
        instants, most = near.shape[1:]
        self._anybody: list[bool] = np.logical_or.reduce(np.isfinite(near), axis=(0, 2)).tolist()
        """By instant."""
        self._end_m, self._standing = end_m, np.zeros(len(track_of))
        # an instant is one piece of memory, with the end of the track as its last column
        shape = (instants, len(track_of), most + 1)
        self._near, self._center = np.full(shape, _AT_THE_END), np.full(shape, np.inf)
        self._stop_m, self._speed = np.empty(shape), np.zeros(shape)
        self._near[..., :most] = near.transpose(1, 0, 2)[:, track_of]
        self._center[..., :most] = center.transpose(1, 0, 2)[:, track_of]
        self._speed[..., :most] = speed.transpose(1, 0, 2)[:, track_of]
        np.subtract(self._near, front_m, self._stop_m)
        self._stop_m[..., most] = end_m
        self._rows = (most + 1) * np.arange(len(track_of))
        self._nobody = np.full(shape[1:], np.inf)

    def ahead_of(self, progress_m: Floats, instant: int) -> tuple[Floats, Floats]:
        """(N,) where each has to stop for whoever is nearest ahead of an arc length, and how fast that one is."""
        if not self._anybody[instant]:
            return self._end_m, self._standing
        ahead = self._center[instant] > progress_m[:, None]
        first = self._rows + np.where(ahead, self._near[instant], self._nobody).argmin(axis=1)
        return self._stop_m[instant].ravel()[first], self._speed[instant].ravel()[first]


def _limits(tracks: Sequence[ProposalPath]) -> Floats | None:
    """(P, S) speed limits for each metre of the tracks, None if no track has any."""
    columns = [track.limit_mps if track.limit_mps is not None else np.array([np.inf]) for track in tracks]
    limits = stacked(columns)
    return None if limits.shape[1] == 1 and not np.isfinite(limits).any() else limits


def _tables(tracks: Sequence[ProposalPath]) -> tuple[Floats, Floats, Floats]:
    """Near ends, centres and speeds (P, K + 1, B) of all that is on the tracks; inf, nan and 0 where there is less."""
    most = max(len(track.occupied.rows) + len(track.standing_m) for track in tracks)
    instants = tracks[0].occupied.near_m.shape[1]
    shape = (len(tracks), instants, max(most, 1))
    near, center, speed = np.full(shape, np.inf), np.full(shape, np.nan), np.zeros(shape)
    for p, track in enumerate(tracks):
        count = len(track.occupied.rows)
        near[p, :, :count] = track.occupied.near_m.T
        center[p, :, :count] = track.occupied.center_m.T
        speed[p, :, :count] = track.occupied.speed_mps.T
        for j, (start_m, end_m) in enumerate(track.standing_m, start=count):
            near[p, :, j], center[p, :, j] = start_m, 0.5 * (start_m + end_m)
    return near, center, speed
