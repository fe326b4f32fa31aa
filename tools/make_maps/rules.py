"""What a plan leaves to rules, written out: junctions where roads meet, roundabouts, and driveways.

Numbers tell where a thing made by rule belongs, so that ids stay when other parts of a plan change:

- junction `RRSS`: the numbers of the two roads, the lower one first; `SSRR` where they meet once more
- roundabout RR: parts of its ring `RR0001`, ...; its junctions `RR0101`, ... in the same order
- driveway `RRMMMM`: its road and the station where it leaves it, plus 5000 on the backward side; its junction likewise
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np
import shapely
from msgspec.structs import replace

from interplan_sumo.world.geometry import wrap_angle
from tools.make_maps.junction_arms import STUB_M, PlannedArm, planned_arms
from tools.make_maps.plan import (
    RANKS,
    Control,
    Plan,
    PlannedApproach,
    PlannedJunction,
    Rank,
    Road,
    RoadSection,
    Roundabout,
    carriageway_at,
    kerb_side,
)

REACH_M = 14.0
"""A road that ends this close to the axis of another one meets it."""
SAME_PLACE_M = 50.0
"""Where two roads meet that close to a place that the plan names, they meet there."""
CORNER_M: dict[Rank, float] = {"driveway": 5.5, "alley": 5.5, "street": 5.5, "avenue": 6.5, "boulevard": 8.0}
"""Of the junctions of a road with roads of its rank and above."""
RING_CORNER_M = 7.0
ISLAND_STORAGE_M, ISLAND_TAPER_M = 10.0, 18.0
"""The islands of a roundabout are so long, and the street takes so long to widen for them."""
STREET, AVENUE = RANKS.index("street"), RANKS.index("avenue")
TURN_RAD = np.radians(32.0)
"""What bends less leads straight on (`movements.STRAIGHT_RAD`)."""
LONGEST_PART_RAD = np.radians(120.0)
"""Of a ring, between two tangents."""


def written_out(plan: Plan) -> Plan:
    """The plan with every road and junction that follows by rule; ValueError where a rule finds no way."""
    rings = [_ring(plan, ring) for ring in plan.roundabouts]
    junctions = (*_junctions(plan), *(junction for _, found in rings for junction in found))
    roads = (*plan.roads, *(road for parts, _ in rings for road in parts))
    return replace(plan, roads=roads, junctions=junctions, roundabouts=())


# --- where roads meet ----------------------------------------------------------------------------


def _junctions(plan: Plan) -> Iterator[PlannedJunction]:
    """Those of the plan, completed, and all others where two roads meet."""
    listed = [junction for junction in plan.junctions if len(junction.roads) == 2 and junction.at is None]
    taken = [(junction.roads, junction.at) for junction in plan.junctions if junction.at is not None]
    numbers: set[int] = set()
    for one, other in combinations(plan.roads, 2):
        for place in _meetings(plan, one, other):
            if any({one.name, other.name} <= set(names) and _apart_m(at, place) < SAME_PLACE_M for names, at in taken):
                continue
            if any(
                {one.name, other.name} <= set(r.roads) and _apart_m(r.at, place) < r.radius_m for r in plan.roundabouts
            ):
                continue
            exception = next((j for j in listed if set(j.roads) == {one.name, other.name}), None)
            ordered = exception.roads if exception else _by_priority(one, other, place)
            low, high = sorted((one.number, other.number))
            number = next((n for n in (low * 100 + high, high * 100 + low) if n not in numbers), None)
            if number is None:
                raise ValueError(f"{one.name} and {other.name} meet more than twice")
            numbers.add(number)
            junction = exception or PlannedJunction(roads=ordered)
            yield completed(plan, replace(junction, at=place, number=junction.number or number))
    for junction in plan.junctions:
        if junction.at is not None:
            low, high = sorted(plan.road[name].number for name in junction.roads[:2])
            yield completed(plan, replace(junction, number=junction.number or low * 100 + high))


def _rank(road: Road) -> int:
    return RANKS.index(road.rank)


def _apart_m(one: Sequence[float], other: Sequence[float]) -> float:
    return float(np.hypot(one[0] - other[0], one[1] - other[1]))


def _meetings(plan: Plan, one: Road, other: Road) -> list[tuple[float, float]]:
    """Where the axes of two roads cross, or one ends at the other; along the first."""
    names = {one.name, other.name}
    if "motorway" in (one.rank, other.rank) or any({ramp.ramp, ramp.road} == names for ramp in plan.ramps):
        return []
    lines = [shapely.LineString(road.axis.poses(road.axis.grid_m)[:, :2]) for road in (one, other)]
    common = shapely.intersection(lines[0], lines[1])
    found = [(float(x_m), float(y_m)) for x_m, y_m in shapely.get_coordinates(common)]
    for line, across in ((lines[0], lines[1]), (lines[1], lines[0])):
        for end in (shapely.Point(line.coords[0]), shapely.Point(line.coords[-1])):
            if shapely.distance(end, across) < REACH_M:
                along_m = across.project(end)
                at = across.interpolate(along_m)
                beside = min(along_m, across.length - along_m) > STUB_M
                if beside and all(_apart_m((at.x, at.y), place) > 2.0 * REACH_M for place in found):
                    found.append((at.x, at.y))
    return sorted(found, key=lambda place: lines[0].project(shapely.Point(place)))


def _by_priority(one: Road, other: Road, place: tuple[float, float]) -> tuple[str, str]:
    """The road of the higher rank first, of equal ones that which goes on."""

    def weight(road: Road) -> tuple[int, bool, int]:
        station_m = road.axis.station_of(*place)
        return _rank(road), STUB_M < station_m < road.axis.length_m - STUB_M, -road.number

    first, second = sorted((one, other), key=weight, reverse=True)
    return first.name, second.name


def completed(plan: Plan, junction: PlannedJunction) -> PlannedJunction:
    """A junction with all that its plan leaves to rules."""
    roads = [plan.road[name] for name in junction.roads]
    lowest = min(_rank(road) for road in roads)
    junction = replace(junction, corner_m=junction.corner_m or CORNER_M[RANKS[lowest]])
    arms = planned_arms(plan, replace(junction, approaches={}, control="none"))
    first, second = ([arm for arm in arms.values() if arm.road is road] for road in roads[:2])
    side_street = len(roads) == 2 and lowest < AVENUE and len(second) == 1 and not junction.control
    if junction.carriageway is None and side_street and first and _median_m(first[0]) > 0.0:
        # The median is closed: one comes in and leaves on the side of the street.
        outward = kerb_side(plan, "forward") * _side_of(first[0], second[0])
        junction = replace(junction, carriageway="forward" if outward > 0.0 else "backward")
    control = junction.control or _control(plan, roads, len(arms), junction.carriageway is not None)
    junction = replace(junction, control=control)
    if junction.approaches is None:
        junction = replace(junction, approaches=_pockets(junction, arms, plan))
    if junction.crosswalks is None:
        minor = tuple(arm.key for arm in arms.values() if arm.road is not roads[0])
        by_control = {"signal": tuple(arms), "all_way_stop": tuple(arms), "stop": minor, "yield": minor, "none": ()}
        whole = junction.carriageway is None
        crossed = by_control[control] if whole else minor
        junction = replace(junction, crosswalks=crossed if lowest >= STREET else ())
    return junction


def _median_m(arm: PlannedArm) -> float:
    both = [carriageway_at(arm.road, direction, arm.cut_m) for direction in (arm.arriving, arm.leaving)]
    return min(0.0 if one is None or one.one_way else one.median_m for one in both)


def _side_of(arm: PlannedArm, minor: PlannedArm) -> float:
    """+1 where the minor arm leaves to the left of the axis of the other one's road, else -1."""
    axis, way = arm.road.axis.pose(arm.station_m), minor.road.axis.pose(minor.cut_m)
    left = -np.sin(axis.heading_rad) * (way.x_m - axis.x_m) + np.cos(axis.heading_rad) * (way.y_m - axis.y_m)
    return float(np.sign(left))


