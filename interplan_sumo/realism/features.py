"""What is compared between simulated and recorded traffic: features of motions, computed in one way for both.

Everything is derived from boxes over time, smoothed by `motion`; a simulation's own speeds, leaders and lanes are not
used. Vehicles that never drive are left out: they are parked. Bicycles are no feature.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from interplan_sumo.realism.distances import Sample
from interplan_sumo.realism.following import Following, followings
from interplan_sumo.realism.lane_changes import SeenLaneChange, lane_changes
from interplan_sumo.realism.likelihood import Bins
from interplan_sumo.realism.motion import MOVING_MPS, Motion, motions
from interplan_sumo.realism.tracks import RecordedTraffic
from interplan_sumo.world.geometry import Floats, Ints

FOLLOWING_M, FOLLOWING_MPS = 60.0, 3.0
"""Time gaps are those of who is at most this far behind another, bumper to bumper, and at least this fast."""
QUEUE_M: Final = 10.0
"""A larger gap between two who stand is no queue."""
STOP_S: Final = 1.0
"""A shorter stop is none."""
FREE_S: Final = 4.0
"""Whoever is so long behind the one ahead, or has nobody within 80 m, drives as fast as it likes ..."""
FREE_MPS2: Final = 0.3
"""... if it neither speeds up nor brakes more than this, and drives straight on, ..."""
FREE_RADPS: Final = 0.05
FREE_MPS: Final = 5.0
"""... faster than this."""
BRAKING_MPS2: Final = -0.5
"""Braking begins where the acceleration falls below this, and stays there for half a second."""
ONSET_S: Final = 1.5
"""The deceleration at onset is the strongest of the first so long: the smoothing lets it grow for about that long."""
LONGEST_TTC_S: Final = 20.0
"""Beyond it nobody brakes because of a collision to come."""
SEEN_S: Final = 5.0
"""The strongest acceleration is that of each whole stretch of so long, standing apart.

Who is seen for longer has more chances.
"""
WALKED_M: Final = 2.0
"""A walker gets at least so far."""
SHAKY_MPS3: Final = 1.5
"""Whose jerk exceeds this half of the time is shaken by whoever tracked it: it says nothing about accelerations.

