"""What several commands share: exit codes, looks, arguments and their completion."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

DONE, OUR_FAULT, BAD_INPUT, INCOMPLETE = 0, 1, 2, 3

LOOKS: dict[str, Any] = {"no_args_is_help": True, "add_completion": True, "pretty_exceptions_enable": False}


def naming(option: str, names: Callable[[], Iterable[str]]) -> type[TyperCommand]:
    """A command whose help says what an option takes; the names are looked up when the help is shown."""

    class Naming(TyperCommand):
        def format_help(self, ctx: Any, formatter: Any) -> None:
            for parameter in self.params:
                if parameter.name == option:
                    said: str = getattr(parameter, "help", None) or ""
                    setattr(parameter, "help", f"{', '.join(names())}. {said}".strip())  # noqa: B010 (typed as a base)
            super().format_help(ctx, formatter)

    return Naming


def starting(names: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """The completion of an option that takes one of some names."""
    return lambda incomplete: [name for name in names() if name.startswith(incomplete)]


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
