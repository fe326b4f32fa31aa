"""Reading a SUMO network with sumolib: lanes, ways between them, lights and right of way."""

from __future__ import annotations

import gzip
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.sax import SAXException

import numpy as np
from defusedxml import DefusedXmlException
from defusedxml.sax import parseString

from interplan_sumo.errors import MapError
from interplan_sumo.world.geometry import Floats


@dataclass(frozen=True, slots=True, eq=False)
class SumoLane:
    """A lane of the network in SUMO coordinates."""

    points: Floats
    length_m: float
    """SUMO's nominal length."""
    speed_mps: float


@dataclass(frozen=True, slots=True)
class CheckedLink:
    """A connection between two lanes that are not internal, and the internal lanes that it runs over."""

    from_lane: str
    to_lane: str
    via: tuple[str, ...]
    light: tuple[str, int] | None
    """Traffic light and link index."""
    node: str
    link: int
    """Index among the links of the node."""


@dataclass(frozen=True, eq=False)
class NetworkSummary:
    """What there is to check in a network."""

    left_hand: bool
    lanes: dict[str, SumoLane]
    ways: tuple[CheckedLink, ...]
    lights: dict[str, tuple[tuple[float, str], ...]]
    """Traffic light -> phases of (seconds, state)."""
    yields: dict[str, dict[int, frozenset[int]]]
    """Node -> link -> links that it yields to."""


def read_network(path: Path) -> NetworkSummary:
    """A network file, plain or gzipped; MapError names the file if it is missing or damaged."""
    try:
        from sumolib.net import NetReader
    except ImportError as error:
        raise MapError("checking a network needs sumolib: pip install 'interplan-sumo[maps]'") from error
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise MapError(f"no network at {path}; run `interplan-sumo maps convert {path.parent}`") from None
    except OSError as error:
        raise MapError(f"network {path} cannot be read: {error}") from error
    reader: Any = NetReader(withInternal=True, withPrograms=True)
    try:
        text = gzip.decompress(data) if data[:2] == b"\x1f\x8b" else data
        parseString(text, reader)
        return _network(reader.getNet(), _head(text))
    except (
        OSError, EOFError, zlib.error, SAXException, DefusedXmlException,
        ValueError, KeyError, IndexError, TypeError, AttributeError, AssertionError,
    ) as error:  # fmt: skip
        what = f"{type(error).__name__}: {error}"
        raise MapError(
            f"network {path} is damaged ({what}); run `interplan-sumo maps convert {path.parent}` to write it anew"
        ) from error


def _head(text: bytes) -> bytes:
    start = text.index(b"<net")
    return text[start : text.index(b">", start)]


def _network(net: Any, head: bytes) -> NetworkSummary:
    lanes: dict[str, SumoLane] = {}
    ways: list[CheckedLink] = []
    onward: dict[str, str] = {}
    edges = net.getEdges(withInternal=True)
    for edge in edges:
        for lane in edge.getLanes():
            points = np.array([point[:2] for point in lane.getShape()], dtype=np.float64)
            lanes[lane.getID()] = SumoLane(points, float(lane.getLength()), float(lane.getSpeed()))
            if edge.getFunction() == "internal":
                for connection in lane.getOutgoing():
                    onward[lane.getID()] = connection.getViaLaneID()
    if not lanes:
        raise ValueError("it has no lanes")
    for edge in edges:
        if edge.getFunction() == "internal":
            continue
        for lane in edge.getLanes():
            for connection in lane.getOutgoing():
                via: list[str] = []
                step = connection.getViaLaneID()
                while step and step not in via:
                    via.append(step)
                    step = onward.get(step, "")
                node = edge.getToNode()
                light = connection.getTLSID()
                ways.append(
                    CheckedLink(
                        lane.getID(),
                        connection.getToLane().getID(),
                        tuple(via),
                        (light, int(connection.getTLLinkIndex())) if light else None,
                        node.getID(),
                        int(node.getLinkIndex(connection)),
                    )
                )
    lights = {
        light.getID(): tuple(
            (float(phase.duration), str(phase.state))
            for program in light.getPrograms().values()
            for phase in program.getPhases()
        )
        for light in net.getTrafficLights()
    }
    yields = {
        node.getID(): {
            int(link): frozenset(k for k, bit in enumerate(reversed(bits)) if bit == "1")
            for link, bits in node._prohibits.items()
        }
        for node in net.getNodes()
    }
    return NetworkSummary(b'lefthand="true"' in head, lanes, tuple(ways), lights, yields)
