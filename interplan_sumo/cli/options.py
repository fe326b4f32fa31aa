"""What several commands share: exit codes, looks, and options with their completion."""

from __future__ import annotations

import inspect
import os
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from interplan_sumo.batch.options import SETTINGS, RunOptions, settings_of
from interplan_sumo.batch.processes import SINGLE_THREAD
from interplan_sumo.cli import completion

DONE, OUR_FAULT, BAD_INPUT, INCOMPLETE = 0, 1, 2, 3

LOOKS: dict[str, Any] = {"no_args_is_help": True, "add_completion": True, "pretty_exceptions_enable": False}


def naming(option: str, names: Callable[[], Iterable[str]]) -> type[TyperCommand]:
    """A command whose help says what an option takes; the names are looked up when the help is shown."""

    class Naming(TyperCommand):
        def format_help(self, ctx: Any, formatter: Any) -> None:
            for parameter in self.params:
                if parameter.name == option:
                    said: str = getattr(parameter, "help", None) or ""
                    known = f"{', '.join(names())}."
                    if not said.startswith(known):  # help may be asked for again
                        setattr(parameter, "help", f"{known} {said}".strip())  # noqa: B010 (typed as a base)
            super().format_help(ctx, formatter)

    return Naming


def takes_run_options(*names: str, **help: str) -> Callable[[Callable[..., int]], Callable[..., int]]:
    """Give a command these options of a run (all, without names) in place of its parameter `options`.

    `help` replaces what is said of an option, by its name.
    """
    chosen = [each for each in fields(RunOptions) if not names or each.name in names]
    settings = [each.name for each in chosen if each.name in SETTINGS]

    def decorate(command: Callable[..., int]) -> Callable[..., int]:
        def decorated(**given: Any) -> int:
            said = {each.name: given.pop(each.name) for each in chosen if each.name not in settings}
            said |= settings_of(given.pop("set_", None) or ()) if settings else {}
            return command(options=RunOptions(**{k: v for k, v in said.items() if v is not None}), **given)

        asked: list[inspect.Parameter] = []
        for each in inspect.signature(command, eval_str=True).parameters.values():
            asked += _parameters(chosen, help) if each.name == "options" else [each.replace(kind=each.KEYWORD_ONLY)]
        decorated.__name__, decorated.__doc__ = command.__name__, command.__doc__
        decorated.__signature__ = inspect.Signature(asked)  # type: ignore[attr-defined]
        decorated.__annotations__ = {each.name: each.annotation for each in asked}
        return decorated

    return decorate


def take_one_thread() -> None:
    """Before libraries are imported: sums keep one order, and the workers are the parallelism."""
    os.environ.update({name: os.environ.get(name, value) for name, value in SINGLE_THREAD.items()})


def say_what_cannot_act(vehicle_types: Path | None) -> None:
    """The warnings of a vehicle-type file, on stderr; InputError if it cannot be used."""
    if vehicle_types is not None:
        from interplan_sumo.simulation.vehicle_types import read_vehicle_types

        for line in read_vehicle_types(vehicle_types).warnings:
            print(f"warning: {line}", file=sys.stderr)


def say_reservations(options: RunOptions) -> None:
    """Warnings about scenarios that nobody may be able to solve, on stderr; InputError if they cannot be used."""
    from interplan_sumo.batch.custom_references import reservations
    from interplan_sumo.batch.jobs import Selection

    selection = Selection.of(options)
    for line in () if selection.source.official else reservations(selection.scenarios, selection.files):
        print(f"warning: {line}", file=sys.stderr)


def run_folder(context: typer.Context, options: RunOptions, prefix: str) -> tuple[Path, list[str]]:
    """The folder of a run, a new one where none is given, and the command that goes on in it."""
    folder = options.out or Path("runs") / f"{prefix}{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}"
    return folder, ["interplan-sumo", *context.obj, *([] if options.out else ["--out", str(folder)])]


KINDS: dict[str, Any] = {
    "tuple[str, ...]": list[str] | None,
    "int | str | None": str | None,
    "Path | None": Path | None,
    "str | None": str | None,
    "int | None": int | None,
    "int": int,
    "float": float,
    "bool": bool,
}
"""What typer reads for a field of a type."""


def _parameters(chosen: list[Any], help: dict[str, str]) -> list[inspect.Parameter]:
    found: dict[str, inspect.Parameter] = {}
    settings: list[str] = []
    for each in chosen:
        about = each.metadata
        said = help.get(each.name, about["help"])
        if about.get("setting"):
            settings.append(f"{each.name}={said}")
            option = typer.Option(
                "--set", help=f"{' or '.join(settings)}.", metavar="KEY=VALUE", autocompletion=completion.settings
            )
            found["set_"] = _parameter("set_", Annotated[list[str] | None, option], None)
            continue
        flag = about.get("flag", f"--{each.name.replace('_', '-')}")
        completes = getattr(completion, about["completes"]) if "completes" in about else None
        option = typer.Option(flag, help=said, metavar=about.get("metavar"), autocompletion=completes)
        found[each.name] = _parameter(each.name, Annotated[KINDS[str(each.type)], option], each.default or None)
    return list(found.values())


def _parameter(name: str, annotation: Any, default: Any) -> inspect.Parameter:
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


MapArgument = Annotated[
    str,
    typer.Argument(
        help="A folder with a map.gpkg, or a shipped map's name.", metavar="DIR", autocompletion=completion.map_names
    ),
]
WorkersOption = Annotated[int | None, typer.Option(help="Processes; 0 works in this one. Default: all cores.")]
QuietOption = Annotated[bool, typer.Option("--quiet", help="No progress.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")]
