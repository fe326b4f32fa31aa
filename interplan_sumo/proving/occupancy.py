"""Occupancy: which places on a way are taken at a time, for an ego of each speed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.proving.course import GRID_M, Course
from interplan_sumo.proving.recording import Recording
from interplan_sumo.proving.ways import HALF_LENGTH_M, HALF_WIDTH_M, Way
from interplan_sumo.world.geometry import Floats, Ints

LEVEL_MPS, CELL_M = 0.5, 0.25
"""Speeds and places are multiples of these, so that constant accelerations of whole levels lead from one to another."""
FAR_M = 60.0
"""Nobody farther from the grid than this counts."""
BESIDE_M = 0.3
"""Room to vehicles beside the ego."""
FEET_M = 0.6
"""Room to pedestrians beside it."""
STILL_MPS = 0.05
ALONGSIDE_M = 0.5
"""Boxes that overlap by less than this follow one another."""
STOP_M = 0.5
"""The ego stops this far before a red light."""


_Box = tuple[float, float, float, float]
"""Near and far arc, right and left offset."""


@dataclass(frozen=True, slots=True)
class Margins:
    """How much room is kept."""

    front_m: float = 1.5
    front_s: float = 1.2
    """To whoever is ahead, on top: this time at the closing speed. The metric asks for more than 0.95 s."""
    rear_m: float = 1.5
    rear_s: float = 1.0
    """To whoever is behind in a lane that the ego enters."""
    comfort_s: float = 1.0
    """To whoever is ahead, where it costs nothing: this time at the own speed on top."""


@dataclass(frozen=True, slots=True)
class Grid:
    """Places from `arc_m` on, `CELL_M` apart, and speeds from 0 on, `LEVEL_MPS` apart."""

    arc_m: float
    cells: int
    levels: int

    @property
    def arcs_m(self) -> Floats:
        """(S,)"""
        return self.arc_m + CELL_M * np.arange(self.cells)

    @property
    def speeds_mps(self) -> Floats:
        """(V,)"""
        return LEVEL_MPS * np.arange(self.levels)


@dataclass(frozen=True, slots=True, eq=False)
class Queue:
    """Those ahead on a way from one time to another, by their order at the first: n of them."""

    passed: Ints
    """(S,) how many of them are not ahead of an ego at each place."""
    last_cell: Ints
    """(V, n + 1) the farthest place where an ego of each speed may be at the second time, with i of them passed."""
    last_comfortable_cell: Ints
    """(V, n + 1) the same with comfortable room."""


class Occupancy:
    """What is taken by a recording on each of some ways."""

    def __init__(
        self,
        course: Course,
        ways: tuple[Way, ...],
        others: Recording,
        red: Mapping[str, NDArray[np.bool_]],
        margins: Margins,
        grid: Grid,
    ) -> None:
        self._course, self._ways, self._others, self._margins, self.grid = course, ways, others, margins, grid
        self._lights = [
            [(self._stop_arc_m(lane), red[lane]) for lane in way.track.lanes if lane in red] for way in ways
        ]
        at = np.rint((grid.arcs_m - course.arc_m[0]) / GRID_M).astype(np.int64)
        at = np.clip(at, 0, len(course.arc_m) - 1)
        self._lefts = [way.left_m[at] for way in ways]
        self._slopes = [np.gradient(way.left_m, GRID_M)[at] for way in ways]
        fastest_m = LEVEL_MPS * grid.levels * margins.front_s
        self._aside_m = [np.abs(slope) * fastest_m for slope in self._slopes]
        self._in_way: dict[tuple[int, int], NDArray[np.bool_]] = {}
        self._queues: dict[tuple[int, int, int], Queue | None] = {}
        self._taken: dict[tuple[int, int, bool], NDArray[np.bool_] | None] = {}

    def _stop_arc_m(self, connector: str) -> float:
        arc, _, _ = self._course.unrolled(self._course.roads[connector].centerline.points[:1])
        return float(arc[0])

    # --- who is in the way ---------------------------------------------------------------------

    def _boxes(self, frame: int) -> tuple[Floats, Floats, Floats, Floats]:
        """Near, far, right and left (N,) at a frame, nan if absent."""
        others = self._others
        now = min(frame, others.frames - 1)
        return others.near_m[:, now], others.far_m[:, now], others.right_m[:, now], others.left_m[:, now]

    def in_way(self, way: int, frame: int) -> NDArray[np.bool_]:
        """(N,) who is in a way at a frame, or will be at once."""
        key = (way, frame)
        if key not in self._in_way:
            self._in_way[key] = self._find_in_way(self._ways[way], frame)
        return self._in_way[key]

    def _find_in_way(self, way: Way, frame: int) -> NDArray[np.bool_]:
        near, far, right, left = self._boxes(frame)
        shares = np.linspace(0.0, 1.0, 5)
        with np.errstate(invalid="ignore"):
            arcs = near[:, None] - 1.0 + shares * (far - near + 2.0)[:, None]
            cells = np.nan_to_num((arcs - self._course.arc_m[0]) / GRID_M, nan=0.0, posinf=0.0, neginf=0.0)
            here = way.left_m[np.clip(np.rint(cells).astype(np.int64), 0, len(way.left_m) - 1)]
            gone = np.isnan(here)
            lowest = np.where(gone, np.inf, here).min(axis=1, initial=np.inf)
            highest = np.where(gone, -np.inf, here).max(axis=1, initial=-np.inf)
            room = HALF_WIDTH_M + BESIDE_M
            return (left > lowest - room) & (right < highest + room)

    # --- what that takes -----------------------------------------------------------------------

    def queue(self, way: int, before: int, after: int) -> Queue | None:
        """Those who drive the ego's way on a way at both of two frames, and red lights; None if there are none."""
        key = (way, before, after)
        if key not in self._queues:
            self._queues[key] = self._find_queue(way, before, after)
        return self._queues[key]

    def _find_queue(self, way: int, before: int, after: int) -> Queue | None:
        others, margins, grid = self._others, self._margins, self.grid
        first, last = min(before, others.frames - 1), min(after, others.frames - 1)
        rows = np.flatnonzero(
            self.in_way(way, before) & self.in_way(way, after) & others.yields[:, first] & others.yields[:, last]
        )
        near_before, near_after = others.near_m[rows, first], others.near_m[rows, last]
        speed, least_m = others.along_mps[rows, last], np.full(len(rows), margins.front_m)
        for stop_m, red in self._lights[way]:
            if red[first : last + 1].any():
                near_before, near_after = np.append(near_before, stop_m), np.append(near_after, stop_m)
                speed, least_m = np.append(speed, np.inf), np.append(least_m, STOP_M)  # no time to collision with it
        if not len(speed):
            return None
        order = np.argsort(near_before, kind="stable")
        near_before, near_after, speed, least_m = (a[order] for a in (near_before, near_after, speed, least_m))
        passed = np.searchsorted(near_before, grid.arcs_m + HALF_LENGTH_M - ALONGSIDE_M, side="left")
        own = grid.speeds_mps[:, None]
        closing = np.maximum(0.0, own - speed)
        limit = near_after - HALF_LENGTH_M - least_m - margins.front_s * closing
        wish = limit - margins.comfort_s * own
        return Queue(passed, self._farthest(limit), self._farthest(wish))

    def _farthest(self, limit_m: Floats) -> Ints:
        """(V, n + 1) cells from limits (V, n): the least over those from the i-th on."""
        ahead = np.minimum.accumulate(limit_m[:, ::-1], axis=1)[:, ::-1]
        cells = np.floor((ahead - self.grid.arc_m) / CELL_M)
        free = np.full((len(cells), 1), float(self.grid.cells))
        return np.concatenate((np.clip(cells, -1.0, self.grid.cells), free), axis=1).astype(np.int64)

    def taken(self, way: int, frame: int, *, everyone: bool, before: int | None = None) -> NDArray[np.bool_] | None:
        """(V, S) where an ego of each speed would be too near to somebody at a frame; None if nowhere.

        Without `everyone` those are left out who drive the ego's way and did so on
        this way at the frame `before`: `queue` is about them.
        """
        key = (way, frame, everyone)
        if key not in self._taken:
            self._taken[key] = self._find_taken(way, frame, everyone, before)
        return self._taken[key]

    def _find_taken(self, way: int, frame: int, everyone: bool, before: int | None) -> NDArray[np.bool_] | None:
        others, grid = self._others, self.grid
        now = min(frame, others.frames - 1)
        follows = others.yields[:, now]
        there = self.in_way(way, frame)
        if everyone:
            counted = there | ~follows
        else:
            newcomers = there & ~self.in_way(way, before) if before is not None else there
            counted = (newcomers & follows) | ~follows
        near, far, right, left = self._boxes(frame)
        counted &= (near < grid.arc_m + CELL_M * grid.cells + FAR_M) & (far > grid.arc_m - FAR_M)
        rows = np.flatnonzero(counted)
        if not len(rows):
            return None
        taken = np.zeros((grid.levels, grid.cells), dtype=np.bool_)
        for row in rows.tolist():
            box = (float(near[row]), float(far[row]), float(right[row]), float(left[row]))
            along, across = float(others.along_mps[row, now]), float(others.across_mps[row, now])
            here = self._near(box, along)
            if here.start < here.stop:
                if follows[row]:
                    taken[:, here] |= self._followed(here, box, along)
                else:
                    room_m = FEET_M if others.walks[row] else BESIDE_M
                    here = self._beside(way, here, box, across, room_m)
                    if here.start < here.stop:
                        taken[:, here] |= self._met(way, here, box, along, across, room_m)
        return taken if taken.any() else None

    def _near(self, box: _Box, along_mps: float) -> slice:
        """The cells where the fastest ego may be too near to somebody."""
        margins, grid = self._margins, self.grid
        fastest = LEVEL_MPS * (grid.levels - 1)
        begin = box[0] - HALF_LENGTH_M - margins.front_m - margins.front_s * max(0.0, fastest - along_mps)
        end = box[1] + HALF_LENGTH_M + margins.rear_m + margins.rear_s * max(0.0, along_mps)
        first = int(np.clip(np.ceil((begin - grid.arc_m) / CELL_M), 0, grid.cells))
        return slice(first, int(np.clip(np.floor((end - grid.arc_m) / CELL_M) + 1, 0, grid.cells)))

    def _beside(self, way: int, here: slice, box: _Box, across_mps: float, room_m: float) -> slice:
        """Those of the cells from which the ego may come to be where somebody is."""
        reach_m = HALF_WIDTH_M + (box[3] - box[2]) / 2.0 + room_m + abs(across_mps) * self._margins.front_s
        reaches_m = reach_m + self._aside_m[way][here]
        rows = np.flatnonzero(np.abs(self._lefts[way][here] - (box[2] + box[3]) / 2.0) < reaches_m)
        return slice(here.start + int(rows[0]), here.start + int(rows[-1]) + 1) if len(rows) else slice(0, 0)

    def _followed(self, here: slice, box: _Box, along_mps: float) -> NDArray[np.bool_]:
        """(V, K) whether the ego is too near before or behind somebody who drives its way in its lane."""
        margins, own = self._margins, self.grid.speeds_mps[:, None]
        arcs = self.grid.arcs_m[here]
        begin = box[0] - HALF_LENGTH_M - margins.front_m - margins.front_s * np.maximum(0.0, own - along_mps)
        end = box[1] + HALF_LENGTH_M + margins.rear_m + margins.rear_s * np.maximum(0.0, along_mps - own)
        return (arcs >= begin) & (arcs <= end)

    def _met(
        self, way: int, here: slice, box: _Box, along_mps: float, across_mps: float, room_m: float
    ) -> NDArray[np.bool_]:
        """(V, K) whether the ego meets somebody soon if both go straight on from where they are."""
        margins, own = self._margins, self.grid.speeds_mps[:, None]
        arcs, lefts, slopes = self.grid.arcs_m[here], self._lefts[way][here], self._slopes[way][here]
        ahead_m = box[0] - margins.front_m - HALF_LENGTH_M - arcs
        behind_m = box[1] + margins.rear_m + HALF_LENGTH_M - arcs
        closing, aside = own - along_mps, slopes * own - across_mps
        half_m = HALF_WIDTH_M + (box[3] - box[2]) / 2.0 + room_m
        offset = lefts - (box[2] + box[3]) / 2.0
        with np.errstate(divide="ignore", invalid="ignore"):
            nearing = closing > STILL_MPS
            begin = np.where(nearing, ahead_m / closing, np.where(ahead_m <= 0.0, 0.0, np.inf))
            cease = np.where(nearing, behind_m / closing, np.where(behind_m >= 0.0, np.inf, -np.inf))
            one, two = (-half_m - offset) / aside, (half_m - offset) / aside
        straight, inside = np.abs(aside) < STILL_MPS, np.abs(offset) < half_m
        begin_beside = np.where(straight, np.where(inside, -np.inf, np.inf), np.minimum(one, two))
        cease_beside = np.where(straight, np.where(inside, np.inf, -np.inf), np.maximum(one, two))
        first = np.maximum(np.maximum(begin, begin_beside), 0.0)
        return first <= np.minimum(np.minimum(cease, cease_beside), margins.front_s)
