"""Rates: collisions and the like per 1000 km, per hour and per opportunity, in strata, by place, with intervals.

Nothing is told with an interval that has fewer than 30 effective events (Kish),
and nothing at all where less than a fifth of the kilometres are naive.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import hypot
from typing import Final, get_args

import numpy as np

from interplan_sumo.batch.records import FaultClass
from interplan_sumo.endurance.rate_sample import (
    MEASURES,
    METRES,
    SECONDS,
    MeasureKey,
    RareWeights,
    RateSample,
    Stratum,
    WeighedSegment,
    natural_probabilities,
    rare_weights,
    weighed,
)
from interplan_sumo.endurance.records import PLACE_KINDS, PlaceKind, RareKind, SegmentRecord, TrafficCell
from interplan_sumo.errors import InputError, counted
from interplan_sumo.statistics.event_rates import FEWEST_EFFECTIVE, ClusterRate, effective_size
from interplan_sumo.statistics.intervals import Range

FEWEST_NAIVE: Final = 0.2
"""Of the kilometres: exposure and the ordinary rate are known from these only."""
KM1000: Final = 1e6
"""Metres."""
HOUR: Final = 3600.0
FEWEST_FOR_SPREAD: Final = 5.0
"""Effective events for a standard error that plans are made with, though it makes no interval yet."""


@dataclass(frozen=True, slots=True)
class RateEstimate:
    """A rate, and how well it is known."""

    per_1000_km: float
    per_hour: float | None
    """None at one kind of place, whose hours are not known."""
    interval: Range | None
    """95 %, per 1000 km; None with fewer than 30 effective events, or where all began at one place."""
    interval_per_hour: Range | None
    events: int
    """That were seen."""
    effective: float
    """As many events with equal weights would say as much."""
    spread: ClusterRate | None
    """Per metre, from 5 effective events on."""


@dataclass(frozen=True, slots=True)
class FailuresGiven:
    """Failures per rare event that began."""

    per_event: float
    interval: Range | None
    per_opportunity: float
    """Failures per opportunity and second: the natural probability times those per event."""
    events: int


@dataclass(frozen=True)
class MeasureRates:
    """The rates of one measure."""

    total: RateEstimate
    ordinary: RateEstimate
    rare: Mapping[RareKind, RateEstimate]
    given: Mapping[RareKind, FailuresGiven]
    """Of kinds whose weights are used."""
    places: Mapping[PlaceKind, RateEstimate]
    """The total per 1000 km at such places; empty where their metres are not known."""
    sample: RateSample

    @property
    def gain_bound(self) -> float | None:
        """How many times as far naive driving would have to go at most: the total over the ordinary rate.

        Boosting says nothing of the ordinary rate, which takes naive
        kilometres however precisely the rest is known. None without ordinary events.
        """
        if not self.ordinary.per_1000_km > 0.0:
            return None
        return self.total.per_1000_km / self.ordinary.per_1000_km


@dataclass(frozen=True)
class DrivenRates:
    """What a planner did in one cell, or in all that it drove."""

    planner: str
    cell: TrafficCell | None
    """None for all of its cells together, each with the kilometres that were driven in it."""
    segments: int
    starts: int
    naive_m: float
    boosted_m: float
    naive_s: float
    wall_s: float
    """That all segments took, one after another."""
    mean_weight: tuple[float, float] | None
    """Of boosted segments, and its standard error: it should be 1."""
    removed_vehicles: int
    faults: Mapping[FaultClass, int]
    rare: Mapping[RareKind, RareWeights]
    measures: Mapping[MeasureKey, MeasureRates]
    """Empty where there are no rates."""
    refused: str
    """Why; empty where there are rates."""

    @property
    def label(self) -> str:
        """The planner, and the cell where it is one."""
        cell = self.cell
        return self.planner if cell is None else f"{self.planner}, {cell_text(cell)}"


@dataclass(frozen=True)
class EnduranceRates:
    """Rates of all planners, together and cell by cell."""

    natural: Mapping[RareKind, float]
    """Probability per opportunity and second that rates are told for."""
    planners: tuple[DrivenRates, ...]
    cells: tuple[DrivenRates, ...]


def cell_text(cell: TrafficCell) -> str:
    """A cell in a line."""
    return f"{cell.map}, density {cell.density:g}, {cell.drivers}"


def endurance_rates(
    segments: Iterable[SegmentRecord],
    rare: Mapping[RareKind, float] | None = None,
    only: Collection[MeasureKey] = tuple(MEASURES),
) -> EnduranceRates:
    """Rates from segments of any planners and cells; `rare` has natural probabilities other than those driven with.

    InputError where two versions of a planner drove, where rare events had
    several natural probabilities and `rare` does not say which one is meant, or
    where nothing was driven.
    """
    ordered = sorted(segments, key=lambda each: (each.planner, each.cell, each.index))
    if not any(each.metres > 0.0 for each in ordered):
        faults = Counter(f"{each.fault.kind} fault" for each in ordered if each.fault is not None)
        why = ", ".join(counted(number, kind) for kind, number in faults.items())
        message = next((each.fault.message for each in ordered if each.fault is not None), "")
        raise InputError("no kilometre was driven" + (f": {why}, first: {message}" if why else ""))
    _check_versions(ordered)
    natural = natural_probabilities(ordered, rare)
    by_cell: dict[tuple[str, TrafficCell], list[WeighedSegment]] = {}
    for each in ordered:
        by_cell.setdefault((each.planner, each.cell), []).append(weighed(each, natural))
    planners = dict.fromkeys(planner for planner, _ in by_cell)
    cells = {key: _driven(*key, found, natural, only) for key, found in by_cell.items()}
    together: list[DrivenRates] = []
    for planner in planners:
        own = [key for key in by_cell if key[0] == planner]
        if len(own) == 1:
            together.append(cells[own[0]])
        else:
            together.append(_driven(planner, None, [each for key in own for each in by_cell[key]], natural, only))
    return EnduranceRates(natural, tuple(together), tuple(cells.values()))


def _check_versions(segments: Iterable[SegmentRecord]) -> None:
    versions: dict[str, str | None] = {}
    for each in segments:
        if versions.setdefault(each.planner, each.planner_hash) != each.planner_hash:
            raise InputError(f"{each.planner} drove these kilometres in two versions; give folders of one")


def _driven(
    planner: str,
    cell: TrafficCell | None,
    segments: Sequence[WeighedSegment],
    natural: Mapping[RareKind, float],
    only: Collection[MeasureKey],
) -> DrivenRates:
    records = [each.record for each in segments]
    naive_m = sum(each.metres for each in records if each.naive)
    boosted_m = sum(each.metres for each in records if not each.naive)
    refused = ""
    if naive_m < FEWEST_NAIVE * (naive_m + boosted_m) or naive_m == 0.0:
        share = 100.0 * naive_m / max(naive_m + boosted_m, 1e-9)
        refused = f"{share:.0f} % of the kilometres are naive; rates need {100.0 * FEWEST_NAIVE:.0f} %"
    rare = rare_weights(segments, natural)
    faults = [each.fault.kind for each in records if each.fault is not None]
    return DrivenRates(
        planner=planner,
        cell=cell,
        segments=len(records),
        starts=len({(each.cell.map, each.start) for each in records}),
        naive_m=naive_m,
        boosted_m=boosted_m,
        naive_s=sum(each.seconds for each in records if each.naive),
        wall_s=sum(each.wall_s for each in records),
        mean_weight=_mean_weight(records),
        removed_vehicles=sum(each.removed_vehicles for each in records),
        faults={kind: faults.count(kind) for kind in get_args(FaultClass) if kind in faults},
        rare=rare,
        measures={} if refused else {key: measure_rates(segments, rare, key) for key in only},
        refused=refused,
    )


def _mean_weight(records: Iterable[SegmentRecord]) -> tuple[float, float] | None:
    weights = np.array([each.final_weight for each in records if not each.naive])
    if len(weights) < 2:
        return None
    return float(weights.mean()), float(weights.std(ddof=1) / np.sqrt(len(weights)))


def measure_rates(
    segments: Sequence[WeighedSegment], rare: Mapping[RareKind, RareWeights], measure: MeasureKey
) -> MeasureRates:
    """The rates of one measure in all strata and at all kinds of places."""
    sample = RateSample(segments, rare, measure)
    naive = [each.record for each in segments if each.record.naive]
    known = all(abs(sum(each.metres_at.values()) - each.metres) < 1.0 + 0.01 * each.metres for each in naive)
    at: dict[PlaceKind, RateSample] = (
        {place: RateSample(segments, rare, measure, place) for place in PLACE_KINDS} if known else {}
    )
    return MeasureRates(
        total=_estimate(sample, "total"),
        ordinary=_estimate(sample, "ordinary"),
        rare={kind: _estimate(sample, kind) for kind in rare},
        given={kind: _given(sample, kind) for kind, of in rare.items() if not of.refused},
        places={place: _estimate(each, "total", hours=False) for place, each in at.items() if each.sums.total[METRES]},
        sample=sample,
    )


def _estimate(sample: RateSample, stratum: Stratum, *, hours: bool = True) -> RateEstimate:
    parts = sample.contributions(stratum)
    total, effective = sample.sums.total, effective_size(parts)
    count = float(sample.count(total, stratum))
    spread = sample.rate(stratum) if effective >= FEWEST_FOR_SPREAD else None
    enough = sample.enough(stratum)
    in_hours = sample.rate(stratum, SECONDS) if hours and enough else None
    return RateEstimate(
        per_1000_km=count / total[METRES] * KM1000,
        per_hour=float(count / total[SECONDS] * HOUR) if hours and total[SECONDS] > 0.0 else None,
        interval=_scaled(spread, KM1000) if enough else None,
        interval_per_hour=_scaled(in_hours, HOUR),
        events=len(parts),
        effective=effective,
        spread=spread,
    )


def _scaled(found: ClusterRate | None, by: float) -> Range | None:
    if found is None:
        return None
    low, high = found.interval()
    return low * by, high * by


def _given(sample: RateSample, kind: RareKind) -> FailuresGiven:
    per_event = float(sample.failures_given(sample.sums.total, kind))
    parts = sample.contributions(kind)
    spread = None
    if effective_size(parts) >= FEWEST_EFFECTIVE:
        spread = sample.sums.rate(lambda sums: sample.failures_given(sums, kind))
    return FailuresGiven(per_event, _scaled(spread, 1.0), sample.rare[kind].natural * per_event, len(parts))


def log_ratio(a: RateEstimate, b: RateEstimate) -> tuple[float, Range] | None:
    """The ratio of two independent rates and its 95 % interval; None where one of them has none."""
    if a.interval is None or b.interval is None or a.spread is None or b.spread is None:
        return None
    reach = np.exp(hypot(a.spread.half_width_of_log(), b.spread.half_width_of_log()))
    ratio = a.per_1000_km / b.per_1000_km
    return ratio, (ratio / float(reach), ratio * float(reach))
