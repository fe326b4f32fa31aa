"""Rate samples: what segments add to a rate, as columns, and the strata that are made of their sums.

How often a planner fails per kilometre is told in strata, which add up:

    ordinary        events while no rare event was active, from naive segments:      N = count
    each rare kind  p * O * F: its probability, the opportunity-seconds of naive segments, and failures per event
                    that began, F = sum of w * failures / sum of w, from all segments

N over the metres of naive segments is the rate. The weight w of a rare event is
that of its segment up to its draw, without it: events begin at opportunities of
natural traffic, weighted so, in boosted segments as in naive ones. Where one w
is more than a tenth of all, or nothing was boosted, the naive count stands
instead.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Final, Literal, NamedTuple

import numpy as np

from interplan_sumo.endurance.records import (
    RARE_KINDS,
    Counts,
    EventRecord,
    PlaceKind,
    RareKind,
    SegmentRecord,
    likelihood_ratio,
)
from interplan_sumo.errors import InputError, UnknownNameError
from interplan_sumo.statistics.event_rates import FEWEST_EFFECTIVE, ClusterRate, ClusterSums, Floats, effective_size

MOST_OF_ONE: Final = 0.1
"""Of the sum of weights: with more the mean is one observation's."""
FEWEST_COUNTED: Final = 5
"""Events of strata without weights, for an interval of the total."""
UNSEEN: Final = 3.7
MeasureKey = Literal[
    "at_fault_collision",
    "other_collision",
    "near_miss",
    "hard_braking",
    "red_light",
    "stall",
    "off_road",
    "planner_fault",
]
Stratum = RareKind | Literal["ordinary", "rare", "total"]
"""What a rate is made of; `rare` are all kinds of rare events together."""
MEASURES: Final[dict[MeasureKey, str]] = {
    "at_fault_collision": "at-fault collisions",
    "other_collision": "other collisions",
    "near_miss": "near misses",
    "hard_braking": "hard braking caused",
    "red_light": "red lights run",
    "stall": "stalls",
    "off_road": "off the road",
    "planner_fault": "planner faults",
}
METRES, SECONDS, ORDINARY, FIRST = 0, 1, 2, 3
"""Columns; from the fourth on four of each rare kind: naive count, opportunities, weights, weighted failures."""


class RateEvent(NamedTuple):
    """An event as rates see it."""

    measure: MeasureKey
    rare: RareKind | None
    place: PlaceKind | None
    weight: float
    """Of its rare event, as F has it; 1 without one."""
    naive_weight: float
    """As the naive count has it: 1, unless natural probabilities are others than those that were driven with."""


class WeighedSegment(NamedTuple):
    """A segment, with weights for the natural probabilities that rates are told for."""

    record: SegmentRecord
    weights: tuple[tuple[RareKind, float], ...]
    """Of each rare event that began."""
    events: tuple[RateEvent, ...]


def measure_named(name: str) -> MeasureKey:
    """The measure of that name; UnknownNameError if there is none."""
    for key in MEASURES:
        if key == name:
            return key
    raise UnknownNameError("measure", name, MEASURES)


def measure_of(event: EventRecord) -> MeasureKey:
    """What an event is counted as."""
    if event.kind == "collision":
        return "at_fault_collision" if event.at_fault else "other_collision"
    return event.kind


def natural_probabilities(
    segments: Sequence[SegmentRecord], others: Mapping[RareKind, float] | None = None
) -> dict[RareKind, float]:
    """Those that rates are told for: the ones that were driven with, or `others` instead.

    InputError where segments were driven with different ones, or for a kind
    that never could begin.
    """
    found: dict[RareKind, set[float]] = {}
    for each in segments:
        for kind, p in each.natural.items():
            found.setdefault(kind, set()).add(p)
    given = dict(others or {})
    for kind, p in given.items():
        if kind not in found or found[kind] == {0.0}:
            raise InputError(f"no {kind} could begin in these kilometres; drive with it before asking for its rate")
        if not 0.0 <= p <= 1.0:
            raise InputError(f"{kind} has the probability {p:g} per opportunity and second; give 0 to 1")
    for kind, values in found.items():
        if kind not in given and len(values) > 1:
            shown = " and ".join(f"{p:g}" for p in sorted(values)[:2])
            raise InputError(f"{kind} was driven with the probabilities {shown}; say which one rates are for")
    return {kind: given.get(kind, min(found[kind])) for kind in RARE_KINDS if kind in found}


