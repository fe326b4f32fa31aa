"""What lies along the kerb: parking, bus stops and bays, sidewalks."""

from __future__ import annotations

import numpy as np
import shapely

from tools.make_maps.layout import Block, Layout
from tools.make_maps.plan import BusStop, Road
from tools.make_maps.road_geometry import RoadGeometry

KERB_CLEAR_M = 8.0
"""No parking this close to a stop line or crossing."""
SHORTEST_PARKING_M = 12.0
"""Two cars."""
BAY_DEPTH_M = 3.0
BAY_LENGTH_M = 16.0
"""One bus of 12 m with room to pull out."""
BAY_TAPER_M = 12.0
STOP_MOVED_M = 60.0
"""How far a bus stop may move along the road to a place where it fits."""
STOP_LENGTH_M = 16.0
"""Kerb kept free at a stop without a bay, beyond which the bus swings in and out."""
SMALLEST_SIDEWALK_M2 = 6.0
ROOM_BEHIND_KERB_M = 9.0
"""How far beyond its lanes a road looks for its own bays, pockets, corners and sidewalks."""
PARK_OVERLAP_M = 0.01
"""By how much car parks reach over the ends of their driveways."""


def stop_place(layout: Layout, road: Road, stop: BusStop) -> tuple[Block, float]:
    """The roadblock beside which a bus stops, and where: as near to the wish as junctions and tapers allow.

    ValueError where that is nowhere within `STOP_MOVED_M`.
    """
    half_m = STOP_LENGTH_M / 2.0 + (BAY_TAPER_M if stop.bay else 0.0)
    places = [
        (block, min(max(stop.at_m, block.low_m + half_m), block.high_m - half_m))
        for block in layout.blocks
        if (block.road, block.direction) == (road.name, stop.direction) and block.high_m - block.low_m >= 2.0 * half_m
    ]
    block, at_m = min(places, key=lambda place: abs(place[1] - stop.at_m), default=(None, 0.0))
    if block is None or abs(at_m - stop.at_m) > STOP_MOVED_M:
        raise ValueError(f"{road.name}: no roadblock near {stop.at_m} m has room for the bus stop")
    return block, at_m


def bus_bays(ground: RoadGeometry, layout: Layout) -> list[tuple[Road, shapely.Polygon]]:
    """The bays of all bus stops that have one."""
    bays: list[tuple[Road, shapely.Polygon]] = []
    for road in ground.plan.roads:
        for stop in road.stops:
            block, at_m = stop_place(layout, road, stop)
            if stop.bay:
                kerb_m = block.strips[-1].kerb_m
                half_m = BAY_LENGTH_M / 2.0
                knots = at_m + np.array([-half_m - BAY_TAPER_M, -half_m, half_m, half_m + BAY_TAPER_M])
                grid = road.axis.grid_m
                stations = np.unique(np.concatenate((knots, grid[(grid > knots[0]) & (grid < knots[-1])])))
                depth = np.interp(stations, knots, (0.0, BAY_DEPTH_M, BAY_DEPTH_M, 0.0))
                side = ground.side(stop.direction)
                poses = road.axis.poses(stations)
                normal = np.stack((-np.sin(poses[:, 2]), np.cos(poses[:, 2])), axis=1) * side
                edge = poses[:, :2] + kerb_m * normal
                bays.append((road, _whole(ground.surface(edge, edge + depth[:, None] * normal).buffer(0))))
    return bays


