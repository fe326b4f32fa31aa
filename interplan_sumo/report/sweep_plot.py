"""Sweep plot: lines with intervals over one parameter; a heat map and lines for two."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from interplan_sumo.batch.sweep import Parameter, as_number
from interplan_sumo.report.sweep_lines import MEASURES, Mean, Measure, SweepLine
from interplan_sumo.world.files import writing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure

MOST_PARAMETERS: Final = 2
"""More than these make no picture."""
PANEL: Final = (340, 300)
"""Pixels of one measure."""
DPI: Final = 100
SCALE: Final = (0.0, 100.0)
"""Of every axis and every colour, so that panels and sweeps can be held side by side: what changes nothing looks so."""
GRADES: Final = ((0.0, "#b3261e"), (0.3, "#ec8f6a"), (0.6, "#f5cf7b"), (0.85, "#b5d99c"), (1.0, "#2f8f5b"))
"""Colours from bad to good, those of the report's bands, by the share of SCALE at which they stand."""
COLOURS: Final = ("#1f5fa8", "#d1672c", "#2a9d6f", "#8e44ad", "#b01e28", "#777777", "#0aa3c2", "#c9a227")
DASHES: Final = ("-", "--", ":", "-.")
"""One per planner."""
INK: Final = "#3a3f47"


def why_no_plot(parameters: Sequence[Parameter], lines: Sequence[SweepLine]) -> str | None:
    """Why there is nothing to draw, or nothing to draw it with; None if there is."""
    if importlib.util.find_spec("matplotlib") is None:
        return "no plot: it needs matplotlib; run: pip install 'interplan-sumo[plots]'"
    if len(parameters) > MOST_PARAMETERS:
        return f"no plot: {len(parameters)} parameters are varied, {MOST_PARAMETERS} fit into a picture"
    if not any(mean for line in lines for mean in line.means.values()):
        return "no plot: no combination is complete"
    return None


def plot_sweep(parameters: Sequence[Parameter], lines: Sequence[SweepLine], path: Path) -> None:
    """Draw the main measures of a sweep of one or two parameters into a PNG file; equal sweeps give equal files.

    All panels have the same scale, 0 to 100, and say of how many scenarios and drives each mean is; bars are intervals.

    Two parameters: per measure a heat map for each planner, and below it a line
    for each value of the one that is drawn in colours. InputError if the file
    cannot be written.
    """
    from matplotlib.figure import Figure

    measures = drawn_measures(lines)
    planners = list(dict.fromkeys(line.planner for line in lines))
    along, colours = _roles(parameters)
    maps = planners if colours is not None else []
    rows, columns = len(maps) + 1, len(measures)
    figure = Figure(figsize=(columns * PANEL[0] / DPI, rows * PANEL[1] / DPI), dpi=DPI, layout="constrained")
    grid: Any = figure.subplots(rows, columns, squeeze=False)
    for column, measure in enumerate(measures):
        for row, planner in enumerate(maps):
            assert colours is not None
            of_planner = [line for line in lines if line.planner == planner]
            _heat_map(grid[row, column], measure, along, colours, of_planner)
            if len(maps) > 1:
                grid[row, column].set_title(f"{_counted(measure, of_planner)}\n{planner}", fontsize=9, color=INK)
        _curves(grid[rows - 1, column], measure, along, colours, lines, planners)
        if not maps:
            grid[0, column].set_title(_counted(measure, lines), fontsize=9, color=INK)
    _legend(figure, grid[rows - 1, 0])
    figure.set_facecolor("#ffffff")
    with writing(path):
        figure.savefig(path, metadata={"Software": None})


def drawn_measures(lines: Sequence[SweepLine]) -> list[Measure]:
    """The measures with a panel: of the two goals the one that is harder to reach, where it is judged."""
    there = {measure.key: measure for measure in MEASURES if any(line.means[measure.key] for line in lines)}
    goal = "goal_lane" if "goal_lane" in there else "goal_reached"
    return [there[key] for key in ("score", goal, "at_fault_collisions", "hard_braking_behind") if key in there]


def along_axis(parameters: Sequence[Parameter]) -> Parameter:
    """What runs along the axis: numbers rather lie there than words."""
    return [*(each for each in parameters if not _numeric(each)), *filter(_numeric, parameters)][-1]


def _roles(parameters: Sequence[Parameter]) -> tuple[Parameter, Parameter | None]:
    """What runs along the axis, and what has a colour per value."""
    along = along_axis(parameters)
    return along, next((each for each in parameters if each is not along), None)


def _numeric(parameter: Parameter) -> bool:
    return all(as_number(value) is not None for value in parameter.values)


def ordered_values(parameter: Parameter) -> list[str]:
    """Numbers by size, words as given."""
    return sorted(parameter.values, key=lambda v: as_number(v) or 0.0) if _numeric(parameter) else [*parameter.values]


def _mean(lines: Sequence[SweepLine], measure: Measure, setting: Mapping[str, str]) -> Mean | None:
    """The mean of the line that has these values; None if it has none."""
    return next((line.means[measure.key] for line in lines if setting.items() <= line.setting.items()), None)


