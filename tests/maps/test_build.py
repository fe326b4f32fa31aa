"""The shipped maps: built in one go, the same every time, and fit to drive on."""

from __future__ import annotations

from pathlib import Path

import pytest

from interplan_sumo.maps.build import build_district
from interplan_sumo.maps.check import check_map
from interplan_sumo.maps.geopackage import read_map
from interplan_sumo.maps.store import MapFiles, maps
from tests.maps.sumo_runs import random_traffic

SHIPPED = maps()
SMALL_BYTES = 500_000


@pytest.mark.slow
def test_a_district_is_built_the_same_every_time_and_listed(tmp_path: Path) -> None:
    first, second = (build_district("back_bay", tmp_path / k) for k in "ab")
    assert first.ok
    assert first == second
    one, other = (maps(tmp_path / k)["back_bay"] for k in "ab")
    for path in (one.gpkg, one.network, one.ids):
        assert path.read_bytes() == (other.folder / path.name).read_bytes()


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_maps_pass_the_check_and_stay_small(name: str) -> None:
    files: MapFiles = SHIPPED[name]
    report = check_map(files, read_map(files.gpkg, name))
    assert report.problems == ()
    assert report.lane_deviation_m.max < 0.01
    assert report.connector_deviation_m.max < 0.01
    assert files.network.stat().st_size + files.ids.stat().st_size < SMALL_BYTES


@pytest.mark.parametrize("name", SHIPPED)
@pytest.mark.slow
def test_traffic_on_shipped_maps_meets_no_accident(name: str, tmp_path: Path) -> None:
    files = SHIPPED[name]
    run = random_traffic(files, read_map(files.gpkg, name), tmp_path, vehicles=100, seed=2)
    assert run.vehicles > 50
    assert run.teleports == 0
    assert run.collisions == 0
    assert [overlap for overlap in run.overlaps if not overlap.askew] == []
    assert run.without_cause == ()
