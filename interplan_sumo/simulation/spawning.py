"""Where the traffic stands and how fast it drives when an episode begins.

Lane by lane, from the downstream end: centre gaps uniform from 10 m up to the density's largest (interPlan's
numbers), and the highest speed that is safe. Vehicles that the scenario places stand where it says; the others leave
them room. At the end all look ahead along their own routes: those that are too fast for what is there start slower.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from interplan_sumo.errors import ScenarioError
from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.scenario.route import route_lanes
from interplan_sumo.scenario.scenario import LARGEST_GAP_M, SLOW_KINDS, SMALLEST_GAP_M, Density, Scenario
from interplan_sumo.simulation.idm import acceleration_mps2
from interplan_sumo.simulation.lane_chains import (
    ChainedLane,
    chain_through,
    closed_spans,
    ego_sumo_route,
    way_ahead,
)
from interplan_sumo.simulation.lane_occupancy import AHEAD_M as LOOK_AHEAD_M
from interplan_sumo.simulation.lane_occupancy import CAR_LENGTH_M, LaneOccupancy, Occupant
from interplan_sumo.simulation.light_cycles import LightCycles
from interplan_sumo.simulation.local_demand import LEAST_ROAD_M, LocalDemand, agent_route, local_demand
from interplan_sumo.simulation.network import NetworkLane, SumoNetwork, opens_freely
from interplan_sumo.simulation.obstacles import LaneBlockage
from interplan_sumo.simulation.passed_light import lights_at_start
from interplan_sumo.simulation.slow_vehicles import slow_vehicle
from interplan_sumo.simulation.start_speed import LINE_M, StartAhead, hardest_mps2, safe, start_speed_mps
from interplan_sumo.simulation.vehicle_types import VehicleType, VehicleTypes
from interplan_sumo.world.ego import PACIFICA, EgoShape
from interplan_sumo.world.geometry import wrap_angle
from interplan_sumo.world.roads import Lane, Roads

AHEAD_M, BEHIND_M = 250.0, 200.0
"""How far ahead of the ego and behind it lanes are filled, and, as far as behind it, side roads."""
CLEAR_M = 3.0
"""No vehicle starts nearer than this to an obstacle."""
FASTEST_MPS = 40.0
"""Routes are long enough for drives at this speed."""
CREEP_M = 8.0
"""Who would start this near to a line that is closed stands before it: those that creep up to it jerk."""
SWITCHING_LINE_M = 4.0
"""So far before a light that is about to leave green: who starts moving has room to stop again."""
KERB_M = 0.1
"""Without a light SUMO's cars stop only this far before the end of their lane."""
MOST_LOOKS = 20
"""A speed that is lowered lowers that of the next one behind, and so on."""


@dataclass(frozen=True, slots=True, eq=False)
class StagedScenario:
    """A scenario on its map and its SUMO network, with the types that its traffic is drawn from."""

    scenario: Scenario
    roads: Roads
    network: SumoNetwork
    ids: NetworkIds
    types: VehicleTypes
    shape: EgoShape = PACIFICA

    @property
    def route_m(self) -> float:
        """Length of the agents' routes."""
        return FASTEST_MPS * self.scenario.duration_s + AHEAD_M


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
    drawn: bool = False
    """It is left out where no start is safe and mild; the scenario asks for none in particular."""


@dataclass(frozen=True, slots=True)
class Population:
    """Everyone at the start."""

    spawns: tuple[Spawn, ...]
    """In a fixed order, those that the scenario places first."""
    demand: LocalDemand
    ego_route: tuple[str, ...]
    """SUMO edges."""
    lights: LightCycles
    """How they go on from the start."""


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
        if self.driver is None:
            return True
        ax_mps2 = acceleration_mps2(self.driver, self.speed_mps, self.limit_mps, gap_m, leader_mps)
        return ax_mps2 >= -hardest_mps2(self.driver)


_PlannedChain = tuple[str, Density, list[ChainedLane], tuple[float, float]]
"""Lane of the map that it runs through, its density, its lanes, and the stretch of it that is filled."""


