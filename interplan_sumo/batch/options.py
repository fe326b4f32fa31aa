"""Run options: what one can choose about a run, declared once.

The commands, the Python API, sweeps, environments, `verify` and the workers take it from here. A new option is one
field, with its help, its default and what is checked, and one place that asks for it.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

from interplan_sumo.batch.processes import Workers
from interplan_sumo.batch.records import MOST_SEEDS, Shard
from interplan_sumo.errors import InputError, UnknownNameError, check_names, clean_line

if TYPE_CHECKING:
    from interplan_sumo.batch.overrides import Overrides
    from interplan_sumo.batch.tasks import Limits


def _about(help: str, **about: Any) -> dict[str, Any]:
    """Metadata of a field. `about` may hold

    `flag`: its option on the command line, if it is not called as the field is;
    `metavar`, `completes`: what stands there for the value, and the function of `cli.completion` that completes it;
    `least`, `most`, `choices`: what the value may be;
    `setting`: whether it changes the scenarios and is given as `--set KEY=VALUE`;
    `scene`: whether it says what is driven and scored, and not how a run goes about it.
    """
    return {"help": help, **about}


MOST_MEMORY_GB: Final = 2.0**33
"""From here on, where numbers of bytes end, there is no limit."""
DENSITIES: Final = ("low", "medium", "high")
"""That scenes with traffic can be driven in instead of their own."""


@dataclass(frozen=True, slots=True)
class RunOptions:
    """What to run, where to, and within which limits. InputError for a value that cannot be."""

    planners: tuple[str, ...] = field(
        default=(),
        metadata=_about(
            "A name, module:Class, name?option=value&... or exec:COMMAND. Default: the recommended one.",
            flag="--planner",
            metavar="P",
            completes="planner_names",
        ),
    )
    out: Path | None = field(
        default=None, metadata=_about("The run folder; the same command resumes it.", metavar="DIR")
    )
    suite: str | None = field(
        default=None, metadata=_about("NAME==VERSION.", metavar="SUITE", completes="suite_names", scene=True)
    )
    scenarios: tuple[str, ...] = field(
        default=(),
        metadata=_about(
            "Ids, such as 'nudge/*', or a FILE.yaml, or the folder it lies in.",
            metavar="GLOB",
            completes="scenario_ids",
            scene=True,
        ),
    )
    seeds: int = field(
        default=1,
        metadata=_about("0 to N-1; 0 is certified.", metavar="N", least=1, most=MOST_SEEDS, scene=True),
    )
    workers: int | str | None = field(
        default=None,
        metadata=_about(
            "Processes; 0 runs in this one; ray[:ADDRESS] takes a Ray cluster. Default: all cores.",
            metavar="N|ray",
        ),
    )
    traffic: Path | None = field(
        default=None,
        metadata=_about("Vehicle types instead of the scenarios'.", metavar="FILE.xml", scene=True),
    )
    density: str | None = field(
        default=None,
        metadata=_about("|".join(DENSITIES), choices=DENSITIES, setting=True, scene=True),
    )
    behaviour: str | None = field(default=None, metadata=_about("NAME", setting=True, scene=True))
    perception: str | None = field(default=None, metadata=_about("full|occluded|noisy|late", setting=True, scene=True))
    limit: int | None = field(default=None, metadata=_about("At most so many scenarios.", metavar="N", least=1))
    shard: str | None = field(
        default=None,
        metadata=_about("The I-th of N parts; `merge` joins them.", metavar="I/N"),
    )
    profile: str | None = field(
        default=None,
        metadata=_about(
            "Of the score: interplan-strict (default), -paper, -code, nuplan, or a FILE.yaml.",
            metavar="NAME",
            completes="profile_names",
            scene=True,
        ),
    )
    in_process: bool = field(
        default=False,
        metadata=_about("No process of its own for the planner, for debugging; as --workers 0 unless N are given."),
    )
    redo: tuple[str, ...] = field(
        default=(),
        metadata=_about("Drive the rows of this planner again.", metavar="P", completes="planner_names"),
    )
    plan_limit_s: float = field(
        default=10.0,
        metadata=_about("Seconds of a plan(); 0 for no limit.", flag="--plan-limit", metavar="S", least=0),
    )
    job_limit_s: float = field(
        default=3600.0,
        metadata=_about("Seconds of a drive; 0 for no limit.", flag="--job-limit", metavar="S", least=0),
    )
    memory_gb: float = field(
        default=8.0,
        metadata=_about("Memory of a worker, and of its planner (Linux); 0 for no limit.", metavar="GB", least=0),
    )

    def __post_init__(self) -> None:
        for each in fields(self):
            value = _read(each.name, getattr(self, each.name), str(each.type))
            object.__setattr__(self, each.name, value)
            _check(each.name, value, **{k: v for k, v in each.metadata.items() if k in ("least", "most", "choices")})
        for planner in self.planners:
            if not planner.isprintable():
                raise InputError(f"planner '{clean_line(planner)}' holds characters that cannot be printed")
        if self.traffic is not None and self.behaviour is not None:
            raise InputError("--traffic replaces the vehicle types that --set behaviour chooses; give only one")
        if self.perception is not None:
            from interplan_sumo.scenario.scenario import perception_named  # not for every command that starts

            object.__setattr__(self, "perception", perception_named(self.perception))
        if self.shard is not None:
            Shard.parse(self.shard)
        _check("workers", self.who.processes, least=0, hint=" (in this process)")

    @classmethod
    def of(cls, given: dict[str, Any], *, names: Iterable[str] = ()) -> Self:
        """From keyword arguments; UnknownNameError for one that is no option, or none of `names`."""
        known = tuple(names) or tuple(each.name for each in fields(cls))
        check_names("option", given, known)
        return cls(**given)

    @property
    def who(self) -> Workers:
        """Who does the drives."""
        if self.workers is None and self.in_process:
            return Workers(0)
        return Workers.parse(None if self.workers is None else str(self.workers))

    @property
    def isolated(self) -> bool:
        """Whether planners run in processes of their own."""
        return not self.in_process and not self.who.in_this_process

    @property
    def overrides(self) -> Overrides:
        """What is changed in the scenarios."""
        from interplan_sumo.batch.overrides import Overrides

        return Overrides(vehicle_types=self.traffic, **{name: getattr(self, name) for name in SETTINGS})

    @property
    def limits(self) -> Limits:
        from interplan_sumo.batch.tasks import Limits

        return Limits(
            plan_s=self.plan_limit_s or inf,
            task_s=self.job_limit_s or inf,
            memory_bytes=round(self.memory_gb * 2**30) or None if self.memory_gb < MOST_MEMORY_GB else None,
        )


SETTINGS: Final = tuple(each.name for each in fields(RunOptions) if each.metadata.get("setting"))
"""Options that `--set` takes."""
SCENE_OPTIONS: Final = tuple(each.name for each in fields(RunOptions) if each.metadata.get("scene"))
"""Options that say what is driven; environments have them, too."""


def settings_of(pairs: Sequence[str]) -> dict[str, str]:
    """Options from what `--set` was given, `KEY=VALUE` texts; InputError for another key, or one given twice."""
    given: dict[str, str] = {}
    for pair in pairs:
        key, equals, value = pair.partition("=")
        if not equals or not value:
            raise InputError(f"--set {pair!r} has no value; write KEY=VALUE, such as density=high")
        if key not in SETTINGS:
            raise UnknownNameError("setting to override", key, SETTINGS)
        if given.setdefault(key, value) != value:
            raise InputError(f"--set gives {key} twice: {given[key]} and {value}")
    return given


def _read(name: str, value: Any, kind: str) -> Any:
    """A value as its field has it: texts from one or several, a path from a text."""
    try:
        if kind.startswith("tuple"):
            return (os.fspath(value),) if isinstance(value, str | os.PathLike) else tuple(map(os.fspath, value))
        if kind.startswith("Path") and value is not None:
            return Path(value)
        if kind.startswith("float"):
            return float(str(value))
    except (TypeError, ValueError):
        raise InputError(f"{name} is {value!r}, which is none") from None
    if not (value is None and "None" in kind) and type(value).__name__ not in kind.split(" | "):
        raise InputError(f"{name} is {value!r}, expected {kind.removesuffix(' | None')}")
    return value


def _check(
    name: str,
    value: Any,
    least: float | None = None,
    most: float = inf,
    choices: Sequence[str] | None = None,
    hint: str = "",
) -> None:
    if value is None:
        return
    if choices is not None and value not in choices:
        raise UnknownNameError(name, value, choices)
    if least is not None and not least <= value <= most:
        way = f"{least}{hint} or more" if value < least else f"at most {most}"
        raise InputError(f"{name} is {value}, expected {way}")
