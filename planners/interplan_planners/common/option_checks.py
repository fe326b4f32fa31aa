"""Option checks: what the numbers of a planner's options may be."""

from __future__ import annotations


def more_than_0(**options: float) -> None:
    """ValueError for one that is not."""
    for name, value in options.items():
        if not value > 0:
            raise ValueError(f"{name} is {value}, expected more than 0")


def at_least_0(**options: float) -> None:
    """ValueError for one that is not."""
    for name, value in options.items():
        if not value >= 0:
            raise ValueError(f"{name} is {value}, expected 0 or more")
