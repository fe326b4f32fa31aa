"""The distributions of a realism report as a figure for a paper: cumulative shares, one panel per feature."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from interplan_sumo.errors import InputError
from interplan_sumo.realism.comparison import FEWEST, RealismReport
from interplan_sumo.realism.distances import Sample
from interplan_sumo.realism.page import drawn_rows
from interplan_sumo.report.sweep_plot import COLOURS, INK
from interplan_sumo.world.files import writing

PANEL: Final = (2.6, 2.1)
"""Inches."""
ACROSS: Final = 4


def plot_realism(report: RealismReport, path: Path) -> None:
    """Draw the features that are scored into a file (.png, .pdf, .svg); InputError if it cannot be written."""
    from matplotlib.figure import Figure

    shown = report.recorded.scored
    if not shown:
        raise InputError(f"nothing to draw: no feature has {FEWEST} recorded road users; name more recordings")
    down = -(-len(shown) // ACROSS)
    figure = Figure(figsize=(ACROSS * PANEL[0], down * PANEL[1] + 0.3), layout="constrained")
    grid: Any = figure.subplots(down, ACROSS, squeeze=False)
    for axes in grid.flat[len(shown) :]:
        axes.set_axis_off()
    for axes, feature in zip(grid.flat, shown, strict=False):
        for samples in report.recorded.places.values():
            if samples[feature.key].road_users > 1:
                _curve(axes, samples[feature.key], color="0.8", lw=0.8)
        _curve(axes, report.recorded.together[feature.key], color="0.25", lw=2.0, label="recorded")
        for number, row in enumerate(drawn_rows(report)):
            if len(row.features[feature.key].simulated):
                colour = COLOURS[number % len(COLOURS)]
                _curve(axes, row.features[feature.key].simulated, color=colour, lw=1.3, label=row.name)
        axes.set(xlim=(feature.bins.low, feature.bins.high), ylim=(0.0, 1.0))
        axes.set_xlabel(f"{feature.title} ({feature.unit})", fontsize=8, color=INK)
        axes.tick_params(labelsize=7, labelcolor=INK)
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
    named: dict[str, Any] = {}
    for axes in grid.flat:
        handles, labels = axes.get_legend_handles_labels()
        named |= dict(zip(labels, handles, strict=True))
    figure.legend(named.values(), named.keys(), loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    try:
        with writing(path, "give another file as --plot"):
            figure.savefig(path, dpi=130)
    except ValueError as error:
        raise InputError(f"cannot write {path}: {error}") from None


def _curve(axes: Any, sample: Sample, **looks: Any) -> None:
    """The share of road users at or below a value."""
    axes.step(*sample.cumulative, where="post", **looks)
