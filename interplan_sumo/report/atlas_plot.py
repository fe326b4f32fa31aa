"""Atlas plot: the map of an atlas as a picture for papers and slides."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from interplan_sumo.errors import InputError
from interplan_sumo.extras import need_matplotlib
from interplan_sumo.report.atlas import Atlas
from interplan_sumo.report.atlas_page import GREEN, HIGH, RED, WIDE, atlas_map, axis_ticks
from interplan_sumo.world.files import writing

DPI: Final = 150
SIZE_INCHES: Final = (6.4, 4.6)
FAILS, SOLVES = "#b3261e", "#2f8f5b"
UNTOLD: Final = {".png": "Software", ".pdf": "CreationDate", ".svg": "Date"}
"""What a file does not say of itself, so that equal ones are equal."""


def plot_atlas(atlas: Atlas, path: Path) -> None:
    """Draw marks and shading into a PNG, PDF or SVG file; equal atlases give equal files.

    InputError if the file cannot be written, or is to be of a kind that matplotlib does not know.
    """
    need_matplotlib("the atlas as a picture")
    from matplotlib import rc_context
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    drawn = atlas_map(atlas)
    figure = Figure(figsize=SIZE_INCHES, dpi=DPI, layout="constrained")
    axes = figure.subplots()
    width, height = drawn.cell
    for x, y, share in drawn.shades:
        corner = x / WIDE, 1.0 - (y + height) / HIGH
        for colour, dark in ((FAILS, RED * share), (SOLVES, GREEN * (1.0 - share))):
            axes.add_patch(Rectangle(corner, width / WIDE, height / HIGH, color=colour, alpha=dark, lw=0))
    solved = np.array([mark.solved for mark in drawn.marks], dtype=bool)
    for those, marker, colour, name in ((~solved, "x", FAILS, "failed"), (solved, "o", SOLVES, "solved")):
        x, y = drawn.places[those].T
        axes.scatter(x, y, marker=marker, color=colour, s=30, label=f"{name} ({those.sum()})", zorder=3, clip_on=False)
    across, up = atlas.shown
    axes.set_xticks(*zip(*axis_ticks(across), strict=True))
    axes.set_yticks(*zip(*axis_ticks(up), strict=True))
    axes.set_xlabel(across.name)
    axes.set_ylabel(up.name)
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(0.0, 1.0)
    axes.set_title(f"{atlas.planner}, {atlas.family}: {atlas.solved} of {len(atlas.scenes)} solved", fontsize=10)
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    kind = path.suffix.lower()
    if kind not in UNTOLD:
        raise InputError(f"{path}: pictures end in .png, .svg or .pdf")
    with writing(path, "give another file as --png"), rc_context({"svg.hashsalt": "atlas"}):
        figure.savefig(path, metadata={UNTOLD[kind]: None})
