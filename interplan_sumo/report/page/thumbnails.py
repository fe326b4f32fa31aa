"""Thumbnails: a scene as a small drawing inside the page: the road, the way to the goal, and what is in it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np
import shapely
from markupsafe import Markup

from interplan_sumo.report.replay.surroundings import drivable_around
from interplan_sumo.report.road_markings import markings
from interplan_sumo.scenario.jaywalking import walk
from interplan_sumo.scenario.route import route_centerline, way_ahead
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import Floats, box_corners
from interplan_sumo.world.roads import Roads

WIDE_M, HIGH_M = 66.0, 38.0
"""Of the piece of map; a unit of the drawing is a metre, the ego drives to the right."""
DETAIL_M: Final = 0.4


def thumbnail(scenario: Scenario, roads: Roads) -> Markup:
    """An SVG element without words: who looks for them has the scene's name beside it."""
    view = _View(scenario, roads)
    area = view.area
    road = shapely.intersection(drivable_around(roads, area), area)
    lines = markings(roads, area)
    goal = way_ahead(roads, scenario)
    parts = [
        _path("road", view, (ring for part in shapely.get_parts(road) for ring in _rings(part)), closed=True),
        *(
            _path(kind, view, _clipped([line.linestring for line in lines[kind]], area), closed=False)
            for kind in ("dashed", "middle")
        ),
        _path("way", view, _clipped([goal.linestring], area), closed=False),
        _path("thing", view, _obstacle_corners(scenario, roads), closed=True),
        _path("walk", view, _walks(scenario, roads), closed=False),
        _path("ego", view, [_ego_corners(scenario, roads)], closed=True),
    ]
    drawn = "".join(part for part in parts if part)
    return Markup(f'<svg class="thumbnail" viewBox="0 0 {WIDE_M:g} {HIGH_M:g}" aria-hidden="true">{drawn}</svg>')


class _View:
    """From the map to the drawing: turned so that the ego starts to the right."""

    def __init__(self, scenario: Scenario, roads: Roads) -> None:
        start = scenario.start.pose(roads)
        self._along = np.array([np.cos(start.heading_rad), np.sin(start.heading_rad)])
        self._left = np.array([-self._along[1], self._along[0]])
        things = [(each.x_m, each.y_m) for each in (o.pose(roads) for o in scenario.obstacles)]
        route = way_ahead(roads, scenario)
        middle = route.pose_at(min(route.length_m / 2.0, 0.45 * WIDE_M))
        shown = np.mean(np.array(things), axis=0) if things else np.array([middle.x_m, middle.y_m])
        here = np.array([start.x_m, start.y_m])
        # the ego stays in the picture, wherever the things are
        away = (shown - here) @ np.stack((self._along, self._left), axis=1)
        away = np.clip(away, (0.0, -0.3 * HIGH_M), (0.38 * WIDE_M, 0.3 * HIGH_M))
        self._middle = here + away[0] * self._along + away[1] * self._left
        wide, high = WIDE_M / 2.0, HIGH_M / 2.0
        corners = [(wide, high), (-wide, high), (-wide, -high), (wide, -high)]
        self.area = shapely.Polygon([self._middle + x * self._along + y * self._left for x, y in corners])

    def points(self, xy: Floats) -> Floats:
        """Points (N, 2) of the map in the drawing."""
        away = np.asarray(xy) - self._middle
        return np.column_stack((WIDE_M / 2.0 + away @ self._along, HIGH_M / 2.0 - away @ self._left))


def _path(kind: str, view: _View, lines: Iterable[Floats], *, closed: bool) -> str:
    drawn = "".join(_words(view.points(line)) + "Z" * closed for line in lines if len(line) > 1)
    return f'<path class="t-{kind}" d="{drawn}"/>' if drawn else ""


def _words(points: Floats) -> str:
    """A line in SVG's words, in steps of 0.1 m."""
    whole = np.round(points, 1).tolist()
    return "M" + "L".join(f"{x:g} {y:g}" for x, y in whole)


def _rings(shape: shapely.Geometry) -> list[Floats]:
    if not isinstance(shape, shapely.Polygon) or shape.is_empty:
        return []
    simple = shapely.simplify(shape, DETAIL_M)
    return [shapely.get_coordinates(ring)[:-1] for ring in (simple.exterior, *simple.interiors)]


def _clipped(lines: Iterable[shapely.Geometry], area: shapely.Geometry) -> list[Floats]:
    inside = shapely.simplify(shapely.intersection(np.array([*lines], dtype=object), area), DETAIL_M)
    return [shapely.get_coordinates(part) for part in shapely.get_parts(inside) if not shapely.is_empty(part)]


def _obstacle_corners(scenario: Scenario, roads: Roads) -> list[Floats]:
    found: list[Floats] = []
    for obstacle in scenario.obstacles:
        pose, (length_m, width_m) = obstacle.pose(roads), obstacle.size_m
        wide = (max(length_m, 1.2), max(width_m, 1.2))  # a cone is seen, too
        found.append(box_corners(pose.x_m, pose.y_m, pose.heading_rad, *wide)[0])
    return found


def _walks(scenario: Scenario, roads: Roads) -> list[Floats]:
    line = route_centerline(roads, scenario) if scenario.jaywalkers else None
    return [] if line is None else [walk(each, roads, line).points for each in scenario.jaywalkers]


def _ego_corners(scenario: Scenario, roads: Roads) -> Floats:
    pose = scenario.start.pose(roads)
    return box_corners(pose.x_m, pose.y_m, pose.heading_rad, PACIFICA.length_m, PACIFICA.width_m)[0]
