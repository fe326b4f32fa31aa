"""The vocabulary of road plans: what one writes down to describe a district.

A plan is a handful of roads, each an axis with cross-sections. Where they meet,
who has priority there, driveways along them, and all lanes, tapers, pockets,
connectors, stop lines and kerbs follow by rule; what a plan says of a junction
are exceptions. So a district fits on a page, `plans/<name>.yaml`.

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
from typing import Literal, get_args

import msgspec
import numpy as np

from interplan_sumo.world.roads import DrivingSide
from tools.make_maps.geometry import Alignment, alignment

Direction = Literal["forward", "backward"]
"""Along the axis of a road or against it."""

Control = Literal["signal", "all_way_stop", "stop", "yield", "none"]
"""How a junction is controlled; at `stop` and `yield` the first road named has priority."""

Rank = Literal["driveway", "alley", "street", "avenue", "boulevard", "motorway"]
"""What a road is to others that it meets; a motorway meets nothing but its ramps."""
RANKS: tuple[Rank, ...] = get_args(Rank)

JOINT_M = 6.0
"""Length of the pass-through connectors by which long roads are cut into roadblocks."""
NOSE_M = 0.6
"""Least width of the median that remains beside a pocket."""
MAX_BLOCK_M = 300.0
"""Longer stretches are cut evenly into roadblocks below this length."""
GORE_M = 0.2
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


class Driveways(_Part, frozen=True):
    """Ways off the road by rule: one wherever there is room, `every_m` apart."""

    side: Direction
    """Which carriageway's kerb they cross; where there is a median they can be reached from that one only."""
    every_m: float
    from_m: float = 0.0
    to_m: float = math.inf
    length_m: float = 18.0
    """From the kerb on."""
    skew_deg: float = 0.0
    """By how much they lean towards higher stations."""
    park_m: tuple[float, float] | None = None
    """Width and depth of a car park at their ends; they are shallower where there is less room."""


class PlannedApproach(_Part, frozen=True):
    """What an arm of a junction adds for the traffic that arrives on it."""

    inner_pockets: int = 0
    kerb_pockets: int = 0
    storage_m: float = 60.0
    taper_m: float = 30.0
    pocket_width_m: float = 3.1
    island_m: float = 0.0
    """Width of a traffic island between the carriageways, for as long as `storage_m`."""
    use: tuple[str, ...] = ()
    """Turns per lane from left to right, such as [L, LT, T, TR]; found by rule if empty."""

    @property
    def pockets(self) -> int:
        return self.inner_pockets + self.kerb_pockets

    @property
    def widened_m(self) -> tuple[float, float]:
        """How far from the stop line the pockets reach, and the taper behind them."""
        return self.storage_m, self.storage_m + self.taper_m


class Road(_Part, frozen=True):
    """A named road: an axis, its cross-sections, and what stands along the kerb."""

    number: int
    """10 to 99: the leading digits of all its ids; of roads made by rule six digits, see `rules`."""
    name: str
    points: tuple[tuple[float, ...], ...]
    """Polygon of tangents, see `geometry.alignment`; of a ramp those away from the carriageway."""
    sections: tuple[RoadSection, ...] = ()
    both: Carriageway | None = None
    """Short for one section with equal carriageways both ways."""
    one: Carriageway | None = None
    """Short for one section that leads forward only."""
    rank: Rank = "street"
    pocket: PlannedApproach | None = None
    """How it widens, by rule, before lights at which its traffic can turn across the oncoming one."""
    bus_stops: tuple[float, ...] = ()
    """Stations, negative ones for traffic that drives backward."""
    bays: tuple[float, ...] = ()
    """Those of the bus stops that have a bay."""
    crossings: tuple[PlannedCrossing, ...] = ()
    driveways: tuple[Driveways, ...] = ()
    end_park_m: tuple[float, float] | None = None
    """Width and depth of a car park at its end."""
    sidewalk_m: float = 2.5
    """0 without sidewalks."""

    @cached_property
    def axis(self) -> Alignment:
        return alignment(self.points)

    @property
    def stops(self) -> tuple[BusStop, ...]:
        return tuple(BusStop("forward" if at > 0 else "backward", abs(at), at in self.bays) for at in self.bus_stops)


class PlannedJunction(_Part, frozen=True):
    """A place where roads meet; a road either passes through it or ends in it.

    An *arm* is named by its road and the side on which it leaves the junction:
    `main+` leads to higher stations of `main`, `main-` to lower ones.
    """

    roads: tuple[str, ...]
    at: tuple[float, float] | None = None
    """Roughly where; the exact place is where the axes of the first two roads cross. None: where they meet."""
    number: int = 0
    """The id of the intersection; 0: by rule, from the numbers of the roads."""
    control: Control | None = None
    """None: by the ranks of the roads."""
    approaches: dict[str, PlannedApproach] | None = None
    """None: the pockets that the roads have by rule."""
    crosswalks: tuple[str, ...] | None = None
    """Arms with a crosswalk; None: by the control."""
    corner_m: float = 0.0
    """Least radius of the kerb at corners; 0: by the ranks of the roads."""
    carriageway: Direction | None = None
    """Only this carriageway of the first road belongs to the junction: the median is closed and the other runs past."""
    banned: tuple[tuple[str, str], ...] = ()
    """Movements not allowed, as (from arm, to arm)."""

    around: bool = False
    """Whether it belongs to a roundabout: the ring, of which two parts meet here, is named first."""

    @property
    def name(self) -> str:
        return " and ".join(self.roads)

    @property
    def crossing(self) -> tuple[str, str]:
        """The two roads whose axes mark its middle."""
        first, second = self.roads[-2:] if self.around else self.roads[:2]
        return first, second

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


class Roundabout(_Part, frozen=True):
    """A ring of one lane around which one drives, where roads end."""

    name: str
    number: int
    """10 to 99, and of no road."""
    at: tuple[float, float]
    roads: tuple[str, ...]
    """They end in its middle."""
    ring: Carriageway
    radius_m: float = 20.0
    """Of the middle of its lane."""
    island_m: float = 3.0
    """Width of the islands between who comes and who leaves."""


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
    minor: Literal["stop", "yield"] = "stop"
    """What stands where a road meets one of a higher rank without a light."""
    driveway: Carriageway | None = None
    """Each way of all driveways."""
    roads: tuple[Road, ...]
    junctions: tuple[PlannedJunction, ...] = ()
    """Exceptions, and places where more than two roads meet."""
    roundabouts: tuple[Roundabout, ...] = ()
    ramps: tuple[Ramp, ...] = ()

    @cached_property
    def road(self) -> Mapping[str, Road]:
        """Roads by name."""
        return {road.name: road for road in self.roads}


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


def kerb_side(plan: Plan, direction: Direction) -> float:
    """+1 where the kerb of this direction is to the left of the axis, else -1."""
    return -1.0 if (direction == "forward") == (plan.driving_side == "right") else 1.0


def carriageway_at(road: Road, direction: Direction, station_m: float) -> Carriageway | None:
    """The carriageway of one direction at a station."""
    section = [s for s in road.sections if s.from_m <= station_m + 1e-6][-1]
    return section.forward if direction == "forward" else section.backward


def missing_median_m(carriageway: Carriageway, approach: PlannedApproach) -> float:
    """By how much the median is too narrow for the inner pockets of an approach, or for its island."""
    room_m = max(0.0, 2.0 * carriageway.inner_m - NOSE_M)
    pockets_m = approach.inner_pockets * approach.pocket_width_m - room_m
    return max(0.0, pockets_m, approach.island_m - max(0.0, 2.0 * carriageway.inner_m))


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
