"""Driveways by rule: along a road, one wherever there is room for it and its car park."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import shapely
from msgspec.structs import replace

from tools.make_maps.junction_arms import STUB_M, PlannedArm, planned_arms
from tools.make_maps.plan import (
    Carriageway,
    Driveways,
    Plan,
    PlannedJunction,
    Road,
    RoadSection,
    carriageway_at,
    kerb_side,
)
from tools.make_maps.rules import completed

BESIDE_JUNCTION_M = 18.0
"""From where a junction and its pockets end to the middle of a driveway: half its mouth, and a lane between both."""
BESIDE_DRIVEWAY_M = 26.0
"""Between the middles of two mouths on one carriageway."""
BESIDE_END_M = STUB_M + 2.0
"""From the end of a road; what is nearer counts as its end."""
BESIDE_BUS_STOP_M = 30.0
BESIDE_CROSSING_M = 22.0
CLEAR_M = 3.0
"""Of other roads, driveways and car parks."""
SHALLOWEST_PARK_M = 12.0
BACKWARD = 5000
"""Added to the station in the number of a driveway on the backward side."""


def with_driveways(plan: Plan) -> Plan:
    """The plan with the driveways of all its roads; they are left out where there is no room."""
    if not any(road.driveways for road in plan.roads):
        return plan
    if plan.driveway is None:
        raise ValueError("a plan with driveways says in `driveway` what each way of them is like")
    arms = {junction.number: planned_arms(plan, junction) for junction in plan.junctions}
    land = [(road.name, _corridor(road)) for road in plan.roads]
    mouths: dict[str, list[tuple[float, str | None]]] = {road.name: [] for road in plan.roads}
    roads: list[Road] = []
    junctions: list[PlannedJunction] = []
    for road in plan.roads:
        for rule in road.driveways:
            for station_m in _stations(plan, road, rule, arms):
                divided = _divided(road, station_m)
                crossed = rule.side if divided else None
                beside = [m for m, of in mouths[road.name] if of is None or crossed is None or of == crossed]
                if any(abs(m - station_m) < BESIDE_DRIVEWAY_M for m in beside):
                    continue
                way = _driveway(plan, road, rule, station_m, plan.driveway, land)
                if way is not None:
                    mouths[road.name].append((station_m, crossed))
                    roads.append(way)
                    land.append((way.name, _corridor(way)))
                    at = road.axis.pose(station_m)
                    junctions.append(
                        PlannedJunction(
                            number=way.number,
                            at=(at.x_m, at.y_m),
                            roads=(road.name, way.name),
                            carriageway=crossed,
                            approaches={},
                        )
                    )
    grown = replace(plan, roads=(*plan.roads, *roads))
    return replace(grown, junctions=(*plan.junctions, *(completed(grown, junction) for junction in junctions)))


def _divided(road: Road, station_m: float) -> bool:
    both = (carriageway_at(road, "forward", station_m), carriageway_at(road, "backward", station_m))
    return all(one is not None for one in both) and min(one.median_m for one in both if one) > 0.0


def _stations(plan: Plan, road: Road, rule: Driveways, arms: Mapping[int, Mapping[str, PlannedArm]]) -> Iterator[float]:
    """Where the rule puts driveways and the road has room for their mouths."""
    taken: list[tuple[float, float]] = []
    for junction in plan.junctions:
        if road.name in junction.roads and junction.takes(road.name, rule.side):
            for arm in arms[junction.number].values():
                if arm.road.name == road.name:
                    widened_m = arm.approach.widened_m[1] if arm.approach.pockets or arm.pushed_m else 0.0
                    end_m = arm.cut_m + arm.sign * (widened_m + BESIDE_JUNCTION_M)
                    taken.append((min(arm.station_m, end_m), max(arm.station_m, end_m)))
    for stop in road.stops:
        if stop.direction == rule.side:
            taken.append((stop.at_m - BESIDE_BUS_STOP_M, stop.at_m + BESIDE_BUS_STOP_M))
    taken += [(c.at_m - BESIDE_CROSSING_M, c.at_m + BESIDE_CROSSING_M) for c in road.crossings]
    for section in road.sections[1:]:
        reach_m = section.taper_m / 2.0 + BESIDE_JUNCTION_M
        taken.append((section.from_m - reach_m, section.from_m + reach_m))
    first_m, last_m = max(rule.from_m, BESIDE_END_M), min(rule.to_m, road.axis.length_m - BESIDE_END_M)
    for station_m in np.arange(first_m, last_m, rule.every_m).tolist():
        if not any(low_m < station_m < high_m for low_m, high_m in taken):
            yield float(station_m)


def _driveway(
    plan: Plan,
    road: Road,
    rule: Driveways,
    station_m: float,
    way: Carriageway,
    land: list[tuple[str, shapely.Geometry]],
) -> Road | None:
    """The driveway at a station; None where other roads, driveways or car parks lie in its way."""
    carriageway = carriageway_at(road, rule.side, station_m)
    if carriageway is None:
        raise ValueError(f"{road.name}: driveways on the {rule.side} side, where nobody drives")
    side = kerb_side(plan, rule.side)
    kerb_m = abs(carriageway.inner_m + sum(carriageway.widths_m)) + carriageway.parking_m
    start = road.axis.pose(station_m)
    lean = np.radians(rule.skew_deg)
    heading = start.heading_rad + side * (np.pi / 2.0 - lean)
    ahead = np.array([np.cos(heading), np.sin(heading)])
    from_axis_m = kerb_m / np.cos(lean)
    start_xy = np.array([start.x_m, start.y_m])
    end = start_xy + (from_axis_m + rule.length_m) * ahead
    number = road.number * 10000 + round(station_m) + (0 if rule.side == "forward" else BACKWARD)
    driveway = Road(
        number=number,
        name=f"{road.name}_{'' if rule.side == 'forward' else 'far_'}{station_m:.0f}",
        points=((start.x_m, start.y_m), (float(end[0]), float(end[1]))),
        sections=(RoadSection(forward=way, backward=way),),
        rank="driveway",
        sidewalk_m=0.0,
    )
    beyond = [ground for name, ground in land if name != road.name]
    mouth = shapely.LineString([start_xy + (from_axis_m + CLEAR_M) * ahead, end]).buffer(way.width_m + CLEAR_M)
    if any(shapely.intersects(mouth, ground) for ground in beyond):
        return None
    if rule.park_m is None:
        return driveway
    width_m, depth_m = rule.park_m
    while depth_m >= SHALLOWEST_PARK_M:
        park = shapely.LineString([end, end + depth_m * ahead]).buffer(width_m / 2.0 + CLEAR_M, cap_style="flat")
        if not any(shapely.intersects(park, ground) for _, ground in land):
            return replace(driveway, end_park_m=(width_m, depth_m))
        depth_m -= 4.0
    return None


def _corridor(road: Road) -> shapely.Geometry:
    """The ground of a road with its parking, sidewalks and car park, roughly."""
    axis = road.axis.poses(road.axis.grid_m)
    sections = [one for s in road.sections for one in (s.forward, s.backward) if one is not None]
    half_m = max(max(abs(s.inner_m), s.inner_m + sum(s.widths_m)) + s.parking_m for s in sections) + road.sidewalk_m
    ground = shapely.LineString(axis[:, :2]).buffer(half_m, cap_style="flat")
    if road.end_park_m is None:
        return ground
    width_m, depth_m = road.end_park_m
    end = road.axis.poses(np.array([road.axis.length_m, road.axis.length_m + depth_m]))[:, :2]
    return shapely.union(ground, shapely.LineString(end).buffer(width_m / 2.0, cap_style="flat"))
