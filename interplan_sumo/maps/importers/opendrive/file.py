"""Reading an OpenDRIVE file (1.4 to 1.8): its XML to plain data."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from interplan_sumo.errors import MapError
from interplan_sumo.maps.importers.opendrive import curves
from interplan_sumo.maps.importers.opendrive.curves import Coefficients, Curve, Piece, PiecewiseCubic, ReferenceLine
from interplan_sumo.maps.importers.opendrive.elements import (
    UnusableRoadError,
    XodrAccess,
    XodrConnection,
    XodrFile,
    XodrHeader,
    XodrJunction,
    XodrLane,
    XodrLink,
    XodrRoad,
    XodrSection,
)
from interplan_sumo.maps.importers.opendrive.equipment import objects_of, signals_of, speed_mps
from interplan_sumo.world.xml_file import elements, local_name

_ROOT = "OpenDRIVE"
_FARTHEST = 1e9
_LONGEST_M = 100_000.0
"""No road is longer; a damaged length would fill the memory."""
_SHORTEST_M = 1e-6
_MOST_TURN_RAD = 500.0
"""80 rounds: no ramp winds more often."""
_HEIGHTS = ("elevationProfile/elevation", "lateralProfile/superelevation")
_NOWHERE = ("", "-1")


def read_file(path: Path) -> XodrFile:
    """The roads and junctions of a file; MapError with one line if it is missing, damaged or of another kind.

    A road that cannot be used is left out, with the reason in `faults`.
    """
    file = XodrFile(path)
    header: XodrHeader | None = None
    sequence: dict[str, float] = {}
    for element in elements(path, _ROOT):
        _without_namespaces(element)
        match element.tag:
            case "header":
                header = _header(element)
            case "road":
                _add_road(file, element)
            case "controller":
                signals = (control.get("signalId", "").strip() for control in element.iterfind("control"))
                file.controllers.setdefault(element.get("id", "").strip(), tuple(filter(None, signals)))
                _note_sequence(sequence, element)
            case "junction":
                junction = _junction(element)
                file.junctions.setdefault(junction.id, junction)
                for controller in element.iterfind("controller"):
                    _note_sequence(sequence, controller)
            case _:
                pass
    if not file.roads and not file.faults:
        raise MapError(f"{path}: the file holds no road; give one with a road network")
    controllers = dict(sorted(file.controllers.items(), key=lambda item: sequence.get(item[0], math.inf)))
    return XodrFile(path, file.roads, file.junctions, controllers, header, file.faults)


def number(element: Element, name: str, default: float | None = None) -> float:
    """An attribute as a number; UnusableRoadError where it is none, or missing without a default."""
    text = element.get(name)
    if text is None and default is not None:
        return default
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not abs(value) < _FARTHEST:
        raise UnusableRoadError(f"{name} of <{element.tag}> is {(text or '')[:30]!r}, expected a number")
    return value


def _without_namespaces(element: Element) -> None:
    for part in element.iter():
        part.tag = local_name(part.tag)


def _header(element: Element) -> XodrHeader:
    version = f"{element.get('revMajor', '1')}.{element.get('revMinor', '')}"
    reference = " ".join((element.findtext("geoReference") or "").split())
    shift = element.find("offset")
    try:
        x, y, turn = (number(shift, key, 0.0) for key in ("x", "y", "hdg")) if shift is not None else (0.0, 0.0, 0.0)
    except UnusableRoadError:
        x, y, turn = 0.0, 0.0, 0.0
    return XodrHeader(version[:10], reference, (x, y), turn)


# --- roads -----------------------------------------------------------------------------------------------


def _add_road(file: XodrFile, element: Element) -> None:
    id_ = element.get("id", "").strip()
    if id_ in file.roads or id_ in file.faults:
        file.faults.setdefault(f"{id_} (again)", "road with the id of another")
        return
    try:
        file.roads[id_] = _road(id_, element)
    except UnusableRoadError as fault:
        file.faults[id_] = f"road that cannot be read: {fault}"


def _road(id_: str, element: Element) -> XodrRoad:
    reference = _reference(element)
    length_m = number(element, "length", reference.length_m)
    if abs(length_m - reference.length_m) > 0.01 * length_m + 0.1 or not 0.0 < length_m < _LONGEST_M:
        length_m = reference.length_m
    lanes = element.find("lanes")
    if lanes is None:
        raise UnusableRoadError("it has no <lanes>")
    junction = element.get("junction", "").strip()
    link = element.find("link")
    return XodrRoad(
        id=id_,
        junction="" if junction in _NOWHERE else junction,
        left_hand=element.get("rule", "").strip().upper() == "LHT",
        reference=reference,
        offset=_profile(lanes.iterfind("laneOffset"), "s"),
        sections=_sections(lanes, length_m),
        predecessor=_link(link, "predecessor"),
        successor=_link(link, "successor"),
        limits=_limits(element.iterfind("type"), "s", lambda kind: kind.find("speed")),
        signals=signals_of(element, number),
        objects=objects_of(element, number),
        is_flat=all(_is_flat(element, path) for path in _HEIGHTS),
        length_m=length_m,
    )


def _link(link: Element | None, name: str) -> XodrLink | None:
    element = None if link is None else link.find(name)
    if element is None or element.get("elementType") not in ("road", "junction"):
        return None
    contact = element.get("contactPoint", "").strip()
    return XodrLink(
        is_junction=element.get("elementType") == "junction",
        id=element.get("elementId", "").strip(),
        contact=contact if contact in ("start", "end") else None,
        station_m=number(element, "elementS") if element.get("elementS") is not None else None,
    )


def _is_flat(road: Element, path: str) -> bool:
    rows = [[number(e, key, 0.0) for key in "abcd"] for e in road.iterfind(path)]
    return all(row[1:] == [0.0, 0.0, 0.0] and row[0] == rows[0][0] for row in rows)


def _profile(records: Iterable[Element], station: str) -> PiecewiseCubic | None:
    """Cubic polynomials by station; of several at one station the last counts."""
    rows = sorted(
        ([number(e, station, 0.0), *(number(e, key, 0.0) for key in "abcd")] for e in records), key=lambda row: row[0]
    )
    if not rows:
        return None
    table = np.array(rows)
    table = table[np.append(np.diff(table[:, 0]) > 0.0, True)]
    return PiecewiseCubic(table[:, 0], table[:, 1:])


# --- reference lines -------------------------------------------------------------------------------------


def _reference(road: Element) -> ReferenceLine:
    elements = sorted(road.iterfind("planView/geometry"), key=lambda element: number(element, "s"))
    lengths = [number(element, "length") for element in elements]
    kept = [(element, length) for element, length in zip(elements, lengths, strict=True) if length > _SHORTEST_M]
    if not kept:
        raise UnusableRoadError("its <planView> has no geometry with a length")
    if sum(length for _, length in kept) > _LONGEST_M:
        raise UnusableRoadError(f"it is longer than {_LONGEST_M / 1000.0:g} km")
    following = [element for element, _ in kept[1:]]
    pieces = [
        Piece(
            number(element, "s"),
            length,
            number(element, "x"),
            number(element, "y"),
            number(element, "hdg"),
            _curve(element, length, after),
        )
        for (element, length), after in zip(kept, (*following, None), strict=True)
    ]
    return ReferenceLine(tuple(pieces))


def _curve(element: Element, length_m: float, after: Element | None) -> Curve:
    for shape in element:
        match shape.tag:
            case "line":
                return curves.line()
            case "arc":
                curvature = _turning(number(shape, "curvature"), length_m)
                return curves.arc(curvature)
            case "spiral":
                start, end = (_turning(number(shape, key), length_m) for key in ("curvStart", "curvEnd"))
                return curves.spiral(start, end, length_m)
            case "poly3":
                return curves.graph(_coefficients(shape, "abcd"), length_m)
            case "paramPoly3":
                u, v = _coefficients(shape, ("aU", "bU", "cU", "dU")), _coefficients(shape, ("aV", "bV", "cV", "dV"))
                return curves.cubic(u, v, _span(element, shape, u, v, length_m, after), length_m)
            case _:
                pass
    raise UnusableRoadError("a <geometry> has no shape that is known")


def _turning(curvature: float, length_m: float) -> float:
    if abs(curvature) * length_m > _MOST_TURN_RAD:
        raise UnusableRoadError(f"a curvature of {curvature:g} winds up too tightly to be a road")
    return curvature


def _coefficients(shape: Element, keys: Iterable[str]) -> Coefficients:
    a, b, c, d = (number(shape, key, 0.0) for key in keys)
    return a, b, c, d


def _span(
    element: Element, shape: Element, u: Coefficients, v: Coefficients, length_m: float, after: Element | None
) -> float:
    """How far the parameter of a paramPoly3 runs; without a pRange, as far as leads to the next geometry."""
    said = shape.get("pRange", "").strip().lower()
    if said == "arclength":
        return length_m
    if said == "normalized" or after is None:
        return 1.0

    def misses_m(span: float) -> float:
        x, y, heading = (number(element, key) for key in ("x", "y", "hdg"))
        piece = Piece(0.0, length_m, x, y, heading, curves.cubic(u, v, span, length_m))
        end = piece.at(np.array([length_m]))[0][0]
        return float(np.hypot(end[0] - number(after, "x"), end[1] - number(after, "y")))

    return min((1.0, length_m), key=misses_m)


# --- lanes -----------------------------------------------------------------------------------------------


def _sections(lanes: Element, length_m: float) -> tuple[XodrSection, ...]:
    found: list[XodrSection] = []
    for k, element in enumerate(lanes.iterfind("laneSection")):
        one_side = element.get("singleSide", "").strip() == "true"
        left, right = element.find("left"), element.find("right")
        section = XodrSection(
            number=k,
            start_m=min(max(number(element, "s"), 0.0), length_m),
            lanes=(*_lanes(left, 1), *_lanes(right, -1)),
            left_only=one_side and right is None and left is not None,
            right_only=one_side and left is None and right is not None,
        )
        found.append(section)
    if not found:
        raise UnusableRoadError("it has no lane section")
    return tuple(sorted(found, key=lambda section: section.start_m))


def _lanes(side: Element | None, sign: int) -> Iterator[XodrLane]:
    seen: set[int] = set()
    for element in () if side is None else side.iterfind("lane"):
        id_ = int(number(element, "id"))
        if id_ * sign <= 0 or id_ in seen:
            raise UnusableRoadError(f"a lane on its {'left' if sign > 0 else 'right'} has the id {id_}")
        seen.add(id_)
        yield XodrLane(
            id=id_,
            kind=element.get("type", "none").strip(),
            width=_profile(element.iterfind("width"), "sOffset"),
            border=_profile(element.iterfind("border"), "sOffset"),
            predecessors=_lane_ids(element, "link/predecessor"),
            successors=_lane_ids(element, "link/successor"),
            limits=_limits(element.iterfind("speed"), "sOffset", lambda speed: speed),
            access=tuple(_access(element)),
            direction=element.get("direction", "standard").strip(),
        )


def _lane_ids(lane: Element, path: str) -> tuple[int, ...]:
    return tuple(dict.fromkeys(int(number(link, "id")) for link in lane.iterfind(path)))


def _access(lane: Element) -> Iterator[XodrAccess]:
    """The rules of access by the station where they begin; those of one station count together."""
    users: dict[tuple[float, bool], set[str]] = {}
    for access in lane.iterfind("access"):
        key = number(access, "sOffset", 0.0), access.get("rule", "allow").strip() != "deny"
        named = [access.get("restriction"), *(inner.get("type") for inner in access.iterfind("restriction"))]
        users.setdefault(key, set()).update(name.strip() for name in named if name)
    for (offset_m, allows), names in sorted(users.items(), key=lambda item: item[0][0]):
        yield XodrAccess(offset_m, allows, frozenset(names))


def _limits(
    records: Iterable[Element], station: str, speed_of: Callable[[Element], Element | None]
) -> tuple[tuple[float, float | None], ...]:
    found: dict[float, float | None] = {}
    for record in records:
        speed = speed_of(record)
        limit = None if speed is None else speed_mps(speed.get("max", ""), speed.get("unit", "m/s"))
        found[number(record, station, 0.0)] = limit
    return tuple(sorted(found.items()))


# --- junctions -------------------------------------------------------------------------------------------


def _junction(element: Element) -> XodrJunction:
    return XodrJunction(
        id=element.get("id", "").strip(),
        kind=element.get("type", "default").strip() or "default",
        connections=tuple(_connections(element)),
        priorities=tuple((p.get("high", "").strip(), p.get("low", "").strip()) for p in element.iterfind("priority")),
    )


def _note_sequence(sequence: dict[str, float], controller: Element) -> None:
    """The place of a controller among those of its junction, which either may tell."""
    text = controller.get("sequence", "").strip()
    if text.isdecimal() and len(text) < 10:
        sequence[controller.get("id", "").strip()] = float(text)


def _connections(junction: Element) -> Iterator[XodrConnection]:
    for element in junction.iterfind("connection"):
        contact = element.get("contactPoint", "").strip()
        links: list[tuple[int, int]] = []
        for link in element.iterfind("laneLink"):
            try:
                links.append((int(number(link, "from")), int(number(link, "to"))))
            except UnusableRoadError:
                continue
        yield XodrConnection(
            incoming=element.get("incomingRoad", "").strip(),
            connecting=(element.get("connectingRoad") or element.get("linkedRoad") or "").strip(),
            contact=contact if contact in ("start", "end") else None,
            lanes=tuple(links),
        )
