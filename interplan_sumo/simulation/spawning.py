"""Where the traffic stands and how fast it drives when an episode begins.

Lane by lane, from the downstream end: centre gaps uniform from 10 m up to the
density's largest (interPlan's numbers), and the highest speed that is safe.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.scenario.scenario import LARGEST_GAP_M, SMALLEST_GAP_M, Density, Scenario
from interplan_sumo.simulation.idm import acceleration_mps2, largest_speed_mps
from interplan_sumo.simulation.network import Network, NetworkLane, NetworkLink
from interplan_sumo.simulation.obstacles import Blockage
from interplan_sumo.simulation.vehicle_types import VehicleType, VehicleTypes
from interplan_sumo.world.ego import EgoShape
from interplan_sumo.world.geometry import wrap_angle
from interplan_sumo.world.roads import Lane, Roads

AHEAD_M = 300.0
"""How far ahead of the ego lanes are filled."""
BEHIND_M = 120.0
"""How far behind the ego lanes are filled."""
CLEAR_M = 3.0
"""Nobody starts nearer than this to an obstacle."""
ROUTE_M = 1500.0
"""Length of an agent's route: longer than 30 s of driving at any limit of ours."""
HOLD_S = 3.0
"""Nobody may hit anybody within this time if all hold their speed (benchmark.md)."""
HARDEST_FIRST_BRAKING_MPS2 = 2.9
"""Just milder than the 3 m/s2 that the benchmark allows in the first step."""
CAR_LENGTH_M = 5.0
"""Gaps are meant for cars up to this length; longer vehicles add the rest."""
STOPPING_MPS2 = 1.5
"""Comfortable braking towards a light or a junction that may not be open."""


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


@dataclass(frozen=True, slots=True)
class _Stretch:
    """A SUMO lane as a part of a chain of lanes that follow one another; the ego's projection is at 0 m."""

    lane: NetworkLane
    start_m: float
    link: NetworkLink | None
    """The way on that the chain takes."""

    @property
    def end_m(self) -> float:
        return self.start_m + self.lane.length_m


def spawn(
    scenario: Scenario, roads: Roads, network: Network, ids: NetworkIds, types: VehicleTypes, shape: EgoShape,
    blocked: tuple[Blockage, ...], rng: np.random.Generator, reach_m: tuple[float, float] = (BEHIND_M, AHEAD_M),
) -> tuple[Spawn, ...]:  # fmt: skip
    """All agents of a scenario at the start, in a fixed order; none on a blocked stretch.

    `reach_m` is how far behind and ahead of the ego lanes are filled.
    """
    behind_m, ahead_m = reach_m
    spawns: list[Spawn] = []
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
        chain = _chain(network, *ids.sumo_place(lane_id, arc_m), used, upstream_m, downstream_m)
        used.update(stretch.lane.id for stretch in chain)
        ego = (scenario.start_speed_mps, shape.length_m) if lane_id == start.id else None
        if chain:
            span = (max(chain[0].start_m, -upstream_m), min(chain[-1].end_m, downstream_m))
            closed = _closed(chain, blocked)
            spawns += _fill(network, chain, span, closed, LARGEST_GAP_M[density], types, ego, rng)
    return tuple(spawns)


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


def continued_route(
    network: Network, lane: str, length_m: float, rng: np.random.Generator | None = None
) -> tuple[str, ...]:
    """SUMO edges from a normal lane on, without changing lane where it can be helped: straight on, else at random.

    Without `rng` the first way is taken.
    """
    here = network.lanes[lane]
    route = [here.edge]
    driven_m = 0.0
    while driven_m < length_m:
        driven_m += here.length_m
        ways = network.links[here.id]
        if not ways:
            break
        straight = [way for way in ways if way.direction == "s"]
        pool = straight or ways
        way = pool[int(rng.integers(len(pool)))] if rng is not None else next(iter(pool))
        here = network.lanes[way.to_lane]
        if here.edge in route:  # SUMO's lane choice is at its best on routes without loops
            break
        route.append(here.edge)
    return tuple(route)


def ego_sumo_route(network: Network, ids: NetworkIds, lanes: tuple[str, ...]) -> tuple[str, ...]:
    """SUMO edges along a chain of lanes and connectors of the map, and straight on behind its end."""
    edges: list[str] = []
    for lane_id in lanes:
        for piece in ids.pieces[lane_id]:
            lane = network.lanes[piece.sumo_lane]
            if not lane.internal and (not edges or edges[-1] != lane.edge):
                edges.append(lane.edge)
    last = next(p.sumo_lane for p in reversed(ids.pieces[lanes[-1]]) if not network.lanes[p.sumo_lane].internal)
    return (*edges, *(edge for edge in continued_route(network, last, 500.0)[1:] if edge not in edges))


