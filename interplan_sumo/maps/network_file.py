"""SUMO network files, the one reader of them: what their elements say, in the coordinates of the file."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from interplan_sumo.errors import MapError
from interplan_sumo.maps.program_elements import program_of
from interplan_sumo.maps.signal_program import SignalProgram
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.xml_file import elements

LANE_WIDTH_M = 3.2
"""SUMO's default, where a file gives no width."""
WIDEST_M = 100.0
"""No lane is as wide; a wrong digit makes it so, and what lies on such a lane takes minutes."""
_NO_POINTS: Floats = np.zeros((0, 2))
_DRIVEN = frozenset(("normal", "connector"))
_CONDITIONS = frozenset(("condition", "assignment", "function"))
# SUMO's vehicle classes.
CLASSES = frozenset(
    "private emergency authority army vip pedestrian passenger hov taxi bus coach delivery truck trailer motorcycle "
    "moped bicycle evehicle tram rail_urban rail rail_electric rail_fast ship container cable_car subway aircraft "
    "wheelchair scooter drone custom1 custom2".split()
)


@dataclass(frozen=True, slots=True, eq=False)
class FileLane:
    """A lane as it stands in the file."""

    id: str
    edge: str
    index: int
    """Counted from the kerb."""
    shape: Floats
    """(N, 2) its middle, or the outline of a walking area."""
    outline: Floats
    """(N, 2) the outline of a crossing, where the file draws it; else empty."""
    width_m: float
    length_m: float | None
    """SUMO's, in which places on the lane are told; may differ from what is drawn."""
    speed_mps: float | None
    internal: bool
    """Within a junction."""
    allow: str
    disallow: str

    @property
    def classes(self) -> frozenset[str]:
        """Who may use it."""
        return _classes(self.allow, self.disallow)


@dataclass(frozen=True, slots=True)
class FileConnection:
    """A way from lane to lane."""

    from_lane: str
    to_lane: str
    via: str
    """The first lane within the junction; empty where the network has none."""
    light: str
    """Traffic light; empty without one."""
    light_link: str
    """Index of its letter in the states of the light."""
    state: str
    direction: str
    allow: str
    disallow: str

    @property
    def classes(self) -> frozenset[str]:
        """Who may use it."""
        return _classes(self.allow, self.disallow)

    @property
    def link(self) -> tuple[str, int] | None:
        """Traffic light and index, None without one; ValueError where the index is no number."""
        return (self.light, int(self.light_link)) if self.light else None

    @property
    def name(self) -> str:
        return f"{self.from_lane} -> {self.to_lane}"


@dataclass(frozen=True, eq=False)
class FileJunction:
    """A junction; what only some ask for is read when they do."""

    id: str
    path: Path
    element: Element

    @cached_property
    def incoming(self) -> tuple[str, ...]:
        """Lanes that come to it, in SUMO's order."""
        return tuple(self.element.get("incLanes", "").split())

    @cached_property
    def lanes(self) -> frozenset[str]:
        """Lanes that come to it or run through it."""
        return frozenset((*self.incoming, *self.element.get("intLanes", "").split()))

    @cached_property
    def shape(self) -> Floats:
        """(N, 2) its outline."""
        return _shape(self.path, f"junction {self.id[:40]!r}", self.element.get("shape", ""))

    @property
    def kind(self) -> str:
        """SUMO's type."""
        return self.element.get("type", "")

    @cached_property
    def yields(self) -> dict[int, frozenset[int]]:
        """Link -> links that it yields to, both counted as they leave the incoming lanes."""
        return self._bits("response")

    @cached_property
    def foes(self) -> dict[int, frozenset[int]]:
        """Link -> links whose paths meet its own."""
        return self._bits("foes")

    def _bits(self, name: str) -> dict[int, frozenset[int]]:
        return {
            int(request.attrib["index"]): frozenset(
                at for at, bit in enumerate(reversed(request.attrib[name])) if bit == "1"
            )
            for request in self.element.iterfind("request")
        }


