"""What stands behind `--planner 'nuplan:package.module:Class?argument=value'`; imports the devkit on demand only."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from interplan_sumo.bridge.nuplan.config import arguments
from interplan_sumo.errors import PlannerLoadError, check_names
from interplan_sumo.planner import Planner

CONFIG = "config"
"""The option that names a YAML file of constructor arguments."""
_HOW = "docs/nuplan_planners.md says how to set it up"


def find(target: str) -> None:
    """Check that the devkit and the module of `package.module:Class` exist; PlannerLoadError otherwise."""
    if not _exists("nuplan"):
        raise PlannerLoadError(
            f"planner 'nuplan:{target}' needs nuPlan's devkit: put a checkout of nuplan-devkit on PYTHONPATH; {_HOW}"
        )
    module = target.partition(":")[0]
    if not _exists(module):
        raise PlannerLoadError(
            f"planner 'nuplan:{target}': there is no module {module!r}, neither on PYTHONPATH nor in the folder "
            f"{os.getcwd()}"
        )


def factory(target: str) -> Callable[..., Planner]:
    """What makes planners from the constructor arguments of `package.module:Class` and the option `config`."""
    find(target)
    module, _, name = target.partition(":")
    try:
        kind: Any = getattr(importlib.import_module(module), name, None)
        from interplan_sumo.bridge.nuplan.planner import NuPlanPlanner
    except ModuleNotFoundError as error:
        raise PlannerLoadError(
            f"planner 'nuplan:{target}': its imports need the module {error.name!r}, which is not installed; {_HOW}"
        ) from error
    except Exception as error:
        problem = f"{type(error).__name__}: {error}"
        raise PlannerLoadError(f"planner 'nuplan:{target}' cannot be imported: {problem}") from error
    if kind is None:
        raise PlannerLoadError(f"planner 'nuplan:{target}': module {module!r} has no {name!r}")

    def make(**options: Any) -> Planner:
        config = options.pop(CONFIG, None)

        def all_arguments() -> dict[str, Any]:
            held = {} if config is None else arguments(Path(str(config)), f"{module}.{name}")
            return {**held, **options}

        _check_options(kind, target, all_arguments())
        # Made anew for each planner: planners change the objects that they are given.
        return NuPlanPlanner(lambda: kind(**all_arguments()))

    return make


def _check_options(kind: Any, target: str, given: Iterable[str]) -> None:
    """UnknownNameError for an option that is no argument of the constructor."""
    parameters = inspect.signature(kind.__init__).parameters.values()
    if any(each.kind is inspect.Parameter.VAR_KEYWORD for each in parameters):
        return
    known = [CONFIG, *(each.name for each in list(parameters)[1:])]
    check_names(f"option of planner 'nuplan:{target}'", given, known)


def _exists(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except (ImportError, ValueError):
        return False
