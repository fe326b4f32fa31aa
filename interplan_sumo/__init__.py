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
    from interplan_sumo.errors import InputError, InterplanError, UnknownNameError
    from interplan_sumo.maps.store import load_roads
    from interplan_sumo.planner import Mission, Observation, Past, Planner, load_planner
    from interplan_sumo.policy import PolicyPlanner
    from interplan_sumo.scenario.scenario import Scenario
    from interplan_sumo.testing import assert_planner_conforms, check_planner
    from interplan_sumo.world.actors import ActorKind, Actors
    from interplan_sumo.world.ego import EgoShape, EgoState
    from interplan_sumo.world.geometry import Polyline, Pose, wrap_angle
    from interplan_sumo.world.roads import Connector, Lane, Roads
    from interplan_sumo.world.signals import Signals, SignalStatus
    from interplan_sumo.world.trace import Trace
    from interplan_sumo.world.trajectory import Trajectory

    __version__: str

__all__ = [
    "ActorKind",
    "Actors",
    "Connector",
    "EgoShape",
    "EgoState",
    "InputError",
    "InterplanError",
    "Lane",
    "Mission",
    "Observation",
    "Past",
    "Planner",
    "PolicyPlanner",
    "Polyline",
    "Pose",
    "Roads",
    "Scenario",
    "SignalStatus",
    "Signals",
    "Trace",
    "Trajectory",
    "UnknownNameError",
    "assert_planner_conforms",
    "check_planner",
    "compare",
    "compare_all",
    "load_drive",
    "load_planner",
    "load_roads",
    "load_run",
    "load_scenario",
    "load_trace",
    "replay",
    "run",
    "scenarios",
    "score",
    "table",
    "wrap_angle",
]

_HOMES = {
    "ActorKind": "world.actors",
    "Actors": "world.actors",
    "Connector": "world.roads",
    "EgoShape": "world.ego",
    "EgoState": "world.ego",
    "InputError": "errors",
    "InterplanError": "errors",
    "Lane": "world.roads",
    "Mission": "planner",
    "Observation": "planner",
    "Past": "planner",
    "Planner": "planner",
    "PolicyPlanner": "policy",
    "Polyline": "world.geometry",
    "Pose": "world.geometry",
    "Roads": "world.roads",
    "Scenario": "scenario.scenario",
    "SignalStatus": "world.signals",
    "Signals": "world.signals",
    "Trace": "world.trace",
    "Trajectory": "world.trajectory",
    "UnknownNameError": "errors",
    "assert_planner_conforms": "testing",
    "check_planner": "testing",
    "load_planner": "planner",
    "load_roads": "maps.store",
    "wrap_angle": "world.geometry",
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
