"""Reading the signals and objects of an OpenDRIVE road."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from xml.etree.ElementTree import Element

from interplan_sumo.maps.importers.opendrive.elements import (
    Corner,
    UnusableRoadError,
    XodrObject,
    XodrRepeat,
    XodrSignal,
)

_WANTED = frozenset(("crosswalk", "parkingspace", "roadmark", "stopline"))
"""Kinds of objects that matter to those who drive, without regard to case."""
_UNITS = {"m/s": 1.0, "km/h": 1.0 / 3.6, "mph": 0.44704}
_FASTEST_MPS = 100.0
_LIMIT_KINDS = {"274": "km/h", "r2-1": "mph"}
"""Signs with a speed limit, and the unit of those that tell none."""
_END_KINDS = frozenset(("278", "282"))
_LIMIT_MEANINGS, _END_MEANINGS = frozenset(("maximum", "zone")), frozenset(("maximumEnd", "zoneEnd"))


def speed_mps(text: str, unit: str) -> float | None:
    """A speed limit in m/s; None for "no limit", "undefined" and what is no speed."""
    factor = _UNITS.get(unit.strip() or "m/s")
    try:
        value = float(text)
    except ValueError:
        return None
    return value * factor if factor is not None and 0.0 < value * factor < _FASTEST_MPS else None


def signals_of(road: Element, number: Callable[..., float]) -> tuple[XodrSignal, ...]:
    """The signals of a road and the references to some; those without a place are passed over."""
    found: list[XodrSignal] = []
    for element in road.iterfind("signals/*"):
        if element.tag in ("signal", "signalReference"):
            try:
                found.append(_signal(element, number))
            except UnusableRoadError:
                continue
    return tuple(found)


def _signal(element: Element, number: Callable[..., float]) -> XodrSignal:
    priority = element.find("semantics/priority")
    is_dynamic = element.get("dynamic", "no").strip() in ("yes", "true", "1")
    says_limit, limit_mps = _limit(element, is_dynamic=is_dynamic)
    return XodrSignal(
        id=element.get("id", "").strip(),
        station_m=number(element, "s"),
        left_m=number(element, "t", 0.0),
        orientation=element.get("orientation", "").strip() or "none",
        is_dynamic=is_dynamic,
        kind=element.get("type", "").strip(),
        country=element.get("country", "").strip(),
        name=element.get("name", "").strip(),
        meaning="" if priority is None else priority.get("type", "").strip(),
        validity=tuple(_validity(element, number)),
        is_reference=element.tag == "signalReference",
        says_limit=says_limit,
        limit_mps=limit_mps,
    )


def _limit(element: Element, *, is_dynamic: bool) -> tuple[bool, float | None]:
    """Whether a signal begins or ends a speed limit, and the limit in m/s; NaN for one that cannot be told."""
    kind = element.get("type", "").strip().lower()
    speed = element.find("semantics/speed")
    meaning = "" if speed is None else speed.get("type", "").strip()
    if meaning in _END_MEANINGS or kind in _END_KINDS:
        return True, None
    if speed is None or meaning not in _LIMIT_MEANINGS:
        speed = element
        if kind not in _LIMIT_KINDS:
            return False, None
    if is_dynamic:
        return True, math.nan
    limit_mps = speed_mps(speed.get("value", ""), speed.get("unit", "").strip() or _LIMIT_KINDS.get(kind, "km/h"))
    return True, math.nan if limit_mps is None else limit_mps


def _validity(element: Element, number: Callable[..., float]) -> Iterator[tuple[int, int]]:
    for validity in element.iterfind("validity"):
        ends = int(number(validity, "fromLane")), int(number(validity, "toLane"))
        yield min(ends), max(ends)


def objects_of(road: Element, number: Callable[..., float]) -> tuple[XodrObject, ...]:
    """The crosswalks, parking spaces and marks of a road; what has no place is passed over."""
    found: list[XodrObject] = []
    for element in road.iterfind("objects/object"):
        kind, name = element.get("type", "").strip(), element.get("name", "").strip()
        called = name.lower().replace(" ", "")
        if kind.lower() in _WANTED or "crosswalk" in called or "stopline" in called:
            try:
                found.append(_object(element, kind, name, number))
            except UnusableRoadError:
                continue
    return tuple(found)


def _object(element: Element, kind: str, name: str, number: Callable[..., float]) -> XodrObject:
    return XodrObject(
        id=element.get("id", "").strip(),
        kind=kind.lower(),
        subtype=element.get("subtype", "").strip().lower(),
        name=name.lower(),
        station_m=number(element, "s"),
        left_m=number(element, "t"),
        heading_rad=number(element, "hdg", 0.0),
        length_m=number(element, "length", 0.0),
        width_m=number(element, "width", 0.0),
        outlines=tuple(
            tuple(_corners(outline, number))
            for path in ("outline", "outlines/outline")
            for outline in element.iterfind(path)
        ),
        repeats=tuple(
            XodrRepeat(
                number(repeat, "s"),
                number(repeat, "length", 0.0),
                number(repeat, "distance", 0.0),
                (number(repeat, "tStart", 0.0), number(repeat, "tEnd", 0.0)),
            )
            for repeat in element.iterfind("repeat")
        ),
        orientation=element.get("orientation", "").strip() or "none",
        validity=tuple(_validity(element, number)),
    )


def _corners(outline: Element, number: Callable[..., float]) -> Iterator[Corner]:
    for corner in outline:
        if corner.tag == "cornerRoad":
            yield "road", number(corner, "s"), number(corner, "t")
        elif corner.tag == "cornerLocal":
            yield "local", number(corner, "u"), number(corner, "v")
