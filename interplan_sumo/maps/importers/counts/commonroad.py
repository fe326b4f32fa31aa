"""A second reading of CommonRoad files: one pass of events instead of a tree, lengths measured on the globe."""

from __future__ import annotations

import gzip
import math
import warnings
import zlib
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax import ContentHandler, SAXException
from xml.sax.xmlreader import AttributesImpl

import numpy as np
import pyproj
from defusedxml import DefusedXmlException
from defusedxml.sax import parseString
from pyproj.exceptions import CRSError

from interplan_sumo.errors import MapError
from interplan_sumo.maps.importers.source import SourceCount

_LIMIT_SIGNS = ("274", "274.1", "R2-1", "R15", "C43", "B14", "B31", "3.24", "\u03a1-32", "r301", "R4-1")
_CLOSED_TYPES = ("crosswalk", "sidewalk", "parking", "border", "restricted_area")
_OPEN_TO_NAMED_CARS = ("bicycleLane", "busLane", "busStop", "shoulder", "restricted")
_UNITS = {"mph": 0.44704, "km/h": 1 / 3.6, "kmh": 1 / 3.6, "m/s": 1.0, "": 1.0}
_TOP_MPS = 160 / 3.6 + 0.6
_SAME_M = 1e-3
_LARGEST = 1e8
_MOVE = (("xTranslation", "0"), ("yTranslation", "0"), ("zRotation", "0"), ("scaling", "1"))


@dataclass(slots=True)
class _Lanelet:
    bounds: dict[str, list[list[float]]] = field(default_factory=lambda: {"leftBound": [], "rightBound": []})
    refs: dict[str, set[str]] = field(default_factory=dict[str, set[str]])
    types: set[str] = field(default_factory=set[str])
    users: set[str] = field(default_factory=set[str])
    limit: str = ""


@dataclass(slots=True)
class _Content:
    lanelets: dict[str, _Lanelet] = field(default_factory=dict[str, _Lanelet])
    limits: dict[str, list[str]] = field(default_factory=dict[str, list[str]])
    """Sign -> the values of its speed limits."""
    dark: set[str] = field(default_factory=set[str])
    inside: set[str] = field(default_factory=set[str])
    incoming: set[str] = field(default_factory=set[str])
    move: dict[str, str] = field(default_factory=dict[str, str])


class _Handler(ContentHandler):
    """Gathers what counts, by the path of open elements."""

    def __init__(self) -> None:
        super().__init__()
        self.found = _Content()
        self._open: list[str] = []
        self._text = ""
        self._owner = ""
        self._sign = ""

    def startElement(self, name: str, attrs: AttributesImpl) -> None:  # noqa: N802  (the name is xml.sax's)
        self._open.append(name)
        self._text = ""
        found = self.found
        if len(self._open) == 2:
            self._owner = str(attrs.get("id", ""))
            if name == "lanelet":
                found.lanelets[self._owner] = _Lanelet()
            return
        match self._open[1:]:
            case ["lanelet", ("predecessor" | "successor" | "trafficSignRef" | "trafficLightRef") as tag]:
                self._lanelet.refs.setdefault(tag, set()).add(str(attrs.get("ref", "")))
            case ["lanelet", "stopLine", ("trafficSignRef" | "trafficLightRef") as tag]:
                self._lanelet.refs.setdefault(tag, set()).add(str(attrs.get("ref", "")))
            case ["lanelet", ("leftBound" | "rightBound") as side, "point"]:
                self._lanelet.bounds[side].append([math.nan, math.nan])
            case ["intersection", "incoming", "incomingLanelet"]:
                found.incoming.add(str(attrs.get("ref", "")))
            case ["intersection", "incoming", tag] if tag.startswith("successors"):
                found.inside.add(str(attrs.get("ref", "")))
            case _:
                pass

    def characters(self, content: str) -> None:
        self._text += content

    def endElement(self, name: str) -> None:  # noqa: ARG002, N802  (the names are xml.sax's)
        text, found = self._text.strip(), self.found
        match self._open[1:]:
            case ["lanelet", ("leftBound" | "rightBound") as side, "point", ("x" | "y") as axis]:
                self._lanelet.bounds[side][-1]["xy".index(axis)] = _number(text)
            case ["lanelet", "laneletType"]:
                self._lanelet.types.add(text)
            case ["lanelet", "userOneWay" | "userBidirectional"]:
                self._lanelet.users.add(text)
            case ["lanelet", "speedLimit"]:
                self._lanelet.limit = text
            case ["trafficSign", "trafficSignElement", "trafficSignID"]:
                self._sign = text
            case ["trafficSign", "trafficSignElement", "additionalValue"] if self._sign in _LIMIT_SIGNS:
                found.limits.setdefault(self._owner, []).append(text)
            case ["trafficLight", "active"] if text == "false":
                found.dark.add(self._owner)
            case ["location", "geoTransformation", *_, tag]:
                found.move.setdefault(tag, text)
            case _:
                pass
        self._open.pop()
        self._text = ""

    @property
    def _lanelet(self) -> _Lanelet:
        return self.found.lanelets[self._owner]


