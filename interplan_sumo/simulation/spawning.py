"""Where the traffic stands and how fast it drives when an episode begins.

Lane by lane, from the downstream end: centre gaps uniform from 10 m up to the
density's largest (interPlan's numbers), and the highest speed that is safe.
Vehicles that the scenario places stand where it says; the others leave them room.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import sqrt

import numpy as np

from interplan_sumo.errors import ScenarioError
from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.scenario.scenario import LARGEST_GAP_M, SMALLEST_GAP_M, Density, Scenario
from interplan_sumo.simulation.idm import acceleration_mps2, largest_speed_mps
from interplan_sumo.simulation.lane_chains import ROUTE_M, ChainedLane, chain_through, closed_spans, continued_route
from interplan_sumo.simulation.network import SumoNetwork
from interplan_sumo.simulation.obstacles import LaneBlockage
from interplan_sumo.simulation.vehicle_types import VehicleType, VehicleTypes
from interplan_sumo.world.ego import PACIFICA, EgoShape
from interplan_sumo.world.geometry import wrap_angle
from interplan_sumo.world.roads import Lane, Roads

AHEAD_M = 300.0
"""How far ahead of the ego lanes are filled."""
BEHIND_M = 120.0
"""How far behind the ego lanes are filled."""
CLEAR_M = 3.0
"""No vehicle starts nearer than this to an obstacle."""
HOLD_S = 3.0
"""No vehicle may hit another within this time if all hold their speed (benchmark.md)."""
HARDEST_FIRST_BRAKING_MPS2 = 2.9
"""Just milder than the 3 m/s2 that the benchmark allows in the first step."""
CAR_LENGTH_M = 5.0
"""Gaps are meant for cars up to this length; longer vehicles add the rest."""
STOPPING_MPS2 = 1.5
"""Comfortable braking towards a light or a junction that may not be open."""
LINE_M = 1.0
"""SUMO's cars stop this far before the end of their lane."""


@dataclass(frozen=True, slots=True, eq=False)
class StagedScenario:
    """A scenario on its map and its SUMO network, with the types that its traffic is drawn from."""

    scenario: Scenario
    roads: Roads
    network: SumoNetwork
    ids: NetworkIds
    types: VehicleTypes
    shape: EgoShape = PACIFICA


@dataclass(frozen=True, slots=True)
class Spawn:
    """One agent at the start."""

    lane: str
    """SUMO lane."""
    position_m: float
    """SUMO's lane position of the front bumper."""
    speed_mps: float
    driver: VehicleType
    route: tuple[str, ...]
    """SUMO edges."""


@dataclass(frozen=True, slots=True, eq=False)
class FilledLane:
    """A chain of lanes that has been filled, and where the filling ended."""

    chain: list[ChainedLane]
    begin_m: float
    """Where the filled part begins, along the chain."""
    next_m: float
    """Where the centre of the next vehicle upstream would have been."""
    largest_gap_m: float


@dataclass(frozen=True, slots=True)
class Population:
    """Everyone at the start."""

    spawns: tuple[Spawn, ...]
    """In a fixed order, those that the scenario places first."""
    filled: tuple[FilledLane, ...]


@dataclass(frozen=True, slots=True)
class _Fixed:
    """A vehicle on a chain whose place and speed are given: the ego, or one that the scenario places."""

    centre_m: float
    length_m: float
    speed_mps: float
    driver: VehicleType | None
    """None: the ego."""
    limit_mps: float

    def room_m(self) -> float:
        """From its centre to the next one ahead, at least."""
        longer_m = max(0.0, self.length_m - CAR_LENGTH_M) if self.driver is not None else 0.0
        return SMALLEST_GAP_M + longer_m

    def follows(self, gap_m: float, leader_mps: float) -> bool:
        """Whether it may start this far behind a leader."""
        if not safe(self.speed_mps, gap_m, leader_mps):
            return False
        braking = -HARDEST_FIRST_BRAKING_MPS2
        driver = self.driver
        return driver is None or (
            acceleration_mps2(driver, self.speed_mps, self.limit_mps, gap_m, leader_mps) >= braking
        )


