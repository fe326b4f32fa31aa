"""The vocabulary of road plans: what one writes down to describe a district.

A plan is a handful of roads, each an axis with cross-sections, and the places
where they meet. All lanes, tapers, pockets, connectors, stop lines and kerbs
follow from it by rule, so a district fits on a page.

*Inner* means next to the axis of the road, *kerb* means away from it, so that
one plan reads the same for both driving sides: the inner pocket is a left-turn
pocket where one drives on the right and a right-turn pocket where one drives on
the left. Coordinates are metres east and north of the district's origin.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from types import MappingProxyType
from typing import Literal

import numpy as np

from interplan_sumo.world.roads import DrivingSide
from tools.make_maps.geometry import Alignment, alignment

Direction = Literal["forward", "backward"]
"""Along the axis of a road or against it."""

Control = Literal["signal", "all_way_stop", "stop", "yield", "none"]
"""How a junction is controlled; at `stop` and `yield` the first road named has priority."""

JOINT_M = 6.0
"""Length of the pass-through connectors by which long roads are cut into roadblocks."""
NOSE_M = 0.6
"""Least width of the median that remains beside a pocket."""
MAX_BLOCK_M = 300.0
"""Longer stretches are cut evenly into roadblocks below this length."""
GORE_M = 0.1
"""Paint between a carriageway and the arm of a ramp."""


@dataclass(frozen=True, slots=True)
class Carriageway:
    """One direction of a road: its lanes from the inner one to the kerb."""

    widths_m: tuple[float, ...]
    limit_kmh: float
    inner_m: float = 0.0
    """Distance of the first lane's inner edge from the axis: half the median, negative on one-way streets."""
    parking_m: float = 0.0
    """Width of the kerb parking beside the last lane, 0 without."""
    far_parking_m: float = 0.0
    """Width of the parking beside the first lane, on one-way streets."""

    @property
    def width_m(self) -> float:
        return sum(self.widths_m)


def lanes(
    count: int, limit_kmh: float, *, width_m: float = 3.3, median_m: float = 0.0, parking_m: float = 0.0
) -> Carriageway:
    """Equal lanes on one side of a median of the given full width."""
    return Carriageway((width_m,) * count, limit_kmh, median_m / 2.0, parking_m)


def one_way(
    count: int, limit_kmh: float, *, width_m: float = 3.3, parking_m: float = 0.0, far_parking_m: float = 0.0
) -> Carriageway:
    """Equal lanes centred on the axis."""
    return Carriageway((width_m,) * count, limit_kmh, -count * width_m / 2.0, parking_m, far_parking_m)


@dataclass(frozen=True, slots=True)
class RoadSection:
    """The cross-section of a road from one station on."""

    from_m: float
    forward: Carriageway | None
    backward: Carriageway | None = None
    taper_m: float = 40.0
    """Length over which lanes are gained, lost or shifted, centred on `from_m`."""


def both_ways(way: Carriageway) -> tuple[RoadSection, ...]:
    """One cross-section all along, alike in both directions."""
    return (RoadSection(0, way, way),)


def one_section(way: Carriageway) -> tuple[RoadSection, ...]:
    """One cross-section all along, for traffic in the direction of the axis."""
    return (RoadSection(0, way),)


@dataclass(frozen=True, slots=True)
class BusStop:
    """A stop for one bus, at the kerb or in a bay of its own."""

    direction: Direction
    at_m: float
    """Station of its middle."""
    bay: bool = False


def stops(*stations_m: float, bays: tuple[float, ...] = ()) -> tuple[BusStop, ...]:
    """Bus stops at stations, negative ones for traffic that drives backward; those among `bays` have one."""
    return tuple(BusStop("forward" if at > 0 else "backward", abs(at), at in bays) for at in stations_m)


@dataclass(frozen=True, slots=True)
class PlannedCrossing:
    """A pedestrian crossing away from junctions."""

    at_m: float
    signal: bool = False


@dataclass(frozen=True, slots=True)
class CarPark:
    """A car park behind the sidewalk, with a driveway in its middle."""

    direction: Direction
    from_m: float
    to_m: float
    depth_m: float = 32.0


@dataclass(frozen=True)
class Road:
    """A named road: an axis, its cross-sections, and what stands along the kerb."""

    number: int
    """10 to 99: the leading digits of all its ids."""
    name: str
    points: tuple[tuple[float, ...], ...]
    """Polygon of tangents, see `geometry.alignment`."""
    sections: tuple[RoadSection, ...]
    bus_stops: tuple[BusStop, ...] = ()
    crossings: tuple[PlannedCrossing, ...] = ()
    car_parks: tuple[CarPark, ...] = ()
    sidewalk_m: float = 2.5
    """0 without sidewalks."""

    @cached_property
    def axis(self) -> Alignment:
        return alignment(self.points)


