"""Expert drives: what progress is measured against, recorded once per suite and stored with it.

The expert of a scenario is the IDM planner on the same road with the same
lights but without any traffic: how far a lawful driver gets whom nobody
hinders. It keeps its lane and stops nowhere but at red lights.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pandas as pd

from interplan_sumo.errors import ScenarioError
from interplan_sumo.planner import load_planner
from interplan_sumo.scenario.scenario import Scenario, TrafficDemand
from interplan_sumo.scenario.suite import Suite
from interplan_sumo.simulation.episode import drive
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.trace import EgoTrack

DRIVER = "idm"


def expert_drive(scenario: Scenario) -> EgoTrack:
    """Drive the scenario without traffic, up to the goal line; ScenarioError if that fails."""
    empty = replace(scenario, traffic=TrafficDemand())
    episode = drive(empty, load_planner(DRIVER))
    if episode.trace is None or episode.fault is not None:
        reason = episode.fault.message if episode.fault is not None else "nothing was recorded"
        raise ScenarioError(f"{scenario.id}: the expert cannot drive it: {reason}")
    return episode.trace.ego


def write_experts(suite: Suite) -> Path:
    """Record the experts of a suite into its folder, one table for all; the columns of ego.parquet and the scenario."""
    tables: list[pd.DataFrame] = []
    for scenario in sorted(suite.scenarios, key=lambda s: s.id):
        track = expert_drive(scenario)
        table = track.to_frame(PACIFICA)
        table.insert(0, "scenario_id", scenario.id)
        tables.append(table)
    path = suite.folder / "experts.parquet"
    path.parent.mkdir(parents=True, exist_ok=True)
    together = pd.concat(tables, ignore_index=True)
    together["scenario_id"] = together["scenario_id"].astype("category")
    together.to_parquet(path, index=False, compression="zstd")
    return path
