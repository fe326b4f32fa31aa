"""Shot: a drive as the camera of a film follows it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np
import shapely
from scipy.ndimage import gaussian_filter1d

from interplan_sumo.batch.stored_drive import StoredDrive
from interplan_sumo.maps.render import STOP_COLOURS
from interplan_sumo.report import scenario_drawing as drawing
from interplan_sumo.report.key_events import NOTHING, KeyEvent, deciding_moment
from interplan_sumo.report.replay.agents_timeline import standing_rows
from interplan_sumo.report.road_markings import signal_changes, status_at, stop_bars
from interplan_sumo.report.scenario_drawing import View
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.geometry import Floats, box_corners
from interplan_sumo.world.roads import StopLineKind
from interplan_sumo.world.signals import SignalStatus

if TYPE_CHECKING:
    from matplotlib.axes import Axes

AHEAD_M: Final = 14.0
"""The camera looks so far ahead of the ego."""
CALM_S: Final = 1.2
"""Standard deviation of the Gaussian that smooths the camera's way."""
NEAR_M: Final = 10.0
"""What is so far outside the view may still reach into it."""
PEOPLE: Final = "pedestrian"
PAINT: Final = {**STOP_COLOURS, StopLineKind.TRAFFIC_LIGHT: drawing.MARKING}
"""Colours of stop lines; what a light shows is drawn upon its own."""


