"""Lanelets with their boundaries turned to run with the traffic, and what each is for by its tags."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import numpy as np
import shapely

from interplan_sumo.maps.importers.lanelet2.osm import OsmFile, Relation
from interplan_sumo.maps.importers.lines import along, ring
from interplan_sumo.world.geometry import Floats

_SHORT_M = 0.1
_NARROW_M = 0.3
_WIDE_M = 100.0


class UnusableError(Exception):
    """A lanelet or area that cannot be used, with the reason that a user reads."""


@dataclass(frozen=True, slots=True, eq=False)
class Bound:
    """A way as one boundary of a lanelet, in the direction of travel."""

    nodes: tuple[str, ...]
    points: Floats
    """(N, 2) metres, without repetitions."""

    def turned(self) -> Bound:
        return Bound(self.nodes[::-1], self.points[::-1])


@dataclass(frozen=True, eq=False)
class Lanelet:
    """A lanelet of any kind; `left` and `right` run the same way, with left on the left."""

    id: str
    tags: dict[str, str]
    left: Bound
    right: Bound
    rules: tuple[str, ...]
    """Ids of the regulatory elements that it names."""

    @cached_property
    def polygon(self) -> shapely.Polygon | None:
        """None where the boundaries enclose nothing."""
        return ring(np.concatenate((self.right.points, self.left.points[::-1])))

    @property
    def mean_length_m(self) -> float:
        return (length_m(self.left.points) + length_m(self.right.points)) / 2.0

    @property
    def mean_width_m(self) -> float:
        return 0.0 if self.polygon is None else self.polygon.area / self.mean_length_m


def truth(text: str, default: bool) -> bool:
    """A tag's value as Lanelet2 reads it: yes, true and 1; no, false and 0."""
    low = text.lower()
    return True if low in ("yes", "true", "1") else False if low in ("no", "false", "0") else default


def length_m(points: Floats) -> float:
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def points_of(file: OsmFile, points: dict[str, tuple[float, float]], way: str) -> Floats:
    """(N, 2) vertices of a way; UnusableError if it, or one of its nodes, is not there or has no place."""
    if way not in file.ways:
        raise UnusableError("names a way that the file lacks")
    if any(node not in points for node in file.ways[way].nodes):
        raise UnusableError("names a point that the file lacks or does not place")
    return np.array([points[node] for node in file.ways[way].nodes], dtype=np.float64).reshape(-1, 2)


def lanelet_of(file: OsmFile, points: dict[str, tuple[float, float]], relation: Relation) -> Lanelet:
    """The lanelet that a relation describes; UnusableError where a boundary is missing.

    The order of a way's nodes means nothing: the roles say which boundary is
    on the left, and so the direction of travel. Each one is turned until the
    middle of the other lies on its proper side, as Lanelet2 does it.
    """
    left, right = (_bound(file, points, relation, role) for role in ("left", "right"))
    at_left, at_right = _middle_vertex(left.points), _middle_vertex(right.points)
    if not _is_left_of(right.points, at_left):
        right = right.turned()
    if _is_left_of(left.points, at_right):
        left = left.turned()
    return Lanelet(relation.id, relation.tags, left, right, relation.refs("regulatory_element", "relation"))


def check_drivable(lanelet: Lanelet) -> None:
    """UnusableError for a lanelet that no car fits on."""
    if lanelet.mean_length_m < _SHORT_M:
        raise UnusableError(f"is shorter than {_SHORT_M:g} m")
    left, right = shapely.LineString(lanelet.left.points), shapely.LineString(lanelet.right.points)
    if left.crosses(right) or left.intersection(right).length > _SHORT_M:
        raise UnusableError("has boundaries that cross")
    if lanelet.mean_width_m < _NARROW_M:
        raise UnusableError(f"is narrower than {_NARROW_M:g} m")
    if lanelet.mean_width_m > _WIDE_M:
        raise UnusableError(f"is wider than {_WIDE_M:g} m")


def between(left: Floats, right: Floats, share_of_left: Callable[[Floats], Floats], spacing_m: float) -> Floats:
    """(N, 2) a line from between the beginnings of two lines to between their ends.

    The two are matched by relative arc length; `share_of_left` says for these
    how much of the left one enters. Each vertex of theirs gives one, and more
    stand between so that none are further apart than `spacing_m`.
    """
    shares = [np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T)))) for line in (left, right)]
    steps = 1 + int(max(share[-1] for share in shares) / spacing_m)
    shares = [share / share[-1] for share in shares]
    at = np.unique(np.concatenate((*shares, np.linspace(0.0, 1.0, steps + 1))))
    at = at[np.diff(at, prepend=-1.0) > 1e-9]
    lines = [
        np.stack([np.interp(at, share, line[:, axis]) for axis in (0, 1)], axis=1)
        for share, line in zip(shares, (left, right), strict=True)
    ]
    of_left = share_of_left(at)[:, None]
    return of_left * lines[0] + (1.0 - of_left) * lines[1]


