"""Tiny worlds for the tests; they live in the package, so that the conformance suite uses the same ones."""

from __future__ import annotations

from interplan_sumo.tiny_worlds import (
    CRS,
    DT_S,
    LANE_WIDTH_M,
    cars,
    curved_road,
    drive,
    drive_along,
    drive_through,
    ego,
    ego_on,
    junction,
    mission,
    observation,
    pedestrians,
    road_along,
    signals,
    straight_plan,
    straight_road,
    together,
)

__all__ = [
    "CRS",
    "DT_S",
    "LANE_WIDTH_M",
    "cars",
    "curved_road",
    "drive",
    "drive_along",
    "drive_through",
    "ego",
    "ego_on",
    "junction",
    "mission",
    "observation",
    "pedestrians",
    "road_along",
    "signals",
    "straight_plan",
    "straight_road",
    "together",
]
