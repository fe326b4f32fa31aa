"""Maps that came along with scenarios: found by name beside their file, never confused with shipped ones."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from interplan_sumo.errors import MapError, UnknownNameError
from interplan_sumo.maps.crop import crop
from interplan_sumo.maps.store import MANIFEST, MapFiles, copy_map, find_map, is_shipped, load_roads, maps, place_map
from interplan_sumo.tiny_worlds import straight_road


@pytest.fixture
def beside(tmp_path: Path) -> Path:
    """A maps folder with one map, `backwater`."""
    shutil.copytree(find_map("strip").folder, tmp_path / "maps" / "backwater" / "1.0")
    return tmp_path / "maps"


def test_a_name_is_looked_for_beside_and_among_the_shipped_maps(beside: Path) -> None:
    assert find_map("backwater", beside).folder == (beside / "backwater" / "1.0").resolve()
    assert find_map("strip", beside) == find_map("strip")
    assert load_roads("backwater", beside).name == "backwater"
    with pytest.raises(UnknownNameError, match="no map named 'backwater'"):
        find_map("backwater")


def test_a_misspelt_name_leads_to_the_map_beside(beside: Path) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'backwater'"):
        find_map("backwatr", beside)


def test_a_name_that_is_shipped_and_beside_is_refused(beside: Path) -> None:
    shutil.copytree(beside / "backwater", beside / "strip")
    with pytest.raises(MapError, match=r"map 'strip' is a shipped one and lies in .*, too; rename that folder"):
        find_map("strip", beside)
    assert find_map("strip").folder == maps()["strip"].folder


def test_a_folder_without_maps_and_none_at_all_change_nothing(tmp_path: Path) -> None:
    assert find_map("strip", tmp_path) == find_map("strip")
    assert find_map("strip", tmp_path / "nowhere") == find_map("strip")


def test_only_a_map_in_its_own_place_is_a_shipped_one(beside: Path) -> None:
    assert is_shipped(find_map("strip"))
    assert is_shipped(find_map(find_map("strip").folder))
    assert not is_shipped(find_map("backwater", beside))
    shutil.copytree(beside / "backwater", beside / "strip")
    assert not is_shipped(find_map(beside / "strip"))


def test_a_copy_has_the_same_hash_and_another_network_another_one(beside: Path, tmp_path: Path) -> None:
    files = find_map("backwater", beside)
    copy = copy_map(files, tmp_path / "copy")
    assert copy.hash() == files.hash()
    assert json.loads((tmp_path / "copy" / MANIFEST).read_text()) == {"backwater": {"version": "1.0", "layers": {}}}
    assert sorted(each.name for each in (tmp_path / "copy").iterdir()) == ["backwater", MANIFEST]
    copy.network.write_bytes(copy.network.read_bytes() + b"\0")
    assert copy.hash() != files.hash()
    copy.network.unlink()
    with pytest.raises(MapError, match="maps convert"):
        copy.hash()


def test_a_copy_takes_the_place_of_what_was_there_and_a_map_stays_where_it_is(beside: Path, tmp_path: Path) -> None:
    files = find_map("backwater", beside)
    old = tmp_path / "copy" / "backwater" / "0.9"
    old.mkdir(parents=True)
    copy_map(files, tmp_path / "copy")
    assert not old.exists()
    before = files.gpkg.stat().st_mtime_ns
    assert copy_map(files, beside).gpkg.stat().st_mtime_ns == before


def test_a_map_that_cannot_be_filled_leaves_what_was_there(beside: Path) -> None:
    def fail(folder: Path) -> None:
        (folder / "map.gpkg").write_bytes(b"half")
        raise OSError(28, "No space left on device")

    with pytest.raises(MapError, match=r"cannot put map backwater into .*No space left"):
        place_map(MapFiles("backwater", "1.0", beside / "backwater" / "1.0"), beside, fail)
    assert [each.name for each in beside.iterdir()] == ["backwater"]
    assert find_map("backwater", beside).hash() == find_map("strip").hash()


def test_a_crop_several_places_is_what_lies_around_each() -> None:
    roads = straight_road(length_m=400.0, cuts_m=((90.0, 100.0), (190.0, 200.0), (290.0, 300.0)))
    one, other = (crop(roads, [place], 20.0) for place in ((10.0, 0.0), (390.0, 0.0)))
    both = crop(roads, ((10.0, 0.0), (390.0, 0.0)), 20.0)
    assert set(both.lanes) == {*one.lanes, *other.lanes} == {"11", "71"}
    assert {each.id for each in both.road_segments} == {each.id for each in (*one.road_segments, *other.road_segments)}
    with pytest.raises(ValueError, match="a crop needs finite places"):
        crop(roads, (), 20.0)
