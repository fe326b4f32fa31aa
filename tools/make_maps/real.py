"""Streets as they are: crops an extract of OpenStreetMap as a recipe says, and imports it as a shipped map.

`python -m tools.make_maps.real EXTRACT.osm NAME` crops a fresh extract to what the recipe
`tools/make_maps/extracts/NAME.yaml` asks for and writes it beside the recipe.
`python -m tools.make_maps` makes the maps of all recipes from those files.
"""

from __future__ import annotations

import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
import shapely
import yaml

from interplan_sumo.maps.check import MapReport, check_map
from interplan_sumo.maps.importers.importing import import_map
from interplan_sumo.maps.store import load_roads, write_maps_manifest
from interplan_sumo.world.xml_file import elements

EXTRACTS = Path(__file__).parent / "extracts"
LICENCE_FILE = "LICENSE.md"
_LICENCE = """# Licence of this map

© OpenStreetMap contributors (https://www.openstreetmap.org/copyright).

{place}. {source}.

The files in this folder are made from data of OpenStreetMap and are available under the Open Database License 1.0
(https://opendatacommons.org/licenses/odbl/1-0/), not under the licence of interplan-sumo. Whoever passes on the map, or
maps and scenes made from it, must name OpenStreetMap's contributors and keep this licence. What was cropped and changed
stands in the recipe of the same name in tools/make_maps/extracts of interplan-sumo's source.
"""
STREETS = frozenset(
    "motorway motorway_link trunk trunk_link primary primary_link secondary secondary_link tertiary tertiary_link "
    "unclassified residential living_street".split()
)


@dataclass(frozen=True)
class Recipe:
    """What of an extract is kept and what is changed; all ids are OpenStreetMap's, each change gives its reason."""

    name: str
    place: str
    """Where it is, in words."""
    source: str
    """Where the extract was found, and its date."""
    outline: shapely.Polygon
    """Longitudes and latitudes in degrees; ways are cut where they leave it."""
    dropped: Mapping[int, str] = field(default_factory=dict[int, str])
    """Ways that are left out."""
    joined: Mapping[int, str] = field(default_factory=dict[int, str])
    """Closed ways whose nodes become one crossing in their middle."""
    tagged: Mapping[int, Mapping[str, str]] = field(default_factory=dict[int, Mapping[str, str]])
    """Tags to set on ways; an empty one is taken away."""
    limits_kmh: Mapping[str, float] = field(default_factory=dict[str, float])
    """By kind of street: the limit where a way names none."""


def read_recipe(path: Path) -> Recipe:
    """The recipe in a file named after its map."""
    data: dict[str, Any] = yaml.safe_load(path.read_text(encoding="utf-8"))
    outline = shapely.Polygon(data.pop("outline"))
    tagged = {way: {k: str(v) for k, v in tags.items() if k != "why"} for way, tags in data.pop("tagged", {}).items()}
    return Recipe(name=path.stem, outline=outline, tagged=tagged, **data)


RECIPES: dict[str, Path] = {file.stem: file for file in sorted(EXTRACTS.glob("*.yaml"))}
"""The files of all recipes by the names of their maps."""


# --- an extract, cropped --------------------------------------------------------------------------------


@dataclass
class _Extract:
    """Streets of an extract, as far as cropping changes them."""

    places: dict[int, tuple[float, float]]
    node_tags: dict[int, dict[str, str]]
    ways: dict[int, list[int]]
    way_tags: dict[int, dict[str, str]]
    restrictions: list[tuple[dict[str, str], list[tuple[str, int, str]]]]


def crop(path: Path, recipe: Recipe) -> str:
    """The streets of an extract inside the outline, as XML without the names of those who drew them.

    Streets that are connected to the rest only outside the outline are left out.
    """
    found = _streets(path)
    for way in recipe.dropped:
        del found.ways[way]
    for way, tags in recipe.tagged.items():
        changed = {**found.way_tags[way], **tags}
        found.way_tags[way] = {key: value for key, value in changed.items() if value}
    for way in found.ways:
        tags = found.way_tags[way]
        if tags.get("sidewalk") == "separate" or tags.get("sidewalk:both") == "separate":
            tags["sidewalk"] = "both"  # footways of their own are not read
            tags.pop("sidewalk:both", None)
        if "maxspeed" not in tags and tags["highway"] in recipe.limits_kmh:
            tags["maxspeed"] = f"{recipe.limits_kmh[tags['highway']]:g}"
    for way in recipe.joined:
        _join(found, way)
    _cut(found, recipe.outline)
    _keep_the_largest(found)
    return _xml(found, recipe)


def _streets(path: Path) -> _Extract:
    found = _Extract({}, {}, {}, {}, [])
    for element in elements(path, "osm"):
        tags = {tag.get("k", ""): tag.get("v", "") for tag in element.iter("tag")}
        match element.tag:
            case "node":
                node = int(element.attrib["id"])
                found.places[node] = float(element.attrib["lon"]), float(element.attrib["lat"])
                found.node_tags[node] = tags
            case "way" if tags.get("highway") in STREETS and tags.get("area") != "yes":
                found.ways[int(element.attrib["id"])] = [int(node.attrib["ref"]) for node in element.iter("nd")]
                found.way_tags[int(element.attrib["id"])] = tags
            case "relation" if tags.get("type") == "restriction":
                members = [(m.get("type", ""), int(m.attrib["ref"]), m.get("role", "")) for m in element.iter("member")]
                found.restrictions.append((tags, members))
            case _:
                pass
    return found


