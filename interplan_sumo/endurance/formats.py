"""The endurance report for people and for programs: tables on a terminal, lines of a page, and one JSON document."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from interplan_sumo.endurance.looks import HoursNeeded
from interplan_sumo.endurance.rate_sample import MEASURES, MeasureKey
from interplan_sumo.endurance.rates import DrivenRates, FailuresGiven, RateEstimate, cell_text
from interplan_sumo.endurance.records import PLACE_KINDS, PlaceKind
from interplan_sumo.endurance.report import EnduranceReport
from interplan_sumo.endurance.stop_rule import StopStanding
from interplan_sumo.errors import counted
from interplan_sumo.statistics.event_rates import FEWEST_EFFECTIVE
from interplan_sumo.statistics.intervals import Range

if TYPE_CHECKING:
    from rich.console import RenderableType

RARE_TITLES: Final = {
    "jaywalker": "jaywalker",
    "blocked_lane": "blocked lane",
    "cut_in": "cut-in",
    "hard_braking_ahead": "hard braking ahead",
    "red_light_runner": "red-light runner",
    "door": "opening door",
    "crosswalk": "crosswalk",
}
STRATUM_COLUMNS: Final = (
    "stratum", "probability", "opportunities / km", "began", "failures per event", "per million opportunities",
    "per 1000 km", "per hour", "effective events", "",
)  # fmt: skip
BRACKETS: Final = (
    "Brackets: 95 % interval, from starts that are drawn again with all their segments; none below "
    f"{FEWEST_EFFECTIVE:.0f} effective events. In parentheses: events that were seen."
)
REMOVED_PER_KM: Final = 0.1
"""More vehicles taken out of jams than this are told as a fault of the traffic."""
ODD_WEIGHT: Final = 4.0
"""Standard errors that the mean weight may be from 1."""


@dataclass(frozen=True)
class FigureTable:
    """A table in words."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def number_text(value: float) -> str:
    """With three digits."""
    return f"{value:,.0f}" if value >= 999.5 else f"{value:.3g}"


def range_text(interval: Range) -> str:
    return f"[{number_text(interval[0])}, {number_text(interval[1])}]"


def rate_text(rate: RateEstimate) -> str:
    """Per 1000 km, with its interval, or with the events that were seen where there is none."""
    beside = f"({rate.events})" if rate.interval is None else range_text(rate.interval)
    return f"{number_text(rate.per_1000_km)} {beside}"


def report_tables(report: EnduranceReport) -> list[FigureTable]:
    """All tables: rates, strata of each planner, places, and what the rate depends on."""
    found = [rates_table(report)]
    found += [strata_table(each, report.measure) for each in report.rates.planners if each.measures]
    found += [places_table(each) for each in report.rates.planners if each.measures]
    return [each for each in (*found, cells_table(report), *regression_tables(report)) if each.rows]


def shown_measures(report: EnduranceReport) -> list[MeasureKey]:
    """All but planner faults, which are shown where there are some."""
    every = [*report.rates.planners, *report.rates.cells]
    faults = any(each.measures and each.measures["planner_fault"].total.events for each in every)
    return [key for key in MEASURES if key != "planner_fault" or faults]


def rates_table(report: EnduranceReport) -> FigureTable:
    """A line per planner."""
    return _lines("Per 1000 km", [(each.planner, each) for each in report.rates.planners], report)


def cells_table(report: EnduranceReport) -> FigureTable:
    """A line per planner and cell; empty where each planner has one cell, of which all is said already."""
    several = len(report.rates.cells) > len(report.rates.planners)
    lines = [(each.label, each) for each in report.rates.cells] if several else []
    return _lines("Per 1000 km, cell by cell", lines, report)


def _lines(title: str, lines: Sequence[tuple[str, DrivenRates]], report: EnduranceReport) -> FigureTable:
    measures = shown_measures(report)
    columns = ("planner", "km", "of them naive", *(MEASURES[key] for key in measures))
    return FigureTable(title, columns, tuple((name, *_distance(each), *_line(each, measures)) for name, each in lines))


