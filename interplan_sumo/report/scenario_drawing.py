"""Drawing of a scene: roads as a driver knows them, and everything that stands, waits or drives on them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import cos, sin
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import shapely

from interplan_sumo.maps.render import ASPHALT, CARPARK, EXTRA, INK, JUNCTION, STOP_COLOURS, WALKWAY
from interplan_sumo.report.road_markings import goal_line, markings
from interplan_sumo.scenario.jaywalking import trigger_distance_m, walk
from interplan_sumo.scenario.route import route_centerline, way_ahead
from interplan_sumo.scenario.scenario import OBSTACLES, Scenario
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import Floats, Pose, box_corners
from interplan_sumo.world.roads import Roads, StopLineKind
from interplan_sumo.world.signals import SignalStatus

if TYPE_CHECKING:
    from matplotlib.axes import Axes

EGO: Final = "#1d4ed8"
ROUTE: Final = "#3b82f6"
GOAL: Final = "#15803d"
STANDING: Final = "#2b2f36"
HIDING: Final = "#6b4f1d"
CONE: Final = "#f97316"
BARRIER: Final = "#dc2626"
WORKER: Final = "#a16207"
PERSON: Final = "#c026d3"
MARKING: Final = "#ffffff"
MIDDLE: Final = "#e9b949"
EDGE: Final = "#8a8f98"
LIGHTS: Final = {
    SignalStatus.GREEN: "#16a34a",
    SignalStatus.YELLOW: "#f5b301",
    SignalStatus.RED: "#e11d2e",
    SignalStatus.UNKNOWN: "#8a8f98",
}
"""As in replays, whose style holds them."""
LIGHT_M: Final = 0.9
"""Width of a light's bar, as in replays."""
LOST: Final = "#b3261e"
"""Under the words on points that were lost."""
BEHAVIOURS: Final = {"conservative": "#2a9d6f", "assertive": "#e11d48"}
OTHERS: Final = ("#7c5cff", "#0891b2", "#b45309", "#64748b", "#be185d")
"""For types of drivers with other names, in order of their names."""
OBSTACLE_COLOURS: Final = {
    ActorKind.VEHICLE: STANDING,
    ActorKind.TRAFFIC_CONE: CONE,
    ActorKind.BARRIER: BARRIER,
    ActorKind.CZONE_SIGN: BARRIER,
    ActorKind.PEDESTRIAN: WORKER,
    ActorKind.GENERIC_OBJECT: STANDING,
}
ARROW_S: Final = 1.0
"""Velocity arrows are as long as the way in this time."""


@dataclass(frozen=True, slots=True)
class View:
    """A window on the map, turned so that the route runs from left to right."""

    x_m: float
    """Map coordinates of the middle."""
    y_m: float
    turned_rad: float
    """Map heading that points to the right."""
    width_m: float
    height_m: float
    scale: float
    """Pixels per metre."""

    @classmethod
    def of_box(cls, low: Floats, high: Floats, turned_rad: float) -> View:
        """The window between two corners (2,), given in axes that are turned about the origin of the map."""
        x_m, y_m = ((low + high) / 2.0).tolist()
        c, s = cos(turned_rad), sin(turned_rad)
        width_m, height_m = (high - low).tolist()
        return cls(c * x_m - s * y_m, s * x_m + c * y_m, turned_rad, width_m, height_m, 1.0)

    def points(self, xy: Any) -> Floats:
        """Map coordinates (..., 2) as those of the picture, metres from its middle."""
        away = np.asarray(xy, dtype=np.float64) - (self.x_m, self.y_m)
        c, s = cos(self.turned_rad), sin(self.turned_rad)
        return np.stack((c * away[..., 0] + s * away[..., 1], c * away[..., 1] - s * away[..., 0]), axis=-1)

    @property
    def outline(self) -> shapely.Polygon:
        """The window in map coordinates."""
        c, s = cos(self.turned_rad), sin(self.turned_rad)
        half = ((1, 1), (-1, 1), (-1, -1), (1, -1))
        corners = [(a * self.width_m / 2.0, b * self.height_m / 2.0) for a, b in half]
        return shapely.Polygon([(self.x_m + c * x - s * y, self.y_m + s * x + c * y) for x, y in corners])


def behaviour_colours(names: Iterable[str]) -> dict[str, str]:
    """A colour for each type of driver; one for all unnamed types where they are more than there are colours."""
    found = sorted({*names})
    rest = [name for name in found if name not in BEHAVIOURS]
    many = len(rest) > len(OTHERS)
    others = {name: OTHERS[0 if many else i] for i, name in enumerate(rest)}
    return {name: BEHAVIOURS.get(name, others.get(name, INK)) for name in found}