def _chain(
    network: Network, sumo_lane: str, fraction: float, used: set[str], upstream_m: float, downstream_m: float
) -> list[_Stretch]:
    """The lane and what precedes and follows it straight on, from upstream to downstream."""
    here = network.lanes[sumo_lane]
    at_m = -fraction * here.length_m
    taken = set(used)
    if here.internal or here.id in taken:
        return []
    ahead: list[_Stretch] = []
    start_m, lane = at_m, here
    while True:
        taken.add(lane.id)
        ways = network.links[lane.id]
        straight = [way for way in ways if way.direction == "s"]
        way = next(iter(straight or ways), None)
        ahead.append(_Stretch(lane, start_m, way))
        start_m += lane.length_m
        if way is None or start_m > downstream_m or way.to_lane in taken:
            break
        for inner in way.via:
            ahead.append(_Stretch(network.lanes[inner], start_m, None))
            start_m += network.lanes[inner].length_m
        lane = network.lanes[way.to_lane]
    behind: list[_Stretch] = []
    end_m, lane = at_m, here
    while end_m > -upstream_m:
        ways = network.incoming.get(lane.id, ())
        way = next((w for w in ways if w.direction == "s" and w.from_lane not in taken), None)
        if way is None:
            break
        for inner in reversed(way.via):
            end_m -= network.lanes[inner].length_m
            behind.insert(0, _Stretch(network.lanes[inner], end_m, None))
        lane = network.lanes[way.from_lane]
        taken.add(lane.id)
        end_m -= lane.length_m
        behind.insert(0, _Stretch(lane, end_m, way))
    return behind + ahead


def _fill(
    network: Network, chain: list[_Stretch], span: tuple[float, float], closed: list[tuple[float, float]],
    largest_gap_m: float, types: VehicleTypes, ego: tuple[float, float] | None, rng: np.random.Generator,
) -> list[Spawn]:  # fmt: skip
    """Agents on one chain, from its downstream end. `ego` is (speed, length) on the ego's own lane."""
    placed: list[tuple[Spawn, float]] = []  # with the place of the rear bumper along the chain
    leader: tuple[float, float] | None = None  # rear bumper and speed
    lowest_m, centre_m = span
    while True:
        centre_m -= rng.uniform(SMALLEST_GAP_M, largest_gap_m)
        if ego is not None and centre_m < SMALLEST_GAP_M:
            (speed_mps, length_m), ego = ego, None
            while placed and not _safe(speed_mps, placed[-1][1] - length_m / 2, placed[-1][0].speed_mps):
                placed.pop()
            leader = (-length_m / 2, speed_mps)
            if centre_m > -SMALLEST_GAP_M:  # this slot is the ego's
                centre_m = 0.0
                continue
        if centre_m < lowest_m:
            return [spawn for spawn, _ in placed]
        driver = types.draw(rng)
        centre_m -= max(0.0, driver.length_m - CAR_LENGTH_M)
        front_m = centre_m + driver.length_m / 2
        rear_m = front_m - driver.length_m
        stretch = next((s for s in chain if s.start_m <= rear_m and front_m <= s.end_m), None)
        if stretch is None or stretch.lane.internal:
            continue  # nobody starts inside a junction
        if any(start_m < front_m + CLEAR_M and rear_m - CLEAR_M < end_m for start_m, end_m in closed):
            continue
        standing = min((start_m for start_m, _ in closed if start_m > front_m), default=None)
        ahead = leader if standing is None or (leader is not None and leader[0] < standing) else (standing, 0.0)
        speed_mps = _start_speed_mps(network, chain, stretch, front_m, driver, ahead)
        if speed_mps is None:
            continue
        route = continued_route(network, stretch.lane.id, ROUTE_M, rng)
        placed.append((Spawn(stretch.lane.id, front_m - stretch.start_m, speed_mps, driver, route), rear_m))
        leader = (rear_m, speed_mps)


def _closed(chain: list[_Stretch], blocked: tuple[Blockage, ...]) -> list[tuple[float, float]]:
    """Blocked stretches along a chain."""
    starts = {stretch.lane.id: stretch.start_m for stretch in chain}
    return [(starts[b.lane] + b.start_m, starts[b.lane] + b.end_m) for b in blocked if b.lane in starts]


def _safe(speed_mps: float, gap_m: float, leader_mps: float) -> bool:
    """Nobody hits anybody within the hold time."""
    return gap_m > 0.5 and (speed_mps - leader_mps) * HOLD_S <= gap_m - 0.5


def _start_speed_mps(
    network: Network, chain: list[_Stretch], stretch: _Stretch, front_m: float, driver: VehicleType,
    leader: tuple[float, float] | None,
) -> float | None:  # fmt: skip
    """The highest safe start speed; None where even standing is not safe."""
    limit_mps = stretch.lane.limit_mps
    allowed = [limit_mps * driver.speed_factor, driver.max_speed_mps]
    for part in chain:  # the next junction that may not be open
        if part.end_m >= front_m and part.link is not None and not network.opens_freely(part.link):
            allowed.append(sqrt(2.0 * STOPPING_MPS2 * max(0.0, part.end_m - front_m - 1.0)))
            break
    if leader is None:
        return largest_speed_mps(allowed, [])
    gap_m, leader_mps = leader[0] - front_m, leader[1]
    if gap_m <= driver.min_gap_m:
        return None

    def in_equilibrium(speed_mps: float) -> bool:
        return acceleration_mps2(driver, speed_mps, limit_mps, gap_m, speed_mps) >= 0.0

    def brakes_mildly(speed_mps: float) -> bool:
        return acceleration_mps2(driver, speed_mps, limit_mps, gap_m, leader_mps) >= -HARDEST_FIRST_BRAKING_MPS2

    def holds(speed_mps: float) -> bool:
        return _safe(speed_mps, gap_m, leader_mps)

    return largest_speed_mps(allowed, [in_equilibrium, brakes_mildly, holds])
