"""How often intervals hold the truth and detectable differences are detected, on made-up suites whose truth is known.

python -m benchmarks.interval_coverage [--repetitions 4000]

Prints the tables of docs/statistics.md: the coverage of the 95 % interval of a
mean and of a paired difference, and how often a difference as large as the
printed least detectable one is found, beside what a bootstrap over seeds and a
plain percentile bootstrap over scenes would do.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import Final

import numpy as np

from interplan_sumo.statistics.detection import least_detectable_difference
from interplan_sumo.statistics.intervals import DIFFERENCES, DRAWS, POINTS, MeanEstimate, mean_estimate
from interplan_sumo.statistics.scene_values import DriveValue, DriveValues, Floats, differences


@dataclass(frozen=True, slots=True)
class MadeUpSuite:
    """Families of scenes, each driven with several seeds; scores 0 to 100."""

    title: str
    families: int
    scenes: int
    """Per family."""
    seeds: int
    chances: tuple[float, float]
    """Of success, mean over the scenes of the first and of the last family; those between lie evenly between."""
    alike: float
    """Of the seeds of a scene: 0 if all end the same, large if scenes do not differ."""
    together: int = 1
    """So many families lie at the same places, where every second scene ends as that of the first of them does."""

    @property
    def truth(self) -> float:
        """The mean score of all scenes that there could be."""
        return 100.0 * MEAN_QUALITY * float(self._chances().mean())

    def _chances(self) -> Floats:
        return np.linspace(*self.chances, self.families)

    def scores(self, rng: np.random.Generator) -> Floats:
        """(families, scenes, seeds): 0 where it fails, 75 to 100 where it succeeds.

        The chance of a scene is drawn from a beta distribution around that of its family, its quality once.
        """
        mean = self._chances()[:, None]
        chance = rng.beta(mean * self.alike, (1.0 - mean) * self.alike, (self.families, self.scenes))
        quality = 1.0 - 0.25 * rng.beta(1.0, 2.0, (self.families, self.scenes))
        done = rng.random((self.families, self.scenes, self.seeds)) < chance[..., None]
        scores: Floats = 100.0 * quality[..., None] * done
        for family in range(1, self.together):
            as_first = rng.random(self.scenes) < 0.5
            scores[family, as_first] = scores[0, as_first]
        return scores


MEAN_QUALITY: Final = 1.0 - 0.25 / 3.0

SUITES: Final = (
    MadeUpSuite("8 families x 10 scenes, 1 seed", 8, 10, 1, (0.2, 0.8), 2.0),
    MadeUpSuite("8 x 10, 3 seeds, strong scenes", 8, 10, 3, (0.2, 0.8), 0.5),
    MadeUpSuite("8 x 10, families 5 to 95 %", 8, 10, 1, (0.05, 0.95), 2.0),
    MadeUpSuite("8 x 10, 3 seeds, 85 to 99 %", 8, 10, 3, (0.85, 0.99), 1.0),
    MadeUpSuite("8 x 30, 1 seed", 8, 30, 1, (0.2, 0.8), 2.0),
    MadeUpSuite("8 x 3, 3 seeds", 8, 3, 3, (0.2, 0.8), 2.0),
    MadeUpSuite("9 x 1, 1 seed", 9, 1, 1, (0.2, 0.8), 2.0),
    MadeUpSuite("one family of 10, half solved", 1, 10, 1, (0.5, 0.5), 2.0),
    MadeUpSuite("one family of 10, 80 % solved", 1, 10, 1, (0.8, 0.8), 2.0),
    MadeUpSuite("8 x 10, 96 % solved", 8, 10, 1, (0.96, 0.96), 2.0),
    MadeUpSuite("8 x 10, three families at the same places", 8, 10, 1, (0.5, 0.5), 2.0, together=3),
    MadeUpSuite("8 x 40, three families at the same places", 8, 40, 1, (0.5, 0.5), 2.0, together=3),
)


def drive_values(scores: Floats, together: int = 1) -> DriveValues:
    """Scores (families, scenes, seeds) as a run has them; the scenes of the first families lie at the same places."""
    return {
        (f"{family}/{scene}", seed): DriveValue(str(family), float(value), str(scene) if family < together else "")
        for (family, scene, seed), value in np.ndenumerate(scores)
    }


def estimate_of(scores: Floats, together: int = 1) -> MeanEstimate:
    found = mean_estimate(drive_values(scores, together), POINTS)
    assert found is not None
    return found


def coverage(suite: MadeUpSuite, repetitions: int, rng: np.random.Generator) -> tuple[float, float]:
    """The share of intervals that hold the truth, and their mean width in points."""
    bounds = np.array([estimate_of(suite.scores(rng), suite.together).interval for _ in range(repetitions)])
    held = (bounds[:, 0] <= suite.truth + 1e-9) & (bounds[:, 1] >= suite.truth - 1e-9)
    return float(held.mean()), float(np.ptp(bounds, axis=1).mean())


def percentile_coverage(suite: MadeUpSuite, over: str, repetitions: int, rng: np.random.Generator) -> float:
    """The same of a plain percentile bootstrap over the `seeds` of each scene or over all `scenes` of a family."""
    held = 0
    for _ in range(repetitions):
        scores = suite.scores(rng)
        axis = 2 if over == "seeds" else 1
        picked = rng.integers(0, scores.shape[axis], (DRAWS, *scores.shape[: axis + 1]))
        values = scores if over == "seeds" else scores.mean(axis=2)
        means = np.take_along_axis(np.broadcast_to(values, (DRAWS, *values.shape)), picked, axis + 1)
        low, high = np.quantile(means.reshape(DRAWS, -1).mean(axis=1), (0.025, 0.975))
        held += low - 1e-9 <= suite.truth <= high + 1e-9
    return held / repetitions


@dataclass(frozen=True, slots=True)
class PairedSuite:
    """Two planners on the same scenes, which are as hard for both; b gets `more` points in the mean than a."""

    title: str
    families: int
    scenes: int
    seeds: int
    spread: float
    """Of the differences between scenes, standard deviation in points."""

    def rows(self, more: float, rng: np.random.Generator) -> tuple[DriveValues, DriveValues]:
        shape = (self.families, self.scenes, 1)
        hard = rng.uniform(0.0, 100.0, shape)
        effect = rng.choice((-1.0, 0.0, 0.0, 1.0), shape) * self.spread * np.sqrt(2.0)
        noise = rng.normal(0.0, self.spread / 4.0, (2, self.families, self.scenes, self.seeds))
        return drive_values(hard + noise[0]), drive_values(hard + effect + more + noise[1])

    def estimate(self, more: float, rng: np.random.Generator) -> MeanEstimate:
        found = mean_estimate(differences(*self.rows(more, rng)), DIFFERENCES)
        assert found is not None
        return found


PAIRS: Final = (
    PairedSuite("8 x 10, 1 seed", 8, 10, 1, 45.0),
    PairedSuite("8 x 10, 3 seeds", 8, 10, 3, 45.0),
    PairedSuite("8 x 30, 1 seed", 8, 30, 1, 45.0),
    PairedSuite("one family of 10", 1, 10, 3, 45.0),
)


def detection(suite: PairedSuite, repetitions: int, rng: np.random.Generator) -> tuple[float, float, float, float]:
    """Of equal planners the share told apart; then coverage, the mean least detectable difference, and its power.

    Power is the share of fresh tables that tell the planners apart when they differ by what another table printed.
    """
    wrong = held = found = 0
    printed: list[float] = []
    for _ in range(repetitions):
        null = suite.estimate(0.0, rng)
        wrong += null.p_value < 0.05
        held += null.interval[0] <= 0.0 <= null.interval[1]
        least = least_detectable_difference(null) or 0.0
        printed.append(least)
        found += suite.estimate(least, rng).p_value < 0.05
    return wrong / repetitions, held / repetitions, float(np.mean(printed)), found / repetitions


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--repetitions", type=int, default=4000)
    options.add_argument("--seed", type=int, default=26)
    asked = options.parse_args()
    rng = np.random.default_rng(asked.seed)
    print("| made-up suite | coverage | width | percentile over scenes | over seeds |\n|---|---:|---:|---:|---:|")
    for suite in SUITES:
        held, width = coverage(suite, asked.repetitions, rng)
        few = asked.repetitions // 4
        over_scenes = f"{100.0 * percentile_coverage(suite, 'scenes', few, rng):.1f} %"
        over_seeds = f"{100.0 * percentile_coverage(suite, 'seeds', few, rng):.1f} %" if suite.seeds > 1 else "-"
        print(f"| {suite.title} | {100.0 * held:.1f} % | {width:.0f} | {over_scenes} | {over_seeds} |", flush=True)
    print(
        "\n| two planners | told apart though equal | coverage | least detectable | found |\n|---|---:|---:|---:|---:|"
    )
    for pair in PAIRS:
        wrong, held, least, found = detection(pair, asked.repetitions, rng)
        shares = f"{100.0 * wrong:.1f} % | {100.0 * held:.1f} % | {least:.1f} points | {100.0 * found:.1f} %"
        print(f"| {pair.title} | {shares} |", flush=True)


if __name__ == "__main__":
    main()
