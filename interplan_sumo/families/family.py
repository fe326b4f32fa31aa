"""Family: everything that the benchmark knows about one kind of scenario, declared in one place."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, NoReturn, TypeAlias, TypeVar

if TYPE_CHECKING:  # names of families are listed often, and that is to be quick
    from interplan_sumo.families.draws import Draws
    from interplan_sumo.scenario.scenario import Scenario
    from interplan_sumo.world.roads import Roads

Place = TypeVar("Place")
StartCheck: TypeAlias = "Callable[[Scenario, Roads], list[str]]"
"""What is wrong with a scenario before anybody drives it, one sentence each: which field, what would be right."""

LAST = 1000
"""Where a family stands that does not say where."""


def _nothing(_scenario: Scenario) -> Collection[int]:
    return ()


def _nowhere(*_: object) -> NoReturn:
    from interplan_sumo.scenario.sites import UnsuitableError

    raise UnsuitableError("scenarios of this family are not drawn")


@dataclass(frozen=True, kw_only=True)
class Family(Generic[Place]):
    """A kind of scenario. Its name is that of its entry point in the group `interplan_sumo.families`."""

    title: str
    """As tables and pages name it."""
    description: str = ""
    """One sentence: what it asks of a planner."""
    suitable: Callable[[Roads, str, float], Place] = _nowhere
    """What a place (lane, arc length) of a map offers, often a `Site`; UnsuitableError says why it does not do."""
    drawn: Callable[[str, Roads, Place, Draws], Scenario] = _nowhere
    """A new scenario with an id at such a place; UnsuitableError or ScenarioError if what was drawn finds no room."""

    telling: tuple[str, ...] = ()
    """The two draws that tell its scenes apart best: a search spreads over them, an atlas shows them."""
    draws_as: str = ""
    """Families that share this name draw alike: equal seeds give the same places; default: its own name."""
    restaged: Callable[[Scenario], Scenario] | None = None
    """A scene of a family that draws alike as one of this family, its id apart; needed if there are such families."""

    order: int = LAST
    """Where it stands in tables, listings and `all`: ours at 10, 20, ...; equal ones by name."""
    column: str = ""
    """The heading of its column in the table; default: the title."""
    column_key: str = ""
    """The name of its column in files; default: its name."""
    ordinary: bool = False
    """Whether it is ordinary driving, which has one column for all and no part in the mean of the benchmark."""
    on_request: bool = False
    """Whether it is made only if it is asked for by name, not as one of `all` or `ordinary`."""
    changes_lanes: bool = False
    """Whether the columns about drivable area, goal lane and collisions are taken over it, too."""

    checks: tuple[StartCheck, ...] = ()
    """Its own start checks, besides those of every scenario."""
    may_overlap: Callable[[Scenario], Collection[int]] = _nothing
    """Indices of the obstacles that may overlap one another."""
    exempt: tuple[str, ...] = ()
    """Gates that are not judged in its scenarios."""
    weighs_direction: bool = False
    """Whether interPlan's published code weighs the driving direction of its drives instead of gating it."""

    asks: Callable[[Scenario, Roads], bool] | None = None
    """Whether a scenario, whatever its family, asks what this one asks: the audit goes by what is in it."""
    audit_class: str = ""
    """What the audit calls that; default: the title."""
    original: str = ""
    """The type of scenario, or the modification, that stands for it in interPlan's own configuration."""
