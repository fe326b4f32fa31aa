"""A second reading of Lanelet2 files: the whole tree at once, lengths measured on the globe."""

from __future__ import annotations

import math
import warnings
from collections import Counter, defaultdict
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element, ParseError

import numpy as np
from defusedxml import DefusedXmlException
from defusedxml.ElementTree import parse
from numpy.typing import NDArray
from pyproj import Geod, Transformer
from pyproj.crs import CRS
from pyproj.exceptions import ProjError

from interplan_sumo.errors import MapError
from interplan_sumo.maps.importers.source import SourceCount

_GLOBE = Geod(ellps="WGS84")
_EARTH_M = 6_371_000.0
_FOR_CARS = ("road", "highway", "play_street", "exit", "")
_ON_FOOT = ("crosswalk", "walkway", "shared_walkway", "stairs", "pedestrian_lane")
_TWO_LANES_M = 4.5
_LAW_KMH = {"road": (50.0, 100.0), "highway": (130.0, 130.0), "play_street": (7.0, 7.0), "exit": (50.0, None)}
_ZONES_KMH = {"274.1": 30.0, "310": 50.0, "311": 100.0, "325": 7.0, "325.1": 7.0}
_SHARES = np.linspace(0.0, 1.0, 201)

_Line = NDArray[np.complex128]  # east + north * 1j: degrees on the globe, else the file's own metres


class _Direction(NamedTuple):
    lane: str
    first: tuple[str, str]
    """Nodes at the beginning of the left and of the right boundary."""
    last: tuple[str, str]


class _Lanelet(NamedTuple):
    id: str
    tags: dict[str, str]
    rules: list[str]
    left: list[str]
    """Nodes along the lanelet's own direction."""
    right: list[str]
    left_line: _Line
    """The same boundaries at 201 equal shares of their lengths."""
    right_line: _Line
    width_m: float

    @property
    def is_split(self) -> bool:
        tags = self.tags
        one_way = tags.get("one_way:vehicle:car", tags.get("one_way:vehicle", tags.get("one_way", "yes")))
        return one_way.lower() in ("no", "false", "0") and self.width_m >= _TWO_LANES_M

    @property
    def directions(self) -> list[_Direction]:
        """The lane, or the two of a lanelet that is split."""
        (a, b), (c, d) = (self.left[0], self.right[0]), (self.left[-1], self.right[-1])
        there, back = _Direction(self.id, (a, b), (c, d)), _Direction(f"{self.id}:back", (d, c), (b, a))
        return [there, back] if self.is_split else [there]


class _Places:
    """Where nodes lie, and how long lines between them are."""

    def __init__(self, root: Element) -> None:
        degrees, metres = _points(root, "lon", "lat", tagged=False), _points(root, "local_x", "local_y", tagged=True)
        self._on_globe = _varies(degrees) and not _contradict(root, degrees, metres)
        self._at = degrees if self._on_globe else metres
        for system in () if self._on_globe else _systems(root):
            placed = _through(system, metres)
            if _varies(placed):
                self._on_globe, self._at = True, placed
                break

    def line(self, nodes: Sequence[str]) -> _Line:
        """The line through nodes; KeyError where one has no place."""
        return np.array([self._at[node] for node in nodes])

    def length_m(self, line: _Line) -> float:
        if self._on_globe:
            return float(_GLOBE.line_length(line.real, line.imag))
        return float(np.abs(np.diff(line)).sum())

    def flat_m(self, line: _Line) -> _Line:
        """Metres on a plane that touches the globe at the line."""
        if not self._on_globe:
            return line
        per_degree = np.radians(1.0) * _EARTH_M
        return line.real * per_degree * np.cos(np.radians(line.imag.mean())) + 1j * line.imag * per_degree


def count_lanelet2(path: Path) -> SourceCount:
    """What a Lanelet2 file holds; MapError if it cannot be read."""
    try:
        root: Element | None = parse(str(path), forbid_dtd=True).getroot()
    except (OSError, ParseError, DefusedXmlException, LookupError, ValueError) as error:
        what = " ".join(str(error).split())
        raise MapError(f"{path}: the file cannot be counted ({what}); copy or download it again") from error
    if root is None:
        raise MapError(f"{path}: the file is empty; copy or download it again")
    _drop_deleted(root)
    places = _Places(root)
    ways = {way.get("id", ""): way for way in reversed(root.findall("way"))}
    rules = {rule.get("id", ""): rule for rule in _relations(root, "regulatory_element")}
    lanes: dict[str, _Lanelet] = {}
    others: Counter[str] = Counter()
    for relation in _relations(root, "lanelet"):
        id_, tags = relation.get("id", "").strip(), _tags(relation)
        lanelet = None if id_ in lanes else _lanelet(relation, ways, places)
        kind = _kind(tags)
        if lanelet is None or (not kind and _cross(places, lanelet)):
            others["lanelet that cannot be drawn"] += 1
        elif kind:
            others[kind] += 1
        else:
            lanes[id_] = lanelet
    limits = {id_: _limit_mps(lanelet, rules, ways) for id_, lanelet in lanes.items()}
    return SourceCount(
        lane_length_m=_lengths(places, lanes),
        links=_links(lanes),
        leaving=0,
        lit=frozenset(lane for lanelet in lanes.values() for lane in _lit(lanelet, rules, ways, places)),
        limit_mps={
            lane: limit
            for id_, lanelet in lanes.items()
            if (limit := limits[id_]) is not None
            for lane, *_ in lanelet.directions
        },
        crosswalks=others["crosswalk"],
        left_out=others,
    )


