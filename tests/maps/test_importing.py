"""Importing: a map is there as a whole or not at all, whatever the format."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import pytest

from interplan_sumo.errors import InputError
from interplan_sumo.maps.controls import CONTROLS_FILE
from interplan_sumo.maps.importers.importing import import_map
from interplan_sumo.maps.store import find_map, maps, write_maps_manifest
from tests.maps.argoverse_files import straight, street, tile, written


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_an_import_that_fails_leaves_what_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "town"
    import_map(written(street(), tmp_path), "argoverse2", folder)
    before = contents(folder)
    assert "1.0/map.net.xml.gz" in before
    other = written(tile(straight(1, 0.0, 90.0, 0.0)), tmp_path)
    with monkeypatch.context() as full:
        full.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))  # so that SUMO makes no network
        with pytest.raises(InputError, match="cannot write"):
            import_map(other, "argoverse2", folder, overwrite=True)
        with pytest.raises(InputError, match="cannot write"):
            import_map(other, "argoverse2", tmp_path / "village")
    assert contents(folder) == before
    assert contents(tmp_path / "village") == {}
    import_map(other, "argoverse2", tmp_path / "village")
    (folder / "1.0" / CONTROLS_FILE).write_text("{}")  # of the map that was there
    import_map(other, "argoverse2", folder, overwrite=True)
    assert contents(folder).keys() == before.keys()
    assert contents(folder) != before


def test_what_a_killed_import_leaves_is_no_map(tmp_path: Path) -> None:
    folder = tmp_path / "maps" / "town"
    files, _ = import_map(written(street(), tmp_path), "argoverse2", folder)
    for left in (folder / ".writing-1", tmp_path / "maps" / ".writing-2" / "1.0"):
        left.mkdir(parents=True)
        shutil.copy(files.gpkg, left / "map.gpkg")
    assert find_map(folder).folder == files.folder
    write_maps_manifest(tmp_path / "maps")
    assert list(maps(tmp_path / "maps")) == ["town"]
