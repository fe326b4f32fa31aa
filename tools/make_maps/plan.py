"""The vocabulary of road plans: what one writes down to describe a district.

A plan is a handful of roads, each an axis with cross-sections, and the places
where they meet. All lanes, tapers, pockets, connectors, stop lines and kerbs
follow from it by rule, so a district fits on a page, `plans/<name>.yaml`.

*Inner* means next to the axis of the road, *kerb* means away from it, so that
one plan reads the same for both driving sides: the inner pocket is a left-turn
pocket where one drives on the right and a right-turn pocket where one drives on
the left. Coordinates are metres east and north of the district's origin.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
import yaml
from msgspec.structs import replace

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


class _Part(msgspec.Struct, frozen=True, forbid_unknown_fields=True, dict=True):
    """Whatever a plan is made of, with the fields that its YAML has."""


class Carriageway(_Part, frozen=True):
    """One direction of a road: equal lanes beside a median, or on both sides of the axis of a one-way street."""

    lanes: int
    limit_kmh: float
    width_m: float
    """Of each lane."""
    median_m: float = 0.0
    """Its full width."""
    one_way: bool = False
    parking_m: float = 0.0
    """Width of the kerb parking beside the last lane, 0 without."""
    far_parking_m: float = 0.0
    """Width of the parking beside the first lane, on one-way streets."""

    @property
    def widths_m(self) -> tuple[float, ...]:
        """From the inner lane to the kerb."""
        return (self.width_m,) * self.lanes

    @property
    def inner_m(self) -> float:
        """Distance of the first lane's inner edge from the axis; negative on one-way streets."""
        return -self.lanes * self.width_m / 2.0 if self.one_way else self.median_m / 2.0


class RoadSection(_Part, frozen=True):
    """The cross-section of a road from one station on."""

    from_m: float = 0.0
    forward: Carriageway | None = None
    backward: Carriageway | None = None
    taper_m: float = 40.0
    """Length over which lanes are gained, lost or shifted, centred on `from_m`."""


@dataclass(frozen=True, slots=True)
class BusStop:
    """A stop for one bus, at the kerb or in a bay of its own."""

    direction: Direction
    at_m: float
    """Station of its middle."""
    bay: bool


class PlannedCrossing(_Part, frozen=True):
    """A pedestrian crossing away from junctions."""

    at_m: float
    signal: bool = False


class CarPark(_Part, frozen=True):
    """A car park behind the sidewalk, with a driveway in its middle."""

    direction: Direction
    from_m: float
    to_m: float
    depth_m: float = 32.0


class Road(_Part, frozen=True):
    """A named road: an axis, its cross-sections, and what stands along the kerb."""

    number: int
    """10 to 99: the leading digits of all its ids."""
    name: str
    points: tuple[tuple[float, ...], ...]
    """Polygon of tangents, see `geometry.alignment`; of a ramp those away from the carriageway."""
    sections: tuple[RoadSection, ...]
    bus_stops: tuple[float, ...] = ()
    """Stations, negative ones for traffic that drives backward."""
    bays: tuple[float, ...] = ()
    """Those of the bus stops that have a bay."""
    crossings: tuple[PlannedCrossing, ...] = ()
    car_parks: tuple[CarPark, ...] = ()
    sidewalk_m: float = 2.5
    """0 without sidewalks."""

    @cached_property
    def axis(self) -> Alignment:
        return alignment(self.points)

    @property
    def stops(self) -> tuple[BusStop, ...]:
        return tuple(BusStop("forward" if at > 0 else "backward", abs(at), at in self.bays) for at in self.bus_stops)


class PlannedApproach(_Part, frozen=True):
    """What an arm of a junction adds for the traffic that arrives on it."""

    inner_pockets: int = 0
    kerb_pockets: int = 0
    storage_m: float = 60.0
    taper_m: float = 30.0
    pocket_width_m: float = 3.1
    use: tuple[str, ...] = ()
    """Turns per lane from left to right, such as [L, LT, T, TR]; found by rule if empty."""

    @property
    def pockets(self) -> int:
        return self.inner_pockets + self.kerb_pockets

    @property
    def widened_m(self) -> tuple[float, float]:
        """How far from the stop line the pockets reach, and the taper behind them."""
        return self.storage_m, self.storage_m + self.taper_m


class PlannedJunction(_Part, frozen=True):
    """A place where roads meet; a road either passes through it or ends in it.

    An *arm* is named by its road and the side on which it leaves the junction:
    `main+` leads to higher stations of `main`, `main-` to lower ones.
    """

    number: int
    """1 to 99, the id of the intersection."""
    at: tuple[float, float]
    """Roughly where; the exact place is where the axes of the first two roads cross."""
    roads: tuple[str, ...]
    control: Control
    approaches: dict[str, PlannedApproach] = {}
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


class Ramp(_Part, frozen=True):
    """Where a one-way ramp leaves or joins the kerb lane of a carriageway.

    The carriageway must lose (exit) or gain (entry) its kerb lane in the
    section that begins at that station; the ramp starts or ends there.
    """

    road: str
    direction: Direction
    at_m: float
    ramp: str
    kind: Literal["exit", "entry"]
    bend: tuple[float, float, float]
    """Of the ramp, on the tangent of its arm: how far ahead in the direction of travel, radius, spiral length."""


