"""The planner's side of the benchmark: what a planner is given and what it returns.

A planner is any object with the two methods of `Planner`; no base class.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

from interplan_sumo.errors import InputError, PlannerLoadError, UnknownNameError, told
from interplan_sumo.planner_options import option_defaults, options_of, settings_class
from interplan_sumo.registry import INSTALL_HINT, Registry, source_of
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import PACIFICA, EgoShape, EgoState
from interplan_sumo.world.geometry import Pose
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.signals import Signals
from interplan_sumo.world.trajectory import Trajectory

RECOMMENDED = "foresight"
"""The best planner so far; `make benchmark` runs it."""


@dataclass(frozen=True, eq=False)
class Mission:
    """What a planner is told once, before the first step: as nuPlan's planner initialization."""

    roads: Roads
    route: tuple[str, ...]
    """Roadblock and roadblock-connector ids in driving order, from the start to the goal."""
    goal: Pose
    """Where to go: a pose on the goal lane's centre line, map frame."""
    shape: EgoShape = PACIFICA
    dt_s: float = 0.1


@dataclass(frozen=True, eq=False)
class Past:
    """The last 2 s, oldest first, one entry per step, the present not included.

    Before the start of an episode the past is extrapolated backwards at
    constant speed along the lanes.
    """

    egos: tuple[EgoState, ...] = ()
    actors: tuple[Actors, ...] = ()


@dataclass(frozen=True, eq=False)
class Observation:
    """What a planner sees at one step: everything within 100 m."""

    time_s: float
    ego: EgoState
    actors: Actors
    signals: Signals
    past: Past = field(default_factory=Past)


@runtime_checkable
class Planner(Protocol):
    """Plans for one ego. One instance drives many episodes, one after the other; `start` opens each.

    Its options are the arguments of its constructor. A class with many may keep them in a dataclass, its attribute
    `Settings`, an instance of which its constructor then takes.

    It may also have a method `report()`: what it returns after an episode, plain
    data, is kept as `planner_report` in the results. `queries` and `fallbacks`
    (counts by cause) in it are summed up in tables.
    """

    def start(self, mission: Mission) -> None:
        """Get ready for a new episode; nothing of the last one may remain."""
        ...

    def plan(self, observation: Observation) -> Trajectory:
        """A trajectory that covers `observation.time_s` and the time after it."""
        ...


class PlannerScheme(Protocol):
    """Planners of another world, named `prefix:module:Class`; `target` is what follows the prefix."""

    def find(self, target: str) -> None:
        """Check that the target exists without importing it; PlannerLoadError otherwise."""
        ...

    def factory(self, target: str) -> Callable[..., Planner]:
        """What makes the planner from its options; PlannerLoadError if it cannot be imported."""
        ...


EXEC = "exec"
"""The prefix of planners that are programs: `exec:COMMAND`, docs/planner_protocol.md."""

PLANNERS: Registry[Callable[..., Planner]] = Registry(
    "interplan_sumo.planners", "planner", hint=f"Or give module:Class. {INSTALL_HINT}"
)
SCHEMES: Registry[PlannerScheme] = Registry(
    "interplan_sumo.planner_schemes", "planner scheme", hint=f"A planner of your own is module:Class. {INSTALL_HINT}"
)
"""By the prefix that each stands for."""


@dataclass(frozen=True, slots=True)
class PlannerInfo:
    """A registered planner, as `planners list` prints it."""

    name: str
    source: str
    """The distribution that registers it."""
    parameters: Mapping[str, Any]
    """Options and their defaults: the constructor's arguments, or the fields of its class's `Settings`."""
    recommended: bool
    paper: str | None = None
    """Where it was published: the class attribute `paper`, if it has one."""
    problem: str | None = None
    """Why it cannot be imported, if it cannot."""


def split_spec(spec: str) -> tuple[str, str]:
    """What stands before and behind the question mark of a planner's options; a command has none."""
    name, _, query = spec.partition("?")
    return (spec, "") if spec.startswith(f"{EXEC}:") else (name, query)


