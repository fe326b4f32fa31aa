"""The golden controller cases of nuPlan, as our own types."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from interplan_sumo.dynamics import bicycle
from interplan_sumo.dynamics.lqr import follow, target, track
from interplan_sumo.dynamics.rear_axle import center_of
from interplan_sumo.world.ego import PACIFICA, EgoShape, EgoState
from interplan_sumo.world.trajectory import Trajectory
from tests import golden_values
from tests.golden_values import Pair, floats

GOLDEN = golden_values.GOLDEN / "nuplan_controller"


@dataclass(frozen=True)
class Case:
    ego: EgoState
    plan: Trajectory
    expected: dict[str, Any]
    start_us: int
    step_s: float
    shape: EgoShape


def case_names() -> list[str]:
    return sorted(path.stem for path in GOLDEN.glob("*.json"))


def read_case(name: str) -> Case:
    """Times start at 0: epoch seconds in a double are off by a quarter of a microsecond."""
    table = json.loads((GOLDEN / f"{name}.json").read_text())
    body = table.get("vehicle", {})
    ahead_m = body.get("rear_axle_to_center", PACIFICA.rear_axle_to_center_m)
    wheelbase_m = body.get("wheel_base", PACIFICA.wheelbase_m)
    shape = replace(PACIFICA, wheelbase_m=wheelbase_m, rear_axle_to_center_m=ahead_m)
    start_us = table["initial_ego"]["time_us"]
    rows = np.array(table["planned_trajectory"]["rows"])
    heading = rows[:, 3]
    plan = Trajectory(
        (rows[:, 0] - start_us) * 1e-6,
        rows[:, 1] + ahead_m * np.cos(heading),
        rows[:, 2] + ahead_m * np.sin(heading),
        heading,
    )
    step_s = table.get("time_step", 0.1)
    return Case(ego_state(table["initial_ego"], start_us, shape), plan, table["expected"], start_us, step_s, shape)


def ego_state(row: dict[str, float], start_us: int, shape: EgoShape = PACIFICA) -> EgoState:
    x_m, y_m = center_of(row["x"], row["y"], row["heading"], shape)
    names = (
        "heading", "vx", "vy", "ax", "ay", "tire_steering_angle", "tire_steering_rate", "angular_velocity",
        "angular_acceleration",
    )  # fmt: skip
    return EgoState((row["time_us"] - start_us) * 1e-6, x_m, y_m, *(row[name] for name in names))


def pairs(case: Case) -> Iterator[Pair]:
    """Every stored value beside ours: what is aimed at, the commands, the state after a step, the closed loop."""
    yield from aim_pairs(case)
    yield from step_pairs(case)
    yield from loop_pairs(case)


def aim_pairs(case: Case) -> Iterator[Pair]:
    """What the tracker reads off the plan, and its commands."""
    wanted = case.expected
    aim = target(case.ego, case.plan, case.shape)
    command = track(case.ego, case.plan, case.shape)
    for name, ours in (
        ("reference_velocity", aim.speed_mps),
        ("curvature_profile", list(aim.curvature_per_m)),
        ("lateral_error", aim.lateral_error_m),
        ("heading_error", aim.heading_error_rad),
        ("acceleration_command", command.acceleration_mps2),
        ("steering_rate_command", command.tire_rate_radps),
    ):
        yield Pair(name, floats(wanted[name]), floats(ours))


def step_pairs(case: Case) -> Iterator[Pair]:
    """The state after one step of the vehicle."""
    after = follow(case.ego, case.plan, case.step_s, case.shape)
    wanted = ego_state(case.expected["state_after_one_step"], case.start_us, case.shape)
    yield Pair("state_after_one_step", _numbers(wanted), _numbers(after))


def loop_pairs(case: Case) -> Iterator[Pair]:
    """Commands and last state of the plan tracked step by step; nothing where the case has no closed loop."""
    loop = case.expected.get("closed_loop")
    if loop is None:
        return
    state, commands = case.ego, list[float]()
    for _ in loop["commands"]:
        command = track(state, case.plan, case.shape)
        commands += [command.acceleration_mps2, command.tire_rate_radps]
        state = bicycle.step(state, command.acceleration_mps2, command.tire_rate_radps, case.step_s, case.shape)
    yield Pair("closed_loop commands", floats(np.ravel(loop["commands"])), floats(commands))
    yield Pair(
        "closed_loop state", _numbers(ego_state(loop["state_after"], case.start_us, case.shape)), _numbers(state)
    )


def _numbers(state: EgoState) -> np.ndarray:
    return floats([getattr(state, column.name) for column in fields(state)])