# --- elements ------------------------------------------------------------------------------------------


def _drop_deleted(root: Element) -> None:
    for child in list(root):
        if child.get("action") == "delete" or child.get("visible") == "false":
            root.remove(child)


def _tags(element: Element) -> dict[str, str]:
    return {tag.get("k", "").strip(): tag.get("v", "").strip() for tag in element.findall("tag")}


def _relations(root: Element, type_: str) -> list[Element]:
    return [relation for relation in root.findall("relation") if _tags(relation).get("type") == type_]


def _members(relation: Element, role: str) -> list[str]:
    return [m.get("ref", "").strip() for m in relation.findall("member") if m.get("role") == role]


def _nodes(way: Element) -> list[str]:
    return [nd.get("ref", "").strip() for nd in way.findall("nd")]


def _points(root: Element, x: str, y: str, *, tagged: bool) -> dict[str, complex]:
    found: dict[str, complex] = {}
    for node in root.findall("node"):
        values = _tags(node) if tagged else node.attrib
        try:
            at = complex(float(values[x]), float(values[y]))
        except (KeyError, ValueError):
            continue
        if abs(at) < 1e8 and (tagged or (abs(at.real) <= 180.0 and abs(at.imag) <= 90.0)):
            found.setdefault(node.get("id", "").strip(), at)
    return found


def _varies(points: dict[str, complex]) -> bool:
    at: _Line = np.array(list(points.values()), dtype=np.complex128)
    return len(at) > 1 and float(max(np.ptp(at.real), np.ptp(at.imag))) > 1e-6


def _contradict(root: Element, degrees: dict[str, complex], metres: dict[str, complex]) -> bool:
    """Whether local metres show ways of another size than degrees do, and not that of Web Mercator."""
    steps = [pair for way in root.findall("way") for pair in pairwise(_nodes(way))]
    both = degrees.keys() & metres.keys()
    steps = [(a, b) for a, b in steps if a in both and b in both and a != b]
    if not steps or len(metres) < len(root.findall("node")) or _systems(root):
        return False
    start: _Line = np.array([degrees[a] for a, _ in steps], dtype=np.complex128)
    end: _Line = np.array([degrees[b] for _, b in steps], dtype=np.complex128)
    on_globe = np.array(_GLOBE.inv(start.real, start.imag, end.real, end.imag)[2])
    on_plane = np.array([abs(metres[b] - metres[a]) for a, b in steps])
    moved = on_globe > 0.0
    scale = float(np.median(on_plane[moved] / on_globe[moved])) if moved.any() else 0.0
    mercator = 1.0 / math.cos(math.radians(float(np.median(start.imag))))
    return min(abs(scale - 1.0), abs(scale / mercator - 1.0)) > 0.01


def _systems(root: Element) -> list[str]:
    texts = [value for key, value in root.attrib.items() if key.lower() == "georeference"]
    for child in root:
        if child.tag.lower() == "georeference":
            texts.append(child.get("v") or (child.text or "").strip())
        elif child.tag not in ("node", "way", "relation"):
            texts += [value for key, value in child.attrib.items() if key.lower() == "georeference"]
            texts += [child.get("v", "")] if child.get("k", "").lower() == "georeference" else []
    return texts


def _through(system: str, metres: dict[str, complex]) -> dict[str, complex]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            own = CRS(system)
        if not own.is_projected or not metres:
            return {}
        to_globe = Transformer.from_crs(own, "OGC:CRS84", always_xy=True)
    except ProjError:
        return {}
    at: _Line = np.array(list(metres.values()), dtype=np.complex128)
    lon, lat = to_globe.transform(at.real, at.imag)
    return {id_: complex(x, y) for id_, x, y in zip(metres, lon, lat, strict=True) if np.isfinite([x, y]).all()}


# --- lanelets ------------------------------------------------------------------------------------------


