"""A Lanelet2 file in the making, and where it goes."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.maps.lanelet2_files import Osm


@pytest.fixture
def osm() -> Osm:
    return Osm()


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "map.osm"
