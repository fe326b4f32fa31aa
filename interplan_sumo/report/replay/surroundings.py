"""Surroundings: the map around a drive, as much of it as a viewer sees."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np
import shapely

from interplan_sumo.report.replay.numbers import Whole, lines, points, rings
from interplan_sumo.report.road_markings import markings, stop_bars
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import Area, Intersection, Roads

REACH_M: Final = 80.0
"""From the drives and the route: a screen in either direction at the usual zoom."""
DETAIL_M: Final = 0.05
"""Vertices that move an outline by less are left out."""
ARROW_EVERY_M: Final = 30.0


def area_around(tracks: Iterable[Floats]) -> shapely.Geometry:
    """The area within about `REACH_M` of points (N, 2) of the map that lie close together."""
    # an ego that stands trembles, and a trembling line takes seconds to widen
    shapes = [shapely.simplify(shapely.LineString(np.repeat(track, 2, axis=0)), 1.0) for track in tracks]
    return shapely.simplify(shapely.buffer(shapely.union_all(shapes), REACH_M), 1.0)


def map_around(roads: Roads, area: shapely.Geometry, origin: Floats) -> dict[str, Any]:
    """What to draw inside an area of the map, in the encoding of `numbers`.

    `areas` by kind and `crosswalks` are polygons as rings, `stop_lines` too, by
    kind; `edge` of the drivable area, `solid`, `dashed` and `middle` markings
    and `connectors` are lines; `arrows` are x, y and heading of each.
    """
    shapely.prepare(area)
    kinds: dict[str, Sequence[Area | Intersection]] = {
        "walkway": roads.walkways,
        "carpark": roads.carparks,
        "extra": roads.generic_drivable_areas,
        "road": roads.road_segments,
        "junction": roads.intersections,
    }
    surfaces = {kind: _clipped([each.polygon for each in areas], area) for kind, areas in kinds.items()}
    edge = shapely.intersection(shapely.boundary(drivable_around(roads, area)), area)
    stops: dict[str, list[shapely.Geometry]] = {}
    for line in roads.stop_lines.values():
        if shapely.intersects(area, line.polygon):
            stops.setdefault(line.kind.name.lower(), []).append(line.polygon)
    ways = [each.centerline.linestring for each in roads.connectors.values()]
    return {
        "areas": {kind: rings(parts, origin) for kind, parts in surfaces.items()},
        "edge": lines([shapely.simplify(edge, DETAIL_M)], origin),
        "crosswalks": rings(_clipped([each.polygon for each in roads.crosswalks], area), origin),
        "stop_lines": {kind: rings(shapes, origin) for kind, shapes in stops.items()},
        "connectors": lines(_clipped(ways, area), origin),
        "arrows": _arrows(roads, area, origin),
        **{
            kind: lines(_clipped([line.linestring for line in found], area), origin)
            for kind, found in markings(roads, area).items()
        },
    }


def drivable_around(roads: Roads, area: shapely.Geometry) -> shapely.Geometry:
    """The surfaces of the drivable area that reach into an area, in one; empty where there are none."""
    surfaces = (*roads.road_segments, *roads.intersections, *roads.generic_drivable_areas, *roads.carparks)
    every = np.array([surface.polygon for surface in surfaces], dtype=object)
    return shapely.union_all(every[shapely.intersects(area, every)]) if len(every) else shapely.MultiPolygon()


def lights(roads: Roads, area: shapely.Geometry, origin: Floats) -> dict[str, dict[str, Whole]]:
    """Every connector of the area with a traffic light: its `bar`, as `stop_bars` has it, and its `way`."""
    found: dict[str, dict[str, Whole]] = {}
    for connector, bar in stop_bars(roads, area).items():
        way = shapely.simplify(roads.connectors[connector].centerline.linestring, DETAIL_M)
        found[connector] = {"bar": points(bar, origin), "way": points(shapely.get_coordinates(way), origin)}
    return found


def _arrows(roads: Roads, area: shapely.Geometry, origin: Floats) -> list[tuple[int, int, float]]:
    """x, y in centimetres and heading in radians of arrows along the lanes."""
    found: list[tuple[int, int, float]] = []
    for lane in roads.lanes.values():
        line = lane.centerline
        if not shapely.intersects(area, lane.polygon):
            continue
        count = max(1, int(line.length_m // ARROW_EVERY_M))
        poses = line.poses_at((np.arange(count) + 0.5) * line.length_m / count)
        for x_m, y_m, heading_rad in poses[shapely.contains_xy(area, poses[:, :2])].tolist():
            (x, y) = points(np.array([(x_m, y_m)]), origin)
            found.append((x, y, round(heading_rad, 3)))
    return found


def _clipped(shapes: Sequence[shapely.Geometry], area: shapely.Geometry) -> list[shapely.Geometry]:
    """The parts of shapes inside an area, without the vertices that nobody sees."""
    if not shapes:
        return []
    every = np.asarray(shapes, dtype=object)
    inside = every[shapely.intersects(area, every)]
    return list(shapely.simplify(shapely.intersection(inside, area), DETAIL_M))
