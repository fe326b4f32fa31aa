"""Learned planners drive alike whichever kernels OpenBLAS has for the processor, and with two threads."""

from __future__ import annotations

import pytest

from benchmarks.trust import KERNELS, driven


@pytest.mark.nightly
def test_a_learned_planner_has_one_trace_over_blas_kernels_and_threads() -> None:
    assert len({driven("urban_driver", kernel)["hash"] for kernel in KERNELS}) == 1