def _kind(tags: dict[str, str]) -> str:
    """What a lanelet is if it is not for cars, empty if it is."""
    subtype = tags.get("subtype", "")
    if subtype == "crosswalk":
        return subtype
    if tags.get("no_drivable_lane", "").lower() in ("yes", "true", "1"):
        return "out of use"
    users = {
        key[12:]: value.lower() in ("yes", "true", "1") for key, value in tags.items() if key[:12] == "participant:"
    }
    cars = [may for user, may in users.items() if user in ("vehicle", "vehicle:car") or user[:12] == "vehicle:car:"]
    if any(cars) or (not cars and not any(users.values()) and subtype in _FOR_CARS):
        return ""
    return subtype if subtype not in _FOR_CARS else "closed to cars"


def _lanelet(relation: Element, ways: dict[str, Element], places: _Places) -> _Lanelet | None:
    """A lanelet with its boundaries along its direction of travel; None if one of them cannot be drawn."""
    bounds = [_members(relation, role) for role in ("left", "right")]
    try:
        left, right = (_nodes(ways[way]) for (way,) in bounds)
        corners = [places.line(left), places.line(right)]
        left_line, right_line = (_even(line, places) for line in corners)
    except (KeyError, ValueError):
        return None
    flat = places.flat_m(np.concatenate((left_line, right_line, *corners)))
    one, other = flat[:201], flat[201:402]
    if min(np.abs(one - other).max(), np.abs(one - other[::-1]).max()) < 0.01:
        return None
    of_left, of_right = flat[402 : 402 + len(left)], flat[402 + len(left) :]
    if _side(of_left, _middle(of_right)) > 0.0:
        left, left_line, one = left[::-1], left_line[::-1], one[::-1]
    if _side(of_right, _middle(of_left)) < 0.0:
        right, right_line, other = right[::-1], right_line[::-1], other[::-1]
    steps, across = np.diff(one + other) / 2.0, one - other
    width_m = float((steps.conj() * (across[1:] + across[:-1]) / 2.0).imag.sum() / np.abs(steps).sum())
    rules = _members(relation, "regulatory_element")
    id_ = relation.get("id", "").strip()
    return _Lanelet(id_, _tags(relation), rules, left, right, left_line, right_line, width_m)


