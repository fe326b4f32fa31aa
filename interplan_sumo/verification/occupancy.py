"""Occupancy: which places on a path are taken at a time, for an ego of each speed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.verification.corridor import GRID_M
from interplan_sumo.verification.drivable_paths import HALF_LENGTH_M, HALF_WIDTH_M, DrivablePath, held_back
from interplan_sumo.verification.planning_problem import Margins, PlanningProblem
from interplan_sumo.world.geometry import Floats, Ints

LEVEL_MPS, CELL_M = 0.5, 0.25
"""Speeds and places are multiples of these, so that constant accelerations of whole levels lead from one to another."""
FAR_M: Final = 60.0
"""Nobody farther from the grid than this counts."""
BESIDE_M: Final = 0.4
"""Room to vehicles beside the ego."""
FEET_M: Final = 0.7
"""Room to pedestrians beside it."""
STILL_MPS: Final = 0.05
"""Slower motion towards one another is none."""
ALONGSIDE_M: Final = 0.5
"""Boxes that overlap by less than this along the way follow one another."""
STOP_M: Final = 0.5
"""The ego stops this far before a red light."""
ROUNDING_M: Final = 1e-6


@dataclass(frozen=True, slots=True)
class SpeedGrid:
    """S places from `arc_m` on, `CELL_M` apart, and V speeds from 0 on, `LEVEL_MPS` apart."""

    arc_m: float
    cells: int
    levels: int

    @property
    def arcs_m(self) -> Floats:
        """(S,)"""
        return (self.arc_m + CELL_M * np.arange(self.cells)).astype(np.float64)

    @property
    def speeds_mps(self) -> Floats:
        """(V,)"""
        return (LEVEL_MPS * np.arange(self.levels)).astype(np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class LeaderQueue:
    """Those ahead on a path from one time to another, n of them, by their order at the first."""

    passed: Ints
    """(S,) how many of them are not ahead of an ego at each place."""
    last_cell: Ints
    """(V, n + 1) the farthest place where an ego of each speed may be at the second time, with i of them passed."""
    last_comfortable_cell: Ints
    """(V, n + 1) the same with comfortable room."""


@dataclass(frozen=True, slots=True)
class _Other:
    """Somebody at one instant, on the corridor."""

    near_m: float
    far_m: float
    right_m: float
    left_m: float
    along_mps: float
    across_mps: float
    room_m: float
    """To keep beside it."""


class PathOccupancy:
    """What is taken on each path of a problem; worked out when asked for, once."""

    def __init__(self, problem: PlanningProblem, margins: Margins, grid: SpeedGrid) -> None:
        self._problem, self._others, self._margins, self._grid = problem, problem.others, margins, grid
        self._arcs_m, self._speeds_mps = grid.arcs_m, grid.speeds_mps[:, None]
        self._fastest_mps = LEVEL_MPS * grid.levels
        corridor, paths = problem.corridor, problem.paths
        at = np.rint((self._arcs_m - corridor.arc_m[0]) / GRID_M).astype(np.int64)
        at = np.clip(at, 0, len(corridor.arc_m) - 1)
        self._lefts_m = [path.left_m[at] for path in paths]
        self._slopes = [held_back(np.gradient(path.left_m, GRID_M))[at] for path in paths]
        self._lefts_between_m = [_between(left_m) for left_m in self._lefts_m]
        self._steepest = [_between(np.abs(slope))[1] for slope in self._slopes]
        stops = {lane: corridor.unrolled(corridor.roads[lane].centerline.points[:1])[0][0] for lane in problem.red}
        self._lights = [
            [(float(stops[lane]), problem.red[lane]) for lane in path.lane_path.lanes if lane in stops]
            for path in paths
        ]
        self._in_way: dict[tuple[int, int], NDArray[np.bool_]] = {}
        self._queues: dict[tuple[int, int, int], LeaderQueue | None] = {}
        self._taken: dict[tuple[int, int, bool], NDArray[np.bool_] | None] = {}

    # --- who is in the way -----------------------------------------------------------------------

    def in_way(self, path: int, frame: int) -> NDArray[np.bool_]:
        """(N,) who is in the way on a path at a frame."""
        key = (path, frame)
        if key not in self._in_way:
            self._in_way[key] = self._find_in_way(self._problem.paths[path], min(frame, self._others.frames - 1))
        return self._in_way[key]

    def _find_in_way(self, path: DrivablePath, now: int) -> NDArray[np.bool_]:
        others, grid_m = self._others, self._problem.corridor.arc_m
        near, far = others.near_m[:, now], others.far_m[:, now]
        with np.errstate(invalid="ignore"):
            arcs = near[:, None] - 1.0 + np.linspace(0.0, 1.0, 5) * (far - near + 2.0)[:, None]
            at = np.nan_to_num((arcs - grid_m[0]) / GRID_M, nan=0.0)
        here = path.left_m[np.clip(np.rint(at).astype(np.int64), 0, len(grid_m) - 1)]
        gone = np.isnan(here)
        lowest = np.where(gone, np.inf, here).min(axis=1, initial=np.inf)
        highest = np.where(gone, -np.inf, here).max(axis=1, initial=-np.inf)
        room_m = HALF_WIDTH_M + BESIDE_M
        return (others.left_m[:, now] > lowest - room_m) & (others.right_m[:, now] < highest + room_m)

    # --- those ahead ---------------------------------------------------------------------------

    def queue(self, path: int, before: int, after: int) -> LeaderQueue | None:
        """Those who drive the ego's way on a path at both of two frames, and red lights; None if there are none."""
        key = (path, before, after)
        if key not in self._queues:
            self._queues[key] = self._find_queue(path, before, after)
        return self._queues[key]

    def _find_queue(self, path: int, before: int, after: int) -> LeaderQueue | None:
        others, margins, own = self._others, self._margins, self._speeds_mps
        first, last = min(before, others.frames - 1), min(after, others.frames - 1)
        follow = others.follows[:, first] & others.follows[:, last]
        rows = np.flatnonzero(self.in_way(path, before) & self.in_way(path, after) & follow)
        near_before, near_after = others.near_m[rows, first], others.near_m[rows, last]
        speed, least_m = others.along_mps[rows, last], np.full(len(rows), margins.front_m)
        for stop_m, red in self._lights[path]:
            if red[first : last + 1].any():
                near_before, near_after = np.append(near_before, stop_m), np.append(near_after, stop_m)
                speed, least_m = np.append(speed, np.inf), np.append(least_m, STOP_M)  # no time to collision with it
        if not len(speed):
            return None
        order = np.argsort(near_before, kind="stable")
        near_before, near_after, speed, least_m = (a[order] for a in (near_before, near_after, speed, least_m))
        passed = np.searchsorted(near_before, self._arcs_m + HALF_LENGTH_M - ALONGSIDE_M, side="left")
        limit_m = near_after - HALF_LENGTH_M - least_m - margins.front_s * np.maximum(0.0, own - speed)
        wish_m = limit_m - margins.comfort_s * own
        return LeaderQueue(passed.astype(np.int64), self._farthest(limit_m), self._farthest(wish_m))

    def _farthest(self, limit_m: Floats) -> Ints:
        """(V, n + 1) cells from limits (V, n): the least over those from the i-th on."""
        ahead = np.minimum.accumulate(limit_m[:, ::-1], axis=1)[:, ::-1]
        cells = np.floor((ahead - self._grid.arc_m) / CELL_M)
        free = np.full((len(cells), 1), float(self._grid.cells))
        return np.concatenate((np.clip(cells, -1.0, self._grid.cells), free), axis=1).astype(np.int64)

    # --- all who are near ----------------------------------------------------------------------

    def taken(self, path: int, frame: int, *, everyone: bool, before: int | None = None) -> NDArray[np.bool_] | None:
        """(V, S) where an ego of each speed would be too near to somebody at a frame; None if nowhere.

        Without `everyone` those are left out who drive the ego's way and did so on
        this path at the frame `before`: `queue` is about them.
        """
        key = (path, frame, everyone)
        if key not in self._taken:
            self._taken[key] = self._find_taken(path, frame, everyone, before)
        return self._taken[key]

    def _find_taken(self, path: int, frame: int, everyone: bool, before: int | None) -> NDArray[np.bool_] | None:
        others, grid = self._others, self._grid
        now = min(frame, others.frames - 1)
        follows = others.follows[:, now]
        counted = self.in_way(path, frame)
        if not everyone and before is not None:
            counted = counted & ~self.in_way(path, before)
        end_m = grid.arc_m + CELL_M * grid.cells
        with np.errstate(invalid="ignore"):
            there = (others.near_m[:, now] < end_m + FAR_M) & (others.far_m[:, now] > grid.arc_m - FAR_M)
        rows = np.flatnonzero(((counted & follows) | (~follows & ~self._far_aside(path, now))) & there)
        taken = np.zeros((grid.levels, grid.cells), dtype=np.bool_)
        for row, begin, end in zip(rows.tolist(), *self._within_reach(rows, now), strict=True):
            here = slice(begin, end)
            if begin >= end:
                continue
            other = self._other(row, now)
            if not follows[row]:
                here = self._beside(path, here, other)
            if here.start < here.stop:
                taken[:, here] |= self._followed(here, other) if follows[row] else self._met(path, here, other)
        return taken if taken.any() else None

    def _other(self, row: int, now: int) -> _Other:
        others = self._others
        return _Other(
            near_m=float(others.near_m[row, now]),
            far_m=float(others.far_m[row, now]),
            right_m=float(others.right_m[row, now]),
            left_m=float(others.left_m[row, now]),
            along_mps=float(others.along_mps[row, now]),
            across_mps=float(others.across_mps[row, now]),
            room_m=FEET_M if others.walks[row] else BESIDE_M,
        )

    def _within_reach(self, rows: Ints, now: int) -> tuple[list[int], list[int]]:
        """Where the cells begin and end, (K,) each, where even the fastest ego may be too near to somebody."""
        others, margins, grid = self._others, self._margins, self._grid
        along_mps = others.along_mps[rows, now]
        closing_mps = np.maximum(0.0, self._fastest_mps - along_mps)
        begin_m = others.near_m[rows, now] - HALF_LENGTH_M - margins.front_m - margins.front_s * closing_mps
        rear_s = margins.rear_s + margins.rear_headway_s
        end_m = others.far_m[rows, now] + HALF_LENGTH_M + margins.rear_m + rear_s * np.maximum(0.0, along_mps)
        first, last = np.ceil((begin_m - grid.arc_m) / CELL_M), np.floor((end_m - grid.arc_m) / CELL_M)
        begin, end = (np.clip(each, 0, grid.cells).astype(np.int64).tolist() for each in (first, last + 1))
        return begin, end

    def _far_aside(self, path: int, now: int) -> NDArray[np.bool_]:
        """(N,) who is so far beside all of a path that `_beside` finds no cell."""
        others = self._others
        right_m, left_m = others.right_m[:, now], others.left_m[:, now]
        half_m = HALF_WIDTH_M + (left_m - right_m) / 2.0 + np.where(others.walks, FEET_M, BESIDE_M)
        aside_mps = self._steepest[path] * self._fastest_mps + np.abs(others.across_mps[:, now])
        lowest_m, highest_m = self._lefts_between_m[path]
        middle_m = (right_m + left_m) / 2.0
        offset_m = np.maximum(lowest_m - middle_m, middle_m - highest_m)
        return offset_m > half_m + self._margins.front_s * aside_mps + ROUNDING_M

    def _beside(self, path: int, here: slice, other: _Other) -> slice:
        """Those of the cells from which the ego may come to be where somebody is who does not drive its way."""
        half_m = HALF_WIDTH_M + (other.left_m - other.right_m) / 2.0 + other.room_m
        aside_mps = np.abs(self._slopes[path][here]) * self._fastest_mps + abs(other.across_mps)
        offset_m = np.abs(self._lefts_m[path][here] - (other.right_m + other.left_m) / 2.0)
        rows = np.flatnonzero(offset_m < half_m + self._margins.front_s * aside_mps)
        return slice(here.start + int(rows[0]), here.start + int(rows[-1]) + 1) if len(rows) else slice(0, 0)

    def _followed(self, here: slice, other: _Other) -> NDArray[np.bool_]:
        """(V, K) whether the ego is too near before or behind somebody who drives its way."""
        margins, own, arcs_m = self._margins, self._speeds_mps, self._arcs_m[here]
        front_m = HALF_LENGTH_M + margins.front_m + margins.front_s * np.maximum(0.0, own - other.along_mps)
        rear_m = HALF_LENGTH_M + margins.rear_m + margins.rear_s * np.maximum(0.0, other.along_mps - own)
        rear_m += margins.rear_headway_s * max(0.0, other.along_mps)
        return (arcs_m >= other.near_m - front_m) & (arcs_m <= other.far_m + rear_m)

    def _met(self, path: int, here: slice, other: _Other) -> NDArray[np.bool_]:
        """(V, K) whether the ego meets somebody soon if both go straight on from where they are."""
        margins, own, arcs_m = self._margins, self._speeds_mps, self._arcs_m[here]
        ahead_m = other.near_m - margins.front_m - HALF_LENGTH_M - arcs_m
        behind_m = other.far_m + margins.rear_m + HALF_LENGTH_M - arcs_m
        offset_m = self._lefts_m[path][here] - (other.right_m + other.left_m) / 2.0
        half_m = HALF_WIDTH_M + (other.left_m - other.right_m) / 2.0 + other.room_m
        closing, aside = own - other.along_mps, self._slopes[path][here] * own - other.across_mps
        nearing, straight = closing > STILL_MPS, np.abs(aside) < STILL_MPS
        with np.errstate(divide="ignore", invalid="ignore"):
            begin = np.where(nearing, ahead_m / closing, np.where(ahead_m <= 0.0, 0.0, np.inf))
            cease = np.where(nearing, behind_m / closing, np.where(behind_m >= 0.0, np.inf, -np.inf))
            one, two = (-half_m - offset_m) / aside, (half_m - offset_m) / aside
        inside = np.abs(offset_m) < half_m
        begin_beside = np.where(straight, np.where(inside, -np.inf, np.inf), np.minimum(one, two))
        cease_beside = np.where(straight, np.where(inside, np.inf, -np.inf), np.maximum(one, two))
        first = np.maximum(np.maximum(begin, begin_beside), 0.0)
        return first <= np.minimum(np.minimum(cease, cease_beside), margins.front_s)


def _between(values: Floats) -> tuple[float, float]:
    """The least and the greatest of those that exist; infinite where there are none."""
    exists = np.isfinite(values)
    return float(values.min(where=exists, initial=np.inf)), float(values.max(where=exists, initial=-np.inf))
