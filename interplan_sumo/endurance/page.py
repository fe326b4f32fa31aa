"""The endurance report as one HTML file: rates, what makes them, where things happened, and how well that is known."""

from __future__ import annotations

from pathlib import Path

from interplan_sumo.endurance.drawings import MAP_WIDE, event_maps, planner_colours, rate_drawings, width_drawing
from interplan_sumo.endurance.formats import (
    cells_table,
    places_table,
    rates_table,
    regression_tables,
    report_notes,
    strata_table,
)
from interplan_sumo.endurance.rate_sample import MEASURES
from interplan_sumo.endurance.report import EnduranceReport
from interplan_sumo.report.page.curves import HIGH, LEFT, WIDE
from interplan_sumo.report.page.html import html, style_of
from interplan_sumo.world.files import writing


def write_endurance_report(
    report: EnduranceReport, *, page: Path | None = None, plot: Path | None = None, command: str = ""
) -> None:
    """As one HTML page and as a figure (.png, .pdf, .svg), where they are asked for; `command` stands on the page.

    InputError if they cannot be written, or if matplotlib is not there for the
    figure. Names are text whatever they hold.
    """
    if plot is not None:
        from interplan_sumo.endurance.plot import plot_endurance

        plot_endurance(report, plot)
    if page is not None:
        text = endurance_page(report, command)
        with writing(page, "give another file as --html"):
            page.write_text(text, encoding="utf-8")


def endurance_page(report: EnduranceReport, command: str = "") -> str:
    """The report as HTML."""
    told = [each for each in report.rates.planners if each.measures]
    return html(
        "endurance.html.j2",
        style=style_of("page.css", "realism.css", "curves.css"),
        script="",
        measure=MEASURES[report.measure],
        colours=planner_colours(report),
        rates=rates_table(report),
        strata=[strata_table(each, report.measure) for each in told],
        places=[table for each in told if (table := places_table(each)).rows],
        panels=rate_drawings(report) if len(report.rates.cells) > 1 else [],
        cells=cells_table(report),
        ratios=[table for table in regression_tables(report) if table.rows],
        maps=event_maps(report),
        widths=width_drawing(report),
        notes=list(report_notes(report)),
        command=command,
        wide=WIDE,
        high=HIGH,
        left=LEFT,
        map_wide=MAP_WIDE,
    )
