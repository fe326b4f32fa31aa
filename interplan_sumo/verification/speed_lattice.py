"""Lattice: the cheapest speed profile, by a shortest-path search over time, path, place and speed.

Steps of 1 s, speeds and places on a grid, so that constant accelerations lead
from one grid point to another. On one path only what is ahead counts: whoever
drives the ego's way stays behind it once it is in front. Where the ego changes
lane or swerves, and against everybody who does not drive its way, all who are
near count.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Generic, TypeVar

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from interplan_sumo.verification.corridor import GRID_M
from interplan_sumo.verification.occupancy import CELL_M, LEVEL_MPS, PathOccupancy, SpeedGrid
from interplan_sumo.verification.planning_problem import (
    STEP_FRAMES,
    Margins,
    Pace,
    PathChange,
    PlanningProblem,
    ProfileStart,
    SpeedProfile,
    TimeGate,
)
from interplan_sumo.world.geometry import Floats, Ints

Scalar = TypeVar("Scalar", bound=np.generic)

# In one step a speed of n levels and an acceleration of k levels lead 2 n + k cells on.
ACCELERATIONS: Final = (0, 1, -1, 2, -2, 3, -3, -4, -5, -6, -7)
"""Levels per step, that is up to 1.5 and down to -3.5 m/s2. Of equally good ones the first wins."""
HARDEST: Final = 7
LATER_PUSH: Final = 4
"""A speed profile that begins under way does not begin with more: it would be felt as a jerk."""
CHANGE_ACCELERATIONS: Final = (0, 1, -1)
SLOWEST_CHANGE: Final = 4
"""A lane change does not end at fewer levels."""
SLOWEST_OVER: Final = 4
"""Levels at which one at least drives where oncoming drivers may stop for the ego: both would wait for ever."""
LEFT_AFTER: Final = 0.6
"""After this share of a lane change nothing in the old lane matters any more."""
THINNED: Final = 4
"""Lane changes begin on the best of so many neighbouring cells."""
TOLERANCE_MPS: Final = 0.02
"""A cap is kept to within this."""

SLOW_COST: Final = 1.0
"""Of a second at standstill; nothing at the highest speed."""
PUSH_COST: Final = 0.1
"""Of a second at 1 m/s2; grows with the square."""
NEAR_COST: Final = 0.3
"""Of a step that ends nearer behind somebody than is comfortable."""
CHANGE_COST: Final = 0.4
"""Of a lane change."""
ASIDE_COST: Final = 0.04
"""Of a second, for each lane between the ego and the goal lane."""


def cheapest_profile(
    problem: PlanningProblem, start: ProfileStart, margins: Margins, pace: Pace, gate: TimeGate | None = None
) -> SpeedProfile | None:
    """The cheapest speed profile to the goal, or as near to it as one gets in time; None if there is none.

    It ends in the goal lane, and passes the gate when it has to.
    """
    return _Lattice(problem, start, margins, pace, gate).solved()


class _Shifted(Generic[Scalar]):
    """A table (V, S) read at places that move on evenly with level and cell, without a copy.

    `filling` is what lies around the table; None goes on with what is at its edges.
    """

    def __init__(self, table: NDArray[Scalar], filling: float | None = None) -> None:
        self._levels = len(table)
        self._left = 2 * self._levels + HARDEST
        around = ((HARDEST, HARDEST), (self._left, HARDEST))
        if filling is None:
            self._padded = np.pad(table, around, mode="edge")
        else:
            self._padded = np.pad(table, around, constant_values=filling)

    def at(self, slower: int, cells_per_level: int, nearer: int, cells: slice) -> NDArray[Scalar]:
        """(V, K) entry (v - slower, s + nearer - cells_per_level v) for all levels v and the cells s."""
        first = self._padded[HARDEST - slower :, self._left + nearer + cells.start :]
        level_bytes, cell_bytes = self._padded.strides
        strides = (level_bytes - cells_per_level * cell_bytes, cell_bytes)
        return as_strided(first, (self._levels, cells.stop - cells.start), strides, writeable=False)


@dataclass(frozen=True, slots=True, eq=False)
class _Begun:
    """Lane changes of one kind from many places."""

    level: Ints  # (C,)
    cell: Ints  # (C,)
    cost: Floats  # (C,)
    k: int
    seconds: int

    def after(self, seconds: int) -> tuple[Ints, Ints]:
        """Levels and cells (C,) some seconds later."""
        cells = self.cell + 2 * seconds * self.level + self.k * seconds * seconds
        return (self.level + self.k * seconds).astype(np.int64), cells.astype(np.int64)

    def only(self, keep: NDArray[np.bool_]) -> _Begun:
        return _Begun(self.level[keep], self.cell[keep], self.cost[keep], self.k, self.seconds)


@dataclass(frozen=True, slots=True)
class _End:
    """Where a path ends on the lattice."""

    cost: float
    step: int
    path: int
    level: int
    cell: int


_CHANGE_CODE = 100
"""Codes from here on are lane changes, below they are accelerations."""


class _Lattice:
    """Costs and codes, how each point was reached, are tables (V, S) by step and path."""

    def __init__(
        self, problem: PlanningProblem, start: ProfileStart, margins: Margins, pace: Pace, gate: TimeGate | None
    ) -> None:
        corridor, paths = problem.corridor, problem.paths
        self._paths, self._start, self._pace, self._gate = paths, start, pace, gate
        self._steps = (problem.frames - 1 - start.frame) // STEP_FRAMES
        self._first_level = round(start.speed_mps / LEVEL_MPS)
        fastest_mps = max(float(np.max(path.cap_mps[np.isfinite(path.left_m)], initial=0.0)) for path in paths)
        self._levels = max(int((fastest_mps + TOLERANCE_MPS) / LEVEL_MPS), self._first_level) + 1
        self._goal = int(np.ceil((corridor.goal_m - start.arc_m) / CELL_M)) + 1
        self._cells = self._goal + 2 * self._levels + 2
        self._behind_gate = 0 if gate is None else int((gate.arc_m - start.arc_m) / CELL_M) + 1
        grid = SpeedGrid(start.arc_m, self._cells, self._levels)
        self._occupancy = PathOccupancy(problem, margins, grid)
        at = np.clip(np.rint((grid.arcs_m - corridor.arc_m[0]) / GRID_M).astype(np.int64), 0, len(corridor.arc_m) - 1)
        caps = [np.where(path.closed, -1.0, np.maximum(path.cap_mps, 0.0))[at] for path in paths]
        self._open = [grid.speeds_mps[:, None] <= cap + TOLERANCE_MPS for cap in caps]
        if corridor.scenario.traffic.oncoming != "none":
            for free, path in zip(self._open, paths, strict=True):
                free[:SLOWEST_OVER, path.over[at]] = False
        self._walls = [_counted(path.closed[at]) for path in paths]
        shape = (self._levels, self._cells)
        self._walls_before = [_Shifted(np.broadcast_to(walls[:-1], shape)) for walls in self._walls]
        self._swerving = [path.swerving[at] for path in paths]
        self._parted = {
            (p, q): _counted(~corridor.neighbours(p, q)[at])
            for p in range(len(paths))
            for q in range(len(paths))
            if p != q and corridor.neighbours(p, q)[at].any()
        }
        self._aside = self._lanes_to_goal()
        self._unreached: Floats = np.full(shape, np.inf)
        self._costs: dict[tuple[int, int], Floats] = {}
        self._codes: dict[tuple[int, int], NDArray[np.int32]] = {}
        self._changes: list[tuple[int, int, int]] = []  # from which path, seconds, levels per step
        rows = np.arange(self._levels)[:, None]
        self._push_costs = [self._cost(rows - k / 2.0, k) for k in ACCELERATIONS]  # (V, 1) each

    def _cost(self, mean_level: NDArray[np.floating[Any]], k: int) -> Floats:
        """Of a second at a mean speed and an acceleration."""
        lost = 1.0 - mean_level.astype(np.float64) / max(self._levels - 1, 1)
        return SLOW_COST * lost + PUSH_COST * (LEVEL_MPS * k) ** 2

    def _lanes_to_goal(self) -> list[int]:
        """Lane changes left per path; -1 where the goal lane cannot be reached."""
        left = [0 if path.lane_path.at_goal else -1 for path in self._paths]
        for distance in range(1, len(left)):
            for p, q in self._parted:
                if left[q] == distance - 1 and left[p] < 0:
                    left[p] = distance
        return left

    # --- the search ----------------------------------------------------------------------------

    def solved(self) -> SpeedProfile | None:
        """The cheapest path as a speed profile."""
        self._costs[0, self._start.path] = self._unreached.copy()
        self._costs[0, self._start.path][self._first_level, 0] = 0.0
        best: _End | None = None
        for step in range(self._steps):
            paths = [p for p, left in enumerate(self._aside) if left >= 0 and (step, p) in self._costs]
            for p in paths:
                self._change_lane(step, p)
            for p in paths:
                self._go_on(step, p)
            best = self._arrived(step + 1, best)
            if best is not None and best.cost <= self._least_cost(step + 1):
                break  # costs only grow
        if best is not None:
            return self._traced(best, to_goal=True)
        nearest = self._nearest()
        return None if nearest is None else self._traced(nearest, to_goal=False)

    def _tables(self, step: int, path: int) -> tuple[Floats, NDArray[np.int32]]:
        """Costs and codes, made when first needed."""
        if (step, path) not in self._costs:
            self._costs[step, path] = self._unreached.copy()
        if (step, path) not in self._codes:
            self._codes[step, path] = np.zeros(self._unreached.shape, dtype=np.int32)
        return self._costs[step, path], self._codes[step, path]

    def _least_cost(self, step: int) -> float:
        return min((float(cost.min()) for (at, _), cost in self._costs.items() if at >= step), default=np.inf)

    def _arrived(self, step: int, best: _End | None) -> _End | None:
        """The better of `best` and who is beyond the goal now; they leave the lattice."""
        for p, left in enumerate(self._aside):
            if (step, p) not in self._costs:
                continue
            beyond = self._costs[step, p][:, self._goal :]
            level, cell = divmod(int(np.argmin(beyond)), beyond.shape[1])
            if left == 0 and beyond[level, cell] < (best.cost if best is not None else np.inf):
                best = _End(float(beyond[level, cell]), step, p, level, cell + self._goal)
            beyond[:] = np.inf
        return best

    def _nearest(self) -> _End | None:
        """The best end short of the goal: each metre left counts as at the highest speed."""
        left = self._goal - np.arange(self._cells)
        found: list[_End] = []
        for p in np.flatnonzero(np.array(self._aside) == 0).tolist():
            if (self._steps, p) in self._costs:
                total = self._costs[self._steps, p] + left * CELL_M / (LEVEL_MPS * max(self._levels - 1, 1))
                level, cell = divmod(int(np.argmin(total)), self._cells)
                found.append(_End(float(total[level, cell]), self._steps, p, level, cell))
        found = [end for end in found if np.isfinite(end.cost)]
        return min(found, key=lambda end: end.cost) if found else None

    def _go_on(self, step: int, path: int) -> None:
        """One step on the same path, at every acceleration."""
        cost = self._costs[step, path]
        reached = np.flatnonzero(np.isfinite(cost).any(axis=0))
        if not len(reached):
            return
        before = self._start.frame + step * STEP_FRAMES
        end = min(int(reached[-1]) + 2 * self._levels + 1, self._cells)
        cells = slice(int(reached[0]), end)  # nobody goes back
        costs, codes = (table[:, cells] for table in self._tables(step + 1, path))
        allowed = (self._open[path] & ~self._taken(path, before, before + STEP_FRAMES))[:, cells]
        cols = np.arange(cells.start, end)
        if self._gate is not None:
            beyond = cols >= self._behind_gate
            allowed &= ~beyond if step < self._gate.step else beyond
        source = _Shifted(cost, np.inf)
        halfway = _Shifted(self._open[path] & ~self._taken(path, before, before + STEP_FRAMES // 2))
        walls, walls_before = self._walls[path], self._walls_before[path]
        farthest = self._farthest_from(path, before)
        hardest = HARDEST
        if step == 0:
            hardest = max(self._pace.first_push, LATER_PUSH if before > 0 else 0)
        for code, k in enumerate(ACCELERATIONS):
            if abs(k) > hardest:
                continue
            total = source.at(k, 2, k, cells) + (self._push_costs[code] + ASIDE_COST * self._aside[path])
            # Half a second before, one was an eighth of (3 v + speed before) back.
            possible = allowed & halfway.at(k // 2, 1, -((2 - k) // 4), cells)
            possible &= walls[cols + 1] == walls_before.at(0, 2, k, cells)
            if farthest is not None:
                last, comfortable = (each.at(0, 2, k, cells) for each in farthest)
                possible &= cols <= last
                total += NEAR_COST * (cols > comfortable)
            better = possible & (total < costs)
            np.copyto(costs, total, where=better)
            np.copyto(codes, code, where=better)

    def _farthest_from(self, path: int, before: int) -> tuple[_Shifted[np.int64], _Shifted[np.int64]] | None:
        """To which cells a queue lets one come in a step, at each speed then and from each cell (V, S).

        As far as one may at all, and with comfortable room; None where nobody is ahead.
        """
        queue = self._occupancy.queue(path, before, before + STEP_FRAMES)
        if queue is None:
            return None
        return _Shifted(queue.last_cell[:, queue.passed]), _Shifted(queue.last_comfortable_cell[:, queue.passed])

    def _taken(self, path: int, before: int, after: int) -> NDArray[np.bool_]:
        """(V, S) taken by those of whom the queue does not tell, and in a swerve by anybody."""
        strangers = self._occupancy.taken(path, after, everyone=False, before=before)
        taken = np.zeros(self._unreached.shape, dtype=np.bool_) if strangers is None else strangers
        if self._swerving[path].any():
            everyone = self._occupancy.taken(path, after, everyone=True)
            if everyone is not None:
                return taken | (everyone & self._swerving[path])
        return taken

    def _change_lane(self, step: int, path: int) -> None:
        """Lane changes to all neighbours, from the best of every few cells."""
        cost = self._costs[step, path]
        count = self._cells // THINNED
        groups = cost[:, : count * THINNED].reshape(self._levels, count, THINNED)
        cell = np.arange(count) * THINNED + groups.argmin(axis=2)
        level = np.broadcast_to(np.arange(self._levels)[:, None], cell.shape)
        least = np.take_along_axis(cost, cell, axis=1)
        for other in range(len(self._paths)):
            if (path, other) not in self._parted or self._aside[other] < 0:
                continue
            for slowest, fastest, seconds in self._pace.changes:
                chosen = np.isfinite(least) & (LEVEL_MPS * level >= slowest) & (LEVEL_MPS * level < fastest)
                if step + seconds <= self._steps and chosen.any():
                    for k in CHANGE_ACCELERATIONS:
                        begun = _Begun(level[chosen], cell[chosen].astype(np.int64), least[chosen], k, seconds)
                        self._end_change(step, path, other, begun)

    def _end_change(self, step: int, path: int, other: int, begun: _Begun) -> None:
        """Follow lane changes to their ends, and take note of those that can be done."""
        level, cell = begun.after(begun.seconds)
        begun = begun.only((level >= SLOWEST_CHANGE) & (level < self._levels) & (cell < self._goal))
        level, cell = begun.after(begun.seconds)
        left = begun.cell + ((cell - begun.cell) * LEFT_AFTER).astype(np.int64)
        parted, walls = self._parted[path, other], self._walls
        possible = (parted[cell + 1] == parted[begun.cell]) & (walls[other][cell + 1] == walls[other][begun.cell])
        possible &= walls[path][left + 1] == walls[path][begun.cell]
        for i in range(1, begun.seconds + 1):
            frame = self._start.frame + (step + i) * STEP_FRAMES
            now = begun.after(i)
            possible &= self._open[other][now]
            taken = self._occupancy.taken(other, frame, everyone=True)
            if taken is not None:
                possible &= ~taken[now]
            if i <= LEFT_AFTER * begun.seconds + 0.5:
                possible &= self._open[path][now]
                queue = self._occupancy.queue(path, frame - STEP_FRAMES, frame)
                if queue is not None:
                    possible &= now[1] <= queue.last_cell[now[0], queue.passed[begun.after(i - 1)[1]]]
        aside = ASIDE_COST * max(self._aside[path], self._aside[other])
        second = self._cost((begun.level + level) / 2.0, begun.k) + aside
        total = begun.cost + CHANGE_COST + begun.seconds * second
        costs, codes = self._tables(step + begun.seconds, other)
        at = level * self._cells + cell
        rows = np.flatnonzero(possible & (total < costs.ravel()[at]))
        rows = rows[np.argsort(-total[rows], kind="stable")]  # of several that end alike the cheapest is written last
        np.put(costs, at[rows], total[rows])
        np.put(codes, at[rows], _CHANGE_CODE + len(self._changes))
        self._changes.append((path, begun.seconds, begun.k))

    # --- the answer ----------------------------------------------------------------------------

    def _traced(self, end: _End, *, to_goal: bool) -> SpeedProfile:
        """The path that ends there, followed back to its start."""
        step, path, level, cell = end.step, end.path, end.level, end.cell
        points, changes = [(level, cell)], list[PathChange]()
        arc_m = self._start.arc_m
        while step > 0:
            code = int(self._codes[step, path][level, cell])
            before, seconds, k = path, 1, ACCELERATIONS[code] if code < _CHANGE_CODE else 0
            if code >= _CHANGE_CODE:
                before, seconds, k = self._changes[code - _CHANGE_CODE]
            to_m = arc_m + CELL_M * cell
            for _ in range(seconds):
                level, cell = level - k, cell - (2 * level - k)
                points.append((level, cell))
            if before != path:
                changes.append(PathChange(arc_m + CELL_M * cell, to_m, path))
            step, path = step - seconds, before
        levels, cells = np.array(points[::-1], dtype=np.float64).T
        return SpeedProfile(
            self._start.frame,
            arc_m + CELL_M * cells,
            LEVEL_MPS * levels,
            self._start.path,
            tuple(changes[::-1]),
            end.cost,
            to_goal,
        )


def _counted(marks: NDArray[np.bool_]) -> Ints:
    """(S + 1,) how many marks lie before each cell: equal counts mean that none lies between."""
    return np.concatenate(([0], np.cumsum(marks))).astype(np.int64)
