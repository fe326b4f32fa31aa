"""OSM XML as it stands: nodes, ways and relations by id, streamed so that large files need little memory."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn
from xml.etree.ElementTree import Element

from interplan_sumo.errors import MapError
from interplan_sumo.world.xml_file import elements

_ID = re.compile(r"[+-]?\d{1,20}")  # of editors: negative for what is new, up to 64 bits
_BEYOND_EARTH = 1e8  # metres or degrees
_GEO_REFERENCE = "georeference"


@dataclass(frozen=True, slots=True)
class OsmNode:
    """Where a point lies, in whichever terms the file has; NaN stands for what it lacks."""

    lat_deg: float
    lon_deg: float
    x_m: float
    y_m: float


@dataclass(frozen=True, slots=True)
class OsmWay:
    """A line through nodes."""

    id: str
    nodes: tuple[str, ...]
    tags: dict[str, str]


@dataclass(frozen=True, slots=True)
class Member:
    """What a relation names."""

    kind: str
    """node, way or relation."""
    ref: str
    role: str


@dataclass(frozen=True, slots=True)
class Relation:
    """A lanelet, an area or a rule."""

    id: str
    members: tuple[Member, ...]
    tags: dict[str, str]

    @property
    def type(self) -> str:
        return self.tags.get("type", "")

    def refs(self, role: str, kind: str = "way") -> tuple[str, ...]:
        """Ids of the members of one role, in the file's order."""
        return tuple(member.ref for member in self.members if (member.role, member.kind) == (role, kind))


@dataclass(frozen=True, eq=False)
class OsmFile:
    """What a file holds, less what is marked as deleted."""

    path: Path
    nodes: dict[str, OsmNode] = field(default_factory=dict[str, OsmNode])
    ways: dict[str, OsmWay] = field(default_factory=dict[str, OsmWay])
    relations: list[Relation] = field(default_factory=list[Relation])
    """In the file's order; nothing keeps two of them from carrying one id."""
    references: list[str] = field(default_factory=list[str])
    """Coordinate systems that the file names for its local coordinates."""

    def of_type(self, *types: str) -> Iterator[Relation]:
        return (relation for relation in self.relations if relation.type in types)

    def fault(self, what: str) -> NoReturn:
        raise MapError(f"{self.path}: {what}")


def read_osm(path: Path) -> OsmFile:
    """The file at `path`; MapError with one line if it is missing, damaged or of another kind.

    Of nodes and ways with the same id, the first one counts.
    """
    file = OsmFile(path)
    for element in elements(path, "osm"):
        if element.tag == "osm":
            file.references.extend(value for key, value in element.attrib.items() if key.lower() == _GEO_REFERENCE)
        elif element.get("action") != "delete" and element.get("visible") != "false":
            _read_element(file, element)
    return file


def number(text: str | None) -> float:
    """A number that can be a coordinate, or NaN."""
    try:
        value = float(text or "")
    except ValueError:
        return math.nan
    return value if abs(value) < _BEYOND_EARTH else math.nan


def _read_element(file: OsmFile, element: Element) -> None:
    kind = element.tag.lower()
    if kind == "node":
        tags = _tags(element)
        file.nodes.setdefault(
            _id(file, element),
            OsmNode(
                number(element.get("lat")),
                number(element.get("lon")),
                number(tags.get("local_x")),
                number(tags.get("local_y")),
            ),
        )
    elif kind == "way":
        nodes = tuple(_ref(nd) for nd in element.iter("nd"))
        id_ = _id(file, element)
        file.ways.setdefault(id_, OsmWay(id_, nodes, _tags(element)))
    elif kind == "relation":
        members = tuple(
            Member(member.get("type", ""), _ref(member), member.get("role", "")) for member in element.iter("member")
        )
        file.relations.append(Relation(_id(file, element), members, _tags(element)))
    elif kind == _GEO_REFERENCE:
        file.references.append(element.get("v") or (element.text or "").strip())
    else:
        named = {element.get("k", "").lower(): element.get("v", "")} | {k.lower(): v for k, v in element.attrib.items()}
        file.references.extend(value for key, value in named.items() if key == _GEO_REFERENCE)


def _tags(element: Element) -> dict[str, str]:
    return {tag.get("k", "").strip(): tag.get("v", "").strip() for tag in element.iter("tag")}


def _ref(element: Element) -> str:
    return element.get("ref", "").strip()


def _id(file: OsmFile, element: Element) -> str:
    id_ = element.get("id", "").strip()
    if not _ID.fullmatch(id_):
        file.fault(f"<{element.tag}> has the id {id_[:30]!r}, expected a whole number; give it one")
    return id_
