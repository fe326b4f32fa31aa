"""Constructor arguments of nuPlan's planners from YAML files in the form that nuPlan's own configurations have."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from interplan_sumo.errors import PlannerLoadError
from interplan_sumo.planner_options import OptionLoader

TARGET = "_target_"
_IGNORED = ("_convert_", "_recursive_")
"""How Hydra would hand containers over: here they are always plain lists and dicts, built inside out."""
_TRUSTED = ("nuplan", "tuplan_garage")
"""Packages whose classes a configuration may name, besides the package of the planner itself."""


def arguments(path: Path, planner: str) -> dict[str, Any]:
    """Constructor arguments of `planner` (its dotted class name) from a configuration file.

    The file holds the arguments themselves, with or without the `_target_` of
    the planner, or as in nuPlan's planner configurations one entry with both.
    Mappings with a `_target_` become objects: classes of nuplan, tuplan_garage
    and the planner's own package, nothing else. PlannerLoadError names the file
    and the key.
    """
    node = _unwrapped(_read(path), planner)
    target = node.get(TARGET, planner)
    if target != planner:
        raise PlannerLoadError(f"{path}: is for {target}, not for {planner}")
    trusted = (*_TRUSTED, planner.partition(".")[0])
    return {
        str(key): _built(value, f"{path}: {key}", trusted)
        for key, value in node.items()
        if key not in (TARGET, *_IGNORED)
    }


def _read(path: Path) -> Mapping[Any, Any]:
    try:
        node = yaml.load(path.read_text(encoding="utf-8"), OptionLoader)
    except OSError as error:
        raise PlannerLoadError(f"cannot read {path}: {error.strerror or error}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise PlannerLoadError(f"{path} is not YAML: {' '.join(str(error).split())}") from error
    if not isinstance(node, Mapping):
        raise PlannerLoadError(f"{path}: holds no mapping of arguments")
    return node


def _unwrapped(node: Mapping[Any, Any], planner: str) -> Mapping[Any, Any]:
    """The arguments of a planner that is the only entry of its file."""
    if len(node) == 1:
        (only,) = node.values()
        if isinstance(only, Mapping) and only.get(TARGET) == planner:
            return only
    return node


def _built(node: Any, where: str, trusted: tuple[str, ...]) -> Any:
    if isinstance(node, str) and "${" in node:
        raise PlannerLoadError(f"{where}: {node!r} is an interpolation, which only Hydra resolves; write the value")
    if isinstance(node, list):
        return [_built(value, f"{where}[{row}]", trusted) for row, value in enumerate(node)]
    if not isinstance(node, Mapping):
        return node
    inner = {key: _built(value, f"{where}.{key}", trusted) for key, value in node.items() if key not in _IGNORED}
    target = inner.pop(TARGET, None)
    if target is None:
        return inner
    unknown = [key for key in inner if not str(key).isidentifier() or str(key).startswith("_")]
    if unknown:
        raise PlannerLoadError(f"{where}: {unknown[0]!r} is no argument; of Hydra's own keys only {TARGET} is known")
    make = _resolved(target, where, trusted)
    try:
        return make(**inner)
    except Exception as error:
        raise PlannerLoadError(f"{where}: {target} cannot be built: {type(error).__name__}: {error}") from error


def _resolved(target: Any, where: str, trusted: tuple[str, ...]) -> Any:
    """The class that a `_target_` names."""
    module, _, name = str(target).rpartition(".")
    if str(target).partition(".")[0] not in trusted or not module:
        raise PlannerLoadError(f"{where}: {target!r} is not a class of {', '.join(dict.fromkeys(trusted))}")
    try:
        found = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError) as error:
        raise PlannerLoadError(f"{where}: cannot import {target}: {error}") from error
    if not isinstance(found, type):
        raise PlannerLoadError(f"{where}: {target} is not a class")
    return found