def weighed(record: SegmentRecord, natural: Mapping[RareKind, float]) -> WeighedSegment:
    """A segment with its weights."""
    weights: list[tuple[RareKind, float]] = []
    begun: Counts = {}
    for each in record.rare_events:
        weights.append((each.kind, likelihood_ratio(natural, record.drawn_with, each.passed, begun)))
        begun[each.kind] = begun.get(each.kind, 0) + 1
    events = [_seen(event, record, weights, natural) for event in record.events]
    if record.fault is not None and record.fault.kind == "planner":
        events.append(RateEvent("planner_fault", None, None, 1.0, 1.0))
    return WeighedSegment(record, tuple(weights), tuple(events))


def _seen(
    event: EventRecord,
    record: SegmentRecord,
    weights: Sequence[tuple[RareKind, float]],
    natural: Mapping[RareKind, float],
) -> RateEvent:
    if event.rare is None:
        return RateEvent(measure_of(event), None, event.place, 1.0, 1.0)
    until_s = event.time_s + 0.05  # times of events are in whole tenths
    begun = (n for n, each in enumerate(record.rare_events) if each.kind == event.rare and each.time_s <= until_s)
    last = max(begun, default=0)
    changed = natural[event.rare] / record.natural[event.rare]
    return RateEvent(measure_of(event), event.rare, event.place, weights[last][1], changed)


@dataclass(frozen=True)
class RareWeights:
    """How many rare events of a kind began, and whether weights can be used."""

    kind: RareKind
    natural: float
    opportunities: int
    """Opportunity-seconds of naive segments."""
    begun_naive: int
    begun_boosted: int
    effective: float
    """As many events that began with equal weights would say as much."""
    refused: str
    """Why the naive count stands instead; empty if it does not."""


def rare_weights(segments: Sequence[WeighedSegment], natural: Mapping[RareKind, float]) -> dict[RareKind, RareWeights]:
    """Of each kind."""
    found: dict[RareKind, RareWeights] = {}
    boosted = any(each.record.drawn_with != natural for each in segments)
    for kind, p in natural.items():
        weights = np.array([w for each in segments for name, w in each.weights if name == kind])
        in_naive = sum(each.record.begun.get(kind, 0) for each in segments if each.record.naive)
        refused = ""
        if not boosted:
            refused = "nothing is boosted"
        elif not weights.sum() > 0.0:
            refused = "none began"
        elif weights.max() > MOST_OF_ONE * weights.sum():
            share = 100.0 * weights.max() / weights.sum()
            few = f"fewer than {1.0 / MOST_OF_ONE:.0f} began"
            refused = few if len(weights) * MOST_OF_ONE < 1.0 else f"one has {share:.0f} % of the weight"
        found[kind] = RareWeights(
            kind=kind,
            natural=p,
            opportunities=sum(each.record.opportunities.get(kind, 0) for each in segments if each.record.naive),
            begun_naive=in_naive,
            begun_boosted=len(weights) - in_naive,
            effective=effective_size(weights),
            refused=refused,
        )
    return found


