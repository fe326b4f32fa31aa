"""Flow against density in the shipped districts, without an ego: where each carries most (endurance/saturation.json).

    python benchmarks/city_saturation.py [--maps strip] [--write]

The number of vehicles on the roads is held, plain SUMO drives them (two minutes to settle, four to measure), and flow
is density times mean speed. Up to where nobody moves it hardly falls, it flattens: saturation is where four fifths of
the most that passes at any density pass.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np

from interplan_sumo.endurance.city import WARM_UP_S, City, step
from interplan_sumo.endurance.demand import lane_kilometres
from interplan_sumo.endurance.saturation import FILE, FlowDensityCurve
from interplan_sumo.maps.store import maps
from interplan_sumo.simulation.sumo import DT_S
from interplan_sumo.simulation.vehicle_types import vehicle_type_file

DENSITIES = (5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0)
MEASURED_S = 240.0
MOST = 0.8


def flow_per_hour(map_name: str, density_per_km: float, behaviour: str, seed: int) -> float:
    """Vehicles that pass a place of one lane in an hour."""
    city = City(map_name, density_per_km, vehicle_type_file(behaviour))
    lane_km = lane_kilometres(city.network, city.demand)
    found: list[float] = []
    with city.empty(np.random.default_rng(seed)) as traffic:
        for number in range(round((WARM_UP_S + MEASURED_S) / DT_S)):
            step(traffic)
            if number * DT_S >= WARM_UP_S and number % 10 == 0:
                found.append(float(traffic.agents.kinematics.speed_mps.sum()) * 3.6 / lane_km)
    return float(np.mean(found))


def curve(map_name: str, behaviour: str) -> FlowDensityCurve:
    """The curve of one district."""
    flows: list[float] = []
    for density in DENSITIES:
        flows.append(round(flow_per_hour(map_name, density, behaviour, 0), 1))
        print(f"{map_name:12s} {density:5.1f} vehicles/km {flows[-1]:6.1f} vehicles/h", flush=True)
    return FlowDensityCurve(saturation(DENSITIES, flows), DENSITIES, tuple(flows))


def saturation(densities: Sequence[float], flows: Sequence[float]) -> float:
    """Where the curve first comes to `MOST` of its highest."""
    wanted = MOST * max(flows)
    first = next(row for row, flow in enumerate(flows) if flow >= wanted)
    if first == 0:
        return densities[0]
    share = (wanted - flows[first - 1]) / (flows[first] - flows[first - 1])
    return round(densities[first - 1] + share * (densities[first] - densities[first - 1]), 1)


def main() -> None:
    """Measure, print, and with --write keep."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--maps", nargs="*", default=list(maps()))
    parser.add_argument("--behaviour", default="mixed")
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    path = Path(__file__).parents[1] / "interplan_sumo" / "endurance" / FILE
    held = msgspec.json.decode(path.read_bytes(), type=dict[str, FlowDensityCurve]) if path.is_file() else {}
    for name in given.maps:
        held[name] = curve(name, given.behaviour)
        print(f"{name:12s} saturation {held[name].saturation_per_km} vehicles/km")
        if given.write:
            ordered = {each: held[each] for each in sorted(held)}
            path.write_bytes(msgspec.json.format(msgspec.json.encode(ordered), indent=2) + b"\n")


if __name__ == "__main__":
    main()