def populate(
    staged: StagedScenario,
    blocked: tuple[LaneBlockage, ...],
    rng: np.random.Generator,
    reach_m: tuple[float, float] = (BEHIND_M, AHEAD_M),
) -> Population:
    """All agents of a scenario at the start; none that is drawn stands on a blocked stretch.

    `reach_m` is how far behind and ahead of the ego lanes are filled.
    ScenarioError or VehicleTypeError if a placed vehicle cannot start.
    """
    scenario, roads, network = staged.scenario, staged.roads, staged.network
    behind_m, ahead_m = reach_m
    placed = [_placed(staged, i, rng) for i in range(len(scenario.vehicles))]
    spawns = list(placed)
    filled: list[FilledLane] = []
    used: set[str] = set()
    start = roads[scenario.start.lane]
    ego_x, ego_y, _ = start.centerline.poses_at(scenario.start.arc_m)[0]
    own = roads.roadblocks[start.roadblock_id].lane_ids
    plan: list[tuple[str, Density, float, float]] = []
    demand = scenario.traffic
    plan.extend((lane, demand.density, behind_m, ahead_m) for lane in own)
    plan.extend((lane, demand.oncoming, ahead_m, behind_m) for lane in oncoming_lanes(roads, scenario))
    for lane_id, density, upstream_m, downstream_m in plan:
        if density == "none":
            continue
        arc_m, _ = roads[lane_id].centerline.project_point(ego_x, ego_y)
        chain = chain_through(network, *staged.ids.sumo_place(lane_id, arc_m), used, upstream_m, downstream_m)
        used.update(stretch.lane.id for stretch in chain)
        if not chain:
            continue
        fixed = _fixed(chain, placed)
        if lane_id == start.id:
            fixed.append(_Fixed(0.0, staged.shape.length_m, scenario.start_speed_mps, None, 0.0))
        fixed.sort(key=lambda each: -each.centre_m)
        span = (max(chain[0].start_m, -upstream_m), min(chain[-1].end_m, downstream_m))
        closed = closed_spans(chain, blocked)
        found, next_m = _fill(network, chain, span, closed, LARGEST_GAP_M[density], staged.types, fixed, rng)
        spawns += found
        filled.append(FilledLane(chain, span[0], next_m, LARGEST_GAP_M[density]))
    return Population(tuple(spawns), tuple(filled))


def _placed(staged: StagedScenario, number: int, rng: np.random.Generator) -> Spawn:
    """One of the vehicles that the scenario places: its centre where it says, at the speed that it says."""
    scenario, network = staged.scenario, staged.network
    vehicle = scenario.vehicles[number]
    what = f"{scenario.id}: vehicles[{number}]"
    lane = staged.roads[vehicle.place.lane]
    if not isinstance(lane, Lane):
        raise ScenarioError(f"{what} starts on connector {lane.id}, inside a junction; place it on a lane")
    driver = staged.types.draw_kind(vehicle.kind, rng)
    half_m, length_m = driver.length_m / 2.0, lane.centerline.length_m
    if not half_m <= vehicle.place.arc_m <= length_m - half_m:
        raise ScenarioError(
            f"{what} ({vehicle.kind}, {driver.length_m:g} m long) reaches beyond lane {lane.id} at "
            f"{vehicle.place.arc_m:g} m; place its centre between {half_m:.1f} and {length_m - half_m:.1f} m"
        )
    if vehicle.speed_mps > driver.max_speed_mps:
        raise ScenarioError(
            f"{what}.speed_mps is {vehicle.speed_mps:g}, its type {driver.name!r} reaches {driver.max_speed_mps:g}"
        )
    sumo_lane, fraction = staged.ids.sumo_place(lane.id, vehicle.place.arc_m + half_m)
    position_m = fraction * network.lanes[sumo_lane].length_m
    return Spawn(sumo_lane, position_m, vehicle.speed_mps, driver, continued_route(network, sumo_lane, ROUTE_M, rng))


def _fixed(chain: list[ChainedLane], placed: Sequence[Spawn]) -> list[_Fixed]:
    """Those of the placed vehicles that start on a chain."""
    stretches = {stretch.lane.id: stretch for stretch in chain}
    return [
        _Fixed(
            stretches[each.lane].start_m + each.position_m - each.driver.length_m / 2.0,
            each.driver.length_m,
            each.speed_mps,
            each.driver,
            stretches[each.lane].lane.limit_mps,
        )
        for each in placed
        if each.lane in stretches
    ]


def oncoming_lanes(roads: Roads, scenario: Scenario) -> tuple[str, ...]:
    """Lanes of the opposite direction beside the ego's start, from the middle of the road outwards.

    Looks at points 1 m apart across the road, up to 25 m to the side on which
    oncoming traffic drives, and takes the first roadblock of opposite heading.
    """
    line = roads[scenario.start.lane].centerline
    side = 1.0 if roads.driving_side == "right" else -1.0
    heading = line.pose_at(scenario.start.arc_m).heading_rad
    for across_m in range(2, 26):
        there = line.pose_at(scenario.start.arc_m, side * across_m)
        for lane_id in roads.lanes_at(there.x_m, there.y_m):
            lane = roads[lane_id]
            arc_m, _ = lane.centerline.project_point(there.x_m, there.y_m)
            turn = abs(wrap_angle(lane.centerline.pose_at(arc_m).heading_rad - heading))
            if isinstance(lane, Lane) and turn > np.radians(150.0):
                return roads.roadblocks[lane.roadblock_id].lane_ids
    return ()


