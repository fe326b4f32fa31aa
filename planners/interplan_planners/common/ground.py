"""What lies under a point: lanes, the route, intersections, the drivable area; for many points at once.

Point-in-polygon queries are what scoring spends its time on, and nearly all
points lie well inside or well outside of everything. So the plane is cut into
cells; a cell that no boundary crosses needs to be asked once, and only points
in the others are tested against the polygons themselves. Answers are exact.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.world.geometry import Floats, Ints
from interplan_sumo.world.roads import Roads

CELL_M = 0.5
WINDOW_CELLS = 512
"""The cells in use form a square of this many by this many, which moves with the points."""
MOST_CROSSING = 40
"""Where more boundaries cross one cell its points are tested against all polygons around them."""
_UNKNOWN = np.iinfo(np.int32).min
_CROWDED = _UNKNOWN + 1


@dataclass(frozen=True, eq=False)
class Under:
    """What lies under points of some shape."""

    sets: Ints
    """Index of the set of areas; equal where all the same areas lie under two points."""
    facts: NDArray[np.bool_]  # (4, S) by set: drivable, on route, on lane, in intersection

    @property
    def drivable(self) -> NDArray[np.bool_]:
        """Inside a lane, a connector, a roadblock or nuPlan's drivable area."""
        return self.facts[0][self.sets]

    @property
    def on_route(self) -> NDArray[np.bool_]:
        """Inside a lane or connector of the route."""
        return self.facts[1][self.sets]

    @property
    def on_lane(self) -> NDArray[np.bool_]:
        """Inside any lane or connector."""
        return self.facts[2][self.sets]

    @property
    def in_intersection(self) -> NDArray[np.bool_]:
        return self.facts[3][self.sets]


