"""Registry: what installed packages add to the benchmark, by entry point.

A package adds a planner, a family of scenarios, a metric, a scoring profile, a map format or a recording format by
naming it in its `pyproject.toml` under the group of the registry; ours stand in our own, in the same way.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from typing import Generic, TypeVar

from interplan_sumo.errors import InputError, UnknownNameError

T = TypeVar("T")

INSTALL_HINT = "Just added it to pyproject.toml? Run: pip install -e ."


class Registry(Mapping[str, T], Generic[T]):
    """The entry points of one group by name, in the order of their names; each is imported when it is asked for."""

    def __init__(self, group: str, what: str, kind: type[T] | None = None, hint: str = INSTALL_HINT) -> None:
        """`what` is the word for one of them in messages, `kind` what each must be an instance of."""
        self.group = group
        self._what = what
        self._kind = kind
        self._hint = hint
        self._loaded: dict[str, T] = {}

    @cached_property
    def points(self) -> Mapping[str, EntryPoint]:
        """The entry points, not imported; InputError if two packages claim a name."""
        found: dict[str, EntryPoint] = {}
        for point in entry_points(group=self.group):
            other = found.setdefault(point.name, point)
            if other.value != point.value:
                raise InputError(
                    f"{self._what} name {point.name!r} is claimed by {source_of(other)} and by {source_of(point)}; "
                    "uninstall one"
                )
        return dict(sorted(found.items()))

    def point(self, name: str) -> EntryPoint:
        """One of them, not imported; UnknownNameError with the nearest name."""
        if name not in self.points:
            raise UnknownNameError(self._what, name, self.points, self._hint)
        return self.points[name]

    def __getitem__(self, name: str) -> T:
        """One of them, imported. UnknownNameError if there is none, InputError if it is broken or another thing."""
        if name not in self._loaded:
            point = self.point(name)
            try:
                found = point.load()
            except Exception as error:
                raise InputError(
                    f"{self._what} {name!r} of {source_of(point)} cannot be imported: {type(error).__name__}: {error}"
                ) from error
            if self._kind is not None and not isinstance(found, self._kind):
                raise InputError(
                    f"{self._what} {name!r} of {source_of(point)} is a {type(found).__name__}, "
                    f"expected a {self._kind.__name__}"
                )
            self._loaded[name] = found
        return self._loaded[name]

    def __contains__(self, name: object) -> bool:
        return name in self.points

    def __iter__(self) -> Iterator[str]:
        return iter(self.points)

    def __len__(self) -> int:
        return len(self.points)


def source_of(point: EntryPoint) -> str:
    """The package that an entry point belongs to."""
    return point.dist.name if point.dist is not None else point.value