def _fill(
    network: SumoNetwork, chain: list[ChainedLane], span: tuple[float, float], closed: list[tuple[float, float]],
    largest_gap_m: float, types: VehicleTypes, fixed: Sequence[_Fixed], rng: np.random.Generator,
) -> tuple[list[Spawn], float]:  # fmt: skip
    """Agents on one chain, from its downstream end, and where the next one would have been.

    `fixed` are the vehicles on the chain whose places are given, from downstream on.
    """
    placed: list[tuple[Spawn, float]] = []  # with the place of the rear bumper along the chain
    leader: tuple[float, float] | None = None  # rear bumper and speed
    waiting = list(fixed)
    lowest_m, centre_m = span
    while True:
        centre_m -= rng.uniform(SMALLEST_GAP_M, largest_gap_m)
        taken = False
        while waiting and centre_m < waiting[0].centre_m + waiting[0].room_m():
            here = waiting.pop(0)
            _make_room(placed, here)
            leader = (here.centre_m - here.length_m / 2, here.speed_mps)
            if centre_m > here.centre_m - SMALLEST_GAP_M:  # this slot is its
                centre_m, taken = here.centre_m, True
        if taken:
            continue
        if centre_m < lowest_m:
            for here in waiting:
                _make_room(placed, here)
            return [spawn for spawn, _ in placed], centre_m
        driver = types.draw(rng)
        centre_m -= max(0.0, driver.length_m - CAR_LENGTH_M)
        front_m = centre_m + driver.length_m / 2
        rear_m = front_m - driver.length_m
        stretch = next((s for s in chain if s.start_m <= rear_m and front_m <= s.end_m), None)
        if stretch is None or stretch.lane.internal:
            continue  # none starts inside a junction
        if any(start_m < front_m + CLEAR_M and rear_m - CLEAR_M < end_m for start_m, end_m in closed):
            continue
        standing = min((start_m for start_m, _ in closed if start_m > front_m), default=None)
        ahead = leader if standing is None or (leader is not None and leader[0] < standing) else (standing, 0.0)
        follows = (ahead[0] - front_m, ahead[1]) if ahead is not None else None
        line_m = _next_line_m(network, chain, front_m)
        speed_mps = start_speed_mps(driver, stretch.lane.limit_mps, line_m, follows)
        if speed_mps is None:
            continue
        route = continued_route(network, stretch.lane.id, ROUTE_M, rng)
        placed.append((Spawn(stretch.lane.id, front_m - stretch.start_m, speed_mps, driver, route), rear_m))
        leader = (rear_m, speed_mps)


def _make_room(placed: list[tuple[Spawn, float]], here: _Fixed) -> None:
    """Take away those ahead of a fixed vehicle that it could not follow."""
    front_m = here.centre_m + here.length_m / 2
    while placed and not here.follows(placed[-1][1] - front_m, placed[-1][0].speed_mps):
        placed.pop()


def _next_line_m(network: SumoNetwork, chain: list[ChainedLane], front_m: float) -> float | None:
    """How far ahead the next junction is that may not be open at the start."""
    for part in chain:
        if part.end_m >= front_m and part.link is not None and not network.opens_freely(part.link):
            return part.end_m - front_m
    return None


def safe(speed_mps: float, gap_m: float, leader_mps: float) -> bool:
    """Whether a follower does not hit its leader within the hold time."""
    return gap_m > 0.5 and (speed_mps - leader_mps) * HOLD_S <= gap_m - 0.5


def start_speed_mps(
    driver: VehicleType, limit_mps: float, line_m: float | None, leader: tuple[float, float] | None,
    *, hardest_mps2: float = HARDEST_FIRST_BRAKING_MPS2,
) -> float | None:  # fmt: skip
    """The highest safe start speed; None where even standing is not safe.

    `line_m` is how far ahead the next junction is that may not be open,
    `leader` the gap to, and the speed of, the next one ahead, `hardest_mps2`
    the hardest braking that following it, or stopping, may take at once.
    """
    allowed = [limit_mps * driver.speed_factor, driver.max_speed_mps]
    meets: list[Callable[[float], bool]] = []
    if line_m is not None:
        room_m = max(0.0, line_m - LINE_M)
        allowed.append(sqrt(2.0 * STOPPING_MPS2 * room_m))
        meets.append(partial(_stops_mildly, driver, limit_mps, room_m, hardest_mps2))
    if leader is None:
        return largest_speed_mps(allowed, meets)
    gap_m, leader_mps = leader
    if gap_m <= driver.min_gap_m:
        return None

    def in_equilibrium(speed_mps: float) -> bool:
        return acceleration_mps2(driver, speed_mps, limit_mps, gap_m, speed_mps) >= 0.0

    def brakes_mildly(speed_mps: float) -> bool:
        return acceleration_mps2(driver, speed_mps, limit_mps, gap_m, leader_mps) >= -hardest_mps2

    def holds(speed_mps: float) -> bool:
        return safe(speed_mps, gap_m, leader_mps)

    return largest_speed_mps(allowed, [*meets, in_equilibrium, brakes_mildly, holds])


def _stops_mildly(driver: VehicleType, limit_mps: float, room_m: float, hardest_mps2: float, speed_mps: float) -> bool:
    """Whether a car stops at a line `room_m` ahead with a mild first step; SUMO's IDM keeps no gap to it (measured)."""
    free = replace(driver, min_gap_m=0.0)
    return speed_mps == 0.0 or acceleration_mps2(free, speed_mps, limit_mps, room_m, 0.0) >= -hardest_mps2
