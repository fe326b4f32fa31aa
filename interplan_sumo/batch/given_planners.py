"""Given planners: planners as Python callers give them, with names, told apart by who can build them."""

from __future__ import annotations

import contextlib
import functools
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from typing import Any

from interplan_sumo.errors import InputError, PlannerLoadError
from interplan_sumo.planner import PLANNERS, Planner

PlannerLike = str | Planner | Callable[[], Planner]
"""A name as `--planner` takes it, a planner, or what makes one: its class or a function without arguments."""


def named_planners(
    planner: PlannerLike | Sequence[PlannerLike] | Mapping[str, PlannerLike],
) -> tuple[list[str], dict[str, Callable[[], Planner]]]:
    """The planners' names, and those of them that only this process can build."""
    if isinstance(planner, Mapping):
        pairs = [(str(name), each) for name, each in planner.items()]
    elif isinstance(planner, Sequence) and not isinstance(planner, str):
        pairs = [(None, each) for each in planner]
    else:
        pairs = [(None, planner)]
    if not pairs:
        raise InputError("no planner given; name one, such as 'idm'")
    names: list[str] = []
    made: dict[str, Callable[[], Planner]] = {}
    for given, each in pairs:
        spec = each if isinstance(each, str) else _spec_of(each)
        if spec is not None and given is None:
            names.append(spec)
            continue
        if isinstance(each, str):
            raise InputError(f"planner {each!r} has a name already; only objects and classes can be given another")
        name = given or getattr(each, "__name__", type(each).__name__)
        if name in names:
            raise InputError(f"two planners are called {name!r}; name them: run({{'a': ..., 'b': ...}})")
        names.append(name)
        made[name] = functools.partial(_build, name, each)
    return names, made


def _spec_of(planner: object) -> str | None:
    """The name under which any process can import a class or function: registered, or module:Class; else None."""
    module, name = getattr(planner, "__module__", None), getattr(planner, "__qualname__", None)
    if not (module and name) or module == "__main__" or getattr(sys.modules.get(module), name, None) is not planner:
        return None
    with contextlib.suppress(ImportError, ValueError):
        if find_spec(module) is not None:
            spec = f"{module}:{name}"
            return next((short for short, point in PLANNERS.points.items() if point.value == spec), spec)
    return None


def _build(name: str, planner: Any) -> Planner:
    """The planner itself, or a new one; PlannerLoadError if that fails or is none."""
    try:
        found = planner if _plans(planner) and not isinstance(planner, type) else planner()
    except Exception as error:
        raise PlannerLoadError(f"planner {name!r} could not be built: {type(error).__name__}: {error}") from error
    if not _plans(found):
        raise PlannerLoadError(f"planner {name!r} lacks a method; a planner needs start(mission) and plan(observation)")
    return found


def _plans(planner: object) -> bool:
    return all(callable(getattr(planner, method, None)) for method in ("start", "plan"))
