"""A second reading of SUMO networks, by SUMO's own library."""

from __future__ import annotations

import gzip
import math
import warnings
import zlib
from collections import Counter
from collections.abc import Sequence
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any
from xml.sax import SAXException

import pyproj
from defusedxml import DefusedXmlException
from defusedxml.sax import parseString
from pyproj.exceptions import CRSError, ProjError

from interplan_sumo.errors import MapError
from interplan_sumo.maps.importers.source import SourceCount

_CAR = "passenger"
_ROADS = ("", "normal", "connector")
_NO_LENGTH_M = 1e-3


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
        raise MapError(f"{path}: the network cannot be counted ({error}); write it anew with netconvert") from error


def _count(net: Any) -> SourceCount:
    edges = [edge for edge in net.getEdges(withInternal=False) if edge.getFunction() in _ROADS]
    lanes = [lane for edge in edges for lane in edge.getLanes()]
    cars = {lane.getID(): lane for lane in lanes if _for_cars(lane) and _shape_m(net, lane.getShape()) > 0.0}
    lengths = {id_: _shape_m(net, lane.getShape()) for id_, lane in cars.items()}
    limits = {id_: float(lane.getSpeed()) for id_, lane in cars.items()}
    links: set[tuple[str, str]] = set()
    lit: set[str] = set()
    for id_, lane in cars.items():
        for way in lane.getOutgoing():
            end = way.getToLane().getID()
            if end not in cars or not _for_cars(way):
                continue
            chain = _chain(net, way.getViaLaneID())
            if not all(map(_for_cars, chain)):
                continue
            shape = [point for part in chain for point in part.getShape()]
            length_m = _shape_m(net, shape)
            over = [chain[0].getID()] if length_m > _NO_LENGTH_M else []
            links.update(zip((id_, *over), (*over, end), strict=True))
            if way.getTLSID():
                lit.add(over[0] if over else id_)
            for via in over:
                lengths[via] = length_m
                limits[via] = min(float(part.getSpeed()) for part in chain)
    return SourceCount(
        lane_length_m=lengths,
        links=frozenset(links),
        leaving=0,
        lit=frozenset(lit),
        limit_mps={id_: limit for id_, limit in limits.items() if limit > 0.0},
        crosswalks=sum(edge.getFunction() == "crossing" for edge in net.getEdges()),
        left_out=Counter("closed to cars" for lane in lanes if lane.getID() not in cars),
    )


def _for_cars(thing: Any) -> bool:
    """Whether a lane or a connection is open to cars; sumolib keeps the word "all" as if it were a class."""
    return bool(thing.allows(_CAR) or thing.allows("all"))


def _chain(net: Any, via: str) -> list[Any]:
    """The internal lanes of a connection, from the first to the last."""
    chain: list[Any] = []
    while via and all(via != lane.getID() for lane in chain):
        chain.append(net.getLane(via))
        onward = chain[-1].getOutgoing()
        via = onward[0].getViaLaneID() if onward else ""
    return chain


def _shape_m(net: Any, shape: Sequence[tuple[float, float]]) -> float:
    """Length of a shape as drawn; on the globe, unless the projection is UTM's: its metres are nearly the ground's."""
    points = [place for place, _ in groupby(point[:2] for point in shape)]
    reference = str(net._location.get("projParameter", "!"))
    degrees = _degrees(reference, points, net.getLocationOffset()) if "proj" in reference else None
    if degrees is not None:
        return float(pyproj.Geod(ellps="WGS84").line_length(*degrees))
    return sum(math.dist(one, other) for one, other in pairwise(points))


def _degrees(
    reference: str, points: Sequence[tuple[float, float]], offset: Sequence[float]
) -> tuple[list[float], list[float]] | None:
    """Longitudes and latitudes of points; None where the projection is of no use or is UTM's."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            project = pyproj.Proj(reference)
        if project.crs.utm_zone or not project.crs.is_projected or not points:
            return None
        x, y = [p[0] - offset[0] for p in points], [p[1] - offset[1] for p in points]
        longitude, latitude = project(x, y, inverse=True)
        return (list(longitude), list(latitude)) if all(map(math.isfinite, (*longitude, *latitude))) else None
    except (CRSError, ProjError):
        return None
