"""Maps by name and by folder."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from interplan_sumo.errors import MapError, UnknownNameError
from interplan_sumo.maps import store
from interplan_sumo.maps.geopackage_writer import write_map
from interplan_sumo.maps.store import find_map, load_roads, maps, write_maps_manifest
from tests.maps.road_worlds import GridPlan, grid_city


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A maps root with two maps."""
    for name, version in (("zoo", "1.0"), ("alley", "2.1")):
        write_map(grid_city(GridPlan(lanes=1, spacing_m=50.0)), tmp_path / "root" / name / version / "map.gpkg")
    write_maps_manifest(tmp_path / "root")
    return tmp_path / "root"


def test_a_written_manifest_is_nuplans(root: Path) -> None:
    content = json.loads((root / "nuplan-maps-v1.0.json").read_text())
    assert content == {"alley": {"version": "2.1", "layers": {}}, "zoo": {"version": "1.0", "layers": {}}}
    assert {name: files.version for name, files in maps(root).items()} == {"alley": "2.1", "zoo": "1.0"}


def test_locations_that_are_not_on_this_machine_are_left_out(root: Path) -> None:
    (root / "zoo" / "1.0" / "map.gpkg").unlink()
    assert list(maps(root)) == ["alley"]


def test_a_root_without_a_manifest_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MapError, match=r"no nuplan-maps-v1\.0\.json in"):
        maps(tmp_path)


@pytest.mark.parametrize(
    "content",
    ["", "[]", "{", '{"a": 1}', '{"a": {"version": 2}}', '{"a": {"version": "../b"}}', '{"..": {"version": "1"}}'],
)
def test_a_manifest_of_another_kind_is_refused(content: str, tmp_path: Path) -> None:
    (tmp_path / "nuplan-maps-v1.0.json").write_text(content)
    with pytest.raises(MapError, match=r"nuplan-maps-v1\.0\.json"):
        maps(tmp_path)


def test_two_versions_of_a_location_cannot_be_listed(root: Path) -> None:
    (root / "zoo" / "1.1").mkdir()
    (root / "zoo" / "1.1" / "map.gpkg").touch()
    with pytest.raises(MapError, match=r"zoo has the versions 1\.0 and 1\.1"):
        write_maps_manifest(root)
    with pytest.raises(MapError, match=r"several versions of a map \(1\.0, 1\.1\)"):
        find_map(root / "zoo")


def test_a_map_is_found_by_folder(root: Path) -> None:
    for path in (root / "zoo" / "1.0", root / "zoo", root / "zoo" / "1.0" / "map.gpkg"):
        files = find_map(path)
        assert (files.name, files.version, files.folder) == ("zoo", "1.0", (root / "zoo" / "1.0").resolve())
        assert find_map(os.fspath(path)) == files


def test_a_map_is_found_by_name(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store, "maps_root", lambda: root)
    assert find_map("alley").folder == root / "alley" / "2.1"
    with pytest.raises(UnknownNameError, match=r"no map named 'aley'\. Did you mean 'alley'"):
        find_map("aley")
    with pytest.raises(UnknownNameError, match=r"A folder must hold a map\.gpkg"):
        find_map(root / "nowhere")


def test_a_file_of_a_foreign_network_is_refused_with_the_command_that_imports_it(tmp_path: Path) -> None:
    (tmp_path / "town.net.xml").touch()
    with pytest.raises(MapError, match=r"maps import .*town\.net\.xml --format sumo --out DIR"):
        find_map(tmp_path / "town.net.xml")


def test_roads_are_read_once_until_the_file_changes(root: Path) -> None:
    roads = load_roads(root / "zoo")
    assert roads.name == "zoo"
    assert load_roads(root / "zoo" / "1.0") is roads
    write_map(grid_city(GridPlan(lanes=2, spacing_m=50.0)), root / "zoo" / "1.0" / "map.gpkg")
    assert len(load_roads(root / "zoo").lanes) == 2 * len(roads.lanes)
