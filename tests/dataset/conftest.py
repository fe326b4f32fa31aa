"""The run that the tests of datasets share: nobody changes it."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

import pytest
from recorded import recorded_run

from interplan_sumo.batch.run_folder import read_run
from interplan_sumo.batch.stored_drive import StoredDrive, StoredDrives


@pytest.fixture(scope="session")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A nudge in right-hand traffic and a lane change in left-hand traffic, two seeds each."""
    temp = tmp_path_factory.getbasetemp()
    runs = temp if "PYTEST_XDIST_WORKER" not in os.environ else temp.parent  # one run for all of pytest's workers
    with (runs / "driving").open("w") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        folder = runs / "runs" / "mine"
        return folder if folder.exists() else recorded_run(folder, "nudge/0", "lane_change_mtd/1", seeds=2)


@pytest.fixture(scope="session")
def stored(driven: Path) -> StoredDrive:
    """A drive of the IDM planner through SUMO's traffic."""
    runs = StoredDrives(read_run(driven))
    return runs.read(runs.run.rows["lane_change_mtd/1", "idm", 0])
