"""Command `rates`: how often planners failed on the kilometres of one or several folders of `endure`."""

from __future__ import annotations

import shlex
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from interplan_sumo.cli.completion import endure_folders, measure_names
from interplan_sumo.cli.options import DONE, JsonOption, take_one_thread
from interplan_sumo.errors import InputError, UnknownNameError

if TYPE_CHECKING:
    from interplan_sumo.endurance.records import RareKind
    from interplan_sumo.endurance.report import EnduranceReport


def rates(
    context: typer.Context,
    folders: Annotated[
        list[Path], typer.Argument(help="Folders of endure.", metavar="DIR", autocompletion=endure_folders)
    ],
    of: Annotated[
        str,
        typer.Option(
            help="What strata, pictures and plans are of; such as near_miss, red_light.",
            metavar="MEASURE",
            autocompletion=measure_names,
        ),
    ] = "at_fault_collision",
    rare: Annotated[
        list[str] | None,
        typer.Option(help="Weigh a rare event by another probability; such as jaywalker=0.001.", metavar="KIND=P"),
    ] = None,
    to: Annotated[float, typer.Option(help="Half-width that is wanted, over the rate.", metavar="SHARE")] = 0.3,
    html: Annotated[Path | None, typer.Option(help="Write one self-contained page.", metavar="FILE")] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw rates over density and drivers.", metavar="FILE.png")] = None,
    as_json: JsonOption = False,
) -> int:
    """Failures per 1000 km and per hour of several planners and cells: strata, places, intervals, regression.

    Rare events can be weighed by other probabilities than those that were driven with.
    """
    take_one_thread()
    from interplan_sumo.endurance.gathered import read_kilometres
    from interplan_sumo.endurance.page import write_endurance_report
    from interplan_sumo.endurance.rate_sample import measure_named
    from interplan_sumo.endurance.report import endurance_report
    from interplan_sumo.extras import need_matplotlib

    measure, probabilities = measure_named(of), _probabilities(rare or ())
    if plot is not None:
        need_matplotlib()
    report = endurance_report(read_kilometres(folders), probabilities, measure, to)
    write_endurance_report(report, page=html, plot=plot, command=shlex.join(["interplan-sumo", *context.obj]))
    _print(report, as_json=as_json)
    return DONE


def _print(report: EnduranceReport, *, as_json: bool) -> None:
    """On stdout."""
    from interplan_sumo.endurance.formats import endurance_json, endurance_text
    from interplan_sumo.report.printing import console, print_json

    if as_json:
        print_json(endurance_json(report))
        return
    place = console()
    for part in endurance_text(report):
        place.print(part)


def _probabilities(texts: Iterable[str]) -> dict[RareKind, float]:
    """From `KIND=P`; InputError for what is none."""
    from interplan_sumo.endurance.records import RARE_KINDS

    found: dict[RareKind, float] = {}
    for text in texts:
        name, _, value = text.partition("=")
        if name not in RARE_KINDS:
            raise UnknownNameError("rare event", name, RARE_KINDS)
        try:
            probability = float(value)
        except ValueError:
            raise InputError(f"--rare {text!r} has no probability; give KIND=P, such as {name}=0.001") from None
        found |= {kind: probability for kind in RARE_KINDS if kind == name}
    return found
