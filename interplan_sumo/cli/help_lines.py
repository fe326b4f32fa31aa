"""Help lines: what the help of a command says of a value and its default, in as few lines as it takes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

NUMBERS: Final = ("budget", "count", "drivers", "each", "port", "sample", "samples", "seed", "workers")
SECONDS: Final = ("at", "duration", "every", "from_s", "to_s")
SHARES: Final = ("difficulty", "min_score", "naive_share", "plausibility")
VALUES: Final[Mapping[str, str]] = {
    **dict.fromkeys(NUMBERS, "N"),
    **dict.fromkeys(SECONDS, "S"),
    **dict.fromkeys(SHARES, "SHARE"),
    "agents": "WHO",
    "below": "POINTS",
    "date": "DATE",
    "ego": "ID",
    "family": "FAMILY",
    "goal": "M",
    "logs": "DIR",
    "map": "MAP",
    "model": "NAME",
    "out": "DIR",
    "panel": "P,Q,...",
    "planner": "P",
    "planner_a": "P",
    "planner_b": "P",
    "profile": "NAME",
    "road": "city|motorway",
    "scenario": "SCENARIO",
    "scenarios": "GLOB",
    "secret_seed": "FILE",
    "shift": "X",
    "source": "TEXT",
    "speed": "X",
    "suite": "SUITE",
    "tag": "TAG",
    "token": "TOKEN",
}
"""By the parameter's name, where it has none of its own; without one, the help would show a type of Python."""
BLANK: Final = " "
"""Of a flag, which takes no value."""


def shorten(parameter: Any) -> None:
    """Give a parameter of a command a value's name, and its default a place in the line that tells what it is."""
    if getattr(parameter, "is_flag", False):
        parameter.metavar, parameter.show_default = BLANK, False
        return
    parameter.metavar = parameter.metavar or VALUES[parameter.name]
    if parameter.param_type_name == "argument":  # its name says what it is; typer adds a type of Python
        parameter.display_type_rich = lambda **_: None
    if parameter.default is not None and parameter.show_default:
        if said := told(parameter.default):
            parameter.help = f"{parameter.help} Default: {said}."
        parameter.show_default = False


def told(default: Any) -> str:
    """A default as one types it."""
    return f"{default:g}" if isinstance(default, float) else str(getattr(default, "value", default))
