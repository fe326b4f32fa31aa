"""Extras: libraries that only some uses need, imported when they are used, and named with the way to get them."""

from __future__ import annotations

import importlib.util
from typing import Any

from interplan_sumo.errors import InputError


def library(name: str, what: str, extra: str) -> Any:
    """The module of that name; InputError naming the extra that has it if it is not installed or cannot be imported."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        why = "is not installed" if isinstance(error, ModuleNotFoundError) else f"cannot be imported: {error}"
        raise InputError(_message(name, what, extra, why)) from None


def need(name: str, what: str, extra: str) -> None:
    """InputError, before anything takes time, if a library is not installed."""
    if importlib.util.find_spec(name) is None:
        raise InputError(_message(name, what, extra, "is not installed"))


def need_matplotlib(what: str = "a plot") -> None:
    """InputError without it."""
    need("matplotlib", what, "plots")


def _message(name: str, what: str, extra: str, why: str) -> str:
    return f"{what} needs {name}, which {why}; run: pip install 'interplan-sumo[{extra}]'"
