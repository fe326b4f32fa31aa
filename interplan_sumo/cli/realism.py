"""Command `traffic realism`: how real simulated traffic is beside recordings."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from interplan_sumo.cli.options import DONE, JsonOption, QuietOption, take_one_thread
from interplan_sumo.errors import InputError


class TakingSeveral(TyperCommand):
    """A command whose option --against takes all that follows it up to the next option, as a shell's glob gives it."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        spread: list[str] = []
        inside = False
        for word in args:
            if word.startswith("-"):
                inside = word == "--against"
            elif inside and spread[-1] != "--against":
                spread.append("--against")
            spread.append(word)
        return super().parse_args(ctx, spread)


def realism(
    context: typer.Context,
    runs: Annotated[
        list[Path],
        typer.Argument(
            help="Run folders, traces, fcd output of SUMO (.xml, .xml.gz), or vehicle-type files (or names of shipped "
            "ones), whose drivers are simulated on shipped city networks.",
            metavar="RUN",
        ),
    ],
    against: Annotated[
        list[Path],
        typer.Option(
            help="Recordings, or folders of them: any format that scenarios import knows, or plain tracks.",
            metavar="RECORDING",
        ),
    ],
    types: Annotated[
        Path | None, typer.Option(help="Vehicle types of fcd output, for their sizes.", metavar="FILE.xml")
    ] = None,
    baselines: Annotated[
        bool,
        typer.Option("--baselines", help="Also simulate each shipped file and each car-following model; minutes."),
    ] = False,
    html: Annotated[Path | None, typer.Option(help="Write one self-contained page.", metavar="FILE")] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the distributions.", metavar="FILE.png")] = None,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> int:
    """How real simulated traffic is: distributions beside recorded ones, distances, and one realism number."""
    take_one_thread()
    from interplan_sumo.realism.baselines import (
        Baseline,
        is_vehicle_types,
        shipped_baselines,
        shipped_files,
        simulated_baselines,
    )
    from interplan_sumo.realism.comparison import realism_report
    from interplan_sumo.realism.features import feature_samples
    from interplan_sumo.realism.formats import realism_json, realism_tables
    from interplan_sumo.realism.sources import named_sources
    from interplan_sumo.realism.tracker_noise import TrackerNoise
    from interplan_sumo.realism.tracks import open_recordings
    from interplan_sumo.realism.views import views_of
    from interplan_sumo.report.printing import console, print_json

    if plot is not None:
        from interplan_sumo.extras import need_matplotlib

        need_matplotlib()
    files = {path: path if path.exists() else shipped_files().get(str(path), path) for path in runs}
    for path in (*files.values(), *against):
        if not path.exists():
            raise InputError(f"cannot read {path}: there is no such file or folder")
    recordings = open_recordings(against)
    noise = TrackerNoise.of(recordings)

    def say(line: str) -> None:
        if not quiet:
            print(line, file=sys.stderr)

    drivers = [Baseline(str(path), file) for path, file in files.items() if is_vehicle_types(file)]
    sources = named_sources([path for path, file in files.items() if not is_vehicle_types(file)], types)
    simulations = {each.name: feature_samples(each.parts(noise)) for each in sources}
    views = views_of(recordings) if drivers or baselines else ()
    simulations |= simulated_baselines(drivers, views, say)
    beside = {}
    if baselines:
        with shipped_baselines() as shipped:
            beside = simulated_baselines(shipped, views, say)
    report = realism_report(simulations, recordings, beside, noise)
    if html is not None:
        from interplan_sumo.realism.page import write_realism_page

        write_realism_page(report, html, shlex.join(["interplan-sumo", *context.obj]))
    if plot is not None:
        from interplan_sumo.realism.plot import plot_realism

        plot_realism(report, plot)
    if as_json:
        print_json(realism_json(report))
    else:
        place = console()
        for part in realism_tables(report):
            place.print(part)
    return DONE
