"""Timing: when to be where on which way, so that nobody who was recorded is met.

A shortest-path search over (time, way, place, speed) in steps of 1 s. On one
way only what is ahead counts: whoever drives the ego's way stays behind it
once it is in front. Where the ego changes lane or swerves, and against
everybody who does not drive its way, all who are near count.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.proving.course import GRID_M, Course
from interplan_sumo.proving.occupancy import CELL_M, LEVEL_MPS, Grid, Margins, Occupancy
from interplan_sumo.proving.recording import Recording
from interplan_sumo.proving.ways import Way
from interplan_sumo.world.geometry import Floats, Ints

STEP_FRAMES = 10
"""1 s: a speed of n levels and an acceleration of k levels lead 2 n + k cells on."""
ACCELERATIONS = (0, 1, -1, 2, -2, 3, -3, -4, -5, -6, -7)
"""Levels per step, that is up to 1.5 and down to -3.5 m/s2. Of equally good ones the first wins."""
CHANGE_ACCELERATIONS = (0, 1, -1)
LATER_PUSH = 4
"""A timing that begins on the way does not begin with more levels: it would be felt as a jerk."""


@dataclass(frozen=True, slots=True)
class Pace:
    """How lively one drives."""

    first_push: int
    """Levels of acceleration or braking in the first second: comfort is judged from the first frame on."""
    changes: tuple[tuple[float, float, int], ...]
    """Speeds from and to (m/s), and how many seconds a lane change takes at them."""


CALM_PACE = Pace(2, ((5.0, np.inf, 4), (2.5, 5.0, 5)))
FIRM_PACE = Pace(4, CALM_PACE.changes)
QUICK_PACE = Pace(7, ((9.0, np.inf, 3), (5.0, 9.0, 4), (2.5, 5.0, 5)))
"""Lane changes as quick as comfort allows; going straight on for a moment, one then may come near whoever is two lanes
over."""
LEFT_AFTER = 0.6
"""After this share of a lane change nothing in the old lane matters any more."""
THINNED = 4
"""Lane changes begin on the best of so many neighbouring cells."""
TOLERANCE_MPS = 0.1
"""A cap is kept to within this."""

SPEED_COST, PUSH_COST, NEAR_COST, CHANGE_COST, ASIDE_COST = 1.0, 0.1, 0.3, 0.4, 0.04
"""Per second: standing; 1 level of acceleration, squared, over 4; too near to somebody; per lane change; not in the
goal lane."""


@dataclass(frozen=True, slots=True)
class Change:
    """A lane change: where it begins and ends."""

    from_m: float
    to_m: float
    way: int
    """The new one."""


@dataclass(frozen=True, slots=True, eq=False)
class Timing:
    """Where to be when: knots 1 s apart, constant acceleration between them."""

    frame: int
    """Of the first knot."""
    arc_m: Floats  # (K,)
    speed_mps: Floats  # (K,)
    way: int
    """On which it begins."""
    changes: tuple[Change, ...]
    cost: float
    to_goal: bool
    """Whether it gets to the goal."""


@dataclass(frozen=True, slots=True)
class Start:
    """Where a search begins."""

    frame: int
    arc_m: float
    speed_mps: float
    way: int


@dataclass(frozen=True, slots=True)
class Gate:
    """When the ego passes a place: in step number `step`, counted from 0."""

    arc_m: float
    step: int


def timing(
    course: Course,
    ways: tuple[Way, ...],
    others: Recording,
    red: Mapping[str, NDArray[np.bool_]],
    start: Start,
    frames: int,
    margins: Margins,
    pace: Pace,
    gate: Gate | None = None,
) -> Timing | None:
    """The cheapest timing to the goal before frame `frames`, or as far as one gets; None if there is none.

    It ends in the goal lane. `red` tells for each connector with a light in
    which frames one must not enter.
    """
    return _Search(course, ways, others, red, start, frames, margins, pace, gate).result()


_CHANGE_CODE = 100


@dataclass(frozen=True, slots=True, eq=False)
class _Move:
    """One acceleration on one way: where each place and speed (V, S) is reached from."""

    k: int
    """Levels per step."""
    at: Ints
    """Flat index of the source; one beyond the last where there is none."""
    source: Ints
    """Its cell."""
    halfway: Ints
    """Flat index half a second before the end."""
    cost: Floats  # (V, 1)


class _Search:
    def __init__(
        self,
        course: Course,
        ways: tuple[Way, ...],
        others: Recording,
        red: Mapping[str, NDArray[np.bool_]],
        start: Start,
        frames: int,
        margins: Margins,
        pace: Pace,
        gate: Gate | None,
    ) -> None:
        self._course, self._ways, self._start, self._pace = course, ways, start, pace
        self._steps = (frames - 1 - start.frame) // STEP_FRAMES
        begin = round(start.speed_mps / LEVEL_MPS)
        top = max(float(np.max(way.cap_mps[np.isfinite(way.left_m)], initial=0.0)) for way in ways)
        self._levels = max(int((top + TOLERANCE_MPS) / LEVEL_MPS), begin) + 1
        self._begin = begin
        self._gate = gate
        self._goal = int(np.ceil((course.goal_m - start.arc_m) / CELL_M)) + 1
        self._cells = self._goal + 2 * self._levels + 2
        grid = Grid(start.arc_m, self._cells, self._levels)
        self._occupancy = Occupancy(course, ways, others, red, margins, grid)
        self._gate_cell = 0 if gate is None else int((gate.arc_m - start.arc_m) / CELL_M)
        at = np.rint((grid.arcs_m - course.arc_m[0]) / GRID_M).astype(np.int64)
        at = np.clip(at, 0, len(course.arc_m) - 1)
        speeds = grid.speeds_mps[:, None]
        self._open = [
            speeds <= np.where(way.closed, -1.0, np.maximum(way.cap_mps, 0.0))[at] + TOLERANCE_MPS for way in ways
        ]
        self._walls = [np.concatenate(([0], np.cumsum(way.closed[at]))) for way in ways]
        self._swerving = [way.swerving[at] for way in ways]
        self._parted = {
            (p, q): np.concatenate(([0], np.cumsum(~course.neighbours(p, q)[at])))
            for p in range(len(ways))
            for q in range(len(ways))
            if p != q and course.neighbours(p, q)[at].any()
        }
        self._aside = self._lanes_to_goal()
        self._costs: dict[tuple[int, int], Floats] = {}
        self._codes: dict[tuple[int, int], NDArray[np.int32]] = {}
        self._changes: list[tuple[int, int, int, int]] = []  # from way, to way, seconds, acceleration
        self._moves = [self._move(k) for k in ACCELERATIONS]

    def _move(self, k: int) -> _Move:
        rows, cols = np.arange(self._levels)[:, None], np.arange(self._cells)
        level, cell = rows - k, cols - (2 * rows - k)
        real = (level >= 0) & (level < self._levels) & (cell >= 0) & (cell < self._cells)
        source = np.clip(cell, 0, self._cells - 1)
        middle = np.clip(cols - (4 * rows - k + 2) // 4, 0, None)  # half a second back: (3 v' + v) / 8 of a second
        halfway = np.clip(rows - k // 2, 0, self._levels - 1) * self._cells + middle
        cost = SPEED_COST * (1.0 - (rows - k / 2.0) / max(self._levels - 1, 1)) + PUSH_COST * (k / 2.0) ** 2
        return _Move(k, np.where(real, level * self._cells + source, self._levels * self._cells), source, halfway, cost)

    def _lanes_to_goal(self) -> list[int]:
        """Lane changes left per way; -1 where the goal lane cannot be reached."""
        left = [0 if way.track.at_goal else -1 for way in self._ways]
        for distance in range(1, len(left)):
            for p, q in self._parted:
                if left[q] == distance - 1 and left[p] < 0:
                    left[p] = distance
        return left

    # --- the search ----------------------------------------------------------------------------

    def result(self) -> Timing | None:
        shape = (self._levels, self._cells)
        self._empty = np.full(shape, np.inf)
        first = self._empty.copy()
        first[self._begin, 0] = 0.0
        self._costs[0, self._start.way] = first
        best: tuple[float, int, int, int, int] | None = None  # cost, step, way, level, cell
        for step in range(self._steps):
            ways = [p for p in range(len(self._ways)) if (step, p) in self._costs and self._aside[p] >= 0]
            for p in ways:
                self._change_lane(step, p)
            for p in ways:
                self._go_on(step, p)
            best = self._absorb(step + 1, best)
            if best is not None and best[0] <= self._least(step + 1):
                break
        to_goal = best is not None
        if best is None:
            best = self._farthest()
        return None if best is None else self._traced(best, to_goal=to_goal)

    def _arrival(self, step: int, way: int) -> tuple[Floats, NDArray[np.int32]]:
        key = (step, way)
        if key not in self._costs:
            self._costs[key] = self._empty.copy()
        if key not in self._codes:
            self._codes[key] = np.zeros(self._empty.shape, dtype=np.int32)
        return self._costs[key], self._codes[key]

    def _least(self, step: int) -> float:
        return min((float(cost.min()) for (at, _), cost in self._costs.items() if at >= step), default=np.inf)

    def _absorb(
        self, step: int, best: tuple[float, int, int, int, int] | None
    ) -> tuple[float, int, int, int, int] | None:
        """Take note of who passed the goal, and take them off the grid."""
        for p in range(len(self._ways)):
            cost = self._costs.get((step, p))
            if cost is None:
                continue
            beyond = cost[:, self._goal :]
            if self._aside[p] == 0:
                at = int(np.argmin(beyond))
                level, cell = divmod(at, beyond.shape[1])
                if beyond[level, cell] < (best[0] if best is not None else np.inf):
                    best = (float(beyond[level, cell]), step, p, level, cell + self._goal)
            beyond[:] = np.inf
        return best

    def _farthest(self) -> tuple[float, int, int, int, int] | None:
        """The best end short of the goal."""
        left_s = (self._goal - np.arange(self._cells)) * CELL_M / (LEVEL_MPS * max(self._levels - 1, 1))
        best: tuple[float, int, int, int, int] | None = None
        for p in range(len(self._ways)):
            cost = self._costs.get((self._steps, p))
            if cost is None or self._aside[p] != 0:
                continue
            total = cost + left_s
            level, cell = divmod(int(np.argmin(total)), self._cells)
            if total[level, cell] < (best[0] if best is not None else np.inf):
                best = (float(total[level, cell]), self._steps, p, level, cell)
        return best

    def _go_on(self, step: int, way: int) -> None:
        """One step on the same way, at every acceleration."""
        before = self._start.frame + step * STEP_FRAMES
        cost = self._costs[step, way]
        reached = np.flatnonzero(np.isfinite(cost).any(axis=0))
        if not len(reached):
            return
        end = min(int(reached[-1]) + 2 * self._levels + 1, self._cells)
        padded = np.concatenate((cost.ravel(), [np.inf]))
        arrival, codes = (table[:, :end] for table in self._arrival(step + 1, way))
        allowed = self._open[way][:, :end] & ~self._blocked(way, before, before + STEP_FRAMES)[:, :end]
        if self._gate is not None and step < self._gate.step:
            allowed[:, max(self._gate_cell + 1, 0) :] = False
        elif self._gate is not None:
            allowed[:, : max(self._gate_cell + 1, 0)] = False
        halfway = (self._open[way] & ~self._blocked(way, before, before + STEP_FRAMES // 2)).ravel()
        queue = self._occupancy.queue(way, before, before + STEP_FRAMES)
        walls, rows, cols = self._walls[way], np.arange(self._levels)[:, None], np.arange(end)
        hardest = max(map(abs, ACCELERATIONS))
        if step == 0:
            hardest = self._pace.first_push if before == 0 else max(self._pace.first_push, LATER_PUSH)
        for code, move in enumerate(self._moves):
            if abs(move.k) > hardest:
                continue
            source = move.source[:, :end]
            total = padded[move.at[:, :end]] + (move.cost + ASIDE_COST * self._aside[way])
            possible = allowed & halfway[move.halfway[:, :end]] & (walls[cols + 1] == walls[source])
            if queue is not None:
                passed = queue.passed[source] + rows * queue.last_cell.shape[1]
                possible &= cols <= queue.last_cell.ravel()[passed]
                total += NEAR_COST * (cols > queue.last_comfortable_cell.ravel()[passed])
            better = possible & (total < arrival)
            np.copyto(arrival, total, where=better)
            np.copyto(codes, code, where=better)

    def _blocked(self, way: int, before: int, after: int) -> NDArray[np.bool_]:
        """(V, S) taken by those of whom the queue does not tell, and in a swerve by anybody."""
        others = self._occupancy.taken(way, after, everyone=False, before=before)
        blocked = np.zeros(self._empty.shape, dtype=np.bool_) if others is None else others.copy()
        if self._swerving[way].any():
            everyone = self._occupancy.taken(way, after, everyone=True)
            if everyone is not None:
                blocked |= everyone & self._swerving[way]
        return blocked

    def _change_lane(self, step: int, way: int) -> None:
        """Lane changes to all neighbours, from the best of every few cells."""
        for other in range(len(self._ways)):
            if (way, other) not in self._parted or self._aside[other] < 0:
                continue
            cost = self._costs[step, way]
            count = self._cells // THINNED
            groups = cost[:, : count * THINNED].reshape(self._levels, count, THINNED)
            cell = np.arange(count) * THINNED + groups.argmin(axis=2)
            level = np.broadcast_to(np.arange(self._levels)[:, None], cell.shape)
            least = np.take_along_axis(cost, cell, axis=1)
            finite = np.isfinite(least)
            for slowest, fastest, seconds in self._pace.changes:
                speeds = LEVEL_MPS * level
                chosen = finite & (speeds >= slowest) & (speeds < fastest)
                if step + seconds <= self._steps and chosen.any():
                    for k in CHANGE_ACCELERATIONS:
                        self._try_change(step, way, other, seconds, k, level[chosen], cell[chosen], least[chosen])

    def _try_change(
        self, step: int, way: int, other: int, seconds: int, k: int, level: Ints, cell: Ints, cost: Floats
    ) -> None:
        """One kind of lane change from many places at once."""
        end_level, end_cell = level + k * seconds, cell + seconds * 2 * level + k * seconds**2
        parted, walls = self._parted[way, other], self._walls
        possible = (end_level >= 4) & (end_level < self._levels) & (end_cell < self._goal)
        level, cell, cost, end_level, end_cell = (a[possible] for a in (level, cell, cost, end_level, end_cell))
        left = cell + ((end_cell - cell) * LEFT_AFTER).astype(np.int64)
        possible = (parted[end_cell + 1] == parted[cell]) & (walls[other][end_cell + 1] == walls[other][cell])
        possible &= walls[way][left + 1] == walls[way][cell]
        top = max(self._levels - 1, 1)
        total = cost + CHANGE_COST + SPEED_COST * seconds * (1.0 - (level + end_level) / 2.0 / top)
        total += PUSH_COST * seconds * (k / 2.0) ** 2 + ASIDE_COST * seconds * max(self._aside[way], self._aside[other])
        for i in range(1, seconds + 1):
            after = self._start.frame + (step + i) * STEP_FRAMES
            now_level, now_cell = level + k * i, cell + i * 2 * level + k * i * i
            before_cell = cell + (i - 1) * 2 * level + k * (i - 1) ** 2
            possible &= self._open[other][now_level, now_cell]
            taken = self._occupancy.taken(other, after, everyone=True)
            if taken is not None:
                possible &= ~taken[now_level, now_cell]
            if i <= LEFT_AFTER * seconds + 0.5:
                possible &= self._open[way][now_level, now_cell]
                queue = self._occupancy.queue(way, after - STEP_FRAMES, after)
                if queue is not None:
                    possible &= now_cell <= queue.last_cell[now_level, queue.passed[before_cell]]
            if not possible.any():
                return
        arrival, codes = self._arrival(step + seconds, other)
        at = end_level * self._cells + end_cell
        possible &= total < arrival.ravel()[at]
        rows = np.flatnonzero(possible)
        rows = rows[np.argsort(-total[rows], kind="stable")]  # of several that end alike the cheapest is written last
        self._changes.append((way, other, seconds, k))
        np.put(arrival, at[rows], total[rows])
        np.put(codes, at[rows], _CHANGE_CODE + len(self._changes) - 1)

    # --- the answer ----------------------------------------------------------------------------

    def _traced(self, end: tuple[float, int, int, int, int], *, to_goal: bool) -> Timing:
        cost, step, way, level, cell = end
        cells, levels, changes = [float(cell)], [float(level)], list[Change]()
        arcs_m = self._start.arc_m
        while step > 0:
            code = int(self._codes[step, way][level, cell])
            if code < _CHANGE_CODE:
                k = ACCELERATIONS[code]
                level, cell, step = level - k, cell - (2 * level - k), step - 1
                cells.append(cell)
                levels.append(level)
                continue
            before, after, seconds, k = self._changes[code - _CHANGE_CODE]
            first = level - k * seconds
            begin = cell - seconds * 2 * first - k * seconds**2
            changes.append(Change(arcs_m + CELL_M * begin, arcs_m + CELL_M * cell, after))
            for i in range(seconds - 1, -1, -1):
                cells.append(begin + i * 2 * first + k * i * i)
                levels.append(first + k * i)
            level, cell, step, way = first, begin, step - seconds, before
        return Timing(
            self._start.frame,
            arcs_m + CELL_M * np.array(cells[::-1]),
            LEVEL_MPS * np.array(levels[::-1]),
            self._start.way,
            tuple(changes[::-1]),
            cost,
            to_goal,
        )
