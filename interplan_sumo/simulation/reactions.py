"""Reactions: which agent reacts to the ego, from when, and how, decided per agent and step.

SUMO sees the ego as a car on the centre line of one lane. Whether an agent
sees it is not left to SUMO: the share f of the ego's box inside the agent's
own corridor (its lane and what continues it) is held against a threshold of
its vehicle type. It starts to react when f > 0 and f >= min(threshold, 0.98),
or when the ego's centre has been ahead in its corridor for 2 s, and goes on
until f = 0. From that follows one of three modes:

| reacts | SUMO sees the ego in the corridor | mode |
|---|---|---|
| no | no | SUMO: the agent is left to SUMO |
| no | yes | IGNORE_EGO: SUMO is told to overlook the ego |
| yes | yes, driving the agent's way | SUMO, which follows the ego |
| yes | no, or oncoming, backing, crossing | OVERRIDE_SPEED: the speed that IDM demands |

Nothing here knows SUMO: arrays and names in, decisions out. The small values
are tuples, not data classes: a step makes dozens of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from math import inf, sqrt
from typing import NamedTuple

from interplan_sumo.simulation.anchor import LOCAL_M
from interplan_sumo.simulation.idm import SMALLEST_GAP_M, acceleration_mps2, wished_gap_m
from interplan_sumo.simulation.lane_polygons import ClipArea, Ring, area_m2, hull
from interplan_sumo.simulation.network import LanePiece, NetworkLane, NetworkLink, SumoNetwork
from interplan_sumo.simulation.vehicle_types import VehicleType

FULLY_MERGED = 0.98
"""Overlap from which the ego counts as fully merged: a box never lies to the last per cent in one lane."""
LEADER_AFTER_S = 2.0
"""After this time with its centre in an agent's corridor the ego is its leader whatever the overlap."""
LOOKAHEAD_M = 150.0
"""How far ahead of its lane an agent's corridor reaches."""
LEAST_ALIGNMENT = 0.85
"""Below this cosine between the ego's motion and the lane SUMO's idea of the ego is too wrong to follow."""
_TOUCH = 1e-6  # shares below this are rounding


class Mode(Enum):
    """Who decides what an agent does about the ego in one step."""

    SUMO = "sumo"
    IGNORE_EGO = "ignore ego"
    OVERRIDE_SPEED = "override speed"


class LaneCoverage(NamedTuple):
    """What the ego's box covers of one SUMO lane."""

    share: float
    """Of the box's area, 0 to 1."""
    start_m: float
    """Lane position where the covered part begins."""
    end_m: float
    speed_mps: float
    """The ego's speed along the lane, negative when it comes towards its traffic."""


class EgoOnNetwork(NamedTuple):
    """The ego as the reaction layer needs it, in SUMO's frame."""

    coverage: Mapping[str, LaneCoverage]
    """Per SUMO lane that the box touches."""
    centre_lanes: frozenset[str]
    """SUMO lanes that contain the box centre."""
    anchor_lane: str | None
    """The SUMO lane on which SUMO sees the ego; None while it is off the network."""
    anchor_position_m: float
    """Lane position of the front bumper there."""
    speed_mps: float
    straddles: bool
    """Whether part of the box lies outside the anchor lane and its continuations."""
    alone: bool = False
    """Whether the box lies wholly inside the anchor lane and nowhere else."""


class Agent(NamedTuple):
    """What a decision needs to know of one agent."""

    id: str
    driver: VehicleType
    position_m: float
    """Of the front bumper on its lane."""
    speed_mps: float
    limit_mps: float
    corridor: Mapping[str, float]
    """SUMO lane ahead -> distance from the start of the agent's own lane to the start of that lane."""


@dataclass(slots=True)
class ReactionMemory:
    """What is remembered of one agent from step to step."""

    reacting: bool = False
    centre_in_corridor_s: float = 0.0


class ReactionDecision(NamedTuple):
    """The outcome for one agent."""

    mode: Mode
    overlap: float
    """f at this step."""
    reacting: bool
    speed_mps: float | None = None
    """That overrides SUMO's own for the next step; None: SUMO's own."""
    at_limit: bool = False
    """Whether the agent brakes as hard as it can, which is less than it would have to."""


def coverage_of_one_lane(
    lane: NetworkLane, near_m: float, corners: Ring, velocity_mps: tuple[float, float]
) -> dict[str, LaneCoverage] | None:
    """What a box in SUMO's frame covers if it lies wholly inside one normal lane; None if it does not.

    The quick way for most steps: normal lanes do not overlap, so there is
    nothing else to find. `near_m` is a lane position within a box length.
    """
    if lane.internal:
        return None
    line, here_m, half_m = lane.plain_line, lane.arc_of(near_m), lane.width_m / 2.0
    arcs: list[float] = []
    for x, y in corners:
        arc_m, left_m = line.project(x, y, (here_m - LOCAL_M, here_m + LOCAL_M))
        if abs(left_m) > half_m:
            return None
        arcs.append(arc_m)
    first, last = min(arcs), max(arcs)
    if first <= 0.0 or last >= line.length_m:
        return None
    speed_mps = line.speed_along((first + last) / 2.0, velocity_mps)
    return {lane.id: LaneCoverage(1.0, lane.position_of(first), lane.position_of(last), speed_mps)}


