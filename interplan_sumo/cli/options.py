"""What several commands share: exit codes, looks, arguments and their completion."""

from __future__ import annotations

from typing import Annotated, Any

import typer

DONE, OUR_FAULT, BAD_INPUT, INCOMPLETE = 0, 1, 2, 3

LOOKS: dict[str, Any] = {"no_args_is_help": True, "add_completion": True, "pretty_exceptions_enable": False}


def planner_names(incomplete: str) -> list[str]:
    from interplan_sumo.planner import PLANNERS

    return [name for name in PLANNERS if name.startswith(incomplete)]


def scenario_ids(incomplete: str) -> list[str]:
    from interplan_sumo.scenario.suite import ids_of, suites

    return sorted({id for key in suites() for id in ids_of(key) if id.startswith(incomplete)})


PlannerOption = Annotated[
    list[str] | None,
    typer.Option(
        "--planner",
        help="A registered name, module:Class, or name?option=value&... Default: the recommended one.",
        autocompletion=planner_names,
    ),
]
MapArgument = Annotated[str, typer.Argument(help="A folder with a map.gpkg, or a shipped map's name.", metavar="DIR")]
PlanLimitOption = Annotated[float, typer.Option(help="Seconds that one plan() call may take; 0 for no limit.")]
JobLimitOption = Annotated[float, typer.Option(help="Seconds that one drive may take; 0 for no limit.")]
MemoryOption = Annotated[float, typer.Option(help="Memory that a worker may allocate (Linux); 0 for no limit.")]
QuietOption = Annotated[bool, typer.Option("--quiet", help="No progress.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")]
