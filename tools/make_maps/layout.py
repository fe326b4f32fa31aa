"""From a plan to blocks: where each road is cut, and which lanes lie between the cuts.

Everything here is in the frame of a road: stations along its axis, and
*outward* distances from the axis towards the kerb of the direction in question.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from tools.make_maps.junction_arms import PlannedArm, planned_arms
from tools.make_maps.plan import (
    JOINT_M,
    MAX_BLOCK_M,
    Carriageway,
    Direction,
    LaneStrip,
    Plan,
    PlannedApproach,
    PlannedJunction,
    Road,
    carriageway_at,
    strips,
)

SHORTEST_BLOCK_M = 6.0


@dataclass(frozen=True, slots=True)
class Block:
    """A roadblock to be: constant lanes between two stations, given in the direction of travel."""

    road: str
    direction: Direction
    piece: int
    """1, 2, ... along the direction of travel."""
    from_m: float
    to_m: float
    strips: tuple[LaneStrip, ...]
    """From the inner lane to the kerb."""
    carriageway: Carriageway
    inner_pockets: int = 0
    kerb_pockets: int = 0
    widened: bool = False
    """Near a junction, where pockets take the room of parked cars."""

    @property
    def low_m(self) -> float:
        return min(self.from_m, self.to_m)

    @property
    def high_m(self) -> float:
        return max(self.from_m, self.to_m)


@dataclass(frozen=True, slots=True)
class Joint:
    """Two blocks of one carriageway that follow one another without a junction."""

    before: Block
    after: Block


@dataclass(frozen=True, slots=True)
class Arm:
    """One road's end at a junction."""

    key: str
    road: str
    sign: int
    """+1 where the road leads on to higher stations, -1 to lower ones."""
    cut_m: float
    arriving: Block | None
    leaving: Block | None


@dataclass(frozen=True)
class Layout:
    """All blocks of a plan and how they meet."""

    blocks: tuple[Block, ...]
    joints: tuple[Joint, ...]
    arms: Mapping[int, tuple[Arm, ...]] = field(default_factory=dict[int, tuple[Arm, ...]])
    """Arms by number of the junction, in the order in which the plan names the roads, minus before plus."""


@dataclass(frozen=True, slots=True)
class _Link:
    """A stretch of road between two junctions, or a junction and the edge of the map."""

    low_m: float
    high_m: float
    low: tuple[PlannedJunction, PlannedArm] | None
    """The junction at the lower station, with the arm in which the link ends."""
    high: tuple[PlannedJunction, PlannedArm] | None


def _links(plan: Plan, direction: Direction) -> dict[str, list[_Link]]:
    """The links of each road as its traffic in one direction sees them, in order of station."""
    met: dict[str, list[tuple[float, PlannedJunction, Mapping[str, PlannedArm]]]] = {
        road.name: [] for road in plan.roads
    }
    for junction in plan.junctions:
        arms = planned_arms(plan, junction)
        for name in junction.roads:
            if junction.takes(name, direction):
                station_m = next(arm.station_m for arm in arms.values() if arm.road.name == name)
                met[name].append((station_m, junction, arms))
    return {road.name: _links_of(road, sorted(met[road.name], key=lambda m: m[0])) for road in plan.roads}


def _links_of(road: Road, met: Sequence[tuple[float, PlannedJunction, Mapping[str, PlannedArm]]]) -> list[_Link]:
    links: list[_Link] = []
    start: tuple[PlannedJunction, PlannedArm] | None = None
    start_m, ended = 0.0, False
    for _, junction, arms in met:
        below, above = arms.get(f"{road.name}-"), arms.get(f"{road.name}+")
        if below is not None:
            cut_m = road.axis.snapped_m(below.cut_m)
            if cut_m - start_m < SHORTEST_BLOCK_M:
                missing_m = SHORTEST_BLOCK_M - (cut_m - start_m)
                after = f" after {start[0].name}" if start is not None else ""
                raise ValueError(f"{road.name}: {missing_m:.1f} m too little{after} before {junction.name}")
            links.append(_Link(start_m, cut_m, start, (junction, below)))
        ended = above is None
        if above is not None:
            start, start_m = (junction, above), road.axis.snapped_m(above.cut_m)
    if not ended:
        links.append(_Link(start_m, road.axis.length_m, start, None))
    return links


@dataclass(frozen=True, slots=True)
class _Stretch:
    """Constant lanes over travelled distances; `t` is the station, or its negative when driving backward."""

    from_t: float
    to_t: float
    carriageway: Carriageway
    approach: PlannedApproach | None
    pushed_m: float