def _control(plan: Plan, roads: Sequence[Road], arms: int, one_side: bool) -> Control:
    ranks = sorted((_rank(road) for road in roads), reverse=True)
    if ranks[-1] < STREET:
        return "none"
    if one_side:
        return plan.minor
    if ranks[1] >= AVENUE or (ranks[0] > AVENUE and arms > 3):
        return "signal"
    if ranks[0] > ranks[1]:
        return plan.minor
    return "all_way_stop" if arms > 3 and plan.minor == "stop" else "none"


def _pockets(junction: PlannedJunction, arms: Mapping[str, PlannedArm], plan: Plan) -> dict[str, PlannedApproach]:
    """At lights, the pockets of roads that have some, on arms from which one turns across the oncoming traffic."""
    if junction.carriageway is not None or junction.control != "signal":
        return {}
    found: dict[str, PlannedApproach] = {}
    for arm in arms.values():
        if arm.road.pocket is not None and _turns_across(plan, arm, list(arms.values())):
            found[arm.key] = arm.road.pocket
    return found


def _turns_across(plan: Plan, arm: PlannedArm, others: Sequence[PlannedArm]) -> bool:
    inward = 1.0 if plan.driving_side == "right" else -1.0
    if carriageway_at(arm.road, arm.arriving, arm.cut_m) is None:
        return False
    return any(
        inward * float(wrap_angle(_outward_rad(other) - _outward_rad(arm) - np.pi)) > TURN_RAD
        for other in others
        if other.road is not arm.road and carriageway_at(other.road, other.leaving, other.cut_m) is not None
    )


