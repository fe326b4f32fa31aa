"""Saturation: at which density each shipped district carries most, as measured by benchmarks/city_saturation.py."""

from __future__ import annotations

from importlib.resources import files
from statistics import median
from typing import Annotated, Final

import msgspec
from msgspec import Meta, Struct

FILE: Final = "saturation.json"


class FlowDensityCurve(Struct, frozen=True):
    """Flow against density in one district, in ordinary traffic without an ego."""

    saturation_per_km: Annotated[float, Meta(gt=0.0, le=200.0)]
    """Vehicles on a kilometre of one lane at which most of them pass."""
    density_per_km: tuple[float, ...]
    flow_per_hour: tuple[float, ...]
    """Vehicles that pass a place of one lane in an hour, on average over the district."""


def flow_density_curves() -> dict[str, FlowDensityCurve]:
    """By map."""
    text = (files("interplan_sumo.endurance") / FILE).read_bytes()
    return msgspec.json.decode(text, type=dict[str, FlowDensityCurve])


def saturation_per_km(map_name: str) -> float:
    """Of a map; of one that has not been measured, the middle one of those that have."""
    curves = flow_density_curves()
    if map_name in curves:
        return curves[map_name].saturation_per_km
    return round(median(curve.saturation_per_km for curve in curves.values()), 2)
