"""Command `atlas`: where in the parameters of its scenes a planner fails."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from interplan_sumo.cli.completion import planner_names, run_folders
from interplan_sumo.cli.options import DONE, JsonOption
from interplan_sumo.report.printing import print_json

if TYPE_CHECKING:
    from interplan_sumo.report.atlas import Atlas


def atlas(
    context: typer.Context,
    folder: Annotated[
        Path,
        typer.Argument(help="A run folder, or one of scenarios harden.", metavar="RUN", autocompletion=run_folders),
    ],
    parameters: Annotated[
        Path | None,
        typer.Option(help="For a run: the folder of scenarios harden, or its parameters.csv.", metavar="DIR|FILE.csv"),
    ] = None,
    planner: Annotated[
        str | None, typer.Option(help="As the folder names it. Default: its first.", autocompletion=planner_names)
    ] = None,
    family: Annotated[str | None, typer.Option(help="Default: that of most scenes.")] = None,
    over: Annotated[
        str | None, typer.Option(help="Two parameters to show. Default: those that tell most.", metavar="A,B")
    ] = None,
    html: Annotated[Path | None, typer.Option(help="Write one self-contained page.", metavar="FILE")] = None,
    png: Annotated[Path | None, typer.Option(help="Draw the map.", metavar="FILE")] = None,
    replays: Annotated[
        bool, typer.Option("--replays", help="For a run: replays of the near misses beside the page.")
    ] = False,
    as_json: JsonOption = False,
) -> int:
    """Where a planner fails: the two parameters of its scenes that tell most, and failed scenes beside solved ones.

    Of a run of scenes that scenarios harden made, or of all that such a search tried.
    """
    from interplan_sumo.errors import InputError
    from interplan_sumo.report.atlas import read_atlas

    names = [name.strip() for name in over.split(",")] if over is not None else []
    found = read_atlas(folder, parameters, planner, family, names)
    if replays and (html is None or found.run is None):
        raise InputError("--replays puts them beside the page of a run; give a run folder and --html FILE")
    if html is not None:
        from interplan_sumo.report.atlas_page import write_atlas_page
        from interplan_sumo.report.atlas_replays import write_near_replays

        if replays:
            write_near_replays(found, html)
        write_atlas_page(found, html, shlex.join(["interplan-sumo", *context.obj]))
        print(f"wrote {html}", file=sys.stderr)
    if png is not None:
        from interplan_sumo.report.atlas_plot import plot_atlas

        plot_atlas(found, png)
        print(f"wrote {png}", file=sys.stderr)
    _print(found, as_json=as_json)
    return DONE


def _print(found: Atlas, *, as_json: bool) -> None:
    from interplan_sumo.report.atlas_page import summary

    if as_json:
        print_json(_json(found))
        return
    for line in summary(found):
        print(line)
    for told in found.alone[:4]:
        print(f"{100.0 * told.share:+5.0f} %  {told.names[0]} alone")
    for pair in found.near:
        changed = ", ".join(f"{name} {one} / {other}" for name, one, other in pair.differences)
        print(f"{pair.apart:.2f} apart: {pair.failed.id} fails, {pair.solved.id} is solved: {changed}")


def _json(found: Atlas) -> dict[str, Any]:
    return {
        "planner": found.planner,
        "family": found.family,
        "scenarios": len(found.scenes),
        "solved": found.solved,
        "shown": [axis.name for axis in found.shown],
        "told": None if found.told is None else found.told.share,
        "by_chance": found.by_chance,
        "alone": {told.names[0]: told.share for told in found.alone},
        "near": [
            {
                "failed": pair.failed.id,
                "solved": pair.solved.id,
                "apart": pair.apart,
                "differences": {name: [one, other] for name, one, other in pair.differences},
            }
            for pair in found.near
        ],
    }
