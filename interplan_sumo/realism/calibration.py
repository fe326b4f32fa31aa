"""Drivers fitted to recordings, from reading to the vehicle-type file: `calibrate`."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from interplan_sumo.errors import InputError
from interplan_sumo.realism.as_seen import ROUNDS, SeenPopulation, as_seen
from interplan_sumo.realism.car_following import PARAMETERS, spacing_rmse_m
from interplan_sumo.realism.driver_fit import DriverFit
from interplan_sumo.realism.driver_population import QUALITIES, DriverPopulation, check_drawn
from interplan_sumo.realism.features import BY_KEY, FeatureSamples, feature_samples
from interplan_sumo.realism.held_out import HeldOut, fitted, held_out
from interplan_sumo.realism.observed_drivers import ObservedDrivers, observed_drivers
from interplan_sumo.realism.plain_traffic import plain_traffic
from interplan_sumo.realism.published import PRIORS, WAVER_MPS2, Road
from interplan_sumo.realism.tracks import RecordedTraffic
from interplan_sumo.realism.vehicle_type_writer import vehicle_type_text, write_vehicle_types
from interplan_sumo.realism.views import views_of
from interplan_sumo.simulation.vehicle_types import read_vehicle_types
from interplan_sumo.world.geometry import Floats

TOLD: Final = 0.5
"""A record tells a parameter if it takes away this share of the population's variance, or more."""
WAVERING: Final = 5
UNITS: Final[dict[str, str]] = dict(zip(QUALITIES, ("s", "m", "m/s2", "m/s2", "", "s", "s", "s"), strict=True))
NAMES: Final[dict[str, str]] = dict(
    zip(
        QUALITIES,
        ("time gap T", "standstill gap s0", "acceleration a", "braking b", "desired speed over the allowed one",
         "reaction time (published)", "critical gap of lane changes (published)", "lane change (published)"),
        strict=True,
    )
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class CalibrationOptions:
    """What a user may say beside the recordings. InputError for what cannot be."""

    road: Road = "city"
    """Whose published drivers fill in what the recordings do not tell."""
    limits_mps: Mapping[str, float] | None = None
    """By place, where known."""
    count: int = 64
    """How many types are drawn."""
    shift: float = 0.0
    """Quantiles by which every drawn driver is more cautious than the measured one."""
    date: str = ""
    """When the recordings were made."""
    source: str = ""
    """Whose they are, and under which licence."""
    as_fitted: bool = False
    """Whether the drivers of a city stay as they were fitted, whatever is seen of them in plain traffic."""

    def __post_init__(self) -> None:
        if self.road not in PRIORS:
            raise InputError(f"the road is {self.road!r}, expected {' or '.join(PRIORS)}")
        for place, limit_mps in (self.limits_mps or {}).items():
            if not 1.0 < limit_mps < 60.0:
                raise InputError(f"the limit of {place} is {limit_mps:g} m/s, expected 1 to 60")
        check_drawn(self.count, self.shift)


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """What was fitted, and how well."""

    options: CalibrationOptions
    recordings: tuple[RecordedTraffic, ...]
    drivers: ObservedDrivers
    fit: DriverFit
    seen: SeenPopulation
    held_out: HeldOut

    @property
    def population(self) -> DriverPopulation:
        """The one that drivers are drawn from."""
        return self.seen.population

    @property
    def rmse_m(self) -> Floats:
        """(E,) spacing errors of the episodes, each driver with its own type."""
        batch = self.drivers.batch(free=False)
        return spacing_rmse_m(batch, np.exp(self.fit.drivers)[batch.driver])

    @property
    def told(self) -> dict[str, int]:
        """How many drivers tell each parameter."""
        return dict(zip(PARAMETERS, (self.fit.identified >= TOLD).sum(axis=0).tolist(), strict=True))

    @property
    def waver_mps2(self) -> float:
        """Of the driver in the middle; published where fewer than `WAVERING` tell it."""
        told = self.drivers.waver_mps2[np.isfinite(self.drivers.waver_mps2)]
        return float(np.median(told)) if len(told) >= WAVERING else WAVER_MPS2[self.options.road]

    def drawn(self) -> Floats:
        """(N, 8) drivers."""
        return self.population.drawn(self.options.count, self.options.shift)

    def text(self) -> str:
        """The vehicle-type file."""
        return vehicle_type_text(self.drawn(), self.waver_mps2, [*_comment(self)])


def calibrate(
    recordings: Sequence[RecordedTraffic],
    options: CalibrationOptions | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> Calibration:
    """Fit drivers to recordings, and to all places but one in turn; InputError as `calibrated`."""
    found = calibrated(recordings, options or CalibrationOptions(), say)
    return replace(found, held_out=held_out(found.drivers, PRIORS[found.options.road]))


def calibrated(
    recordings: Sequence[RecordedTraffic], options: CalibrationOptions, say: Callable[[str], None] = lambda _: None
) -> Calibration:
    """Fit drivers to recordings, nothing held out; InputError if there is too little.

    `say` is told what takes long; TrafficError if SUMO fails.
    """
    prior = PRIORS[options.road]
    drivers = observed_drivers(recordings, options.limits_mps)
    fit = fitted(drivers, prior)
    population = DriverPopulation.of(fit)
    found = Calibration(
        options, tuple(recordings), drivers, fit, SeenPopulation(population, {}, {}, {}), HeldOut((), {})
    )
    return found if options.as_fitted or options.road != "city" else replace(found, seen=_as_seen(found, say))


def _as_seen(found: Calibration, say: Callable[[str], None]) -> SeenPopulation:
    """The population that looks in plain traffic as the recordings look."""
    views = views_of(found.recordings)

    def drive(population: DriverPopulation, seed: int) -> FeatureSamples:
        say(f"plain traffic of the fitted drivers, {seed + 1} of {ROUNDS + 1}")
        text = vehicle_type_text(population.drawn(found.options.count), found.waver_mps2, [])
        with TemporaryDirectory(prefix="interplan_") as folder:
            file = Path(folder) / "drivers.xml"
            write_vehicle_types(file, text)
            return feature_samples(plain_traffic(read_vehicle_types(file), "plain", views, seed))

    return as_seen(found.population, feature_samples(found.recordings), drive)


def _comment(found: Calibration) -> Iterator[str]:
    options, drivers = found.options, found.drivers
    yield "Drivers fitted to recordings by `interplan-sumo traffic calibrate`; regenerate rather than edit."
    if options.source:
        yield from _wrapped(f"Source: {options.source}")
    yield from _wrapped(f"Recordings: {', '.join(each.name for each in found.recordings)}.")
    yield f"Date: {options.date or 'not given'}."
    episodes = sum(len(each.episodes) for each in drivers.drivers)
    yield from _wrapped(
        f"Sample: {len(drivers.drivers)} drivers in {len(drivers.places)} places, {episodes} episodes behind a leader. "
        f"Told by the records of: {', '.join(f'{NAMES[name]} {count}' for name, count in found.told.items())}; "
        f"where a record tells little the population decides, and before it {PRIORS[options.road].source}."
    )
    yield from _wrapped(
        "Allowed speeds (m/s): "
        + ", ".join(f"{place} {mps:.1f}" for place, mps in sorted(drivers.allowed_mps.items()))
        + "; of places without a known limit the 85th percentile of free speeds over 1.1."
    )
    yield from _wrapped(f"Spacing error of a driver's own type, median over episodes: {np.median(found.rmse_m):.2f} m.")
    left = found.held_out
    if left.places:
        yield from _wrapped(
            f"Held out, one place after the other: {left.median('own_rmse_m'):.2f} m with the type fitted for a driver "
            f"by the population of the other places, {left.median('ahead_rmse_m'):.2f} m ahead of what it was fitted "
            f"to, {left.median('anybody_rmse_m'):.2f} m with the median type."
        )
    yield from _wrapped(
        "Published, not fitted: reaction times (Green, 2000), critical gaps and relaxation after cut-ins (I-24 MOTION, "
        "NGSIM US-101), durations of lane changes (Thiemann et al., 2008; Toledo and Zohar, 2007)."
    )
    yield from _wrapped(
        f"Shift: {options.shift:+g} quantiles towards caution. {options.count} types, lognormal and correlated: "
        + ", ".join(f"{NAMES[name]} {_middle(found, at)}" for at, name in enumerate(QUALITIES))
        + "."
    )
    if found.seen.recorded:
        seen = found.seen
        moments = (
            f"{BY_KEY[each.feature].title} p{100.0 * each.share:.0f} recorded {value:.2f}, as fitted "
            f"{seen.before[each]:.2f}, as moved {seen.after[each]:.2f} {BY_KEY[each.feature].unit}"
            for each, value in seen.recorded.items()
        )
        yield from _wrapped(
            "Moved until what recordings would see of them in plain SUMO traffic is what they saw (indirect inference; "
            f"medians only, spreads and correlations are those of the fit): {'; '.join(moments)}."
        )
    wavering = np.isfinite(drivers.waver_mps2).sum()
    yield from _wrapped(
        f"Wavering: root mean square acceleration at a kept speed {found.waver_mps2:.2f} m/s2, "
        + (f"told by {wavering} drivers." if wavering >= WAVERING else "published.")
    )
    if len(drivers.walking_mps):
        low, middle, high = np.percentile(drivers.walking_mps, [5, 50, 95])
        count = len(drivers.walking_mps)
        yield f"Walkers (not part of this file): {middle:.2f} m/s, p5 {low:.2f}, p95 {high:.2f}, n {count}."


def _middle(found: Calibration, at: int) -> str:
    """Median, and p5 to p95, of the drawn drivers."""
    low, middle, high = np.percentile(found.drawn()[:, at], [5, 50, 95])
    unit = UNITS[QUALITIES[at]]
    return f"{middle:.2f}{' ' + unit if unit else ''} ({low:.2f} to {high:.2f})"


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, 110, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)


def calibration_json(found: Calibration) -> dict[str, Any]:
    """One document; null where there is nothing to say."""
    drawn, fit = found.drawn(), found.fit
    return {
        "recordings": [{"name": each.name, "place": each.place} for each in found.recordings],
        "drivers": len(found.drivers.drivers),
        "episodes": sum(len(each.episodes) for each in found.drivers.drivers),
        "allowed_mps": {place: round(mps, 2) for place, mps in sorted(found.drivers.allowed_mps.items())},
        "rmse_m": {"median": _number(np.median(found.rmse_m)), "p90": _number(np.percentile(found.rmse_m, 90))},
        "fit": {
            name: {
                "median": _number(np.exp(fit.mean[at])),
                "log_sigma": _number(np.sqrt(fit.covariance[at, at])),
                "told_by": found.told[name],
                "drivers": [_number(value) for value in np.exp(fit.drivers[:, at])],
            }
            for at, name in enumerate(PARAMETERS)
        },
        "types": {
            name: {f"p{share}": _number(np.percentile(drawn[:, at], share)) for share in (5, 25, 50, 75, 95)}
            for at, name in enumerate(QUALITIES)
        },
        "as_seen": [
            {
                "feature": each.feature,
                "share": each.share,
                "moves": each.quality,
                "recorded": _number(value),
                "as_fitted": _number(found.seen.before[each]),
                "as_moved": _number(found.seen.after[each]),
            }
            for each, value in found.seen.recorded.items()
        ],
        "held_out": {
            "own_rmse_m": _number(found.held_out.median("own_rmse_m")),
            "ahead_rmse_m": _number(found.held_out.median("ahead_rmse_m")),
            "anybody_rmse_m": _number(found.held_out.median("anybody_rmse_m")),
            "between_places_ks": {name: _number(value) for name, value in found.held_out.between.items()},
            "places": [
                {
                    "place": each.place,
                    "drivers": each.drivers,
                    "own_rmse_m": _number(each.own_rmse_m),
                    "ahead_rmse_m": _number(each.ahead_rmse_m),
                    "anybody_rmse_m": _number(each.anybody_rmse_m),
                    "ks": {name: _number(value) for name, value in each.distances.items()},
                }
                for each in found.held_out.places
            ],
        },
        "waver_mps2": _number(found.waver_mps2),
        "walking_mps": [_number(value) for value in np.percentile(found.drivers.walking_mps, [5, 50, 95])]
        if len(found.drivers.walking_mps)
        else None,
    }


def _number(value: Any) -> float | None:
    return round(float(value), 4) if np.isfinite(value) else None
