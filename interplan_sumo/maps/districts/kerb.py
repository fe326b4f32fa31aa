"""What lies along the kerb: parking, bus stops and bays, sidewalks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from interplan_sumo.maps.districts.layout import Block, Layout
from interplan_sumo.maps.districts.plan import BusStop, Road
from interplan_sumo.maps.districts.sheet import Sheet

KERB_CLEAR_M = 8.0
"""No parking this close to a stop line or crossing."""
SHORTEST_PARKING_M = 12.0
"""Two cars."""
BAY_DEPTH_M = 3.0
BAY_LENGTH_M = 16.0
"""One bus of 12 m with room to pull out."""
BAY_TAPER_M = 12.0
STOP_LENGTH_M = 16.0
"""Kerb kept free at a stop without a bay, beyond which the bus swings in and out."""
SMALLEST_SIDEWALK_M2 = 6.0


@dataclass(frozen=True, slots=True)
class BusStopPlace:
    """Where a bus stop of the plan came to lie."""

    lane_id: str
    arc_m: float
    """Along the kerb lane, of the middle of the stop."""
    bay: bool


def stop_block(layout: Layout, road: Road, stop: BusStop) -> Block:
    """The roadblock beside which a bus stops; ValueError where it would stand in a junction or taper."""
    half_m = STOP_LENGTH_M / 2.0 + (BAY_TAPER_M if stop.bay else 0.0)
    for block in layout.blocks:
        if (
            block.road == road.name
            and block.direction == stop.direction
            and block.low_m <= stop.at_m - half_m
            and stop.at_m + half_m <= block.high_m
        ):
            return block
    near = [f"{b.low_m:.0f}-{b.high_m:.0f}" for b in layout.blocks if (b.road, b.direction) == (road.name, stop.direction)]
    raise ValueError(f"{road.name}: the bus stop at {stop.at_m} m does not fit into a roadblock ({', '.join(near)})")


def bus_bays(sheet: Sheet, layout: Layout) -> list[tuple[Road, shapely.Polygon]]:
    """The bays of all bus stops that have one."""
    bays: list[tuple[Road, shapely.Polygon]] = []
    for road in sheet.plan.roads:
        for stop in road.bus_stops:
            if stop.bay:
                block = stop_block(layout, road, stop)
                kerb_m = block.strips[-1].kerb_m
                half_m = BAY_LENGTH_M / 2.0
                knots = stop.at_m + np.array([-half_m - BAY_TAPER_M, -half_m, half_m, half_m + BAY_TAPER_M])
                grid = road.axis.grid_m
                stations = np.unique(np.concatenate((knots, grid[(grid > knots[0]) & (grid < knots[-1])])))
                depth = np.interp(stations, knots, (0.0, BAY_DEPTH_M, BAY_DEPTH_M, 0.0))
                side = sheet.side(stop.direction)
                poses = road.axis.poses(stations)
                normal = np.stack((-np.sin(poses[:, 2]), np.cos(poses[:, 2])), axis=1) * side
                edge = poses[:, :2] + kerb_m * normal
                bays.append((road, shapely.make_valid(sheet.surface(edge, edge + depth[:, None] * normal))))
    return bays


def parking_strips(sheet: Sheet, layout: Layout) -> list[tuple[Road, shapely.Polygon]]:
    """Kerb parking beside all blocks that have it, away from stop lines, crossings, pockets and bus stops."""
    strips: list[tuple[Road, shapely.Polygon]] = []
    for block in layout.blocks:
        width_m = block.way.parking_m
        if width_m == 0.0 or block.inner_pockets or block.kerb_pockets:
            continue
        road = sheet.plan.road[block.road]
        free = [(block.low_m + KERB_CLEAR_M, block.high_m - KERB_CLEAR_M)]
        for stop in road.bus_stops:
            if stop.direction == block.direction:
                half_m = STOP_LENGTH_M / 2.0 + BAY_TAPER_M
                free = _without(free, stop.at_m - half_m, stop.at_m + half_m)
        kerb_m = sheet.side(block.direction) * block.strips[-1].kerb_m
        outer_m = kerb_m + sheet.side(block.direction) * width_m
        for low_m, high_m in free:
            if high_m - low_m >= SHORTEST_PARKING_M:
                polygon = sheet.across(road, low_m, high_m, min(kerb_m, outer_m), max(kerb_m, outer_m))
                strips.append((road, polygon))
    return strips


def _without(free: list[tuple[float, float]], low_m: float, high_m: float) -> list[tuple[float, float]]:
    return [
        part
        for a, b in free
        for part in ((a, min(b, low_m)), (max(a, high_m), b))
        if part[1] - part[0] > 0.0
    ]


def sidewalks(
    sheet: Sheet, layout: Layout, junctions: dict[int, shapely.Polygon], drivable: shapely.Geometry
) -> list[shapely.Polygon]:
    """Walkways beside all roads that have them, round the corners of junctions, and behind bays and parking."""
    plan = sheet.plan
    bands: list[shapely.Geometry] = []
    medians: list[shapely.Geometry] = []
    for road in plan.roads:
        blocks = [b for b in layout.blocks if b.road == road.name]
        for direction in ("forward", "backward"):
            own = [b for b in blocks if b.direction == direction]
            if not own:
                continue
            side = sheet.side(direction)
            alone = len(own) == len(blocks)
            for block in own:
                outer_m = block.strips[-1].kerb_m
                room_m = max(block.way.parking_m, BAY_DEPTH_M if any(s.bay for s in road.bus_stops) else 0.0)
                reach = [(side * block.strips[0].inner_m, side * (outer_m + room_m + road.sidewalk_m))]
                if alone:
                    reach.append((side * outer_m, side * (block.strips[0].inner_m - road.sidewalk_m)))
                if road.sidewalk_m:
                    for a, b in reach:
                        bands.append(sheet.across(road, block.low_m - 3.1, block.high_m + 3.1, min(a, b), max(a, b)))
                if not alone:
                    medians.append(
                        sheet.across(road, block.low_m - 3.1, block.high_m + 3.1, *sorted((-side * 0.1, side * outer_m)))
                    )
    for junction in plan.junctions:
        width_m = min(plan.road[name].sidewalk_m for name in junction.roads)
        if width_m:
            bands.append(junctions[junction.number].buffer(width_m, quad_segs=4))
    land = shapely.difference(shapely.union_all(bands), shapely.union_all([drivable, *medians]))
    # Opened a little, so that no threads remain between a kerb and what lies behind it.
    land = land.buffer(-0.4, join_style="mitre").buffer(0.4, join_style="mitre")
    parts = [p for p in shapely.get_parts(land) if p.area >= SMALLEST_SIDEWALK_M2]
    return sorted((p.simplify(0.02) for p in parts), key=lambda p: tuple(np.round(p.bounds, 1)))