def lane_coverage(
    near: Iterable[LanePiece], area: ClipArea, velocity_mps: tuple[float, float]
) -> dict[str, LaneCoverage]:
    """What an area in SUMO's frame covers of each lane; `velocity_mps` is the ego's, in the same frame.

    `near` are the pieces of lanes that the area may touch; lanes come in their order.
    """
    whole_m2 = abs(area_m2(area.ring))
    coverage: dict[str, LaneCoverage] = {}
    for piece in near:
        line, covered_m2 = piece.plain_line, 0.0
        first, last = inf, -inf
        for part in piece.convex_parts:
            covered = area.on(part)
            if not covered:
                continue
            covered_m2 += abs(area_m2(covered))
            for x, y in covered:
                arc_m = line.arc_on(part.segment, x, y) if part.segment is not None else line.project(x, y)[0]
                first, last = min(first, arc_m), max(last, arc_m)
        share = covered_m2 / whole_m2
        if share <= _TOUCH:
            continue
        lane, before = piece.lane, coverage.get(piece.lane.id)
        start_m, end_m = lane.position_of(piece.start_m + first), lane.position_of(piece.start_m + last)
        if before is None:
            coverage[lane.id] = LaneCoverage(
                share, start_m, end_m, line.speed_along((first + last) / 2.0, velocity_mps)
            )
        else:
            start_m, end_m = min(start_m, before.start_m), max(end_m, before.end_m)
            coverage[lane.id] = LaneCoverage(before.share + share, start_m, end_m, before.speed_mps)
    return coverage


def swept_area(box: Ring, velocity_mps: tuple[float, float], time_s: float) -> Ring:
    """The area that a box covers in `time_s` at constant velocity and heading."""
    if time_s <= 0.0 or velocity_mps == (0.0, 0.0):
        return box
    dx, dy = velocity_mps[0] * time_s, velocity_mps[1] * time_s
    return hull([*box, *((x + dx, y + dy) for x, y in box)])


def corridor(network: SumoNetwork, lane: str, route: tuple[str, ...]) -> dict[str, float]:
    """The lanes that an agent on `lane` will drive on along `route`, with the distance to the start of each.

    Ends where the agent must change lane first. An agent inside a junction
    has the rest of the junction and the lane behind it in its corridor.
    """
    found = {lane: 0.0}
    here = network.lanes[lane]
    distance_m = here.length_m
    if here.internal:
        link = _link_through(network, lane, route)
        if link is None:
            return found
        inner = link.via[link.via.index(lane) + 1 :]
    else:
        link = _link_onward(network, lane, route)
        inner = link.via if link is not None else ()
    while link is not None and distance_m < LOOKAHEAD_M + here.length_m:
        for name in inner:
            found[name] = distance_m
            distance_m += network.lanes[name].length_m
        found[link.to_lane] = distance_m
        distance_m += network.lanes[link.to_lane].length_m
        link = _link_onward(network, link.to_lane, route)
        inner = link.via if link is not None else ()
    return found


def _link_onward(network: SumoNetwork, lane: str, route: tuple[str, ...]) -> NetworkLink | None:
    edge = network.lanes[lane].edge
    if edge not in route[:-1]:
        return None
    following = route[route.index(edge) + 1]
    return next((x for x in network.links[lane] if network.lanes[x.to_lane].edge == following), None)


def _link_through(network: SumoNetwork, internal: str, route: tuple[str, ...]) -> NetworkLink | None:
    pairs = set(pairwise(route))
    for way in network.ways_through(internal):
        if (network.lanes[way.from_lane].edge, network.lanes[way.to_lane].edge) in pairs:
            return way
    return None