def drivers_in_legend(counts: Mapping[str, int]) -> list[tuple[str, str, int]]:
    """Label, colour and number of each type of driver; types that share a colour stand there once."""
    colours = behaviour_colours(counts)
    shared = [name for name in counts if name not in BEHAVIOURS]
    if len(shared) <= len(OTHERS):
        return [(name, colours[name], counts[name]) for name in sorted(counts)]
    named = [(name, colours[name], counts[name]) for name in sorted(counts) if name in BEHAVIOURS]
    return [*named, ("drivers, each its own type", OTHERS[0], sum(counts[name] for name in shared))]


# --- roads ---------------------------------------------------------------------------------------


def draw_roads(axes: Axes, roads: Roads, view: View, stop_colours: Mapping[StopLineKind, str] = STOP_COLOURS) -> None:
    """Surfaces, lane markings, crossings and stop lines inside the view."""
    near = view.outline
    layers: tuple[tuple[Iterable[Any], str], ...] = (
        (roads.walkways, WALKWAY), (roads.carparks, CARPARK), (roads.generic_drivable_areas, EXTRA),
        (roads.road_segments, ASPHALT), (roads.intersections, JUNCTION),
    )  # fmt: skip
    for order, (areas, colour) in enumerate(layers):
        _fill(
            axes,
            view,
            _near((a.polygon for a in areas), near),
            facecolor=colour,
            edgecolor="none",
            zorder=1 + order / 10,
        )
    drivable = shapely.intersection(roads.drivable_area, shapely.buffer(near, 5.0))
    _fill(axes, view, [drivable], facecolor="none", edgecolor=EDGE, linewidth=0.9, zorder=1.9)
    crossings = _near((area.polygon for area in roads.crosswalks), near)
    _fill(axes, view, crossings, facecolor="#ffffff", alpha=0.8, edgecolor="none", zorder=2.0)
    _markings(axes, roads, view)
    for kind, colour in stop_colours.items():
        lines = _near((line.polygon for line in roads.stop_lines.values() if line.kind is kind), near)
        _fill(axes, view, lines, facecolor=colour, edgecolor=colour, linewidth=0.6, alpha=0.8, zorder=2.6)
    ways = [c.centerline.points for c in roads.connectors.values() if c.polygon.intersects(near)]
    _lines(axes, view, ways, colors="#ffffff", linewidths=0.5, alpha=0.5, zorder=2.1)
    _direction_arrows(axes, roads, view)


def _near(polygons: Iterable[shapely.Polygon], near: shapely.Polygon) -> list[shapely.Polygon]:
    return [polygon for polygon in polygons if polygon.intersects(near)]


def _fill(axes: Axes, view: View, geometries: Iterable[shapely.Geometry], **style: Any) -> None:
    from matplotlib.collections import PathCollection
    from matplotlib.path import Path as Outline

    paths = [
        Outline.make_compound_path(
            *(Outline(view.points(ring.coords), closed=True) for ring in (part.exterior, *part.interiors))
        )
        for geometry in geometries
        for part in shapely.get_parts(geometry)
        if isinstance(part, shapely.Polygon)
    ]
    axes.add_collection(PathCollection(paths, **style))


def _lines(axes: Axes, view: View, lines: Iterable[Floats], **style: Any) -> None:
    from matplotlib.collections import LineCollection

    axes.add_collection(LineCollection([view.points(line) for line in lines], **style))


def _markings(axes: Axes, roads: Roads, view: View) -> None:
    """Dashes between lanes of one direction, solid lines at the edges, yellow ones between the directions."""
    found = {kind: [line.points for line in group] for kind, group in markings(roads, view.outline).items()}
    width = max(0.5, 0.13 * view.scale)
    _lines(axes, view, found["solid"], colors=MARKING, linewidths=width, zorder=2.3)
    _lines(axes, view, found["dashed"], colors=MARKING, linewidths=width, linestyles=(0, (9.0, 9.0)), zorder=2.3)
    _lines(axes, view, found["middle"], colors=MIDDLE, linewidths=1.2 * width, zorder=2.4)


