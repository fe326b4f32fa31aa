"""Libraries that only some planners need: imported when they are used, named with the way to get them."""

from __future__ import annotations

import importlib
from typing import Any

from interplan_sumo.errors import InputError


def library(name: str, what: str, extra: str) -> Any:
    """The module of that name; InputError naming the extra that has it if it is not installed or cannot be imported."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        why = "is not installed" if isinstance(error, ModuleNotFoundError) else f"cannot be imported: {error}"
        raise InputError(f"{what} needs {name}, which {why}. Run: pip install 'interplan-sumo[{extra}]'") from None