def _distance(driven: DrivenRates) -> tuple[str, str]:
    metres = driven.naive_m + driven.boosted_m
    return number_text(metres / 1000.0), f"{100.0 * driven.naive_m / max(metres, 1e-9):.0f} %"


def _line(driven: DrivenRates, measures: Sequence[MeasureKey]) -> list[str]:
    return [rate_text(driven.measures[key].total) if driven.measures else "refused" for key in measures]


def strata_table(driven: DrivenRates, measure: MeasureKey) -> FigureTable:
    """What makes the rate of a planner."""
    rates = driven.measures[measure]
    kilometres = driven.naive_m / 1000.0
    rows = [("ordinary", "", "", "", "", "", *_stratum(rates.ordinary), "naive kilometres only")]
    for kind, of in driven.rare.items():
        began = of.begun_naive + of.begun_boosted
        if not of.opportunities and not began:
            continue
        given = rates.given.get(kind)
        rows.append(
            (
                RARE_TITLES[kind],
                f"{of.natural:.2g}",
                number_text(of.opportunities / kilometres),
                f"{began} ({of.begun_naive} naive)",
                _given_text(given),
                "-" if given is None else number_text(1e6 * given.per_opportunity),
                *_stratum(rates.rare[kind]),
                f"naive count: {of.refused}" if of.refused else "weighted",
            )
        )
    rows.append(("total", "", "", "", "", "", *_stratum(rates.total), ""))
    return FigureTable(f"{driven.planner}: what makes its {MEASURES[measure]}", STRATUM_COLUMNS, tuple(rows))


def _stratum(rate: RateEstimate) -> tuple[str, str, str]:
    hour = "-" if rate.per_hour is None else number_text(rate.per_hour)
    if rate.interval_per_hour is not None:
        hour += f" {range_text(rate.interval_per_hour)}"
    return rate_text(rate), hour, f"{rate.effective:.0f}"


def _given_text(given: FailuresGiven | None) -> str:
    if given is None:
        return "-"
    beside = f"({given.events})" if given.interval is None else range_text(given.interval)
    return f"{number_text(given.per_event)} {beside}"


def places_table(driven: DrivenRates) -> FigureTable:
    """Per 1000 km at each kind of place."""
    places: list[PlaceKind] = [
        place for place in PLACE_KINDS if any(place in rates.places for rates in driven.measures.values())
    ]
    rows = [
        (MEASURES[key], *(rate_text(rates.places[place]) for place in places))
        for key, rates in driven.measures.items()
        if places and rates.total.events
    ]
    return FigureTable(f"{driven.planner}: per 1000 km at such places", ("", *places), tuple(rows))


def regression_tables(report: EnduranceReport) -> list[FigureTable]:
    """By how much planners, densities and drivers multiply the rate; none without a regression."""
    rows = [
        (f"{each.factor} {each.level}", each.reference, f"{number_text(each.ratio)} {range_text(each.interval)}")
        for each in report.regression.ratios
    ]
    title = f"{MEASURES[report.measure].capitalize()} multiplied by, all else alike"
    return [FigureTable(title, ("with", "instead of", "times"), tuple(rows))]


def report_notes(report: EnduranceReport) -> Iterator[str]:
    """What stands under the tables."""
    yield BRACKETS
    for each in report.rates.planners:
        yield from _driven_notes(each, report)
    yield from (f"{each.label}: no rates, {each.refused}." for each in report.rates.cells if each.refused and each.cell)
    if report.regression.left_out:
        yield f"Left out of the regression: {', '.join(report.regression.left_out)}."
    if report.regression.why_not and len(report.rates.cells) > 1:
        yield f"No regression over cells: {report.regression.why_not}."


