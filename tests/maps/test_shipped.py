"""The maps in nets/ are what the code makes today, small enough to start fast, and faithful."""

from __future__ import annotations

from pathlib import Path

import pytest

from interplan_sumo.maps.check import check_map
from interplan_sumo.maps.districts import DISTRICTS, draw
from interplan_sumo.maps.store import find_map, load_roads, maps
from interplan_sumo.maps.to_sumo import convert
from interplan_sumo.verification.lock import roads_hash

NAMES = sorted(DISTRICTS)


def test_every_district_is_shipped_and_nothing_else() -> None:
    assert sorted(maps()) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_the_shipped_map_is_the_drawn_one(name: str) -> None:
    assert roads_hash(load_roads(name)) == roads_hash(draw(name))


@pytest.mark.parametrize("name", NAMES)
def test_the_shipped_network_is_made_from_the_shipped_map_byte_for_byte(name: str, tmp_path: Path) -> None:
    convert(load_roads(name), tmp_path)
    for file in ("map.net.xml.gz", "ids.json"):
        assert (tmp_path / file).read_bytes() == (find_map(name).folder / file).read_bytes()


@pytest.mark.parametrize("name", NAMES)
def test_the_shipped_network_is_faithful(name: str) -> None:
    report = check_map(find_map(name), load_roads(name))
    assert report.ok, report.problems