@dataclass(frozen=True, eq=False)
class Shot:
    """A drive as the camera follows it."""

    drive: StoredDrive
    frames: Sequence[int]
    size_m: tuple[float, float]
    """Width and height of the view."""

    @cached_property
    def moment(self) -> KeyEvent:
        return deciding_moment(self.drive)

    @cached_property
    def turned_rad(self) -> float:
        """Map heading that points to the right: from the start to the goal."""
        scenario, roads = self.drive.scenario, self.drive.roads
        start, goal = scenario.start.pose(roads), scenario.goal.pose(roads)
        return float(np.arctan2(goal.y_m - start.y_m, goal.x_m - start.x_m))

    def _held(self, frame: int) -> int:
        return min(frame, len(self.drive.trace) - 1)

    @cached_property
    def way(self) -> Floats:
        """(N, 2) where the camera looks in each frame of the drive."""
        ego = self.drive.trace.ego
        ahead = AHEAD_M * np.array((np.cos(self.turned_rad), np.sin(self.turned_rad)))
        calm = CALM_S / self.drive.trace.dt_s
        return np.stack([gaussian_filter1d(v, calm, mode="nearest") for v in (ego.x_m, ego.y_m)], axis=1) + ahead

    @cached_property
    def whole(self) -> View:
        """All that the camera sees from the first to the last frame, at a pixel per metre."""
        flat = View(0.0, 0.0, self.turned_rad, 1.0, 1.0, 1.0)
        seen = flat.points(self.way[[self._held(frame) for frame in self.frames]])
        half_m = np.array(self.size_m) / 2.0
        return View.of_box(seen.min(axis=0) - half_m, seen.max(axis=0) + half_m, self.turned_rad)

    def view(self, frame: int, scale: float) -> View:
        x_m, y_m = self.way[self._held(frame)].tolist()
        return View(x_m, y_m, self.turned_rad, *self.size_m, scale)

    @cached_property
    def colours(self) -> dict[str, str]:
        names = {str(name) for name in self.drive.trace.actors.behaviour if name}
        return drawing.behaviour_colours(names) | {PEOPLE: drawing.PERSON}

    @cached_property
    def standing(self) -> set[str]:
        """Ids of what stays at its place: it is drawn with the road."""
        table = self.drive.trace.actors
        return set(table.ids[standing_rows(table)].tolist())

    def moving(self, frame: int, view: View) -> tuple[Actors, dict[str, str]]:
        """Who is in view and moves by itself, and the word that says the colour of each."""
        table, rows = self.drive.trace.actors, self.drive.trace.actors.rows(self._held(frame))
        actors = table.at(self._held(frame))
        words = [
            PEOPLE if kind == ActorKind.PEDESTRIAN and name not in self.standing else str(behaviour)
            for name, kind, behaviour in zip(
                actors.ids, actors.kind.tolist(), table.behaviour[rows].tolist(), strict=True
            )
        ]
        x_m, y_m = np.abs(view.points(np.stack((actors.x_m, actors.y_m), axis=1))).T
        near = (x_m < self.size_m[0] / 2.0 + NEAR_M) & (y_m < self.size_m[1] / 2.0 + NEAR_M)
        return actors, {actors.ids[row]: words[row] for row in np.flatnonzero(near) if words[row]}

    @cached_property
    def lights(self) -> list[tuple[shapely.Polygon, list[tuple[int, int]]]]:
        """The bars of lights that come into view, less what stands upon them, and the changes of each."""
        roads = self.drive.roads
        ends = stop_bars(roads, shapely.buffer(self.whole.outline, NEAR_M))
        changes = signal_changes(self.drive.trace, ends)
        poses = [(obstacle.pose(roads), obstacle.size_m) for obstacle in self.drive.scenario.obstacles]
        boxes = [box_corners(pose.x_m, pose.y_m, pose.heading_rad, *size_m)[0] for pose, size_m in poses]
        standing = shapely.union_all([shapely.Polygon(box) for box in boxes])
        return [
            (part, changes[connector])
            for connector in changes
            for part in shapely.get_parts(shapely.difference(drawing.light_bar(ends[connector]), standing))
        ]

    def shown(self, frame: int, view: View) -> list[tuple[shapely.Polygon, SignalStatus]]:
        """The bars of lights in view, and what each shows."""
        window, held = view.outline, self._held(frame)
        return [(bar, status_at(changes, held)) for bar, changes in self.lights if bar.intersects(window)]

    def draw_road(self, axes: Axes, view: View) -> None:
        """What stays the same: the map, the task and what stands on it."""
        roads, scenario = self.drive.roads, self.drive.scenario
        drawing.draw_roads(axes, roads, view, PAINT)
        drawing.draw_route(axes, scenario, roads, view)
        drawing.draw_obstacles(axes, scenario, roads, view)

    def draw_frame(self, axes: Axes, frame: int, view: View) -> None:
        """What the lights show, who moves, the ego's way so far, and its plan."""
        frame = self._held(frame)
        drawing.draw_lights(axes, self.shown(frame, view), view)
        ego, plans = self.drive.trace.ego, self.drive.trace.plans
        trail = view.points(np.stack((ego.x_m[: frame + 1], ego.y_m[: frame + 1]), axis=1))
        axes.plot(*trail.T, color=drawing.EGO, linewidth=1.6, alpha=0.45, zorder=4.0)
        if frame < len(plans):
            plan = view.points(np.stack((plans[frame].x_m, plans[frame].y_m), axis=1))
            axes.plot(*plan.T, color="white", linewidth=4.2, alpha=0.8, solid_capstyle="round", zorder=4.2)
            axes.plot(*plan.T, color=drawing.EGO, linewidth=2.2, solid_capstyle="round", zorder=4.3)
        actors, words = self.moving(frame, view)
        people = {name: word for name, word in words.items() if word == PEOPLE}
        drivers = {name: word for name, word in words.items() if word != PEOPLE}
        drawing.draw_agents(axes, actors, drivers, view, self.colours)
        drawing.draw_agents(axes, self._ego(frame), {"ego": "ego"}, view, {"ego": drawing.EGO})
        drawing.draw_agents(axes, actors, people, view, self.colours)

    def _ego(self, frame: int) -> Actors:
        """The ego as a row, so that it is drawn as everybody else."""
        ego, shape = self.drive.trace.ego, self.drive.trace.shape
        heading_rad, speed_mps = float(ego.heading_rad[frame]), float(ego.vx_mps[frame])
        columns = (
            float(ego.x_m[frame]), float(ego.y_m[frame]), heading_rad, shape.length_m, shape.width_m,
            speed_mps * np.cos(heading_rad), speed_mps * np.sin(heading_rad),
        )  # fmt: skip
        kind = np.array([ActorKind.VEHICLE], dtype=np.int8)
        return Actors(("ego",), kind, *(np.array([value]) for value in columns))

    def words(self, frame: int) -> tuple[str, str]:
        """The time and speed; what was lost, once it was."""
        held = self._held(frame)
        speed_mps = float(self.drive.trace.ego.vx_mps[held])
        said = f"{held * self.drive.trace.dt_s:4.1f} s   {3.6 * max(0.0, speed_mps):3.0f} km/h"
        lost = self.moment.metric != NOTHING and held >= self.moment.frame
        return said, self.moment.reason if lost else ""
