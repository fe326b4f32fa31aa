"""The Intelligent Driver Model over many episodes at once: a follower driven behind each recorded leader.

Time steps, the order of updates and the least gap are those of SUMO 1.28, whose IDM equals the textbook form.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from interplan_sumo.realism.following import Following
from interplan_sumo.world.geometry import Floats, Ints

PARAMETERS: Final = ("time_gap_s", "standstill_gap_m", "accel_mps2", "decel_mps2", "speed_factor")
"""T, s0, a, b and v0 over the speed that the place allows; columns of every array of parameters here."""
SMALLEST_GAP_M: Final = 0.1
HARDEST_MPS2: Final = 9.0
"""Nobody brakes harder, as `emergencyDecel` has it."""
FREE_GAP_M: Final = 1e5
"""Of those who follow nobody."""


@dataclass(frozen=True, slots=True, eq=False)
class EpisodeBatch:
    """Episodes side by side, the longest first, padded at their ends: rows of one time step each."""

    driver: Ints
    """(E,) Whose episode it is."""
    rows: Ints
    """(E,) How many time steps it has."""
    step_s: Floats
    """(E,)"""
    allowed_mps: Floats
    """(E,) The speed that the place allows."""
    speed_mps: Floats
    """(K, E) Of the follower, as recorded."""
    gap_m: Floats
    """(K, E) From bumper to bumper, as recorded."""
    leader_m: Floats
    """(K, E) The way of the leader since the episode began."""
    leader_mps: Floats
    """(K, E)"""

    @property
    def seen(self) -> Floats:
        """(K, E) 1 where there is a time step, 0 beyond the end of an episode."""
        return (np.arange(len(self.gap_m))[:, None] < self.rows[None, :]).astype(np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class FreeDriving:
    """A stretch in which a driver had nobody ahead. Arrays (N,), evenly spaced in time."""

    step_s: float
    speed_mps: Floats


Episode = Following | FreeDriving


def batch_of(episodes: Sequence[tuple[int, float, Episode]]) -> EpisodeBatch:
    """Episodes as (driver, allowed speed, episode)."""
    order = sorted(range(len(episodes)), key=lambda at: -len(episodes[at][2].speed_mps))
    found = [episodes[at] for at in order]
    rows = np.array([len(each.speed_mps) for _, _, each in found], dtype=np.int64)
    arrays = np.zeros((4, int(rows.max()), len(found)))
    for at, (_, _, each) in enumerate(found):
        way_m = _way_m(each.speed_mps, each.step_s)
        free = isinstance(each, FreeDriving)
        gap_m = np.full(len(way_m), FREE_GAP_M) - way_m if free else each.gap_m
        leader_mps = np.zeros(len(way_m)) if free else each.leader_speed_mps
        arrays[:, : rows[at], at] = (each.speed_mps, gap_m, gap_m + way_m - gap_m[0], leader_mps)
    return EpisodeBatch(
        np.array([driver for driver, _, _ in found], dtype=np.int64),
        rows,
        np.array([each.step_s for _, _, each in found]),
        np.array([allowed_mps for _, allowed_mps, _ in found]),
        *arrays,
    )


def simulated_gaps(batch: EpisodeBatch, parameters: Floats) -> Floats:
    """(K, ..., E) gaps of followers who start as recorded and drive by (..., E, 5) parameters behind the leaders."""
    time_gap_s, standstill_gap_m, accel_mps2, decel_mps2, factor = np.moveaxis(parameters, -1, 0)
    comfort_mps2 = 2.0 * np.sqrt(accel_mps2 * decel_mps2)
    over_desired = 1.0 / (factor * batch.allowed_mps)
    gaps_m = np.zeros((len(batch.gap_m), *time_gap_s.shape))
    gaps_m[0] = batch.gap_m[0]
    speed_mps = np.broadcast_to(batch.speed_mps[0], time_gap_s.shape).copy()
    way_m = np.zeros(time_gap_s.shape)
    for row in range(1, len(gaps_m)):
        on = slice(0, int(np.searchsorted(-batch.rows, -row)))  # those with more rows than this
        v, step_s, seen = speed_mps[..., on], batch.step_s[on], row - 1
        closing = v * (v - batch.leader_mps[seen, on]) / comfort_mps2[..., on]
        wished_m = standstill_gap_m[..., on] + np.maximum(0.0, v * time_gap_s[..., on] + closing)
        ratio = wished_m / np.maximum(gaps_m[seen, ..., on], SMALLEST_GAP_M)
        free = (v * over_desired[..., on]) ** 2
        wanted_mps2 = accel_mps2[..., on] * (1.0 - free * free - ratio * ratio)
        v = np.maximum(0.0, v + np.maximum(wanted_mps2, -HARDEST_MPS2) * step_s)
        speed_mps[..., on] = v
        way_m[..., on] += v * step_s
        gaps_m[row, ..., on] = batch.gap_m[0, on] + batch.leader_m[row, on] - way_m[..., on]
    return gaps_m


def spacing_rmse_m(batch: EpisodeBatch, parameters: Floats) -> Floats:
    """(E,) root mean square error of the gap in each episode, with (E, 5) parameters."""
    error_m = (simulated_gaps(batch, parameters) - batch.gap_m) * batch.seen
    return np.sqrt((error_m**2).sum(axis=0) / np.maximum(batch.rows - 1, 1))


def _way_m(speed_mps: Floats, step_s: float) -> Floats:
    return np.append(0.0, np.cumsum((speed_mps[1:] + speed_mps[:-1]) / 2.0) * step_s)