def decide(
    agents: Iterable[Agent],
    ego: EgoOnNetwork,
    ahead: Mapping[float, Mapping[str, LaneCoverage]],
    memory: dict[str, ReactionMemory],
    dt_s: float,
    *,
    at_start: bool = False,
) -> dict[str, ReactionDecision]:
    """The decision for each agent; `memory` is updated, agents that need none are left out.

    `ahead` holds, per anticipation time above 0, what the ego's swept box covers.
    `at_start` marks the first step: an ego that starts in an agent's lane is
    respected from the beginning.
    """
    decisions: dict[str, ReactionDecision] = {}
    for agent in agents:
        coverage = ego.coverage if agent.driver.anticipation_s <= 0.0 else ahead[agent.driver.anticipation_s]
        corridor, position_m = agent.corridor, agent.position_m
        overlap, nearest_m, nearest, is_leader = 0.0, inf, None, False
        for lane, part in coverage.items():
            start_m = corridor.get(lane)
            if start_m is None or start_m + part.end_m <= position_m:
                continue  # not ahead on its way
            overlap += part.share
            is_leader = is_leader or lane in ego.centre_lanes
            if start_m + part.start_m < nearest_m:
                nearest_m, nearest = start_m + part.start_m, part
        anchor_m = corridor.get(ego.anchor_lane) if ego.anchor_lane is not None else None
        rear_m = position_m - agent.driver.length_m  # SUMO may brake for whatever is not wholly behind
        sumo_sees_ego = anchor_m is not None and anchor_m + ego.anchor_position_m > rear_m
        remembered = memory.get(agent.id)
        if remembered is None:
            if nearest is None and not sumo_sees_ego:
                continue
            remembered = memory[agent.id] = ReactionMemory()
        if nearest is None:
            remembered.reacting = False
            remembered.centre_in_corridor_s = 0.0
            decisions[agent.id] = ReactionDecision(Mode.IGNORE_EGO if sumo_sees_ego else Mode.SUMO, 0.0, False)
            continue
        overlap = min(1.0, overlap)
        remembered.centre_in_corridor_s = remembered.centre_in_corridor_s + dt_s if is_leader else 0.0
        if overlap >= min(agent.driver.react_overlap, FULLY_MERGED):
            remembered.reacting = True
        if is_leader and (at_start or remembered.centre_in_corridor_s >= LEADER_AFTER_S - 1e-9):
            remembered.reacting = True
        if not remembered.reacting:
            decisions[agent.id] = ReactionDecision(Mode.IGNORE_EGO if sumo_sees_ego else Mode.SUMO, overlap, False)
        elif sumo_sees_ego and nearest.speed_mps >= LEAST_ALIGNMENT * ego.speed_mps and ego.speed_mps >= 0.0:
            _, at_limit = _next_speed_mps(agent, nearest_m - position_m, nearest.speed_mps, dt_s)
            decisions[agent.id] = ReactionDecision(Mode.SUMO, overlap, True, at_limit=at_limit)
        else:
            wanted = _next_speed_mps(agent, nearest_m - position_m, nearest.speed_mps, dt_s)
            decisions[agent.id] = ReactionDecision(Mode.OVERRIDE_SPEED, overlap, True, *wanted)
    return decisions


def yield_to(
    agents: Iterable[Agent],
    obstructions: Mapping[str, Sequence[tuple[str, LaneCoverage]]],
    decisions: Mapping[str, ReactionDecision],
    dt_s: float,
) -> dict[str, ReactionDecision]:
    """`decisions` with the speeds lowered that agents need to follow, or stop before, what is in their corridor.

    `obstructions` are, by SUMO lane, names and coverage of pedestrians (nameless)
    and of other agents' bodies; an agent's own body does not concern it. Everyone
    yields to them, whatever the type.
    """
    decided = dict(decisions)
    for agent in agents:
        leader = _decisive_leader(agent, obstructions)
        if leader is None:
            continue
        speed_mps, at_limit = _next_speed_mps(agent, *leader, dt_s)
        before = decided.get(agent.id, ReactionDecision(Mode.OVERRIDE_SPEED, 0.0, False))
        if before.speed_mps is not None:
            speed_mps = min(speed_mps, before.speed_mps)
        if before.at_limit:
            speed_mps, at_limit = min(speed_mps, _hardest_mps(agent, dt_s)), True
        mode = Mode.IGNORE_EGO if before.mode is Mode.IGNORE_EGO else Mode.OVERRIDE_SPEED
        decided[agent.id] = ReactionDecision(mode, before.overlap, before.reacting, speed_mps, at_limit)
    return decided


def _decisive_leader(
    agent: Agent, obstructions: Mapping[str, Sequence[tuple[str, LaneCoverage]]]
) -> tuple[float, float] | None:
    """Gap and speed, not below 0, of what is ahead for which IDM brakes hardest: largest wished gap per gap."""
    name, driver, position_m, speed_mps, _, ahead = agent
    comfort_mps2 = 2.0 * sqrt(driver.accel_mps2 * driver.decel_mps2)
    found: tuple[float, float] | None = None
    most = -1.0
    for lane, parts in obstructions.items():
        start_m = ahead.get(lane)
        if start_m is None:
            continue
        for other, part in parts:
            if other == name or start_m + part.end_m <= position_m:
                continue
            gap_m, leader_mps = start_m + part.start_m - position_m, max(0.0, part.speed_mps)
            wished_m = wished_gap_m(driver, speed_mps, leader_mps, comfort_mps2)
            ratio = wished_m / max(gap_m, SMALLEST_GAP_M)
            if ratio > most:
                most, found = ratio, (gap_m, leader_mps)
    return found


def _next_speed_mps(agent: Agent, gap_m: float, leader_mps: float, dt_s: float) -> tuple[float, bool]:
    """The speed that IDM wants, as far as brakes allow, and whether it would brake harder than they do."""
    acceleration = acceleration_mps2(agent.driver, agent.speed_mps, agent.limit_mps, gap_m, leader_mps)
    if acceleration < -agent.driver.emergency_decel_mps2:
        return _hardest_mps(agent, dt_s), True
    return max(0.0, agent.speed_mps + acceleration * dt_s), False


def _hardest_mps(agent: Agent, dt_s: float) -> float:
    """The speed after a step of braking as hard as the agent can."""
    return max(0.0, agent.speed_mps - agent.driver.emergency_decel_mps2 * dt_s)
