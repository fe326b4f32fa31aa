"""The Intelligent Driver Model for many proposals at once: how far each gets along its path behind whoever leads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from interplan_planners.common.idm_policy import IdmDriver, idm_accelerations_mps2
from interplan_planners.common.occupancy import StripOccupancy
from interplan_sumo.world.geometry import Floats, Ints


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
    (front_m, rear_m), track_of, count = bumpers_m, start.track_of, len(start.track_of)
    instants, step_s, steps = clock.instants, clock.step_s, len(clock.instants) - 1
    near, center, lead_speed = _tables(tracks)
    limits = _limits(tracks)
    end_m = np.array([track.length_m for track in tracks])[track_of] - 0.5 * (front_m + rear_m)
    progress = np.array(start.progress_m, dtype=np.float64)
    speed = np.maximum(np.broadcast_to(start.speed_mps, (count,)), 0.0)
    target = np.asarray(target_mps, dtype=np.float64)
    columns = (progress_m_at, speed_at) = np.empty((steps + 1, count)), np.empty((steps + 1, count))
    progress_m_at[0], speed_at[0] = progress, speed
    rows = np.arange(count)
    lead_m, lead_mps = end_m, np.zeros(count)
    for k in range(1, steps + 1):
        if (k - 1) % clock.lead_every == 0 or k == 1:
            k_lead = instants[k]
            ahead = center[track_of, k_lead] > progress[:, None]
            reach = np.where(ahead, near[track_of, k_lead], np.inf)
            first = reach.argmin(axis=1)
            nearest = reach[rows, first]
            led = np.isfinite(nearest)
            # a gap to the end of the path is measured from the middle of the car, any other from its front bumper
            lead_m = np.where(led, nearest - front_m, end_m)
            lead_mps = np.where(led, lead_speed[track_of, k_lead][rows, first], 0.0)
        wanted = target if target.ndim == 1 else target[:, k - 1]
        if limits is not None:
            metre = np.minimum(progress.astype(np.int64), limits.shape[1] - 1)
            wanted = np.minimum(wanted, limits[track_of, metre])
        acceleration = idm_accelerations_mps2(driver, speed, wanted, lead_m - progress, lead_mps)
        if most_mps2 is not None:
            acceleration = np.minimum(acceleration, most_mps2[..., k - 1])
        progress = progress + step_s * speed
        speed = np.maximum(speed + step_s * acceleration, 0.0)
        progress_m_at[k], speed_at[k] = progress, speed
    return Rollout(*(np.ascontiguousarray(column.T) for column in columns))


def _limits(tracks: Sequence[ProposalPath]) -> Floats | None:
    """(P, S) speed limits for each metre of the tracks, None if no track has any."""
    columns = [track.limit_mps if track.limit_mps is not None else np.array([np.inf]) for track in tracks]
    longest = max(len(column) for column in columns)
    if longest == 1 and not any(np.isfinite(column[0]) for column in columns):
        return None
    return np.stack([np.pad(column, (0, longest - len(column)), mode="edge") for column in columns])


def _tables(tracks: Sequence[ProposalPath]) -> tuple[Floats, Floats, Floats]:
    """Near ends, centres and speeds (P, K + 1, B) of all that is on the tracks; inf, -inf and 0 where there is less."""
    most = max(len(track.occupied.rows) + len(track.standing_m) for track in tracks)
    instants = tracks[0].occupied.near_m.shape[1]
    shape = (len(tracks), instants, max(most, 1))
    near, center, speed = np.full(shape, np.inf), np.full(shape, -np.inf), np.zeros(shape)
    for p, track in enumerate(tracks):
        count = len(track.occupied.rows)
        near[p, :, :count] = track.occupied.near_m.T
        center[p, :, :count] = np.nan_to_num(track.occupied.center_m.T, nan=-np.inf)
        speed[p, :, :count] = track.occupied.speed_mps.T
        for j, (start_m, end_m) in enumerate(track.standing_m, start=count):
            near[p, :, j], center[p, :, j] = start_m, 0.5 * (start_m + end_m)
    return near, center, speed
