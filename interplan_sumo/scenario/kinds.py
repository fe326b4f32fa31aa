"""Kinds of what a scenario can place: obstacles, those who walk into the road, vehicles; with their usual sizes."""

from __future__ import annotations

from typing import Literal

from interplan_sumo.world.actors import ActorKind

ObstacleKind = Literal["car", "van", "bus", "truck", "cone", "barrier", "sign", "worker", "person", "door"]
OBSTACLES: dict[str, tuple[ActorKind, float, float]] = {
    "car": (ActorKind.VEHICLE, 4.6, 1.85),
    "van": (ActorKind.VEHICLE, 5.9, 2.05),
    "bus": (ActorKind.VEHICLE, 12.0, 2.55),
    "truck": (ActorKind.VEHICLE, 8.0, 2.4),
    "cone": (ActorKind.TRAFFIC_CONE, 0.5, 0.5),
    "barrier": (ActorKind.BARRIER, 2.0, 0.6),
    "sign": (ActorKind.CZONE_SIGN, 0.6, 0.6),
    "worker": (ActorKind.PEDESTRIAN, 0.9, 0.79),
    "person": (ActorKind.PEDESTRIAN, 0.9, 0.79),
    "door": (ActorKind.GENERIC_OBJECT, 1.0, 0.15),
}
"""nuPlan's class and the default length and width of each kind; cones and people as in interPlan. A worker is one
at the works, a person anybody else who stands, a door one of a parked car that is open."""
OBSTACLE_HEIGHTS_M: dict[str, float] = {
    "car": 1.5, "van": 2.6, "bus": 3.0, "truck": 2.4, "cone": 0.75, "barrier": 1.0, "sign": 1.0, "worker": 1.75,
    "person": 1.75, "door": 1.2,
}  # fmt: skip
"""The default height of each kind: what is tall hides others where perception is `occluded`."""
WalkerKind = Literal["pedestrian", "cyclist"]
WALKERS: dict[str, tuple[ActorKind, float, float]] = {
    "pedestrian": (ActorKind.PEDESTRIAN, 0.9, 0.79),
    "cyclist": (ActorKind.BICYCLE, 1.8, 0.65),
}
"""nuPlan's class, length (along the way) and width of each kind; the pedestrian is interPlan's."""

VehicleKind = Literal["car", "truck", "bus", "motorcycle", "bicycle", "tractor"]
VEHICLE_KINDS: tuple[VehicleKind, ...] = ("car", "truck", "bus", "motorcycle", "bicycle", "tractor")
SLOW_KINDS: tuple[VehicleKind, ...] = ("bicycle", "tractor")
"""Kinds that drive no faster than they start, whatever the vehicle-type file says."""
SLOW_SIZES_M: dict[str, tuple[float, float]] = {"bicycle": (1.8, 0.65), "tractor": (5.5, 2.4)}
"""Their lengths and widths."""
