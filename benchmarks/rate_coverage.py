"""How often intervals of rates hold the truth: kilometres made up in a world whose rates are known.

python -m benchmarks.rate_coverage [RUNS]
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from interplan_sumo.endurance.looks import stopped_at
from interplan_sumo.endurance.rates import MeasureRates, endurance_rates, log_ratio
from interplan_sumo.endurance.records import (
    Counts,
    EventRecord,
    RareEventRecord,
    RareKind,
    SegmentRecord,
    TrafficCell,
    likelihood_ratio,
)
from interplan_sumo.endurance.stop_rule import BATCH

CELL: Final = TrafficCell("toy", 0.5, "mixed")
NATURAL: Final[dict[RareKind, float]] = {"jaywalker": 0.001, "cut_in": 0.002}
BOOSTED: Final[dict[RareKind, float]] = {"jaywalker": 0.0125, "cut_in": 0.025}


@dataclass(frozen=True)
class ToyPlace:
    """What one kilometre from such a start is like."""

    ordinary: float
    """Collisions per kilometre while no rare event is active."""
    opportunities: dict[RareKind, float]
    """Mean opportunity-seconds per kilometre."""
    failures: dict[RareKind, float]
    """The probability of a collision once such an event has begun."""


QUIET: Final = ToyPlace(0.006, {"jaywalker": 20.0, "cut_in": 10.0}, {"jaywalker": 0.3, "cut_in": 0.15})
BUSY: Final = ToyPlace(0.014, {"jaywalker": 60.0, "cut_in": 30.0}, {"jaywalker": 0.55, "cut_in": 0.3})


@dataclass(frozen=True)
class ToyWorld:
    """Starts of which half are of either place; each has segments of its own luck."""

    segments: int
    naive: float
    """Share of the segments."""
    per_start: int
    places: tuple[ToyPlace, ...] = (QUIET, BUSY)
    luck: float = 0.3
    """Standard deviation of the logarithm of a start's ordinary rate, beside what its place says."""

    @property
    def truth(self) -> dict[str, float]:
        """Collisions per kilometre, by stratum and `total`."""
        found = {"ordinary": float(np.mean([place.ordinary for place in self.places]))}
        for kind, p in NATURAL.items():
            found[kind] = float(np.mean([p * each.opportunities[kind] * each.failures[kind] for each in self.places]))
        return found | {"total": sum(found.values())}


def driven(world: ToyWorld, rng: np.random.Generator) -> list[SegmentRecord]:
    """The segments of one run, naive and boosted ones in turn."""
    found: list[SegmentRecord] = []
    for start, first in enumerate(range(0, world.segments, world.per_start)):
        place = world.places[int(rng.integers(len(world.places)))]
        luck = float(np.exp(rng.normal(0.0, world.luck) - world.luck**2 / 2.0))
        for index in range(first, min(first + world.per_start, world.segments)):
            naive = (index + 1) * world.naive % 1.0 < index * world.naive % 1.0 or world.naive == 1.0
            found.append(_segment(index, f"e{start}", place, luck, naive, rng))
    return found


def _segment(
    index: int, start: str, place: ToyPlace, luck: float, naive: bool, rng: np.random.Generator
) -> SegmentRecord:
    """A kilometre in 100 s; what is left of a segment after a collision is driven, too."""
    q = NATURAL if naive else BOOSTED
    passed, begun = Counts(), Counts()
    events, rare = [], []
    for _ in range(rng.poisson(place.ordinary * luck)):
        events.append(_collision(50.0, None, 1.0))
    chances: Counts = {kind: int(rng.poisson(mean)) for kind, mean in place.opportunities.items()}
    for kind, count in chances.items():
        for begins in rng.random(count) < q[kind]:
            if not begins:
                passed[kind] = passed.get(kind, 0) + 1
                continue
            before = likelihood_ratio(NATURAL, q, passed, begun)
            begun[kind] = begun.get(kind, 0) + 1
            weight, time_s = likelihood_ratio(NATURAL, q, passed, begun), float(len(rare))
            rare.append(RareEventRecord(kind, time_s, "o", before, weight, dict(passed)))
            if rng.random() < place.failures[kind]:
                events.append(_collision(time_s, kind, weight))
    weight = likelihood_ratio(NATURAL, q, passed, begun)
    return SegmentRecord(
        index=index, cell=CELL, planner="toy", planner_hash=None, seed=0, naive=naive, start=start,
        metres=1000.0, seconds=100.0, weighted_metres=1000.0 * weight, weighted_seconds=100.0 * weight,
        final_weight=1.0 if naive else weight, natural=NATURAL, drawn_with=q, opportunities=chances,
        rare_events=tuple(rare), events=tuple(events), metres_at={"straight": 1000.0},
    )  # fmt: skip


