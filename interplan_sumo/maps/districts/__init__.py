"""The four shipped districts, drawn from compact road plans."""

from __future__ import annotations

from functools import cache

from interplan_sumo.errors import UnknownNameError
from interplan_sumo.maps.districts import back_bay, hazelwood, one_north, strip
from interplan_sumo.maps.districts.draw import draw_plan
from interplan_sumo.maps.districts.kerb import BusStopPlace, bus_stop_places
from interplan_sumo.maps.districts.layout import layout
from interplan_sumo.maps.districts.plan import Plan
from interplan_sumo.maps.districts.sheet import Sheet
from interplan_sumo.world.roads import Roads

DISTRICTS: dict[str, Plan] = {module.PLAN.name: module.PLAN for module in (strip, one_north, back_bay, hazelwood)}


@cache
def draw(name: str) -> Roads:
    """A district as `Roads`; UnknownNameError if there is none of that name."""
    return draw_plan(_plan(name))


@cache
def bus_stops(name: str) -> tuple[BusStopPlace, ...]:
    """Where buses stop in a district, which nuPlan's schema has no layer for."""
    plan = _plan(name)
    return bus_stop_places(Sheet(plan), layout(plan))


def _plan(name: str) -> Plan:
    if name not in DISTRICTS:
        raise UnknownNameError("district", name, DISTRICTS)
    return DISTRICTS[name]
