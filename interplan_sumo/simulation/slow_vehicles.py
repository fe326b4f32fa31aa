"""Slow vehicles: cyclists and tractors that a scenario places, the same whatever the vehicle-type file says.

They are SUMO's vehicles as all others are, only that they never drive faster
than they start, and may keep beside the middle of their lane.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from interplan_sumo.scenario.kinds import SLOW_SIZES_M
from interplan_sumo.scenario.scenario import PlacedVehicle
from interplan_sumo.simulation.vehicle_type_reader import VehicleTypeElement
from interplan_sumo.simulation.vehicle_types import VehicleType

_STAYS: Final = {"lcStrategic": "-1", "lcSpeedGain": "0", "lcKeepRight": "0", "lcCooperative": "0"}
"""SUMO's words for one that keeps its lane."""
ELEMENTS: Final[Mapping[str, VehicleTypeElement]] = {
    "bicycle": VehicleTypeElement(
        "slow_bicycle",
        0,
        {
            "id": "slow_bicycle", "vClass": "bicycle", "height": "1.7",
            "minGap": "0.5", "accel": "1.0", "decel": "2.0", "emergencyDecel": "7.0", "tau": "1.0", "speedDev": "0",
            "sigma": "0", **_STAYS,
        },
        {"interplan.reactOverlap": "1"},
    ),
    "tractor": VehicleTypeElement(
        "slow_tractor",
        0,
        {
            "id": "slow_tractor", "vClass": "truck", "height": "2.9",
            "minGap": "1.0", "accel": "0.8", "decel": "2.0", "emergencyDecel": "6.0", "tau": "1.0", "speedDev": "0",
            "sigma": "0", **_STAYS,
        },
        {"interplan.reactOverlap": "1"},
    ),
}  # fmt: skip
"""By kind. They follow as Krauss has it: who is passed by a faster one brakes only where it would hit it."""


def slow_vehicle(vehicle: PlacedVehicle) -> VehicleType:
    """The type of a placed vehicle of `SLOW_KINDS`."""
    element = ELEMENTS[vehicle.kind]
    most_mps = max(round(vehicle.speed_mps, 4), 0.1)
    length_m, width_m = SLOW_SIZES_M[vehicle.kind]
    return VehicleType(
        f"{element.id}~{most_mps}~{vehicle.place.left_m}".replace("-", "m"),
        length_m,
        width_m,
        float(element.attributes["height"]),
        max_speed_mps=most_mps,
        vehicle_class=element.attributes["vClass"],
        react_overlap=1.0,
        drawn_from=element.id,
        drawn=(("length", length_m), ("maxSpeed", most_mps), ("width", width_m)),
        left_m=vehicle.place.left_m,
    )
