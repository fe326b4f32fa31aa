"""The drawing ground of a plan: from stations and outward distances to lines and surfaces on the ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from interplan_sumo.world.geometry import Floats, Polyline, Pose
from tools.make_maps.geometry import SmoothCurve, beside
from tools.make_maps.layout import Arm, Block
from tools.make_maps.plan import Direction, Plan, Road, kerb_side

DECIMALS = 6
"""Coordinates are rounded to a micrometre: the same on every machine, and shared corners stay shared."""
STRAIGHT_SINE = 1e-5
"""Vertices of edges that bend less are left out; centre lines keep all theirs."""


@dataclass(frozen=True)
class RoadGeometry:
    """A plan with its frame."""

    plan: Plan

    def side(self, direction: Direction) -> float:
        """+1 where outward of this direction is to the left of the axis, else -1."""
        return kerb_side(self.plan, direction)

    def on_map(self, points: Floats) -> Floats:
        """Local points in map coordinates."""
        return np.round(points + np.array(self.plan.origin_m), DECIMALS)

    def centerline(self, points: Floats) -> Polyline:
        return Polyline(self.on_map(points))

    def edge(self, points: Floats) -> Polyline:
        """A boundary: without the vertices that a straight does not need."""
        return Polyline(_thinned(self.on_map(points)))

    def along(
        self, road: Road, direction: Direction, from_m: float, to_m: float, from_outward_m: float, to_outward_m: float
    ) -> SmoothCurve:
        """The line in the direction of travel from one grid station to another, gliding between two offsets."""
        side = self.side(direction)
        stations = road.axis.grid_between(min(from_m, to_m), max(from_m, to_m))
        if direction == "forward":
            return beside(road.axis, stations, side * from_outward_m, side * to_outward_m)
        return beside(road.axis, stations, side * to_outward_m, side * from_outward_m).reversed()

    def pose(self, block: Block, outward_m: float, *, at_end: bool) -> Pose:
        """The pose of travel at an end of a block."""
        road = self.plan.road[block.road]
        station_m = block.to_m if at_end else block.from_m
        pose = road.axis.pose(station_m, self.side(block.direction) * outward_m)
        turned = 0.0 if block.direction == "forward" else np.pi
        return Pose(pose.x_m, pose.y_m, pose.heading_rad + turned)

    def left_to_right(self, count: int) -> Sequence[int]:
        """Lanes counted from the inner one, in order from left to right."""
        return range(count) if self.plan.driving_side == "right" else range(count)[::-1]

    def left_edge_first(self, inner: Floats, kerb: Floats) -> tuple[Floats, Floats]:
        """The inner and the kerb edge of a strip as its left and right edge."""
        return (inner, kerb) if self.plan.driving_side == "right" else (kerb, inner)

    def arm_edges_m(self, arm: Arm) -> tuple[float, float]:
        """Offsets of an arm's outer lane edges, to the left of the axis: the lower and the higher one."""
        edges = [
            self.side(block.direction) * outward
            for block in (arm.arriving, arm.leaving)
            if block is not None
            for outward in (block.strips[0].inner_m, block.strips[-1].kerb_m)
        ]
        return min(edges), max(edges)

    def across(self, road: Road, low_m: float, high_m: float, right_m: float, left_m: float) -> shapely.Polygon:
        """The band between two stations (any, not only of the grid) and two offsets to the left of the axis."""
        inside = road.axis.grid_m[(road.axis.grid_m > low_m + 1e-6) & (road.axis.grid_m < high_m - 1e-6)]
        stations = np.concatenate(([low_m], inside, [high_m]))
        poses = road.axis.poses(stations)
        curve = SmoothCurve(poses[:, :2], poses[:, 2])
        return self.surface(curve.shifted(left_m), curve.shifted(right_m))

    def surface(self, left: Floats, right: Floats) -> shapely.Polygon:
        """The area between two local lines of equal direction."""
        return between(_thinned(self.on_map(left)), _thinned(self.on_map(right)))


def between(left: Floats, right: Floats) -> shapely.Polygon:
    """The area between two lines of equal direction, in map coordinates."""
    return shapely.Polygon(np.concatenate((left, right[::-1])))


def _thinned(points: Floats) -> Floats:
    steps = np.diff(points, axis=0)
    length = np.hypot(steps[:, 0], steps[:, 1])
    keep_step = length > 1e-9
    points = points[np.concatenate(([True], keep_step))]
    unit = steps[keep_step] / length[keep_step][:, None]
    bends = np.abs(unit[:-1, 0] * unit[1:, 1] - unit[:-1, 1] * unit[1:, 0]) > STRAIGHT_SINE
    return points[np.concatenate(([True], bends, [True]))]
