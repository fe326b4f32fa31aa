"""Cross-sections: which lanes lie where across a road."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from interplan_sumo.maps.districts.plan import Carriageway, Direction, PlannedApproach, Road

NOSE_M = 0.6
"""Least width of the median that remains beside a pocket."""


@dataclass(frozen=True, slots=True)
class LaneStrip:
    """A lane across the road: outward distances of its two edges from the axis."""

    inner_m: float
    kerb_m: float

    @property
    def middle_m(self) -> float:
        return (self.inner_m + self.kerb_m) / 2.0

    @property
    def width_m(self) -> float:
        return self.kerb_m - self.inner_m


def way_at(road: Road, direction: Direction, station_m: float) -> Carriageway | None:
    """The carriageway of one direction at a station."""
    section = [s for s in road.sections if s.from_m <= station_m + 1e-6][-1]
    return section.forward if direction == "forward" else section.backward


def missing_median_m(way: Carriageway, approach: PlannedApproach) -> float:
    """By how much the median is too narrow for the inner pockets of an approach."""
    room_m = max(0.0, 2.0 * way.inner_m - NOSE_M)
    return max(0.0, approach.inner_pockets * approach.pocket_width_m - room_m)


def strips(way: Carriageway, approach: PlannedApproach | None = None, pushed_m: float = 0.0) -> tuple[LaneStrip, ...]:
    """The lanes of a carriageway pushed towards the kerb, with the pockets of an approach."""
    inner_count = approach.inner_pockets if approach else 0
    kerb_count = approach.kerb_pockets if approach else 0
    pocket_m = approach.pocket_width_m if approach else 0.0
    widths = (pocket_m,) * inner_count + way.widths_m + (pocket_m,) * kerb_count
    edges = np.concatenate(([0.0], np.cumsum(widths))) + way.inner_m + pushed_m - inner_count * pocket_m
    return tuple(LaneStrip(float(a), float(b)) for a, b in pairwise(edges))
