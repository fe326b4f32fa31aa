"""Profile: which metrics make the score, as gates or with what weight; a YAML file, registered or one's own.

    needs_scenario: true            # whether a trace and a map are not enough
    honours_exemptions: true        # whether gates that a scenario exempts are left out
    gates:                          # factors of the score
      - {metric: no_collision}
      - {metric: obstacle_passed, when: with_obstacles}
    weights:                        # terms of the weighted mean
      - {metric: nuplan_progress, as: progress, weight: 5}

`as` is the name in rows and tables, the metric's own if it is left out; `when` one of `CONDITIONS`. A package adds a
profile by an entry point `NAME = "PACKAGE"` in the group `interplan_sumo.profiles`, with `NAME.yaml` in that package.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from math import isfinite
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Final, NoReturn

import yaml

from interplan_sumo.errors import InputError, UnknownNameError
from interplan_sumo.families import find_family
from interplan_sumo.metrics.metric import METRICS
from interplan_sumo.registry import Registry

if TYPE_CHECKING:
    from interplan_sumo.metrics.facts import Facts

DEFAULT_PROFILE: Final = "interplan-paper"
PROFILES: Final = Registry("interplan_sumo.profiles", "scoring profile", ModuleType)
"""The packages that hold each registered profile."""
SUFFIXES: Final = (".yaml", ".yml")


def always(facts: Facts) -> bool:  # noqa: ARG001
    """Judged in every drive."""
    return True


def with_obstacles(facts: Facts) -> bool:
    """Judged where something must be passed."""
    return bool(facts.obstacle_corners)


def lane_blocked(facts: Facts) -> bool:
    """Judged in the families for which the published code makes the driving-direction gate a weighted term."""
    return find_family(facts.staged.family).weighs_direction


def lane_free(facts: Facts) -> bool:
    """Judged in the other families."""
    return not lane_blocked(facts)


CONDITIONS: Final[Mapping[str, Callable[[Facts], bool]]] = {
    judged.__name__: judged for judged in (always, with_obstacles, lane_blocked, lane_free)
}


@dataclass(frozen=True, slots=True)
class Term:
    """A gate, or a term of the weighted mean."""

    name: str
    """In rows and tables."""
    metric: str
    weight: float | None = None
    """None of a gate."""
    when: str = "always"
    """One of `CONDITIONS`."""


@dataclass(frozen=True, slots=True)
class Profile:
    """Which terms make the score."""

    name: str
    terms: tuple[Term, ...]
    """Gates first."""
    needs_scenario: bool
    honours_exemptions: bool
    """Whether gates that `Scenario.exempt` names are left out."""


def find_profile(profile: str | Path | Profile) -> Profile:
    """A registered profile by name, or that of a YAML file, named after the file and what it says.

    A profile is returned as it is. UnknownNameError if there is none of that
    name, InputError with file and line for one that cannot be used.
    """
    if isinstance(profile, Profile):
        return profile
    if isinstance(profile, Path) or profile.lower().endswith(SUFFIXES):
        found = _read(Path(profile), Path(profile).stem)
        digest = hashlib.sha256(repr(replace(found, name="")).encode()).hexdigest()
        return replace(found, name=f"{found.name}@{digest[:12]}")
    return _registered(profile)


@cache
def _registered(name: str) -> Profile:
    return _read(files(PROFILES[name]) / f"{name}.yaml", name)


KEPT: Final = "profile.yaml"
"""In a run folder the profile of a file, as it was then."""


def keep_profile(profile: Profile, folder: Path) -> None:
    """Write a file's profile into a run folder, so that `stored_profile` finds it; registered ones need none."""
    if "@" not in profile.name:
        return
    said: dict[str, Any] = {
        "needs_scenario": profile.needs_scenario,
        "honours_exemptions": profile.honours_exemptions,
        "gates": [],
        "weights": [],
    }
    for term in profile.terms:
        entry: dict[str, Any] = {"metric": term.metric, "as": term.name, "when": term.when}
        if term.weight is None:
            said["gates"].append(entry)
        else:
            said["weights"].append(entry | {"weight": term.weight})
    (folder / KEPT).write_text(yaml.safe_dump(said, sort_keys=False, default_flow_style=None), encoding="utf-8")


def stored_profile(name: str, folder: Path) -> Profile:
    """The profile of a run by its name in the manifest; errors as from `find_profile`."""
    return _read(folder / KEPT, name) if "@" in name else _registered(name)


def row_metrics() -> tuple[str, ...]:
    """Names under which metrics stand in rows: those of the registered profiles, then all that no such profile uses."""
    terms = [term for name in PROFILES for term in find_profile(name).terms]
    used = {term.metric for term in terms}
    return tuple(dict.fromkeys((*(term.name for term in terms), *(name for name in METRICS if name not in used))))