def _direction_arrows(axes: Axes, roads: Roads, view: View) -> None:
    """Small arrows on the lanes, which way they go."""
    near = view.outline
    every_m = max(30.0, 150.0 / view.scale)
    poses: list[Floats] = []
    for lane in roads.lanes.values():
        if lane.polygon.intersects(near):
            count = max(1, int(lane.centerline.length_m // every_m))
            poses.append(lane.centerline.poses_at((np.arange(count) + 0.5) * lane.centerline.length_m / count))
    if poses:
        at = np.concatenate(poses)
        tip = at[:, :2] + 1.6 * np.stack((np.cos(at[:, 2]), np.sin(at[:, 2])), axis=1)
        tail = at[:, :2] - 1.6 * np.stack((np.cos(at[:, 2]), np.sin(at[:, 2])), axis=1)
        _arrows(axes, view, tail, tip, MARKING, alpha=0.75, width_m=0.16, zorder=2.7)


def _arrows(
    axes: Axes,
    view: View,
    tails: Floats,
    tips: Floats,
    colour: str,
    *,
    width_m: float,
    zorder: float,
    alpha: float = 1.0,
) -> None:
    """Arrows between points (K, 2) of the map."""
    start, end = view.points(tails), view.points(tips)
    axes.quiver(
        start[:, 0], start[:, 1], *(end - start).T, angles="xy", scale_units="xy", scale=1.0, units="xy",
        width=width_m, headwidth=5.0, headlength=5.0, headaxislength=4.5, minlength=0.0, color=colour, alpha=alpha,
        zorder=zorder,
    )  # fmt: skip


# --- the task ------------------------------------------------------------------------------------


def draw_route(axes: Axes, scenario: Scenario, roads: Roads, view: View) -> None:
    """The roadblocks of the route, its line from the start to the goal, and the goal line across them."""
    blocks = [roads.roadblocks[block].polygon for block in scenario.route]
    _fill(axes, view, blocks, facecolor=ROUTE, edgecolor="none", alpha=0.10, zorder=2.2)
    way = way_ahead(roads, scenario).points
    _lines(axes, view, [way], colors=ROUTE, linewidths=max(1.2, 0.22 * view.scale), alpha=0.55, zorder=3.0)
    pose = scenario.goal.pose(roads)
    _lines(axes, view, [goal_line(roads, scenario)], colors=GOAL, linewidths=max(1.8, 0.5 * view.scale), zorder=3.2)
    at = view.points((pose.x_m, pose.y_m))
    axes.plot(*at, marker="*", markersize=max(9.0, 1.6 * view.scale), color=GOAL, markeredgecolor="white", zorder=6.0)


def draw_ego(axes: Axes, scenario: Scenario, roads: Roads, view: View) -> None:
    """The ego's box at the start and how far it goes in a second."""
    pose = scenario.start.pose(roads)
    _vehicle(axes, view, pose, (PACIFICA.length_m, PACIFICA.width_m), EGO, zorder=8.0)
    front = _ahead(pose, PACIFICA.length_m / 2.0)
    tip = _ahead(pose, PACIFICA.length_m / 2.0 + ARROW_S * scenario.start_speed_mps)
    _arrows(axes, view, front[None], tip[None], EGO, width_m=_arrow_m(view, 0.5), zorder=8.1)


def draw_obstacles(axes: Axes, scenario: Scenario, roads: Roads, view: View) -> None:
    """True boxes; what is too small to be seen also gets a dot."""
    for i, obstacle in enumerate(scenario.obstacles):
        pose, kind = obstacle.pose(roads), OBSTACLES[obstacle.kind][0]
        if kind == ActorKind.VEHICLE:
            colour = HIDING if i == scenario.occluder else STANDING
            _vehicle(axes, view, pose, obstacle.size_m, colour, zorder=7.0, alpha=0.85)
        else:
            _box(axes, view, pose, obstacle.size_m, OBSTACLE_COLOURS[kind], zorder=7.2)
            _dot(axes, view, pose, OBSTACLE_COLOURS[kind], "^" if kind == ActorKind.TRAFFIC_CONE else "o", zorder=7.1)


def draw_jaywalkers(axes: Axes, scenario: Scenario, roads: Roads, view: View) -> None:
    """People where they wait, their ways across, and where the ego's front sets them off at its start speed."""
    if not scenario.jaywalkers:
        return
    line = route_centerline(roads, scenario)
    for walker in scenario.jaywalkers:
        taken = walk(walker, roads, line)
        way, (ends,) = taken.points, taken.poses(np.array([taken.duration_s]))
        width = max(1.1, 0.16 * view.scale)
        _lines(axes, view, [way], colors=PERSON, linewidths=width, linestyles=(0, (4.0, 2.0)), zorder=6.4)
        back = way[-1] - 1.2 * np.array((np.cos(ends[2]), np.sin(ends[2])))
        _arrows(axes, view, back[None], way[-1:], PERSON, width_m=_arrow_m(view, 0.3), zorder=6.5)
        pose = Pose(*taken.poses(np.array([-1.0]))[0].tolist())
        _box(axes, view, pose, taken.size_m, PERSON, zorder=7.6)
        _dot(axes, view, pose, PERSON, "o", zorder=7.5)
        if shapely.intersects(shapely.LineString(way), line.linestring):
            front = line.pose_at(taken.conflict_m - trigger_distance_m(scenario.start_speed_mps))
            bar = [_aside(front, side * 2.2) for side in (1.0, -1.0)]
            _lines(axes, view, [np.stack(bar)], colors=PERSON, linewidths=max(1.5, 0.2 * view.scale), zorder=6.3)


# --- the traffic ---------------------------------------------------------------------------------


def light_bar(ends: Floats) -> shapely.Polygon:
    """The bar of a light on the ground, from its ends (2, 2)."""
    return shapely.LineString(ends).buffer(LIGHT_M / 2.0, cap_style="flat")


def draw_lights(axes: Axes, bars: Sequence[tuple[shapely.Polygon, SignalStatus]], view: View) -> None:
    """The bars of lights in the colours of what they show: on the ground, under everybody's way."""
    if bars:
        shapes, shown = zip(*bars, strict=True)
        _fill(axes, view, shapes, facecolor=[LIGHTS[status] for status in shown], edgecolor="none", zorder=3.5)


def draw_agents(
    axes: Axes, actors: Actors, behaviours: Mapping[str, str], view: View, colours: Mapping[str, str]
) -> None:
    """Moving vehicles in the colour of their behaviour, with velocity arrows."""
    rows = [row for row, name in enumerate(actors.ids) if name in behaviours]
    for row in rows:
        pose = Pose(float(actors.x_m[row]), float(actors.y_m[row]), float(actors.heading_rad[row]))
        size_m = (float(actors.length_m[row]), float(actors.width_m[row]))
        _vehicle(axes, view, pose, size_m, colours[behaviours[actors.ids[row]]], zorder=5.0)
    for name, colour in colours.items():
        mine = [row for row in rows if behaviours[actors.ids[row]] == name and actors.speed_mps[row] > 0.2]
        if mine:
            half_m = actors.length_m[mine] / 2.0
            ahead = np.stack((np.cos(actors.heading_rad[mine]), np.sin(actors.heading_rad[mine])), axis=1)
            front = np.stack((actors.x_m[mine], actors.y_m[mine]), axis=1) + half_m[:, None] * ahead
            tips = front + ARROW_S * np.stack((actors.vx_mps[mine], actors.vy_mps[mine]), axis=1)
            _arrows(axes, view, front, tips, colour, width_m=_arrow_m(view, 0.28), zorder=5.1)


def draw_frame(axes: Axes, view: View, part: View) -> None:
    """The outline of another view."""
    corners = view.points(part.outline.exterior.coords)
    axes.plot(*corners.T, color=INK, linewidth=1.0, linestyle=(0, (1.0, 2.0)), zorder=9.0)


# --- bodies --------------------------------------------------------------------------------------


def _vehicle(
    axes: Axes, view: View, pose: Pose, size_m: Sequence[float], colour: str, *, zorder: float, alpha: float = 1.0
) -> None:
    """A box with a bright windscreen, so that one sees where its front is."""
    _box(axes, view, pose, size_m, colour, zorder=zorder, alpha=alpha)
    length_m, width_m = size_m
    x_m, y_m = _ahead(pose, length_m / 2.0 - min(0.28 * length_m, 1.5)).tolist()
    screen = Pose(x_m, y_m, pose.heading_rad)
    _box(axes, view, screen, (min(0.12 * length_m, 0.7), 0.78 * width_m), "#ffffff", zorder=zorder + 0.01, alpha=0.8)


def _box(
    axes: Axes, view: View, pose: Pose, size_m: Sequence[float], colour: str, *, zorder: float, alpha: float = 1.0
) -> None:
    (corners,) = box_corners(pose.x_m, pose.y_m, pose.heading_rad, size_m[0], size_m[1])
    axes.fill(*view.points(corners).T, facecolor=colour, edgecolor="white", linewidth=0.4, alpha=alpha, zorder=zorder)


def _dot(axes: Axes, view: View, pose: Pose, colour: str, marker: str, *, zorder: float) -> None:
    x_m, y_m = view.points((pose.x_m, pose.y_m))
    axes.plot([x_m], [y_m], marker=marker, markersize=5.0, color=colour, markeredgewidth=0.0, zorder=zorder)


def _ahead(pose: Pose, metres: float) -> Floats:
    return np.array((pose.x_m + metres * cos(pose.heading_rad), pose.y_m + metres * sin(pose.heading_rad)))


def _aside(pose: Pose, left_m: float) -> Floats:
    return np.array((pose.x_m - left_m * sin(pose.heading_rad), pose.y_m + left_m * cos(pose.heading_rad)))


def _arrow_m(view: View, metres: float) -> float:
    """Width of an arrow's shaft: never thinner than a pixel and a bit."""
    return max(metres, 1.3 / view.scale)
