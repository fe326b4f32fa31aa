"""Reading an OpenStreetMap extract: netconvert makes a SUMO network of it, which then is read like any other."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from subprocess import TimeoutExpired
from tempfile import TemporaryDirectory
from typing import TypeVar

from interplan_sumo.errors import MapError
from interplan_sumo.maps.importers.osm.extract import OsmExtract, driving_side, read_extract
from interplan_sumo.maps.importers.source import SourceCount, SourceMap
from interplan_sumo.maps.importers.sumo.count import count_sumo_network
from interplan_sumo.maps.importers.sumo.reader import read_sumo_network
from interplan_sumo.maps.to_sumo import netconvert, netconvert_message, sumo_home
from interplan_sumo.world.xml_file import is_zipped

LICENCE = (
    "Map data: OpenStreetMap contributors, Open Database License 1.0 (openstreetmap.org/copyright). Whoever passes on "
    "the map, or scenes on it, must name them and keep that licence."
)
_TYPE_FILES = ("osmNetconvert.typ.xml", "osmNetconvertUrbanDe.typ.xml", "osmNetconvertPedestrians.typ.xml")
"""SUMO's own: widths and classes; urban limits in place of 100 km/h where a road has no tag; sidewalks of streets."""
_OPTIONS = (
    "--keep-edges.by-vclass=passenger",  # footways of their own would cut every street into pieces
    "--geometry.remove",
    "--geometry.remove.min-length=10",  # where tags change beside a junction: its corners swallow such a street
    "--junctions.join",
    "--junctions.corner-detail=5",
    "--default.junctions.radius=9",  # to the back of sidewalks; SUMO's 4 m draws turns of 3.5 m, too tight for cars
    "--junctions.limit-turn-speed=3.5",  # m/s2; SUMO's 5.5 is no comfort
    "--roundabouts.guess",
    "--ramps.guess",
    "--osm.turn-lanes",
    "--osm.lane-access",
    "--osm.sidewalks",
    "--crossings.guess",  # SUMO 1.28 crashes with --osm.crossings where the footway of a crossing is not kept
    "--tls.guess-signals",
    "--tls.discard-simple",
    "--tls.join",
    "--no-turnarounds",
    "--precision=3",
    "--xml-validation=never",
    "--aggregate-warnings=1",
)
_LONGEST_S = 3600.0
_Read = TypeVar("_Read", SourceMap, SourceCount)


def read_osm_extract(path: Path) -> SourceMap:
    """The roads for cars of an extract, in the UTM zone where it lies; MapError with one line if it cannot be used."""
    extract = read_extract(Path(path))
    side, why = driving_side(extract)
    with _network(extract, left_hand=side == "left") as network:
        read = _told(extract, network, read_sumo_network)
    name = re.sub(r"[^a-z0-9]+", "_", extract.path.name.lower().partition(".")[0]).strip("_") or "osm"
    return replace(read, name=name, format="OpenStreetMap", notes=(*_notes(extract, side, why), *read.notes))


def count_osm(path: Path) -> SourceCount:
    """What SUMO's own library finds in the network that netconvert makes of an extract."""
    extract = read_extract(Path(path))
    with _network(extract, left_hand=driving_side(extract)[0] == "left") as network:
        return _told(extract, network, count_sumo_network)


def _notes(extract: OsmExtract, side: str, why: str) -> tuple[str, ...]:
    without = extract.roads - extract.with_limit
    return (
        LICENCE,
        f"Traffic keeps {side}, {why}.",
        f"{without} of {extract.roads} roads name no limit and have SUMO's for a road of their kind in town. "
        "Widths, lanes without a tag, signal programs and sidewalks are SUMO's, too.",
        *((f"{extract.driveways} service roads and tracks are not roads here.",) if extract.driveways else ()),
    )


@contextmanager
def _network(extract: OsmExtract, *, left_hand: bool) -> Generator[Path]:
    """The network that netconvert makes of an extract."""
    types = ",".join(str(sumo_home() / "data" / "typemap" / name) for name in _TYPE_FILES)
    with TemporaryDirectory(prefix="interplan-osm-") as folder:
        network = Path(folder, "map.net.xml")
        plain = Path(folder, "extract.osm.gz" if is_zipped(extract.path) else "extract.osm")
        shutil.copyfile(extract.path, plain)  # a comma in a name would make it two names
        options = [f"--osm-files={plain}", f"--type-files={types}", *_OPTIONS]
        options += [f"--output-file={network}", *(["--lefthand"] if left_hand else [])]
        try:
            done = netconvert(options, folder, longest_s=_LONGEST_S)
        except (OSError, TimeoutExpired) as error:
            raise MapError(f"{extract.path}: netconvert does not come to an end with it: {error}") from error
        if done.returncode != 0 or not network.is_file():
            said = " ".join(netconvert_message(done.stderr).split())[:120]
            raise MapError(f"{extract.path}: netconvert makes no network of it ({said}); check the extract")
        yield network


def _told(extract: OsmExtract, network: Path, read: Callable[[Path], _Read]) -> _Read:
    """What `read` makes of the network; its faults are told of the extract."""
    try:
        return read(network)
    except MapError as error:
        said = str(error).replace(str(network), "the network that netconvert makes of it")
        raise MapError(f"{extract.path}: {said}") from error