def populate(
    staged: StagedScenario,
    blocked: tuple[LaneBlockage, ...],
    rng: np.random.Generator,
    reach_m: tuple[float, float] = (BEHIND_M, AHEAD_M),
    crossed: tuple[LaneBlockage, ...] = (),
) -> Population:
    """All agents of a scenario at the start; none that is drawn stands on a blocked stretch, or between ego and event.

    `reach_m` is how far behind and ahead of the ego lanes are filled, `crossed` are stretches that people will cross.
    ScenarioError or VehicleTypeError if a placed vehicle cannot start.
    """
    scenario, roads, network, (behind_m, ahead_m) = staged.scenario, staged.roads, staged.network, reach_m
    start = roads[scenario.start.lane]
    ego_x, ego_y, _ = start.centerline.poses_at(scenario.start.arc_m)[0]
    own = roads.roadblocks[start.roadblock_id].lane_ids
    plan: list[tuple[str, Density, float, float]] = []
    wanted = scenario.traffic
    plan.extend((lane, wanted.density, behind_m, ahead_m) for lane in own)
    against = oncoming_lanes(roads, scenario)
    plan.extend((lane, wanted.oncoming, ahead_m, behind_m) for lane in against)
    chains, used = list[_PlannedChain](), set[str]()
    for lane_id, density, upstream_m, downstream_m in plan:
        arc_m, _ = roads[lane_id].centerline.project_point(ego_x, ego_y)
        chain = chain_through(network, *staged.ids.sumo_place(lane_id, arc_m), used, upstream_m, downstream_m)
        used.update(stretch.lane.id for stretch in chain)
        if chain:
            span = (max(chain[0].start_m, -upstream_m), min(chain[-1].end_m, downstream_m))
            chains.append((lane_id, density, chain, span))
    ego_route = ego_sumo_route(network, staged.ids, route_lanes(roads, scenario))
    demand = local_demand(network, wanted, (*ego_route, *_edges(chains, own)), _edges(chains, against))
    placed = [_placed(staged, i, demand, rng) for i in range(len(scenario.vehicles))]
    spawns = list(placed)
    for lane_id, density, chain, span in chains:
        if density == "none":
            continue
        fixed = _fixed(chain, placed)
        if lane_id == start.id:
            fixed.append(_Fixed(0.0, staged.shape.length_m, scenario.start_speed_mps, None, 0.0))
        fixed.sort(key=lambda each: -each.centre_m)
        closed = closed_spans(chain, blocked)
        if lane_id == start.id:
            crawling = [(each.centre_m, 0.0) for each in fixed if each.driver is not None and each.driver.is_slow]
            events = (*closed, *closed_spans(chain, crossed), *crawling)
            closed.append((0.0, min((at_m for at_m, _ in events if at_m > 0.0), default=0.0)))
        drawn = _fill(chain, span, closed, LARGEST_GAP_M[density], staged.types, fixed, rng)
        for lane, front_m, speed_mps, driver in drawn:
            spawns.append(Spawn(lane, front_m, speed_mps, driver, _route(staged, lane, demand, rng), drawn=True))
    origin = staged.ids.origin_m
    occupied = LaneOccupancy(network, blocked)
    lane, fraction = staged.ids.sumo_place(scenario.start.lane, scenario.start.arc_m)
    centre_m = fraction * network.lanes[lane].length_m
    front_m = centre_m + staged.shape.length_m / 2.0
    lights = lights_at_start(network, staged.ids, scenario)
    occupied.add(lane, Occupant(front_m, front_m - staged.shape.length_m, scenario.start_speed_mps))
    if wanted.density != "none" or wanted.oncoming != "none":
        spawns += _on_side_roads(staged, demand, (ego_x - origin[0], ego_y - origin[1]), used, occupied, spawns, rng)
    spawns = settled(network, spawns, occupied, lights)
    return Population(tuple(spawns), demand, ego_route, lights)


