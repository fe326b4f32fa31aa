"""Hundreds of kilometres in one process, in short: what is held, and how a slope of memory is told."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from benchmarks.long_drive import Driven, Held, held, jobs, settings_of, slope_mb_per_100_km
from interplan_sumo.batch.options import RunOptions
from interplan_sumo.endurance.city import STATES
from interplan_sumo.endurance.kilometres import EndureOptions
from tests.simulation.traffic_invariants import Violation


def options(folder: Path, metres: float = 1500.0) -> EndureOptions:
    run = RunOptions(workers=0, in_process=True)
    return EndureOptions("idm", "strip", 1.0, folder, density=0.25, run=run, segment_m=metres)


def test_a_worker_that_leaks_a_tenth_of_a_megabyte_per_kilometre_is_told_so() -> None:
    noise = np.random.default_rng(0).normal(0.0, 50.0, 400)
    leaks = [Driven(1000.0, 1.0, 400_000.0 + 102.4 * km + each) for km, each in enumerate(noise)]
    slope, error = slope_mb_per_100_km(leaks)
    assert slope == pytest.approx(10.0, abs=4.0 * error)
    assert error < 0.1


def test_what_comes_and_goes_where_the_map_ends_is_nothing_broken() -> None:
    gone = [Violation(kind, 3, "a", 20.0) for kind in ("leaves_at_map_end", "leaves", "appears_at_map_end")]
    assert [each.kind for _, each in Held(found=[(0, each) for each in gone]).broken] == ["leaves"]


def test_segments_are_those_of_endure_one_after_the_other(tmp_path: Path) -> None:
    assert [job.index for job in islice(jobs(options(tmp_path)), 2 * STATES + 1)] == list(range(2 * STATES + 1))


@pytest.mark.slow
def test_every_frame_of_the_district_is_held(tmp_path: Path) -> None:
    given = options(tmp_path, 60.0)
    total = next(held(given, settings_of(given).drive.seat("idm")))
    assert total.metres >= 60.0
    assert total.agent_s > 50 * 15.0  # the run-out at least, and fifty vehicles in the district
    assert total.broken == []
