"""The families of scenarios: one module each, found by entry point, ours and those that other packages add.

A family is declared once, as a `Family`; whoever needs to know something about one asks for it by its name, with
`find_family`, or goes through `families()`. No other module names one.
"""

from __future__ import annotations

from functools import cache
from typing import Any, Final

from interplan_sumo.families.family import Family, StartCheck
from interplan_sumo.registry import Registry

FAMILIES: Final = Registry[Family[Any]]("interplan_sumo.families", "family", Family)
"""By name; each is imported when it is asked for. UnknownNameError with the nearest name for one that is not there."""


@cache
def families() -> dict[str, Family[Any]]:
    """All of them by name, in their own order: those of the benchmark, ordinary driving, then those without one."""
    return dict(sorted(FAMILIES.items(), key=lambda item: (item[1].order, item[0])))


@cache
def find_family(name: str) -> Family[Any]:
    """One by its name; with everything as usual, and the name as its title, if it is not installed."""
    return FAMILIES[name] if name in FAMILIES else Family(title=name)


def names(*, ordinary: bool) -> tuple[str, ...]:
    """The families of ordinary driving, or the others, in order, without those that are made on request only."""
    found = families()
    return tuple(name for name, each in found.items() if each.ordinary == ordinary and not each.on_request)


def original_names() -> dict[str, str]:
    """The family here of each type of scenario, or modification, that interPlan's own configuration names."""
    return {each.original: name for name, each in families().items() if each.original}


def named_family(id: str) -> str:
    """By which a scenario is called: ids are `family/number`, or `map.family/number` where one was made for a map."""
    return id.partition("/")[0].rpartition(".")[2]


__all__ = ["FAMILIES", "Family", "StartCheck", "families", "find_family", "named_family", "names", "original_names"]