class Ground:
    """The areas of a map around one route. Keeps what it has learned, so one instance should serve an episode."""

    def __init__(self, roads: Roads, route_lanes: Iterable[str]) -> None:
        lanes = [*roads.lanes.values(), *roads.connectors.values()]
        surfaces = (
            *roads.roadblocks.values(), *roads.road_segments, *roads.generic_drivable_areas, *roads.carparks
        )  # fmt: skip
        polygons = [area.polygon for area in (*lanes, *surfaces, *roads.intersections)]
        self._polygons = np.array(polygons, dtype=object)
        shapely.prepare(self._polygons)
        self._tree = shapely.STRtree(self._polygons)
        count, inner = len(polygons), len(polygons) - len(roads.intersections)
        self._is_lane = np.arange(count) < len(lanes)
        self._is_crossing = np.arange(count) >= inner
        on_route = frozenset(route_lanes)
        self._is_route = np.array([lane.id in on_route for lane in lanes] + [False] * (count - len(lanes)), dtype=bool)
        self._sets: dict[frozenset[int], int] = {}
        self._facts = np.zeros((4, 0), dtype=np.bool_)
        self._lanes_of: list[frozenset[int]] = []
        self._mixtures = _Mixtures()
        self._found: dict[int, int] = {}
        """Sets of points in cells that boundaries cross, by mixture and by which of its areas hold the point."""
        self._one_lane: dict[tuple[int, ...], bool] = {}
        self._cells = np.full((WINDOW_CELLS, WINDOW_CELLS), _UNKNOWN, dtype=np.int32)
        self._corner: Ints | None = None

    def under(self, x_m: Floats, y_m: Floats) -> Under:
        """What lies under points of any shape, map frame. On an edge counts as outside."""
        return Under(self._sets_under(np.ravel(x_m), np.ravel(y_m)).reshape(np.shape(x_m)), self._facts)

    def farther(self, x_m: Floats, y_m: Floats, than_m: float) -> NDArray[np.bool_]:
        """(M,) whether points (M,) are farther than this from all that is drivable."""
        near, _ = self._tree.query(shapely.points(x_m, y_m), predicate="dwithin", distance=than_m)
        far = np.ones(len(x_m), dtype=np.bool_)
        far[near] = False
        return far

    def straddles(self, corners: Ints) -> NDArray[np.bool_]:
        """(M,) whether boxes lie in several lanes and in none entirely, from the sets under their corners (M, 4)."""
        # four indices of at most 16 bits make one number, so that equal rows are found quickly
        keys = corners[:, 0] | corners[:, 1] << 16 | corners[:, 2] << 32 | corners[:, 3] << 48
        _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
        straddling = [self._straddles(tuple(row)) for row in corners[first].tolist()]
        return np.array(straddling, dtype=np.bool_)[inverse]

    def _straddles(self, corners: tuple[int, ...]) -> bool:
        known = self._one_lane.get(corners)
        if known is None:
            lanes = [self._lanes_of[i] for i in corners]
            known = self._one_lane[corners] = len(frozenset.union(*lanes)) > 1 and not frozenset.intersection(*lanes)
        return known

    # --- cells ---------------------------------------------------------------------------------

    def _sets_under(self, x_m: Floats, y_m: Floats) -> Ints:
        if not x_m.size:
            return np.zeros(0, dtype=np.int64)
        column, row = np.floor(x_m / CELL_M).astype(np.int64), np.floor(y_m / CELL_M).astype(np.int64)
        low = np.array((column.min(), row.min()))
        high = np.array((column.max(), row.max()))
        if (high - low >= WINDOW_CELLS).any():  # spread too far for the window
            return self._asked(x_m, y_m)
        if self._corner is None or (low < self._corner).any() or (high >= self._corner + WINDOW_CELLS).any():
            self._corner = (low + high - WINDOW_CELLS) // 2
            self._cells.fill(_UNKNOWN)
        column -= self._corner[0]
        row -= self._corner[1]
        found = self._cells[row, column].astype(np.int64)
        unknown = found == _UNKNOWN
        if unknown.any():
            cells = np.unique(row[unknown] * WINDOW_CELLS + column[unknown])
            self._cells.flat[cells] = self._explored(cells, self._corner)
            found[unknown] = self._cells[row[unknown], column[unknown]]
        mixed = np.flatnonzero(found < 0)
        if mixed.size:
            crowded = mixed[found[mixed] == _CROWDED]
            if crowded.size:
                found[crowded] = self._asked(x_m[crowded], y_m[crowded])
                mixed = mixed[found[mixed] < 0]
        if mixed.size:
            found[mixed] = self._tested(x_m[mixed], y_m[mixed], -1 - found[mixed])
        return found

    def _explored(self, cells: Ints, corner: Ints) -> Ints:
        """What holds in each of the cells: the index of a set, -1 - the index of a mixture, or `_CROWDED`."""
        left = (cells % WINDOW_CELLS + corner[0]) * CELL_M
        bottom = (cells // WINDOW_CELLS + corner[1]) * CELL_M
        boxes = np.asarray(shapely.box(left, bottom, left + CELL_M, bottom + CELL_M))
        # not the tree's own predicate, which prepares the boxes: the polygons are prepared already
        cell, polygon = self._tree.query(boxes)
        touching = shapely.intersects(self._polygons[polygon], boxes[cell])
        cell, polygon = cell[touching], polygon[touching]
        order = np.lexsort((polygon, cell))
        cell, polygon = cell[order], polygon[order]
        whole = shapely.contains_properly(self._polygons[polygon], boxes[cell])
        result = np.empty(len(cells), dtype=np.int64)
        starts = np.searchsorted(cell, np.arange(len(cells) + 1)).tolist()
        members, covered = polygon.tolist(), whole.tolist()
        for i, (first, last) in enumerate(pairwise(starts)):
            full = frozenset(
                p for p, all_of_it in zip(members[first:last], covered[first:last], strict=True) if all_of_it
            )
            if len(full) == last - first:
                result[i] = self._set(full)
            else:
                crossing = tuple(p for p in members[first:last] if p not in full)
                result[i] = -1 - self._mixtures.index(full, crossing) if len(crossing) <= MOST_CROSSING else _CROWDED
        return result

    def _tested(self, x_m: Floats, y_m: Floats, mixture: Ints) -> Ints:
        """Sets under points (M,) in cells of mixtures (M,): only areas whose boundaries cross the cell are tested."""
        first, count, areas = self._mixtures.columns
        counts = count[mixture]
        ends = np.cumsum(counts)
        point = np.repeat(np.arange(len(mixture)), counts)
        place = np.arange(len(point)) - (ends - counts)[point]
        area = areas[first[mixture][point] + place]
        inside = shapely.contains_xy(self._polygons[area], x_m[point], y_m[point])
        bits = np.bitwise_or.reduceat(inside.astype(np.int64) << place, ends - counts)
        keys: list[int] = (bits | mixture << MOST_CROSSING).tolist()
        known = self._found
        try:
            return np.array([known[key] for key in keys], dtype=np.int64)
        except KeyError:
            for key in {*keys} - known.keys():
                full, crossing = self._mixtures.kinds[key >> MOST_CROSSING]
                known[key] = self._set(full.union(p for i, p in enumerate(crossing) if key >> i & 1))
            return np.array([known[key] for key in keys], dtype=np.int64)

    def _asked(self, x_m: Floats, y_m: Floats) -> Ints:
        """Sets under points (M,), each of them tested against all polygons around it."""
        point, area = self._tree.query(shapely.points(x_m, y_m))
        inside = shapely.contains_xy(self._polygons[area], x_m[point], y_m[point])
        areas: list[set[int]] = [set() for _ in range(len(x_m))]
        for i, j in zip(point[inside].tolist(), area[inside].tolist(), strict=True):
            areas[i].add(j)
        return np.array([self._set(frozenset(each)) for each in areas], dtype=np.int64)

    def _set(self, areas: frozenset[int]) -> int:
        """The index of a set of areas, a new one if it has not been met."""
        index = self._sets.get(areas)
        if index is None:
            index = self._sets[areas] = len(self._sets)
            rows = np.array(sorted(areas), dtype=np.int64)
            lane, crossing = self._is_lane[rows], self._is_crossing[rows]
            facts = (len(rows) > 0, bool(self._is_route[rows].any()), bool(lane.any()), bool(crossing.any()))
            self._facts = np.column_stack((self._facts, np.array(facts, dtype=np.bool_)))
            self._lanes_of.append(frozenset(rows[lane].tolist()))
        return index


class _Mixtures:
    """What may hold in a cell that boundaries cross: areas that cover it, and those whose boundaries cross it."""

    def __init__(self) -> None:
        self.kinds: list[tuple[frozenset[int], tuple[int, ...]]] = []
        self._index: dict[tuple[frozenset[int], tuple[int, ...]], int] = {}
        self._columns: tuple[Ints, Ints, Ints] | None = None

    def index(self, full: frozenset[int], crossing: tuple[int, ...]) -> int:
        """The number of a mixture, a new one if it has not been met."""
        found = self._index.setdefault((full, crossing), len(self.kinds))
        if found == len(self.kinds):
            self.kinds.append((full, crossing))
            self._columns = None
        return found

    @property
    def columns(self) -> tuple[Ints, Ints, Ints]:
        """Where the crossing areas of each begin, how many there are, and all of them in one row."""
        if self._columns is None:
            count = np.array([len(crossing) for _, crossing in self.kinds])
            areas = np.array([area for _, crossing in self.kinds for area in crossing])
            self._columns = np.cumsum(count) - count, count, areas
        return self._columns
