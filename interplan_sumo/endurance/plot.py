"""The endurance report as a figure for a paper: rates over density and drivers, and how well they became known."""

from __future__ import annotations

from math import ceil, floor, log10
from pathlib import Path
from typing import Any, Final

from interplan_sumo.endurance.drawings import RateAxis
from interplan_sumo.endurance.rate_sample import MEASURES
from interplan_sumo.endurance.rates import DrivenRates
from interplan_sumo.endurance.report import EnduranceReport
from interplan_sumo.errors import InputError
from interplan_sumo.extras import need_matplotlib
from interplan_sumo.report.sweep_plot import COLOURS, INK
from interplan_sumo.world.files import writing

PANEL: Final = (3.1, 2.7)
"""Inches."""
ACROSS: Final = 4
MARKERS: Final = ("o", "s", "^")
LINES: Final = ("-", "--", ":")
"""Of the first planners as many as there are colours, of the next, and of those after them."""


def plot_endurance(report: EnduranceReport, path: Path) -> None:
    """Draw it into a file (.png, .pdf, .svg); InputError if it cannot be written, or there is nothing to draw."""
    need_matplotlib()
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, NullLocator

    cells = [each for each in report.rates.cells if each.cell is not None and each.measures]
    if not cells:
        raise InputError("nothing to draw: no cell has rates")
    panels = list(dict.fromkeys((each.cell.map, each.cell.drivers) for each in cells if each.cell))
    count = len(panels) + 1
    across = min(count, ACROSS)
    down = -(-count // across)
    figure = Figure(figsize=(across * PANEL[0], down * PANEL[1] + 0.3), layout="constrained")
    grid: Any = figure.subplots(down, across, squeeze=False)
    looks = {each.planner: planner_look(number) for number, each in enumerate(report.rates.planners)}
    axis = RateAxis.of(cells, report)
    for axes, (map_name, drivers) in zip(grid.flat, panels, strict=False):
        own = [each for each in cells if each.cell and (each.cell.map, each.cell.drivers) == (map_name, drivers)]
        _rates(axes, own, report, looks)
        axes.set_title(f"{drivers}, {map_name}", fontsize=9, color=INK)
        axes.set_yscale("asinh", linear_width=axis.least)
        axes.yaxis.set_major_formatter(FuncFormatter(lambda rate, _: f"{rate:,.0f}"))
        axes.set_yticks(axis.marked)
        axes.yaxis.set_minor_locator(NullLocator())
        axes.set_ylim(-0.05 * axis.least, axis.top)
    _widths(grid.flat[len(panels)], report, looks)
    for axes in grid.flat[count:]:
        axes.set_axis_off()
    for axes in grid.flat[:count]:
        axes.tick_params(labelsize=8, labelcolor=INK)
        axes.grid(visible=True, color="#dddddd", lw=0.6)
        axes.set_axisbelow(True)
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
    handles: Any = grid.flat[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=min(len(looks), 6), fontsize=9, frameon=False)
    try:
        with writing(path, "give another file as --plot"):
            figure.savefig(path, dpi=130)
    except ValueError as error:
        raise InputError(f"cannot write {path}: {error}") from None


def planner_look(number: int) -> dict[str, Any]:
    """Colour, marker and line of the n-th planner; no two of the first 24 are alike."""
    turn = number // len(COLOURS) % len(MARKERS)
    return {"color": COLOURS[number % len(COLOURS)], "marker": MARKERS[turn], "linestyle": LINES[turn]}


def _rates(axes: Any, cells: list[DrivenRates], report: EnduranceReport, looks: dict[str, dict[str, Any]]) -> None:
    """Rates with intervals, hollow without, and the regression's line."""
    densities = sorted({each.cell.density for each in report.rates.cells if each.cell})
    for number, (planner, look) in enumerate(looks.items()):
        own = sorted(
            ((each.cell.density, each) for each in cells if each.cell and each.planner == planner),
            key=lambda pair: pair[0],
        )
        aside = (number - (len(looks) - 1) / 2.0) * min(0.12, 0.5 / len(looks))
        axes.plot([], [], **look, ms=4, lw=1.4, label=planner)
        line: list[tuple[float, float, float, float]] = []
        for density, each in own:
            x = densities.index(density) + aside
            rate = each.measures[report.measure].total
            low, high = rate.interval or (rate.per_1000_km, rate.per_1000_km)
            axes.errorbar(
                x, rate.per_1000_km, [[rate.per_1000_km - low], [high - rate.per_1000_km]], **look,
                ms=4, lw=1.4, capsize=3, mfc="white" if rate.interval is None else look["color"], zorder=3,
            )  # fmt: skip
            fitted = None if each.cell is None else report.regression.fitted.get((planner, each.cell))
            if fitted is not None:
                line.append((x, fitted[0], *fitted[1]))
        if len(line) > 1:
            x, y, low, high = zip(*line, strict=True)
            axes.plot(x, y, color=look["color"], linestyle=look["linestyle"], lw=1.0, alpha=0.5)
            axes.fill_between(x, low, high, color=look["color"], alpha=min(0.12, 0.6 / len(looks)), lw=0.0)
    axes.set_xticks(range(len(densities)), [f"{each:g}" for each in densities])
    axes.set_xlim(-0.5, len(densities) - 0.5)
    axes.set_xlabel("density, of saturation", fontsize=9, color=INK)
    axes.set_ylabel(f"{MEASURES[report.measure]}\nper 1000 km", fontsize=9, color=INK)


def _decades(report: EnduranceReport) -> tuple[float, float]:
    """The powers of ten around the kilometres of all widths."""
    every = [each.km for points in report.widths.values() for each in points] or [10.0, 100.0]
    low, high = floor(log10(min(every))), ceil(log10(max(every)))
    return 10.0**low, 10.0 ** max(high, low + 1)


def _widths(axes: Any, report: EnduranceReport, looks: dict[str, dict[str, Any]]) -> None:
    """Kilometres against half-widths."""
    from matplotlib.ticker import FuncFormatter, NullFormatter, NullLocator

    for planner, points in report.widths.items():
        if points:
            axes.plot(
                [each.km for each in points], [100.0 * each.half_width for each in points], **looks[planner],
                ms=3, lw=1.4,
            )  # fmt: skip
    axes.set(xscale="log", yscale="log", ylim=(5.0, 100.0))
    axes.set_xlim(*_decades(report))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda km, _: f"{km:,.0f}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_yticks([5, 10, 20, 30, 50, 100], ["5", "10", "20", "30", "50", "100"])
    axes.set_xlabel("kilometres driven", fontsize=9, color=INK)
    axes.set_ylabel("half-width, % of the rate", fontsize=9, color=INK)
