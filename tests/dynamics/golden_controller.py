"""The golden controller cases of nuPlan, as our own types."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from interplan_sumo.dynamics.rear_axle import center_of
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.trajectory import Trajectory

GOLDEN = Path(os.environ.get("INTERPLAN_GOLDEN", Path(__file__).parents[1] / "golden")) / "nuplan_controller"


@dataclass(frozen=True)
class Case:
    ego: EgoState
    plan: Trajectory
    expected: dict[str, Any]
    start_us: int


def case_names() -> list[str]:
    return sorted(path.stem for path in GOLDEN.glob("*.json"))


def read_case(name: str) -> Case:
    """Times start at 0: epoch seconds in a double are off by a quarter of a microsecond."""
    table = json.loads((GOLDEN / f"{name}.json").read_text())
    start_us = table["initial_ego"]["time_us"]
    rows = np.array(table["planned_trajectory"]["rows"])
    heading = rows[:, 3]
    ahead_m = PACIFICA.rear_axle_to_center_m
    plan = Trajectory(
        (rows[:, 0] - start_us) * 1e-6,
        rows[:, 1] + ahead_m * np.cos(heading),
        rows[:, 2] + ahead_m * np.sin(heading),
        heading,
    )
    return Case(ego_state(table["initial_ego"], start_us), plan, table["expected"], start_us)


def ego_state(row: dict[str, float], start_us: int) -> EgoState:
    x_m, y_m = center_of(row["x"], row["y"], row["heading"], PACIFICA)
    names = (
        "heading", "vx", "vy", "ax", "ay", "tire_steering_angle", "tire_steering_rate", "angular_velocity",
        "angular_acceleration",
    )  # fmt: skip
    return EgoState((row["time_us"] - start_us) * 1e-6, x_m, y_m, *(row[name] for name in names))
