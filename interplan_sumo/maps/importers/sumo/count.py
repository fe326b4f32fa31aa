"""A second reading of SUMO networks, by SUMO's own library."""

from __future__ import annotations

import gzip
import math
import zlib
from collections.abc import Sequence
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any
from xml.sax import SAXException

import pyproj
from defusedxml import DefusedXmlException
from defusedxml.sax import parseString
from pyproj.exceptions import ProjError

from interplan_sumo.errors import MapError
from interplan_sumo.maps.importers.lines import SHORTEST_M
from interplan_sumo.maps.importers.source import SourceCount

_ROADS = ("", "normal", "connector")


def count_sumo_network(path: Path) -> SourceCount:
    """What a network holds: car lanes of its edges, and one lane for each connection that runs over internal lanes.

    Needs sumolib (MapError with the way out without it). MapError if the file cannot be read.
    """
    try:
        from sumolib.net import NetReader
    except ImportError as error:
        raise MapError("counting a SUMO network needs sumolib: pip install 'interplan-sumo[maps]'") from error
    reader: Any = NetReader(withInternal=True)
    try:
        data = path.read_bytes()
        parseString(gzip.decompress(data) if data[:2] == b"\x1f\x8b" else data, reader)
        return _count(reader.getNet())
    except (
        OSError, EOFError, zlib.error, SAXException, DefusedXmlException,
        ValueError, LookupError, TypeError, AttributeError, AssertionError,
    ) as error:  # fmt: skip
        said = " ".join(str(error).split())[:120]
        raise MapError(f"{path}: the network cannot be counted ({said}); write it anew with netconvert") from error


def _count(net: Any) -> SourceCount:
    roads = [edge for edge in net.getEdges(withInternal=False) if edge.getFunction() in _ROADS]
    lanes = [lane for edge in roads for lane in edge.getLanes()]
    drawn_m = {lane.getID(): _length_m(net, lane.getShape()) for lane in lanes}
    cars = {lane.getID(): lane for lane in lanes if _for_cars(lane) and drawn_m[lane.getID()] > 0.0}
    lengths = {id_: drawn_m[id_] for id_ in cars}
    links: set[tuple[str, str]] = set()
    for id_, lane in cars.items():
        for way in lane.getOutgoing():
            end, chain = way.getToLane().getID(), _chain(net, way.getViaLaneID())
            if end in cars and all(map(_for_cars, (way, *chain))):
                length_m = _length_m(net, [point for part in chain for point in part.getShape()])
                over = [chain[0].getID()] if length_m >= SHORTEST_M else []
                lengths.update(dict.fromkeys(over, length_m))
                links.update(zip((id_, *over), (*over, end), strict=True))
    crossings = sum(edge.getFunction() == "crossing" for edge in net.getEdges())
    return SourceCount(lengths, frozenset(links), crosswalks=crossings, left_out=len(lanes) - len(cars))


def _for_cars(thing: Any) -> bool:
    """Whether a lane or a connection is open to cars; sumolib keeps the word "all" as if it were a class."""
    return bool(thing.allows("passenger") or thing.allows("all"))


def _chain(net: Any, via: str) -> list[Any]:
    """The internal lanes of a connection, from the first to the last."""
    chain: list[Any] = []
    while via and all(via != lane.getID() for lane in chain):
        chain.append(net.getLane(via))
        onward = chain[-1].getOutgoing()
        via = onward[0].getViaLaneID() if onward else ""
    return chain


def _length_m(net: Any, shape: Sequence[tuple[float, float]]) -> float:
    """Length of a shape as drawn; on the globe where the network has a projection that can be used."""
    points = [place for place, _ in groupby(point[:2] for point in shape)]
    if net.hasGeoProj():
        try:
            degrees = [net.convertXY2LonLat(x, y) for x, y in points]
        except (ProjError, RuntimeError):
            degrees = []
        if degrees and all(map(math.isfinite, (*degrees[0], *degrees[-1]))):
            return float(pyproj.Geod(ellps="WGS84").line_length([x for x, _ in degrees], [y for _, y in degrees]))
    return sum(math.dist(one, other) for one, other in pairwise(points))