def _join(found: _Extract, ring: int) -> None:
    nodes = found.ways.pop(ring)
    middle = shapely.Polygon([found.places[node] for node in nodes]).centroid
    one = nodes[0]
    found.places[one], found.node_tags[one] = (middle.x, middle.y), {}
    for way, line in found.ways.items():
        merged = [one if node in nodes else node for node in line]
        found.ways[way] = [node for k, node in enumerate(merged) if k == 0 or node != merged[k - 1]]


def _cut(found: _Extract, outline: shapely.Polygon) -> None:
    """Ways are cut at the outline, where each gets a node of its own; parts of a way beyond the first are new ways."""
    inside = {node for node, place in found.places.items() if outline.covers(shapely.Point(place))}
    edge = outline.exterior
    ways, found.ways = found.ways, {}
    next_node, next_way = max(found.places) + 1, max(ways) + 1
    for way, line in ways.items():
        parts: list[list[int]] = [[]]
        for before, after in zip([None, *line[:-1]], line, strict=True):
            if before is not None and (before in inside) != (after in inside):
                leg = shapely.LineString([found.places[before], found.places[after]])
                x, y = shapely.get_coordinates(shapely.intersection(leg, edge))[0].tolist()
                found.places[next_node] = round(x, 7), round(y, 7)
                parts[-1].append(next_node)
                next_node += 1
                if after not in inside:
                    parts.append([])
            if after in inside:
                parts[-1].append(after)
        for k, part in enumerate(part for part in parts if len(part) > 1):
            number = way if k == 0 else next_way
            next_way += k > 0
            found.ways[number], found.way_tags[number] = part, found.way_tags[way]


def _keep_the_largest(found: _Extract) -> None:
    """Only the streets that hang together: of several such nets the longest."""
    of_node: dict[int, int] = {}

    def root(node: int) -> int:
        while of_node.setdefault(node, node) != node:
            node = of_node[node]
        return node

    for line in found.ways.values():
        for node in line[1:]:
            of_node[root(node)] = root(line[0])
    length: dict[int, float] = {}
    for line in found.ways.values():
        places = np.array([found.places[node] for node in line])
        length[root(line[0])] = length.get(root(line[0]), 0.0) + float(np.hypot(*np.diff(places, axis=0).T).sum())
    largest = max(length, key=lambda node: (length[node], -node))
    found.ways = {way: line for way, line in found.ways.items() if root(line[0]) == largest}


def _xml(found: _Extract, recipe: Recipe) -> str:
    root = Element("osm", version="0.6", copyright="OpenStreetMap contributors", license="ODbL-1.0")
    ElementTree.SubElement(root, "note").text = f"{recipe.place}. {recipe.source}."
    kept = {node for line in found.ways.values() for node in line}
    for node in sorted(kept):
        x, y = found.places[node]
        _tagged(root, "node", {"id": str(node), "lat": f"{y:.7f}", "lon": f"{x:.7f}"}, found.node_tags.get(node, {}))
    for way in sorted(found.ways):
        element = _tagged(root, "way", {"id": str(way)}, {})
        for node in found.ways[way]:
            ElementTree.SubElement(element, "nd", ref=str(node))
        _tags(element, found.way_tags[way])
    known = found.ways.keys() | kept
    whole = [(tags, members) for tags, members in found.restrictions if all(ref in known for _, ref, _ in members)]
    for number, (tags, members) in enumerate(whole, start=1):
        element = _tagged(root, "relation", {"id": str(number)}, {})
        for kind, ref, role in members:
            ElementTree.SubElement(element, "member", type=kind, ref=str(ref), role=role)
        _tags(element, tags)
    ElementTree.indent(root, " ")
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _tagged(root: Element, kind: str, attributes: Mapping[str, str], tags: Mapping[str, str]) -> Element:
    element = ElementTree.SubElement(root, kind, dict(attributes))
    _tags(element, tags)
    return element


_TOLD = frozenset(
    "access area barrier bridge bus busway change crossing driving_side foot footway highway junction lane_markings "
    "lanes layer level maxspeed motor_vehicle name narrow oneway placement restriction type shoulder sidewalk surface "
    "stop traffic_calming traffic_sign traffic_signals tunnel turn vehicle width".split()
)


def _tags(element: Element, tags: Mapping[str, str]) -> None:
    for key in sorted(tags):
        if key.partition(":")[0] in _TOLD:
            ElementTree.SubElement(element, "tag", k=key, v=tags[key])


# --- the map ----------------------------------------------------------------------------------------------


def make_real_map(recipe: Recipe, root: Path) -> MapReport:
    """Write `<root>/<name>/1.0/` from the extract beside the recipe, with its licence, list it, and check it."""
    folder = root / recipe.name
    files, _ = import_map(extract_of(recipe), "osm", folder, overwrite=True)
    (files.folder / LICENCE_FILE).write_text(licence(recipe), encoding="utf-8")
    write_maps_manifest(root)
    return check_map(files, load_roads(files.folder))


def extract_of(recipe: Recipe) -> Path:
    """The cropped extract of a recipe."""
    return EXTRACTS / f"{recipe.name}.osm"


def licence(recipe: Recipe) -> str:
    """What goes with the map."""
    return _LICENCE.format(place=recipe.place, source=recipe.source)


if __name__ == "__main__":
    given = read_recipe(RECIPES[sys.argv[2]])
    extract_of(given).write_text(crop(Path(sys.argv[1]), given), encoding="utf-8")