@dataclass(frozen=True, slots=True)
class FileProgram:
    """A program of a traffic light."""

    id: str
    """The traffic light."""
    program: SignalProgram
    conditions: bool = False
    """Whether it switches by expressions of its own, or is read from elsewhere."""

    @property
    def offset_s(self) -> float:
        return self.program.offset_s

    @property
    def phases(self) -> tuple[tuple[float, str], ...]:
        """(seconds, state with one letter for each link)."""
        return tuple((phase.duration_s, phase.state) for phase in self.program.phases)


@dataclass(slots=True, eq=False)
class NetworkFile:
    """One network."""

    path: Path
    attributes: dict[str, str] = field(default_factory=dict[str, str])
    location: dict[str, str] = field(default_factory=dict[str, str])
    lanes: dict[str, FileLane] = field(default_factory=dict[str, FileLane])
    """Of normal edges."""
    internal: dict[str, FileLane] = field(default_factory=dict[str, FileLane])
    in_order: list[FileLane] = field(default_factory=list[FileLane])
    """Both, as they stand in the file."""
    crossings: list[FileLane] = field(default_factory=list[FileLane])
    walking_areas: list[FileLane] = field(default_factory=list[FileLane])
    connections: list[FileConnection] = field(default_factory=list[FileConnection])
    """From lanes of normal edges to lanes of others, as junctions count their links."""
    onward: dict[str, str] = field(default_factory=dict[str, str])
    """Internal lane -> the internal lane that follows it."""
    junctions: list[FileJunction] = field(default_factory=list[FileJunction])
    edges: dict[str, list[str]] = field(default_factory=dict[str, list[str]])
    """Normal edge -> its lanes by index, 0 at the kerb."""
    programs: list[FileProgram] = field(default_factory=list[FileProgram])
    """Of several of one light SUMO runs the last."""

    @property
    def left_hand(self) -> bool:
        return self.attributes.get("lefthand", "").lower() in ("true", "1")

    def links(self) -> Iterator[tuple[FileJunction, list[FileConnection]]]:
        """Each junction with its links in SUMO's order: by the lanes that come to it, then as in the file."""
        leaving: dict[str, list[FileConnection]] = defaultdict(list)
        for connection in self.connections:
            leaving[connection.from_lane].append(connection)
        for junction in self.junctions:
            yield junction, [each for lane in junction.incoming for each in leaving.get(lane, ())]

    def via(self, connection: FileConnection) -> tuple[str, ...]:
        """The internal lanes that a connection runs over, upstream to downstream."""
        found: list[str] = []
        step = connection.via
        while step and step not in found:
            found.append(step)
            step = self.onward.get(step, "")
        return tuple(found)

    def fault(self, what: str) -> MapError:
        """The error for something in the file."""
        return _fault(self.path, what)


def read_network_file(path: Path) -> NetworkFile:
    """A network file, plain or gzipped; MapError names the file and the element that cannot be used."""
    file = NetworkFile(Path(path))
    stream = elements(file.path, "net")
    file.attributes.update(next(stream).attrib)
    old = False
    for element in stream:
        match element.tag:
            case "location":
                file.location.update(element.attrib)
            case "edge":
                _add_edge(file, element)
            case "connection":
                _add_connection(file, element)
            case "junction":
                if element.get("type") != "internal":
                    file.junctions.append(FileJunction(element.get("id", ""), file.path, element))
            case "tlLogic":
                file.programs.append(_program(file, element))
            case "succ":
                old = True
            case _:
                pass
    if old and not file.connections:
        raise file.fault("SUMO wrote it before version 0.13; write it anew: netconvert -s OLD.net.xml -o NEW.net.xml")
    return file


def _add_edge(file: NetworkFile, element: Element) -> None:
    id_ = element.get("id", "")
    function = element.get("function", "normal")
    lanes = [_lane(file, id_, lane, function == "internal") for lane in element if lane.tag == "lane"]
    if function == "internal" or function in _DRIVEN:
        file.in_order += lanes
    if function == "internal":
        file.internal.update((lane.id, lane) for lane in lanes)
    elif function == "crossing":
        file.crossings += lanes
    elif function == "walkingarea":
        file.walking_areas += lanes
    elif function in _DRIVEN:
        if id_ in file.edges or not id_:
            raise file.fault(f"edge {id_[:40]!r}: the id is empty or taken; every edge needs its own")
        lanes.sort(key=lambda lane: lane.index)
        file.edges[id_] = [lane.id for lane in lanes]
        for lane in lanes:
            if lane.id in file.lanes:
                raise file.fault(f"lane {lane.id[:40]!r}: the id is taken; every lane needs its own")
            file.lanes[lane.id] = lane


