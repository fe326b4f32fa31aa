"""nuPlan's devkit for the tests that need it; they are skipped where it is not on the path."""

from __future__ import annotations

import importlib
import warnings
from typing import Any

import pytest

REASON = "nuPlan's devkit is not on PYTHONPATH (docs/nuplan_planners.md)"


def devkit(module: str = "nuplan.planning.simulation.planner.abstract_planner") -> Any:
    """A module of the devkit, or of ours or others that needs it; skips the test where it cannot be imported."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the devkit's and its dependencies' own
        try:
            importlib.import_module("nuplan.planning.simulation.planner.abstract_planner")
            return importlib.import_module(module)
        except ModuleNotFoundError as error:
            if str(error.name).startswith("interplan_sumo"):  # of ours, so no excuse
                raise
            pytest.skip(f"no module {error.name}: {REASON}")