def _middle(corners: _Line) -> complex:
    """The vertex that Lanelet2 takes for the middle of a line."""
    return complex(corners[len(corners) // 2]) if len(corners) > 2 else complex(corners.mean())


def _side(corners: _Line, point: complex) -> float:
    """Positive if a point lies left of a line, negative if it lies right; at a corner both directions count."""
    steps = np.diff(corners)
    start, steps = corners[:-1][steps != 0.0], steps[steps != 0.0]
    steps_m = np.abs(steps)
    along_m = np.clip(((point - start) * steps.conj()).real / steps_m, 0.0, steps_m)
    off = point - start - along_m * steps / steps_m
    nearest = int(np.abs(off).argmin())
    at_corner = along_m[nearest] == steps_m[nearest]
    direction = (steps / steps_m)[nearest : nearest + (2 if at_corner else 1)].sum()
    return float((direction.conjugate() * off[nearest]).imag)


def _even(line: _Line, places: _Places) -> _Line:
    """201 points at equal shares of the length; ValueError for a line without length."""
    if len(line) < 2:
        raise ValueError("a point")
    run_m = np.concatenate(([0.0], np.abs(np.diff(places.flat_m(line))).cumsum()))
    if run_m[-1] < 1e-3:
        raise ValueError("a point")
    return np.interp(_SHARES * run_m[-1], run_m, line)


def _cross(places: _Places, lanelet: _Lanelet) -> bool:
    """Whether a step of one boundary passes over a step of the other."""
    flat = places.flat_m(places.line(lanelet.left + lanelet.right))
    left, right = flat[: len(lanelet.left)], flat[len(lanelet.left) :]
    a, b, c, d = left[:-1, None], left[1:, None], right[None, :-1], right[None, 1:]
    over = _turn(a, b, c) * _turn(a, b, d) < 0.0
    return bool((over & (_turn(c, d, a) * _turn(c, d, b) < 0.0)).any())


def _turn(a: _Line, b: _Line, c: _Line) -> NDArray[np.float64]:
    """1 where c lies to the left of the line from a to b, -1 to the right, 0 on it."""
    area_m2 = ((b - a).conj() * (c - a)).imag
    return np.sign(np.where(np.abs(area_m2) > 1e-6, area_m2, 0.0))


def _links(lanes: dict[str, _Lanelet]) -> frozenset[tuple[str, str]]:
    starts: defaultdict[tuple[str, str], list[str]] = defaultdict(list)
    ways = [way for lanelet in lanes.values() for way in lanelet.directions]
    for lane, first, _ in ways:
        starts[first].append(lane)
    return frozenset(
        (lane, onward)
        for lane, _, last in ways
        for onward in starts[last]
        if onward.partition(":")[0] != lane.partition(":")[0]
    )


def _lengths(places: _Places, lanes: dict[str, _Lanelet]) -> dict[str, float]:
    """Of the middle of each lane, which is that of a half where a lanelet is split."""
    share = 0.25 if _keeps_right(lanes) else 0.75
    lengths: dict[str, float] = {}
    for lanelet in lanes.values():
        of_left = (share, 1.0 - share) if lanelet.is_split else (0.5,)
        for (lane, _, _), part in zip(lanelet.directions, of_left, strict=True):
            lengths[lane] = places.length_m(lanelet.left_line * part + lanelet.right_line * (1.0 - part))
    return lengths


def _keeps_right(lanes: dict[str, _Lanelet]) -> bool:
    """Oncoming lanes have their left boundaries in common where traffic keeps right, else their right ones."""
    votes = 0
    for vote, side in ((1, "left"), (-1, "right")):
        bounds = {tuple(getattr(lane, side)) for lane in lanes.values() if not lane.is_split}
        votes += vote * sum(nodes[::-1] in bounds for nodes in bounds)
    return votes >= 0


# --- rules ---------------------------------------------------------------------------------------------


def _lit(lanelet: _Lanelet, rules: dict[str, Element], ways: dict[str, Element], places: _Places) -> set[str]:
    """The lanes of a lanelet that name a light; the way back where the stop line lies at the lanelet's beginning."""
    lit: set[str] = set()
    for id_ in lanelet.rules:
        if id_ in rules and _tags(rules[id_]).get("subtype") == "traffic_light":
            lines = [_nodes(ways[way]) for way in _members(rules[id_], "ref_line") if way in ways]
            lit.add(lanelet.directions[-1 if _begins_at(lanelet, lines, places) else 0][0])
    return lit


def _begins_at(lanelet: _Lanelet, lines: list[list[str]], places: _Places) -> bool:
    middle = (lanelet.left_line + lanelet.right_line) / 2.0
    nearest: list[tuple[float, bool]] = []
    for nodes in lines:
        try:
            ends = places.flat_m(np.concatenate((middle[[0, -1]], _even(places.line(nodes), places))))
        except (KeyError, ValueError):
            continue
        gaps = [float(np.abs(ends[2:] - ends[k]).min()) for k in (0, 1)]
        nearest.append((min(gaps), gaps[0] < gaps[1]))
    if nearest:
        return min(nearest)[1]
    return bool(lanelet.tags.get("turn_direction"))


def _limit_mps(lanelet: _Lanelet, rules: dict[str, Element], ways: dict[str, Element]) -> float | None:
    tags = lanelet.tags
    stated: list[str] = []
    for rule in (rules[id_] for id_ in lanelet.rules if id_ in rules):
        if _tags(rule).get("subtype") == "speed_limit":
            stated.append(_tags(rule).get("sign_type", ""))
            for sign in (_tags(ways[way]) for way in _members(rule, "refers") if way in ways):
                stated += [sign.get("sign_type", ""), sign.get("subtype", "")]
    stated += [tags.get(f"speed_limit{user}", "") for user in (":vehicle:car", ":vehicle", "")]
    for text in stated:
        if (limit := _speed_mps(text)) is not None:
            return limit
    if tags.get("region", "de")[:2].lower() != "de":
        return None
    in_town = {"urban": 0, "nonurban": 1}.get(tags.get("location", "urban"))
    kmh = None if in_town is None else _LAW_KMH.get(tags.get("subtype") or "road", (None, None))[in_town]
    return None if kmh is None else kmh / 3.6


def _speed_mps(text: str) -> float | None:
    """A speed, or the one on a German sign."""
    low = text.lower().replace("_", ".").replace(",", ".").replace(" ", "")
    if low.startswith("de"):
        code, _, value = low[2:].partition("-")
        if value.isdigit() and code.startswith("274"):
            return float(value) / 3.6
        return _ZONES_KMH[code] / 3.6 if code in _ZONES_KMH else None
    low = low.removeprefix("speedlimit").removeprefix("speed.limit").removeprefix("maxspeed").lstrip("-.")
    number = low.rstrip("abcdefghijklmnopqrstuvwxyz/")
    factor = {"mph": 0.44704, "m/s": 1.0, "mps": 1.0, "ms": 1.0}.get(low[len(number) :], 1.0 / 3.6)
    try:
        speed = float(number) * factor
    except ValueError:
        return None
    return speed if 0.0 < speed <= 150.0 else None