def _heat_map(axes: Axes, measure: Measure, along: Parameter, down: Parameter, lines: Sequence[SweepLine]) -> None:
    across, rows = ordered_values(along), ordered_values(down)
    means = [[_mean(lines, measure, {along.key: x, down.key: y}) for x in across] for y in rows]
    values = np.array([[np.nan if mean is None else mean.value for mean in row] for row in means])
    low, high = SCALE
    graded = _graded(measure)
    axes.imshow(np.ma.masked_invalid(values), aspect="auto", origin="lower", cmap=graded, vmin=low, vmax=high)
    for row, column in np.ndindex(*values.shape):
        red, green, blue, _ = graded((values[row, column] - low) / (high - low))
        colour = "#000000" if 0.3 * red + 0.6 * green + 0.1 * blue > 0.5 else "#ffffff"
        axes.text(column, row, _cell(means[row][column]), ha="center", va="center", fontsize=8, color=colour)
    axes.set_xticks(range(len(across)), across)
    axes.set_yticks(range(len(rows)), rows)
    _name_axes(axes, along.key, down.key)
    axes.set_title(_counted(measure, lines), fontsize=9, color=INK)


def _cell(mean: Mean | None) -> str:
    if mean is None:
        return "-"
    return f"{mean.value:.3g}" + ("" if mean.interval is None else "\n[{:.0f}, {:.0f}]".format(*mean.interval))


def _counted(measure: Measure, lines: Sequence[SweepLine]) -> str:
    """What is drawn, and of how many scenarios and drives each mean is."""
    means = [mean for line in lines if (mean := line.means[measure.key]) is not None]
    counts = ("scenario", [mean.scenarios for mean in means]), ("drive", [mean.drives for mean in means])
    said = [f"{_span(numbers)} {what}{'s' * (max(numbers) != 1)}" for what, numbers in counts if numbers]
    return f"{measure.label}\nn = {', '.join(said)}"


def _span(numbers: Sequence[int]) -> str:
    low, high = min(numbers), max(numbers)
    return str(low) if low == high else f"{low} to {high}"


def _graded(measure: Measure) -> Colormap:
    """From bad to good along SCALE, whichever end is the good one."""
    from matplotlib.colors import LinearSegmentedColormap

    grades = LinearSegmentedColormap.from_list("grades", [*GRADES])
    return grades.reversed() if measure.lower_is_better else grades


def _curves(
    axes: Axes,
    measure: Measure,
    along: Parameter,
    colours: Parameter | None,
    lines: Sequence[SweepLine],
    planners: Sequence[str],
) -> None:
    """A line per planner, or per planner and value, with the interval of each mean as a bar."""
    ticks = ordered_values(along)
    numeric = _numeric(along)
    places = np.array([as_number(tick) if numeric else at for at, tick in enumerate(ticks)], dtype=np.float64)
    fixed: list[dict[str, str]] = (
        [{}] if colours is None else [{colours.key: value} for value in ordered_values(colours)]
    )
    curves = [(planner, setting) for planner in planners for setting in fixed]
    apart = (np.ptp(places) or 1.0) * 0.015  # so that the bars of several lines do not hide each other
    for number, (planner, setting) in enumerate(curves):
        of_planner = [line for line in lines if line.planner == planner]
        means = [_mean(of_planner, measure, {along.key: tick, **setting}) for tick in ticks]
        found = [(place, mean) for place, mean in zip(places, means, strict=True) if mean is not None]
        if not found:
            continue
        x = np.array([place for place, _ in found]) + (number - (len(curves) - 1) / 2) * apart
        y = np.array([mean.value for _, mean in found])
        bounds = [mean.interval or (mean.value, mean.value) for _, mean in found]
        which = planners.index(planner)
        axes.errorbar(
            x,
            y,
            yerr=np.abs(np.array(bounds).T - y),
            color=COLOURS[(fixed.index(setting) if setting else which) % len(COLOURS)],
            ls=DASHES[which % len(DASHES)],
            label=_label(planner if len(planners) > 1 else "", setting) or planner,
            marker="o", ms=4, lw=1.4, capsize=3, clip_on=False, zorder=3,
        )  # fmt: skip
    axes.set_xticks(places, ticks)
    _name_axes(axes, along.key, measure.title)
    axes.set_ylim(*SCALE)
    axes.grid(visible=True, color="#dddddd", lw=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _name_axes(axes: Axes, across: str, up: str) -> None:
    axes.set_xlabel(across, fontsize=9, color=INK)
    axes.set_ylabel(up, fontsize=9, color=INK)
    axes.tick_params(labelsize=8, labelcolor=INK)


def _label(planner: str, setting: Mapping[str, str]) -> str:
    return ", ".join(filter(None, (planner, *(f"{key} {value}" for key, value in setting.items()))))


def _legend(figure: Figure, axes: Axes) -> None:
    """One for all panels, below them."""
    handles, labels = axes.get_legend_handles_labels()
    if labels:
        figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 6), fontsize=9, frameon=False)
