"""The same drive on differently optimised arithmetic: BLAS kernels differ between machines, traces must not."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.environments import environment

CODE = """
from interplan_sumo.planner import load_planner
from interplan_sumo.scenario.suite import find_scenario
from interplan_sumo.simulation.episode import drive

episode = drive(find_scenario("lane_change_htd/0"), load_planner("interplan_planners.idm:IdmPlanner"))
print(episode.trace.hash())
"""


@pytest.mark.slow
def test_a_trace_is_equal_under_two_blas_kernels() -> None:
    hashes = {
        kernel: subprocess.run(
            [sys.executable, "-c", CODE],
            env=environment(OPENBLAS_CORETYPE=kernel),
            capture_output=True,
            text=True,
            check=True,
            timeout=120,
        ).stdout.strip()
        for kernel in ("Haswell", "Nehalem")
    }
    assert len(hashes["Haswell"]) == 64
    assert hashes["Haswell"] == hashes["Nehalem"]
