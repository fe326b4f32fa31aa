"""Tiny foreign maps, drawn by hand: straight lanes, forks, merges, crossings."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from interplan_sumo.maps.importers.fidelity import count_of
from interplan_sumo.maps.importers.source import SourceCount, SourceLane, SourceMap
from interplan_sumo.world.geometry import Floats

WIDTH_M = 3.5
ORIGIN_M = np.array((500_000.0, 4_000_000.0))
"""Where the tiny worlds lie in UTM."""


def line(*points: Sequence[float]) -> Floats:
    """Points in the frame of the tiny world, as map metres."""
    return np.array(points, dtype=np.float64) + ORIGIN_M


def lane(id: str, middle: Sequence[Sequence[float]], width_m: float = WIDTH_M, **facts: Any) -> SourceLane:
    """A lane of even width along straight pieces."""
    points = np.array(middle, dtype=np.float64)
    ahead = np.gradient(points, axis=0)
    length = np.hypot(ahead[:, 0], ahead[:, 1])[:, None]
    normal = np.stack((-ahead[:, 1], ahead[:, 0]), axis=1) / length * width_m / 2.0
    return SourceLane(id, line(*(points + normal)), line(*(points - normal)), **facts)


def straight(id: str, start_m: float, end_m: float, y_m: float = 0.0, **facts: Any) -> SourceLane:
    """A lane to the east, or to the west if it ends before it starts."""
    return lane(id, ((start_m, y_m), (end_m, y_m)), **facts)


def linked(lanes: Iterable[SourceLane], links: Iterable[tuple[str, str]]) -> dict[str, SourceLane]:
    """The lanes with these links, by id."""
    found = {each.id: each for each in lanes}
    for here, there in links:
        if here in found:
            found[here] = replace(found[here], successors=(*found[here].successors, there))
        if there in found:
            found[there] = replace(found[there], predecessors=(*found[there].predecessors, here))
    return found


def neighbours(lanes: dict[str, SourceLane], *left_to_right: str) -> dict[str, SourceLane]:
    """The lanes, some of them side by side."""
    found = dict(lanes)
    for left, right in pairwise(left_to_right):
        found[left] = replace(found[left], right_neighbour=right)
        found[right] = replace(found[right], left_neighbour=left)
    return found


def world(lanes: dict[str, SourceLane], **facts: Any) -> SourceMap:
    """A map of these lanes."""
    return SourceMap("tiny", "hand", "EPSG:32631", "right", lanes, **facts)


def bend(radius_m: float, turn_rad: float, start: tuple[float, float], heading_rad: float = 0.0) -> list[list[float]]:
    """Points of an arc, to the left for a positive turn."""
    angles = np.linspace(0.0, turn_rad, max(8, int(abs(turn_rad) * 16)))
    side = np.sign(turn_rad)
    x = radius_m * np.sin(np.abs(angles))
    y = side * radius_m * (1.0 - np.cos(angles))
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    return [[start[0] + cos * a - sin * b, start[1] + sin * a + cos * b] for a, b in zip(x, y, strict=True)]


def road_of_two() -> SourceMap:
    """Two lanes side by side, in two rows that follow one another."""
    rows = [
        straight("a1", 0, 50),
        straight("b1", 0, 50, -WIDTH_M),
        straight("a2", 50, 120),
        straight("b2", 50, 120, -WIDTH_M),
    ]
    lanes = linked(rows, (("a1", "a2"), ("b1", "b2")))
    return world(neighbours(neighbours(lanes, "a1", "b1"), "a2", "b2"))


def fork() -> SourceMap:
    """A lane that leads straight on, and off to the left in a bend of 20 m."""
    turn = bend(20.0, np.pi / 2.0, (60.0, 0.0))
    ahead = [*turn, [turn[-1][0], turn[-1][1] + 40.0]]
    lanes = [straight("in", 0, 60), straight("on", 60, 140), lane("off", ahead)]
    return world(linked(lanes, (("in", "on"), ("in", "off"))))


def crossing() -> SourceMap:
    """Two one-way streets that cross, neither divided where they do."""
    return world({"east": straight("east", 0, 100), "north": lane("north", ((50.0, -50.0), (50.0, 50.0)))})


def junction_with_flags() -> SourceMap:
    """An approach of one lane, an intersection that the file names with a way on and a turn, and two exits."""
    turn = bend(10.0, -np.pi / 2.0, (50.0, 0.0))
    end = turn[-1]
    lanes = [
        straight("in", 0, 50, speed_limit_mps=13.0),
        straight("through", 50, 70, in_intersection=True, speed_limit_mps=13.0),
        lane("turn", turn, in_intersection=True, speed_limit_mps=8.0),
        straight("out", 70, 130, speed_limit_mps=13.0),
        lane("side", ((end[0], end[1]), (end[0], end[1] - 40.0)), speed_limit_mps=8.0),
    ]
    return world(linked(lanes, (("in", "through"), ("in", "turn"), ("through", "out"), ("turn", "side"))))


def assert_as_counted(source: SourceMap, count: SourceCount) -> None:
    """Two readings of one file find the same lanes, links, crosswalks and others, and lanes of the same length."""
    own = count_of(source)
    assert own.lane_length_m.keys() == count.lane_length_m.keys()
    assert (own.links, own.leaving) == (count.links, count.leaving)
    assert (own.crosswalks, own.left_out) == (count.crosswalks, count.left_out)
    assert own.lane_length_m == pytest.approx(count.lane_length_m, rel=0.05, abs=1.5)
    assert sum(own.lane_length_m.values()) == pytest.approx(sum(count.lane_length_m.values()), rel=0.01)