def _lane(file: NetworkFile, edge: str, element: Element, internal: bool) -> FileLane:
    index = element.get("index", "")
    id_ = element.get("id", f"{edge}_{index}")
    if not index.isdecimal() or len(index) > 4:
        raise file.fault(f"lane {id_[:40]!r}: index is {index[:20]!r}, expected a whole number")
    what = f"lane {id_[:40]!r}"
    length, speed = element.get("length"), element.get("speed", element.get("maxspeed"))
    return FileLane(
        id=id_,
        edge=edge,
        index=int(index),
        shape=_shape(file.path, what, element.get("shape", "")),
        outline=_shape(file.path, what, element.get("outlineShape", "")),
        width_m=_width(file, id_, element),
        length_m=None if length is None else _number(file.path, f"{what}: length", length),
        speed_mps=None if speed is None else _number(file.path, f"{what}: speed", speed),
        internal=internal,
        allow=element.get("allow", ""),
        disallow=element.get("disallow", ""),
    )


def _width(file: NetworkFile, id_: str, element: Element) -> float:
    text = element.get("width")
    width_m = LANE_WIDTH_M if text is None else _number(file.path, f"lane {id_[:40]!r}: width", text)
    if not 0.0 < width_m < WIDEST_M:
        raise file.fault(f"lane {id_[:40]!r}: width is {width_m:g} m, expected more than 0 and less than {WIDEST_M:g}")
    return width_m


def _classes(allow: str, disallow: str) -> frozenset[str]:
    """Who may use a lane: those allowed, else all but those disallowed."""
    allowed, barred = allow.split(), disallow.split()
    if allowed:
        return CLASSES if "all" in allowed else frozenset(allowed)
    return frozenset() if "all" in barred else CLASSES - frozenset(barred)


def _add_connection(file: NetworkFile, element: Element) -> None:
    given = element.attrib
    start, end = given.get("from", ""), given.get("to", "")
    from_lane, to_lane = f"{start}_{given.get('fromLane', '')}", f"{end}_{given.get('toLane', '')}"
    via = given.get("via", "")
    if start.startswith(":"):
        if via:
            file.onward[from_lane] = via
        return
    if end.startswith(":"):
        return  # from a sidewalk to a walking area: SUMO does not count it among the junction's links
    file.connections.append(
        FileConnection(
            from_lane=from_lane,
            to_lane=to_lane,
            via=via,
            light=given.get("tl", ""),
            light_link=given.get("linkIndex", ""),
            state=given.get("state", ""),
            direction=given.get("dir", ""),
            allow=given.get("allow", ""),
            disallow=given.get("disallow", ""),
        )
    )


def _program(file: NetworkFile, element: Element) -> FileProgram:
    id_ = element.get("id", "")
    try:
        return FileProgram(id_, program_of(element), any(each.tag in _CONDITIONS for each in element))
    except ValueError as error:
        raise file.fault(f"traffic light {id_[:40]!r}: {error}") from None


def _shape(path: Path, what: str, text: str) -> Floats:
    """(N, 2) the points of a text such as "1.00,2.00 3.00,4.00,0.50"; heights are dropped."""
    if not text:
        return _NO_POINTS
    rows = [part.split(",") for part in text.split()]
    try:
        numbers = [(float(row[0]), float(row[1])) for row in rows if len(row) in (2, 3)]
        if len(numbers) == len(rows) and math.isfinite(sum(map(sum, numbers))):
            return np.array(numbers)
    except ValueError:
        pass
    for row in rows:  # which of them is wrong
        if len(row) not in (2, 3):
            raise _fault(path, f"{what}: {','.join(row)[:30]!r} in its shape is no point")
        for number in row[:2]:
            _number(path, f"{what}: shape", number)
    raise _fault(path, f"{what}: its shape lies beyond all bounds")


def _number(path: Path, what: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise _fault(path, f"{what} is {text[:20]!r}, expected a number")
    return value


def _fault(path: Path, what: str) -> MapError:
    return MapError(f"{path}: {' '.join(what.split())}")