def count_commonroad(path: Path) -> SourceCount:
    """What a CommonRoad file holds; MapError if it cannot be read."""
    handler = _Handler()
    try:
        data = path.read_bytes()
        parseString(gzip.decompress(data) if data[:2] == b"\x1f\x8b" else data, handler)
    except (OSError, EOFError, zlib.error, SAXException, DefusedXmlException, ValueError, LookupError) as error:
        raise MapError(f"{path}: the file cannot be counted ({error}); copy or download it again") from error
    found = handler.found
    closed = {id_: why for id_, lanelet in found.lanelets.items() if (why := _closed(lanelet))}
    cars = {id_: lanelet for id_, lanelet in found.lanelets.items() if id_ not in closed}
    links, leaving = _links(found, cars)
    limits = {id_: _limit_mps(found, lanelet) for id_, lanelet in cars.items()}
    to_globe = _to_globe(found.move)
    return SourceCount(
        lane_length_m={id_: _length_m(lanelet, to_globe) for id_, lanelet in cars.items()},
        links=frozenset(links),
        leaving=leaving,
        lit=_lit(found, cars, links),
        limit_mps={id_: limit for id_, limit in limits.items() if limit is not None},
        crosswalks=sum(why == "crosswalk" for why in closed.values()),
        left_out=Counter(closed.values()),
    )


def _number(text: str) -> float:
    value = float(text)
    if not abs(value) < _LARGEST:
        raise ValueError(f"{value:g} cannot be")
    return value


def _closed(lanelet: _Lanelet) -> str:
    """What keeps cars off a lanelet, empty where nothing does."""
    if min(_drawn_points(bound) for bound in lanelet.bounds.values()) < 2:
        return "lanelet without length"
    for kind in _CLOSED_TYPES:
        if kind in lanelet.types:
            return kind
    users = lanelet.users - {"priorityVehicle"}
    if users.intersection(("car", "vehicle")):
        return ""
    return next((kind for kind in _OPEN_TO_NAMED_CARS if kind in lanelet.types), " ".join(sorted(users)))


def _drawn_points(points: list[list[float]]) -> int:
    """How many points a line has, repeated ones counted once."""
    return sum(not i or math.dist(points[i - 1], point) > _SAME_M for i, point in enumerate(points))


def _links(found: _Content, cars: dict[str, _Lanelet]) -> tuple[set[tuple[str, str]], int]:
    links: set[tuple[str, str]] = set()
    beyond: set[tuple[str, str]] = set()
    for id_, lanelet in cars.items():
        ways = [(id_, other) for other in lanelet.refs.get("successor", ())]
        ways += [(other, id_) for other in lanelet.refs.get("predecessor", ())]
        for start, end in ways:
            if start in cars and end in cars:
                links.add((start, end))
            elif start not in found.lanelets or end not in found.lanelets:
                beyond.add((start, end))
    return links, len(beyond)


def _lit(found: _Content, cars: dict[str, _Lanelet], links: set[tuple[str, str]]) -> frozenset[str]:
    """Lanes at which a light holds: where several in a row name it, those from which it is not named again."""
    inside = found.inside - found.incoming
    inside |= {id_ for id_, lanelet in cars.items() if "intersection" in lanelet.types}
    lights = {id_: lanelet.refs.get("trafficLightRef", set()) - found.dark for id_, lanelet in cars.items()}
    again: dict[str, set[str]] = {id_: set() for id_ in cars}
    for start, end in links:
        if start not in inside and end not in inside:
            again[start] |= lights[end]
    return frozenset(id_ for id_ in cars if lights[id_] - again[id_])


def _limit_mps(found: _Content, lanelet: _Lanelet) -> float | None:
    texts = [lanelet.limit, *(v for sign in lanelet.refs.get("trafficSignRef", ()) for v in found.limits.get(sign, ()))]
    values: list[float] = []
    for text in texts:
        number = text.rstrip("kmph/s ")
        try:
            values.append(float(number) * _UNITS[text[len(number) :].strip()])
        except (ValueError, KeyError):
            continue
    return min((value for value in values if 0.0 < value <= _TOP_MPS), default=None)


def _to_globe(move: dict[str, str]) -> tuple[pyproj.Transformer, float, float, float, float] | None:
    """To longitude and latitude, with shift, turn and scale; None where the file names no usable system."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            own = pyproj.CRS(move["geoReference"])
        if not own.is_projected:
            return None
        shift_x, shift_y, turn, scale = (_number(move.get(name, default)) for name, default in _MOVE)
        return pyproj.Transformer.from_crs(own, own.geodetic_crs, always_xy=True), shift_x, shift_y, turn, scale
    except (KeyError, ValueError, CRSError):
        return None


def _length_m(lanelet: _Lanelet, to_globe: tuple[pyproj.Transformer, float, float, float, float] | None) -> float:
    """Length of the middle: halfway between points of equal share of the two bounds."""
    left, right = (_at_shares(np.array(lanelet.bounds[side])) for side in ("leftBound", "rightBound"))
    x, y = ((left + right) / 2.0).T
    if to_globe is not None:
        transformer, shift_x, shift_y, turn, scale = to_globe
        place = (x + 1j * y) * scale * np.exp(1j * turn) + shift_x + 1j * shift_y
        longitude, latitude = transformer.transform(place.real, place.imag)
        if np.isfinite(longitude).all():
            return float(pyproj.Geod(ellps="WGS84").line_length(longitude, latitude))
    return float(np.hypot(np.diff(x), np.diff(y)).sum())


def _at_shares(points: np.ndarray) -> np.ndarray:
    """201 points at equal shares of a line's length."""
    run = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))))
    at = np.linspace(0.0, run[-1], 201)
    return np.stack((np.interp(at, run, points[:, 0]), np.interp(at, run, points[:, 1])), axis=1)
