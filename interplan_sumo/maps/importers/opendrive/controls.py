"""Lights, signs and stop lines of an OpenDRIVE file: at which lanes they hold."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from operator import attrgetter

import numpy as np
import shapely

from interplan_sumo.maps.importers.opendrive.areas import is_stop_mark, long_axis, outlines_of
from interplan_sumo.maps.importers.opendrive.elements import XodrFile, XodrObject, XodrRoad, XodrSignal
from interplan_sumo.maps.importers.opendrive.links import Sides
from interplan_sumo.maps.importers.opendrive.stretches import DrawnStretch
from interplan_sumo.maps.importers.opendrive.travel import Network, TravelLane
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import StopLineKind

_LIGHTS = ("1000000", "1000099")
"""Kinds of lights in OpenDRIVE's own catalogue lie between these."""
_NOT_FOR_CARS = frozenset(("1000002", "1000007", "1000013"))
"""Lights for those on foot and on bicycles."""
_STOP_KINDS, _YIELD_KINDS, _LINE_KINDS = frozenset(("206", "r1-1")), frozenset(("205", "r1-2")), frozenset(("294",))
_NEAR_M = 40.0
"""A light or a sign so near to the end of its road holds there; a light further away holds where it stands."""
_ACROSS_M = 0.5
"""A stop line that comes so near to the middle of a lane is one of that lane."""
_BEHIND_M = 5.0
"""A light so near behind the beginning of its road holds at that beginning."""


@dataclass(eq=False)
class Controls:
    """What holds for which lanes."""

    lights_at_start: dict[str, dict[str, None]] = field(default_factory=dict[str, dict[str, None]])
    lights_at_end: dict[str, dict[str, None]] = field(default_factory=dict[str, dict[str, None]])
    sign_at_end: dict[str, StopLineKind] = field(default_factory=dict[str, StopLineKind])
    lines: list[tuple[str, Floats, tuple[str, ...]]] = field(default_factory=list[tuple[str, Floats, tuple[str, ...]]])
    """Stop lines: id, (2, 2) points, and the lanes at whose end they lie."""
    leading_nowhere: dict[str, None] = field(default_factory=dict[str, None])
    """Lights before or behind which the map ends: nobody passes them."""
    idle: list[str] = field(default_factory=list[str])
    """Lights that hold for no lane for cars."""
    idle_signs: list[str] = field(default_factory=list[str])
    """Stop and yield signs that hold at no end of a road for cars."""


def is_light(signal: XodrSignal) -> bool:
    """Whether a signal is a light for cars."""
    kind = signal.kind.replace(".", "")
    if signal.meaning == "trafficLight":
        return True
    return signal.is_dynamic and _LIGHTS[0] <= kind <= _LIGHTS[1] and kind not in _NOT_FOR_CARS and len(kind) == 7


def sign_of(signal: XodrSignal) -> StopLineKind | None:
    """What a sign asks for, None if neither stopping nor yielding."""
    kind, name = signal.kind.lower(), signal.name.lower().replace(" ", "")
    if signal.is_dynamic:
        return None
    if signal.meaning in ("stop", "fourWayStop") or kind in _STOP_KINDS:
        return StopLineKind.STOP_SIGN
    if signal.meaning == "yield" or kind in _YIELD_KINDS:
        return StopLineKind.YIELD
    if kind in ("", "-1") and ("stopsign" in name or "sign_stop" in name):
        return StopLineKind.STOP_SIGN
    return StopLineKind.YIELD if kind in ("", "-1") and "yield" in name else None


def is_stop_line(signal: XodrSignal) -> bool:
    return signal.meaning == "stopLine" or (not signal.is_dynamic and signal.kind in _LINE_KINDS)


def cuts_of(road: XodrRoad, known: Mapping[str, XodrSignal]) -> Iterator[float]:
    """Stations in the middle of a road at which a light holds: its lanes are cut there."""
    if not road.junction:
        for signal in road.signals:
            near_m = min(signal.station_m, road.length_m - signal.station_m)
            if is_light(known.get(signal.id, signal)) and near_m > _NEAR_M and _is_meant(signal):
                yield signal.station_m


