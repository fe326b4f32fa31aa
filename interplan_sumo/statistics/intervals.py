"""Intervals: how far a mean over scenes may be from that of all scenes like them, by a stratified cluster bootstrap.

The figure is the mean over the scenes of the mean over the seeds of each, so
that every scene weighs the same and a family weighs as many scenes as it has:

    m = sum over families f of n_f / n * mean_f.

Scenes are drawn again within their families, each with all its seeds, because
drives of one scene are not independent and a suite always has the same number
of scenes of each family. What is taken for random is thus which scenes of a
family somebody has built, not only what happens in them. Scenes of one place are
not independent either and are drawn together: families that lie at the same
places are one, f, and what is said of scenes below holds for its places.

With n_f scenes in a family a bootstrap of n_f draws has a variance that is too
small by (n_f - 1) / n_f, so n_f - 1 are drawn (McCarthy and Snowden, 1985; Rao
and Wu, Resampling inference with complex survey data, JASA 83, 1988). And a
percentile interval takes the variance as known; with few scenes it is not.
Each draw is therefore moved away from the mean, by Student's quantile over the
normal's at the rank of the draw (after Hesterberg, What teachers should know
about the bootstrap, Am. Stat. 69, 2015, expanded percentiles), with

    v_f = (n_f / n)^2 * s_f^2 / n_f,   se^2 = sum of v_f,
    nu = se^4 / sum of (v_f^2 / (n_f - 1))

degrees of freedom (Satterthwaite, 1946). docs/statistics.md has the coverage.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from math import inf, isfinite, sqrt
from typing import Final

import numpy as np

from interplan_sumo.statistics.scene_values import DriveValues, Floats, strata

DRAWS: Final = 2000
SEED: Final = 20240407
"""Fixed, so that the same scores give the same interval, in whatever order they come."""
CONFIDENCE: Final = 0.95
MANY_SCENES: Final = 1000
"""The mean of a family of more is drawn from the normal distribution that its bootstrap means tend to."""
SAME: Final = 1e-4
"""Values of a family no farther apart are equal: scores of one drive agree to this, in points, across machines."""
FEW_DRAWS: Final = 10
"""Where fewer draws lie beyond zero, Student's distribution says how probable that is: draws do not reach so far."""

Range = tuple[float, float]
"""A least and a greatest value."""
POINTS: Final[Range] = (0.0, 100.0)
"""Between which all scores and shares of a table lie."""
DIFFERENCES: Final[Range] = (-100.0, 100.0)
"""And their differences."""


@dataclass(frozen=True)
class MeanEstimate:
    """The mean of a figure over scenes, and how well it is known; in the unit of the figure."""

    value: float
    scenes: int
    places: int
    """At which they lie: as many say something that no other does."""
    standard_error: float
    """0 where all scenes of each family are equal."""
    degrees_of_freedom: float
    ends: Range
    """Least and greatest mean of a place."""
    limits: Range
    """What figures of scenes lie between; infinite where nobody knows."""
    draw: Callable[[], Floats]
    """The (2000,) bootstrap means in no order, not yet moved by Student's quantiles; drawn when they are asked for."""

    @cached_property
    def moved(self) -> Floats:
        """(2000,), the draws by size, each moved away from the mean as the module says."""
        from scipy.special import ndtri, stdtrit  # here, as most commands need no quantiles

        ranks = (np.arange(DRAWS) + 0.5) / DRAWS
        farther = stdtrit(self.degrees_of_freedom, ranks) / ndtri(ranks)
        return self.value + (np.sort(self.draw()) - self.value) * farther

    @property
    def interval(self) -> Range:
        """95 % of the moved draws lie between, as far as the limits go.

        Where all scenes of each family are equal there is nothing to draw. What
        is known then is that not too large a share of such scenes is another:
        where a share q is as those n that were seen, q^n is the chance to see
        no other, so q is at least 0.025^(1/n) (Clopper and Pearson, Biometrika
        26, 1934; 0.69 for ten scenes, 0.955 for eighty). The rest may have any
        value within the limits; towards an infinite one nothing can be said.
        """
        least, greatest = self.limits
        if self.standard_error == 0.0:
            others = 1.0 - ((1.0 - CONFIDENCE) / 2.0) ** (1.0 / self.places)
            low = self.value - (others * (self.ends[1] - least) if isfinite(least) else 0.0)
            high = self.value + (others * (greatest - self.ends[0]) if isfinite(greatest) else 0.0)
        else:
            beyond = round(DRAWS * (1.0 - CONFIDENCE) / 2.0)
            low, high = float(self.moved[beyond - 1]), float(self.moved[-beyond])
        return max(low, least), min(high, greatest)

    @cached_property
    def p_value(self) -> float:
        """Of a true mean of 0, two-sided: twice the share of moved draws that are 0 or on its other side.

        Where nothing varies, twice the chance to see no other scene if there are
        as many as it takes to make the mean 0. Below 0.05 only if the interval leaves
        out 0, but never below `least_p`.
        """
        if abs(self.value) <= SAME:
            return 1.0
        share = self._share_unseen() if self.standard_error == 0.0 else self._share_beyond()
        return min(1.0, max(2.0 * share, self.least_p))

    @property
    def least_p(self) -> float:
        """2^(1 - places), what a sign test can reach: fewer than six prove nothing, however equal their scenes are."""
        return 2.0 ** (1 - min(self.places, 1000))

    def _share_unseen(self) -> float:
        farthest = self.ends[1] - self.limits[0] if self.value > 0.0 else self.limits[1] - self.ends[0]
        return (1.0 - abs(self.value) / farthest) ** self.places if isfinite(farthest) else 0.0

    def _share_beyond(self) -> float:
        from scipy.special import stdtr

        beyond = int(np.sum(self.moved <= 0.0 if self.value > 0.0 else self.moved >= 0.0))
        if beyond >= FEW_DRAWS:
            return beyond / DRAWS
        far = abs(self.value) / self.standard_error
        return min(FEW_DRAWS / DRAWS, float(stdtr(self.degrees_of_freedom, -far)))


