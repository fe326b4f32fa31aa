"""Lane groups to SUMO edges: where a roadblock is cut so that the lanes of an edge stay side by side.

All lanes of a SUMO edge share one length, and a car that changes lanes keeps
its position on it. A roadblock is therefore cut at cross-sections between which
every lane advances at nearly the same rate, and lanes that begin or end beyond
the others get edges of their own there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from interplan_sumo.world.geometry import Floats, Polyline
from interplan_sumo.world.roads import Roadblock, Roads

CUT_M = 0.2
"""Length of the internal lane at a cut; SUMO's lanes are at least 0.1 m long."""
MISALIGNED_M = 0.5
"""How far a lane change may move a car along the road."""
RAGGED_M, RAGGED_SHARE = 5.0, 0.05
"""A lane that reaches beyond the shortest by more than both this and this share of its length is cut there."""
TAPER = 20.0
"""Smaller differences are spread over so many times their length: lanes differ by a twentieth there, nowhere else."""
SHORTEST_M = 5.0
"""No cut for alignment closer than this to another one."""
_STEP_M, _MOST_STEPS = 1.0, 500  # spacing of the cross-sections that are tried; coarser on long roads
_REACH_M = 60.0  # how far beyond its ends the reference line is extended to find ragged ends


@dataclass(frozen=True, slots=True)
class LaneStretch:
    """A stretch of a lane or connector of the map."""

    lane_id: str
    start_m: float
    end_m: float

    @property
    def length_m(self) -> float:
        return self.end_m - self.start_m


@dataclass(frozen=True, slots=True)
class Edge:
    """One SUMO edge to be: its lanes from the kerb inwards, as SUMO numbers them."""

    id: str
    from_node: str
    to_node: str
    lanes: tuple[LaneStretch, ...]


@dataclass(frozen=True, slots=True)
class Join:
    """The way across a cut, from one edge to the next along the same lane."""

    node: str
    from_edge: str
    from_lane: int
    to_edge: str
    to_lane: int
    stretch: LaneStretch


@dataclass(frozen=True, slots=True)
class LaneGroup:
    """A roadblock as SUMO edges."""

    edges: tuple[Edge, ...]
    joins: tuple[Join, ...]
    first: dict[str, tuple[str, int]]
    """Lane id -> edge and lane index where the lane begins."""
    last: dict[str, tuple[str, int]]
    """Lane id -> edge and lane index where the lane ends."""


def lane_group(roads: Roads, block: Roadblock, start_node: str, end_node: str) -> LaneGroup:
    """The edges of one roadblock between its two nodes.

    Edges that would begin and end at the same node are cut in the middle, since
    SUMO has no loops.
    """
    left_to_right = [roads.lanes[lane_id] for lane_id in block.lane_ids]
    lanes = left_to_right[::-1] if roads.driving_side == "right" else left_to_right
    ids = [lane.id for lane in lanes]
    lines = [lane.centerline for lane in lanes]
    if len(lines) == 1:
        bounds = [np.array([0.0, lines[0].length_m])]
        return _assembled(block.id, ids, bounds, [0.0], [lines[0].length_m], start_node, end_node)
    cuts = _common_cuts(lines)
    if cuts is None:  # nothing runs side by side: every lane is an edge of its own
        parts = [
            _assembled(
                f"{block.id}.l{i}",
                [lane],
                [np.array([0.0, line.length_m])],
                [0.0],
                [line.length_m],
                start_node,
                end_node,
            )
            for i, (lane, line) in enumerate(zip(ids, lines, strict=True))
        ]
        return LaneGroup(
            tuple(e for p in parts for e in p.edges),
            tuple(j for p in parts for j in p.joins),
            {k: v for p in parts for k, v in p.first.items()},
            {k: v for p in parts for k, v in p.last.items()},
        )
    lengths = [line.length_m for line in lines]
    allowed = [max(RAGGED_M, RAGGED_SHARE * length) for length in lengths]
    starts = [float(c[0]) if c[0] > a else 0.0 for c, a in zip(cuts, allowed, strict=True)]
    ends = [float(c[-1]) if n - c[-1] > a else n for c, n, a in zip(cuts, lengths, allowed, strict=True)]
    for cut, start, end in zip(cuts, starts, ends, strict=True):
        cut[0], cut[-1] = start, end
    return _assembled(block.id, ids, cuts, starts, ends, start_node, end_node, lengths)