# --- the file ------------------------------------------------------------------------------------

_LINE: Final = object()
"""The key under which a mapping that was read knows its line."""


class _LoaderWithLines(yaml.SafeLoader):
    """Safe values; every mapping knows its line, and no key stands twice in one."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        found = super().construct_mapping(node, deep)
        if len(found) < len(node.value):
            raise yaml.constructor.ConstructorError(None, None, "a key stands twice in one mapping", node.start_mark)
        return found | {_LINE: node.start_mark.line + 1}


def _read(file: Path | Traversable, name: str) -> Profile:
    try:
        text = file.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot read the profile {file}: {error.strerror or error}; give another file") from None
    except UnicodeDecodeError:
        raise InputError(f"{file} is no text in UTF-8; {_WAY_OUT}") from None
    try:
        return _ProfileReader(str(file)).profile(yaml.load(text, _LoaderWithLines), name)  # a SafeLoader
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f", line {mark.line + 1}" if mark is not None else ""
        raise InputError(f"{file}{where}: this is not YAML: {error.problem or error.context}") from None
    except (yaml.YAMLError, ValueError) as error:
        raise InputError(f"{file}: this is not YAML: {' '.join(str(error).split())}") from None
    except RecursionError:
        raise InputError(f"{file}: lists inside lists without end; {_WAY_OUT}") from None


_WAY_OUT: Final = "docs/metrics.md shows what a profile looks like"


@dataclass(frozen=True, slots=True)
class _ProfileReader:
    file: str

    def profile(self, data: Any, name: str) -> Profile:
        said = self._fields(data, "a profile", {"needs_scenario", "honours_exemptions"}, {"gates", "weights"})
        flags = {key: said[key] for key in ("needs_scenario", "honours_exemptions")}
        for key, value in flags.items():
            if not isinstance(value, bool):
                self._fail(said, f"{key} is {value!r}, expected true or false")
        gates = [self._term(each, weighted=False) for each in self._list(said, "gates")]
        weights = [self._term(each, weighted=True) for each in self._list(said, "weights")]
        if not weights:
            self._fail(said, "there are no weights, every score would be 0; name a metric with a weight")
        self._check_names(said, (*gates, *weights))
        return Profile(name, (*gates, *weights), **flags)

    def _term(self, data: Any, *, weighted: bool) -> Term:
        needed = {"metric", "weight"} if weighted else {"metric"}
        said = self._fields(data, "a weighted term" if weighted else "a gate", needed, {"as", "when"})
        metric, when, weight = said["metric"], said.get("when", "always"), said.get("weight", 1)
        name = said.get("as", metric)
        for value, known, what in ((metric, METRICS, "metric"), (when, CONDITIONS, "condition")):
            if value not in tuple(known):
                self._fail(said, str(UnknownNameError(what, str(value), known)))
        if not isinstance(name, str) or not name.isidentifier():
            self._fail(said, f"as is {name!r}, expected a word such as {metric}")
        if not (type(weight) in (int, float) and isfinite(weight) and weight > 0):
            self._fail(said, f"the weight of {name} is {weight!r}, expected a number above 0")
        return Term(name, metric, float(weight) if weighted else None, when)

    def _check_names(self, said: dict[Any, Any], terms: tuple[Term, ...]) -> None:
        """A name stands once, or twice under conditions of which exactly one holds."""
        for name in {term.name for term in terms}:
            conditions = [term.when for term in terms if term.name == name]
            if len(conditions) > 1 and sorted(conditions) != ["lane_blocked", "lane_free"]:
                self._fail(said, f"{name} stands {len(conditions)} times; give each a name of its own with `as`")

    def _list(self, said: dict[Any, Any], key: str) -> list[Any]:
        found = said.get(key, [])
        return found if isinstance(found, list) else self._fail(said, f"{key} is no list of terms")

    def _fields(self, data: Any, what: str, needed: set[str], further: set[str]) -> dict[Any, Any]:
        """A mapping that has what it needs, and nothing unknown."""
        if not isinstance(data, dict):
            raise InputError(f"{self.file}: found {str(data)[:40]!r} in place of {what}; {_WAY_OUT}")
        for key in data.keys() - {_LINE}:
            if key not in needed | further:
                self._fail(data, str(UnknownNameError("field", str(key), needed | further)))
        for key in sorted(needed - data.keys()):
            self._fail(data, f"{what} has no {key}")
        return data

    def _fail(self, said: dict[Any, Any], problem: str) -> NoReturn:
        raise InputError(f"{self.file}, line {said[_LINE]}: {problem}")
