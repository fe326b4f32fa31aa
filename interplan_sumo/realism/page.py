"""The realism report as one HTML file: distributions side by side as drawings, and all figures."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor
from pathlib import Path
from typing import Final

import numpy as np

from interplan_sumo.realism.comparison import FeatureComparison, RealismReport, RealismRow
from interplan_sumo.realism.distances import Sample
from interplan_sumo.realism.features import FEATURES, TrafficFeature
from interplan_sumo.realism.formats import COLUMNS, ROW_COLUMNS, feature_cells, report_notes, row_figures, row_title
from interplan_sumo.realism.likelihood import Bins
from interplan_sumo.report.page.html import html, style_of
from interplan_sumo.world.files import writing
from interplan_sumo.world.geometry import Floats

WIDE, HIGH = 300.0, 150.0
"""Of a drawing, in its own units."""
MOST_LINES: Final = 6
"""More would hide one another: runs first, then baselines."""
FINER: Final = 3
"""So many bars of a drawing to a bin of the likelihood."""
MOST_TICKS: Final = 6


@dataclass(frozen=True, slots=True)
class DistributionLine:
    """A distribution as a path of steps."""

    name: str
    colour: int
    path: str


@dataclass(frozen=True, slots=True)
class DistributionDrawing:
    """One feature: the recordings as an area, simulations as lines, and ticks along the axis."""

    title: str
    recorded: str
    lines: tuple[DistributionLine, ...]
    ticks: tuple[tuple[float, str], ...]
    about: str
    """In words, for who cannot see it."""


def drawn_rows(report: RealismReport) -> list[RealismRow]:
    """The rows that drawings show."""
    rows = [row for row in report.rows if row.kind == "run"]
    return [*rows, *(row for row in report.rows if row.kind == "baseline")][:MOST_LINES]


def write_realism_page(report: RealismReport, path: Path, command: str) -> None:
    """The page; InputError if it cannot be written. Names are text whatever they hold."""
    text = realism_page(report, command)
    with writing(path, "give another file as --html"):
        path.write_text(text, encoding="utf-8")


def realism_page(report: RealismReport, command: str) -> str:
    """The report as HTML."""
    shown = [each for each in FEATURES if len(report.recorded.together[each.key])]
    return html(
        "realism.html.j2",
        style=style_of("page.css", "realism.css"),
        script="",
        drawings=[_drawing(each, report) for each in shown],
        lines=[(number, row_title(row)) for number, row in enumerate(drawn_rows(report))],
        runs=[
            (row.name, row_figures(row), [feature_cells(each, row.features[each.key], report) for each in FEATURES])
            for row in report.rows
            if row.kind == "run"
        ],
        features=tuple(each.short for each in shown),
        columns=COLUMNS,
        row_columns=ROW_COLUMNS,
        rows=[
            (row_title(row), row_figures(row), [_distance_cell(row.features[each.key]) for each in shown])
            for row in report.rows
        ],
        bands=DISTANCE_BANDS,
        places=[
            (name, [samples[each.key].road_users for each in shown]) for name, samples in report.recorded.places.items()
        ],
        notes=report_notes(report),
        command=command,
        wide=WIDE,
        high=HIGH,
    )


DISTANCE_BANDS: Final = {"b4": "below 10", "b3": "to 20", "b2": "to 40", "b1": "to 70", "b0": "above"}
"""Of a KS distance x 100, by the class of its colour in the style of the report: green is near."""


def _distance_cell(found: FeatureComparison) -> tuple[str, str, str]:
    """What is shown of a distance, the class of its colour, and of how many road users it is."""
    if found.ks is None:
        return "-", "none", "nothing to compare"
    distance = round(100.0 * found.ks)  # what is shown alike has one colour
    band = next((name for name, most in zip(DISTANCE_BANDS, (9, 20, 40, 70), strict=False) if distance <= most), "b0")
    counts = f"n = {found.simulated.road_users} simulated, {found.recorded.road_users} recorded"
    return str(distance), band, counts


def _drawing(feature: TrafficFeature, report: RealismReport) -> DistributionDrawing:
    bins = Bins(feature.bins.low, feature.bins.high, feature.bins.count * FINER)
    recorded = report.recorded.together[feature.key]
    rows = drawn_rows(report)
    shares = [_shares(row.features[feature.key].simulated, bins) for row in rows]
    of_recorded = _shares(recorded, bins)
    # A simulation in which all do the same would press everything else flat.
    top = min(max(float(each.max(initial=0.0)) for each in (of_recorded, *shares)), 2.5 * float(of_recorded.max()))
    said = ", ".join(
        f"{row.name} {row.features[feature.key].simulated.quantile(0.5):.2f}"
        for row in rows
        if len(row.features[feature.key].simulated)
    )
    return DistributionDrawing(
        title=f"{feature.title} ({feature.unit})",
        recorded=f"M0 {HIGH:g}{_steps(of_recorded, top)}V{HIGH:g}Z",
        lines=tuple(
            DistributionLine(row.name, number, f"M0 {HIGH:g}{_steps(each, top)}V{HIGH:g}")
            for number, (row, each) in enumerate(zip(rows, shares, strict=True))
            if each.any()
        ),
        ticks=tuple(
            (round(WIDE * (value - bins.low) / (bins.high - bins.low), 1), f"{value:g}")
            for value in _round_numbers(bins.low, bins.high)
        ),
        about=f"medians: recorded {recorded.quantile(0.5):.2f}, {said or 'nothing simulated'}",
    )


def _round_numbers(low: float, high: float) -> list[float]:
    """The multiples of the smallest round step between two numbers, at most MOST_TICKS of them."""
    steps = [round_one * 10.0**power for power in range(-3, 4) for round_one in (1.0, 2.0, 5.0)]
    step = next(each for each in steps if (high - low) / each < MOST_TICKS)
    return [step * number for number in range(ceil(low / step - 1e-9), floor(high / step + 1e-9) + 1)]


def _shares(sample: Sample, bins: Bins) -> Floats:
    """The share of the road users in each bin; all 0 of an empty sample."""
    counts = np.bincount(bins.of(sample.values), weights=sample.weights, minlength=bins.count)
    return counts / max(counts.sum(), 1e-12)


def _steps(shares: Floats, top: float) -> str:
    """The upper edge of a histogram from left to right, in SVG's words."""
    heights = HIGH * (1.0 - np.minimum(shares / top, 1.0))
    ends = WIDE * np.arange(1, len(shares) + 1) / len(shares)
    return "".join(f"V{height:.1f}H{end:.1f}" for height, end in zip(heights, ends, strict=True))