def _common_cuts(lines: Sequence[Polyline]) -> list[Floats] | None:
    """Per lane the arc lengths of the common cross-sections, outermost included; None if there are none."""
    reference = lines[len(lines) // 2]
    first, last = reference.poses_at((0.0, reference.length_m))
    behind = first[:2] - _REACH_M * np.array([np.cos(first[2]), np.sin(first[2])])
    ahead = last[:2] + _REACH_M * np.array([np.cos(last[2]), np.sin(last[2])])
    long = Polyline(np.concatenate((behind[None], reference.points, ahead[None])))
    along: list[tuple[Floats, Floats]] = []
    for line in lines:
        arc = np.linspace(0.0, line.length_m, _count(line.length_m))
        section, _ = long.project(line.poses_at(arc)[:, :2])
        along.append((np.maximum.accumulate(section) - _REACH_M, arc))
    start, end = max(s[0] for s, _ in along), min(s[-1] for s, _ in along)
    if end - start < max(1.0, 4 * CUT_M):
        return None
    sections = np.linspace(start, end, _count(end - start))
    arcs = np.array([np.interp(sections, s, a) for s, a in along])
    spacing_m = (end - start) / (len(sections) - 1)
    final = len(sections) - 1
    ragged_m = arcs[:, 0].max(), max(n.length_m - a for n, a in zip(lines, arcs[:, -1], strict=True))
    even = _taper(ragged_m[0], spacing_m, final), final - _taper(ragged_m[1], spacing_m, final)
    bounds = sorted({0, *(even if even[0] < even[1] else ()), final})
    kept = sorted({*bounds, *(k for i, j in pairwise(bounds) for k in _aligning(arcs, i, j))})
    cuts = [row[kept].copy() for row in arcs]
    return cuts if all((np.diff(c) > 2 * CUT_M).all() for c in cuts) else None


def _count(length_m: float) -> int:
    return max(2, min(_MOST_STEPS, int(np.ceil(length_m / _STEP_M)) + 1))


def _taper(ragged_m: float, spacing_m: float, count: int) -> int:
    """How many cross-sections from a ragged end the lanes are cut, so that they run evenly from there on."""
    if ragged_m <= MISALIGNED_M:
        return 0
    sections = int(np.ceil(max(SHORTEST_M, TAPER * ragged_m) / spacing_m))
    return sections if sections * spacing_m < count * spacing_m - SHORTEST_M else 0


def _aligning(arcs: Floats, first: int, last: int) -> list[int]:
    """The columns of `arcs` (lanes, cross-sections) strictly between two of them at which to cut."""
    span = arcs[:, last] - arcs[:, first]
    if span.min() <= 0.0:
        return []
    share = (arcs[:, first : last + 1] - arcs[:, first, None]) / span[:, None]
    apart_m = np.abs(np.diff(share, axis=0)).max(axis=0) * span.mean()
    spacing_m = span.mean() / (last - first)
    margin = int(np.ceil(SHORTEST_M / max(spacing_m, 1e-6)))
    inside = apart_m[margin : len(apart_m) - margin]
    if apart_m.max() <= MISALIGNED_M or inside.size == 0:
        return []
    cut = first + margin + int(np.argmax(inside))
    return [*_aligning(arcs, first, cut), cut, *_aligning(arcs, cut, last)]


def _assembled(
    name: str,
    ids: Sequence[str],
    cuts: Sequence[Floats],
    starts: Sequence[float],
    ends: Sequence[float],
    start_node: str,
    end_node: str,
    lengths: Sequence[float] | None = None,
) -> LaneGroup:
    """Edges between the cuts, and edges of one lane where a lane reaches beyond the first or last cut."""
    lengths = list(ends) if lengths is None else lengths
    if start_node == end_node and len(cuts[0]) == 2:
        cuts = [np.array([c[0], (c[0] + c[-1]) / 2, c[-1]]) for c in cuts]
    count = len(cuts[0]) - 1
    nodes = [start_node, *(f"{name}.c{k}" for k in range(1, count)), end_node]
    names = [name] if count == 1 else [f"{name}.{k}" for k in range(count)]
    half = min(CUT_M / 2, *(float(np.diff(cut).min()) / 4 for cut in cuts))  # lanes may be as short as a cut
    longer = [start > 0.0 for start in starts]
    further = [end < length for end, length in zip(ends, lengths, strict=True)]
    edges: list[Edge] = []
    joins: list[Join] = []
    for k in range(count):
        stretches = tuple(
            LaneStretch(
                lane,
                float(cut[k]) + (half if k > 0 or longer[i] else 0.0),
                float(cut[k + 1]) - (half if k < count - 1 or further[i] else 0.0),
            )
            for i, (lane, cut) in enumerate(zip(ids, cuts, strict=True))
        )
        edges.append(Edge(names[k], nodes[k], nodes[k + 1], stretches))
    for k, (here, there) in enumerate(pairwise(edges)):
        for i, (a, b) in enumerate(zip(here.lanes, there.lanes, strict=True)):
            joins.append(Join(nodes[k + 1], here.id, i, there.id, i, LaneStretch(a.lane_id, a.end_m, b.start_m)))
    first = {lane: (names[0], i) for i, lane in enumerate(ids)}
    last = {lane: (names[-1], i) for i, lane in enumerate(ids)}
    for i, lane in enumerate(ids):
        if longer[i]:
            pads = _pads(f"{name}.s{i}", lane, 0.0, edges[0].lanes[i].start_m - CUT_M, start_node)
            edges += pads.edges
            joins += pads.joins
            final = pads.edges[-1]
            stretch = LaneStretch(lane, final.lanes[0].end_m, edges[0].lanes[i].start_m)
            joins.append(Join(start_node, final.id, 0, names[0], i, stretch))
            first[lane] = pads.first[lane]
        if further[i]:
            pads = _pads(f"{name}.e{i}", lane, edges[count - 1].lanes[i].end_m + CUT_M, float(lengths[i]), end_node)
            edges += pads.edges
            joins += pads.joins
            initial = pads.edges[0]
            stretch = LaneStretch(lane, edges[count - 1].lanes[i].end_m, initial.lanes[0].start_m)
            joins.append(Join(end_node, names[-1], i, initial.id, 0, stretch))
            last[lane] = pads.last[lane]
    return LaneGroup(tuple(edges), tuple(joins), first, last)


def _pads(name: str, lane: str, start_m: float, end_m: float, node: str) -> LaneGroup:
    """A stretch of one lane that begins and ends at the same node, as two edges."""
    middle = (start_m + end_m) / 2
    cut = f"{name}.c"
    before = Edge(f"{name}a", node, cut, (LaneStretch(lane, start_m, middle - CUT_M / 2),))
    after = Edge(f"{name}b", cut, node, (LaneStretch(lane, middle + CUT_M / 2, end_m),))
    across = Join(cut, before.id, 0, after.id, 0, LaneStretch(lane, before.lanes[0].end_m, after.lanes[0].start_m))
    return LaneGroup((before, after), (across,), {lane: (before.id, 0)}, {lane: (after.id, 0)})
