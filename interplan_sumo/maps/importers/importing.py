"""Importing a map: its file, whatever the format, to a folder with map.gpkg, SUMO network and a record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from interplan_sumo.errors import InputError, MapError, UnknownNameError
from interplan_sumo.maps.geopackage import read_map
from interplan_sumo.maps.geopackage_writer import write_map
from interplan_sumo.maps.importers.build import Built, build
from interplan_sumo.maps.importers.fidelity import SourceReport, compare
from interplan_sumo.maps.importers.record import ImportRecord, LaneOrigin
from interplan_sumo.maps.importers.source import SourceCount, SourceMap
from interplan_sumo.maps.problem import MapProblem
from interplan_sumo.maps.store import MapFiles
from interplan_sumo.maps.to_sumo import convert
from interplan_sumo.world.files import file_hash
from interplan_sumo.world.roads import Roads

VERSION = "1.0"
NUPLAN = "nuplan"


@dataclass(frozen=True, slots=True)
class Format:
    """A foreign format: how its files are read, and how they are counted for the check."""

    pattern: str
    """How the names of its files look."""
    read: Callable[[Path], SourceMap]
    count: Callable[[Path], SourceCount]


def _argoverse2() -> Format:
    from interplan_sumo.maps.importers.counts.argoverse2 import count_argoverse2
    from interplan_sumo.maps.importers.readers.argoverse2 import read_argoverse2

    return Format("log_map_archive_*.json", read_argoverse2, count_argoverse2)


def _lanelet2() -> Format:
    from interplan_sumo.maps.importers.counts.lanelet2 import count_lanelet2
    from interplan_sumo.maps.importers.readers.lanelet2 import read_lanelet2

    return Format("*.osm", read_lanelet2, count_lanelet2)


def _commonroad() -> Format:
    from interplan_sumo.maps.importers.counts.commonroad import count_commonroad
    from interplan_sumo.maps.importers.readers.commonroad import read_commonroad

    return Format("*.xml", read_commonroad, count_commonroad)


def _sumo() -> Format:
    from interplan_sumo.maps.importers.counts.sumo_network import count_sumo_network
    from interplan_sumo.maps.importers.readers.sumo_network import read_sumo_network

    return Format("*.net.xml*", read_sumo_network, count_sumo_network)


FORMATS: dict[str, Callable[[], Format]] = {
    "argoverse2": _argoverse2,
    "lanelet2": _lanelet2,
    "commonroad": _commonroad,
    "sumo": _sumo,
}
"""By the name that the command takes; nuPlan's own format needs no import of this kind."""


def format_named(name: str) -> Format:
    """A format by its name; UnknownNameError if there is none."""
    if name not in FORMATS:
        raise UnknownNameError("map format", name, (*FORMATS, NUPLAN))
    return FORMATS[name]()


def import_map(source: Path, format: str, folder: Path, *, overwrite: bool = False) -> tuple[MapFiles, ImportRecord]:
    """Write `<folder>/1.0/` with map.gpkg, map.net.xml.gz, ids.json and import.json; the map is named after `folder`.

    `source` may be a folder that holds one file of the format. A GeoPackage
    (format "nuplan") is read and written anew, with its own ids. Equal files
    give equal maps. MapError if the file cannot be used, InputError if the
    folder holds a map already and is not to be overwritten.
    """
    name = folder.resolve().name
    files = MapFiles(name, VERSION, folder / VERSION)
    if files.gpkg.exists() and not overwrite:
        raise InputError(f"{files.gpkg} exists; name another folder with --out, or give --overwrite")
    if format == NUPLAN:
        file = _file(source, "*.gpkg")
        made = _as_it_is(read_map(file, name))
    else:
        reader = format_named(format)
        file = _file(source, reader.pattern)
        made = build(replace(reader.read(file), name=name))
    record = ImportRecord(
        file=file.name,
        sha256=file_hash(file),
        format=format,
        origins=made.origins,
        left_out=made.left_out,
        notes=made.notes,
    )
    try:
        files.folder.mkdir(parents=True, exist_ok=True)
        write_map(made.roads, files.gpkg)
        convert(read_map(files.gpkg, name), files.folder)
        record.write(files.folder)
    except OSError as error:
        raise InputError(f"cannot write {files.folder}: {error.strerror or error}; name another folder") from None
    return files, record


def check_source(roads: Roads, record: ImportRecord, source: Path) -> SourceReport:
    """An imported map against a second, independent reading of the file that it came from."""
    reader = format_named(record.format)
    file = _file(source, reader.pattern)
    report = compare(roads, record, reader.count(file))
    if file_hash(file) != record.sha256:
        said = f"is not the file that the map was imported from ({record.file}): its checksum differs"
        report = replace(report, problems=(MapProblem("another_file", "file", str(file), said), *report.problems))
    return report


def _file(source: Path, pattern: str) -> Path:
    """The file itself, or the only one of a folder that looks like it."""
    if not source.is_dir():
        if not source.is_file():
            raise MapError(f"there is no file {source}")
        return source
    found = sorted(source.glob(pattern))
    if len(found) != 1:
        names = f" ({', '.join(path.name for path in found[:3])}{', ...' if len(found) > 3 else ''})" if found else ""
        raise MapError(f"{source} holds {len(found)} files {pattern}{names}; name one file")
    return found[0]


def _as_it_is(roads: Roads) -> Built:
    """A map that keeps nuPlan's rules already."""
    origins = {
        lane.id: (LaneOrigin(lane.id, 0.0, 1.0, 0.0, round(lane.centerline.length_m, 3)),)
        for lane in (*roads.lanes.values(), *roads.connectors.values())
    }
    return Built(roads, origins, {}, ())
