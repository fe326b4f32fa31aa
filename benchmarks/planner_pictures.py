"""What planners do: python -m benchmarks.planner_pictures RUN... --out planners.png [--scenarios nudge/0 ...]

Draws drives that run folders hold, seed 0: a block per scenario, a strip per
planner. The colour of the driven way is the time. Every `--every` seconds the
boxes of the ego and of all who move are drawn in that time's colour, so that
what has one colour was there at one time; a cross marks a collision by the
ego's fault. Needs the extra [plots].
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import cos, sin
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from interplan_sumo.batch.records import Row
from interplan_sumo.batch.run_folder import StoredRun, read_run
from interplan_sumo.maps.render import INK, PAPER
from interplan_sumo.maps.store import load_roads
from interplan_sumo.metrics.metric import failure_words
from interplan_sumo.report import scenario_drawing as drawing
from interplan_sumo.report.scenario_drawing import View
from interplan_sumo.scenario.route import route_centerline
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.suite import find_scenario, find_suite
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.trace import Trace

WIDTH = 1000
"""Pixels of a strip."""
HEIGHTS = (96, 260)
"""Least and largest height of a strip in pixels; where that is too little for a turn, all is drawn smaller."""
TITLE, GAP, FOOT, BLOCKS_BESIDE = 30, 6, 72, 2
BEFORE_M, BEYOND_M, ASIDE_M = 12.0, 45.0, 7.0
"""Shown before the start, beyond what is staged, and on both sides of all that is shown."""
DPI = 100
LONGEST_S = 30.0
TIMES = colormaps["turbo"]


@dataclass(frozen=True, eq=False)
class Drive:
    """A drive as a run folder holds it."""

    row: Row
    trace: Trace

    @property
    def verdict(self) -> str:
        """The planner, the score, and what cost most."""
        row = self.row
        words = f"{row.planner}: {100.0 * (row.score or 0.0):.0f}"
        if row.fault:
            return f"{words}, {row.fault.kind} fault"
        gates = [name for name in row.gates if row.judged[name] < 1.0]
        lost = [name for name in row.weights if row.judged[name] < 0.9]
        return ", ".join([words, *(failure_words(name) for name in gates or lost)])

    @property
    def contacts(self) -> list[dict[str, Any]]:
        """Collisions by the ego's fault, with their frames."""
        found = self.row.metrics.get("no_collision")
        return [contact for contact in found.detail.get("contacts", []) if contact["at_fault"]] if found else []


def drives(runs: Sequence[StoredRun], scenario_id: str, planners: Sequence[str]) -> list[Drive]:
    """Seed 0 of these planners on a scenario; of all, as the runs name them, where none is named."""
    wanted = planners or dict.fromkeys(planner for run in runs for planner in run.planners)
    rows = [(run, run.rows.get((scenario_id, planner, 0))) for planner in wanted for run in runs]
    return [Drive(row, Trace.read(run.path / row.trace)) for run, row in rows if row is not None and row.trace]


def view_of(scenario: Scenario, shown: Sequence[Drive]) -> View:
    """From the start to a little beyond what stands or walks there, or all of the way if nothing does."""
    roads = load_roads(scenario.map, scenario.maps_beside)
    poses = [obstacle.pose(roads) for obstacle in scenario.obstacles]
    poses += [place.pose(roads) for walker in scenario.jaywalkers for place in walker.places]
    line = route_centerline(roads, scenario)
    start, goal = scenario.start.pose(roads), scenario.goal.pose(roads)
    start_m, goal_m = (line.project_point(pose.x_m, pose.y_m)[0] for pose in (start, goal))
    if poses:
        staged = np.array([(pose.x_m, pose.y_m) for pose in poses])
        goal_m = min(float(line.project(staged)[0].max()) + BEYOND_M, goal_m)
    way = line.poses_at(np.linspace(start_m - BEFORE_M, goal_m, 50))[:, :2]
    heading_rad = float(np.arctan2(*(way[-1] - way[0])[::-1]))
    flat = View(0.0, 0.0, heading_rad, 1.0, 1.0, 1.0)
    low, high = flat.points(way).min(axis=0), flat.points(way).max(axis=0)
    for drive in shown:
        driven = flat.points(np.column_stack((drive.trace.ego.x_m, drive.trace.ego.y_m)))
        inside = driven[(driven[:, 0] > low[0]) & (driven[:, 0] < high[0])]
        low[1], high[1] = min(low[1], inside[:, 1].min()), max(high[1], inside[:, 1].max())
    wide_m, high_m = (high - low).tolist()
    scale = min(WIDTH / wide_m, HEIGHTS[1] / (high_m + 2.0 * ASIDE_M))
    height_m = max(high_m + 2.0 * ASIDE_M, HEIGHTS[0] / scale)
    middle_x, middle_y = (0.5 * (low + high)).tolist()
    c, s = cos(heading_rad), sin(heading_rad)
    return View(c * middle_x - s * middle_y, s * middle_x + c * middle_y, heading_rad, WIDTH / scale, height_m, scale)


