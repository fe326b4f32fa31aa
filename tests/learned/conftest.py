"""The data set that the tests of learned planners share: nobody changes it."""

from __future__ import annotations

from pathlib import Path

import pytest
from tiny_dataset import write_tiny_dataset

from interplan_sumo.dataset.reading import Dataset, read_dataset


@pytest.fixture(scope="session")
def tiny_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny_dataset(tmp_path_factory.mktemp("learned") / "data")


@pytest.fixture(scope="session")
def tiny_data(tiny_folder: Path) -> Dataset:
    return read_dataset(tiny_folder)
