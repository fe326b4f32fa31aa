"""What a CommonRoad file says of itself as a whole: its frame, its country, its time step."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from interplan_sumo.errors import MapError
from interplan_sumo.world.frame import STAND_IN, Frame, utm_frame
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.xml_file import elements

_LARGEST = 1e9
"""No coordinate, speed or angle that means anything is larger."""
_VERSIONS = ("2018b", "2020a")


@dataclass(frozen=True, eq=False)
class CommonRoadFile:
    """One CommonRoad XML file, its elements sorted by tag."""

    path: Path
    name: str
    """The benchmark id, fit for a folder, else the file's own name."""
    attributes: Mapping[str, str]
    parts: Mapping[str, Sequence[Element]]
    """Tag -> elements below the root."""
    frame: Frame
    notes: tuple[str, ...]

    @property
    def country(self) -> str:
        """The three letters that a benchmark id opens with, such as USA; "C-" marks several ego cars."""
        return self.name.removeprefix("C-")[:3].upper()

    def fault(self, element: Element, what: str) -> MapError:
        """The error for one element of the file."""
        where = f"{element.tag} {element.get('id', 'without id')[:40]}"
        return MapError(f"{self.path}: {' '.join(f'{where}: {what}'.split())}")

    def number(self, owner: Element, element: Element | None, name: str) -> float:
        """The text of an element as a number of a size that can be; `owner` and `name` are for the message."""
        text = (element.text or "").strip() if element is not None else ""
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not abs(value) < _LARGEST:
            raise self.fault(owner, f"{name} is {text[:30]!r}, expected a number")
        return value

    def point(self, owner: Element, element: Element, name: str) -> tuple[float, float]:
        """x and y of a point element, in the coordinates of the file."""
        x, y = (self.number(owner, element.find(axis), f"{axis} of {name}") for axis in ("x", "y"))
        return x, y

    def polyline(self, owner: Element, name: str) -> Floats:
        """(N, 2) the points below the child `name`, in `frame.crs`; empty where there is none."""
        points = [self.point(owner, point, name) for point in owner.iterfind(f"{name}/point")]
        try:
            return self.frame.points(np.array(points, dtype=np.float64).reshape(-1, 2))
        except MapError as error:
            raise self.fault(owner, f"{name}: {error}") from error


def read_commonroad_file(path: Path) -> CommonRoadFile:
    """A CommonRoad XML file of version 2018b or 2020a; MapError if it is missing, damaged or of another kind."""
    path = Path(path)
    stream = elements(path, "commonRoad")
    attributes = dict(next(stream).attrib)
    parts: dict[str, list[Element]] = {}
    for element in stream:
        parts.setdefault(element.tag, []).append(element)
    notes: list[str] = []
    version = attributes.get("commonRoadVersion", "unknown")
    if version not in _VERSIONS:
        notes.append(f"The format version is {version[:20]}; it was read as {' or '.join(_VERSIONS)}.")
    frame, why = _frame(parts)
    return CommonRoadFile(
        path=path,
        name=re.sub(r"[^\w-]+", "-", attributes.get("benchmarkID", "")).strip("-")[:80] or path.stem,
        attributes=attributes,
        parts=parts,
        frame=frame,
        notes=(*notes, *why),
    )


def _frame(parts: Mapping[str, Sequence[Element]]) -> tuple[Frame, tuple[str, ...]]:
    """The frame, and what the user should know of it."""
    places = (found for one in parts.get("location", ()) if (found := one.find("geoTransformation")) is not None)
    place = next(places, None)
    reference = (place.findtext("geoReference") or "").strip() if place is not None else ""
    if place is None or not reference:
        return STAND_IN, ("The file does not say where it lies: its coordinates are kept, at a place that stands in.",)
    move = place.find("additionalTransformation")
    try:
        shift = (_setting(move, "xTranslation", 0.0), _setting(move, "yTranslation", 0.0))
        turn, scale = _setting(move, "zRotation", 0.0), _setting(move, "scaling", 1.0)
        if not scale > 0.0:
            raise MapError(f"scaling is {scale:g}, expected more than 0")
        frame = utm_frame(reference, _sample(parts), shift, turn, scale)
    except MapError as error:
        return STAND_IN, (f"The georeference cannot be used ({error}): the map was put at a place that stands in.",)
    turned = ("Points were scaled, then turned, then shifted to the georeference.",) if turn or scale != 1.0 else ()
    return frame, turned


def _setting(move: Element | None, name: str, default: float) -> float:
    text = move.findtext(name) if move is not None else None
    try:
        value = float(text) if text is not None else default
    except ValueError:
        value = math.nan
    if not abs(value) < _LARGEST:
        raise MapError(f"{name} is {str(text)[:30]!r}, expected a number")
    return value


def _sample(parts: Mapping[str, Sequence[Element]]) -> tuple[float, float]:
    """Any point of the file; the first of its lanelets, if it has one."""
    for tag in ("lanelet", *parts):
        for element in parts.get(tag, ()):
            point = element.find(".//point")
            if point is not None:
                return _setting(point, "x", 0.0), _setting(point, "y", 0.0)
    return 0.0, 0.0
