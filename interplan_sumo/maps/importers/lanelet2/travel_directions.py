"""Lanes for cars: one for each direction in which a lanelet may be driven, and which of them follow or adjoin."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from interplan_sumo.maps.driving_side import shown_side
from interplan_sumo.maps.importers.lanelet2.lanelets import Bound, Lanelet, between, truth
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import DrivingSide

TWO_WAY_WIDTH_M = 4.5
"""A lanelet that is driven in both directions is split in two from this width on."""
_WIDENING_M = 10.0  # over this length a half becomes the whole lanelet, where only whole ones lie beyond
_INNER_SPACING_M = 1.0

_Edge = tuple[str, ...]  # the nodes of a boundary, in the direction of travel


@dataclass(frozen=True, slots=True, eq=False)
class TravelDirection:
    """One direction of travel over a lanelet, or over its half."""

    id: str
    lanelet: Lanelet
    left: Floats
    right: Floats
    left_edge: _Edge | None
    """None in the middle of a lanelet that is split."""
    right_edge: _Edge | None
    start: tuple[str, str]
    """Nodes at the start of the lanelet's left and right boundary, in this direction."""
    end: tuple[str, str]
    is_back: bool = False
    """Against the lanelet's own direction."""


def is_two_way(lanelet: Lanelet) -> bool:
    """Whether cars may drive a lanelet in both directions: one_way=no, or one_way:vehicle=no and the like."""
    for key in ("one_way:vehicle:car", "one_way:vehicle", "one_way"):
        if key in lanelet.tags:
            return not truth(lanelet.tags[key], True)
    return False


def travel_directions_of(lanelets: Iterable[Lanelet], side: DrivingSide) -> list[TravelDirection]:
    """One direction for each lanelet, two for one that is driven both ways and wide enough.

    A half that leads only to lanelets that are not split, or comes only from
    such, widens to the whole width there, so that no lane jumps aside at a joint.
    """
    directions: list[TravelDirection] = []
    for lanelet in lanelets:
        directions.append(_direction(lanelet.id, lanelet, lanelet.left, lanelet.right))
        if is_two_way(lanelet) and lanelet.mean_width_m >= TWO_WAY_WIDTH_M:
            back = _direction(f"{lanelet.id}:back", lanelet, lanelet.right.turned(), lanelet.left.turned())
            directions.append(replace(back, is_back=True))
    halves = {id_ for direction in directions if direction.is_back for id_ in (direction.lanelet.id, direction.id)}
    onward = followers(directions)
    before = predecessors(onward)
    return [
        _half(
            direction,
            side,
            *(bool(ids) and halves.isdisjoint(ids) for ids in (before[direction.id], onward[direction.id])),
        )
        if direction.id in halves
        else direction
        for direction in directions
    ]


def _direction(id_: str, lanelet: Lanelet, left: Bound, right: Bound) -> TravelDirection:
    return TravelDirection(
        id=id_,
        lanelet=lanelet,
        left=left.points,
        right=right.points,
        left_edge=left.nodes,
        right_edge=right.nodes,
        start=(left.nodes[0], right.nodes[0]),
        end=(left.nodes[-1], right.nodes[-1]),
    )


def _half(direction: TravelDirection, side: DrivingSide, whole_at_start: bool, whole_at_end: bool) -> TravelDirection:
    """The half of a direction on its side of the road."""
    reach = min(_WIDENING_M / direction.lanelet.mean_length_m, 0.5)

    def far_share(at: Floats) -> Floats:
        """How far the inner boundary lies towards the far side, at shares of the length."""
        ramps = np.zeros_like(at)
        for is_whole, away in ((whole_at_start, at), (whole_at_end, 1.0 - at)):
            if is_whole:
                near = np.clip(1.0 - away / reach, 0.0, 1.0)
                ramps = np.maximum(ramps, near * near * (3.0 - 2.0 * near))
        return 0.5 + 0.5 * ramps

    if side == "right":
        inner = between(direction.left, direction.right, far_share, _INNER_SPACING_M)
        return replace(direction, left=inner, left_edge=None)
    inner = between(direction.right, direction.left, far_share, _INNER_SPACING_M)
    return replace(direction, right=inner, right_edge=None)


def followers(directions: Iterable[TravelDirection]) -> dict[str, tuple[str, ...]]:
    """Ids of the directions that begin at the two nodes where a direction ends, by id."""
    directions = list(directions)
    beginning: defaultdict[tuple[str, str], list[TravelDirection]] = defaultdict(list)
    for direction in directions:
        beginning[direction.start].append(direction)
    return {
        direction.id: tuple(next_.id for next_ in beginning[direction.end] if next_.lanelet.id != direction.lanelet.id)
        for direction in directions
    }


def predecessors(onward: Mapping[str, Sequence[str]]) -> dict[str, tuple[str, ...]]:
    """What comes before, from what follows: ids by id."""
    before: dict[str, list[str]] = {id_: [] for id_ in onward}
    for id_, next_ids in onward.items():
        for next_id in next_ids:
            before[next_id].append(id_)
    return {id_: tuple(ids) for id_, ids in before.items()}


def right_neighbours(directions: Sequence[TravelDirection]) -> dict[str, str]:
    """By id, the direction of the same direction on the other side of a direction's right boundary.

    Where several have that line as their left boundary, that one which
    lies closest to the direction, so that every direction has one neighbour at most.
    """
    on_right_of: defaultdict[_Edge, list[TravelDirection]] = defaultdict(list)
    for direction in directions:
        if direction.left_edge is not None:
            on_right_of[direction.left_edge].append(direction)
    pairs = sorted(
        (_apart_m(direction, other), row, direction.id, other.id)
        for row, direction in enumerate(directions)
        if direction.right_edge is not None
        for other in on_right_of[direction.right_edge]
    )
    found: dict[str, str] = {}
    taken: set[str] = set()
    for _, _, id_, other_id in pairs:
        if id_ not in found and other_id not in taken:
            found[id_] = other_id
            taken.add(other_id)
    return found


def _apart_m(one: TravelDirection, other: TravelDirection) -> float:
    """How far the far boundaries lie apart at their ends, both together."""
    return float(np.hypot(*(one.left[[0, -1]] - other.right[[0, -1]]).T).sum())


def driving_side(lanelets: Sequence[Lanelet]) -> DrivingSide | None:
    """The side that traffic keeps to, None where the lanelets for one direction do not show it."""
    one_way = [lanelet for lanelet in lanelets if not is_two_way(lanelet)]
    left = (shapely.LineString(lanelet.left.points) for lanelet in one_way)
    right = (shapely.LineString(lanelet.right.points) for lanelet in one_way)
    return shown_side(left, right)
