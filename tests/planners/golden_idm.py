"""The golden IDM cases of nuPlan: one explicit Euler step each."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from interplan_planners.common.idm_policy import IdmDriver, idm_acceleration_mps2, idm_step
from tests import golden_values
from tests.golden_values import Pair, floats

GOLDEN = golden_values.GOLDEN / "nuplan_idm"

Case = dict[str, Any]


def read_cases() -> list[Case]:
    file = GOLDEN / "idm_cases.json"
    return json.loads(file.read_text())["cases"] if file.exists() else []


def pairs(case: Case) -> Iterator[Pair]:
    """The acceleration before it is clipped, and progress and speed after the step."""
    p, agent, lead, wanted = case["parameters"], case["agent"], case["lead"], case["expected"]
    driver = IdmDriver(
        p["target_velocity"], p["min_gap_to_lead_agent"], p["headway_time"], p["accel_max"], p["decel_max"]
    )
    gap_m = lead["progress"] - lead["length_rear"] - agent["progress"]
    acceleration = idm_acceleration_mps2(driver, agent["velocity"], gap_m, lead["velocity"])
    moved_m, speed = idm_step(driver, agent["velocity"], gap_m, lead["velocity"], case["sampling_time"])
    yield Pair("unclipped_acceleration", floats(wanted["unclipped_acceleration"]), floats(acceleration))
    yield Pair("progress", floats(wanted["progress"]), floats(agent["progress"] + moved_m))
    yield Pair("velocity", floats(wanted["velocity"]), floats(speed))
