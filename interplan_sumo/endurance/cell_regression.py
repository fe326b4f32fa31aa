"""Cell regression: how a rate depends on planner, density, drivers and map, over all cells that were driven.

A Poisson regression of the total count of each segment, with the kilometres as
exposure and errors that allow for starts: one factor for each planner, density,
population of drivers and map, which multiply. What was driven in one cell so
says something of the others.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from interplan_sumo.endurance.rate_sample import METRES, MeasureKey
from interplan_sumo.endurance.rates import KM1000, DrivenRates
from interplan_sumo.endurance.records import TrafficCell
from interplan_sumo.errors import InputError
from interplan_sumo.statistics.event_rates import FEWEST_EFFECTIVE
from interplan_sumo.statistics.intervals import Range
from interplan_sumo.statistics.poisson_regression import poisson_regression

FACTORS: Final[dict[str, Callable[[DrivenRates], str]]] = {
    "planner": lambda driven: driven.planner,
    "density": lambda driven: f"{_cell(driven).density:g}",
    "drivers": lambda driven: _cell(driven).drivers,
    "map": lambda driven: _cell(driven).map,
}


@dataclass(frozen=True, slots=True)
class RateRatio:
    """By how much a rate is multiplied at one level of a factor, beside its reference."""

    factor: str
    level: str
    reference: str
    ratio: float
    interval: Range


@dataclass(frozen=True)
class CellRegression:
    """What the regression says of one measure."""

    measure: MeasureKey
    ratios: tuple[RateRatio, ...]
    fitted: Mapping[tuple[str, TrafficCell], tuple[float, Range]]
    """Per 1000 km, by planner and cell, with 95 % intervals."""
    left_out: tuple[str, ...]
    """Levels without any event, whose ratio has no value, and cells without rates."""
    why_not: str
    """Why there is no regression; empty where there is."""


def cell_regression(cells: Sequence[DrivenRates], measure: MeasureKey) -> CellRegression:
    """The regression over these cells."""
    left_out = [f"{each.label} ({each.refused})" for each in cells if each.refused]
    used = [each for each in cells if not each.refused]
    while empty := _without_events(used, measure):
        factor, level = empty
        left_out.append(f"{factor} {level} (no events)")
        used = [each for each in used if FACTORS[factor](each) != level]
    levels = {factor: _levels(used, factor, measure) for factor in FACTORS}
    columns = [(factor, level) for factor, found in levels.items() for level in found[1:]]

    def covariates(driven: DrivenRates) -> list[float]:
        return [1.0, *(float(FACTORS[factor](driven) == level) for factor, level in columns)]

    why_not = _why_not(used, measure)
    if why_not:
        return CellRegression(measure, (), {}, tuple(left_out), why_not)
    samples = [each.measures[measure].sample for each in used]
    rows = [covariates(each) for each, sample in zip(used, samples, strict=True) for _ in sample.starts]
    try:
        fit = poisson_regression(
            np.array(rows),
            np.concatenate([sample.segment_counts() for sample in samples]),
            np.concatenate([sample.rows[:, METRES] for sample in samples]),
            [start for sample in samples for start in sample.starts],
        )
    except InputError as error:
        return CellRegression(measure, (), {}, tuple(left_out), str(error))
    ratios: list[RateRatio] = []
    for number, (factor, level) in enumerate(columns, start=1):
        ratio, interval = fit.rate(np.eye(len(columns) + 1)[number])
        ratios.append(RateRatio(factor, level, levels[factor][0], ratio, interval))
    fitted: dict[tuple[str, TrafficCell], tuple[float, Range]] = {}
    for each in used:
        rate, (low, high) = fit.rate(np.array(covariates(each)))
        fitted[each.planner, _cell(each)] = rate * KM1000, (low * KM1000, high * KM1000)
    return CellRegression(measure, tuple(ratios), fitted, tuple(left_out), "")


def _cell(driven: DrivenRates) -> TrafficCell:
    if driven.cell is None:
        raise ValueError("a regression is over cells")
    return driven.cell


def _levels(cells: Sequence[DrivenRates], factor: str, measure: MeasureKey) -> list[str]:
    """The reference first: the lowest density, else where most happened, for the others are known best beside it.

    The others in the order of the cells, which is by planner, map, density and drivers; densities by size.
    """
    events: dict[str, float] = {}
    for each in cells:
        level = FACTORS[factor](each)
        events[level] = events.get(level, 0.0) + each.measures[measure].total.effective
    if factor == "density":
        return sorted(events, key=float)
    reference = max(events, key=events.__getitem__, default="")  # without cells there are no levels
    return sorted(events, key=lambda level: level != reference)


def _without_events(cells: Sequence[DrivenRates], measure: MeasureKey) -> tuple[str, str] | None:
    """The first factor and level at which nothing happened, though it did at others."""
    for factor in FACTORS:
        events: dict[str, float] = {}
        for each in cells:
            level = FACTORS[factor](each)
            events[level] = events.get(level, 0.0) + each.measures[measure].total.per_1000_km
        for level, count in events.items():
            if count == 0.0 and len(events) > 1:
                return factor, level
    return None


def _why_not(cells: Sequence[DrivenRates], measure: MeasureKey) -> str:
    if len(cells) < 2:
        return "a regression is over two cells or planners at least"
    events = sum(each.measures[measure].total.effective for each in cells)
    if events < FEWEST_EFFECTIVE:
        return f"{events:.0f} effective events in all cells; a regression needs {FEWEST_EFFECTIVE:.0f}"
    return ""
