"""Curves: panels of a page in which each planner has a line, marks and intervals, as figures of SVG."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

WIDE, HIGH = 300.0, 170.0
"""Of a panel, in its own units."""
LEFT: Final = 34.0
"""For the numbers of the axis upwards."""
MARGIN: Final = 26.0
"""Between the ends of the axis along and what is drawn at them."""
APART: Final = 9.0
"""Between planners at one place."""


@dataclass(frozen=True, slots=True)
class CurveMark:
    """A figure at its place, with its interval as a bar; hollow where it has none."""

    x: float
    y: float
    bar: str
    hollow: bool
    title: str


@dataclass(frozen=True, slots=True)
class PlannerCurve:
    """What one planner has in a panel."""

    name: str
    colour: int
    path: str
    """A line; empty without one."""
    band: str
    """Around the line; empty without one."""
    marks: tuple[CurveMark, ...]


@dataclass(frozen=True, slots=True)
class CurvePanel:
    """One panel with ticks along both axes."""

    title: str
    planners: tuple[PlannerCurve, ...]
    along: tuple[tuple[float, str], ...]
    upwards: tuple[tuple[float, str], ...]
    axis: str
    """What stands below."""
    about: str
    """In words, for who cannot see it."""


def line_through(points: Sequence[tuple[float, float]]) -> str:
    """A line in SVG's words; empty if it is only a step upwards."""
    if len({x for x, _ in points}) < 2:
        return ""
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points)


def place_along(number: int, count: int) -> float:
    """Of one of several places that lie evenly along the axis."""
    return LEFT + MARGIN + (WIDE - LEFT - 2.0 * MARGIN) * (number / (count - 1) if count > 1 else 0.5)


def aside(number: int, count: int) -> float:
    """How far one of several planners is drawn from its place, so that bars do not hide one another."""
    return (number - (count - 1) / 2.0) * min(APART, 2.0 * MARGIN / count)


def height(value: float, low: float, high: float) -> float:
    """Of a value on an axis that reaches from `low` to `high`."""
    return HIGH * (1.0 - min(max((value - low) / (high - low), 0.0), 1.0))


def bar_between(x: float, low: float, high: float) -> str:
    """The bar of an interval, in SVG's words."""
    return f"M{x:.1f} {low:.1f}V{high:.1f}"
