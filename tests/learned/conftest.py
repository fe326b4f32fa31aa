"""What the tests of learned planners share: a data set, which nobody changes, and modules that need torch."""

from __future__ import annotations

import importlib
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


@pytest.fixture(scope="module", autouse=True)
def modules_that_need_torch(request: pytest.FixtureRequest) -> None:
    """What a test module names in NEEDS_TORCH: imported when its tests run, since collection must not take seconds."""
    for name, module in getattr(request.module, "NEEDS_TORCH", {}).items():
        pytest.importorskip("torch", reason="needs torch: pip install 'interplan-sumo[train]'")
        setattr(request.module, name, importlib.import_module(module))