class RateSample:
    """What segments add to the rates of one measure, at one kind of place or anywhere."""

    def __init__(
        self,
        segments: Sequence[WeighedSegment],
        rare: Mapping[RareKind, RareWeights],
        measure: MeasureKey,
        place: PlaceKind | None = None,
    ) -> None:
        """`rare` says of each kind whether its weights are used."""
        self.rare = rare
        self._first = {kind: FIRST + 4 * number for number, kind in enumerate(rare)}
        self.rows = np.zeros((len(segments), FIRST + 4 * len(rare)))
        """(N, C)"""
        self.events: list[RateEvent] = []
        """Those that have a part in the total."""
        for row, segment in zip(self.rows, segments, strict=True):
            self._fill(row, segment, measure, place)
        self.starts = [(each.record.cell.map, each.record.start) for each in segments]
        """(N,), what segments are clustered by."""

    def _fill(self, row: Floats, segment: WeighedSegment, measure: MeasureKey, place: PlaceKind | None) -> None:
        record = segment.record
        if record.naive:
            row[METRES] = record.metres if place is None else record.metres_at.get(place, 0.0)
            row[SECONDS] = record.seconds
            for kind, count in record.opportunities.items():
                row[self._first[kind] + 1] += count
        for kind, weight in segment.weights:
            row[self._first[kind] + 2] += weight
        for event in segment.events:
            if event.measure != measure or place not in (None, event.place):
                continue
            if event.rare is not None:
                row[self._first[event.rare] + 3] += event.weight
            if record.naive:
                column = ORDINARY if event.rare is None else self._first[event.rare]
                row[column] += event.naive_weight
            if record.naive or (event.rare is not None and not self.rare[event.rare].refused):
                self.events.append(event)

    @cached_property
    def sums(self) -> ClusterSums:
        """Over segments that began at one place."""
        return ClusterSums(self.rows, self.starts)

    def count(self, sums: Floats, stratum: Stratum) -> Floats:
        """How many events naive segments would have, of sums (..., C)."""
        if stratum == "ordinary":
            return sums[..., ORDINARY]
        if stratum == "total":
            return sums[..., ORDINARY] + self.count(sums, "rare")
        if stratum == "rare":
            return sum((self.count(sums, kind) for kind in self.rare), np.zeros(sums.shape[:-1]))
        first = self._first[stratum]
        if self.rare[stratum].refused:
            return sums[..., first]
        begun = self.rare[stratum].natural * sums[..., first + 1]
        return begun * self.failures_given(sums, stratum)

    def failures_given(self, sums: Floats, kind: RareKind) -> Floats:
        """Failures per rare event that began, of sums (..., C); 0 where none did."""
        weights, failures = sums[..., self._first[kind] + 2], sums[..., self._first[kind] + 3]
        return np.divide(failures, weights, out=np.zeros_like(failures), where=weights > 0.0)

    def rate(self, stratum: Stratum, per: int = METRES) -> ClusterRate | None:
        """Per metre or second of naive driving; None where there are no events, or all from one start."""
        return self.sums.rate(partial(self.rates, stratum=stratum, per=per))

    def rates(self, sums: Floats, stratum: Stratum, per: int = METRES) -> Floats:
        """Per metre or second of naive driving, of sums (..., C)."""
        exposure = sums[..., per]
        return np.divide(self.count(sums, stratum), exposure, out=np.zeros(exposure.shape), where=exposure > 0.0)

    def contributions(self, stratum: Stratum) -> Floats:
        """What each event adds to the count of a stratum."""
        if stratum == "total":
            return np.concatenate([self.contributions(each) for each in ("ordinary", *self.rare)])
        if stratum == "rare":
            return np.concatenate([np.zeros(0), *(self.contributions(kind) for kind in self.rare)])
        if stratum == "ordinary":
            return np.array([1.0 for event in self.events if event.rare is None])
        if self.rare[stratum].refused:
            return np.array([event.naive_weight for event in self.events if event.rare == stratum])
        total = self.sums.total
        first = self._first[stratum]
        each = self.rare[stratum].natural * total[first + 1] / total[first + 2]
        return np.array([each * event.weight for event in self.events if event.rare == stratum])

    def enough(self, stratum: Stratum) -> bool:
        """Whether an interval can be told: 30 effective events, and what weights do not tell is seen or small.

        Few events that only naive segments tell would otherwise go unseen among
        many weighted ones: of none that were seen there may be 3.7 (Poisson, 97.5 %).
        """
        if effective_size(self.contributions(stratum)) < FEWEST_EFFECTIVE:
            return False
        if stratum != "total":
            return True
        counted_ones = sum(event.rare is None or bool(self.rare[event.rare].refused) for event in self.events)
        unseen = MOST_OF_ONE * float(self.count(self.sums.total, "total")) >= UNSEEN
        return counted_ones >= FEWEST_COUNTED or unseen

    def segment_counts(self) -> Floats:
        """(N,) what each segment adds to the total count, to first order: they sum to it, and vary as it does."""
        counts = self.rows[:, ORDINARY].copy()
        total = self.sums.total
        for kind, of in self.rare.items():
            first = self._first[kind]
            if of.refused:
                counts += self.rows[:, first]
                continue
            given = float(self.failures_given(total, kind))
            unexpected = (self.rows[:, first + 3] - given * self.rows[:, first + 2]) / total[first + 2]
            counts += of.natural * (given * self.rows[:, first + 1] + total[first + 1] * unexpected)
        return counts
