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
_UNKNOWN = np.iinfo(np.int32).min


@dataclass(frozen=True, eq=False)
class Under:
    """What lies under points of some shape."""

    drivable: NDArray[np.bool_]
    """Inside a lane, a connector, a roadblock or nuPlan's drivable area."""
    on_route: NDArray[np.bool_]
    """Inside a lane or connector of the route."""
    on_lane: NDArray[np.bool_]
    """Inside any lane or connector."""
    in_intersection: NDArray[np.bool_]
    sets: Ints
    """Index of the set of areas; equal where all the same areas lie under two points."""


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
        self._facts = np.zeros((0, 4), dtype=np.bool_)  # by set: drivable, on route, on lane, in intersection
        self._lanes_of: list[frozenset[int]] = []
        self._mixtures: list[Ints] = []  # candidates of the cells that boundaries cross
        self._one_lane: dict[tuple[int, ...], bool] = {}
        self._cells = np.full((WINDOW_CELLS, WINDOW_CELLS), _UNKNOWN, dtype=np.int32)
        self._corner: Ints | None = None

    def under(self, x_m: Floats, y_m: Floats) -> Under:
        """What lies under points of any shape, map frame. On an edge counts as outside."""
        sets = self._sets_under(np.ravel(x_m), np.ravel(y_m)).reshape(np.shape(x_m))
        facts = self._facts[sets]
        return Under(facts[..., 0], facts[..., 1], facts[..., 2], facts[..., 3], sets)

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
        if (high - low >= WINDOW_CELLS).any():  # spread too far for the window: ask the polygons themselves
            return self._tested(x_m, y_m, [np.arange(len(self._polygons))], [slice(0, x_m.size)])
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
            mixed = mixed[np.argsort(found[mixed], kind="stable")]
            kinds, starts = np.unique(found[mixed], return_index=True)
            candidates = [self._mixtures[-1 - kind] for kind in kinds.tolist()]
            pieces = [slice(a, b) for a, b in pairwise([*starts.tolist(), mixed.size])]
            found[mixed] = self._tested(x_m[mixed], y_m[mixed], candidates, pieces)
        return found

    def _explored(self, cells: Ints, corner: Ints) -> Ints:
        """What holds in each of the cells: the index of a set, or -1 - the index of a mixture."""
        left = (cells % WINDOW_CELLS + corner[0]) * CELL_M
        bottom = (cells // WINDOW_CELLS + corner[1]) * CELL_M
        boxes = np.asarray(shapely.box(left, bottom, left + CELL_M, bottom + CELL_M))
        cell, polygon = self._tree.query(boxes, predicate="intersects")
        order = np.lexsort((polygon, cell))
        cell, polygon = cell[order], polygon[order]
        whole = shapely.contains_properly(self._polygons[polygon], boxes[cell])
        result = np.empty(len(cells), dtype=np.int64)
        starts = np.searchsorted(cell, np.arange(len(cells) + 1)).tolist()
        members, covered = polygon.tolist(), whole.tolist()
        mixtures = {tuple(m.tolist()): i for i, m in enumerate(self._mixtures)}
        for i, (first, last) in enumerate(pairwise(starts)):
            here = members[first:last]
            if all(covered[first:last]):
                result[i] = self._set(frozenset(here))
                continue
            index = mixtures.setdefault(tuple(here), len(self._mixtures))
            if index == len(self._mixtures):
                self._mixtures.append(np.array(here, dtype=np.int64))
            result[i] = -1 - index
        return result

    def _tested(self, x_m: Floats, y_m: Floats, candidates: list[Ints], pieces: list[slice]) -> Ints:
        """Sets under points (M,), each piece of them tested against its own candidates."""
        areas = np.unique(np.concatenate(candidates))
        inside = np.zeros((len(x_m), len(areas)), dtype=np.bool_)
        asked: dict[int, list[Ints]] = {}
        points = np.arange(len(x_m))
        for members, piece in zip(candidates, pieces, strict=True):
            for column in np.searchsorted(areas, members).tolist():
                asked.setdefault(column, []).append(points[piece])
        for column, lists in asked.items():
            rows = np.concatenate(lists)
            inside[rows, column] = shapely.contains_xy(self._polygons[areas[column]], x_m[rows], y_m[rows])
        patterns, inverse = np.unique(np.packbits(inside, axis=1), axis=0, return_inverse=True)
        members = np.unpackbits(patterns, axis=1, count=len(areas)).astype(np.bool_)
        return np.array([self._set(frozenset(areas[row].tolist())) for row in members])[inverse.ravel()]

    def _set(self, areas: frozenset[int]) -> int:
        """The index of a set of areas, a new one if it has not been met."""
        index = self._sets.get(areas)
        if index is None:
            index = self._sets[areas] = len(self._sets)
            rows = np.array(sorted(areas), dtype=np.int64)
            lane, crossing = self._is_lane[rows], self._is_crossing[rows]
            facts = (len(rows) > 0, bool(self._is_route[rows].any()), bool(lane.any()), bool(crossing.any()))
            self._facts = np.concatenate((self._facts, np.array([facts], dtype=np.bool_)))
            self._lanes_of.append(frozenset(rows[lane].tolist()))
        return index
