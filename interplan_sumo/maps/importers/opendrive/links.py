"""Which lane follows which: OpenDRIVE's links of lanes, roads and junctions, as pairs of lane ends that meet."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from interplan_sumo.maps.importers.opendrive.elements import XodrConnection, XodrFile, XodrJunction, XodrLink, XodrRoad
from interplan_sumo.maps.importers.opendrive.stretches import DrawnStretch, SideStretch

Sides = Mapping[tuple[str, bool], Sequence[SideStretch]]
"""By road and whether it is its left side, from the road's start to its end."""

LaneEnd = tuple[DrawnStretch, bool]
"""A lane and whether its end (in the direction of the reference line) is meant, or its start."""

_SAME_STATION_M = 1.01


@dataclass(eq=False)
class Joints:
    """Ends of lanes that meet."""

    pairs: dict[tuple[str, bool, str, bool], tuple[LaneEnd, LaneEnd]] = field(
        default_factory=dict[tuple[str, bool, str, bool], tuple[LaneEnd, LaneEnd]]
    )
    beyond: int = 0
    """Links to roads and lanes that the file lacks."""

    def add(self, one: LaneEnd, other: LaneEnd) -> None:
        a, b = sorted((one, other), key=lambda end: (end[0].id, end[1]))
        self.pairs.setdefault((a[0].id, a[1], b[0].id, b[1]), (a, b))


def joints_of(file: XodrFile, sides: Sides) -> Joints:
    """Every pair of lane ends that the file joins, whichever of the two names the other."""
    found = Joints()
    for chain in sides.values():
        for before, after in pairwise(chain):
            _join_sections(found, before, after)
    for road in file.roads.values():
        for at_end in (False, True):
            link = road.link(at_end=at_end)
            if link is not None and not link.is_junction:
                _join_roads(found, file, sides, road, at_end, link)
    for junction in file.junctions.values():
        for connection in junction.connections:
            _join_junction(found, file, sides, junction, connection)
    return found


def _join_sections(found: Joints, before: SideStretch, after: SideStretch) -> None:
    if before.section == after.section:
        pairs = [(id_, id_) for id_ in before.lanes]
    else:
        pairs = [(id_, onward) for id_, lane in before.lanes.items() for onward in lane.lane.successors]
        pairs += [(back, id_) for id_, lane in after.lanes.items() for back in lane.lane.predecessors]
        pairs = pairs or [(id_, id_) for id_ in before.lanes]
    for one, other in dict.fromkeys(pairs):
        if one in before.lanes and other in after.lanes:
            found.add((before.lanes[one], True), (after.lanes[other], False))
        else:
            found.beyond += 1


def _lanes_at(sides: Sides, road: str, *, at_end: bool) -> dict[int, DrawnStretch]:
    """The lanes at one end of a road, by their ids."""
    lanes: dict[int, DrawnStretch] = {}
    for left in (False, True):
        chain = sides.get((road, left), ())
        if chain:
            lanes |= chain[-1 if at_end else 0].lanes
    return lanes


def _join_roads(found: Joints, file: XodrFile, sides: Sides, road: XodrRoad, at_end: bool, link: XodrLink) -> None:
    """The lanes at the end of a road with those of the road that it links to."""
    other = file.roads.get(link.id)
    if other is None:
        found.beyond += 1
        return
    own = _lanes_at(sides, road.id, at_end=at_end)
    pairs = [
        (id_, onward)
        for id_, lane in own.items()
        for onward in (lane.lane.successors if at_end else lane.lane.predecessors)
    ]
    if link.station_m is not None:
        for id_, onward in pairs:
            for place in _ends_at(sides, other.id, onward, link.station_m):
                found.add((own[id_], at_end), place)
        return
    far = _far_end(road, at_end, other, link.contact)
    theirs = _lanes_at(sides, other.id, at_end=far)
    back = other.link(at_end=far)
    if not pairs and back is not None and back.id == road.id and not back.is_junction:
        linked = any((lane.lane.successors if far else lane.lane.predecessors) for lane in theirs.values())
        pairs = [] if linked else [(id_, id_ if at_end != far else -id_) for id_ in own]
    for id_, onward in pairs:
        if onward in theirs:
            found.add((own[id_], at_end), (theirs[onward], far))
        else:
            found.beyond += 1


def _ends_at(sides: Sides, road: str, lane: int, station_m: float) -> Iterator[LaneEnd]:
    """The ends of a lane's stretches at a station in the middle of its road."""
    for stretch in sides.get((road, lane > 0), ()):
        if lane in stretch.lanes:
            if abs(stretch.end_m - station_m) < _SAME_STATION_M:
                yield stretch.lanes[lane], True
            if abs(stretch.start_m - station_m) < _SAME_STATION_M:
                yield stretch.lanes[lane], False


def _far_end(road: XodrRoad, at_end: bool, other: XodrRoad, contact: str | None) -> bool:
    """Whether a road meets the end of another one: as the file says, else as they lie."""
    if contact is not None:
        return contact == "end"
    here = _end_of(road, at_end=at_end)
    return bool(np.hypot(*(_end_of(other, at_end=True) - here)) < np.hypot(*(_end_of(other, at_end=False) - here)))


def _end_of(road: XodrRoad, *, at_end: bool) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return road.reference.at(np.array([road.length_m if at_end else 0.0]), ending=at_end)[0][0]


def _join_junction(
    found: Joints, file: XodrFile, sides: Sides, junction: XodrJunction, connection: XodrConnection
) -> None:
    """The lanes of an incoming road with those of its connecting road, or with those that they meet directly."""
    incoming, connecting = file.roads.get(connection.incoming), file.roads.get(connection.connecting)
    if incoming is None or connecting is None:
        found.beyond += 1
        return
    at_end = _contact(junction, incoming, connecting, connection.contact)
    back = connecting.link(at_end=at_end)
    known = back is not None and not back.is_junction and back.id == incoming.id
    if known and back is not None and back.station_m is not None:
        for from_, to in connection.lanes:
            way = _lanes_at(sides, connecting.id, at_end=at_end).get(to)
            if way is not None:
                for place in _ends_at(sides, incoming.id, from_, back.station_m):
                    found.add((way, at_end), place)
        return
    said = back.contact if known and back is not None else _only_end(incoming, junction.id)
    far = _far_end(connecting, at_end, incoming, said)
    theirs, own = _lanes_at(sides, incoming.id, at_end=far), _lanes_at(sides, connecting.id, at_end=at_end)
    for from_, to in connection.lanes:
        if from_ in theirs and to in own:
            found.add((theirs[from_], far), (own[to], at_end))
        else:
            found.beyond += 1


def _contact(junction: XodrJunction, incoming: XodrRoad, connecting: XodrRoad, contact: str | None) -> bool:
    """Whether the incoming road meets the end of the connecting one."""
    if contact is not None:
        return contact == "end"
    links = [connecting.link(at_end=at_end) for at_end in (False, True)]
    named = [link is not None and link.id in (incoming.id, junction.id) for link in links]
    return named[1] and not named[0]


def _only_end(road: XodrRoad, junction: str) -> str | None:
    """The end at which a road leads into a junction; None where it is both or none."""
    into = [
        end
        for end, link in (("start", road.predecessor), ("end", road.successor))
        if link is not None and link.is_junction and link.id == junction
    ]
    return into[0] if len(into) == 1 else None