def mean_estimate(drives: DriveValues, limits: Range = (-inf, inf)) -> MeanEstimate | None:
    """The mean over scenes, of figures that lie within these limits.

    None with fewer than two places, which say nothing about scenes like theirs.
    """
    found = strata(drives)
    samples = [stratum.values for stratum in found]
    scenes, places = sum(stratum.scenes for stratum in found), sum(map(len, samples))
    if places < 2:
        return None
    shares = np.array([stratum.scenes / scenes for stratum in found])
    variances = shares**2 * [_variance(values) / len(values) for values in samples]
    return MeanEstimate(
        value=float(shares @ [values.mean() for values in samples]),
        scenes=scenes,
        places=places,
        standard_error=sqrt(variances.sum()),
        degrees_of_freedom=_degrees_of_freedom(variances, [len(values) - 1 for values in samples]),
        ends=(float(min(values[0] for values in samples)), float(max(values[-1] for values in samples))),
        limits=limits,
        draw=partial(_drawn_means, shares, samples),
    )


def mean_interval(drives: DriveValues, limits: Range) -> Range | None:
    """That of the mean over scenes, of figures that lie within these limits; None with fewer than two places."""
    estimate = mean_estimate(drives, limits)
    return None if estimate is None else estimate.interval


def unpaired_difference(a: MeanEstimate, b: MeanEstimate) -> MeanEstimate:
    """b less a, of scenes that have nothing to do with each other."""
    variances = np.array([a.standard_error**2, b.standard_error**2])
    return MeanEstimate(
        value=b.value - a.value,
        scenes=min(a.scenes, b.scenes),
        places=min(a.places, b.places),
        standard_error=sqrt(variances.sum()),
        degrees_of_freedom=_degrees_of_freedom(variances, [a.degrees_of_freedom, b.degrees_of_freedom]),
        ends=(b.ends[0] - a.ends[1], b.ends[1] - a.ends[0]),
        limits=(b.limits[0] - a.limits[1], b.limits[1] - a.limits[0]),
        # as they come, draws of scenes of equal number would go hand in hand
        draw=lambda: np.random.default_rng(SEED + 1).permutation(b.draw()) - a.draw(),
    )


def _variance(values: Floats) -> float:
    """Of the scenes of a family, from their sample."""
    return 0.0 if np.ptp(values) <= SAME else float(values.var(ddof=1))


def _drawn_means(shares: Floats, samples: Sequence[Floats]) -> Floats:
    """(2000,) means over families with these shares of the scenes."""
    rng = np.random.default_rng(SEED)
    return shares @ np.array([_drawn_family_means(values, rng) for values in samples])


def _drawn_family_means(values: Floats, rng: np.random.Generator) -> Floats:
    """(2000,) means of n - 1 of n values (n,), drawn with replacement."""
    count = len(values)
    if count > MANY_SCENES:
        return rng.normal(values.mean(), sqrt(_variance(values) / count), DRAWS)
    return values[rng.integers(0, count, (DRAWS, count - 1))].mean(axis=1)


def _degrees_of_freedom(variances: Floats, of_each: Sequence[float]) -> float:
    """Satterthwaite's of a sum of independent variances with so many each; all together where nothing varies."""
    if not variances.any():
        return float(sum(of_each))
    shares = variances / variances.sum()
    return 1.0 / float(np.sum(shares**2 / np.array(of_each)))
