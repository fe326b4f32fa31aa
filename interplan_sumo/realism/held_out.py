"""How well fitted drivers do where nobody fitted them: one place left out after the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np

from interplan_sumo.realism.car_following import batch_of, spacing_rmse_m
from interplan_sumo.realism.distances import Sample, kolmogorov_smirnov
from interplan_sumo.realism.driver_fit import DriverEvidence, DriverFit, fit_drivers
from interplan_sumo.realism.driver_population import DriverPopulation
from interplan_sumo.realism.following import Following
from interplan_sumo.realism.observed_drivers import ObservedDrivers
from interplan_sumo.realism.published import DriverPrior
from interplan_sumo.world.geometry import Floats

FEWEST: Final = 5
"""A place with fewer drivers says nothing of a population."""
LEAST_S: Final = 3.0
"""An episode is cut in two if both halves are at least half so long."""


@dataclass(frozen=True, slots=True)
class HeldOutPlace:
    """A place whose drivers the population does not know."""

    place: str
    drivers: int
    """Who follow somebody."""
    own_rmse_m: float
    """Spacing error of the type fitted for each driver as a member of the population of the other places; median."""
    ahead_rmse_m: float
    """The same in the second half of each episode, with the type fitted to the first; median. NaN if all are short."""
    anybody_rmse_m: float
    """The same with the type in the middle of the population."""
    distances: Mapping[str, float]
    """KS distance of the drawn population from what was seen of these drivers directly."""


@dataclass(frozen=True, slots=True)
class HeldOut:
    """All places, each left out of the fit in turn."""

    places: tuple[HeldOutPlace, ...]
    between: Mapping[str, float]
    """Median KS distance between two places."""

    def median(self, name: str) -> float:
        """Over drivers: of the medians of the places, each weighing as much as it has drivers."""
        values = np.repeat([getattr(each, name) for each in self.places], [each.drivers for each in self.places])
        return float(np.nanmedian(values)) if np.isfinite(values).any() else np.nan


def fitted(drivers: ObservedDrivers, prior: DriverPrior, population: DriverFit | None = None) -> DriverFit:
    """Drivers and population; with a `population` only the drivers, as members of it."""
    known = DriverEvidence.of(drivers.standstill_gaps_m, drivers.cruise, drivers.trembles)
    return fit_drivers(drivers.batch(), known, prior, population)


def held_out(drivers: ObservedDrivers, prior: DriverPrior) -> HeldOut:
    """Leave each place out, fit the others, and look at the one left out."""
    places = [each for each in drivers.places if len(_following(drivers.within([each])).drivers) >= FEWEST]
    if len(drivers.places) < 2:
        return HeldOut((), {})
    seen = {each: _seen(drivers.within([each])) for each in places}
    pairs = [
        {name: kolmogorov_smirnov(a, b) for name, a, b in _common(seen[one], seen[other])}
        for one, other in combinations(places, 2)
    ]
    names = sorted({name for pair in pairs for name in pair})
    between = {name: float(np.median([pair[name] for pair in pairs if name in pair])) for name in names}
    told = [
        each for each in places if any(driver.episodes or driver.free for driver in _elsewhere(drivers, each).drivers)
    ]
    return HeldOut(tuple(_held_out(drivers, each, prior) for each in told), between)


def _elsewhere(drivers: ObservedDrivers, place: str) -> ObservedDrivers:
    return drivers.within([each for each in drivers.places if each != place])


def _held_out(drivers: ObservedDrivers, place: str, prior: DriverPrior) -> HeldOutPlace:
    others = _elsewhere(drivers, place)
    population = fitted(others, prior)
    left = _following(drivers.within([place]))
    batch = left.batch(free=False)
    own = np.exp(fitted(left, prior, population).drivers)
    middle = np.tile(np.exp(population.mean), (len(batch.driver), 1))
    drawn = DriverPopulation.of(population).drawn(256)
    expected = {"standstill_gap": drawn[:, 1], "speed_factor": drawn[:, 4]}
    return HeldOutPlace(
        place,
        len(left.drivers),
        float(np.median(spacing_rmse_m(batch, own[batch.driver]))),
        _ahead_rmse_m(left, prior, population),
        float(np.median(spacing_rmse_m(batch, middle))),
        {
            name: kolmogorov_smirnov(a, b)
            for name, a, b in _common({name: _sample(each) for name, each in expected.items()}, _seen(left))
        },
    )


def _ahead_rmse_m(drivers: ObservedDrivers, prior: DriverPrior, population: DriverFit) -> float:
    halves = [
        (replace(driver, episodes=(_rows(each, slice(None, middle)),), free=()), _rows(each, slice(middle, None)))
        for driver in drivers.drivers
        for each in driver.episodes
        if (middle := len(each.time_s) // 2) * each.step_s * 2.0 >= LEAST_S
    ]
    if not halves:
        return np.nan
    first = replace(drivers, drivers=tuple(driver for driver, _ in halves))
    own = np.exp(fitted(first, prior, population).drivers)
    batch = batch_of([(n, drivers.allowed_mps[driver.place], after) for n, (driver, after) in enumerate(halves)])
    return float(np.median(spacing_rmse_m(batch, own[batch.driver])))


def _rows(episode: Following, rows: slice) -> Following:
    names = ("time_s", "gap_m", "speed_mps", "leader_speed_mps", "acceleration_mps2")
    return replace(episode, **{name: getattr(episode, name)[rows] for name in names})


def _following(drivers: ObservedDrivers) -> ObservedDrivers:
    """Those who follow somebody."""
    return replace(drivers, drivers=tuple(each for each in drivers.drivers if each.episodes))


def _seen(drivers: ObservedDrivers) -> Mapping[str, Sample]:
    return {"standstill_gap": _sample(drivers.standstill_gaps_m), "speed_factor": _sample(drivers.cruise)}


def _sample(values: Floats) -> Sample:
    return Sample.of([value] for value in values[np.isfinite(values)].tolist())


def _common(one: Mapping[str, Sample], other: Mapping[str, Sample]) -> Sequence[tuple[str, Sample, Sample]]:
    """What both have enough of."""
    return [(name, one[name], other[name]) for name in one if min(len(one[name]), len(other[name])) >= FEWEST]