def parking_strips(ground: RoadGeometry, layout: Layout) -> list[tuple[Road, shapely.Polygon]]:
    """Kerb parking beside all blocks that have it, away from stop lines, crossings, pockets and bus stops."""
    strips: list[tuple[Road, shapely.Polygon]] = []
    for block in layout.blocks:
        if block.widened:
            continue
        road = ground.plan.road[block.road]
        whole = [(block.low_m + KERB_CLEAR_M, block.high_m - KERB_CLEAR_M)]
        beside_stops = whole
        for stop in road.stops:
            if stop.direction == block.direction:
                half_m = STOP_LENGTH_M / 2.0 + BAY_TAPER_M
                _, at_m = stop_place(layout, road, stop)
                beside_stops = _without(beside_stops, at_m - half_m, at_m + half_m)
        side = ground.side(block.direction)
        kerb_m, inner_m = side * block.strips[-1].kerb_m, side * block.strips[0].inner_m
        for free, edge_m, width_m in (
            (beside_stops, kerb_m, side * block.carriageway.parking_m),
            (whole, inner_m, -side * block.carriageway.far_parking_m),
        ):
            for low_m, high_m in free if width_m else ():
                if high_m - low_m >= SHORTEST_PARKING_M:
                    strips.append((road, ground.across(road, low_m, high_m, *sorted((edge_m, edge_m + width_m)))))
    return strips


def _without(free: list[tuple[float, float]], low_m: float, high_m: float) -> list[tuple[float, float]]:
    return [part for a, b in free for part in ((a, min(b, low_m)), (max(a, high_m), b)) if part[1] - part[0] > 0.0]


def car_parks(ground: RoadGeometry) -> list[tuple[Road, shapely.Polygon]]:
    """Car parks at the ends of driveways."""
    parks: list[tuple[Road, shapely.Polygon]] = []
    for road in ground.plan.roads:
        if road.end_park_m is not None:
            width_m, depth_m = road.end_park_m
            end_m = road.axis.length_m
            area = ground.across(road, end_m - PARK_OVERLAP_M, end_m + depth_m, -width_m / 2.0, width_m / 2.0)
            parks.append((road, area))
    return parks


def sidewalks(ground: RoadGeometry, layout: Layout, paved: shapely.Geometry) -> list[tuple[Road, shapely.Polygon]]:
    """Walkways along all roads that have them: behind bays and parking, round the corners of junctions."""
    plan = ground.plan
    found: list[tuple[Road, shapely.Polygon]] = []
    medians = [area for road in plan.roads for area in _medians(ground, layout, road)]
    taken: shapely.Geometry = shapely.union_all([paved, *medians])
    for road in plan.roads:
        if not road.sidewalk_m:
            continue
        half_m = (
            max(
                max(abs(block.strips[0].inner_m), block.strips[-1].kerb_m)
                for block in layout.blocks
                if block.road == road.name
            )
            + ROOM_BEHIND_KERB_M
        )
        corridor = ground.across(road, 0.0, road.axis.length_m, -half_m, half_m)
        own = shapely.intersection(paved, corridor)
        land = own.buffer(road.sidewalk_m, join_style="round", quad_segs=6).difference(taken).intersection(corridor)
        # Opened a little, so that no threads remain between a kerb and what lies behind it.
        land = land.buffer(-0.4, join_style="mitre").buffer(0.4, join_style="mitre").simplify(0.02).difference(taken)
        parts = [p for p in shapely.get_parts(land) if p.area >= SMALLEST_SIDEWALK_M2]
        found += [(road, p) for p in sorted(parts, key=lambda p: tuple(np.round(p.bounds, 1)))]
        taken = shapely.union(taken, land)
    return found


def _medians(ground: RoadGeometry, layout: Layout, road: Road) -> list[shapely.Polygon]:
    """What lies between the carriageways of a road, over its whole length."""
    inner: dict[str, float] = {}
    for block in layout.blocks:
        if block.road == road.name:
            offset_m = ground.side(block.direction) * max(block.carriageway.inner_m, 0.0)
            inner[block.direction] = max(inner.get(block.direction, offset_m), offset_m, key=abs)
    if len(inner) < 2:
        return []
    right_m, left_m = sorted(inner.values())
    if left_m - right_m < 0.1:
        return []
    return [ground.across(road, 0.0, road.axis.length_m, right_m, left_m)]


def _whole(area: shapely.Geometry) -> shapely.Polygon:
    assert isinstance(area, shapely.Polygon), "surfaces beside the kerb are drawn in one piece"
    return area
