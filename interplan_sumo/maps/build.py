"""Building the shipped maps: draw a district, write it, convert it, check it."""

from __future__ import annotations

from pathlib import Path

from interplan_sumo.maps.check import MapReport, check_map
from interplan_sumo.maps.districts import DISTRICTS, draw
from interplan_sumo.maps.geopackage import read_map
from interplan_sumo.maps.geopackage_writer import write_map
from interplan_sumo.maps.store import MapFiles, write_maps_manifest
from interplan_sumo.maps.to_sumo import convert

VERSION = "1.0"


def build_district(name: str, root: Path, version: str = VERSION) -> MapReport:
    """Write `<root>/<name>/<version>/` with map, network and id map, list it in the root, and check it.

    The network is made from the map as it reads back from disk, so that both
    agree to the last digit.
    """
    files = MapFiles(name, version, Path(root) / name / version)
    files.folder.mkdir(parents=True, exist_ok=True)
    write_map(draw(name), files.gpkg)
    roads = read_map(files.gpkg, name)
    convert(roads, files.folder)
    write_maps_manifest(root)
    return check_map(files, roads)


def build_districts(root: Path, version: str = VERSION) -> dict[str, MapReport]:
    """`build_district` for all of them, by name."""
    return {name: build_district(name, root, version) for name in DISTRICTS}
