"""A picture of a map that a person understands."""

from __future__ import annotations

from collections.abc import Iterable
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import shapely

from interplan_sumo.errors import MapError
from interplan_sumo.extras import need_matplotlib
from interplan_sumo.world.files import writing
from interplan_sumo.world.roads import Roads, StopLineKind, Turn

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PAPER = "#f4f1ea"
ASPHALT = "#c9ccd1"
JUNCTION = "#bcc0c6"
EXTRA = "#d9cfe6"
CARPARK = "#d3d6da"
WALKWAY = "#e6ddc8"
LANE_EDGE = "#ffffff"
INK = "#3a3f47"
TURN_COLOURS = {
    Turn.STRAIGHT: "#4b6cb7",
    Turn.LEFT: "#2a9d6f",
    Turn.RIGHT: "#c26d2b",
    Turn.U_TURN: "#8e44ad",
    Turn.UNKNOWN: "#777777",
}
STOP_COLOURS = {
    StopLineKind.PEDESTRIAN_CROSSING: "#0aa3c2",
    StopLineKind.STOP_SIGN: "#b01e28",
    StopLineKind.TRAFFIC_LIGHT: "#1f9d3a",
    StopLineKind.TURN_STOP: "#8e44ad",
    StopLineKind.YIELD: "#e39a1c",
    StopLineKind.UNKNOWN: "#777777",
}
LIMIT_COLOURS = "viridis"
MARGIN_M = 25.0
"""Around the lanes."""

_Corner = Literal["lower right", "upper right", "upper left"]


def render_map(
    roads: Roads,
    path: str | PathLike[str],
    *,
    lane_ids: bool = False,
) -> None:
    """Draw a map into a picture file (the suffix says which kind).

    Lanes are tinted by speed limit and carry arrows in the direction of travel;
    connectors are coloured by turn, stop lines by kind. Limits are in km/h,
    shown where they begin. Equal calls write equal PNG files. Needs the `plots`
    extra; InputError says so where it is missing, MapError where there is nothing
    to draw or the file cannot be written.
    """
    need_matplotlib("a picture of a map")
    from matplotlib.figure import Figure

    if not roads.lanes:
        raise MapError(f"map {roads.name} has no lanes to draw")
    bounds = shapely.total_bounds(np.array([lane.polygon for lane in roads.lanes.values()]))
    low_x, low_y, high_x, high_y = (bounds + MARGIN_M * np.array((-1.0, -1.0, 1.0, 1.0))).tolist()
    width_m, height_m = high_x - low_x, high_y - low_y
    scale = min(1500.0 / max(width_m, height_m), 12.0)
    figure = Figure(figsize=(width_m * scale / 100.0, height_m * scale / 100.0), dpi=100)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    figure.set_facecolor(PAPER)
    axes.set_axis_off()
    axes.set_aspect("equal")
    axes.set_xlim(low_x, high_x)
    axes.set_ylim(low_y, high_y)

    _surfaces(axes, roads)
    limits = _lanes(axes, roads, scale)
    _connectors(axes, roads, scale)
    _controls(axes, roads)
    _limit_signs(axes, roads)
    if lane_ids:
        _lane_ids(axes, roads, scale)
    _legend(axes, roads, limits, scale)
    kind = Path(path).suffix.removeprefix(".").lower()
    if kind not in figure.canvas.get_supported_filetypes():
        raise MapError(f"{path}: pictures end in .png, .svg or .pdf")
    with writing(path, kind=MapError):
        figure.savefig(path, facecolor=PAPER, metadata={"Software": None} if kind == "png" else None)


def _fill(axes: Axes, polygons: Iterable[shapely.Geometry], **style: Any) -> None:
    from matplotlib.collections import PathCollection
    from matplotlib.path import Path as Outline

    paths: list[Outline] = []
    for geometry in polygons:
        for part in shapely.get_parts(geometry):
            if isinstance(part, shapely.Polygon):
                rings = [Outline(np.asarray(ring.coords), closed=True) for ring in (part.exterior, *part.interiors)]
                paths.append(Outline.make_compound_path(*rings))
    axes.add_collection(PathCollection(paths, **style))


