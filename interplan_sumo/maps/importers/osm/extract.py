"""What an OpenStreetMap extract says of itself, before SUMO reads it: what it is, where it lies, who keeps left."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from interplan_sumo.errors import MapError
from interplan_sumo.maps.importers.osm.left_hand_places import keeps_left
from interplan_sumo.world.roads import DrivingSide
from interplan_sumo.world.xml_file import elements

_FOR_CARS = frozenset(
    "motorway motorway_link trunk trunk_link primary primary_link secondary secondary_link tertiary tertiary_link "
    "unclassified residential living_street".split()
)
_NO_ROADS = frozenset(("service", "track"))
MOST_LANES = 30
"""Nobody has built a wider road; netconvert would make as many lanes as a slip of the pen says."""
_ENOUGH_ROUNDABOUTS = 2
"""So many that turn one way, and none the other, outweigh the place."""
_BINARY = (".pbf", ".o5m", ".bz2", ".zip", ".7z", ".xz")


@dataclass(eq=False)
class OsmExtract:
    """Figures of one extract."""

    path: Path
    roads: int = 0
    """Ways that SUMO takes for roads for cars."""
    with_limit: int = 0
    """Of those, the ones that name a limit."""
    driveways: int = 0
    """Service roads and tracks, which SUMO keeps for deliveries."""
    lanelets: int = 0
    sides: Counter[str] = field(default_factory=Counter[str])
    """By what tags say: "left" or "right"."""
    roundabouts: list[tuple[str, ...]] = field(default_factory=list[tuple[str, ...]])
    """The nodes of each, in the direction of traffic."""
    span_deg: tuple[float, float, float, float] = (math.inf, math.inf, -math.inf, -math.inf)
    """Lowest longitude and latitude, highest longitude and latitude."""

    @property
    def middle_deg(self) -> tuple[float, float]:
        west, south, east, north = self.span_deg
        return (west + east) / 2.0, (south + north) / 2.0


def read_extract(path: Path) -> OsmExtract:
    """The figures of a file; MapError with one line unless it is an extract with roads for cars."""
    if path.suffix.lower() in _BINARY:
        raise MapError(f"{path}: {path.suffix} is not read; give OSM XML (osmium cat {path.name} -o map.osm)")
    found = OsmExtract(path)
    for element in elements(path, "osm"):
        if element.get("action") != "delete" and element.get("visible") != "false":
            _count(found, element)
    if found.lanelets and not found.roads:
        raise MapError(f"{path}: it is a Lanelet2 map, not an extract of OpenStreetMap; give --format lanelet2")
    if not found.roads:
        raise MapError(f"{path}: the file holds no way that is a road for cars; give an extract with streets")
    if not all(map(math.isfinite, found.span_deg)):
        raise MapError(f"{path}: its nodes have no latitudes and longitudes; give them")
    return found


def _count(found: OsmExtract, element: Element) -> None:
    match element.tag:
        case "node":
            _widen(found, element)
        case "way":
            _count_way(found, element)
        case "relation":
            found.lanelets += any(t.get("k") == "type" and t.get("v") == "lanelet" for t in element.iter("tag"))
        case _:
            pass


def _widen(found: OsmExtract, node: Element) -> None:
    place = _place(node)
    if place is not None:
        (west, south, east, north), (x, y) = found.span_deg, place
        found.span_deg = min(west, x), min(south, y), max(east, x), max(north, y)


def _place(node: Element) -> tuple[float, float] | None:
    try:
        x, y = float(node.get("lon", "")), float(node.get("lat", ""))
    except ValueError:
        return None
    return (x, y) if abs(x) <= 180.0 and abs(y) <= 90.0 else None


def _count_way(found: OsmExtract, way: Element) -> None:
    tags = {tag.get("k", ""): tag.get("v", "") for tag in way.iter("tag")}
    kind = tags.get("highway", "")
    found.driveways += kind in _NO_ROADS
    if kind in _FOR_CARS:
        found.roads += 1
        for key, text in tags.items():
            if key.startswith("lanes") and any(map(_is_too_many, text.split(";"))):
                said = f"{way.get('id', '?')} has {key}={text if len(text) < 12 else f'{text[:9]}...'}"
                raise MapError(f"{found.path}: way {said}, expected {MOST_LANES} at most; correct it")
        found.with_limit += any(key.startswith("maxspeed") for key in tags)
        if tags.get("driving_side") in ("left", "right"):
            found.sides[tags["driving_side"]] += 1
        nodes = tuple(node.get("ref", "") for node in way.iter("nd"))
        if tags.get("junction") == "roundabout" and len(nodes) > 3 and nodes[0] == nodes[-1]:
            found.roundabouts.append(nodes)


def _is_too_many(text: str) -> bool:
    digits = text.strip().removeprefix("+").lstrip("0")
    return digits.isdecimal() and (len(digits) > 2 or int(digits) > MOST_LANES)


# --- the driving side --------------------------------------------------------------------------------------


def driving_side(extract: OsmExtract) -> tuple[DrivingSide, str]:
    """The side on which traffic keeps, and what says so: tags, else roundabouts that turn one way, else the place."""
    if extract.sides:
        side: DrivingSide = "left" if extract.sides["left"] > extract.sides["right"] else "right"
        return side, "by the tags of its roads"
    turns = _turns(extract)
    if len(turns) >= _ENOUGH_ROUNDABOUTS and len(set(turns)) == 1:
        return ("left" if turns[0] else "right"), "as its roundabouts turn"
    return ("left" if keeps_left(*extract.middle_deg) else "right"), "as is the law where it lies"


def _turns(extract: OsmExtract) -> list[bool]:
    """For each roundabout whether it turns clockwise."""
    wanted = {node for nodes in extract.roundabouts for node in nodes}
    places = _places(extract.path, wanted) if wanted else {}
    found: list[bool] = []
    for nodes in extract.roundabouts:
        ring = np.array([places[node] for node in nodes if node in places]).reshape(-1, 2)
        if len(ring) > 3:
            x, y = (ring - ring[0]).T
            found.append(bool(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) < 0.0))
    return found


def _places(path: Path, wanted: Iterable[str]) -> dict[str, tuple[float, float]]:
    wanted = frozenset(wanted)
    found: dict[str, tuple[float, float]] = {}
    for element in elements(path, "osm"):
        if element.tag == "node" and element.get("id", "") in wanted:
            place = _place(element)
            if place is not None:
                found[element.get("id", "")] = place
    return found