def _edges(chains: Sequence[_PlannedChain], of: Sequence[str]) -> set[str]:
    return {part.lane.edge for lane, _, chain, _ in chains if lane in of for part in chain if not part.lane.internal}


def _route(staged: StagedScenario, lane: str, demand: LocalDemand, rng: np.random.Generator) -> tuple[str, ...]:
    return agent_route(staged.network, demand, lane, staged.route_m, np.random.default_rng(rng.integers(2**32)))


def _placed(staged: StagedScenario, number: int, demand: LocalDemand, rng: np.random.Generator) -> Spawn:
    """One of the vehicles that the scenario places: its centre where it says, at the speed that it says."""
    scenario, network = staged.scenario, staged.network
    vehicle = scenario.vehicles[number]
    what = f"{scenario.id}: vehicles[{number}]"
    lane = staged.roads[vehicle.place.lane]
    if not isinstance(lane, Lane):
        raise ScenarioError(f"{what} starts on connector {lane.id}, inside a junction; place it on a lane")
    driver = slow_vehicle(vehicle) if vehicle.kind in SLOW_KINDS else staged.types.draw_kind(vehicle.kind, rng)
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
    return Spawn(sumo_lane, position_m, vehicle.speed_mps, driver, _route(staged, sumo_lane, demand, rng))


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
    chain: list[ChainedLane], span: tuple[float, float], closed: list[tuple[float, float]],
    largest_gap_m: float, types: VehicleTypes, fixed: Sequence[_Fixed], rng: np.random.Generator,
) -> list[tuple[str, float, float, VehicleType]]:  # fmt: skip
    """Lane, position of the front bumper, speed and driver of agents on one chain, from its downstream end.

    `fixed` are the vehicles on the chain whose places are given, from downstream on.
    """
    placed: list[tuple[str, float, float, VehicleType]] = []
    rears_m: list[float] = []  # along the chain
    leader: tuple[float, float] | None = None  # rear bumper and speed
    waiting = list(fixed)
    lowest_m, centre_m = span
    while True:
        centre_m -= rng.uniform(SMALLEST_GAP_M, largest_gap_m)
        taken = False
        while waiting and centre_m < waiting[0].centre_m + waiting[0].room_m():
            here = waiting.pop(0)
            _make_room(placed, rears_m, here)
            leader = (here.centre_m - here.length_m / 2, here.speed_mps)
            if centre_m > here.centre_m - SMALLEST_GAP_M:  # this slot is its
                centre_m, taken = here.centre_m, True
        if taken:
            continue
        if centre_m < lowest_m:
            for here in waiting:
                _make_room(placed, rears_m, here)
            return placed
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
        speed_mps = start_speed_mps(driver, StartAhead(stretch.lane.limit_mps, leader=follows))
        if speed_mps is None:
            continue
        placed.append((stretch.lane.id, front_m - stretch.start_m, speed_mps, driver))
        rears_m.append(rear_m)
        leader = (rear_m, speed_mps)


def _make_room(placed: list[tuple[str, float, float, VehicleType]], rears_m: list[float], here: _Fixed) -> None:
    """Take away those ahead of a fixed vehicle that it could not follow."""
    front_m = here.centre_m + here.length_m / 2
    while placed and not here.follows(rears_m[-1] - front_m, placed[-1][2]):
        placed.pop()
        rears_m.pop()


