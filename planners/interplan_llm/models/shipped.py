"""Adapters that come with the package: the default model tuned for one planner each, as its card beside it tells."""

from __future__ import annotations

import os
from importlib.resources import files
from pathlib import Path

from interplan_sumo.errors import InputError, UnknownNameError

ADAPTERS = ("hybrid", "waypoints")


def adapter_file(name: str) -> Path:
    """The GGUF file of an adapter. UnknownNameError for a name that is none, InputError if the file is not there."""
    if name not in ADAPTERS:
        raise UnknownNameError("tuned adapter", name, ADAPTERS, "Write for example embedded+tuned:hybrid")
    path = Path(os.fspath(files("interplan_llm"))) / "adapters" / f"{name}.gguf"  # type: ignore[arg-type]
    if not path.is_file():
        raise InputError(
            f"this installation holds no tuned adapter {name!r} ({path}); "
            f"make one, see docs/language_models.md, and name it: embedded+lora:FILE"
        )
    return path
