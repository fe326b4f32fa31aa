"""Drawn scene: what stands still of a drive, as plain data for a page: the map around it, its lights, the route."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2
from typing import Any, Final

import numpy as np
import shapely

from interplan_sumo.report import scenario_drawing as drawing
from interplan_sumo.report.replay import surroundings
from interplan_sumo.report.replay.numbers import PER_METRE, PER_RADIAN, PER_UNIT, points
from interplan_sumo.report.road_markings import goal_line
from interplan_sumo.scenario.route import way_ahead
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import Roads

LOOKS: Final = {
    "vehicle": drawing.OTHERS[0],
    "standing": drawing.STANDING,
    "hiding": drawing.HIDING,
    "cone": drawing.CONE,
    "barrier": drawing.BARRIER,
    "worker": drawing.WORKER,
    "pedestrian": drawing.PERSON,
    "bicycle": drawing.OTHERS[1],
    "object": drawing.OTHERS[3],
}
"""Colours of whoever has no type of driver, as in the pictures of scenarios."""


@dataclass(frozen=True, eq=False)
class DrawnScene:
    """A piece of map, and what it holds for a page."""

    origin: Floats
    """Of all coordinates of the page, map frame."""
    drivable: shapely.Geometry
    """The drivable area."""
    fields: dict[str, Any]
    """`per`, `turned_rad`, `extent`, `map`, `lights`, `route` and `looks`, as the docstring of `data` tells them."""

    @classmethod
    def of(cls, roads: Roads, scenario: Scenario, tracks: Sequence[Floats] = ()) -> DrawnScene:
        """Around the route and tracks (N, 2) of the map."""
        route = way_ahead(roads, scenario)
        away = route.points[-1] - route.points[0]
        shown = np.concatenate((route.points, *tracks))
        origin = np.floor(shown.min(axis=0))
        area = surroundings.area_around((route.points, *tracks))
        fields = {
            "per": {"metre": PER_METRE, "radian": PER_RADIAN, "unit": PER_UNIT},
            "turned_rad": round(atan2(away[1], away[0]), 4),
            "extent": points(np.stack((shown.min(axis=0), shown.max(axis=0))), origin),
            "map": surroundings.map_around(roads, area, origin),
            "lights": surroundings.lights(roads, area, origin),
            "route": {"line": points(route.points, origin), "goal": points(goal_line(roads, scenario), origin)},
            "looks": LOOKS,
        }
        return cls(origin, surroundings.drivable_around(roads, area), fields)