def _on_side_roads(
    staged: StagedScenario, demand: LocalDemand, ego_m: tuple[float, float], used: set[str], occupied: LaneOccupancy,
    others: Sequence[Spawn], rng: np.random.Generator,
) -> list[Spawn]:  # fmt: skip
    """Agents on all lanes but those `used` that lie within reach of the ego, each from its downstream end."""
    network = staged.network
    taken: dict[str, list[tuple[float, float]]] = {}
    found: list[Spawn] = []
    for each in others:
        taken.setdefault(each.lane, []).append((each.position_m - each.driver.length_m, each.position_m))
    for lane_id in sorted(demand.lanes - used):
        lane = network.lanes[lane_id]
        span = _within(lane, ego_m, BEHIND_M)
        if span is None:
            continue
        blocks = [*taken.get(lane_id, []), *((each.rear_m, each.front_m) for each in occupied.on(lane_id))]
        largest_m = demand.largest_gap_m[lane.edge]
        centre_m = span[1] + rng.uniform(0.0, largest_m - SMALLEST_GAP_M)
        while True:
            driver = staged.types.draw(rng)
            centre_m -= rng.uniform(SMALLEST_GAP_M, largest_m) + max(0.0, driver.length_m - CAR_LENGTH_M)
            front_m, rear_m = centre_m + driver.length_m / 2.0, centre_m - driver.length_m / 2.0
            if rear_m < span[0]:
                break
            clear_m = SMALLEST_GAP_M - CAR_LENGTH_M
            if front_m > lane.length_m or any(a < front_m + clear_m and rear_m - clear_m < b for a, b in blocks):
                continue
            speed_mps = min(lane.limit_mps * driver.speed_factor, driver.max_speed_mps)
            found.append(Spawn(lane_id, front_m, speed_mps, driver, _route(staged, lane_id, demand, rng), drawn=True))
    return found


def _within(lane: NetworkLane, ego_m: tuple[float, float], reach_m: float) -> tuple[float, float] | None:
    """The stretch of a lane, in SUMO's positions, that lies within reach of the ego."""
    if lane.line.length_m < LEAST_ROAD_M:
        return None
    line = lane.line.resampled(CAR_LENGTH_M)
    near = np.flatnonzero(np.hypot(line.points[:, 0] - ego_m[0], line.points[:, 1] - ego_m[1]) <= reach_m)
    if len(near) == 0:
        return None
    return lane.position_of(float(line.arc_m[near[0]])), lane.position_of(float(line.arc_m[near[-1]]))


def settled(network: SumoNetwork, spawns: Sequence[Spawn], occupied: LaneOccupancy, lights: LightCycles) -> list[Spawn]:
    """All at speeds that suit what lies ahead on their routes: connectors, lights, junctions, leaders, the ego.

    Those placed keep theirs where it suits, even beyond the limit; those drawn are left out if standing is not safe.
    """
    opens = partial(opens_freely, lights)
    spawns = [_up_to_the_line(network, each, lights) if each.drawn else each for each in spawns]
    ways = [way_ahead(network, each.lane, each.route, each.position_m + LOOK_AHEAD_M) for each in spawns]
    speeds: list[float | None] = [each.speed_mps for each in spawns]
    for _ in range(MOST_LOOKS):
        now = occupied.copy()
        for each, speed_mps in zip(spawns, speeds, strict=True):
            if speed_mps is not None:
                rear_m = each.position_m - each.driver.length_m
                now.add(each.lane, Occupant(each.position_m, rear_m, speed_mps, each.driver))
        before = list(speeds)
        for i, (each, way) in enumerate(zip(spawns, ways, strict=True)):
            speed_mps = speeds[i]
            if speed_mps is None:
                continue
            ahead = now.ahead_of(way, each.position_m, opens)
            slower = start_speed_mps(each.driver, ahead, most_mps=speed_mps, settled=each.drawn)
            speeds[i] = 0.0 if slower is None and not each.drawn else slower
        if speeds == before:
            break
    return [replace(each, speed_mps=mps) for each, mps in zip(spawns, speeds, strict=True) if mps is not None]


def _up_to_the_line(network: SumoNetwork, each: Spawn, lights: LightCycles) -> Spawn:
    """One that starts near the end of its lane, from where it may not drive on, where SUMO's cars stop there."""
    room_m = network.lanes[each.lane].length_m - each.position_m
    (here, *_) = way_ahead(network, each.lane, each.route, 0.0)
    if not LINE_M < room_m < CREEP_M or here.link is None or opens_freely(lights, here.link):
        return each
    light = here.link.light
    green = light is not None and lights.shown[light[0]][light[1]] == "G"
    line_m = KERB_M if light is None else SWITCHING_LINE_M if green else LINE_M
    return replace(each, position_m=each.position_m + room_m - line_m)
