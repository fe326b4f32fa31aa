"""interplan-sumo: can a motion planner cope with rare, interactive traffic?

Importing the package is cheap: the names of `__all__`, and the version, are loaded when they are first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from interplan_sumo.api import (
        compare,
        compare_all,
        load_drive,
        load_run,
        load_scenario,
        load_trace,
        replay,
        run,
        scenarios,
        score,
        table,
    )
    from interplan_sumo.errors import InputError, InterplanError
    from interplan_sumo.planner import Mission, Observation, Planner
    from interplan_sumo.policy import PolicyPlanner
    from interplan_sumo.scenario.scenario import Scenario
    from interplan_sumo.world.trace import Trace
    from interplan_sumo.world.trajectory import Trajectory

    __version__: str

__all__ = [
    "InputError",
    "InterplanError",
    "Mission",
    "Observation",
    "Planner",
    "PolicyPlanner",
    "Scenario",
    "Trace",
    "Trajectory",
    "compare",
    "compare_all",
    "load_drive",
    "load_run",
    "load_scenario",
    "load_trace",
    "replay",
    "run",
    "scenarios",
    "score",
    "table",
]

_HOMES = {
    "InputError": "errors",
    "InterplanError": "errors",
    "Mission": "planner",
    "Observation": "planner",
    "Planner": "planner",
    "PolicyPlanner": "policy",
    "Scenario": "scenario.scenario",
    "Trace": "world.trace",
    "Trajectory": "world.trajectory",
}
"""The modules of names that are not in `api`."""


def __getattr__(name: str) -> Any:
    if name == "__version__":
        found = _version()
    elif name in __all__:
        found = getattr(import_module(f"{__name__}.{_HOMES.get(name, 'api')}"), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = found
    return found


def _version() -> str:
    """Of the installed package."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("interplan-sumo")
    except PackageNotFoundError:  # a bare checkout
        return "0.0.0"


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
