"""What an OpenDRIVE file holds, as plain data; stations are metres along the reference line of a road."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from interplan_sumo.maps.importers.opendrive.curves import PiecewiseCubic, ReferenceLine

Corner = tuple[str, float, float]
"""A corner of an outline: "road" with s and t, or "local" with u and v."""


class UnusableRoadError(ValueError):
    """Why a road cannot be used, in words."""


@dataclass(frozen=True, slots=True)
class XodrAccess:
    """Who may use a lane from a station of its section on."""

    offset_m: float
    allows: bool
    """Whether those who are named may use it, and nobody else; otherwise all but those."""
    users: frozenset[str]


@dataclass(frozen=True, slots=True, eq=False)
class XodrLane:
    """One lane of a lane section."""

    id: int
    """Counted from the middle, positive to the left of the reference line."""
    kind: str
    """The file's type, such as "driving"."""
    width: PiecewiseCubic | None
    """Stations from the start of the section."""
    border: PiecewiseCubic | None
    """How far its outer edge lies to the left of the reference line, in place of a width."""
    predecessors: tuple[int, ...]
    successors: tuple[int, ...]
    limits: tuple[tuple[float, float | None], ...]
    """From which station of the section on which limit holds, in m/s."""
    access: tuple[XodrAccess, ...]
    direction: str
    """"standard", "reversed" or "both"."""


@dataclass(frozen=True, slots=True, eq=False)
class XodrSection:
    """Lanes side by side between two stations."""

    number: int
    start_m: float
    lanes: tuple[XodrLane, ...]
    """Of both sides, without the one of no width in the middle."""
    left_only: bool = False
    right_only: bool = False
    """The section speaks for one side; the other goes on as before."""

    def side(self, *, left: bool) -> list[XodrLane]:
        """The lanes of one side, from the middle outwards."""
        return sorted((lane for lane in self.lanes if (lane.id > 0) == left), key=lambda lane: abs(lane.id))


@dataclass(frozen=True, slots=True)
class XodrLink:
    """What a road joins at one of its ends."""

    is_junction: bool
    id: str
    contact: str | None
    """"start" or "end" of the other road."""
    station_m: float | None
    """Where a way of a virtual junction leaves or joins the other road."""


@dataclass(frozen=True, slots=True)
class XodrSignal:
    """A signal, or a reference to one, with the place where it holds."""

    id: str
    station_m: float
    left_m: float
    orientation: str
    """"+" for traffic along the reference line, "-" against it, else both."""
    is_dynamic: bool
    kind: str
    country: str
    name: str
    meaning: str
    """What the file says that it means (1.8): "stop", "yield", "trafficLight", "stopLine", or nothing."""
    validity: tuple[tuple[int, int], ...]
    """Ranges of lane ids, lowest first."""
    is_reference: bool = False
    says_limit: bool = False
    """Whether it begins or ends a speed limit."""
    limit_mps: float | None = None
    """The limit that it begins, NaN where that cannot be told; None where it ends one."""


@dataclass(frozen=True, slots=True)
class XodrRepeat:
    """Copies of an object along the road."""

    station_m: float
    length_m: float
    distance_m: float
    left_m: tuple[float, float]
    """At the first and the last copy."""


@dataclass(frozen=True, slots=True)
class XodrObject:
    """Something on or beside a road."""

    id: str
    kind: str
    subtype: str
    name: str
    station_m: float
    left_m: float
    heading_rad: float
    """Against the road's."""
    length_m: float
    width_m: float
    outlines: tuple[tuple[Corner, ...], ...]
    repeats: tuple[XodrRepeat, ...]
    orientation: str = "none"
    """As of a signal."""
    validity: tuple[tuple[int, int], ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class XodrRoad:
    """A road: a reference line with lanes on both sides."""

    id: str
    junction: str
    """The junction that it leads through; empty for none."""
    left_hand: bool
    reference: ReferenceLine
    offset: PiecewiseCubic | None
    """How far the middle lies to the left of the reference line."""
    sections: tuple[XodrSection, ...]
    predecessor: XodrLink | None
    successor: XodrLink | None
    limits: tuple[tuple[float, float | None], ...]
    """From which station on which limit holds, in m/s."""
    signals: tuple[XodrSignal, ...]
    objects: tuple[XodrObject, ...]
    is_flat: bool
    length_m: float

    def link(self, *, at_end: bool) -> XodrLink | None:
        return self.successor if at_end else self.predecessor


@dataclass(frozen=True, slots=True)
class XodrConnection:
    """A way into a junction: lanes of a road that lead to lanes of another."""

    incoming: str
    connecting: str
    contact: str | None
    """The end of the connecting road that the incoming one meets."""
    lanes: tuple[tuple[int, int], ...]
    """(from, to) lane ids."""


@dataclass(frozen=True, slots=True)
class XodrJunction:
    """A junction."""

    id: str
    kind: str
    """"default", "direct", "virtual" or "crossing"."""
    connections: tuple[XodrConnection, ...]
    priorities: tuple[tuple[str, str], ...]
    """(high, low): the roads of which the first one goes first."""


@dataclass(frozen=True, eq=False)
class XodrFile:
    """One file."""

    path: Path
    roads: dict[str, XodrRoad] = field(default_factory=dict[str, XodrRoad])
    junctions: dict[str, XodrJunction] = field(default_factory=dict[str, XodrJunction])
    controllers: dict[str, tuple[str, ...]] = field(default_factory=dict[str, tuple[str, ...]])
    """Controller -> the signals that it switches together; in the order in which they get green."""
    header: XodrHeader | None = None
    faults: dict[str, str] = field(default_factory=dict[str, str])
    """Road -> why it cannot be used."""
    unread: Sequence[str] = ()


@dataclass(frozen=True, slots=True)
class XodrHeader:
    """Where the file's coordinates lie."""

    version: str
    reference: str
    """A PROJ string or WKT; empty where the file does not say."""
    shift_m: tuple[float, float]
    turn_rad: float


def by_signal(controllers: Mapping[str, Sequence[str]]) -> dict[str, str]:
    """Signal -> the first controller that names it."""
    found: dict[str, str] = {}
    for controller, signals in controllers.items():
        for signal in signals:
            found.setdefault(signal, controller)
    return found
