"""Pictures of scenarios: one that shows everything that is staged, and a sheet of many to compare at a glance."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import cos, sin
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from interplan_sumo.errors import InputError
from interplan_sumo.extras import need_matplotlib
from interplan_sumo.maps.render import EXTRA, INK, PAPER
from interplan_sumo.maps.store import load_roads
from interplan_sumo.report import scenario_drawing as drawing
from interplan_sumo.report.scenario_drawing import View
from interplan_sumo.scenario.route import goal_arc_m, route_centerline, start_arc_m, way_ahead
from interplan_sumo.scenario.scenario import OBSTACLES, Scenario
from interplan_sumo.scenario.suite import certificate_of
from interplan_sumo.simulation.setup import open_traffic
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.files import writing
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.lane_changes import lane_changes_needed
from interplan_sumo.world.roads import Roads

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH: Final = 1500
"""Pixels of a picture."""
DPI: Final = 100
TITLE, FOOT, GAP = 62, 42, 8
"""Pixels above, below and between the views."""
CLOSE_UP_M: Final = (70.0, 21.0)
"""Least width and height of the close-up of what stands in the way."""
MARGIN_M: Final = 14.0
"""Before and behind what a view must show; beside it half of that."""
CELL: Final = (330, 104)
"""Pixels of one scenario on a sheet."""
CELL_TITLE: Final = 17
COLUMNS: Final = 10
TITLE_LETTERS: Final = 52
"""Letters that have room above a scenario of a sheet."""
OF_ONE_FAMILY: Final = 4
"""Columns of a sheet that needs no row for each family."""
LEGEND_ENTRY: Final = (230, 26)
"""Pixels that one of the words below a sheet may take."""


@dataclass(frozen=True, slots=True, eq=False)
class StagedTraffic:
    """The moving vehicles of seed 0 at t = 0."""

    actors: Actors
    behaviours: dict[str, str]


def start_traffic(scenario: Scenario, roads: Roads) -> StagedTraffic:
    """Who drives where when the scenario begins; opens SUMO unless nothing moves."""
    if not scenario.has_traffic:
        return StagedTraffic(Actors.none(), {})
    with open_traffic(scenario, roads) as traffic:
        return StagedTraffic(traffic.observe().actors, dict(traffic.behaviours))


def render_scenario(scenario: Scenario, roads: Roads, path: str | PathLike[str]) -> None:
    """Draw a scenario: the whole way from the start to the goal, and a close-up of what stands or crosses there.

    The route runs from left to right. Equal calls write equal PNG files. Needs
    the `plots` extra; InputError says so where it is missing, or names the
    file that cannot be written. Opens SUMO if the scenario has traffic.
    """
    scenario.check(roads)
    _figure(1, 1)  # before SUMO is started in vain
    traffic = start_traffic(scenario, roads)
    colours = drawing.behaviour_colours(traffic.behaviours.values())
    views = [_overview(scenario, roads)]
    if scenario.obstacles or scenario.jaywalkers:
        views.append(_close_up(scenario, roads, views[0].turned_rad))
    heights = [round(view.height_m * view.scale) for view in views]
    total = TITLE + sum(heights) + GAP * (len(views) - 1) + FOOT
    figure = _figure(WIDTH, total)
    top = total - TITLE
    for view, height in zip(views, heights, strict=True):
        axes = figure.add_axes((0.0, (top - height) / total, 1.0, height / total))
        _scene(axes, scenario, roads, traffic, colours, view)
        _scale_bar(axes, view)
        if view is not views[-1]:
            drawing.draw_frame(axes, view, views[-1])
        top -= height + GAP
    _north(figure, views[0].turned_rad, total)
    _title(figure, scenario, roads, total)
    _legend(figure, scenario, roads, traffic, views)
    _save(figure, path)


def contact_sheet(scenarios: Iterable[Scenario], path: str | PathLike[str]) -> None:
    """Draw many scenarios small, rows of their own for each family; each route runs from left to right.

    Raises as `render_scenario` does. Opens SUMO once for each that has traffic.
    """
    rows: dict[str, list[Scenario]] = {}
    for scenario in scenarios:
        rows.setdefault(scenario.family, []).append(scenario)
    columns = COLUMNS if len(rows) > 1 else OF_ONE_FAMILY
    cells = [(family, part) for family, many in rows.items() for part in _pieces(many, columns)]
    if not cells:
        raise InputError("there are no scenarios to draw")
    staged = {scenario.id: _opened(scenario) for _, part in cells for scenario in part}
    entries = _sheet_entries(Counter(name for _, traffic in staged.values() for name in traffic.behaviours.values()))
    width = max(len(part) for _, part in cells) * (CELL[0] + GAP) + GAP
    beside = min(len(entries), width // LEGEND_ENTRY[0])
    below = FOOT + LEGEND_ENTRY[1] * (-(-len(entries) // beside) - 1)
    height = len(cells) * (CELL[1] + CELL_TITLE + GAP) + GAP + below
    figure = _figure(width, height)
    for row, (_, part) in enumerate(cells):
        for column, scenario in enumerate(part):
            roads, traffic = staged[scenario.id]
            colours = drawing.behaviour_colours({*traffic.behaviours.values()})
            left = GAP + column * (CELL[0] + GAP)
            bottom = height - (row + 1) * (CELL[1] + CELL_TITLE + GAP)
            axes = figure.add_axes((left / width, bottom / height, CELL[0] / width, CELL[1] / height))
            _scene(axes, scenario, roads, traffic, colours, _cell_view(scenario, roads))
            top = (bottom + CELL[1] + 3) / height
            figure.text(left / width, top, scenario.id, fontsize=8, weight="bold", color=INK)
            figure.text((left + CELL[0]) / width, top, _about(scenario), fontsize=7, ha="right", color=INK)
    figure.legend(handles=entries, loc="lower center", ncols=beside, fontsize=12, frameon=False)
    _save(figure, path)


def _opened(scenario: Scenario) -> tuple[Roads, StagedTraffic]:
    roads = load_roads(scenario.map, scenario.maps_beside)
    return roads, start_traffic(scenario, roads)


def _about(scenario: Scenario) -> str:
    """The words above a scenario of a sheet, as many as have room beside its id."""
    demand = scenario.traffic
    words = [
        *([] if scenario.id.startswith(f"{Path(scenario.map).name}.") else [scenario.map]),
        demand.density,
        *([f"oncoming {demand.oncoming}"] if demand.oncoming != "none" else ()),
    ]
    last = ["open"] if _is_open(scenario) else []
    while words and len(scenario.id) + len(", ".join((*words, *last))) > TITLE_LETTERS:
        words.pop()
    return ", ".join((*words, *last))


# --- what a view shows ---------------------------------------------------------------------------


def _staged(scenario: Scenario, roads: Roads) -> Floats:
    """(K, 2) everything that stands or crosses, in map coordinates."""
    poses = [obstacle.pose(roads) for obstacle in scenario.obstacles]
    poses += [place.pose(roads) for walker in scenario.jaywalkers for place in walker.places]
    return np.array([(pose.x_m, pose.y_m) for pose in poses], dtype=np.float64).reshape(-1, 2)


def _way(scenario: Scenario, roads: Roads) -> Floats:
    """(K, 2) the start and the route from there to the goal, in map coordinates."""
    start = scenario.start.pose(roads)
    return np.concatenate((((start.x_m, start.y_m),), way_ahead(roads, scenario).points))


def _overview(scenario: Scenario, roads: Roads) -> View:
    way = _way(scenario, roads)
    return _around(np.concatenate((way, _staged(scenario, roads))), _direction(way), WIDTH, (280, 760))


def _close_up(scenario: Scenario, roads: Roads, turned_rad: float) -> View:
    staged = _staged(scenario, roads)
    heading_rad = _heading_at(scenario, roads, staged, turned_rad)
    least = View(0.0, 0.0, heading_rad, *CLOSE_UP_M, 1.0)
    return _around(staged, heading_rad, WIDTH, (300, 760), least)


def _cell_view(scenario: Scenario, roads: Roads) -> View:
    """A scenario on the sheet: what stands in the way and the ego, or the way to the goal."""
    way, staged = _way(scenario, roads), _staged(scenario, roads)
    shown = np.concatenate((way[:1], staged)) if len(staged) else way
    return _around(shown, _direction(way if not len(staged) else shown), CELL[0], (CELL[1], CELL[1]))


def _direction(way: Floats) -> float:
    """Map heading from the first to the last point."""
    away = way[-1] - way[0]
    return float(np.arctan2(away[1], away[0]))


def _heading_at(scenario: Scenario, roads: Roads, staged: Floats, otherwise_rad: float) -> float:
    """Heading of the route beside what is staged."""
    line = route_centerline(roads, scenario)
    arc_m, _ = line.project(staged.mean(axis=0)[None])
    return float(line.poses_at(arc_m)[0, 2]) if len(staged) else otherwise_rad


def _around(xy: Floats, turned_rad: float, width: int, heights: tuple[int, int], least: View | None = None) -> View:
    """The view of this width in pixels that shows all points, no lower and no higher than `heights`."""
    flat = View(0.0, 0.0, turned_rad, 1.0, 1.0, 1.0).points(xy)
    margin_m = np.array((MARGIN_M, MARGIN_M / 2.0))
    shown = View.of_box(flat.min(axis=0) - margin_m, flat.max(axis=0) + margin_m, turned_rad)
    width_m, height_m = shown.width_m, shown.height_m
    if least is not None:
        width_m, height_m = max(width_m, least.width_m), max(height_m, least.height_m)
    width_m = max(width_m, height_m * width / heights[1])
    scale = width / width_m
    height_m = max(height_m, heights[0] / scale)
    return replace(shown, width_m=width_m, height_m=height_m, scale=scale)


def _scene(
    axes: Axes, scenario: Scenario, roads: Roads, traffic: StagedTraffic, colours: dict[str, str], view: View
) -> None:
    axes.set_facecolor(PAPER)
    axes.set_xlim(-view.width_m / 2.0, view.width_m / 2.0)
    axes.set_ylim(-view.height_m / 2.0, view.height_m / 2.0)
    axes.set_xticks([])
    axes.set_yticks([])
    axes.set_autoscale_on(False)
    drawing.draw_roads(axes, roads, view)
    drawing.draw_route(axes, scenario, roads, view)
    drawing.draw_agents(axes, traffic.actors, traffic.behaviours, view, colours)
    drawing.draw_obstacles(axes, scenario, roads, view)
    drawing.draw_jaywalkers(axes, scenario, roads, view)
    drawing.draw_ego(axes, scenario, roads, view)


# --- words around it -----------------------------------------------------------------------------


def _title(figure: Figure, scenario: Scenario, roads: Roads, total: int) -> None:
    demand = scenario.traffic
    limit_mps = roads[scenario.start.lane].speed_limit_mps
    need = lane_changes_needed(roads, scenario.route, scenario.goal.lane).get(scenario.start.lane)
    words = [
        f"traffic: {demand.density}",
        f"oncoming: {demand.oncoming}",
        f"drivers: {demand.behaviour}",
        f"starts with {3.6 * scenario.start_speed_mps:.0f} km/h"
        + (f", limit {3.6 * limit_mps:.0f}" if limit_mps is not None else ""),
        f"{goal_arc_m(roads, scenario) - start_arc_m(roads, scenario):.0f} m to the goal",
    ]
    if need:
        words.append(f"{need} lane change{'s' if need > 1 else ''}")
    if scenario.jaywalkers:
        words.append(f"walking at {', '.join(f'{walker.speed_mps:g}' for walker in scenario.jaywalkers)} m/s")
    words += _solved(scenario)
    figure.text(14 / WIDTH, (total - 27) / total, scenario.id, fontsize=17, weight="bold", color=INK)
    site = f"{scenario.site(roads)}, {roads.driving_side}-hand traffic"
    figure.text(1.0 - 14 / WIDTH, (total - 25) / total, site, fontsize=12, ha="right", color=INK)
    figure.text(14 / WIDTH, (total - 52) / total, "   |   ".join(words), fontsize=11, color=INK)


def _solved(scenario: Scenario) -> list[str]:
    """Who solves an official scenario, as far as that was asked."""
    proved = certificate_of(scenario.id, scenario.hash())
    if proved is None or proved.solved_by is None:
        return []
    return [f"solved by {proved.solved_words}" if proved.solved_by else "open: no planner solves it"]


def _is_open(scenario: Scenario) -> bool:
    proved = certificate_of(scenario.id, scenario.hash())
    return proved is not None and proved.solved_by == ()


def _legend(
    figure: Figure,
    scenario: Scenario,
    roads: Roads,
    traffic: StagedTraffic,
    views: Sequence[View],
) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    entries: list[Any] = [
        Patch(facecolor=drawing.EGO, label="ego, and its way in 1 s"),
        Line2D([], [], color=drawing.ROUTE, linewidth=3, alpha=0.6, label="route"),
        Line2D([], [], color=drawing.GOAL, linewidth=3, marker="*", markersize=11, label="goal line and lane"),
    ]
    there = drawing.drivers_in_legend(Counter(traffic.behaviours.values()))
    entries += [Patch(facecolor=colour, label=f"{label} ({number})") for label, colour, number in there]
    words = {
        "vehicle": "standing vehicle",
        "czone sign": "sign",
        "traffic cone": "cone",
        "pedestrian": "person",
        "generic object": "door",
    }
    open_ones = (each for i, each in enumerate(scenario.obstacles) if i != scenario.occluder)
    for kind in sorted({OBSTACLES[each.kind][0] for each in open_ones}):
        name = kind.words
        entries.append(Patch(facecolor=drawing.OBSTACLE_COLOURS[ActorKind(kind)], label=words.get(name, name)))
    if scenario.occluder is not None:
        entries.append(Patch(facecolor=drawing.HIDING, label="hides pedestrians"))
    if scenario.jaywalkers:
        entries += [
            Line2D([], [], color=drawing.PERSON, marker="o", linestyle=(0, (4.0, 2.0)), label="pedestrian and way"),
            Line2D([], [], color=drawing.PERSON, marker="|", markersize=12, linestyle="none", markeredgewidth=2.5,
                   label="ego's front here sets it off"),
        ]  # fmt: skip
    if any(area.polygon.intersects(view.outline) for area in roads.generic_drivable_areas for view in views):
        entries.append(Patch(facecolor=EXTRA, label="parking or bus bay"))
    figure.legend(
        handles=entries, loc="lower center", ncols=len(entries), fontsize=10 if len(entries) < 10 else 9, frameon=False,
        borderaxespad=0.4, handlelength=1.6, columnspacing=1.3,
    )  # fmt: skip


def _sheet_entries(seen: Counter[str]) -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    return [
        Patch(facecolor=drawing.EGO, label="ego"),
        Line2D([], [], color=drawing.ROUTE, linewidth=3, alpha=0.6, label="route"),
        Line2D([], [], color=drawing.GOAL, linewidth=3, marker="*", markersize=11, label="goal"),
        *(Patch(facecolor=colour, label=label) for label, colour, _ in drawing.drivers_in_legend(seen)),
        Patch(facecolor=drawing.STANDING, label="standing vehicle"),
        Patch(facecolor=drawing.HIDING, label="hides pedestrians"),
        Line2D([], [], color=drawing.CONE, marker="^", linestyle="none", markersize=9, label="cone"),
        Line2D([], [], color=drawing.WORKER, marker="o", linestyle="none", markersize=9, label="person"),
        Line2D([], [], color=drawing.PERSON, marker="o", linestyle=(0, (4.0, 2.0)), label="pedestrian"),
    ]


def _scale_bar(axes: Axes, view: View) -> None:
    length_m = next(m for m in (200, 100, 50, 20, 10, 5, 2, 1) if m < 0.22 * view.width_m or m == 1)
    x_m, y_m = -view.width_m / 2.0 + 18.0 / view.scale, -view.height_m / 2.0 + 16.0 / view.scale
    halo: dict[str, Any] = {"color": "white", "linewidth": 6.0, "solid_capstyle": "butt", "alpha": 0.8}
    axes.plot([x_m, x_m + length_m], [y_m, y_m], **halo, zorder=20)
    axes.plot([x_m, x_m + length_m], [y_m, y_m], color=INK, linewidth=3.0, solid_capstyle="butt", zorder=21)
    axes.text(
        x_m, y_m + 6.0 / view.scale, f"{length_m} m", fontsize=10, color=INK, zorder=21,
        bbox={"facecolor": "white", "alpha": 0.6, "edgecolor": "none", "pad": 0.8},
    )  # fmt: skip


def _north(figure: Figure, turned_rad: float, total: int) -> None:
    """A small arrow to the north at the right of the upper view."""
    axes = figure.add_axes((1.0 - 52 / WIDTH, (total - TITLE - 52) / total, 44 / WIDTH, 44 / total))
    axes.set_axis_off()
    axes.set_xlim(-1.0, 1.0)
    axes.set_ylim(-1.0, 1.0)
    x, y = sin(turned_rad), cos(turned_rad)
    axes.annotate(
        "",
        xy=(0.85 * x, 0.85 * y),
        xytext=(-0.5 * x, -0.5 * y),
        arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 1.8},
    )
    axes.text(-0.75 * x, -0.75 * y, "N", fontsize=9, ha="center", va="center", color=INK)


def _figure(width: int, height: int) -> Figure:
    """An empty picture of this size in pixels; InputError without matplotlib."""
    need_matplotlib("a picture")
    from matplotlib.figure import Figure

    return Figure(figsize=(width / DPI, height / DPI), dpi=DPI)


def _save(figure: Figure, path: str | PathLike[str]) -> None:
    figure.set_facecolor("#ffffff")
    kind = Path(path).suffix.removeprefix(".").lower()
    if kind not in figure.canvas.get_supported_filetypes():
        raise InputError(f"{path}: pictures end in .png, .svg or .pdf")
    with writing(path):
        figure.savefig(path, metadata={"Software": None} if kind == "png" else None)


def _pieces(many: Sequence[Scenario], size: int) -> list[Sequence[Scenario]]:
    return [many[i : i + size] for i in range(0, len(many), size)]
