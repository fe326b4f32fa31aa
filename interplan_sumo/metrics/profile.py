"""Profile: which metrics make the score, as gates or with what weight; a YAML file, registered or one's own.

    needs_scenario: true            # whether a trace and a map are not enough
    honours_exemptions: true        # whether gates that a scenario exempts are left out
    gates:                          # factors of the score
      - {metric: no_collision, role: safety}
      - {metric: obstacle_passed, when: with_obstacles}
    weights:                        # terms of the weighted mean
      - {metric: nuplan_progress, as: progress, weight: 5}

`as` is the name in rows and tables, the metric's own if it is left out; `when` one of `CONDITIONS`; `role` says what
the loss of a gate means: the drive was unsafe, or its task was not done. `beside` names profiles whose scores are told
beside the own. A package adds a profile by an entry point `NAME = "PACKAGE"` in the group `interplan_sumo.profiles`,
with `NAME.yaml` in that package.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, Final, Literal

import msgspec
import yaml

from interplan_sumo.errors import InputError, UnknownNameError
from interplan_sumo.families import find_family
from interplan_sumo.metrics.metric import METRICS
from interplan_sumo.registry import Registry
from interplan_sumo.world.files import replacing

if TYPE_CHECKING:
    from interplan_sumo.metrics.facts import Facts

DEFAULT_PROFILE: Final = "interplan-strict"
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


Role = Literal["safety", "task"]


class Term(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A gate, or a term of the weighted mean."""

    metric: str
    name: str = msgspec.field(name="as", default="")
    """In rows and tables."""
    when: str = "always"
    """One of `CONDITIONS`."""
    weight: Annotated[float, msgspec.Meta(gt=0.0, le=1e6)] | None = None
    """None of a gate."""
    role: Role | None = None
    """What it says of a drive that this gate took points from."""

    def __post_init__(self) -> None:
        for name, known, what in ((self.metric, METRICS, "metric"), (self.when, CONDITIONS, "condition")):
            if name not in known:
                raise ValueError(UnknownNameError(what, name, known))
        msgspec.structs.force_setattr(self, "name", self.name or self.metric)


class Profile(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Which terms make the score."""

    name: str = ""
    needs_scenario: bool
    honours_exemptions: bool
    """Whether gates that `Scenario.exempt` names are left out."""
    gates: tuple[Term, ...] = ()
    weights: Annotated[tuple[Term, ...], msgspec.Meta(min_length=1)]
    beside: tuple[str, ...] = ()
    """Registered profiles by which every drive is scored as well."""

    def __post_init__(self) -> None:
        for name in self.beside:
            if name not in PROFILES:
                raise ValueError(UnknownNameError("scoring profile", name, PROFILES))
        for term in self.terms:
            if term.role is not None and term.weight is not None:
                raise ValueError(f"{term.name} has a weight and the role {term.role}; only gates have roles")
            if (term.weight is None) is (term in self.weights):
                raise ValueError(f"{term.name} needs a weight among the weights, and none among the gates")
            conditions = sorted(other.when for other in self.terms if other.name == term.name)
            if len(conditions) > 1 and conditions != ["lane_blocked", "lane_free"]:
                raise ValueError(f"{term.name} stands {len(conditions)} times; give each a name of its own with `as`")

    @property
    def terms(self) -> tuple[Term, ...]:
        """Gates first."""
        return (*self.gates, *self.weights)


def find_profile(profile: str | Path | Profile) -> Profile:
    """A registered profile by name, or that of a YAML file, named after the file and what it says.

    A profile is returned as it is. UnknownNameError if there is none of that
    name, InputError with file and line for one that cannot be used.
    """
    if isinstance(profile, Profile):
        return profile
    if isinstance(profile, Path) or profile.lower().endswith(SUFFIXES):
        found = _read(Path(profile))
        digest = hashlib.sha256(msgspec.json.encode(found)).hexdigest()
        return msgspec.structs.replace(found, name=f"{Path(profile).stem}@{digest[:12]}")
    return _registered(profile)


@cache
def _registered(name: str) -> Profile:
    return _read(files(PROFILES[name]) / f"{name}.yaml", name)


KEPT: Final = "profile.yaml"
"""In a run folder the profile of a file, as it was then."""


def keep_profile(profile: Profile, folder: Path) -> None:
    """Write a file's profile into a run folder, so that `stored_profile` finds it; registered ones need none.

    OSError if it cannot be written.
    """
    if "@" not in profile.name:
        return
    with replacing(folder / KEPT) as fresh:
        fresh.write_bytes(msgspec.yaml.encode(msgspec.structs.replace(profile, name="")))


def stored_profile(name: str, folder: Path) -> Profile:
    """The profile of a run by its name in the manifest; errors as from `find_profile`."""
    return _read(folder / KEPT, name) if "@" in name else _registered(name)


def row_metrics() -> tuple[str, ...]:
    """Names under which metrics stand in rows: those of the registered profiles, then all that no such profile uses."""
    terms = [term for name in PROFILES for term in find_profile(name).terms]
    used = {term.metric for term in terms}
    return tuple(dict.fromkeys((*(term.name for term in terms), *(name for name in METRICS if name not in used))))


def _read(file: Path | Traversable, name: str = "") -> Profile:
    try:
        data = yaml.safe_load(file.read_text(encoding="utf-8"))
        return msgspec.structs.replace(msgspec.convert(data, Profile), name=name)
    except OSError as error:
        raise InputError(f"cannot read the profile {file}: {error.strerror or error}; give another file") from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f", line {mark.line + 1}" if mark is not None else ""
        raise InputError(f"{file}{where}: this is not YAML: {error.problem or error.context}") from None
    except (yaml.YAMLError, msgspec.ValidationError, ValueError, RecursionError) as error:
        said = " ".join(str(error).replace("$.", "").split())
        raise InputError(f"{file}: {said}; docs/metrics.md shows what a profile looks like") from None
