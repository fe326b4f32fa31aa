"""Importing a map: its file, whatever the format, to a folder with map.gpkg, SUMO network and a record."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from interplan_sumo.errors import InputError, MapError
from interplan_sumo.maps.controls import CONTROLS_FILE, MapControls
from interplan_sumo.maps.geopackage import read_map
from interplan_sumo.maps.geopackage_writer import write_map
from interplan_sumo.maps.importers.build import Built, build
from interplan_sumo.maps.importers.carried_controls import carried_controls
from interplan_sumo.maps.importers.control_fidelity import compare_controls
from interplan_sumo.maps.importers.fidelity import SourceReport, compare, with_controls, with_streets
from interplan_sumo.maps.importers.formats import MAP_FORMATS
from interplan_sumo.maps.importers.opinion import SecondOpinion
from interplan_sumo.maps.importers.record import ImportRecord, LaneOrigin
from interplan_sumo.maps.importers.source import SourceMap
from interplan_sumo.maps.importers.street_fidelity import compare_streets
from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.network_links import read_network_summary
from interplan_sumo.maps.problem import MapProblem
from interplan_sumo.maps.store import MapFiles
from interplan_sumo.maps.to_sumo import convert
from interplan_sumo.world.files import file_hash, writing
from interplan_sumo.world.roads import Roads

VERSION = "1.0"
_NONE: tuple[MapControls, tuple[str, ...]] = MapControls(), ()


def import_map(source: Path, format: str, folder: Path, *, overwrite: bool = False) -> tuple[MapFiles, ImportRecord]:
    """Write `<folder>/1.0/`, named after `folder`: map.gpkg, controls.json, map.net.xml.gz, ids.json and import.json.

    `source` may be a folder that holds one file of the format. What is a map
    of nuPlan's schema already is written anew, with its own ids. Equal files
    give equal maps. MapError if the file cannot be used, InputError if the
    folder holds a map already and is not to be overwritten.
    """
    name = folder.resolve().name
    files = MapFiles(name, VERSION, folder / VERSION)
    if files.gpkg.exists() and not overwrite:
        raise InputError(f"{files.gpkg} exists; name another folder with --out, or give --overwrite")
    reader = MAP_FORMATS[format]
    file = _file(source, reader.pattern)
    read = reader.read(file)
    made = build(replace(read, name=name)) if isinstance(read, SourceMap) else _as_it_is(replace(read, name=name))
    controls, changed = carried_controls(read, made.roads, made.origins) if isinstance(read, SourceMap) else _NONE
    record = ImportRecord(
        file=file.name,
        sha256=file_hash(file),
        format=format,
        origins=made.origins,
        left_out=made.left_out,
        notes=(*made.notes, *changed),
    )
    with writing(files.folder, "name another folder"):
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(prefix=".writing-", dir=folder) as place:  # all of a map or nothing
            fresh = MapFiles(name, VERSION, Path(place))
            write_map(made.roads, fresh.gpkg)
            controls.write(fresh.folder)
            convert(read_map(fresh.gpkg, name), fresh.folder)
            record.write(fresh.folder)
            files.folder.mkdir(exist_ok=True)
            if not (fresh.folder / CONTROLS_FILE).is_file():
                (files.folder / CONTROLS_FILE).unlink(missing_ok=True)  # those of another map
            for path in sorted(fresh.folder.iterdir()):
                path.replace(files.folder / path.name)
    return files, record


def check_source(files: MapFiles, roads: Roads, record: ImportRecord, source: Path) -> SourceReport:
    """An imported map against the file that it came from, read again, and a second time by other code if there is any.

    Its SUMO network is read for the signals and the right of way.
    UnknownNameError if the package that reads the format is gone.
    """
    reader = MAP_FORMATS[record.format]
    file = _file(source, reader.pattern)
    read = reader.read(file)
    if not isinstance(read, SourceMap):
        raise InputError(f"{file}: a map of {reader.title} is taken as it is; there is nothing to compare it with")
    network = read_network_summary(files.network)
    controls = compare_controls(roads, record.origins, read, NetworkIds.read(files.ids), network)
    report = with_controls(compare(roads, record, read, None if reader.count is None else reader.count(file)), controls)
    report = with_streets(report, *compare_streets(roads, record.origins, read, record.file))
    if file_hash(file) != record.sha256:
        said = f"is not the file that the map was imported from ({record.file}): its checksum differs"
        report = replace(report, problems=(MapProblem("another_file", "file", str(file), said), *report.problems))
    return report


def second_opinion(record: ImportRecord, source: Path) -> SecondOpinion | None:
    """What another program makes of the file of an imported map; None where the format knows no such program."""
    reader = MAP_FORMATS[record.format]
    return None if reader.opinion is None else reader.opinion(_file(source, reader.pattern))


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