def _bound(file: OsmFile, points: dict[str, tuple[float, float]], relation: Relation, role: str) -> Bound:
    ways = relation.refs(role)
    if len(ways) != 1:
        raise UnusableError(f"names {len(ways) or 'no'} ways as its {role} boundary, needs one")
    line = along(points_of(file, points, ways[0]))
    if len(line) < 2:
        raise UnusableError("has a boundary without length")
    return Bound(file.ways[ways[0]].nodes, line)


def _middle_vertex(points: Floats) -> Floats:
    return points[len(points) // 2] if len(points) > 2 else points.mean(axis=0)


def _is_left_of(line: Floats, point: Floats) -> bool:
    """Whether a point lies left of a line; next to a bend, of the mean of its two directions."""
    steps = np.diff(line, axis=0)
    lengths = np.hypot(*steps.T)
    units = steps / lengths[:, None]
    along = np.clip(((point - line[:-1]) * units).sum(axis=1), 0.0, lengths)
    away = point - line[:-1] - along[:, None] * units
    nearest = int(np.argmin(np.hypot(*away.T)))
    direction = units[nearest]
    if nearest + 1 < len(units) and along[nearest] == lengths[nearest]:
        direction = direction + units[nearest + 1]
    return bool(direction[0] * away[nearest, 1] - direction[1] * away[nearest, 0] > 0.0)


class Kind(Enum):
    """What becomes of a lanelet."""

    LANE = "lane"
    CROSSWALK = "crosswalk"
    WALKWAY = "walkway"
    DRIVABLE = "drivable"
    """Not for cars, but paved: they may stand on it."""
    OTHER = "other"


_PARTICIPANT = "participant:"
_CAR_LANES = frozenset({"", "road", "highway", "play_street", "exit"})
_KINDS = {
    "crosswalk": Kind.CROSSWALK,
    "walkway": Kind.WALKWAY,
    "shared_walkway": Kind.WALKWAY,
    "stairs": Kind.WALKWAY,
    "pedestrian_lane": Kind.WALKWAY,
    "bus_lane": Kind.DRIVABLE,
    "bicycle_lane": Kind.DRIVABLE,
    "emergency_lane": Kind.DRIVABLE,
    "road_shoulder": Kind.DRIVABLE,
}


def kind_of(tags: dict[str, str]) -> Kind:
    """What to make of a lanelet; tags such as participant:vehicle=no outrank its subtype."""
    subtype = tags.get("subtype", "")
    kind = Kind.LANE if subtype in _CAR_LANES else _KINDS.get(subtype, Kind.OTHER)
    if kind is Kind.CROSSWALK:
        return kind
    if truth(tags.get("no_drivable_lane", ""), False):
        return Kind.DRIVABLE
    allowed = _allowed(tags)
    if allowed is None:
        return kind
    if any(_is_car(participant) for participant in allowed):
        return Kind.LANE
    if kind is not Kind.LANE:
        return kind
    return Kind.DRIVABLE if "pedestrian" not in allowed else Kind.WALKWAY


def reason_of(tags: dict[str, str]) -> str:
    """Why a lanelet is no lane for cars, in words."""
    subtype = tags.get("subtype", "")
    if truth(tags.get("no_drivable_lane", ""), False):
        return "lane out of use"
    if subtype in _CAR_LANES:
        return "lane closed to cars"
    return subtype.replace("_", " ") if subtype in _KINDS else f"lanelet of subtype {subtype[:40]!r}"


def _allowed(tags: dict[str, str]) -> set[str] | None:
    """The participants that may pass, where tags name them; None if the subtype has to tell.

    Naming one shuts out all others, as in Lanelet2. Naming only some that may
    not pass leaves cars to the subtype, unless they are among these.
    """
    named = {key.removeprefix(_PARTICIPANT): value for key, value in tags.items() if key.startswith(_PARTICIPANT)}
    allowed = {key for key, value in named.items() if truth(value, False)}
    return allowed if allowed or any(_is_car(participant) for participant in named) else None


def _is_car(participant: str) -> bool:
    return participant == "vehicle" or f"{participant}:".startswith("vehicle:car:")
