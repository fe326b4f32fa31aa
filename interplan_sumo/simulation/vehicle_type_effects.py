"""Which attributes of a vType cannot act in this set-up, and why: what a user of a vehicle-type file should be told.

Found by driving pairs of files that differ in one attribute (tools/vehicle_type_table.py), and in SUMO's documentation.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from interplan_sumo.simulation.vehicle_type_schema import vehicle_type_schema

DRAWING: Final = frozenset("color guiShape imgFile osgFile".split())
UNUSED: Final[Mapping[str, frozenset[str]]] = {
    "it is drawn by SUMO's own window only": DRAWING,
    "nothing here measures emissions or energy": frozenset("emissionClass mass".split()),
    "nobody here parks, boards or loads": frozenset(
        "parkingBadges maneuverAngleTimes personCapacity containerCapacity boardingDuration loadingDuration "
        "boardingFactor speedFactorPremature".split()
    ),
    "nothing here is ever teleported": frozenset("timeToTeleport timeToTeleportBidi".split()),
    "how many vehicles there are is set by the scenario's density": frozenset(["scale"]),
    "only trains have it, and none drive here": frozenset(
        "trainType tractionTable resistanceTable massFactor maxPower maxTraction resCoef_constant resCoef_linear "
        "resCoef_quadratic curveResistance curveIntegration roeckl_sharp_radius roeckl_numerator "
        "roeckl_numerator_sharp roeckl_offset roeckl_offset_sharp".split()
    ),
}
"""Attributes that nothing reads here, by the reason; SUMO is not even given them."""
WITHHELD: Final = frozenset().union(*UNUSED.values())
SUBLANE: Final = frozenset(
    "lcSublane lcPushy lcPushyGap lcImpatience lcTimeToImpatience lcAccelLat lcMaxDistLatStanding lcLaneDiscipline "
    "lcTurnAlignmentDistance minGapLat latAlignment".split()
)
WITHOUT_EFFECT: Final[Mapping[str, frozenset[str]]] = {
    "it acts only with lateral resolution, which is off: a vehicle is in one lane or changes it": SUBLANE,
    "SUMO reads it for the device driverstate only": frozenset(["hasDriverState", "applyDriverState"]),
    "agents are drawn by us, never in turn": frozenset(["deterministic"]),
}
"""Attributes that SUMO reads and that change nothing here, by the reason."""
GENERIC: Final = frozenset(
    "accel decel emergencyDecel apparentDecel tau collisionMinGapFactor startupDelay maxAccelProfile desAccelProfile "
    "speedTable".split()
)
"""Attributes that car-following models have in common, though the schema lists them with some models only."""
BEYOND_SCHEMA: Final[Mapping[str, frozenset[str]]] = {
    "KraussX": frozenset("sigma sigmaStep tmp1 tmp2 tmp3 tmp4 tmp5".split()),
    "ACC": frozenset("speedControlMinGap collisionAvoidanceOverride".split()),
    "CACC": frozenset("speedControlMinGap collisionAvoidanceOverride tauCACCToACC".split()),
}
"""Models of SUMO 1.28, and attributes that they read, which its schema does not tie together."""
CANNOT_RUN: Final[Mapping[str, str]] = {
    "CC": "is steered by Plexe from outside of SUMO; without it its cars drive as Krauss",
    "Rail": "moves trains",
    "SmartSK": "never speeds up in SUMO 1.28, not even from a standstill",
}
"""Car-following models that are refused, and why."""
LANE_CHANGE_CANNOT_RUN: Final[Mapping[str, str]] = {
    "DK2008": "cannot be told whether to change, as vehicles are here that make way for the ego",
}
"""Lane-change models that are refused, and why."""
_PARAMETERS: Final = re.compile(r"interplan\..*|has\..+\.device|device\..+")
"""Parameters of a vType that somebody reads: we, and SUMO's devices."""
CLASSES_ON_ROADS: Final = frozenset(
    "private emergency authority army vip hov passenger taxi bus coach delivery truck trailer motorcycle moped bicycle "
    "scooter evehicle custom1 custom2 ignoring".split()
)
OTHER_CLASSES: Final = frozenset(
    "pedestrian wheelchair tram rail_urban rail rail_electric rail_fast subway cable_car ship container aircraft "
    "drone".split()
)
"""SUMO's vehicle classes that do not drive on roads: refused."""


def car_following_models() -> Mapping[str, frozenset[str]]:
    """The attributes that each car-following model reads besides `GENERIC`; those that cannot run are not there."""
    of_schema, none = vehicle_type_schema().models, frozenset[str]()
    names = [name for name in dict.fromkeys((*of_schema, *BEYOND_SCHEMA)) if name not in CANNOT_RUN]
    return {name: (of_schema.get(name, none) | BEYOND_SCHEMA.get(name, none)) - GENERIC for name in names}


@dataclass(frozen=True, slots=True)
class Idle:
    """An attribute that does nothing."""

    attribute: str
    reason: str


def idle_attributes(attributes: Iterable[str], model: str, parameters: Iterable[str] = ()) -> Iterator[Idle]:
    """Those of a vType's attributes and parameters that cannot act here, given its car-following model."""
    reasons = {name: reason for group in (UNUSED, WITHOUT_EFFECT) for reason, names in group.items() for name in names}
    models, of_schema = car_following_models(), vehicle_type_schema().models
    of_models = frozenset().union(*models.values(), *of_schema.values()) - GENERIC
    for name in attributes:
        if name in reasons:
            yield Idle(name, reasons[name])
        elif name in of_models and name not in models[model]:
            readers = [each for each, own in models.items() if name in own]
            others = [each for each in CANNOT_RUN if name in of_schema.get(each, ())]
            only = ", ".join(readers) or f"{', '.join(others)}, which cannot run here"
            yield Idle(name, f"{model} does not read it, only {only}")
    for name in parameters:
        if not _PARAMETERS.fullmatch(name):
            yield Idle(name, "of the parameters of a vType SUMO reads those of devices only")
