"""Steadied tracks: what a sensor with errors sees, as far as what is remembered tells it better.

Who stands is seen to creep to and fro, and its box to shift; who is lost for a frame is seen no more. How large the
errors are is read from the tracks themselves: nothing that moves by itself jerks from frame to frame as they do. A
sensor without errors is taken at its word.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.planner import Observation
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.geometry import Floats

FRAME_S: Final = 0.1
ERRORS_LAST_S: Final = 0.5
"""After this long an error of a tracker is taken to be down to 1/e of what it was."""
EXACT_MPS: Final = 0.06
"""A sensor whose speeds are off by less is taken at its word."""
LEAST_OFF_M: Final = 0.01
"""No better are the places that it tells."""
LIKELY: Final = 3.5
"""Standard deviations of the errors within which what stands is seen."""
LATELY: Final = 5
"""Frames in which who sets off is found out."""
LOST_FRAMES: Final = 3
"""Who was seen within so many frames is taken to be still there."""
MEDIAN_TO_DEVIATION: Final = 1.4826
"""Standard deviation of normal numbers, by the median of their magnitudes."""


def steadied(observation: Observation) -> Observation:
    """The observation with those who stand at rest where they were seen on average, and those lost lately still there.

    The same one if the sensor seems to have no errors.
    """
    seen = (*observation.past.actors, observation.actors)
    tracks = _Tracks.of(seen[-1], seen)
    off_mps = _deviation(tracks.speed_mps[:, tracks.actors.kind <= ActorKind.BICYCLE])
    if off_mps < EXACT_MPS:
        return observation
    lately = seen[-1 - LOST_FRAMES : -1]
    tracks = _Tracks.of(_with_lost(lately, seen[-1]), seen)
    stands = tracks.stands(off_mps, max(_deviation(tracks.along_m), LEAST_OFF_M))
    past = tuple(_put(each, tracks, stands) for each in observation.past.actors)
    actors = _put(tracks.actors, tracks, stands)
    return replace(observation, actors=actors, past=replace(observation.past, actors=past))


@dataclass(frozen=True, slots=True, eq=False)
class _Tracks:
    """Actors over T frames, the last of which is now; not-a-number where one is not seen."""

    actors: Actors  # (A,) whom they are of, as seen last
    x_m: Floats  # (T, A)
    y_m: Floats  # (T, A)
    turned_rad: Floats  # (T, A) heading, from that seen last
    speed_mps: Floats  # (T, A) along their heading

    @classmethod
    def of(cls, actors: Actors, frames: tuple[Actors, ...]) -> _Tracks:
        row_of = {name: row for row, name in enumerate(actors.ids)}
        x_m, y_m, heading, speed = np.full((4, len(frames), len(actors)), np.nan)
        for k, each in enumerate(frames):
            rows = np.array([row_of.get(name, -1) for name in each.ids], dtype=np.int64)
            here = rows >= 0
            at = rows[here]
            x_m[k, at], y_m[k, at], heading[k, at] = each.x_m[here], each.y_m[here], each.heading_rad[here]
            along = each.vx_mps * np.cos(each.heading_rad) + each.vy_mps * np.sin(each.heading_rad)
            speed[k, at] = along[here]
        turned = heading - actors.heading_rad
        return cls(actors, x_m, y_m, np.arctan2(np.sin(turned), np.cos(turned)), speed)

    @property
    def along_m(self) -> Floats:
        """(T, A) how far each is before where it was seen last, along its heading."""
        cos, sin = np.cos(self.actors.heading_rad), np.sin(self.actors.heading_rad)
        return (self.x_m - self.actors.x_m) * cos + (self.y_m - self.actors.y_m) * sin

    def stands(self, off_mps: float, off_m: float) -> NDArray[np.bool_]:
        """(A,) who is seen to move no more than the errors, of these standard deviations, make it seem."""
        moves_itself = self.actors.kind <= ActorKind.BICYCLE
        count = np.isfinite(self.speed_mps).sum(axis=0)
        mean_off, slope_off = np.array([_standard_errors(n) for n in range(1, len(self.speed_mps) + 1)]).T
        # two estimates of the speed over all that is remembered, weighted by how good they are
        by_speed, by_place = (off_mps * mean_off[count - 1]) ** -2.0, (off_m * slope_off[count - 1]) ** -2.0
        speed_mps = np.nanmean(self.speed_mps, axis=0) * by_speed + _slope_mps(self.along_m) * by_place
        speed_mps /= by_speed + by_place
        still = np.abs(speed_mps) < LIKELY * (by_speed + by_place) ** -0.5
        last = np.array([np.abs(_mean(self.speed_mps[-frames:])) for frames in (1, LATELY)])
        limit_mps = LIKELY * off_mps * np.array([1.0, _standard_errors(LATELY)[0]])
        return ~moves_itself | (still & (last < limit_mps[:, None]).all(axis=0))


def _put(seen: Actors, tracks: _Tracks, stands: NDArray[np.bool_]) -> Actors:
    """What was seen in a frame, with those who stand where they were on average."""
    row_of = {tracks.actors.ids[row]: row for row in np.flatnonzero(stands).tolist()}
    pairs = [(here, row_of[name]) for here, name in enumerate(seen.ids) if name in row_of]
    if not pairs:
        return seen
    here, rows = np.array(pairs).T
    x_m, y_m, heading = seen.x_m.copy(), seen.y_m.copy(), seen.heading_rad.copy()
    vx_mps, vy_mps = seen.vx_mps.copy(), seen.vy_mps.copy()
    x_m[here], y_m[here] = np.nanmean(tracks.x_m[:, rows], axis=0), np.nanmean(tracks.y_m[:, rows], axis=0)
    heading[here] = tracks.actors.heading_rad[rows] + np.nanmean(tracks.turned_rad[:, rows], axis=0)
    vx_mps[here], vy_mps[here] = 0.0, 0.0
    return Actors.trusted(seen.ids, seen.kind, x_m, y_m, heading, seen.length_m, seen.width_m, vx_mps, vy_mps)


def _with_lost(lately: tuple[Actors, ...], now: Actors) -> Actors:
    """Who is seen, and who was seen lately, where each should be by now."""
    found = {name: (now, row, 0.0) for row, name in enumerate(now.ids)}
    for ago, each in enumerate(reversed(lately), 1):
        for row, name in enumerate(each.ids):
            found.setdefault(name, (each, row, ago * FRAME_S))
    if len(found) == len(now):
        return now
    ids = tuple(sorted(found))
    told = [(each.kind[row], each.x_m[row] + s * each.vx_mps[row], each.y_m[row] + s * each.vy_mps[row],
             each.heading_rad[row], each.length_m[row], each.width_m[row], each.vx_mps[row], each.vy_mps[row])
            for each, row, s in map(found.__getitem__, ids)]  # fmt: skip
    return Actors(ids, *map(np.array, zip(*told, strict=True)))


def _deviation(values: Floats) -> float:
    """Standard deviation of the errors of a (T, A) series that itself bends little from frame to frame; 0 if too short.

    The second difference of errors that last has 6 - 8 r + 2 r^2 times their variance, r the correlation of neighbours.
    """
    jerks = np.abs(np.diff(values, 2, axis=0))
    jerks = jerks[np.isfinite(jerks)]
    if not jerks.size:
        return 0.0
    r = np.exp(-FRAME_S / ERRORS_LAST_S)
    return float(MEDIAN_TO_DEVIATION * np.median(jerks) / np.sqrt(6.0 - 8.0 * r + 2.0 * r * r))


@lru_cache
def _standard_errors(frames: int) -> tuple[float, float]:
    """Of the mean, and of the slope per second, of so many neighbouring values with errors of 1 that last."""
    time_s = FRAME_S * np.arange(frames)
    alike = np.exp(-np.abs(time_s[:, None] - time_s) / ERRORS_LAST_S)
    from_middle = time_s - time_s.mean()
    if frames == 1:
        return 1.0, np.inf
    slope = from_middle / (from_middle @ from_middle)
    return float(np.sqrt(alike.mean())), float(np.sqrt(slope @ alike @ slope))


def _mean(values: Floats) -> Floats:
    """(A,) of those of T frames in which each is seen; 0 if in none."""
    seen = np.isfinite(values)
    return np.where(seen, values, 0.0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)


def _slope_mps(along_m: Floats) -> Floats:
    """(A,) change per second of T positions, by least squares over the frames in which each is seen."""
    seen = np.isfinite(along_m)
    time_s = np.where(seen, FRAME_S * np.arange(len(along_m))[:, None], 0.0)
    count = np.maximum(seen.sum(axis=0), 1)
    off_s = np.where(seen, time_s - time_s.sum(axis=0) / count, 0.0)
    return (off_s * np.where(seen, along_m, 0.0)).sum(axis=0) / np.maximum((off_s * off_s).sum(axis=0), 1e-9)
