"""Maps that travel with scenarios: whole if small, else what lies around, the same bytes each time."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from interplan_sumo.errors import InputError, MapError
from interplan_sumo.maps.store import MapFiles, find_map, load_roads
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.verification.generation import carry, generate
from interplan_sumo.verification.map_bundling import KEPT_M, carry_map, own_maps_root, places_of


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> MapFiles:
    """The map `strip` under another name; not to be changed."""
    folder = tmp_path_factory.mktemp("own") / "backwater" / "1.0"
    shutil.copytree(find_map("strip").folder, folder)
    return find_map(folder)


@pytest.fixture(scope="module")
def scenario(own: MapFiles) -> Scenario:
    (found,) = generate(load_roads(own.folder), "nudge", 1, 3, maps_beside=own_maps_root(own)).scenarios
    return found


def test_shipped_maps_need_no_root_and_others_lie_in_theirs(own: MapFiles, tmp_path: Path) -> None:
    assert own_maps_root(find_map("strip")) is None
    assert own_maps_root(own) == own.folder.parents[1]
    shutil.copytree(own.folder, tmp_path / "strip" / "1.0")
    with pytest.raises(MapError, match="map 'strip' is a shipped one"):
        own_maps_root(find_map(tmp_path / "strip"))
    for version in ("1.0", "1.1"):
        shutil.copytree(own.folder, tmp_path / "two" / version)
    with pytest.raises(MapError, match="several versions"):
        own_maps_root(find_map(tmp_path / "two" / "1.0"))


@pytest.mark.parametrize(("spare", "is_whole"), [(0, True), (-1, False)])
def test_a_map_goes_whole_up_to_a_number_of_lanes(
    own: MapFiles, scenario: Scenario, tmp_path: Path, spare: int, is_whole: bool
) -> None:
    roads = load_roads(own.folder)
    carried = carry_map(own, roads, [scenario], tmp_path, whole_lanes=len(roads.lanes) + spare)
    part = load_roads(carried.folder)
    assert (carried.hash() == own.hash()) is is_whole
    assert (len(part.lanes) == len(roads.lanes)) is is_whole
    assert set(part.lanes) <= set(roads.lanes)
    scenario.check(part)
    for x_m, y_m in places_of(scenario, roads):
        near = {lane for lane in roads.lanes_near(x_m, y_m, KEPT_M) if lane in roads.lanes}
        assert near <= set(part.lanes)


@pytest.mark.slow
def test_a_part_has_the_same_bytes_each_time(own: MapFiles, scenario: Scenario, tmp_path: Path) -> None:
    roads = load_roads(own.folder)
    one, other = (carry_map(own, roads, [scenario], tmp_path / name, whole_lanes=0) for name in ("one", "other"))
    assert one.hash() == other.hash()


def test_another_map_of_that_name_is_replaced_only_if_that_is_wanted(
    own: MapFiles, scenario: Scenario, tmp_path: Path
) -> None:
    roads = load_roads(own.folder)
    carry_map(own, roads, [scenario], tmp_path, whole_lanes=0)
    with pytest.raises(InputError, match="backwater exists; name another folder with --out, or give --overwrite"):
        carry_map(own, roads, [scenario], tmp_path)
    assert carry_map(own, roads, [scenario], tmp_path, overwrite=True).hash() == own.hash()


def test_a_map_that_lies_there_already_is_never_cut(own: MapFiles, scenario: Scenario) -> None:
    before = own.hash()
    root = own.folder.parents[1]
    assert carry_map(own, load_roads(own.folder), [scenario], root, whole_lanes=0).folder == own.folder
    assert own.hash() == before


def test_generated_scenarios_take_place_on_the_map_in_their_folder(own: MapFiles, tmp_path: Path) -> None:
    made = generate(load_roads(own.folder), "nudge", 2, 3, maps_beside=own_maps_root(own))
    hashes = [each.hash() for each in made.scenarios]
    carry([made], own, tmp_path)
    assert {each.maps_beside for each in made.scenarios} == {tmp_path.resolve() / "maps"}
    assert [each.hash() for each in made.scenarios] == hashes
    assert {each.map for each in made.scenarios} == {"backwater"}
