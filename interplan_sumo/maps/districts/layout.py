"""From a plan to blocks: where each road is cut, and which lanes lie between the cuts.

Everything here is in the frame of a road: stations along its axis, and
*outward* distances from the axis towards the kerb of the direction in question.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from interplan_sumo.maps.districts.plan import JOINT_M, Approach, Direction, Junction, Plan, Road, Way
from interplan_sumo.maps.districts.sections import Strip, strips, way_at
from interplan_sumo.maps.districts.setbacks import STUB_M, junction_middle, setbacks_m

SHORTEST_BLOCK_M = 12.0


@dataclass(frozen=True, slots=True)
class Block:
    """A roadblock to be: constant lanes between two stations, given in the direction of travel."""

    road: str
    direction: Direction
    piece: int
    """1, 2, ... along the direction of travel."""
    from_m: float
    to_m: float
    strips: tuple[Strip, ...]
    """From the inner lane to the kerb."""
    way: Way
    inner_pockets: int = 0
    kerb_pockets: int = 0

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
class _Meeting:
    """A junction as one road sees it."""

    junction: Junction
    station_m: float
    low_cut_m: float
    """Where the road ends on the lower side; its own start if it begins here."""
    high_cut_m: float


def _meetings(plan: Plan) -> dict[str, list[_Meeting]]:
    """The junctions along each road, in order of station."""
    found: dict[str, list[_Meeting]] = {road.name: [] for road in plan.roads}
    for junction in plan.junctions:
        reach_m = setbacks_m(plan, junction)
        for name in junction.roads:
            road = plan.road[name]
            station_m = road.axis.station_of(*junction_middle(plan, junction))
            low = reach_m.get(f"{name}-")
            high = reach_m.get(f"{name}+")
            if low is None and high is None:
                raise ValueError(f"junction {junction.name}: road {name} does not reach it")
            found[name].append(
                _Meeting(
                    junction,
                    station_m,
                    road.axis.snapped_m(station_m - low) if low is not None else 0.0,
                    road.axis.snapped_m(station_m + high) if high is not None else road.axis.length_m,
                )
            )
    return {name: sorted(meetings, key=lambda m: m.station_m) for name, meetings in found.items()}


def _links(road: Road, meetings: list[_Meeting]) -> list[tuple[float, float, Junction | None, Junction | None]]:
    """Stretches of a road between junctions: stations, and the junction at either end."""
    links: list[tuple[float, float, Junction | None, Junction | None]] = []
    at_m, behind = 0.0, None
    for meeting in meetings:
        if meeting.station_m > STUB_M:  # else the road begins here
            if meeting.low_cut_m - at_m < SHORTEST_BLOCK_M:
                raise ValueError(f"{road.name}: no room before junction {meeting.junction.name}")
            links.append((at_m, meeting.low_cut_m, behind, meeting.junction))
        at_m, behind = meeting.high_cut_m, meeting.junction
    if not meetings or meetings[-1].station_m < road.axis.length_m - STUB_M:
        links.append((at_m, road.axis.length_m, behind, None))
    return links


@dataclass(frozen=True, slots=True)
class _Stretch:
    """Constant lanes over travelled distances; `t` is the station, or its negative when driving backward."""

    from_t: float
    to_t: float
    way: Way
    approach: Approach | None


def _stretches(
    road: Road, direction: Direction, low_m: float, high_m: float, approach: Approach | None
) -> list[_Stretch]:
    """One carriageway between two junctions, cut where its lanes change; gaps are the tapers."""
    forward = direction == "forward"
    start_t, end_t = (low_m, high_m) if forward else (-high_m, -low_m)
    changes: list[tuple[float, float]] = []
    for before, after in pairwise(road.sections):
        one, other = (before.forward, after.forward) if forward else (before.backward, after.backward)
        if one != other and low_m < after.from_m < high_m:
            changes.append((after.from_m if forward else -after.from_m, after.taper_m))
    pedestrian = [(c.at_m if forward else -c.at_m, JOINT_M) for c in road.crossings if low_m < c.at_m < high_m]
    gaps = [(t - length_m / 2.0, t + length_m / 2.0) for t, length_m in sorted(changes + pedestrian)]
    pockets = approach if approach and approach.inner_pockets + approach.kerb_pockets else None
    if pockets:
        gaps.append((end_t - pockets.storage_m - pockets.taper_m, end_t - pockets.storage_m))
    bounds = [start_t, *(t for gap in gaps for t in gap), end_t]
    found: list[_Stretch] = []
    for i, (from_t, to_t) in enumerate(zip(bounds[::2], bounds[1::2], strict=True)):
        if to_t - from_t < SHORTEST_BLOCK_M:
            raise ValueError(f"{road.name} {direction}: no room for lanes between {from_t:.0f} and {to_t:.0f} m")
        way = way_at(road, direction, abs((from_t + to_t) / 2.0))
        if way is None:
            raise ValueError(f"{road.name} {direction}: the carriageway ends in the middle of nowhere")
        last = i == len(bounds) // 2 - 1
        found.append(_Stretch(from_t, to_t, way, pockets if last else None))
    return found


def _cut_evenly(stretch: _Stretch, max_block_m: float) -> list[tuple[float, float]]:
    length_t = stretch.to_t - stretch.from_t
    count = int(np.ceil(length_t / max_block_m))
    each_t = (length_t - (count - 1) * JOINT_M) / count
    return [
        (stretch.from_t + i * (each_t + JOINT_M), stretch.from_t + i * (each_t + JOINT_M) + each_t)
        for i in range(count)
    ]


def layout(plan: Plan) -> Layout:
    """Cut all roads into blocks; ValueError says where a plan leaves no room."""
    meetings = _meetings(plan)
    blocks: list[Block] = []
    joints: list[Joint] = []
    at_end: dict[tuple[int, str, str], Block] = {}
    for road in plan.roads:
        links = _links(road, meetings[road.name])
        directions: tuple[Direction, Direction] = ("forward", "backward")
        for direction in directions:
            piece = 0
            for low_m, high_m, low, high in links if direction == "forward" else reversed(links):
                if way_at(road, direction, (low_m + high_m) / 2.0) is None:
                    continue
                start, end = (low, high) if direction == "forward" else (high, low)
                end_key = f"{road.name}{'-' if direction == 'forward' else '+'}"
                start_key = f"{road.name}{'+' if direction == 'forward' else '-'}"
                approach = end.approaches.get(end_key) if end else None
                previous: Block | None = None
                for stretch in _stretches(road, direction, low_m, high_m, approach):
                    for from_t, to_t in _cut_evenly(stretch, road.max_block_m):
                        piece += 1
                        block = Block(
                            road.name,
                            direction,
                            piece,
                            road.axis.snapped_m(abs(from_t)),
                            road.axis.snapped_m(abs(to_t)),
                            strips(stretch.way, stretch.approach),
                            stretch.way,
                            stretch.approach.inner_pockets if stretch.approach else 0,
                            stretch.approach.kerb_pockets if stretch.approach else 0,
                        )
                        blocks.append(block)
                        if previous is not None:
                            joints.append(Joint(previous, block))
                        elif start is not None:
                            at_end[start.number, start_key, "leaving"] = block
                        previous = block
                if end is not None and previous is not None:
                    at_end[end.number, end_key, "arriving"] = previous
    arms: dict[int, tuple[Arm, ...]] = {}
    for junction in plan.junctions:
        found: list[Arm] = []
        for name in junction.roads:
            for sign, key in ((-1, f"{name}-"), (1, f"{name}+")):
                arriving = at_end.get((junction.number, key, "arriving"))
                leaving = at_end.get((junction.number, key, "leaving"))
                known = arriving or leaving
                if known is not None:
                    cut_m = known.high_m if sign < 0 else known.low_m
                    found.append(Arm(key, name, sign, cut_m, arriving, leaving))
        arms[junction.number] = tuple(found)
    return Layout(tuple(blocks), tuple(joints), arms)
