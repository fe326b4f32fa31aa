"""What recordings tell of each driver: episodes behind a leader, stretches with nobody ahead, stops, cruising speed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.errors import InputError
from interplan_sumo.realism.car_following import Episode, EpisodeBatch, FreeDriving, batch_of
from interplan_sumo.realism.features import BY_KEY, FREE_MPS, FREE_RADPS, MovingTraffic, stretches
from interplan_sumo.realism.following import Following
from interplan_sumo.realism.motion import MOVING_MPS, Motion
from interplan_sumo.realism.tracks import RecordedTraffic
from interplan_sumo.world.geometry import Floats

OVER_LIMIT: Final = 1.1
"""Where no limit is known: 85 % of free drivers are no faster than so many times the limit. Limits are set with the
85th percentile in mind, and in practice lie somewhat below it (Tignor and Warren, 1990)."""
AT_LEAST: Final = 5
"""A place with fewer cruising drivers takes the speed of all places together."""
FREE_STRETCH_S: Final = 2.0
BRAKES_MPS2: Final = -0.3
"""Who brakes with nobody ahead does so for a light, a bend or a junction: no car-following model knows them."""
FAST_SHARE: Final = 0.6
"""... and who stays below this share of the allowed speed as well."""
WAVER_S, WAVER_MPS = 3.0, 1.5
"""A driver wavers where it keeps its speed for so long, to within so much, ..."""


@dataclass(frozen=True, slots=True, eq=False)
class ObservedDriver:
    """One driver of a recording."""

    place: str
    episodes: tuple[Following, ...]
    free: tuple[FreeDriving, ...]
    cruise_mps: float
    """The speed it took with nobody near ahead; NaN if it never was free."""
    standstill_gap_m: float
    """In queues; NaN if it never stood in one."""
    waver_mps2: float
    """Root mean square of its acceleration where it keeps its speed; NaN if it never does."""
    trembles: bool
    """Whether its positions do."""


@dataclass(frozen=True, slots=True, eq=False)
class ObservedDrivers:
    """The drivers of some recordings, and the speed that each place allows."""

    drivers: tuple[ObservedDriver, ...]
    allowed_mps: Mapping[str, float]
    walking_mps: Floats
    """Of each pedestrian, in the middle."""

    @property
    def places(self) -> tuple[str, ...]:
        return tuple(sorted({each.place for each in self.drivers}))

    def within(self, places: Sequence[str]) -> ObservedDrivers:
        """Those of some places."""
        return ObservedDrivers(
            tuple(each for each in self.drivers if each.place in places), self.allowed_mps, self.walking_mps
        )

    def batch(self, free: bool = True) -> EpisodeBatch:
        """All episodes; the free stretches, too, if asked for."""
        found: list[tuple[int, float, Episode]] = []
        for number, each in enumerate(self.drivers):
            parts: tuple[Episode, ...] = (*each.episodes, *(each.free if free else ()))
            found += [(number, self.allowed_mps[each.place], part) for part in parts]
        return batch_of(found)

    @property
    def cruise(self) -> Floats:
        """(D,) cruising over allowed speeds."""
        return np.array([each.cruise_mps / self.allowed_mps[each.place] for each in self.drivers])

    @property
    def trembles(self) -> NDArray[np.bool_]:
        """(D,)"""
        return np.array([each.trembles for each in self.drivers])

    @property
    def waver_mps2(self) -> Floats:
        """(D,)"""
        return np.array([each.waver_mps2 for each in self.drivers])

    @property
    def standstill_gaps_m(self) -> Floats:
        """(D,)"""
        return np.array([each.standstill_gap_m for each in self.drivers])


def observed_drivers(
    recordings: Sequence[RecordedTraffic], limits_mps: Mapping[str, float] | None = None
) -> ObservedDrivers:
    """The drivers who followed somebody, or drove freely, in some recordings.

    `limits_mps` are by place; the others are estimated. InputError if nobody follows anybody.
    """
    moving = [(each.place, MovingTraffic.of(each)) for each in recordings]
    allowed = allowed_speeds(moving, limits_mps or {})
    drivers = tuple(driver for place, traffic in moving for driver in _drivers(place, traffic, allowed[place]))
    if not any(each.episodes for each in drivers):
        raise InputError("nobody follows anybody in these recordings: there is nothing to fit")
    walking = [float(np.median(each.speed_mps[each.speed_mps > 0.0])) for _, t in moving for each in t.walkers]
    return ObservedDrivers(drivers, allowed, np.array(walking))


def allowed_speeds(moving: Sequence[tuple[str, MovingTraffic]], limits_mps: Mapping[str, float]) -> dict[str, float]:
    """The speed that each place allows: its limit where that is known, else what cruising drivers tell."""
    strange = sorted({*limits_mps} - {place for place, _ in moving})
    if strange:
        known = ", ".join(sorted({place for place, _ in moving}))
        raise InputError(f"a limit is given for {strange[0]!r}; the places of these recordings are {known}")
    cruising: dict[str, list[float]] = {}
    fastest: dict[str, float] = {}
    for place, traffic in moving:
        speeds = _cruising_mps(traffic)
        cruising.setdefault(place, []).extend(speeds[np.isfinite(speeds)].tolist())
        fastest[place] = max([fastest.get(place, MOVING_MPS), *(each.speed_mps.max() for each in traffic.vehicles)])
    everywhere = [speed for speeds in cruising.values() for speed in speeds]

    def estimated(place: str) -> float:
        speeds = cruising[place] if len(cruising[place]) >= AT_LEAST else everywhere
        return float(np.percentile(speeds, 85.0)) / OVER_LIMIT if len(speeds) >= AT_LEAST else float(fastest[place])

    return {place: limits_mps.get(place, 0.0) or estimated(place) for place in cruising}


def _cruising_mps(traffic: MovingTraffic) -> Floats:
    """The speed of each of the vehicles where it had nobody near ahead; NaN for those that never did."""
    return np.array([next(iter(found), np.nan) for found in BY_KEY["free_speed"].values(traffic)])


def _drivers(place: str, traffic: MovingTraffic, allowed_mps: float) -> Iterator[ObservedDriver]:
    cruising_mps = _cruising_mps(traffic)
    for number, vehicle in enumerate(traffic.vehicles):
        trembles = number not in traffic.steady
        episodes = tuple(each for each in traffic.followings.get(number, ()) if each.speed_mps.max() > MOVING_MPS)
        free = () if trembles else tuple(_free(vehicle, traffic.followings.get(number, ()), allowed_mps))
        if episodes or free or number in traffic.stops:
            stops_m = traffic.stops.get(number, [])
            stood_m = float(np.median(stops_m)) if stops_m else np.nan
            waver_mps2 = np.nan if trembles else wavering_mps2(vehicle)
            yield ObservedDriver(place, episodes, free, float(cruising_mps[number]), stood_m, waver_mps2, trembles)
    for number in range(len(traffic.vehicles), len(traffic.vehicles) + len(traffic.standing)):
        if number in traffic.stops:  # it waits as long as it is seen
            yield ObservedDriver(place, (), (), np.nan, float(np.median(traffic.stops[number])), np.nan, False)


def wavering_mps2(vehicle: Motion) -> float:
    """Root mean square acceleration where a vehicle drives straight on and keeps its speed; NaN if it never does.

    It is alike with and without somebody ahead, so both count.
    """
    rows = round(WAVER_S / vehicle.step_s) + 1
    parts = [slice(start, start + rows) for start in range(0, len(vehicle.time_s) - rows + 1, rows - 1)]
    even = [
        np.mean(vehicle.acceleration_mps2[part] ** 2)
        for part in parts
        if vehicle.speed_mps[part].min() > FREE_MPS
        and abs(vehicle.speed_mps[part][-1] - vehicle.speed_mps[part][0]) < WAVER_MPS
        and np.abs(vehicle.yaw_rate_radps[part]).max() < FREE_RADPS
    ]
    return float(np.sqrt(np.mean(even))) if even else np.nan


def _free(vehicle: Motion, episodes: Sequence[Following], allowed_mps: float) -> Iterator[FreeDriving]:
    """Stretches with nobody ahead in which a vehicle neither brakes nor turns, and gets fast."""
    free = (vehicle.acceleration_mps2 > BRAKES_MPS2) & (np.abs(vehicle.yaw_rate_radps) < FREE_RADPS)
    for each in episodes:
        free &= (vehicle.time_s < each.time_s[0]) | (vehicle.time_s > each.time_s[-1])
    for part in stretches(free & (vehicle.speed_mps > 0.0), 1):
        speed_mps = vehicle.speed_mps[part]
        if len(part) * vehicle.step_s >= FREE_STRETCH_S and speed_mps[-1] > FAST_SHARE * allowed_mps:
            yield FreeDriving(vehicle.step_s, speed_mps)