def _surfaces(axes: Axes, roads: Roads) -> None:
    layers = (
        (roads.walkways, WALKWAY, 1.0),
        (roads.carparks, CARPARK, 1.1),
        (roads.generic_drivable_areas, EXTRA, 1.2),
        (roads.road_segments, ASPHALT, 1.3),
    )
    for areas, colour, order in layers:
        _fill(axes, (a.polygon for a in areas), facecolor=colour, edgecolor="none", zorder=order)
    for area in roads.carparks:
        middle = area.polygon.representative_point()
        axes.text(middle.x, middle.y, "P", fontsize=9, ha="center", va="center", color=INK, zorder=1.5)
    _fill(axes, (i.polygon for i in roads.intersections), facecolor=JUNCTION, edgecolor="none", zorder=1.4)


def _lanes(axes: Axes, roads: Roads, scale: float) -> tuple[float, float] | None:
    """Draw the lanes; the span of their limits, None where no limit is known."""
    from matplotlib import colormaps
    from matplotlib.collections import LineCollection

    shown = list(roads.lanes.values())
    known = [lane.speed_limit_mps for lane in roads.lanes.values() if lane.speed_limit_mps is not None]
    span = (min(known), max(known)) if known else None
    shades = colormaps[LIMIT_COLOURS]
    for lane in shown:
        if lane.speed_limit_mps is not None and span is not None:
            share = (lane.speed_limit_mps - span[0]) / max(span[1] - span[0], 1e-9)
            _fill(axes, [lane.polygon], facecolor=(*shades(share)[:3], 0.28), edgecolor="none", zorder=2)
    edges = [line.points for lane in shown for line in (lane.left_boundary, lane.right_boundary)]
    axes.add_collection(LineCollection(edges, colors=LANE_EDGE, linewidths=max(0.4, 0.12 * scale), zorder=2.5))
    spots: list[tuple[float, float, float]] = []
    for lane in shown:
        count = max(1, int(lane.centerline.length_m // 45.0))
        arcs = (np.arange(count) + 0.5) * lane.centerline.length_m / count
        spots += [tuple(p) for p in lane.centerline.poses_at(arcs).tolist()]
    if spots:
        x, y, heading = np.array(spots).T
        length_m = max(4.0, 9.0 / scale)
        axes.quiver(
            x - np.cos(heading) * length_m / 2,
            y - np.sin(heading) * length_m / 2,
            np.cos(heading) * length_m,
            np.sin(heading) * length_m,
            angles="xy",
            scale_units="xy",
            scale=1.0,
            units="xy",
            width=max(0.3, 0.7 / scale),
            headwidth=4.0,
            headlength=4.5,
            headaxislength=4.0,
            color=INK,
            alpha=0.8,
            zorder=4,
        )
    return span


def _connectors(axes: Axes, roads: Roads, scale: float) -> None:
    from matplotlib.collections import LineCollection

    for turn, colour in TURN_COLOURS.items():
        lines = [c.centerline.points for c in roads.connectors.values() if c.turn is turn]
        axes.add_collection(
            LineCollection(lines, colors=colour, linewidths=max(0.6, 0.14 * scale), alpha=0.75, zorder=5)
        )


def _controls(axes: Axes, roads: Roads) -> None:
    _fill(
        axes,
        (c.polygon for c in roads.crosswalks),
        facecolor="#ffffff",
        alpha=0.75,
        edgecolor="#8a8f98",
        linewidth=0.4,
        hatch="|||",
        zorder=3,
    )
    for kind, colour in STOP_COLOURS.items():
        polygons = [line.polygon for line in roads.stop_lines.values() if line.kind is kind]
        _fill(axes, polygons, facecolor=colour, edgecolor=colour, linewidth=0.8, zorder=6)


def _limit_signs(axes: Axes, roads: Roads) -> None:
    """A round sign beside every roadblock whose limit differs from what leads into it."""
    for block in roads.roadblocks.values():
        if block.is_connector or not block.lane_ids:
            continue
        lane = roads.lanes[block.lane_ids[-1 if roads.driving_side == "right" else 0]]
        limit = lane.speed_limit_mps
        before = {
            roads.lanes[lane_id].speed_limit_mps
            for link in roads.incoming_roadblocks(block.id)
            for upstream in roads.incoming_roadblocks(link)
            for lane_id in roads.roadblocks[upstream].lane_ids[:1]
        }
        if limit is None or limit in before:
            continue
        aside_m = -9.0 if roads.driving_side == "right" else 9.0
        pose = lane.centerline.pose_at(min(12.0, lane.centerline.length_m / 2.0), aside_m)
        axes.text(
            pose.x_m,
            pose.y_m,
            f"{3.6 * limit:.0f}",
            fontsize=6.5,
            ha="center",
            va="center",
            color=INK,
            zorder=7,
            bbox={"boxstyle": "circle,pad=0.2", "facecolor": "#ffffff", "edgecolor": "#c1121f", "linewidth": 1.4},
        )


def _lane_ids(axes: Axes, roads: Roads, scale: float) -> None:
    for lane in roads.lanes.values():
        pose = lane.centerline.pose_at(lane.centerline.length_m * 0.4)
        degrees = float(np.degrees(pose.heading_rad))
        degrees = degrees - 180.0 if degrees > 90.0 else degrees + 180.0 if degrees < -90.0 else degrees
        axes.text(
            pose.x_m,
            pose.y_m,
            lane.id,
            fontsize=float(np.clip(1.4 * scale, 3.0, 8.0)),
            rotation=degrees,
            ha="center",
            va="center",
            color="#101418",
            zorder=8,
        )


def _legend(axes: Axes, roads: Roads, limits: tuple[float, float] | None, scale: float) -> None:
    from matplotlib import colormaps
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    present = {line.kind for line in roads.stop_lines.values()}
    turns = {c.turn for c in roads.connectors.values()}
    entries: list[Line2D | Patch] = [
        Line2D([], [], color=TURN_COLOURS[t], label=t.name.lower().replace("_", " ")) for t in Turn if t in turns
    ]
    entries += [
        Patch(facecolor=STOP_COLOURS[k], label=k.name.lower().replace("_", " ")) for k in StopLineKind if k in present
    ]
    if limits is not None:
        shades = colormaps[LIMIT_COLOURS]
        for share in (0.0, 1.0) if limits[1] > limits[0] else (0.0,):
            kmh = 3.6 * (limits[0] + share * (limits[1] - limits[0]))
            entries.append(Patch(facecolor=(*shades(share)[:3], 0.45), label=f"limit {kmh:.0f} km/h"))
    if roads.generic_drivable_areas:
        entries.append(Patch(facecolor=EXTRA, label="other paved ground"))
    side = f"{roads.name} ({roads.driving_side}-hand traffic)"
    box = axes.legend(
        handles=entries,
        title=side,
        loc=_free_corner(axes, roads, 200.0 / scale, (28.0 + 15.0 * len(entries)) / scale),
        fontsize=8,
        title_fontsize=10,
        framealpha=0.9,
    )
    box.set_zorder(10)
    low_x, high_x = axes.get_xlim()
    low_y, _ = axes.get_ylim()
    bar_m = float(next(m for m in (500, 200, 100, 50, 20, 10, 5, 2, 1) if m < 0.3 * (high_x - low_x)))
    x_m, y_m = low_x + 14.0 / scale, low_y + 16.0 / scale
    axes.plot([x_m, x_m + bar_m], [y_m, y_m], color=INK, linewidth=2.5, zorder=9)
    axes.text(x_m, y_m + 7.0 / scale, f"{bar_m:.0f} m", fontsize=9, color=INK, zorder=9)


def _free_corner(axes: Axes, roads: Roads, width_m: float, height_m: float) -> _Corner:
    """The corner where a box of this size hides the fewest lanes; the scale bar has the lower left one."""
    (low_x, high_x), (low_y, high_y) = axes.get_xlim(), axes.get_ylim()
    points = np.concatenate([lane.centerline.points for lane in roads.lanes.values()] or [np.zeros((0, 2))])
    x, y = points[:, 0], points[:, 1]
    shown = (x >= low_x) & (x <= high_x) & (y >= low_y) & (y <= high_y)
    right, top = x > high_x - width_m, y > high_y - height_m
    corners: tuple[tuple[_Corner, Any], ...] = (
        ("lower right", right & (y < low_y + height_m)),
        ("upper right", right & top),
        ("upper left", (x < low_x + width_m) & top),
    )
    return min(corners, key=lambda corner: int((corner[1] & shown).sum()))[0]