def _driven_notes(driven: DrivenRates, report: EnduranceReport) -> Iterator[str]:
    metres = driven.naive_m + driven.boosted_m
    yield (
        f"{driven.planner}: {number_text(metres / 1000.0)} km in {counted(driven.segments, 'segment')} from "
        f"{counted(driven.starts, 'start')}"
        + "".join(f", {counted(number, f'{kind} fault')}" for kind, number in driven.faults.items())
        + "."
    )
    if driven.refused:
        yield f"{driven.planner}: no rates, {driven.refused}."
        return
    rates = driven.measures[report.measure]
    bound = rates.gain_bound
    if rates.given and bound is not None:
        yield (
            f"{driven.planner}: boosting can spare naive kilometres by {number_text(bound)} times at most "
            "(total over ordinary rate)."
        )
    if driven.mean_weight is not None:
        mean, error = driven.mean_weight
        odd = "; it should be 1, so do not trust these rates" if abs(mean - 1.0) > ODD_WEIGHT * error else ""
        yield f"{driven.planner}: mean weight of boosted segments {mean:.2f} +- {1.96 * error:.2f}{odd}."
    if driven.removed_vehicles > REMOVED_PER_KM * metres / 1000.0:
        yield (
            f"{driven.planner}: {counted(driven.removed_vehicles, 'vehicle')} taken out of jams, more than one in "
            "10 km: this density is more than the district bears."
        )
    yield from _known_notes(driven, report)


def _known_notes(driven: DrivenRates, report: EnduranceReport) -> Iterator[str]:
    """Whether the rate is known as well as wanted, or when it will be."""
    stop = next((each for each in report.looks[driven.planner] if each.half_width <= report.wanted), None)
    wanted, title = f"+-{100.0 * report.wanted:.0f} %", MEASURES[report.measure]
    if stop is not None:
        yield (
            f"{driven.planner}: {title} known to {wanted} after {number_text(stop.metres / 1000.0)} km: "
            f"{number_text(stop.per_1000_km)} {range_text(stop.interval)}, corrected for "
            f"{counted(stop.number, 'look')} ({stop.standard_errors:.2f} standard errors)."
        )
        return
    hours = report.hours[driven.planner]
    if hours is None:
        yield f"{driven.planner}: no {title}, so nothing says how far {wanted} is."
        return
    time = f" and {number_text(hours.hours)} {range_text(hours.range)} hours of one core" if hours.hours > 0.0 else ""
    share = f"; {100.0 * hours.naive:.0f} % naive would take fewest" if driven.measures[report.measure].given else ""
    yield (
        f"{driven.planner}: {title} to {wanted} take {number_text(hours.kilometres)} km{time} in all"
        f" ({hours.events:.0f} effective events so far, {hours.clustering:.1f} times the variance of independent ones"
        f"{share})."
    )


def standing_text(standing: StopStanding) -> str:
    """How well a rate is known after a batch, and how far it still is, in one line."""
    rule, look = standing.rule, standing.look
    wanted, title = f"+-{100.0 * rule.half_width:.0f} %", MEASURES[rule.measure]
    text = f"{counted(standing.segments, 'segment')}, {number_text(standing.metres / 1000.0)} km: {title} "
    if look is None:
        text += f"not known yet, fewer than {FEWEST_EFFECTIVE:.0f} effective events"
    else:
        text += (
            f"{number_text(look.per_1000_km)} per 1000 km {range_text(look.interval)}, "
            f"+-{100.0 * look.half_width:.0f} %, corrected for {counted(look.number, 'look')}"
        )
    if standing.known:
        return f"{text}; known to {wanted}, so this is the end"
    total = standing.needed.get("total")
    if total is None:
        return f"{text}; none has happened, so nothing says how far {wanted} is"
    parts = [f"{stratum} {_needed_text(each)}" for stratum, each in standing.needed.items() if stratum != "total"]
    return f"{text}; {wanted} take {_needed_text(total)} in all (alone: {', '.join(parts)})"


def _needed_text(needed: HoursNeeded) -> str:
    hours = f", {number_text(needed.hours)} {range_text(needed.range)} core hours" if needed.hours > 0.0 else ""
    return f"{number_text(needed.kilometres)} km{hours}"


