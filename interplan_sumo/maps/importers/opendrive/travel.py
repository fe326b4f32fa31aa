"""Lanes in the direction of travel: which follows which, what lies beside it, and what is too narrow for cars."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from interplan_sumo.maps.importers.lines import SHORTEST_M, TORN_M, length_m
from interplan_sumo.maps.importers.opendrive.lane_types import TWO_WAY
from interplan_sumo.maps.importers.opendrive.links import Joints, LaneEnd, Sides
from interplan_sumo.maps.importers.opendrive.stretches import NARROWEST_M, DrawnStretch, SideStretch
from interplan_sumo.world.geometry import Floats

BACK = ":back"
"""Ends the id of the second of two lanes that share one lane of the file."""
SHARED_WIDTH_M = 5.0
"""A lane for both directions is split along its middle from this width on."""
_CLOSED_M = 0.5
"""A lane that becomes so narrow opens there, or ends."""


@dataclass(eq=False, slots=True)
class TravelLane:
    """A lane as those who drive on it see it."""

    id: str
    stretch: DrawnStretch
    along: bool
    """Whether it runs along the reference line."""
    left: Floats
    """(N, 2) in the direction of travel."""
    right: Floats
    successors: dict[str, None] = field(default_factory=dict[str, None])
    predecessors: dict[str, None] = field(default_factory=dict[str, None])
    left_neighbour: str | None = None
    right_neighbour: str | None = None


@dataclass(eq=False)
class Network:
    """All lanes for cars."""

    lanes: dict[str, TravelLane]
    of_stretch: dict[str, list[TravelLane]]
    """By the id of the stretch that they lie on."""
    narrow: list[TravelLane] = field(default_factory=list[TravelLane])
    """Left out: where a lane opens or ends."""
    one_way: int = 0
    """Lanes for both directions that keep their own, for want of room."""
    split: int = 0
    opposed: int = 0
    """Links between lanes that run against each other."""
    torn: list[tuple[str, str, float]] = field(default_factory=list[tuple[str, str, float]])
    """Links left out, with the distance of the lanes in metres."""


def network_of(sides: Sides, joints: Joints) -> Network:
    """The lanes for cars, linked."""
    network = Network({}, {})
    for chain in sides.values():
        for side in chain:
            _add_lanes(network, sides, side)
    for one, other in joints.pairs.values():
        _link(network, one, other)
    _drop_narrow(network)
    _skip_short(network)
    for chain in sides.values():
        for side in chain:
            _neighbours(network, side)
    return network


def is_turning_lane(sides: Sides, stretch: DrawnStretch) -> bool:
    """Whether a lane for both directions lies between lanes of both: one only turns off from it."""
    if stretch.lane.kind != TWO_WAY:
        return False
    middle_m = (stretch.start_m + stretch.end_m) / 2.0
    seen: set[bool] = set()
    for left in (False, True):
        for side in sides.get((stretch.road.id, left), ()):
            if side.start_m <= middle_m < side.end_m:
                seen |= {o.along for o in side.lanes.values() if o.reason is None and not _both_ways(o)}
    return len(seen) == 2


def _both_ways(stretch: DrawnStretch) -> bool:
    return stretch.lane.kind == TWO_WAY or stretch.lane.direction == "both"


def _add_lanes(network: Network, sides: Sides, side: SideStretch) -> None:
    for stretch in side.lanes.values():
        if stretch.reason is None and is_turning_lane(sides, stretch):
            stretch.reason = "lane for turning from both directions"
        if stretch.reason is None and stretch.width_m.max() < SHORTEST_M:
            stretch.reason = "lane without width"
        if stretch.reason is None:
            made = list(_travel_lanes(network, stretch))
            network.of_stretch[stretch.id] = made
            network.lanes |= {lane.id: lane for lane in made}


def _travel_lanes(network: Network, stretch: DrawnStretch) -> Iterator[TravelLane]:
    low, high = (stretch.outer, stretch.inner) if stretch.left else (stretch.inner, stretch.outer)
    if not _both_ways(stretch):
        yield _travel_lane(stretch, stretch.id, stretch.along, low, high)
    elif stretch.width_m.min() < SHARED_WIDTH_M:
        network.one_way += 1
        yield _travel_lane(stretch, stretch.id, stretch.along, low, high)
    else:
        network.split += 1
        middle = stretch.middle
        on_left = stretch.road.left_hand
        yield _travel_lane(stretch, stretch.id, True, low if on_left else middle, middle if on_left else high)
        yield _travel_lane(stretch, stretch.id + BACK, False, middle if on_left else low, high if on_left else middle)


def _travel_lane(stretch: DrawnStretch, id_: str, along: bool, left: Floats, right: Floats) -> TravelLane:
    """The lane between two lines that run along the reference line, `left` to the left of it."""
    if along:
        return TravelLane(id_, stretch, True, left, right)
    return TravelLane(id_, stretch, False, right[::-1], left[::-1])


def _link(network: Network, one: LaneEnd, other: LaneEnd) -> None:
    """Joins the lanes that meet at two ends, the one that leaves to the one that enters."""
    (a, a_end), (b, b_end) = one, other
    lanes, others = network.of_stretch.get(a.id, ()), network.of_stretch.get(b.id, ())
    if not lanes or not others:
        return
    gap_m = float(np.hypot(*(a.middle_at(at_end=a_end) - b.middle_at(at_end=b_end))))
    if gap_m > TORN_M:
        network.torn.append((a.id, b.id, gap_m))
        return
    found = False
    for lane in lanes:
        for onward in others:
            leaves, enters = lane.along == a_end, onward.along != b_end
            if leaves and enters:
                _follow(lane, onward)
            elif not leaves and not enters:
                _follow(onward, lane)
            found |= leaves == enters
    network.opposed += not found


def _follow(lane: TravelLane, onward: TravelLane) -> None:
    if lane is not onward:
        lane.successors[onward.id] = None
        onward.predecessors[lane.id] = None


def _drop_narrow(network: Network) -> None:
    """Leaves out stretches that are too narrow for cars, unless they are a passage between two lanes."""
    for lane in list(network.lanes.values()):
        width_m = lane.stretch.width_m
        if np.median(width_m) < NARROWEST_M:
            passage = lane.predecessors and lane.successors and width_m.min() >= _CLOSED_M
            if not passage:
                network.narrow.append(lane)
                _unlink(network, lane)


def _skip_short(network: Network) -> None:
    """Leaves out lanes without length: what leads to them leads to what follows them."""
    for lane in list(network.lanes.values()):
        if min(lane.stretch.length_m, length_m(lane.stretch.middle)) < SHORTEST_M:
            for before in lane.predecessors:
                for after in lane.successors:
                    if before in network.lanes and after in network.lanes:
                        _follow(network.lanes[before], network.lanes[after])
            _unlink(network, lane)


def _unlink(network: Network, lane: TravelLane) -> None:
    for before in lane.predecessors:
        network.lanes[before].successors.pop(lane.id, None)
    for after in lane.successors:
        network.lanes[after].predecessors.pop(lane.id, None)
    del network.lanes[lane.id]


def _neighbours(network: Network, side: SideStretch) -> None:
    """Lanes of one direction that adjoin; strips of no width between them do not part them."""
    wide = sorted((s for s in side.lanes.values() if s.width_m.max() >= SHORTEST_M), key=lambda s: abs(s.lane.id))
    last: TravelLane | None = None
    for stretch in wide:
        made = [lane for lane in network.of_stretch.get(stretch.id, ()) if lane.id in network.lanes]
        here = made[0] if len(made) == 1 else None
        if last is not None and here is not None and last.along == here.along:
            outer_is_left = stretch.left == here.along
            left, right = (here, last) if outer_is_left else (last, here)
            left.right_neighbour, right.left_neighbour = right.id, left.id
        last = here
