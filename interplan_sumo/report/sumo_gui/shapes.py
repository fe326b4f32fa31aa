"""Shapes: what stands in a drive and what is marked, as polygons that sumo-gui draws on its network."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.batch.stored_drive import StoredDrive
from interplan_sumo.maps.plain_xml import shape_text
from interplan_sumo.report import scenario_drawing as drawing
from interplan_sumo.report.sumo_gui.xml import colour, tag
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.geometry import Floats, box_corners

GOAL_M: Final = 3.5
"""Length of the line at the goal."""


def shape_tags(drive: StoredDrive, origin_m: tuple[float, float], standing: NDArray[np.bool_]) -> Iterator[str]:
    """Polygons: what stands around, the crosswalks, the route, the goal line and the way that the ego took."""
    roads, origin = drive.roads, np.array(origin_m)
    track = np.stack((drive.trace.ego.x_m, drive.trace.ego.y_m), axis=1)
    near = shapely.box(*(track.min(axis=0) - 150.0), *(track.max(axis=0) + 150.0))
    for area in roads.crosswalks:
        if area.polygon.intersects(near):
            yield _polygon(f"crosswalk_{area.id}", shapely.get_coordinates(area.polygon) - origin, "#ffffff", 1, 0.5)
    for block in drive.scenario.route:
        outline = shapely.get_coordinates(roads.roadblocks[block].polygon.exterior)
        yield _polygon(f"route_{block}", outline - origin, drawing.ROUTE, 2, 0.2)
    goal = drive.scenario.goal
    ends = [replace(goal, left_m=goal.left_m + side * GOAL_M / 2.0).pose(roads) for side in (1.0, -1.0)]
    across = np.array([(pose.x_m, pose.y_m) for pose in ends])
    yield _polygon("goal", across - origin, drawing.GOAL, 4, 1.0, line_m=0.8)
    yield _polygon("ego_way", track - origin, drawing.EGO, 3, 0.8, line_m=0.25)
    actors, shown = drive.trace.actors, set[str]()
    for row in np.flatnonzero(standing):
        name = str(actors.ids[row])
        if name not in shown:
            shown.add(name)
            pose = actors.x_m[row], actors.y_m[row], actors.heading_rad[row]
            (corners,) = box_corners(*pose, actors.length_m[row], actors.width_m[row])
            kind = ActorKind(int(actors.kind[row]))
            paint = drawing.OBSTACLE_COLOURS.get(kind, drawing.STANDING)
            yield _polygon(f"{kind.name.lower()}_{name}", corners - origin, paint, 5, 1.0)


def _polygon(name: str, xy: Floats, fill: str, layer: int, opacity: float, *, line_m: float | None = None) -> str:
    """Points (N, 2) in SUMO's frame, filled, or as a line of this width."""
    line = {"fill": "0", "lineWidth": f"{line_m:g}"} if line_m is not None else {"fill": "1"}
    return tag("poly", id=name, color=colour(fill, opacity), layer=layer, shape=shape_text(xy), **line)
