"""Progress along the roadblocks that the expert passed: nuPlan's measure.

The expert's drive becomes a list of roadblocks, each with the centre line of
the first lane that the expert had in it. A pose earns the difference of its
projections on that centre line while it is inside the roadblock, nothing
outside, and the whole way across when it appears in a later roadblock of the list.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.metrics.association import Place
from interplan_sumo.world.geometry import Floats, Polyline
from interplan_sumo.world.roads import Roads


@dataclass(frozen=True, slots=True, eq=False)
class RouteBlock:
    """A roadblock on the expert's way, and the centre line along which progress in it is measured."""

    roadblock_id: str
    lane_id: str
    polygon: shapely.Polygon
    centerline: Polyline


def route_blocks(roads: Roads, places: Sequence[Place]) -> tuple[RouteBlock, ...]:
    """The roadblocks along the places of a drive, one entry per change of roadblock."""
    kept: Place = ()
    blocks: list[RouteBlock] = []
    for place in places:
        if not place or set(place) & set(kept):
            continue
        kept = place
        lane = roads[place[0]]
        if not blocks or blocks[-1].roadblock_id != lane.roadblock_id:
            polygon = roads.roadblocks[lane.roadblock_id].polygon
            blocks.append(RouteBlock(lane.roadblock_id, lane.id, polygon, lane.centerline))
    return tuple(blocks)


def project_m(line: Polyline, xy: Floats) -> Floats:
    """(K,) arc length of the points of the line nearest to points (K, 2)."""
    return np.asarray(shapely.line_locate_point(line.linestring, shapely.points(xy)), dtype=np.float64).reshape(-1)


def progress_per_frame(blocks: Sequence[RouteBlock], xy: Floats) -> Floats:
    """(N,) progress in metres that each pose (N, 2) adds along the blocks; the first adds nothing.

    All zero without blocks. Backward motion is negative. The pointer into the
    list never moves back: whoever returns to an earlier roadblock earns nothing there.
    """
    gained = np.zeros(len(xy))
    if not blocks or not len(xy):
        return gained
    inside: list[NDArray[np.bool_]] = [shapely.contains_xy(block.polygon, xy) for block in blocks]
    arc = {0: project_m(blocks[0].centerline, xy)}
    current = 0
    last_m = float(arc[0][0])
    for frame in range(1, len(xy)):
        if inside[current][frame]:
            now_m = float(arc[current][frame])
            gained[frame] = now_m - last_m
        else:
            entered = next((b for b in range(current + 1, len(blocks)) if inside[b][frame]), None)
            if entered is None:
                continue
            arc.setdefault(entered, project_m(blocks[entered].centerline, xy))
            now_m = float(arc[entered][frame])
            lines = [block.centerline for block in blocks[current : entered + 1]]
            gained[frame] = lines[0].length_m - last_m + now_m + across_m(lines)
            current = entered
        last_m = now_m
    return gained


def across_m(lines: Sequence[Polyline]) -> float:
    """What lies between the end of the first line and the start of the last one, along the lines.

    A skipped line counts from where the end of the line before projects on it
    to where the start of the next one does; on the last line the end of the
    *first* one marks the start. Centre lines that join without a step give the
    length of the skipped ones.
    """
    ends = [line.points[-1:] for line in lines]
    starts = [line.points[:1] for line in lines]
    total = -float(project_m(lines[-1], ends[0])[0])
    for skipped in range(1, len(lines) - 1):
        reached, left = project_m(lines[skipped], np.concatenate((ends[skipped - 1], starts[skipped + 1])))
        total += float(left - reached)
    return total
