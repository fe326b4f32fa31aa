"""One number for how real traffic is, in the form of the realism meta-metric of Waymo's Sim Agents challenge.

There (N. Montali et al., The Waymo Open Sim Agents Challenge, NeurIPS 2023, section 4; code in waymo-research/
waymo-open-dataset, src/waymo_open_dataset/wdl_limited/sim_agents_metrics, estimators.py and metrics.py, figures of
challenge_2025_sim_agents_config.textproto) an object of a recorded scene is simulated 32 times. Per feature and object
a histogram of all simulated steps, with 0.1 added to each bin, gives each recorded step a probability, that of its bin;
values beyond the ends count in the end bins. The mean of the logarithms over all valid steps is exponentiated: the
likelihood of the feature, 0 to 1. The meta-metric is the weighted mean over the features, then the mean over scenes.

Ours has that arithmetic, and differs in what it is applied to:

- Populations, not rollouts of a recorded scene: nobody of a recording has a twin in a simulation of another place. So
  there is one histogram per feature, over all simulated road users and steps, and one number, not one per scene. It
  says whether the traffic as a whole is like the recorded, not whether a driver did what that driver did.
- Each road user counts as one (`distances.Sample`) in the histogram and in the mean; there each step counts as one.
- The features are of following, braking and changing lanes; there they are also of collisions, of leaving the road
  and of red lights. Bins are narrower where all of a city would lie in two or three of theirs (accelerations in 2.2
  m/s2).
- The weights are ours: theirs are 0.05 for each kinematic feature and 0.1 for each gap to others, so here a feature
  of gaps and braking weighs twice as much as a kinematic one.

A likelihood of 1 would need all recorded values in one bin. What can be reached is that of the recording by itself, the
exponential of its negative entropy: `ceiling`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from interplan_sumo.realism.distances import Sample
from interplan_sumo.world.geometry import Floats, Ints

PSEUDOCOUNT: Final = 0.1
"""Of a road user, in each bin: `additive_smoothing_pseudocount` of Waymo's configuration."""


@dataclass(frozen=True, slots=True)
class Bins:
    """Bins of equal width; what lies beyond the ends counts in the end bins."""

    low: float
    high: float
    count: int

    @property
    def edges(self) -> Floats:
        """(count + 1,)."""
        return np.linspace(self.low, self.high, self.count + 1)

    def of(self, values: Floats) -> Ints:
        """The number of the bin of each value; a value on an inner edge belongs to the bin above."""
        number = np.floor((values - self.low) / (self.high - self.low) * self.count)
        return np.clip(number, 0, self.count - 1).astype(np.int64)


def probabilities(simulated: Sample, bins: Bins) -> Floats:
    """(count,) of each bin, smoothed, so that none is 0."""
    counts = np.bincount(bins.of(simulated.values), weights=simulated.weights, minlength=bins.count) + PSEUDOCOUNT
    return counts / counts.sum()


def likelihood(recorded: Sample, simulated: Sample, bins: Bins) -> float:
    """How likely the recorded values are if the simulated ones are the truth, 0 to 1; ValueError if there is none.

    0 if nothing was simulated: that explains nothing.
    """
    if not len(recorded):
        raise ValueError("nothing was recorded of this feature, so nothing is likely")
    if not len(simulated):
        return 0.0
    return _expected(recorded, probabilities(simulated, bins), bins)


def ceiling(recorded: Sample, bins: Bins) -> float:
    """The highest likelihood that any simulation can have of this recording; ValueError if none is recorded."""
    if not len(recorded):
        raise ValueError("nothing was recorded of this feature, so nothing is likely")
    counts = np.bincount(bins.of(recorded.values), weights=recorded.weights, minlength=bins.count)
    return _expected(recorded, counts / counts.sum(), bins)


def _expected(recorded: Sample, chances: Floats, bins: Bins) -> float:
    """The geometric mean of the probabilities of the recorded values."""
    of_bin = np.bincount(bins.of(recorded.values), weights=recorded.weights, minlength=bins.count)
    there = of_bin > 0.0
    return float(np.exp(of_bin[there] @ np.log(chances[there]) / of_bin.sum()))


def weighted_mean(likelihoods: Mapping[str, float], weights: Mapping[str, float]) -> float:
    """One number of the likelihoods of some features, 0 to 1; ValueError if there is none."""
    if not likelihoods:
        raise ValueError("no feature was recorded")
    total = sum(weights[name] for name in likelihoods)
    return sum(weights[name] * value for name, value in likelihoods.items()) / total
