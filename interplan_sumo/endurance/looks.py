"""Looks: when a rate is known well enough to stop, and how many hours that takes.

Looked is after every batch of segments, by their numbers, so that the answer is
the same in whatever order workers finished them. The intervals are corrected
for that (`statistics.repeated_looks`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Final

from interplan_sumo.endurance.rate_sample import (
    MeasureKey,
    RateSample,
    Stratum,
    WeighedSegment,
    natural_probabilities,
    rare_weights,
    weighed,
)
from interplan_sumo.endurance.rates import FEWEST_FOR_SPREAD, FEWEST_NAIVE, KM1000, DrivenRates
from interplan_sumo.endurance.records import RareKind, SegmentRecord, TrafficCell
from interplan_sumo.statistics.event_rates import ClusterRate, effective_size, relative_to_log
from interplan_sumo.statistics.intervals import Range
from interplan_sumo.statistics.repeated_looks import WIDEST, boundaries

MOST_WIDTHS: Final = 16
FEWER: Final = 0.8
"""As many segments from one width to the one before it."""
LEAST_NEWS: Final = 0.01
"""Of the information that is needed: with less than this no look is taken."""


@dataclass(frozen=True, slots=True)
class RateLook:
    """What was seen of the total rate at one look."""

    number: int
    """From 1; batches with fewer than 30 effective events are none."""
    segments: int
    metres: float
    """That were driven until then, boosted ones included."""
    per_1000_km: float
    interval: Range
    """Holds together with those of all other looks with 95 %."""
    half_width: float
    """Half the interval over the rate."""
    effective: float
    information: float
    """Of what the wanted half-width needs at most."""
    standard_errors: float
    """To either side of the interval."""


def looks(
    segments: Iterable[SegmentRecord],
    measure: MeasureKey,
    batch: int,
    wanted: float,
    natural: Mapping[RareKind, float] | None = None,
) -> list[RateLook]:
    """All looks at one planner's total rate until it is known, after `batch` segments of each cell and seed at a time.

    `wanted` is a half-width over the rate, such as 0.3. Batches end where the
    first segment is missing.
    """
    ordered = sorted(segments, key=lambda each: (each.index, each.cell))
    natural = natural or natural_probabilities(ordered)
    known = [weighed(each, natural) for each in ordered]
    found: list[tuple[int, float, RateSample, ClusterRate, float]] = []
    for end in range(batch, _complete(ordered) + 1, batch):
        until = [each for each in known if each.record.index < end]
        seen = _seen(until, natural, measure)
        if seen is None:
            continue
        metres, sample, spread = seen
        information = min(1.0, (relative_to_log(wanted) / spread.half_width_of_log(_confidence(WIDEST))) ** 2)
        if information < (found[-1][4] if found else 0.0) + LEAST_NEWS:
            continue
        found.append((len(until), metres, sample, spread, information))
        if information == 1.0:
            break
    reaches = boundaries([each[4] for each in found])
    return [
        RateLook(
            number=number,
            segments=count,
            metres=metres,
            per_1000_km=spread.value * KM1000,
            interval=_per_1000_km(spread.interval(_confidence(z))),
            half_width=spread.half_width(_confidence(z)),
            effective=effective_size(sample.contributions("total")),
            information=information,
            standard_errors=z,
        )
        for number, ((count, metres, sample, spread, information), z) in enumerate(
            zip(found, reaches, strict=True), start=1
        )
    ]


def stopped_at(segments: Sequence[SegmentRecord], measure: MeasureKey, batch: int, wanted: float) -> RateLook | None:
    """The first look at which the rate is known as well as wanted; None before that."""
    return next((look for look in looks(segments, measure, batch, wanted) if look.half_width <= wanted), None)


def _seen(
    segments: Sequence[WeighedSegment], natural: Mapping[RareKind, float], measure: MeasureKey
) -> tuple[float, RateSample, ClusterRate] | None:
    """Metres, sample and total rate of some segments; None where they tell no interval."""
    metres = sum(each.record.metres for each in segments)
    naive = sum(each.record.metres for each in segments if each.record.naive)
    if naive < FEWEST_NAIVE * metres or not naive:
        return None
    sample = RateSample(segments, rare_weights(segments, natural), measure)
    spread = sample.rate("total") if sample.enough("total") else None
    return None if spread is None else (metres, sample, spread)


def _complete(segments: Sequence[SegmentRecord]) -> int:
    """How many segments every cell and seed has from the first on without a gap."""
    cells: dict[tuple[TrafficCell, int], set[int]] = {}
    for each in segments:
        cells.setdefault((each.cell, each.seed), set()).add(each.index)
    return min((next(n for n in range(len(own) + 1) if n not in own) for own in cells.values()), default=0)


def _confidence(standard_errors: float) -> float:
    from scipy.special import ndtr

    return 2.0 * float(ndtr(standard_errors)) - 1.0


def _per_1000_km(interval: Range) -> Range:
    return interval[0] * KM1000, interval[1] * KM1000


@dataclass(frozen=True, slots=True)
class WidthPoint:
    """How well a total rate was known after so many kilometres, boosted ones included; not corrected for looking."""

    km: float
    half_width: float
    """Half the 95 % interval over the rate."""


def widths(
    segments: Iterable[SegmentRecord], natural: Mapping[RareKind, float], measure: MeasureKey
) -> list[WidthPoint]:
    """After more and more segments, from where there is an interval on."""
    ordered = sorted(segments, key=lambda each: (each.index, each.cell, each.seed))
    known = [weighed(each, natural) for each in ordered]
    found: list[WidthPoint] = []
    count = float(len(known))
    for _ in range(MOST_WIDTHS):
        seen = _seen(known[: round(count)], natural, measure)
        if seen is None:
            break
        metres, _, spread = seen
        found.append(WidthPoint(metres / 1000.0, spread.half_width()))
        count *= FEWER
    return found[::-1]


@dataclass(frozen=True, slots=True)
class HoursNeeded:
    """What it takes until a rate is known as well as wanted, reckoned from a pilot."""

    wanted: float
    events: float
    """Effective ones of the pilot."""
    clustering: float
    """The variance over that of independent events; 1 where there are too few to tell."""
    kilometres: float
    """In all, those of the pilot included, at the pilot's share of naive ones."""
    hours: float
    """Of one core, those of the pilot included."""
    range: Range
    """Of the hours, because few events are known: 95 %."""
    naive: float
    """The share of naive kilometres that would need fewest; a fifth at least."""


