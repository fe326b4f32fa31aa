"""Crosswalks, car parks and stop lines of an OpenDRIVE road, which the file describes as objects, as outlines."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely

from interplan_sumo.maps.importers.opendrive.elements import Corner, XodrObject, XodrRoad
from interplan_sumo.world.geometry import Floats

_MOST_COPIES = 1000
_STOP_MARKS = frozenset(("signallines", "stopline"))


def is_crosswalk(thing: XodrObject) -> bool:
    return thing.kind == "crosswalk" or "crosswalk" in thing.name


def is_stop_mark(thing: XodrObject) -> bool:
    """Whether a mark on the road is a stop line."""
    return thing.kind == "stopline" or thing.subtype in _STOP_MARKS or "stopline" in thing.name.replace(" ", "")


def is_parking(thing: XodrObject) -> bool:
    return thing.kind == "parkingspace"


def outlines_of(road: XodrRoad, thing: XodrObject) -> Iterator[Floats]:
    """(N, 2) each: the outlines of an object and of its copies, in the file's coordinates."""
    for station_m, left_m in _places(thing):
        drawn = [outline for outline in thing.outlines if len(outline) >= 3]
        for outline in drawn:
            yield _placed(road, thing, outline, station_m, left_m)
        if not drawn and thing.length_m > 0.0 and thing.width_m > 0.0:
            half_m, side_m = thing.length_m / 2.0, thing.width_m / 2.0
            corners = ((-half_m, -side_m), (half_m, -side_m), (half_m, side_m), (-half_m, side_m))
            yield _placed(road, thing, tuple(("local", u, v) for u, v in corners), station_m, left_m)


def long_axis(outline: Floats) -> Floats | None:
    """(2, 2) the ends of the line along the middle of an outline; None if it is no area."""
    box = shapely.MultiPoint(outline).minimum_rotated_rectangle
    if not isinstance(box, shapely.Polygon):
        return None
    corners = shapely.get_coordinates(box)[:4]
    first_m, second_m = np.hypot(*np.diff(corners[:3], axis=0).T)
    a, b, c, d = corners if first_m < second_m else np.roll(corners, 1, axis=0)
    return np.array([(a + b) / 2.0, (c + d) / 2.0])


def _places(thing: XodrObject) -> Iterator[tuple[float, float]]:
    """Station and lateral place of an object, or of each of its copies."""
    if not thing.repeats:
        yield thing.station_m, thing.left_m
    for repeat in thing.repeats:
        step_m = repeat.distance_m
        count = min(1 + int(repeat.length_m / step_m), _MOST_COPIES) if step_m > 0.0 else 1
        for k in range(count):
            share = k * step_m / repeat.length_m if repeat.length_m > 0.0 else 0.0
            yield repeat.station_m + k * step_m, repeat.left_m[0] + share * (repeat.left_m[1] - repeat.left_m[0])


def _placed(road: XodrRoad, thing: XodrObject, outline: tuple[Corner, ...], station_m: float, left_m: float) -> Floats:
    shift_m = station_m - thing.station_m, left_m - thing.left_m
    at, heading = road.reference.at(np.array([station_m]))
    turn = float(heading[0]) + thing.heading_rad
    origin = at[0] + left_m * np.array([-np.sin(heading[0]), np.cos(heading[0])])
    points: list[Floats] = []
    for kind, first, second in outline:
        if kind == "road":
            points.append(road.reference.beside(np.array([first + shift_m[0]]), np.array([second + shift_m[1]]))[0])
        else:
            cos, sin = np.cos(turn), np.sin(turn)
            points.append(origin + np.array([cos * first - sin * second, sin * first + cos * second]))
    return np.array(points)