def _outward_rad(arm: PlannedArm) -> float:
    """Where an arm leads, seen from its junction."""
    return arm.road.axis.pose(arm.cut_m).heading_rad + (0.0 if arm.sign > 0 else np.pi)


# --- roundabouts ---------------------------------------------------------------------------------


def _ring(plan: Plan, ring: Roundabout) -> tuple[list[Road], list[PlannedJunction]]:
    """The parts of a ring from leg to leg in the direction of travel, and the junctions between them."""
    around = 1.0 if plan.driving_side == "right" else -1.0
    middle = np.array(ring.at)
    bearings: dict[str, float] = {}
    for name in ring.roads:
        axis = plan.road[name].axis
        ends = axis.poses([0.0, axis.length_m])[:, :2]
        at_start = _apart_m(ends[0], ring.at) < _apart_m(ends[1], ring.at)
        x_m, y_m, _ = axis.poses(ring.radius_m + 15.0 if at_start else axis.length_m - ring.radius_m - 15.0)[0]
        bearings[name] = float(np.arctan2(y_m - middle[1], x_m - middle[0]))
    first_rad = bearings[ring.roads[0]]
    legs = sorted(ring.roads, key=lambda name: around * (bearings[name] - first_rad) % (2.0 * np.pi))
    roads: list[Road] = []
    for count, (name, following) in enumerate(zip(legs, [*legs[1:], legs[0]], strict=True), start=1):
        span = float(around * (bearings[following] - bearings[name]) % (2.0 * np.pi)) or 2.0 * np.pi
        parts = int(np.ceil(span / LONGEST_PART_RAD))
        half = span / parts / 2.0
        tangents = [bearings[name] + around * half * (2 * k + 1) for k in range(parts)]
        corners = [middle + ring.radius_m / np.cos(half) * _unit(angle) for angle in tangents]
        ends = [middle + ring.radius_m * _unit(bearings[leg]) for leg in (name, following)]
        # A hair less than fits, so that rounding leaves no room for doubt.
        points = (tuple(ends[0]), *((*corner, ring.radius_m - 1e-6) for corner in corners), tuple(ends[1]))
        road = Road(
            number=ring.number * 10000 + count,
            name=f"{ring.name}_{count}",
            points=tuple(tuple(float(value) for value in point) for point in points),
            sections=(RoadSection(forward=ring.ring),),
            rank=RANKS[max(_rank(plan.road[leg]) for leg in legs)],
        )
        roads.append(road)
    known = replace(plan, roads=(*plan.roads, *roads))
    island = PlannedApproach(island_m=ring.island_m, storage_m=ISLAND_STORAGE_M, taper_m=ISLAND_TAPER_M)
    found: list[PlannedJunction] = []
    for count, name in enumerate(legs):
        at = middle + ring.radius_m * _unit(bearings[name])
        junction = PlannedJunction(
            number=ring.number * 10000 + 101 + count,
            at=(float(at[0]), float(at[1])),
            roads=(roads[count - 1].name, roads[count].name, name),
            control="yield",
            crosswalks=(),
            corner_m=RING_CORNER_M,
            around=True,
        )
        arms = planned_arms(known, junction)
        leg = next(arm for arm in arms.values() if arm.road.name == name)
        found.append(replace(junction, approaches={leg.key: island}, crosswalks=(leg.key,)))
    return roads, found


def _unit(angle_rad: float) -> np.ndarray:
    return np.array([np.cos(angle_rad), np.sin(angle_rad)])