def hours_needed(
    driven: DrivenRates, measure: MeasureKey, wanted: float, stratum: Stratum = "total"
) -> HoursNeeded | None:
    """From what a pilot gave, until looks at a stratum of its rate find this half-width at the latest.

    None without events.
    """
    from scipy.special import chdtri

    rates = driven.measures.get(measure)
    if rates is None:
        return None
    sample = rates.sample
    events = effective_size(sample.contributions(stratum))
    if not events > 0.0:
        return None
    spread = sample.rate(stratum) if events >= FEWEST_FOR_SPREAD else None
    independent = 1.0 / sqrt(events)
    error = independent if spread is None else spread.log_error
    share = (error * WIDEST / relative_to_log(wanted)) ** 2
    metres = driven.naive_m + driven.boosted_m
    hours = driven.wall_s / 3600.0 * share
    low, high = float(chdtri(2.0 * events, 0.975)) / 2.0, float(chdtri(2.0 * events + 2.0, 0.025)) / 2.0
    return HoursNeeded(
        wanted=wanted,
        events=events,
        clustering=(error / independent) ** 2,
        kilometres=metres / 1000.0 * share,
        hours=hours,
        range=(hours * events / high, hours * events / low),
        naive=_best_share(driven, sample),
    )


def _best_share(driven: DrivenRates, sample: RateSample) -> float:
    """Of naive kilometres: variances of the strata fall with the kilometres of each."""
    weighted: list[RareKind] = [kind for kind, of in sample.rare.items() if not of.refused]
    from_boosted = sum(float((sample.contributions(kind) ** 2).sum()) for kind in weighted) * driven.boosted_m
    every = float((sample.contributions("total") ** 2).sum()) * driven.naive_m
    from_naive = every - sum(float((sample.contributions(kind) ** 2).sum()) for kind in weighted) * driven.naive_m
    if not from_boosted > 0.0:
        return 1.0
    return max(FEWEST_NAIVE, 1.0 / (1.0 + sqrt(from_boosted / max(from_naive, 1e-12))))