def controls_of(file: XodrFile, known: Mapping[str, XodrSignal], sides: Sides, network: Network) -> Controls:
    """The lights, signs and stop lines of a file.

    `known` are its signals by id, which references name.
    """
    found = Controls()
    lit: set[str] = set()
    put: set[str] = set()
    for road in file.roads.values():
        for signal in road.signals:
            origin = known.get(signal.id, signal)
            if is_light(origin):
                lanes = list(lanes_under(sides, network, road, signal))
                lit |= {signal.id} if lanes else set()
                for lane in lanes:
                    _hang(found, network, road, lane, signal)
            elif (kind := sign_of(origin)) is not None:
                for lane in lanes_under(sides, network, road, signal):
                    put |= {signal.id} if _put(found, network, road, lane, signal, kind) else set()
            elif is_stop_line(origin):
                _draw(found, list(lanes_under(sides, network, road, signal)), signal)
    for road in file.roads.values():
        for thing in road.objects:
            if is_stop_mark(thing):
                _draw_mark(found, sides, network, road, thing)
    for held, ways in ((found.lights_at_end, "successors"), (found.lights_at_start, "predecessors")):
        for lane in [id_ for id_ in held if not getattr(network.lanes[id_], ways)]:
            found.leading_nowhere.update(held.pop(lane))
    found.idle = [id_ for id_, signal in known.items() if is_light(signal) and id_ not in lit]
    signs = (id_ for id_, signal in known.items() if not is_light(signal) and sign_of(signal) is not None)
    found.idle_signs = [id_ for id_ in signs if id_ not in put]
    return found


def _is_meant(signal: XodrSignal | XodrObject) -> bool:
    """Whether a signal names lanes at all; RoadRunner's name the middle and leave the lanes to references."""
    return signal.validity != ((0, 0),)


def lanes_under(
    sides: Sides, network: Network, road: XodrRoad, signal: XodrSignal | XodrObject
) -> Iterator[TravelLane]:
    """The lanes for cars for which a signal, or a mark, holds, where it stands.

    Named lanes count whatever the orientation, where it fits none of them.
    """
    if not _is_meant(signal):
        return
    here = [stretch for stretch in _at(sides, road, signal.station_m) if names(signal, stretch)]
    lanes = [lane for stretch in here for lane in network.of_stretch.get(stretch.id, ()) if lane.id in network.lanes]
    wanted = [lane for lane in lanes if signal.orientation not in "+-" or lane.along == (signal.orientation == "+")]
    yield from wanted or (lanes if signal.validity else ())


def names(signal: XodrSignal | XodrObject, stretch: DrawnStretch) -> bool:
    """Whether a signal holds for a lane, as far as it names any."""
    return not signal.validity or any(low <= stretch.lane.id <= high for low, high in signal.validity)


def _at(sides: Sides, road: XodrRoad, station_m: float) -> Iterator[DrawnStretch]:
    """The lanes at a station, of both sides."""
    at_m = min(max(station_m, 0.0), road.length_m)
    for left in (False, True):
        for stretch in sides.get((road.id, left), ()):
            if stretch.start_m <= at_m < stretch.end_m or at_m == stretch.end_m == road.length_m:
                yield from stretch.lanes.values()


def _to_end_m(lane: TravelLane, station_m: float) -> float:
    """How far it is from a station to the end of the road, in the direction of travel."""
    return lane.stretch.road.length_m - station_m if lane.along else station_m


def _last(network: Network, lane: TravelLane) -> TravelLane:
    """The lane at which one leaves the road that a lane lies on."""
    return _outermost(network, lane, attrgetter("successors"))


def _first(network: Network, lane: TravelLane) -> TravelLane:
    """The lane at which one comes onto the road that a lane lies on."""
    return _outermost(network, lane, attrgetter("predecessors"))


