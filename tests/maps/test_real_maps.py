"""Real maps of every format: imported whole, faithful in SUMO, and good to drive on."""

from __future__ import annotations

from pathlib import Path

import pytest

from interplan_sumo.families import names
from interplan_sumo.maps.check import check_map
from interplan_sumo.maps.importers.importing import check_source, import_map
from interplan_sumo.maps.importers.record import ImportRecord, read_record
from interplan_sumo.maps.store import MapFiles, load_roads
from interplan_sumo.verification.generation import generate
from tests.maps.sumo_runs import random_traffic
from tests.quick import few
from tests.realdata import real

REAL_MAPS = {
    "austin": ("argoverse2", ("argoverse2", "austin_0a1e6f0a")),
    "pittsburgh": ("argoverse2", ("argoverse2", "pit_57819")),
    "karlsruhe": ("lanelet2", ("lanelet2", "mapping_example.osm")),
    "lankershim": ("commonroad", ("commonroad", "USA_Lanker-1_1_T-1.xml")),
    "town01": ("opendrive", ("opendrive", "Town01.xodr")),
    "lankershim_sumo": ("sumo", ("sumo_nets", "ngsim_lankershim.net.xml")),
}
by_map = pytest.mark.parametrize("name", few(REAL_MAPS, 1, 1))


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("real_maps")


def imported(root: Path, name: str) -> tuple[MapFiles, Path]:
    """The map, imported once per test module, and its source."""
    format, parts = REAL_MAPS[name]
    source = real(*parts)
    files = MapFiles(name, "1.0", root / name / "1.0")
    if not files.gpkg.exists():
        import_map(source, format, root / name)
    return files, source


@by_map
def test_nothing_of_the_file_is_lost(root: Path, name: str) -> None:
    files, source = imported(root, name)
    report = check_source(files, load_roads(files.folder), _record(files), source)
    assert report.problems == ()
    assert report.lanes.file == report.lanes.map > 30
    assert report.links.file == report.links.map > 30


def _record(files: MapFiles) -> ImportRecord:
    record = read_record(files.folder)
    assert record is not None
    return record


@by_map
def test_its_network_lies_where_the_map_does(root: Path, name: str) -> None:
    files, _ = imported(root, name)
    report = check_map(files, load_roads(files.folder))
    assert report.problems == ()
    assert report.lane_deviation_m.max < 0.05


@pytest.mark.parametrize("name", few(REAL_MAPS, 1, 1))
def test_the_same_file_gives_the_same_map(root: Path, name: str, tmp_path: Path) -> None:
    files, source = imported(root, name)
    again, _ = import_map(source, REAL_MAPS[name][0], tmp_path / name)
    for one, other in ((files.network, again.network), (files.ids, again.ids)):
        assert one.read_bytes() == other.read_bytes()
    assert (files.folder / "import.json").read_bytes() == (again.folder / "import.json").read_bytes()


@by_map
@pytest.mark.parametrize("seed", few([1, 2], 1, 1))
def test_random_traffic_drives_a_minute_without_teleports_or_overlaps(
    root: Path, name: str, seed: int, tmp_path: Path
) -> None:
    """Cars that stand askew after one of SUMO's slow lane changes may touch; the closed loop looks after these."""
    files, _ = imported(root, name)
    run = random_traffic(files, load_roads(files.folder), tmp_path, vehicles=60, seed=seed)
    assert run.teleports == 0
    assert run.collisions == 0
    assert [overlap for overlap in run.overlaps if not overlap.askew] == []


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["pittsburgh", "karlsruhe"])
def test_at_least_five_families_find_sites(root: Path, name: str) -> None:
    files, _ = imported(root, name)
    roads = load_roads(files.folder)
    found = [family for family in names(ordinary=False) if generate(roads, family, 3, 0).scenarios]
    assert len(found) >= 5, found