def endurance_text(report: EnduranceReport) -> Iterator[RenderableType]:
    """For people."""
    from rich.table import Table as Grid
    from rich.text import Text

    for table in report_tables(report):
        grid = Grid(title=Text(table.title), title_justify="left")
        for number, title in enumerate(table.columns):
            grid.add_column(Text(title), justify="right" if number else "left", overflow="fold")
        for row in table.rows:
            grid.add_row(*(Text(each) for each in row))
        yield grid
    for line in report_notes(report):
        yield Text(line)


def endurance_json(report: EnduranceReport) -> dict[str, Any]:
    """As one document; null where there is nothing to say."""
    return {
        "measure": report.measure,
        "natural": dict(report.rates.natural),
        "planners": [_driven_json(each) for each in report.rates.planners],
        "cells": [_driven_json(each) for each in report.rates.cells],
        "regression": {
            "ratios": [
                {"factor": each.factor, "level": each.level, "reference": each.reference, "ratio": each.ratio,
                 "interval": list(each.interval)}
                for each in report.regression.ratios
            ],
            "left_out": list(report.regression.left_out),
            "why_not": report.regression.why_not or None,
        },
        "looks": {
            planner: [
                {"segments": each.segments, "km": each.metres / 1000.0, "per_1000_km": each.per_1000_km,
                 "interval": list(each.interval), "half_width": each.half_width, "effective_events": each.effective,
                 "information": each.information, "standard_errors": each.standard_errors}
                for each in found
            ]
            for planner, found in report.looks.items()
        },
        "wanted_half_width": report.wanted,
        "needed": {
            planner: None if each is None else {
                "km": each.kilometres, "core_hours": each.hours, "range": list(each.range),
                "effective_events": each.events, "clustering": each.clustering, "naive_share": each.naive,
            }
            for planner, each in report.hours.items()
        },
        "notes": list(report_notes(report)),
    }  # fmt: skip


def _driven_json(driven: DrivenRates) -> dict[str, Any]:
    cell = driven.cell
    return {
        "planner": driven.planner,
        "cell": None if cell is None else {"map": cell.map, "density": cell.density, "drivers": cell.drivers},
        "title": driven.planner if cell is None else cell_text(cell),
        "naive_km": driven.naive_m / 1000.0,
        "boosted_km": driven.boosted_m / 1000.0,
        "naive_hours": driven.naive_s / 3600.0,
        "segments": driven.segments,
        "starts": driven.starts,
        "mean_weight": None if driven.mean_weight is None else list(driven.mean_weight),
        "removed_vehicles": driven.removed_vehicles,
        "faults": dict(driven.faults),
        "refused": driven.refused or None,
        "rare": {
            kind: {
                "probability": of.natural, "opportunities": of.opportunities, "begun_naive": of.begun_naive,
                "begun_boosted": of.begun_boosted, "effective": of.effective, "refused": of.refused or None,
            }
            for kind, of in driven.rare.items()
        },
        "measures": {
            key: {
                "total": _rate_json(rates.total),
                "ordinary": _rate_json(rates.ordinary),
                "rare": {kind: _rate_json(rate) for kind, rate in rates.rare.items()},
                "given": {
                    kind: {"per_event": given.per_event, "interval": given.interval and list(given.interval),
                           "per_opportunity": given.per_opportunity, "events": given.events}
                    for kind, given in rates.given.items()
                },
                "places": {place: _rate_json(rate) for place, rate in rates.places.items()},
                "gain_bound": rates.gain_bound,
            }
            for key, rates in driven.measures.items()
        },
    }  # fmt: skip


def _rate_json(rate: RateEstimate) -> dict[str, Any]:
    return {
        "per_1000_km": rate.per_1000_km,
        "interval": rate.interval and list(rate.interval),
        "per_hour": rate.per_hour,
        "interval_per_hour": rate.interval_per_hour and list(rate.interval_per_hour),
        "events": rate.events,
        "effective_events": rate.effective,
    }
