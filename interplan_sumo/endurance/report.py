"""The endurance report: all that is told of the kilometres of one or several folders, before it has a form."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from interplan_sumo.endurance.cell_regression import CellRegression, cell_regression
from interplan_sumo.endurance.looks import HoursNeeded, RateLook, WidthPoint, hours_needed, looks, widths
from interplan_sumo.endurance.rate_sample import MEASURES, MeasureKey, measure_of
from interplan_sumo.endurance.rates import EnduranceRates, endurance_rates
from interplan_sumo.endurance.records import EventRecord, RareKind, SegmentRecord
from interplan_sumo.endurance.stop_rule import BATCH
from interplan_sumo.errors import InputError

MAIN: Final[MeasureKey] = "at_fault_collision"
"""What strata, looks and pictures are of where nothing else is asked for."""
WANTED: Final = 0.3
"""Half-width of the interval over the rate."""


@dataclass(frozen=True, slots=True)
class MappedEvent:
    """Where something happened."""

    planner: str
    measure: MeasureKey
    event: EventRecord
    segment: int


@dataclass(frozen=True)
class EnduranceReport:
    """Rates, what they depend on, how well they are known, and where things happened."""

    rates: EnduranceRates
    measure: MeasureKey
    """That strata, regression, looks and widths are of."""
    regression: CellRegression
    looks: Mapping[str, Sequence[RateLook]]
    """By planner, until its rate is known as well as wanted."""
    hours: Mapping[str, HoursNeeded | None]
    widths: Mapping[str, Sequence[WidthPoint]]
    events: Mapping[str, Sequence[MappedEvent]]
    """By map."""
    wanted: float


def endurance_report(
    segments: Iterable[SegmentRecord],
    rare: Mapping[RareKind, float] | None = None,
    measure: MeasureKey = MAIN,
    wanted: float = WANTED,
    batch: int = BATCH,
) -> EnduranceReport:
    """The report of segments of any planners and cells.

    `rare` has natural probabilities per opportunity and second other than those
    that were driven with, `wanted` is a half-width over the rate. InputError as
    `endurance_rates`.
    """
    if measure not in MEASURES:
        raise InputError(f"no measure {measure!r}; there are {', '.join(MEASURES)}")
    if not 0.01 <= wanted <= 2.0:
        raise InputError(f"a half-width of {wanted:g} of the rate; give 0.01 to 2")
    records = list(segments)
    rates = endurance_rates(records, rare)
    own = {each.planner: [record for record in records if record.planner == each.planner] for each in rates.planners}
    events: dict[str, list[MappedEvent]] = {}
    for record in sorted(records, key=lambda each: (each.planner, each.cell, each.seed, each.index)):
        events.setdefault(record.cell.map, []).extend(
            MappedEvent(record.planner, measure_of(event), event, record.index) for event in record.events
        )
    return EnduranceReport(
        rates=rates,
        measure=measure,
        regression=cell_regression(rates.cells, measure),
        looks={planner: looks(found, measure, batch, wanted, rates.natural) for planner, found in own.items()},
        hours={each.planner: hours_needed(each, measure, wanted) for each in rates.planners},
        widths={planner: widths(found, rates.natural, measure) for planner, found in own.items()},
        events=events,
        wanted=wanted,
    )
