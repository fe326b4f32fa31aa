"""Who brakes while it is still changing lane: SUMO's erring drivers behind it stop in time, others are left alone."""

from __future__ import annotations

from pathlib import Path

import libsumo
import numpy as np
import pytest
from networks import LANE_Y, agent, ego_at, traffic

from interplan_sumo.simulation.vehicle_types import read_vehicle_types, vehicle_type_file

SPEED_MPS = 14.0


def drive(model: str, braking_mps2: float, folder: Path) -> tuple[float, float, bool]:
    """Who cuts in 3 m ahead brakes half-way: least gap, hardest braking behind, and whether that was at our word."""
    path = folder / "cars.xml"
    text = vehicle_type_file("conservative").read_text().replace('"IDM"', f'"{model}" maxSpeedLat="0.7"')
    text = text.replace('accel="1.0" decel="2.0"', 'accel="0.6" decel="1.5"').replace('tau="1.5"', 'tau="1.0"')
    path.write_text(text)
    cars = read_vehicle_types(path)
    length_m = cars.members[0].length_m
    spawns = (agent(cars, "e0_0", 103.0 + length_m, SPEED_MPS), agent(cars, "e0_1", 100.0, SPEED_MPS))
    vehicle, far, speed_mps, told = libsumo.vehicle, ego_at(900.0, LANE_Y[2]), SPEED_MPS, False
    gaps_m: list[float] = []
    speeds: list[float] = []
    with traffic(cars, spawns, far) as run:
        vehicle.setSpeedMode("a0", 0)
        vehicle.changeLane("a0", 1, 100.0)
        for _ in range(70):
            if vehicle.getLaneIndex("a0") or vehicle.getLateralLanePosition("a0") > 0.9:
                speed_mps = max(0.0, speed_mps - braking_mps2 * 0.1)
            vehicle.setSpeed("a0", speed_mps)
            run.react(far)
            told = told or "a1" in run._control._cut_ins._ahead
            run.place_ego(far)
            run.advance()
            gaps_m.append(vehicle.getPosition("a0")[0] - length_m - vehicle.getPosition("a1")[0])
            speeds.append(vehicle.getSpeed("a1"))
    return min(gaps_m), -min(np.diff(speeds)) / 0.1, told


@pytest.mark.parametrize(
    ("model", "braking_mps2", "surprised"), [("EIDM", 9.0, True), ("EIDM", 4.0, False), ("IDM", 9.0, False)]
)
def test_nobody_drives_into_who_brakes_while_it_cuts_in(
    model: str, braking_mps2: float, surprised: bool, tmp_path: Path
) -> None:
    gap_m, braked_mps2, told = drive(model, braking_mps2, tmp_path)
    assert gap_m > 0.0
    assert braked_mps2 < 9.05
    assert told is surprised
