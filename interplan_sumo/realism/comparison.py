"""Realism: simulated traffic beside recorded traffic, feature by feature, and as one number.

Recordings of several places differ among themselves, so rows say both how far a simulation lies from all recordings
taken as one, and how far from each place; and each place is itself a row, compared with all the others.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from statistics import median
from typing import Final, Literal

import numpy as np

from interplan_sumo.errors import InputError
from interplan_sumo.realism.distances import Sample, kolmogorov_smirnov, wasserstein
from interplan_sumo.realism.features import FEATURES, FeatureSamples, TrafficFeature, feature_samples, pooled
from interplan_sumo.realism.likelihood import ceiling, likelihood, weighted_mean
from interplan_sumo.realism.motion import motion_of
from interplan_sumo.realism.tracker_noise import NO_NOISE, TrackerNoise
from interplan_sumo.realism.tracks import RecordedTraffic, Track

FEWEST: Final = 10
"""Of fewer recorded road users nothing is scored; and no place is compared by fewer."""

RowKind = Literal["run", "recording", "baseline"]


@dataclass(frozen=True, slots=True, eq=False)
class RecordedPlaces:
    """What simulations are compared with."""

    places: Mapping[str, FeatureSamples]
    together: FeatureSamples
    """All places as one."""

    @property
    def scored(self) -> list[TrafficFeature]:
        """The features with enough road users to be likely or not."""
        return [each for each in FEATURES if self.together[each.key].road_users >= FEWEST]

    def without(self, place: str) -> RecordedPlaces:
        """The other places."""
        return of_places({name: samples for name, samples in self.places.items() if name != place})


@dataclass(frozen=True, slots=True, eq=False)
class FeatureComparison:
    """One feature of one simulation beside the recordings."""

    simulated: Sample
    recorded: Sample
    ks: float | None
    """Kolmogorov-Smirnov distance to all recordings as one; None where either side has nothing."""
    wasserstein: float | None
    """In the unit of the feature."""
    ks_by_place: Mapping[str, float]
    """To each place that has at least `FEWEST` road users with the feature."""
    likelihood: float | None
    """Of the recordings, were the simulation the truth; None where the feature is not scored."""

    @property
    def median_ks(self) -> float | None:
        """Over the places."""
        return median(self.ks_by_place.values()) if self.ks_by_place else None


@dataclass(frozen=True, slots=True, eq=False)
class RealismRow:
    """One simulation, or one place as if it were one."""

    name: str
    kind: RowKind
    features: Mapping[str, FeatureComparison]
    realism: float | None
    """The weighted mean of the likelihoods, 0 to 1; None where nothing is scored."""
    ceiling: float | None
    """The realism that the recordings have by themselves: nothing can have more."""

    @property
    def share(self) -> float | None:
        """Realism as a share of what can be had, 0 to 1: rows that are scored by different features compare by it."""
        return None if self.realism is None or not self.ceiling else self.realism / self.ceiling


@dataclass(frozen=True, slots=True, eq=False)
class RealismReport:
    """Rows in the order in which they are printed, and how far the places lie from one another."""

    recorded: RecordedPlaces
    rows: tuple[RealismRow, ...]
    between_places: Mapping[str, float]
    """By feature: the median of the KS distances of all pairs of places, where there are two with enough road users."""


def recorded_places(recordings: Iterable[RecordedTraffic]) -> RecordedPlaces:
    """Recordings by place; InputError if nobody moves in them."""
    found: dict[str, list[FeatureSamples]] = {}
    for each in recordings:
        found.setdefault(each.place, []).append(feature_samples([each]))
    if not found:
        raise InputError("there is no recording to compare with; name one with --against")
    recorded = of_places({place: _together(parts) for place, parts in found.items()})
    if not any(map(len, recorded.together.values())):
        raise InputError(f"nobody moves in {', '.join(found)} for 1.5 s or more; name longer recordings with --against")
    return recorded


def of_places(places: Mapping[str, FeatureSamples]) -> RecordedPlaces:
    """From the samples of each place."""
    return RecordedPlaces(places, _together(list(places.values())))


def _together(parts: Sequence[FeatureSamples]) -> FeatureSamples:
    return pooled({each.key: [part[each.key] for part in parts] for each in FEATURES})


def compare(name: str, kind: RowKind, simulated: FeatureSamples, recorded: RecordedPlaces) -> RealismRow:
    """A row. A simulation without a feature has a likelihood of 0 there; a short recording is not scored by it."""
    scored = [each for each in recorded.scored if kind != "recording" or simulated[each.key].road_users >= FEWEST]
    features = {each.key: _compare(each, simulated[each.key], recorded, each in scored) for each in FEATURES}
    likelihoods = {key: found.likelihood for key, found in features.items() if found.likelihood is not None}
    highest = {each.key: ceiling(recorded.together[each.key], each.bins) for each in scored}
    return RealismRow(
        name,
        kind,
        features,
        weighted_mean(likelihoods, WEIGHTS) if scored else None,
        weighted_mean(highest, WEIGHTS) if scored else None,
    )


WEIGHTS: Final[Mapping[str, float]] = {each.key: each.weight for each in FEATURES}


def _compare(feature: TrafficFeature, simulated: Sample, places: RecordedPlaces, scored: bool) -> FeatureComparison:
    recorded = places.together[feature.key]
    both = len(simulated) > 0 and len(recorded) > 0
    there = {name: samples[feature.key] for name, samples in places.places.items()}
    return FeatureComparison(
        simulated,
        recorded,
        kolmogorov_smirnov(simulated, recorded) if both else None,
        wasserstein(simulated, recorded) if both else None,
        {
            name: kolmogorov_smirnov(simulated, sample)
            for name, sample in there.items()
            if both and sample.road_users >= FEWEST
        },
        likelihood(recorded, simulated, feature.bins) if scored else None,
    )


def realism_report(
    simulations: Mapping[str, FeatureSamples],
    recordings: Sequence[RecordedTraffic],
    baselines: Mapping[str, FeatureSamples] | None = None,
    noise: TrackerNoise = NO_NOISE,
) -> RealismReport:
    """The rows of these simulations, of constant velocity and other baselines, and of each place against the others.

    Simulations have been shaken as recordings are by whoever gives them; constant velocity is shaken here.
    """
    recorded = recorded_places(recordings)
    rows = [compare(name, "run", samples, recorded) for name, samples in simulations.items()]
    steady = map(constant_velocity, recordings)
    constant = {"constant velocity": feature_samples(map(noise.on, steady))}
    rows += [compare(n, "baseline", samples, recorded) for n, samples in {**(baselines or {}), **constant}.items()]
    if len(recorded.places) > 1:
        rows += [
            compare(place, "recording", samples, recorded.without(place)) for place, samples in recorded.places.items()
        ]
    return RealismReport(recorded, tuple(rows), _between(recorded))


def _between(recorded: RecordedPlaces) -> dict[str, float]:
    found: dict[str, float] = {}
    for each in FEATURES:
        samples = [part[each.key] for part in recorded.places.values() if part[each.key].road_users >= FEWEST]
        if len(samples) > 1:
            found[each.key] = median(kolmogorov_smirnov(one, other) for one, other in combinations(samples, 2))
    return found


def constant_velocity(traffic: RecordedTraffic) -> RecordedTraffic:
    """Everybody as recorded in the beginning, and from then on straight ahead at the speed it had."""
    return replace(traffic, tracks=tuple(each for track in traffic.tracks if (each := _steady_on(track)) is not None))


def _steady_on(track: Track) -> Track | None:
    motion = motion_of(track)
    if motion is None:
        return None
    ahead_s = motion.time_s - motion.time_s[0]
    heading_rad, speed_mps = float(motion.heading_rad[0]), float(motion.speed_mps[0])
    return replace(
        track,
        time_s=motion.time_s,
        x_m=motion.x_m[0] + ahead_s * speed_mps * np.cos(heading_rad),
        y_m=motion.y_m[0] + ahead_s * speed_mps * np.sin(heading_rad),
        heading_rad=np.full(len(ahead_s), heading_rad),
        speed_mps=np.full(len(ahead_s), speed_mps),
    )
