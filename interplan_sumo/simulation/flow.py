"""Flow: vehicles that keep entering where the filled lanes begin, at their density, for the whole run.

The vehicles that would have stood farther upstream at the start wait in a
queue per chain of lanes, drawn once before the episode. The queue comes nearer
at the flow's own speed, and its first vehicle enters where the filled lanes
begin. If the ego comes near the queue, those that it would meet enter earlier,
farther upstream: none appears within its sight, but where the map ends. Where
there is no room, or no speed that meets the start rules, the first in the queue
waits, and all behind wait for it.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import cos, hypot, inf, sin

import numpy as np

from interplan_sumo.scenario.scenario import SMALLEST_GAP_M
from interplan_sumo.simulation.agent_registry import AgentRegistry
from interplan_sumo.simulation.idm import acceleration_mps2, largest_speed_mps
from interplan_sumo.simulation.lane_chains import ROUTE_M, continued_route, upstream_of
from interplan_sumo.simulation.network import HALF_FOOTPRINT_M, NetworkLink, SumoNetwork
from interplan_sumo.simulation.obstacles import LaneBlockage
from interplan_sumo.simulation.plain_polyline import PlainPolyline
from interplan_sumo.simulation.spawning import CAR_LENGTH_M, CLEAR_M, FilledLane, Spawn, safe, start_speed_mps
from interplan_sumo.simulation.vehicle_types import VehicleType, VehicleTypes
from interplan_sumo.world.ego import EgoShape, EgoState
from interplan_sumo.world.geometry import Floats, Polyline

OUT_OF_SIGHT_M = 110.0
"""No vehicle appears nearer to the ego: a planner sees the centres of boxes within 100 m, and both move in a step."""
EDGE_CLEAR_M = 50.0
"""Where the map ends vehicles may come into sight, but not nearer to the ego than this."""
COMING_NEAR_M = 160.0
"""A vehicle as near as this to the ego enters, before the ego could see it appear."""
RETRY_STEPS = 5
"""A queue looks for room twice a second."""
AHEAD_M, BEHIND_M = 150.0, 80.0
"""How far entering vehicles look for others on their lane."""
STEP_BACK_M = 2.0
"""Places farther upstream are tried in these steps."""
LANE_CHANGE_S = 3.0
"""A car that heads for the lane and will have reached it by then is on it: so long SUMO takes to change lane."""
TURNED_MPS = 6.0
"""Slower cars change lane as fast, and are turned the more."""
ENTRY_BRAKING_MPS2 = 2.4
"""No vehicle starts so fast that it, or so slowly that the one behind it, must brake harder than this."""
FASTEST_APPROACH_MPS = 35.0
"""The ego drives no faster towards a queue: so much of it is drawn for each second."""
LONGEST_HALF_M = 9.0
"""Half of the longest vehicle."""
POINT_M = 0.01
"""Shorter lanes are the cuts between the edges of a lane, which have no direction."""


@dataclass(frozen=True, slots=True)
class Arrival:
    """One vehicle in a queue."""

    gap_m: float
    """From its centre to that of the one before it."""
    driver: VehicleType
    route_seed: int


@dataclass(frozen=True, slots=True, eq=False)
class _Others:
    """All vehicles near an entry that are on its lane: arc lengths of bumpers, speeds along the lane, types."""

    rear_m: Floats
    front_m: Floats
    speed_mps: Floats
    drivers: list[VehicleType | None]
    """None: the ego."""


class Inflow:
    """The queue of one chain of lanes. Places are arc lengths along the chain's line, before 0 is off the map."""

    def __init__(
        self, network: SumoNetwork, filled: FilledLane, blocked: Sequence[LaneBlockage], arrivals: list[Arrival],
        speed_mps: float, dt_s: float, taken: set[str],
    ) -> None:  # fmt: skip
        """`arrivals` in the order in which they come; `speed_mps` is that of the flow.

        `taken` are the lanes that other queues or filled lanes have; those of this one are added.
        """
        upstream = upstream_of(network, filled.chain[0], taken, inf, turning=True)
        taken.update(stretch.lane.id for stretch in upstream)
        self._network = network
        self._stretches = [*upstream, *filled.chain]
        self._first_filled = len(upstream)
        self._line, self._starts_m = _joined([stretch.lane.line for stretch in self._stretches])
        self._track = PlainPolyline(self._line)
        self._at_edge = not network.incoming.get(self._stretches[0].lane.id)
        self._begin_m = max(LONGEST_HALF_M, self._arc_of(filled.begin_m))
        self._closed = self._closed_spans(blocked)
        self._arrivals = arrivals
        self.drivers = tuple(arrival.driver for arrival in arrivals)
        self._next = 0
        self._head_m = min(self._begin_m, self._arc_of(filled.next_m))
        self._step_m = speed_mps * dt_s
        self._dt_s = dt_s

    def _arc_of(self, chain_m: float) -> float:
        """Arc length on the line of a place along the chain, which SUMO measures in its own lengths."""
        first = self._stretches[0]
        if chain_m < first.start_m:
            return chain_m - first.start_m
        at = max(i for i, stretch in enumerate(self._stretches) if stretch.start_m <= chain_m)
        stretch = self._stretches[at]
        return self._starts_m[at] + stretch.lane.arc_of(min(chain_m - stretch.start_m, stretch.lane.length_m))

    def _closed_spans(self, blocked: Sequence[LaneBlockage]) -> list[tuple[float, float]]:
        starts = {stretch.lane.id: i for i, stretch in enumerate(self._stretches)}
        found: list[tuple[float, float]] = []
        for each in blocked:
            at = starts.get(each.lane)
            if at is not None:
                lane, start_m = self._stretches[at].lane, self._starts_m[at]
                found.append((start_m + lane.arc_of(each.start_m), start_m + lane.arc_of(each.end_m)))
        return found

    def advance(self) -> None:
        """The queue comes nearer by one step; past where it enters only as far as it goes between two looks."""
        self._head_m = min(self._begin_m + RETRY_STEPS * self._step_m, self._head_m + self._step_m)

    def entry(
        self, registry: AgentRegistry, ego: EgoState, shape: EgoShape, origin_m: tuple[float, float],
        opens: Callable[[NetworkLink], bool],
    ) -> Spawn | None:  # fmt: skip
        """The first in the queue, if it enters now; `opens` tells which links are open."""
        if self._next >= len(self._arrivals):
            return None
        x_m, y_m = ego.x_m - origin_m[0], ego.y_m - origin_m[1]
        if self._head_m < self._begin_m and not self._is_near(self._head_m, x_m, y_m, COMING_NEAR_M):
            return None
        arrival = self._arrivals[self._next]
        centre_m = self._place(arrival.driver, x_m, y_m)
        if centre_m is None:
            return None
        self._head_m = centre_m
        others = self._others(centre_m, registry, ego, shape, origin_m)
        found = self._start(centre_m, arrival, others, opens)
        if found is not None:
            self._next += 1
            gap_m = self._arrivals[self._next].gap_m if self._next < len(self._arrivals) else inf
            self._head_m = centre_m - gap_m
        return found

    def _is_near(self, arc_m: float, x_m: float, y_m: float, reach_m: float) -> bool:
        pose = self._track.pose_at(arc_m)
        return hypot(pose.x_m - x_m, pose.y_m - y_m) - min(0.0, arc_m) < reach_m

    def _place(self, driver: VehicleType, x_m: float, y_m: float) -> float | None:
        """Where the centre of the first in the queue can be: at its place or upstream, on a lane, out of sight."""
        half_m, centre_m = driver.length_m / 2.0, self._head_m
        while centre_m >= half_m:
            edge = self._at_edge and centre_m < 2.0 * LONGEST_HALF_M
            clear_m = EDGE_CLEAR_M if edge else OUT_OF_SIGHT_M
            if self._fits(centre_m - half_m, centre_m + half_m) and not self._is_near(centre_m, x_m, y_m, clear_m):
                return centre_m
            centre_m -= STEP_BACK_M
        return None

    def _fits(self, rear_m: float, front_m: float) -> bool:
        """Whether a stretch of the line lies on one normal lane and clear of obstacles."""
        at = self._at(front_m)
        if self._stretches[at].lane.internal or rear_m < self._starts_m[at] or front_m > self._end_m(at):
            return False
        return all(front_m + CLEAR_M <= start_m or end_m <= rear_m - CLEAR_M for start_m, end_m in self._closed)

    def _at(self, arc_m: float) -> int:
        """The stretch at an arc length."""
        return max(0, bisect_right(self._starts_m, arc_m) - 1)

    def _end_m(self, at: int) -> float:
        return self._starts_m[at] + self._stretches[at].lane.line.length_m

    def _others(
        self, centre_m: float, registry: AgentRegistry, ego: EgoState, shape: EgoShape, origin_m: tuple[float, float]
    ) -> _Others:
        """All vehicles near a place that are on the lane, or reach into it, where they will be after the step."""
        heading, half_m = np.append(registry.kinematics.heading_rad, ego.heading_rad), shape.length_m / 2.0
        ego_x = ego.x_m - origin_m[0] + half_m * cos(ego.heading_rad)
        ego_y = ego.y_m - origin_m[1] + half_m * sin(ego.heading_rad)
        fronts = np.append(registry.kinematics.front_m, [[ego_x, ego_y]], axis=0)
        speed = np.append(registry.kinematics.speed_mps, ego.speed_mps)
        length, width = np.append(registry.length_m, shape.length_m), np.append(registry.width_m, shape.width_m)
        pose = self._track.pose_at(centre_m)
        near = np.flatnonzero(np.hypot(fronts[:, 0] - pose.x_m, fronts[:, 1] - pose.y_m) < AHEAD_M + BEHIND_M)
        forward = np.stack((np.cos(heading[near]), np.sin(heading[near])), axis=1)
        backs = np.array((0.0, 0.5, 1.0))[:, None] * length[near]
        points = fronts[near] - backs[..., None] * forward  # (3, N, 2) front, centre, rear
        window = (centre_m - BEHIND_M, centre_m + AHEAD_M)
        arcs, lateral = (v.reshape(3, -1) for v in self._line.project(points.reshape(-1, 2), window))
        turned = heading[near] - self._line.poses_at(arcs[1])[:, 2]
        speed_along = speed[near] * np.cos(turned)
        beside_m = HALF_FOOTPRINT_M + width[near] / 2.0
        soon_m = lateral + LANE_CHANGE_S * np.maximum(speed[near], TURNED_MPS) * np.sin(turned)
        on_lane = ((np.abs(lateral) < beside_m) | (np.abs(soon_m) < beside_m) | (lateral * soon_m < 0.0)).any(axis=0)
        moved = speed_along * self._dt_s
        names = [*registry.names, None]
        return _Others(
            (arcs.min(axis=0) + moved)[on_lane],
            (arcs.max(axis=0) + moved)[on_lane],
            speed_along[on_lane],
            [None if (name := names[row]) is None else registry.drivers[name] for row in near[on_lane]],
        )

    def _start(
        self, centre_m: float, arrival: Arrival, others: _Others, opens: Callable[[NetworkLink], bool]
    ) -> Spawn | None:
        """The start of an arrival with its centre at a place; None if there is no room or no speed that is safe."""
        driver = arrival.driver
        front_m, rear_m = centre_m + driver.length_m / 2.0, centre_m - driver.length_m / 2.0
        at = self._at(front_m)
        lane = self._stretches[at].lane
        ahead = others.front_m > centre_m
        leaders = [(float(others.rear_m[i]), float(others.speed_mps[i])) for i in np.flatnonzero(ahead)]
        leaders += [(start_m, 0.0) for start_m, _ in self._closed if start_m > front_m]
        leader = min(leaders, default=None)
        follows = (leader[0] - front_m, leader[1]) if leader is not None else None
        speed_mps = start_speed_mps(
            driver, lane.limit_mps, self._next_line_m(at, front_m, opens), follows, hardest_mps2=ENTRY_BRAKING_MPS2
        )
        if speed_mps is None:
            return None
        for i in np.flatnonzero(~ahead):
            if not _may_follow(others.drivers[i], float(others.speed_mps[i]), lane.limit_mps,
                               rear_m - float(others.front_m[i]), speed_mps):  # fmt: skip
                return None
        position_m = lane.position_of(front_m - self._starts_m[at])
        return Spawn(lane.id, position_m, speed_mps, driver, self._route(at, arrival.route_seed))

    def _next_line_m(self, at: int, front_m: float, opens: Callable[[NetworkLink], bool]) -> float | None:
        """How far ahead the next junction is that may not be open."""
        for i in range(at, len(self._stretches)):
            link = self._stretches[i].link
            if link is not None and not opens(link):
                return self._end_m(i) - front_m
        return None

    def _route(self, at: int, seed: int) -> tuple[str, ...]:
        """Along the chain to where the filled lanes begin, then on as all others."""
        upto = max(at, self._first_filled)
        way = [stretch.lane.edge for stretch in self._stretches[at:upto] if not stretch.lane.internal]
        onward = continued_route(self._network, self._stretches[upto].lane.id, ROUTE_M, np.random.default_rng(seed))
        again = next((i for i, edge in enumerate(onward) if edge in way), len(onward))
        return (*way, *onward[:again])


