"""maps import and maps check --source: what is printed, and one line for whatever goes wrong."""

from __future__ import annotations

import contextlib
import io
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from interplan_sumo.cli import main
from tests.commands import ran
from tests.maps.argoverse_files import street, written

pytestmark = pytest.mark.slow


@dataclass(frozen=True)
class Imported:
    """A small Argoverse 2 map file, the map made from it, and what was said of that as JSON."""

    tile: Path
    out: Path
    said: dict[str, Any]


@pytest.fixture(scope="module")
def imported(tmp_path_factory: pytest.TempPathFactory) -> Imported:
    folder = tmp_path_factory.mktemp("import")
    tile, out = written(street(), folder), folder / "my_street"
    with contextlib.redirect_stdout(io.StringIO()) as said:
        assert main(["maps", "import", str(tile), "--format", "argoverse2", "--out", str(out), "--json"]) == 0
    return Imported(tile, out, json.loads(said.getvalue()))


def test_an_imported_map_is_named_after_its_folder_and_passes_both_checks(
    capsys: pytest.CaptureFixture[str], imported: Imported
) -> None:
    entry, folder = imported.said, imported.out / "1.0"
    assert (entry["name"], Path(entry["path"])) == ("my_street", folder)
    assert entry["lanes"] > 0
    assert {path.name for path in folder.iterdir()} == {"map.gpkg", "map.net.xml.gz", "ids.json", "import.json"}
    code, said, _ = ran(capsys, "maps", "check", imported.out, "--source", imported.tile, "--json")
    assert code == 0
    report = json.loads(said)
    assert report["ok"] is True
    assert report["source"]["lanes"]["file"] == report["source"]["lanes"]["map"] > 0
    assert report["lane_deviation_m"]["max"] < 0.05


def test_the_table_for_people_shows_the_file_beside_the_map(
    capsys: pytest.CaptureFixture[str], imported: Imported
) -> None:
    code, said, _ = ran(capsys, "maps", "check", imported.out, "--source", imported.tile)
    assert code == 0
    for word in ("lane_km", "against log_map_archive", "file", "map", "leaving"):
        assert word in said


def test_a_changed_source_file_fails_the_check(
    capsys: pytest.CaptureFixture[str], imported: Imported, tmp_path: Path
) -> None:
    content = json.loads(imported.tile.read_text())
    lost = next(iter(content["lane_segments"]))
    del content["lane_segments"][lost]
    tile = tmp_path / imported.tile.name
    tile.write_text(json.dumps(content))
    code, said, _ = ran(capsys, "maps", "check", imported.out, "--source", tile, "--json")
    assert code == 1
    problems = {(problem["kind"], problem["layer"], problem["id"]) for problem in json.loads(said)["problems"]}
    assert {("another_file", "file", str(tile)), ("extra", "lane", lost)} <= problems


def test_a_nuplan_map_is_taken_as_it_is(capsys: pytest.CaptureFixture[str], imported: Imported, tmp_path: Path) -> None:
    gpkg, second = imported.out / "1.0" / "map.gpkg", tmp_path / "second"
    code, _, _ = ran(capsys, "maps", "import", gpkg, "--format", "nuplan", "--out", second)
    assert code == 0
    code, _, _ = ran(capsys, "maps", "check", second, "--source", gpkg)
    assert code == 0


def test_a_map_is_not_overwritten_unless_asked_for(
    capsys: pytest.CaptureFixture[str], imported: Imported, tmp_path: Path
) -> None:
    place = tmp_path / "my_street"
    (place / "1.0").mkdir(parents=True)
    (place / "1.0" / "map.gpkg").touch()
    command = ("maps", "import", imported.tile.parent, "--format", "argoverse2", "--out", place)
    code, _, error = ran(capsys, *command)
    assert code == 2
    assert "exists; name another folder with --out, or give --overwrite" in error
    code, said, _ = ran(capsys, *command, "--overwrite")
    assert code == 0
    assert "note: The format has no speed limits" in said
    assert "maps check" in said
    assert (place / "1.0" / "map.gpkg").read_bytes() == (imported.out / "1.0" / "map.gpkg").read_bytes()


@pytest.mark.parametrize(
    ("source", "format", "words"),
    [
        ("nowhere.json", "argoverse2", "there is no file"),
        (".", "lanelet2", r"holds 0 files \*\.osm; name one file"),
        ("log_map_archive_a.json", "argovers2", "Did you mean 'argoverse2'"),
        ("log_map_archive_a.json", "argoverse2", "log_map_archive_a.json"),
        ("log_map_archive_a.json", "lanelet2", "log_map_archive_a.json"),
        ("log_map_archive_a.json", "commonroad", "log_map_archive_a.json"),
        ("log_map_archive_a.json", "opendrive", "log_map_archive_a.json"),
        ("log_map_archive_a.json", "osm", "log_map_archive_a.json"),
        ("log_map_archive_a.json", "sumo", "log_map_archive_a.json"),
        ("log_map_archive_a.json", "nuplan", "log_map_archive_a.json"),
    ],
)
def test_bad_input_is_one_clear_line(
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    source: str,
    format: str,
    words: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "log_map_archive_a.json").write_text("{ not a map")
    code, said, error = ran(capsys, "maps", "import", source, "--format", format, "--out", "out")
    assert code == 2
    assert said == ""
    assert len(error.strip().splitlines()) == 1
    assert re.search(words, error), error
    assert not (tmp_path / "out").exists()