def _collision(time_s: float, rare: RareKind | None, weight: float) -> EventRecord:
    return EventRecord("collision", time_s, 500.0, "straight", True, "car", rare, weight, 0.0, 0.0)


def collisions(segments: Sequence[SegmentRecord]) -> MeasureRates:
    """Their rates of at-fault collisions."""
    return endurance_rates(segments, only=("at_fault_collision",)).planners[0].measures["at_fault_collision"]


WORLDS: Final = {
    "naive, 1,200 km, 2 a start": ToyWorld(1200, 1.0, 2),
    "naive, 3,000 km, 10 a start": ToyWorld(3000, 1.0, 10),
    "half boosted, 800 km, 2 a start": ToyWorld(800, 0.5, 2),
    "half boosted, 1,200 km, 4 a start": ToyWorld(1200, 0.5, 4),
    "a fifth naive, 3,000 km, 4 a start": ToyWorld(3000, 0.2, 4),
    "half boosted, 4,000 km, 40 starts": ToyWorld(4000, 0.5, 100),
}


def coverage(world: ToyWorld, runs: int, seed: int = 0) -> dict[str, tuple[float, float, float, float]]:
    """By stratum: how many percent of intervals hold the truth, their mean half-width and mean rate over the
    truth, and how many percent of the runs have one."""
    rng = np.random.default_rng(seed)
    held: dict[str, list[tuple[bool, float]]] = {key: [] for key in world.truth}
    rates: dict[str, list[float]] = {key: [] for key in world.truth}
    for _ in range(runs):
        found = collisions(driven(world, rng))
        for key, estimate in {"total": found.total, "ordinary": found.ordinary, **found.rare}.items():
            truth = 1000.0 * world.truth[key]
            rates[key].append(estimate.per_1000_km / truth)
            if estimate.interval is not None:
                low, high = estimate.interval
                held[key].append((low <= truth <= high, (high - low) / 2.0 / truth))
    return {
        key: (
            100.0 * float(np.mean([holds for holds, _ in of])) if of else np.nan,
            float(np.mean([width for _, width in of])) if of else np.nan,
            float(np.mean(rates[key])),
            100.0 * len(of) / runs,
        )
        for key, of in held.items()
    }


def ratio_coverage(naive: ToyWorld, boosted: ToyWorld, runs: int, seed: int = 0) -> tuple[float, float]:
    """How many percent of the intervals of boosted over naive rates hold 1, and how many lie within 2/3 to 3/2."""
    rng = np.random.default_rng(seed)
    found = [
        log_ratio(collisions(driven(boosted, rng)).total, collisions(driven(naive, rng)).total) for _ in range(runs)
    ]
    known = [each for each in found if each is not None]
    holds = np.mean([low <= 1.0 <= high for _, (low, high) in known])
    return 100.0 * float(holds), 100.0 * float(np.mean([2.0 / 3.0 <= ratio <= 1.5 for ratio, _ in known]))


def stopped_coverage(
    world: ToyWorld, runs: int, batch: int, wanted: float, seed: int = 0
) -> tuple[float, float, float]:
    """How many percent of intervals hold the truth at the look that stopped, the mean events then, and looks."""
    rng = np.random.default_rng(seed)
    held, events, looks = [], [], []
    for _ in range(runs):
        stop = stopped_at(driven(world, rng), "at_fault_collision", batch, wanted)
        if stop is not None:
            low, high = stop.interval
            held.append(low <= 1000.0 * world.truth["total"] <= high)
            events.append(stop.effective)
            looks.append(stop.number)
    return 100.0 * float(np.mean(held)), float(np.mean(events)), float(np.mean(looks))


def main() -> None:
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    for name, world in WORLDS.items():
        for stratum, (holds, width, rate, known) in coverage(world, runs).items():
            print(
                f"{name:36} {stratum:10} {holds:5.1f} %  half-width {width:.2f}  mean {rate:.3f}  known {known:.0f} %"
            )
    world = WORLDS["naive, 1,200 km, 2 a start"]
    print("boosted over naive", ratio_coverage(replace(world, segments=1600), ToyWorld(2400, 0.25, 4), runs))
    for naive in (1.0, 0.4):
        print("stopped at 30 %", naive, stopped_coverage(ToyWorld(4000, naive, 4), runs, 100, 0.3))
    bad = replace(QUIET, ordinary=0.5)
    print("stopped by itself", stopped_coverage(ToyWorld(400, 0.5, 4, (bad, bad)), runs, BATCH, 0.3))


if __name__ == "__main__":
    main()