def _joined(lines: Sequence[Polyline]) -> tuple[Polyline, list[float]]:
    """Lines that follow one another as one, and the arc length at which each begins."""
    starts_m: list[float] = []
    points: list[Floats] = []
    total_m = 0.0
    for line in lines:
        if line.length_m < POINT_M:
            starts_m.append(total_m)
            continue
        if points:
            total_m += float(np.hypot(*(line.points[0] - points[-1][-1])))
        starts_m.append(total_m)
        points.append(line.points)
        total_m += line.length_m
    return Polyline(np.concatenate(points)), starts_m


def _may_follow(
    driver: VehicleType | None, speed_mps: float, limit_mps: float, gap_m: float, leader_mps: float
) -> bool:
    """Whether a vehicle behind keeps a gap, is not endangered nor made to brake hard; the ego has no type of ours."""
    if gap_m < SMALLEST_GAP_M - CAR_LENGTH_M or not safe(speed_mps, gap_m, leader_mps):
        return False
    return driver is None or (
        gap_m > driver.min_gap_m
        and acceleration_mps2(driver, max(0.0, speed_mps), limit_mps, gap_m, leader_mps) >= -ENTRY_BRAKING_MPS2
    )


class Flow:
    """All inflows of an episode, and the ids of those that enter."""

    def __init__(self, inflows: Sequence[Inflow], tokens: Sequence[str]) -> None:
        """`tokens`: as many as there may be arrivals."""
        self._inflows = inflows
        self._tokens = iter(tokens)
        self._steps = 0
        self._looked = [0] * len(inflows)
        self.drivers = tuple(driver for inflow in inflows for driver in inflow.drivers)
        """Of all that may enter: SUMO must know them before it starts."""

    def entry(
        self, registry: AgentRegistry, ego: EgoState, shape: EgoShape, origin_m: tuple[float, float],
        opens: Callable[[NetworkLink], bool],
    ) -> tuple[str, Spawn] | None:  # fmt: skip
        """Which vehicle enters with the next step, if any, and under which id; to be called once per step."""
        self._steps += 1
        for inflow in self._inflows:
            inflow.advance()
        for number, inflow in enumerate(self._inflows):
            if self._steps - self._looked[number] < RETRY_STEPS:
                continue
            self._looked[number] = self._steps
            spawn = inflow.entry(registry, ego, shape, origin_m, opens)
            if spawn is not None:  # the next one must see this one first
                return next(self._tokens), spawn
        return None


def draw_arrivals(
    filled: FilledLane, types: VehicleTypes, duration_s: float, rng: np.random.Generator
) -> tuple[list[Arrival], float]:
    """A queue that lasts for an episode, and the flow's speed: where gaps are their mean, IDM keeps it."""
    mean_gap_m = (SMALLEST_GAP_M + filled.largest_gap_m) / 2.0
    limit_mps = filled.chain[0].lane.limit_mps
    typical = types.members[0]

    def keeps(speed_mps: float) -> bool:
        return acceleration_mps2(typical, speed_mps, limit_mps, mean_gap_m - CAR_LENGTH_M, speed_mps) >= 0.0

    speed_mps = largest_speed_mps([limit_mps], [keeps])
    arrivals: list[Arrival] = []
    left_m = duration_s * (speed_mps + FASTEST_APPROACH_MPS)
    while left_m > 0.0:
        driver = types.draw(rng)
        gap_m = float(rng.uniform(SMALLEST_GAP_M, filled.largest_gap_m)) + max(0.0, driver.length_m - CAR_LENGTH_M)
        arrivals.append(Arrival(gap_m, driver, int(rng.integers(2**32))))
        left_m -= gap_m
    return arrivals, speed_mps
