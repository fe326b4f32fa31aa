"""Ways: every path from one lane to the next over the pieces between them, as connectors to be."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from interplan_sumo.maps.foreign.pieces import Links, Piece
from interplan_sumo.maps.foreign.ribbon import Ribbon, bridge
from interplan_sumo.maps.foreign.sections import Section

MEETING_M = 0.3
"""Ends that lie no further apart than this are moved together; over a wider gap a curve is drawn."""
FARTHEST_M = 80.0
"""No way is drawn over a wider gap: such a link is a fault of the file."""
MOST_PARTS = 24
"""Pieces in one way; longer chains of overlaps do not occur on roads."""


class Node(NamedTuple):
    """One lane of one piece of a section."""

    section: int
    piece: int
    lane: int


@dataclass(frozen=True, eq=False)
class Way:
    """A path from the end of one lane to the start of another."""

    start: Node
    parts: tuple[Node, ...]
    """The pieces between; none where only a gap lies between the two."""
    end: Node
    ribbon: Ribbon
    """Of one lane, from end to start exactly."""
    drawn_m: tuple[float, ...]
    """Length of the curve drawn over a gap before each part and before the end; 0 where both meet."""


@dataclass(eq=False)
class Ground:
    """The pieces of a map, with the surface of each."""

    sections: Sequence[Section]
    pieces: Sequence[Sequence[Piece]]
    links: Links
    torn: list[tuple[Node, Node, float]] = field(default_factory=list[tuple[Node, Node, float]])
    """Links over a gap too wide to be one, with its width in metres."""
    _ribbons: dict[tuple[int, int], Ribbon] = field(default_factory=dict[tuple[int, int], Ribbon])

    def piece(self, node: Node) -> Piece:
        return self.pieces[node.section][node.piece]

    def surface(self, section: int, piece: int) -> Ribbon:
        """The ribbon of a piece."""
        key = section, piece
        if key not in self._ribbons:
            part = self.pieces[section][piece]
            ribbon = self.sections[section].ribbon.cut(part.start_m, part.end_m)
            self._ribbons[key] = ribbon.uncrossed() if ribbon.lanes == 1 else ribbon
        return self._ribbons[key]

    def ribbon(self, node: Node) -> Ribbon:
        """The ribbon of one lane of a piece."""
        return self.surface(node.section, node.piece).lane(node.lane)

    def nodes(self) -> Iterator[Node]:
        for s, parts in enumerate(self.pieces):
            for p in range(len(parts)):
                for i in range(self.sections[s].lanes):
                    yield Node(s, p, i)

    def following(self, node: Node) -> tuple[Node, ...]:
        """The nodes into which a node leads."""
        if node.piece + 1 < len(self.pieces[node.section]):
            return (Node(node.section, node.piece + 1, node.lane),)
        ahead = self.links.ahead.get((node.section, node.lane), ())
        return tuple(Node(s, 0, i) for s, i in ahead)


def ways(ground: Ground) -> tuple[Way, ...]:
    """All ways of a map; of several between the same two lanes the shortest, since SUMO knows one."""
    best: dict[tuple[Node, Node], Way] = {}
    torn: dict[tuple[Node, Node], float] = {}
    for start in ground.nodes():
        if not ground.piece(start).is_lane:
            continue
        for parts, end in _paths(ground, start):
            way = _way(ground, (start, *parts, end), torn)
            known = best.get((start, end))
            if way is not None and (known is None or way.ribbon.length_m < known.ribbon.length_m):
                best[start, end] = way
    ground.torn.extend((a, b, gap_m) for (a, b), gap_m in torn.items())
    return tuple(best.values())


def _paths(ground: Ground, start: Node) -> Iterator[tuple[tuple[Node, ...], Node]]:
    """Every path from a lane to a lane: the pieces between, and where it ends."""
    stack: list[tuple[Node, ...]] = [(node,) for node in reversed(ground.following(start))]
    while stack:
        path = stack.pop()
        if ground.piece(path[-1]).is_lane:
            yield path[:-1], path[-1]
        elif len(path) <= MOST_PARTS:
            stack += [(*path, node) for node in reversed(ground.following(path[-1])) if node not in path]


def _way(ground: Ground, path: Sequence[Node], torn: dict[tuple[Node, Node], float]) -> Way | None:
    """What lies between the first and the last lane of a path; None where the path is torn."""
    found: Ribbon | None = None
    drawn_m: list[float] = []
    before = ground.ribbon(path[0])
    for here, there in pairwise(path):
        after = ground.ribbon(there)
        gap_m = float(np.hypot(*(after.middles[0, 0] - before.middles[-1, 0])))
        if gap_m > FARTHEST_M:
            torn[here, there] = gap_m
            return None
        if gap_m > MEETING_M:
            curve = bridge(before, after)
            found = curve if found is None else found.joined(curve)
        drawn_m.append(gap_m if gap_m > MEETING_M else 0.0)
        if there != path[-1]:
            found = after if found is None else found.joined(after)
        before = after
    if found is None:  # two lanes that meet, with nothing between: cannot be, joints give each a piece
        return None
    start, end = ground.ribbon(path[0]).middles[-1, 0], ground.ribbon(path[-1]).middles[0, 0]
    whole = found.moved(start - found.middles[0, 0], end - found.middles[-1, 0]).uncrossed()
    return Way(path[0], tuple(path[1:-1]), path[-1], whole, tuple(drawn_m))
