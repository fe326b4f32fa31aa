"""SUMO network files: what their elements say, unconverted."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from interplan_sumo.errors import MapError
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.xml_file import elements

LANE_WIDTH_M = 3.2
"""SUMO's default, where a file gives no width."""
_DRIVEN = frozenset(("normal", "connector"))
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
    shape: Floats
    """(N, 2) its middle, or the outline of a walking area; in the coordinates of the file."""
    outline: Floats
    """(N, 2) the outline of a crossing, where the file draws it; else empty."""
    width_m: float
    speed_mps: float | None
    classes: frozenset[str]
    """Who may use it."""


@dataclass(frozen=True, slots=True)
class FileConnection:
    """A way from lane to lane."""

    from_lane: str
    to_lane: str
    via: str
    """The first lane within the junction; empty where the network has none."""
    light: str
    """Traffic light and link, such as J1/3; empty without one."""
    state: str
    direction: str
    classes: frozenset[str]

    @property
    def name(self) -> str:
        return f"{self.from_lane} -> {self.to_lane}"


@dataclass(frozen=True, slots=True, eq=False)
class FileJunction:
    """A junction with its outline."""

    id: str
    lanes: frozenset[str]
    """Lanes that come to it or run through it."""
    shape: Floats


@dataclass(slots=True, eq=False)
class SumoFile:
    """One network."""

    path: Path
    attributes: dict[str, str] = field(default_factory=dict[str, str])
    location: dict[str, str] = field(default_factory=dict[str, str])
    lanes: dict[str, FileLane] = field(default_factory=dict[str, FileLane])
    """Of normal edges."""
    internal: dict[str, FileLane] = field(default_factory=dict[str, FileLane])
    crossings: list[FileLane] = field(default_factory=list[FileLane])
    walking_areas: list[FileLane] = field(default_factory=list[FileLane])
    connections: list[FileConnection] = field(default_factory=list[FileConnection])
    """From lanes of normal edges."""
    onward: dict[str, str] = field(default_factory=dict[str, str])
    """Internal lane -> the internal lane that follows it."""
    junctions: list[FileJunction] = field(default_factory=list[FileJunction])
    edges: dict[str, list[str]] = field(default_factory=dict[str, list[str]])
    """Normal edge -> its lanes by index, 0 at the kerb."""

    def fault(self, what: str) -> MapError:
        """The error for something in the file."""
        return MapError(f"{self.path}: {' '.join(what.split())}")


def read_sumo_file(path: Path) -> SumoFile:
    """A network file, plain or gzipped; MapError names the file and the element that cannot be used."""
    file = SumoFile(Path(path))
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
                _add_junction(file, element)
            case "succ":
                old = True
            case _:
                pass
    if old and not file.connections:
        raise file.fault("SUMO wrote it before version 0.13; write it anew: netconvert -s OLD.net.xml -o NEW.net.xml")
    return file


def _add_edge(file: SumoFile, element: Element) -> None:
    id_ = element.get("id", "")
    function = element.get("function", "normal")
    lanes = [_lane(file, id_, lane) for lane in element.iterfind("lane")]
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


def _lane(file: SumoFile, edge: str, element: Element) -> FileLane:
    index = element.get("index", "")
    id_ = element.get("id", f"{edge}_{index}")
    if not index.isdecimal() or len(index) > 4:
        raise file.fault(f"lane {id_[:40]!r}: index is {index[:20]!r}, expected a whole number")
    speed = element.get("speed", element.get("maxspeed"))
    return FileLane(
        id=id_,
        edge=edge,
        index=int(index),
        shape=_shape(file, f"lane {id_[:40]!r}", element.get("shape", "")),
        outline=_shape(file, f"lane {id_[:40]!r}", element.get("outlineShape", "")),
        width_m=_width(file, id_, element),
        speed_mps=None if speed is None else _number(file, f"lane {id_[:40]!r}: speed", speed),
        classes=_classes(element.attrib),
    )


def _width(file: SumoFile, id_: str, element: Element) -> float:
    text = element.get("width")
    width_m = LANE_WIDTH_M if text is None else _number(file, f"lane {id_[:40]!r}: width", text)
    if not 0.0 < width_m < 100.0:
        raise file.fault(f"lane {id_[:40]!r}: width is {width_m:g} m, expected more than 0 and less than 100")
    return width_m


def _classes(attributes: Mapping[str, str]) -> frozenset[str]:
    """Who may use a lane: those allowed, else all but those disallowed."""
    allowed, barred = attributes.get("allow", "").split(), attributes.get("disallow", "").split()
    if allowed:
        return CLASSES if "all" in allowed else frozenset(allowed)
    return frozenset() if "all" in barred else CLASSES - frozenset(barred)


def _add_connection(file: SumoFile, element: Element) -> None:
    given = element.attrib
    start, end = given.get("from", ""), given.get("to", "")
    from_lane, to_lane = f"{start}_{given.get('fromLane', '')}", f"{end}_{given.get('toLane', '')}"
    via = given.get("via", "")
    if start.startswith(":"):
        if via:
            file.onward[from_lane] = via
        return
    light = f"{given['tl']}/{given.get('linkIndex', '')}" if given.get("tl") else ""
    file.connections.append(
        FileConnection(from_lane, to_lane, via, light, given.get("state", ""), given.get("dir", ""), _classes(given))
    )


def _add_junction(file: SumoFile, element: Element) -> None:
    id_ = element.get("id", "")
    if element.get("type") != "internal":
        lanes = (*element.get("incLanes", "").split(), *element.get("intLanes", "").split())
        shape = _shape(file, f"junction {id_[:40]!r}", element.get("shape", ""))
        file.junctions.append(FileJunction(id_, frozenset(lanes), shape))


def _shape(file: SumoFile, what: str, text: str) -> Floats:
    """(N, 2) the points of a text such as "1.00,2.00 3.00,4.00,0.50"; heights are dropped."""
    points: list[tuple[float, float]] = []
    for part in text.split():
        numbers = part.split(",")
        if len(numbers) not in (2, 3):
            raise file.fault(f"{what}: {part[:30]!r} in its shape is no point")
        x, y = (_number(file, f"{what}: shape", number) for number in numbers[:2])
        points.append((x, y))
    return np.array(points, dtype=np.float64).reshape(-1, 2)


def _number(file: SumoFile, what: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise file.fault(f"{what} is {text[:20]!r}, expected a number")
    return value