@dataclass(frozen=True, slots=True)
class PlannedApproach:
    """What an arm of a junction adds for the traffic that arrives on it."""

    inner_pockets: int = 0
    kerb_pockets: int = 0
    storage_m: float = 60.0
    taper_m: float = 30.0
    pocket_width_m: float = 3.1
    use: tuple[str, ...] = ()
    """Turns per lane from left to right, such as ("L", "LT", "T", "TR"); found by rule if empty."""

    @property
    def pockets(self) -> int:
        return self.inner_pockets + self.kerb_pockets

    @property
    def widened_m(self) -> tuple[float, float]:
        """How far from the stop line the pockets reach, and the taper behind them."""
        return self.storage_m, self.storage_m + self.taper_m


@dataclass(frozen=True, slots=True)
class PlannedJunction:
    """A place where roads meet; a road either passes through it or ends in it.

    An *arm* is named by its road and the side on which it leaves the junction:
    `"main+"` leads to higher stations of `main`, `"main-"` to lower ones.
    """

    number: int
    """1 to 99, the id of the intersection."""
    at: tuple[float, float]
    """Roughly where; the exact place is where the axes of the first two roads cross."""
    roads: tuple[str, ...]
    control: Control
    approaches: Mapping[str, PlannedApproach] = field(default_factory=lambda: MappingProxyType({}))
    crosswalks: tuple[str, ...] | None = None
    """Arms with a crosswalk; None: all."""
    corner_m: float = 6.0
    """Least radius of the kerb at corners."""
    carriageway: Direction | None = None
    """Only this carriageway of the first road belongs to the junction: the median is closed and the other runs past."""
    banned: tuple[tuple[str, str], ...] = ()
    """Movements not allowed, as (from arm, to arm)."""

    @property
    def name(self) -> str:
        return " and ".join(self.roads)

    def takes(self, road: str, direction: Direction) -> bool:
        """Whether traffic in one direction of a road that it names passes through the junction."""
        return road != self.roads[0] or self.carriageway in (None, direction)


@dataclass(frozen=True, slots=True)
class Ramp:
    """Where a one-way ramp leaves or joins the kerb lane of a carriageway.

    The carriageway must lose (exit) or gain (entry) its kerb lane in the
    section that begins at that station; the ramp starts or ends there.
    """

    road: str
    direction: Direction
    at_m: float
    ramp: str
    kind: Literal["exit", "entry"]


@dataclass(frozen=True)
class Plan:
    """A district on paper."""

    name: str
    crs: str
    origin_m: tuple[float, float]
    """Projected coordinates of the local origin."""
    driving_side: DrivingSide
    roads: tuple[Road, ...]
    junctions: tuple[PlannedJunction, ...]
    ramps: tuple[Ramp, ...] = ()

    @cached_property
    def road(self) -> Mapping[str, Road]:
        """Roads by name."""
        return {road.name: road for road in self.roads}


def ramp_end(road: Road, driving_side: DrivingSide, ramp: Ramp) -> tuple[float, float, float]:
    """x, y and heading of travel where a ramp begins or ends, tangential to the lane that it takes up.

    This is the middle of the kerb lane where the taper of the section at
    `ramp.at_m` meets the ramp.
    """
    at = next(i for i, section in enumerate(road.sections) if section.from_m == ramp.at_m)
    before, section = road.sections[at - 1], road.sections[at]
    forward = ramp.direction == "forward"
    ways = [way for s in (before, section) if (way := s.forward if forward else s.backward) is not None]
    wide = max(ways, key=lambda way: len(way.widths_m))
    outward_m = wide.inner_m + wide.width_m - wide.widths_m[-1] / 2.0 + GORE_M
    side = -1.0 if forward == (driving_side == "right") else 1.0
    # An exit starts behind the taper in the direction of travel, an entry ends before it.
    ahead = (1.0 if forward else -1.0) * (1.0 if ramp.kind == "exit" else -1.0)
    pose = road.axis.pose(ramp.at_m + ahead * section.taper_m / 2.0, side * outward_m)
    return pose.x_m, pose.y_m, pose.heading_rad + (0.0 if forward else math.pi)


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