def _stretches(road: Road, direction: Direction, link: _Link) -> list[_Stretch]:
    """One carriageway of a link, cut where its lanes change; the gaps between stretches are the tapers."""
    forward = direction == "forward"
    start, end = (link.low, link.high) if forward else (link.high, link.low)
    start_t, end_t = (link.low_m, link.high_m) if forward else (-link.high_m, -link.low_m)
    gaps: list[tuple[float, float]] = []
    for before, after in pairwise(road.sections):
        one, other = (before.forward, after.forward) if forward else (before.backward, after.backward)
        if one != other and link.low_m < after.from_m < link.high_m:
            gaps.append((after.from_m if forward else -after.from_m, after.taper_m))
    gaps += [(c.at_m if forward else -c.at_m, JOINT_M) for c in road.crossings if link.low_m < c.at_m < link.high_m]
    bounds = [start_t, *(t + sign * length_m / 2.0 for t, length_m in sorted(gaps) for sign in (-1, 1)), end_t]
    leaving = start[1] if start is not None and start[1].pushed_m else None
    if leaving is not None:
        bounds[1:1] = [start_t + widened_m for widened_m in leaving.approach.widened_m]
    arriving = end[1] if end is not None and (end[1].approach.pockets or end[1].pushed_m) else None
    if arriving is not None:
        bounds[-1:-1] = [end_t - widened_m for widened_m in reversed(arriving.approach.widened_m)]
    found: list[_Stretch] = []
    for from_t, to_t in zip(bounds[::2], bounds[1::2], strict=True):
        if to_t - from_t < SHORTEST_BLOCK_M:
            raise ValueError(f"{road.name} {direction}: no room for lanes between {from_t:.0f} and {to_t:.0f} m")
        carriageway = carriageway_at(road, direction, abs((from_t + to_t) / 2.0))
        assert carriageway is not None, "a carriageway ends at a junction"
        if arriving is not None and to_t == end_t:
            found.append(_Stretch(from_t, to_t, carriageway, arriving.approach, arriving.pushed_m))
        else:
            pushed_m = leaving.pushed_m if leaving is not None and from_t == start_t else 0.0
            found.append(_Stretch(from_t, to_t, carriageway, None, pushed_m))
    return found


def _cut_evenly(stretch: _Stretch) -> list[tuple[float, float]]:
    length_t = stretch.to_t - stretch.from_t
    count = int(np.ceil(length_t / MAX_BLOCK_M))
    each_t = (length_t - (count - 1) * JOINT_M) / count
    return [
        (stretch.from_t + i * (each_t + JOINT_M), stretch.from_t + i * (each_t + JOINT_M) + each_t)
        for i in range(count)
    ]


def layout(plan: Plan) -> Layout:
    """Cut all roads into blocks; ValueError says where a plan leaves no room."""
    blocks: list[Block] = []
    joints: list[Joint] = []
    at_arm: dict[tuple[int, str, bool], Block] = {}
    directions: tuple[Direction, Direction] = ("forward", "backward")
    links = {direction: _links(plan, direction) for direction in directions}
    for road in plan.roads:
        for direction in directions:
            piece = 0
            own = links[direction][road.name]
            for link in own if direction == "forward" else reversed(own):
                if carriageway_at(road, direction, (link.low_m + link.high_m) / 2.0) is None:
                    continue
                row: list[Block] = []
                for stretch in _stretches(road, direction, link):
                    for from_t, to_t in _cut_evenly(stretch):
                        piece += 1
                        row.append(_block(road, direction, piece, stretch, abs(from_t), abs(to_t)))
                blocks += row
                joints += [Joint(a, b) for a, b in pairwise(row)]
                start, end = (link.low, link.high) if direction == "forward" else (link.high, link.low)
                if start is not None:
                    at_arm[start[0].number, start[1].key, False] = row[0]
                if end is not None:
                    at_arm[end[0].number, end[1].key, True] = row[-1]
    arms: dict[int, tuple[Arm, ...]] = {}
    for junction in plan.junctions:
        found: list[Arm] = []
        for name in junction.roads:
            for sign, key in ((-1, f"{name}-"), (1, f"{name}+")):
                arriving = at_arm.get((junction.number, key, True))
                leaving = at_arm.get((junction.number, key, False))
                known = arriving or leaving
                if known is not None:
                    found.append(Arm(key, name, sign, known.high_m if sign < 0 else known.low_m, arriving, leaving))
        arms[junction.number] = tuple(found)
    return Layout(tuple(blocks), tuple(joints), arms)


def _block(road: Road, direction: Direction, piece: int, stretch: _Stretch, from_m: float, to_m: float) -> Block:
    approach = stretch.approach
    return Block(
        road=road.name,
        direction=direction,
        piece=piece,
        from_m=road.axis.snapped_m(from_m),
        to_m=road.axis.snapped_m(to_m),
        strips=strips(stretch.carriageway, approach, stretch.pushed_m),
        carriageway=stretch.carriageway,
        inner_pockets=approach.inner_pockets if approach else 0,
        kerb_pockets=approach.kerb_pockets if approach else 0,
        widened=stretch.pushed_m > 0.0 or (approach is not None and approach.pockets > 0),
    )
