"""A fitted population, moved until what recordings would see of it is what they saw of people: indirect inference.

Near junctions hardly anybody drives as it likes for long. A fit takes what was seen for what was wished, so wishes
come out too low, and driven again they are not even reached. So drivers of the population drive in plain traffic, are
seen as the recordings saw theirs, and the population is moved by what is missing (McFadden, 1989; Gouriéroux, Monfort
and Renault, 1993). How drivers differ, and what goes with what, stays as it was fitted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from interplan_sumo.realism.comparison import FEWEST
from interplan_sumo.realism.driver_population import QUALITIES, DriverPopulation
from interplan_sumo.realism.features import FeatureSamples

ROUNDS: Final = 4
"""Of simulations, each of other traffic. The n-th moves by 1/n of what is missing (Robbins and Monro, 1951): what one
minute of traffic happens to hold evens out."""
STEP: Final = 0.3
"""Of a logarithm, at most, in one round."""


@dataclass(frozen=True, slots=True)
class Moment:
    """A quantile of what is seen that tells a quality of drivers: the more of one, the more of the other."""

    feature: str
    share: float
    quality: str

    def of(self, samples: FeatureSamples) -> float:
        """NaN where too few show it, or none of it."""
        sample = samples[self.feature]
        value = sample.quantile(self.share) if sample.road_users >= FEWEST else np.nan
        return value if value > 0.0 else np.nan


MOMENTS: Final = (
    Moment("time_gap", 0.5, "time_gap_s"),
    Moment("standstill_gap", 0.5, "standstill_gap_m"),
    Moment("strongest_acceleration", 0.9, "accel_mps2"),  # less strong ones tell how many have to wait
    Moment("free_speed", 0.5, "speed_factor"),
)


@dataclass(frozen=True, slots=True, eq=False)
class SeenPopulation:
    """A population, and what is seen of it in place of the recorded drivers."""

    population: DriverPopulation
    recorded: Mapping[Moment, float]
    before: Mapping[Moment, float]
    """Seen of the population as it was fitted."""
    after: Mapping[Moment, float]
    """Seen of `population`."""


def as_seen(
    fitted: DriverPopulation, recorded: FeatureSamples, drive: Callable[[DriverPopulation, int], FeatureSamples]
) -> SeenPopulation:
    """Move a population until the `MOMENTS` of what is seen of it are the recorded ones.

    `drive` tells what is seen when a population drives in traffic of some seed. Moments that the recordings do not
    tell move nothing.
    """
    wanted = {each: value for each in MOMENTS if np.isfinite(value := each.of(recorded))}
    moved, rounds = fitted, list[dict[Moment, float]]()
    for number in range(ROUNDS + 1 if wanted else 0):
        samples = drive(moved, number)
        rounds.append({each: each.of(samples) for each in wanted})
        if number < ROUNDS:
            missing = {each: np.log(wanted[each] / seen) for each, seen in rounds[-1].items() if np.isfinite(seen)}
            by = np.zeros(len(QUALITIES))
            for each, logarithm in missing.items():
                by[QUALITIES.index(each.quality)] = np.clip(logarithm, -STEP, STEP) / (number + 1)
            moved = replace(moved, mean=moved.mean + by)
    return SeenPopulation(moved, wanted, rounds[0] if rounds else {}, rounds[-1] if rounds else {})