def _outermost(network: Network, lane: TravelLane, links: Callable[[TravelLane], Iterable[str]]) -> TravelLane:
    """The end of the chain of single links from a lane within its road."""
    seen = {lane.id}
    while True:
        linked = [network.lanes[id_] for id_ in links(lane)]
        linked = [one for one in linked if one.stretch.road is lane.stretch.road and one.id not in seen]
        if len(linked) != 1:
            return lane
        lane = linked[0]
        seen.add(lane.id)


def _hang(found: Controls, network: Network, road: XodrRoad, lane: TravelLane, signal: XodrSignal) -> None:
    """A light over a lane: where the junction begins, or where it stands."""
    station_m = min(max(signal.station_m, 0.0), road.length_m)
    ahead_m = _to_end_m(lane, station_m)
    if road.junction:
        found.lights_at_start.setdefault(_first(network, lane).id, {})[signal.id] = None
    elif ahead_m <= _NEAR_M and road.length_m - ahead_m > _BEHIND_M:
        found.lights_at_end.setdefault(_last(network, lane).id, {})[signal.id] = None
    elif road.length_m - ahead_m <= _NEAR_M:
        found.lights_at_start.setdefault(_first(network, lane).id, {})[signal.id] = None
    else:
        before = _before(network, lane, station_m)
        found.lights_at_end.setdefault(before.id, {})[signal.id] = None


def _before(network: Network, lane: TravelLane, station_m: float) -> TravelLane:
    """The lane that ends at a station at which the road was cut."""
    stretch = lane.stretch
    begins = abs((stretch.start_m if lane.along else stretch.end_m) - station_m) < 1.0
    behind = [network.lanes[id_] for id_ in lane.predecessors]
    return behind[0] if begins and len(behind) == 1 and behind[0].stretch.road is stretch.road else lane


def _put(
    found: Controls, network: Network, road: XodrRoad, lane: TravelLane, signal: XodrSignal, kind: StopLineKind
) -> bool:
    """A sign before a junction; one on a way through it holds for those who come onto that way.

    Whether it holds anywhere: one further from the end of its road than `_NEAR_M` does not.
    """
    if road.junction:
        ends = [network.lanes[id_] for id_ in _first(network, lane).predecessors]
    elif _to_end_m(lane, signal.station_m) <= _NEAR_M:
        ends = [_last(network, lane)]
    else:
        ends = []
    for end in ends:
        found.sign_at_end[end.id] = min(kind, found.sign_at_end.get(end.id, kind))
    return bool(ends)


def _draw(found: Controls, lanes: list[TravelLane], signal: XodrSignal) -> None:
    """A stop line across lanes, at its station."""
    corners: list[Floats] = []
    for lane in lanes:
        stretch = lane.stretch
        span_m = max(stretch.length_m, 1e-6)
        share = min(max((signal.station_m - stretch.start_m) / span_m, 0.0), 1.0)
        share = share if lane.along else 1.0 - share
        corners += [_along(line, share) for line in (lane.left, lane.right)]
    if corners:
        points = np.array(corners)
        apart = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
        one, other = np.unravel_index(int(apart.argmax()), apart.shape)
        found.lines.append((signal.id, points[[one, other]], tuple(lane.id for lane in lanes)))


def _draw_mark(found: Controls, sides: Sides, network: Network, road: XodrRoad, mark: XodrObject) -> None:
    """A stop line that is drawn as an object, unless a signal says of its lanes already that there is one."""
    lined = {id_ for _, _, ids in found.lines for id_ in ids}
    lanes = list(lanes_under(sides, network, road, mark))
    for outline in outlines_of(road, mark):
        line = long_axis(outline) if np.isfinite(outline).all() else None
        if line is not None:
            drawn = shapely.LineString(line)
            met = [lane for lane in lanes if drawn.distance(shapely.LineString(lane.stretch.middle)) < _ACROSS_M]
            if met and lined.isdisjoint(lane.id for lane in met):
                found.lines.append((mark.id, line, tuple(lane.id for lane in met)))


def _along(line: Floats, share: float) -> Floats:
    """(2,) the point at a share of the length of a line."""
    steps = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))))
    at = share * steps[-1]
    return np.array([np.interp(at, steps, line[:, 0]), np.interp(at, steps, line[:, 1])])