def find_planner(spec: str) -> None:
    """Check that a registered name, a program or the module of `module:Class` exists, importing nothing of the planner.

    UnknownNameError or PlannerLoadError otherwise: what can be known before anything is started.
    """
    name, _ = split_spec(spec)
    module, colon, rest = name.partition(":")
    if ":" in rest or module == EXEC:
        SCHEMES[module].find(rest)
        return
    if not colon:
        PLANNERS.point(name)
        return
    _refuse_file(module, rest)
    try:
        found = importlib.util.find_spec(module) is not None
    except (ImportError, ValueError):
        found = False
    if not found:
        raise PlannerLoadError(
            f"planner {name!r}: there is no module {module!r}, neither installed nor in the folder {os.getcwd()}"
        )


def planners() -> list[PlannerInfo]:
    """Everything registered, with parameters; imports each planner's module."""
    listed: list[PlannerInfo] = []
    for name, point in PLANNERS.points.items():
        recommended = name == RECOMMENDED
        try:
            make = PLANNERS[name]
            info = PlannerInfo(name, source_of(point), option_defaults(make), recommended, _paper(make))
        except InputError as error:
            info = PlannerInfo(name, source_of(point), {}, recommended, problem=str(error))
        listed.append(info)
    return listed


def load_planner(spec: str) -> Planner:
    """A new planner from `name`, `module:Class`, `scheme:module:Class`, or these with `?option=value&option=value`.

    `exec:COMMAND` starts a program.

    Values are read as YAML (`2`, `0.5`, `true`, text, `[1, 2]`) and held against the constructor's annotations,
    `Annotated[float, msgspec.Meta(gt=0)]` included. Raises UnknownNameError or PlannerLoadError with the way out.
    """
    if not isinstance(spec, str):
        raise PlannerLoadError(
            f"load_planner takes a name, such as 'idm' or 'mine:Class', and no {type(spec).__name__}"
        )
    name, query = split_spec(spec)
    make = _factory(name)
    options = options_of(name, make, query)
    settings = settings_class(make)
    try:
        planner = make(settings(**options)) if settings else make(**options)
    except InputError:
        raise
    except (Exception, SystemExit) as error:
        raise PlannerLoadError(f"planner {spec!r} could not be built: {told(error)}") from error
    for method in ("start", "plan"):
        if not callable(getattr(planner, method, None)):
            needs = "a planner needs start(mission) and plan(observation)"
            if callable(getattr(planner, "compute_planner_trajectory", None)):
                needs = f"one of nuPlan's is named nuplan:{spec}"
            raise PlannerLoadError(f"planner {spec!r} has no method {method}(); {needs}")
    return planner


def _factory(name: str) -> Any:
    if ":" in name:
        module_name, _, attribute = name.partition(":")
        if ":" in attribute or module_name == EXEC:
            return SCHEMES[module_name].factory(attribute)
        _refuse_file(module_name, attribute)
        try:
            module = importlib.import_module(module_name)
        except (Exception, SystemExit) as error:
            raise PlannerLoadError(f"planner {name!r}: cannot import {module_name!r}: {told(error)}") from error
        if not hasattr(module, attribute):
            classes = {each: value for each, value in vars(module).items() if isinstance(value, type)}
            planners = [each for each, value in classes.items() if callable(getattr(value, "plan", None))]
            raise UnknownNameError(f"class of module {module_name!r}", attribute, planners or classes)
        return getattr(module, attribute)
    return PLANNERS[name]


def _refuse_file(module: str, attribute: str) -> None:
    """PlannerLoadError if a file is named where a module should be."""
    if module.endswith(".py"):
        dotted = module.removesuffix(".py").removeprefix("./").replace("/", ".")
        raise PlannerLoadError(
            f"planner '{module}:{attribute}' names a file; name its module: {dotted.lstrip('.')}:{attribute}"
        )


def _paper(make: Any) -> str | None:
    paper = getattr(make, "paper", None)
    return paper if isinstance(paper, str) else None