class Plan(_Part, frozen=True, kw_only=True):
    """A district on paper, as `plans/<name>.yaml` has it."""

    name: str = ""
    """That of the file."""
    crs: str
    origin_m: tuple[float, float]
    """Projected coordinates of the local origin."""
    driving_side: DrivingSide
    turned_deg: float = 0.0
    """All points are given in a frame that is turned by so much, counter-clockwise."""
    carriageways: dict[str, Carriageway]
    approaches: dict[str, PlannedApproach] = {}
    """Both are written down once, for the roads and junctions that refer to them by YAML's anchors."""
    roads: tuple[Road, ...]
    junctions: tuple[PlannedJunction, ...]
    ramps: tuple[Ramp, ...] = ()

    @cached_property
    def road(self) -> Mapping[str, Road]:
        """Roads by name."""
        return {road.name: road for road in self.roads}


def read_plan(file: Path) -> Plan:
    """The plan in a YAML file, turned, its ramps led to their carriageways; ValueError names a field that is none."""
    plan = msgspec.convert(yaml.safe_load(file.read_text(encoding="utf-8")), Plan)
    cos, sin = math.cos(math.radians(plan.turned_deg)), math.sin(math.radians(plan.turned_deg))

    def turned(x_m: float, y_m: float) -> tuple[float, float]:
        return x_m * cos - y_m * sin, x_m * sin + y_m * cos

    roads = {
        road.name: replace(road, points=tuple((*turned(*point[:2]), *point[2:]) for point in road.points))
        for road in plan.roads
    }
    for ramp in plan.ramps:
        own = roads[ramp.ramp]
        arm = _ramp_arm(roads[ramp.road], plan.driving_side, ramp)
        points = (*arm, *own.points) if ramp.kind == "exit" else (*own.points, *arm[::-1])
        roads[ramp.ramp] = replace(own, points=points)
    junctions = tuple(replace(junction, at=turned(*junction.at)) for junction in plan.junctions)
    return replace(plan, name=file.stem, roads=tuple(roads.values()), junctions=junctions)


def _ramp_arm(road: Road, driving_side: DrivingSide, ramp: Ramp) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Where a ramp begins or ends, tangential to the lane that it takes up, and its bend on that tangent.

    This is the middle of the kerb lane where the taper of the section at
    `ramp.at_m` meets the ramp.
    """
    at = next(i for i, section in enumerate(road.sections) if section.from_m == ramp.at_m)
    before, section = road.sections[at - 1], road.sections[at]
    forward = ramp.direction == "forward"
    both = [one for s in (before, section) if (one := s.forward if forward else s.backward) is not None]
    wide = max(both, key=lambda one: one.lanes)
    outward_m = wide.inner_m + sum(wide.widths_m) - wide.width_m / 2.0 + GORE_M
    side = -1.0 if forward == (driving_side == "right") else 1.0
    # An exit starts behind the taper in the direction of travel, an entry ends before it.
    ahead = (1.0 if forward else -1.0) * (1.0 if ramp.kind == "exit" else -1.0)
    pose = road.axis.pose(ramp.at_m + ahead * section.taper_m / 2.0, side * outward_m)
    heading_rad = pose.heading_rad + (0.0 if forward else math.pi)
    ahead_m, *rounding = ramp.bend
    bend = (pose.x_m + ahead_m * math.cos(heading_rad), pose.y_m + ahead_m * math.sin(heading_rad), *rounding)
    return (pose.x_m, pose.y_m), bend


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


def carriageway_at(road: Road, direction: Direction, station_m: float) -> Carriageway | None:
    """The carriageway of one direction at a station."""
    section = [s for s in road.sections if s.from_m <= station_m + 1e-6][-1]
    return section.forward if direction == "forward" else section.backward


def missing_median_m(carriageway: Carriageway, approach: PlannedApproach) -> float:
    """By how much the median is too narrow for the inner pockets of an approach."""
    room_m = max(0.0, 2.0 * carriageway.inner_m - NOSE_M)
    return max(0.0, approach.inner_pockets * approach.pocket_width_m - room_m)


def strips(
    carriageway: Carriageway, approach: PlannedApproach | None = None, pushed_m: float = 0.0
) -> tuple[LaneStrip, ...]:
    """The lanes of a carriageway pushed towards the kerb, with the pockets of an approach."""
    inner_count = approach.inner_pockets if approach else 0
    kerb_count = approach.kerb_pockets if approach else 0
    pocket_m = approach.pocket_width_m if approach else 0.0
    widths = (pocket_m,) * inner_count + carriageway.widths_m + (pocket_m,) * kerb_count
    edges = np.concatenate(([0.0], np.cumsum(widths))) + carriageway.inner_m + pushed_m - inner_count * pocket_m
    return tuple(LaneStrip(float(a), float(b)) for a, b in pairwise(edges))
