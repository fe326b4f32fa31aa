"""Standing: which lines of a table can be told apart from the best, and how large a difference the table would find."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import comb
from statistics import median

from interplan_sumo.statistics.detection import (
    SIGNIFICANCE,
    Contrast,
    RowPair,
    contrasts,
    least_detectable_difference,
    row_pairs,
)
from interplan_sumo.statistics.intervals import POINTS, MeanEstimate, mean_estimate, unpaired_difference
from interplan_sumo.statistics.scene_values import DriveKey, DriveValues, mean_over_scenes

LineValues = Mapping[str, DriveValues]
"""Of one line, by column, the figure of each drive, 0 to 100; nothing where the cell has no mean."""


@dataclass(frozen=True, slots=True)
class DetectableDifference:
    """The least true difference between two lines of a column that shows in 80 of 100 such tables, in points."""

    least: float
    middle: float
    """Median over the pairs of lines: some pairs differ more from scene to scene than others."""
    greatest: float
    paired: bool
    """Whether all pairs share their scenes; with one line, that of two such lines on scenes of their own."""


@dataclass(frozen=True, slots=True)
class Standing:
    """How the lines of a table, by their numbers, stand to the best one in the column over all families."""

    column: str
    drives: Mapping[int, int]
    """Lines that have a figure there, and of how many drives."""
    best: int | None
    """None where fewer than two have one, where these are not `of_one_kind`, or one has too few scenes of its own."""
    contrasts: tuple[Contrast, ...]
    detectable: Mapping[str, DetectableDifference]
    """By column, without those where no two scenes differ."""

    @property
    def too_few(self) -> tuple[int, int] | None:
        """How many scenes there are, at how many places, if among so many pairs they tell nobody apart."""
        most = max((each.pair.estimate for each in self.contrasts), key=lambda each: each.places, default=None)
        if most is None or most.least_p * len(self.contrasts) < SIGNIFICANCE:
            return None
        return most.scenes, most.places

    @property
    def alike(self) -> list[int]:
        """Lines that cannot be told apart from the best."""
        return self._beside_best(told_apart=False)

    @property
    def behind(self) -> list[int]:
        """Lines that can."""
        return self._beside_best(told_apart=True)

    def _beside_best(self, *, told_apart: bool) -> list[int]:
        pairs = [{each.pair.a, each.pair.b} for each in self.contrasts if each.told_apart == told_apart]
        return [line for line in self.drives if line != self.best and {line, self.best} in pairs]


def standing(totals: Sequence[str], lines: Sequence[LineValues]) -> Standing:
    """By that of the columns `totals` which most lines have a figure in, the first of equals."""
    having = {key: tuple(number for number, line in enumerate(lines) if line[key]) for key in totals}
    column = max(totals, key=lambda key: len(having[key]))
    figures = having[column]
    pairs = {key: row_pairs([line[key] for line in lines]) for key in lines[0]}
    drives = [frozenset(lines[number][column]) for number in figures]
    compared = len(pairs[column]) == comb(len(figures), 2) or len({*drives}) == 1
    ranked = len(figures) > 1 and compared and of_one_kind(drives)
    spans = {key: _detectable(found, [line[key] for line in lines]) for key, found in pairs.items()}
    return Standing(
        column=column,
        drives={number: len(lines[number][column]) for number in figures},
        best=max(figures, key=lambda number: mean_over_scenes(lines[number][column]) or 0.0) if ranked else None,
        contrasts=tuple(contrasts(pairs[column])),
        detectable={key: span for key, span in spans.items() if span is not None},
    )


def of_one_kind(drives: Collection[frozenset[DriveKey]]) -> bool:
    """Whether means over these may be ranked: all of the same drives, or each over some of its own.

    Where some are shared and others not, who has the lower mean may be better in what is shared.
    """
    kinds = {*drives}
    return all(one.isdisjoint(other) for one, other in combinations(kinds, 2))


def _detectable(pairs: Sequence[RowPair], rows: Sequence[DriveValues]) -> DetectableDifference | None:
    estimates: list[MeanEstimate] = [pair.estimate for pair in pairs]
    if not pairs:
        estimates = [unpaired_difference(one, one) for row in rows if (one := mean_estimate(row, POINTS))]
    found = [least for estimate in estimates if (least := least_detectable_difference(estimate)) is not None]
    if not found:
        return None
    return DetectableDifference(min(found), median(found), max(found), bool(pairs) and all(p.paired for p in pairs))