The median over vehicles is 0.2 in SUMO, 0.4 in logs of nuPlan and sensor logs of Argoverse 2, 0.7 to 0.9 in NGSIM's
recordings and 1.0 and 2.2 in FZI's, whose worst tracks jump back and forth.
"""


@dataclass(frozen=True)
class MovingTraffic:
    """The motions of one recording, and what follows from them."""

    vehicles: tuple[Motion, ...]
    """Those that drive."""
    walkers: tuple[Motion, ...]
    """Those that walk."""
    standing: tuple[Motion, ...]
    """Vehicles that never drive; somebody may stop behind one."""

    @classmethod
    def of(cls, traffic: RecordedTraffic) -> MovingTraffic:
        """Of whoever is seen long enough to have a motion."""
        found = motions(traffic.tracks)
        vehicles = [each for each in found if each.track.kind == "vehicle"]
        drive = [bool((each.speed_mps > MOVING_MPS).any()) for each in vehicles]
        return cls(
            tuple(each for each, drives in zip(vehicles, drive, strict=True) if drives),
            tuple(each for each in found if each.track.kind == "pedestrian" and _way_m(each) > WALKED_M),
            tuple(each for each, drives in zip(vehicles, drive, strict=True) if not drives),
        )

    @cached_property
    def steady(self) -> frozenset[int]:
        """The numbers of those of `vehicles` whose accelerations can be believed."""
        return frozenset(
            number
            for number, each in enumerate(self.vehicles)
            if np.median(np.abs(each.jerk_mps3[each.speed_mps > 0.0])) <= SHAKY_MPS3
        )

    @cached_property
    def _numbers(self) -> Mapping[int, int]:
        """By `id` of a motion: of `vehicles`, then of `standing`."""
        return {id(each): at for at, each in enumerate((*self.vehicles, *self.standing))}

    @cached_property
    def followings(self) -> Mapping[int, list[Following]]:
        """The episodes of each vehicle behind another: of `vehicles` by its number, then of `standing`."""
        found: dict[int, list[Following]] = {}
        for each in followings([*self.vehicles, *self.standing]):
            found.setdefault(self._numbers[id(each.follower)], []).append(each)
        return found

    @cached_property
    def stops(self) -> Mapping[int, list[float]]:
        """The standstill gaps of each vehicle, by the same numbers, in queues that somebody drives up to or away from.

        Parked cars stand behind one another, too.
        """
        found: dict[int, list[float]] = {}
        behind: list[tuple[int, int]] = []
        for follower, episodes in self.followings.items():
            for each in episodes:
                stands = (each.speed_mps == 0.0) & (each.leader_speed_mps == 0.0) & (each.gap_m < QUEUE_M)
                gaps_m = [float(np.median(each.gap_m[rows])) for rows in stretches(stands, STOP_S / each.step_s)]
                if gaps_m:
                    found.setdefault(follower, []).extend(gaps_m)
                    behind.append((follower, self._numbers[id(each.leader)]))
        drive, before = {*range(len(self.vehicles))}, -1
        while len(drive) != before:
            before = len(drive)
            drive |= {one for pair in behind if drive & {*pair} for one in pair}
        return {follower: gaps_m for follower, gaps_m in found.items() if follower in drive}

    @cached_property
    def lane_changes(self) -> list[list[SeenLaneChange]]:
        """By changer."""
        found: dict[int, list[SeenLaneChange]] = {}
        for each in lane_changes(self.vehicles):
            found.setdefault(id(each.changer), []).append(each)
        return list(found.values())


def _way_m(motion: Motion) -> float:
    return float(np.hypot(motion.x_m[-1] - motion.x_m[0], motion.y_m[-1] - motion.y_m[0]))


Values = Iterable[Floats | list[float]]
"""Those of each road user."""


def _speeds(traffic: MovingTraffic) -> Values:
    return (each.speed_mps for each in traffic.vehicles)


def _free_speeds(traffic: MovingTraffic) -> Values:
    for number, each in enumerate(traffic.vehicles):
        free = (
            (each.speed_mps > FREE_MPS)
            & (np.abs(each.acceleration_mps2) < FREE_MPS2)
            & (np.abs(each.yaw_rate_radps) < FREE_RADPS)
        )
        for behind in traffic.followings.get(number, ()):
            close = behind.gap_m < FREE_S * behind.speed_mps
            held_s = behind.time_s[close]
            free &= np.abs(each.time_s[:, None] - held_s[None, :]).min(axis=1, initial=np.inf) > each.step_s
        yield [float(np.median(each.speed_mps[free]))] if free.sum() * each.step_s >= STOP_S else []


def _steady(traffic: MovingTraffic) -> Iterator[Motion]:
    return (traffic.vehicles[number] for number in sorted(traffic.steady))


def _accelerations(traffic: MovingTraffic) -> Values:
    return (each.acceleration_mps2[each.speed_mps > 0.0] for each in _steady(traffic))


def _strongest_accelerations(traffic: MovingTraffic) -> Values:
    for each in _steady(traffic):
        rows = round(SEEN_S / each.step_s) + 1
        starts = range(0, len(each.time_s) - rows + 1, rows - 1)
        parts = [slice(start, start + rows) for start in starts]
        driven = [at for at in parts if (each.speed_mps[at] > MOVING_MPS).any()]
        yield [max(float(each.acceleration_mps2[at].max()), 0.0) for at in driven]


def _jerks(traffic: MovingTraffic) -> Values:
    return (each.jerk_mps3[each.speed_mps > 0.0] for each in _steady(traffic))


def _yaw_rates(traffic: MovingTraffic) -> Values:
    return (each.yaw_rate_radps[each.speed_mps > MOVING_MPS] for each in traffic.vehicles)


def _time_gaps(traffic: MovingTraffic) -> Values:
    for episodes in traffic.followings.values():
        parts = [(each, (each.gap_m < FOLLOWING_M) & (each.speed_mps > FOLLOWING_MPS)) for each in episodes]
        yield np.concatenate([each.gap_m[close] / each.speed_mps[close] for each, close in parts])


def _standstill_gaps(traffic: MovingTraffic) -> Values:
    return traffic.stops.values()


def _steady_followings(traffic: MovingTraffic) -> Iterator[list[Following]]:
    return (episodes for number, episodes in traffic.followings.items() if number in traffic.steady)


def _onsets(episode: Following) -> Ints:
    """The rows at which somebody who is following begins to brake."""
    braking = (episode.acceleration_mps2 < BRAKING_MPS2) & (episode.speed_mps > 0.0)
    first = [rows[0] for rows in stretches(braking, 0.5 / episode.step_s)]
    fast = [row for row in first if row > 0 and episode.speed_mps[row] > FOLLOWING_MPS]
    return np.array(fast, dtype=np.int64)


def _ttcs_at_brake_onset(traffic: MovingTraffic) -> Values:
    for episodes in _steady_followings(traffic):
        found: list[float] = []
        for each in episodes:
            rows = _onsets(each)
            closing_mps = each.speed_mps[rows] - each.leader_speed_mps[rows]
            ttc_s = each.gap_m[rows] / np.maximum(closing_mps, 1e-3)
            found += ttc_s[ttc_s < LONGEST_TTC_S].tolist()
        yield found


def _decelerations_at_onset(traffic: MovingTraffic) -> Values:
    for episodes in _steady_followings(traffic):
        found: list[float] = []
        for each in episodes:
            rows = round(ONSET_S / each.step_s)
            ends = [(row, row + rows) for row in _onsets(each) if row + rows <= len(each.time_s)]
            found += [-float(each.acceleration_mps2[begin:end].min()) for begin, end in ends]
        yield found


def _lane_change_durations(traffic: MovingTraffic) -> Values:
    return ([each.duration_s for each in changes] for changes in traffic.lane_changes)


def _lead_gaps(traffic: MovingTraffic) -> Values:
    return ([each.lead_gap_s for each in changes if each.lead_gap_s is not None] for changes in traffic.lane_changes)


def _lag_gaps(traffic: MovingTraffic) -> Values:
    return ([each.lag_gap_s for each in changes if each.lag_gap_s is not None] for changes in traffic.lane_changes)


def _walking_speeds(traffic: MovingTraffic) -> Values:
    return (each.speed_mps[each.speed_mps > 0.0] for each in traffic.walkers)


def stretches(holds: np.ndarray, least: float) -> list[Ints]:
    """The rows of each stretch in which something holds without a break for at least so many rows."""
    rows = np.flatnonzero(holds)
    parts = np.split(rows, np.flatnonzero(np.diff(rows) != 1) + 1) if len(rows) else []
    return [part for part in parts if len(part) >= least - 1e-6]


@dataclass(frozen=True, slots=True)
class TrafficFeature:
    """One thing that is compared."""

    key: str
    """In JSON."""
    title: str
    short: str
    """Over a column."""
    unit: str
    values: Callable[[MovingTraffic], Values]
    bins: Bins
    """Of the likelihood, and of plots."""
    weight: float
    """In the mean over the likelihoods."""


FEATURES: Final = (
    TrafficFeature("speed", "speed", "speed", "m/s", _speeds, Bins(0.0, 35.0, 10), 1.0),
    TrafficFeature("free_speed", "free speed", "free speed", "m/s", _free_speeds, Bins(0.0, 35.0, 10), 1.0),
    TrafficFeature("acceleration", "acceleration", "accel.", "m/s²", _accelerations, Bins(-4.0, 4.0, 11), 1.0),
    TrafficFeature("strongest_acceleration", "strongest acceleration in 5 s", "max. acc.", "m/s²",
                   _strongest_accelerations, Bins(0.0, 5.0, 10), 1.0),
    TrafficFeature("jerk", "jerk", "jerk", "m/s³", _jerks, Bins(-4.0, 4.0, 11), 1.0),
    TrafficFeature("yaw_rate", "yaw rate", "yaw", "rad/s", _yaw_rates, Bins(-0.5, 0.5, 11), 1.0),
    TrafficFeature("time_gap", "time gap", "time gap", "s", _time_gaps, Bins(0.0, 5.0, 10), 2.0),
    TrafficFeature("standstill_gap", "standstill gap", "still gap", "m", _standstill_gaps, Bins(0.0, 10.0, 10), 2.0),
    TrafficFeature("ttc_at_brake_onset", "TTC at brake onset", "TTC", "s", _ttcs_at_brake_onset,
                   Bins(0.0, 20.0, 10), 2.0),
    TrafficFeature("deceleration_at_onset", "deceleration at onset", "onset", "m/s²", _decelerations_at_onset,
                   Bins(0.0, 4.0, 8), 2.0),
    TrafficFeature("lane_change_duration", "lane-change duration", "change", "s", _lane_change_durations,
                   Bins(0.0, 10.0, 5), 1.0),
    TrafficFeature("lane_change_lead_gap", "lane-change lead gap", "lead", "s", _lead_gaps, Bins(0.0, 8.0, 8), 2.0),
    TrafficFeature("lane_change_lag_gap", "lane-change lag gap", "lag", "s", _lag_gaps, Bins(0.0, 8.0, 8), 2.0),
    TrafficFeature("walking_speed", "walking speed", "walk", "m/s", _walking_speeds, Bins(0.0, 3.0, 10), 1.0),
)  # fmt: skip
BY_KEY: Final[Mapping[str, TrafficFeature]] = {feature.key: feature for feature in FEATURES}

FeatureSamples = Mapping[str, Sample]
"""By feature."""


def feature_samples(traffic: Iterable[RecordedTraffic]) -> FeatureSamples:
    """The values of every feature in some recordings, read one at a time; nobody of one meets anybody of another."""
    found: dict[str, list[Sample]] = {feature.key: [] for feature in FEATURES}
    for each in traffic:
        moving = MovingTraffic.of(each)
        for feature in FEATURES:
            found[feature.key].append(Sample.of(feature.values(moving)))
    return pooled(found)


def pooled(samples: Mapping[str, list[Sample]]) -> FeatureSamples:
    """Several samples of each feature as one."""
    return {key: Sample.pooled(parts) for key, parts in samples.items()}
