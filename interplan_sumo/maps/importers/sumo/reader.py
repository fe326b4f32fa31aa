"""SUMO networks (`.net.xml`, plain or gzipped) as maps."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import shapely

from interplan_sumo.errors import MapError
from interplan_sumo.maps.importers.cross_sections import polygons_in
from interplan_sumo.maps.importers.lines import SHORTEST_M, along, beside, length_m, ring
from interplan_sumo.maps.importers.source import LeftOut, SourceLane, SourceMap
from interplan_sumo.maps.importers.sumo.controls import junctions_of, light_name, signals_of, without_trains
from interplan_sumo.maps.network_file import (
    CLASSES,
    FileConnection,
    FileLane,
    NetworkFile,
    read_network_file,
)
from interplan_sumo.world.frame import STAND_IN, Frame, utm_frame
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import StopLineKind

_CAR = "passenger"
_ON_FOOT = frozenset(("pedestrian", "wheelchair"))
_CYCLES = frozenset(("bicycle", "scooter"))
_RAIL = frozenset(("rail_urban", "rail", "rail_electric", "rail_fast", "subway", "cable_car"))
_OFF_ROAD = frozenset(("ship", "container", "aircraft", "drone"))
_CLOSED_GROUND = frozenset(("sidewalk", "railway", "waterway or runway"))
"""Where no car may stand."""
_FEW = 3
_LEAST_OF_MIDDLE = 0.4
"""So much of the middle of a crossing lies within its outline at least."""
_MOST_OF_STRIP = 1.5
"""An outline of a crossing has at most so many times the ground of its middle at its width."""
_SLIVER_M2 = 1.0
_STOPS = frozenset("sw")
_YIELDS = frozenset("m")
_TURNAROUND = frozenset("tT")
_TOUCH_M = 0.5
"""Boundaries of neighbours that lie no further apart are one line: SUMO rounds shapes, and lanes adjoin."""


@dataclass(frozen=True, slots=True, eq=False)
class _DrawnLane:
    """A lane with its boundaries, in the frame of the map."""

    lane: FileLane
    middle: Floats
    left: Floats
    right: Floats

    @property
    def polygon(self) -> shapely.Polygon | None:
        return ring(np.concatenate((self.left, self.right[::-1])))


def read_sumo_network(path: Path) -> SourceMap:
    """The lanes of a SUMO network on which passenger cars may drive, in the UTM zone of its projection.

    Boundaries run half a lane's width beside its shape. Every connection
    through a junction is one lane, named after its first internal lane; where
    there is none, or one without length, it is a direct link. The speed limit
    of a lane through a junction is SUMO's, which is lowered in tight turns.
    Stop and yield signs are those of approaches all of whose ways, but for turning
    round, must stop or yield. Lanes may be longer or shorter in SUMO's books
    than they are drawn; what is drawn counts. MapError names the file and the
    lane or connection.
    """
    file = read_network_file(path)
    notes: list[str] = []
    frame = _frame(file, notes)
    drawn = {id_: _drawn_lane(file, frame, lane) for id_, lane in file.lanes.items()}
    car_lanes = {
        id_: drawn_lane
        for id_, drawn_lane in drawn.items()
        if drawn_lane is not None and _CAR in drawn_lane.lane.classes
    }
    if not car_lanes:
        raise MapError(f"{file.path}: no lane for passenger cars; give a network with roads")
    ways = [
        way
        for way in file.connections
        if _CAR in way.classes and way.from_lane in car_lanes and way.to_lane in car_lanes
    ]
    ways, level_crossings = without_trains(file, ways)
    chains, closed = _through(file, frame, ways)
    ways = [way if way.via in chains else replace(way, via="") for way in ways if way.via not in closed]
    lanes = _lanes(file, car_lanes, ways)
    lanes |= _connection_lanes(chains, ways)
    if ways and not chains:
        notes.append("The network has no lanes within junctions: lanes follow each other directly.")
    elif not file.attributes.get("limitTurnSpeed", "-").startswith("-"):
        notes.append("Speed limits within junctions are SUMO's: lower where a turn is tight.")
    signals, lost = signals_of(file, ways)
    return SourceMap(
        name=file.path.name.removesuffix(".gz").removesuffix(".xml").removesuffix(".net"),
        format="SUMO network",
        crs=frame.crs,
        driving_side="left" if file.left_hand else "right",
        lanes=lanes,
        crosswalks=tuple(_crossings(file, frame)),
        walkways=tuple(_walkways(file, frame, drawn)),
        drivable=tuple(_junctions(file, frame, car_lanes, chains)),
        left_out=(
            *_left_out(file, drawn, car_lanes),
            *(LeftOut(via, "way through a junction closed to cars") for via in sorted(closed)),
        ),
        signals=signals,
        junctions=junctions_of(file, ways, chains),
        notes=(*notes, *level_crossings, *lost),
    )


# --- the frame -----------------------------------------------------------------------------------------


def _frame(file: NetworkFile, notes: list[str]) -> Frame:
    """The frame by the projection that SUMO noted; its offset is what was added to the projected coordinates."""
    reference = file.location.get("projParameter", "!").strip()
    if reference in ("", "!", "-", "."):
        notes.append("The network does not say where it lies: its coordinates are kept, at a place that stands in.")
        return STAND_IN
    try:
        x, y = (float(part) for part in file.location.get("netOffset", "0,0").split(",")[:2])
        if not math.isfinite(x + y):
            raise ValueError("not finite")
    except ValueError:
        raise file.fault(f"netOffset is {file.location['netOffset'][:40]!r}, expected x,y") from None
    sample = next((lane.shape[0] for lane in file.lanes.values() if len(lane.shape)), np.zeros(2))
    try:
        return utm_frame(reference, (float(sample[0]), float(sample[1])), (-x, -y))
    except MapError as error:
        notes.append(f"The projection cannot be used ({error}): the map was put at a place that stands in.")
        return STAND_IN


# --- lanes of edges ------------------------------------------------------------------------------------


def _drawn_lane(file: NetworkFile, frame: Frame, lane: FileLane) -> _DrawnLane | None:
    """A lane with its boundaries; None for one without length."""
    middle = along(_placed(file, frame, f"lane {lane.id}", lane.shape))
    if len(middle) < 2:
        return None
    half_m = _half_width_m(frame, lane)
    return _DrawnLane(lane, middle, beside(middle, half_m), beside(middle, -half_m))


def _half_width_m(frame: Frame, lane: FileLane) -> float:
    """Half the width of a lane, in metres of the map: a projection that stretches shapes stretches widths as well."""
    return frame.stretch_at((float(lane.shape[0, 0]), float(lane.shape[0, 1]))) * lane.width_m / 2.0


def _placed(file: NetworkFile, frame: Frame, what: str, points: Floats) -> Floats:
    try:
        return frame.points(points)
    except MapError as error:
        raise file.fault(f"{what}: {error}") from error


def _lanes(
    file: NetworkFile, car_lanes: Mapping[str, _DrawnLane], ways: Sequence[FileConnection]
) -> dict[str, SourceLane]:
    lights: dict[str, dict[str, None]] = {}
    for way in ways:
        if not way.via and way.light:
            lights.setdefault(way.from_lane, {})[light_name(way)] = None
    after: dict[str, dict[str, None]] = {}
    before: dict[str, dict[str, None]] = {}
    for way in ways:
        after.setdefault(way.from_lane, {})[way.via or way.to_lane] = None
        before.setdefault(way.to_lane, {})[way.via or way.from_lane] = None
    signs = _signs(file, ways)
    lanes = {
        id_: SourceLane(
            id=id_,
            left=drawn_lane.left,
            right=drawn_lane.right,
            successors=tuple(after.get(id_, ())),
            predecessors=tuple(before.get(id_, ())),
            speed_limit_mps=_limit(drawn_lane.lane.speed_mps),
            lights_at_end=tuple(lights.get(id_, ())),
            sign_at_end=signs.get(drawn_lane.lane.edge),
        )
        for id_, drawn_lane in car_lanes.items()
    }
    for ids in file.edges.values():
        # Index 0 is at the kerb: the rightmost lane where traffic keeps right.
        for one, other in pairwise(ids):
            left, right = (one, other) if file.left_hand else (other, one)
            if left in lanes and right in lanes:
                shared = _shared(car_lanes[left], car_lanes[right])
                lanes[left] = replace(lanes[left], right=shared[0], right_neighbour=right)
                lanes[right] = replace(lanes[right], left=shared[1], left_neighbour=left)
    return lanes


def _shared(left: _DrawnLane, right: _DrawnLane) -> tuple[Floats, Floats]:
    """The boundary between two lanes, for each of them: one line where both draw it alike."""
    if left.right.shape == right.left.shape and np.hypot(*(left.right - right.left).T).max() <= _TOUCH_M:
        middle = (left.right + right.left) / 2.0
        return middle, middle
    return left.right, right.left


def _limit(speed_mps: float | None) -> float | None:
    return speed_mps if speed_mps is not None and speed_mps > 0.0 else None


def _signs(file: NetworkFile, ways: Sequence[FileConnection]) -> dict[str, StopLineKind]:
    """Edge -> the sign at its end: where every way out of it must stop or yield, and no light tells when."""
    states: dict[str, set[str]] = {}
    for way in ways:
        if way.direction not in _TURNAROUND:
            states.setdefault(file.lanes[way.from_lane].edge, set()).add("light" if way.light else way.state)
    signs: dict[str, StopLineKind] = {}
    for edge, seen in states.items():
        if seen <= _STOPS | _YIELDS:
            signs[edge] = StopLineKind.STOP_SIGN if seen & _STOPS else StopLineKind.YIELD
    return signs


# --- ways through junctions ----------------------------------------------------------------------------


def _through(
    file: NetworkFile, frame: Frame, ways: Sequence[FileConnection]
) -> tuple[dict[str, _DrawnLane], frozenset[str]]:
    """First internal lane -> the whole way as one lane, if it has a length; the internal lanes closed to cars."""
    chains: dict[str, _DrawnLane] = {}
    closed: set[str] = set()
    for way in ways:
        if way.via and way.via not in chains:
            parts = _parts(file, way)
            if not all(_CAR in part.classes for part in parts):
                closed.add(way.via)
                continue
            shape = np.concatenate([part.shape for part in parts])
            drawn_lane = _drawn_lane(file, frame, replace(parts[0], shape=shape, speed_mps=_lowest(parts)))
            if drawn_lane is not None and length_m(drawn_lane.middle) >= SHORTEST_M:
                chains[way.via] = drawn_lane
    return chains, frozenset(closed)


def _parts(file: NetworkFile, way: FileConnection) -> list[FileLane]:
    """The internal lanes of a way, in the order in which it runs over them."""
    steps = file.via(way)
    for step in steps:
        if step not in file.internal:
            raise file.fault(f"connection {way.name}: it runs via {step[:40]!r}, which is no internal lane of the file")
    return [file.internal[step] for step in steps]


def _lowest(parts: Iterable[FileLane]) -> float | None:
    return min((part.speed_mps for part in parts if part.speed_mps is not None), default=None)


def _connection_lanes(chains: Mapping[str, _DrawnLane], ways: Sequence[FileConnection]) -> dict[str, SourceLane]:
    by_via: dict[str, list[FileConnection]] = {}
    for way in ways:
        if way.via:
            by_via.setdefault(way.via, []).append(way)
    return {
        via: SourceLane(
            id=via,
            left=chains[via].left,
            right=chains[via].right,
            successors=tuple(dict.fromkeys(way.to_lane for way in over)),
            predecessors=tuple(dict.fromkeys(way.from_lane for way in over)),
            speed_limit_mps=_limit(chains[via].lane.speed_mps),
            in_intersection=True,
            lights_at_start=tuple(dict.fromkeys(light_name(way) for way in over if way.light)),
        )
        for via, over in by_via.items()
    }


# --- what is no lane for cars --------------------------------------------------------------------------


def _left_out(
    file: NetworkFile, drawn: Mapping[str, _DrawnLane | None], car_lanes: Mapping[str, _DrawnLane]
) -> Iterable[LeftOut]:
    for edge in file.edges.values():
        with_cars = any(id_ in car_lanes for id_ in edge)
        for id_ in edge:
            drawn_lane = drawn[id_]
            if drawn_lane is None:
                yield LeftOut(id_, "lane without length")
            elif id_ not in car_lanes:
                reason = _reason(drawn_lane.lane.classes)
                open_ground = reason not in _CLOSED_GROUND and (reason != "tram lane" or with_cars)
                yield LeftOut(id_, reason, drawn_lane.polygon if open_ground else None)


def _reason(classes: frozenset[str]) -> str:
    """Why a lane is not for cars, by those who may use it."""
    classes = classes & CLASSES
    if not classes:
        return "closed lane"
    if classes <= _ON_FOOT:
        return "sidewalk"
    if classes <= _CYCLES | _ON_FOOT:
        return "bicycle lane"
    if classes <= {"tram"}:
        return "tram lane"
    if classes <= _RAIL | {"tram"}:
        return "railway"
    if classes <= _OFF_ROAD:
        return "waterway or runway"
    if classes & {"bus", "coach"}:
        return "bus lane"
    return f"lane for {' and '.join(sorted(classes))} only" if len(classes) <= _FEW else "lane for other vehicles"


def _crossings(file: NetworkFile, frame: Frame) -> Iterable[shapely.Polygon]:
    for lane in file.crossings:
        outline = ring(_placed(file, frame, f"crossing {lane.id}", lane.outline))
        middle = along(_placed(file, frame, f"crossing {lane.id}", lane.shape))
        if len(middle) >= 2:
            line = shapely.LineString(middle)
            strip = line.buffer(_half_width_m(frame, lane), cap_style="flat", join_style="mitre")
            yield strip if outline is None or _lies_elsewhere(outline, line, strip) else outline
        elif outline is not None:
            yield outline


def _lies_elsewhere(outline: shapely.Polygon, line: shapely.LineString, strip: shapely.Polygon) -> bool:
    """Whether an outline is not that of a crossing: netconvert draws some round, or only at, the corner beside it."""
    beside = shapely.intersection(line, outline).length < _LEAST_OF_MIDDLE * line.length
    return beside or outline.area > _MOST_OF_STRIP * strip.area


def _walkways(file: NetworkFile, frame: Frame, drawn: Mapping[str, _DrawnLane | None]) -> Iterable[shapely.Polygon]:
    for lane in file.walking_areas:
        area = ring(_placed(file, frame, f"walking area {lane.id}", lane.shape))
        if area is not None:
            yield area
    for drawn_lane in drawn.values():
        if drawn_lane is not None and _reason(drawn_lane.lane.classes) == "sidewalk":
            shape = drawn_lane.polygon
            if shape is not None:
                yield shape


def _junctions(
    file: NetworkFile, frame: Frame, car_lanes: Mapping[str, _DrawnLane], chains: Mapping[str, _DrawnLane]
) -> Iterable[shapely.Polygon]:
    """Outlines of junctions that cars come to, without the corners where people walk."""
    corners = [ring(_placed(file, frame, f"walking area {lane.id}", lane.shape)) for lane in file.walking_areas]
    trodden = np.array([area for area in corners if area is not None], dtype=object)
    tree = shapely.STRtree(trodden)
    for junction in file.junctions:
        if any(lane in car_lanes or lane in chains for lane in junction.lanes):
            outline = ring(_placed(file, frame, f"junction {junction.id}", junction.shape))
            if outline is not None:
                near = trodden[tree.query(outline, predicate="intersects")]
                rest = polygons_in(shapely.difference(outline, shapely.union_all(near)))
                yield from (part for part in rest if part.area > _SLIVER_M2)