def draw_strip(axes: Axes, scenario: Scenario, drive: Drive, view: View, every_s: float) -> None:
    """One drive, in a window on the map."""
    roads, trace = load_roads(scenario.map, scenario.maps_beside), drive.trace
    axes.set_facecolor(PAPER)
    axes.set(xlim=(-view.width_m / 2, view.width_m / 2), ylim=(-view.height_m / 2, view.height_m / 2))
    axes.set(xticks=[], yticks=[], autoscale_on=False)
    drawing.draw_roads(axes, roads, view)
    drawing.draw_route(axes, scenario, roads, view)
    drawing.draw_obstacles(axes, scenario, roads, view)
    way = view.points(np.column_stack((trace.ego.x_m, trace.ego.y_m)))
    at_s = 1e-6 * (trace.ego.time_us - trace.ego.time_us[0])
    pieces = np.stack((way[:-1], way[1:]), axis=1)
    axes.add_collection(LineCollection(list(pieces), colors=_colours(at_s[:-1]), linewidths=2.2, zorder=8.5))
    moved = _movers(trace)
    for k in _moments(at_s, every_s):
        actors = trace.actors.at(k)
        others = [corners for name, corners in zip(actors.ids, actors.corners, strict=True) if name in moved]
        for boxes, edge, order in ((others, INK, 7.4), ([trace.ego.corners(PACIFICA)[k]], "white", 9.0)):
            shapes = [view.points(box) for box in boxes]
            style: dict[str, Any] = {
                "edgecolor": edge,
                "linewidth": 0.5 if edge == INK else 1.3,
                "alpha": 0.8,
                "zorder": order,
            }
            axes.add_collection(PolyCollection(shapes, facecolor=_colours(at_s[k]), **style))
    for contact in drive.contacts:
        axes.plot(*way[contact["frame"]], marker="x", markersize=11, markeredgewidth=3, color="#b91c1c", zorder=9.5)
    label = {"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1.5}
    axes.text(0.006, 0.94, drive.verdict, transform=axes.transAxes, va="top", weight="bold", zorder=20, bbox=label)


def _movers(trace: Trace) -> set[str]:
    """Who is ever faster than 0.3 m/s; obstacles stand and are drawn as such."""
    speed_mps = np.hypot(trace.actors.vx_mps, trace.actors.vy_mps)
    return set(trace.actors.ids[speed_mps > 0.3].tolist())


def _moments(at_s: Floats, every_s: float) -> Iterator[int]:
    yield from (int(np.argmin(np.abs(at_s - t))) for t in np.arange(0.0, float(at_s[-1]) + 1e-6, every_s))


def _colours(time_s: Floats | float) -> Floats:
    return TIMES(0.05 + 0.9 * np.asarray(time_s) / LONGEST_S)


def picture(blocks: Sequence[tuple[Scenario, list[Drive]]], every_s: float) -> Figure:
    """All blocks, two beside one another."""
    views = [view_of(scenario, shown) for scenario, shown in blocks]
    strips = [round(view.height_m * view.scale) + GAP for view in views]
    tall = [TITLE + len(shown) * strip for (_, shown), strip in zip(blocks, strips, strict=True)]
    rows = [max(tall[i : i + BLOCKS_BESIDE]) for i in range(0, len(tall), BLOCKS_BESIDE)]
    width = BLOCKS_BESIDE * (WIDTH + 2 * GAP)
    height = sum(rows) + FOOT
    figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI, facecolor="white")
    for n, ((scenario, shown), view, strip) in enumerate(zip(blocks, views, strips, strict=True)):
        left = GAP + (n % BLOCKS_BESIDE) * (WIDTH + 2 * GAP)
        top = height - sum(rows[: n // BLOCKS_BESIDE])
        about = f"{scenario.id}   ({scenario.map}, {view.width_m:.0f} m wide)"
        figure.text(left / width, (top - 22) / height, about, fontsize=13, weight="bold", color=INK)
        for i, drive in enumerate(shown):
            bottom = top - TITLE - (i + 1) * strip + GAP
            axes = figure.add_axes((left / width, bottom / height, WIDTH / width, (strip - GAP) / height))
            draw_strip(axes, scenario, drive, view, every_s)
    bar = figure.add_axes((0.25, 48 / height, 0.5, 14 / height))
    shades = ScalarMappable(Normalize(0.0, LONGEST_S), TIMES.resampled(256))
    figure.colorbar(shades, cax=bar, orientation="horizontal", label=f"seconds; boxes every {every_s:g} s")
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN")
    parser.add_argument("--scenarios", nargs="+", help="default: one of each family, those of smoke==1")
    parser.add_argument("--planners", nargs="+", default=(), help="default: all that the runs hold")
    parser.add_argument("--every", type=float, default=4.0)
    parser.add_argument("--out", type=Path, default=Path("planners.png"))
    arguments = parser.parse_args()
    runs = [read_run(folder) for folder in arguments.runs]
    wanted = arguments.scenarios or [scenario.id for scenario in find_suite("smoke==1").scenarios]
    blocks = [(find_scenario(name), drives(runs, name, arguments.planners)) for name in wanted]
    picture(blocks, arguments.every).savefig(arguments.out)


if __name__ == "__main__":
    main()
