"""Reactions: which agent reacts to the ego, from when, and how, decided per agent and step.

SUMO sees the ego as a car on the centre line of one lane. Whether a driver
sees it is not left to SUMO: the share f of the ego's box inside the driver's
own corridor (his lane and its continuation) is held against a threshold of
his vehicle type. He starts to react when f > 0 and f >= min(threshold, 0.98),
or when the ego's centre has been in his corridor as his leader for 2 s, and
goes on until f = 0. From that follows one of four ways to treat him:

| reacts | SUMO sees the ego in his corridor | treatment |
|---|---|---|
| no | no | LEAVE him to SUMO |
| no | yes | IGNORE: SUMO is told to overlook the ego |
| yes | yes, driving his way | LEAVE him to SUMO, which follows the ego |
| yes | no, or oncoming, backing, athwart | IMPOSE the speed that IDM demands |

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
"""After this time with its centre in a driver's corridor the ego is his leader whatever the overlap."""
LOOKAHEAD_M = 150.0
"""How far ahead drivers care for the ego."""
ATHWART = 0.85
"""Below this cosine between the ego's motion and the lane SUMO's idea of the ego is too wrong to be left alone."""
_TOUCH = 1e-6  # shares below this are rounding


class Treatment(Enum):
    """What is done about one agent in one step."""

    LEAVE = "leave"
    IGNORE = "ignore"
    IMPOSE = "impose"


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

    covers: Mapping[str, LaneCoverage]
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

    treatment: Treatment
    overlap: float
    """f at this step."""
    reacting: bool
    speed_mps: float | None = None
    """The speed to impose for the next step; None: SUMO's own."""
    at_limit: bool = False
    """Whether the driver brakes as hard as he can, which is less than he would have to."""


def cover_of_one_lane(
    lane: NetworkLane, near_m: float, corners: Ring, velocity_mps: tuple[float, float]
) -> dict[str, LaneCoverage] | None:
    """What a box in SUMO's frame covers if it lies wholly inside one normal lane; None if it does not.

    The quick way for most steps: normal lanes do not overlap, so there is
    nothing else to find. `near_m` is a lane position within a box length.
    """
    if lane.internal:
        return None
    track, here_m, half_m = lane.track, lane.arc_of(near_m), lane.width_m / 2.0
    arcs: list[float] = []
    for x, y in corners:
        arc_m, left_m = track.project(x, y, (here_m - LOCAL_M, here_m + LOCAL_M))
        if abs(left_m) > half_m:
            return None
        arcs.append(arc_m)
    first, last = min(arcs), max(arcs)
    if first <= 0.0 or last >= track.length_m:
        return None
    speed_mps = track.speed_along((first + last) / 2.0, velocity_mps)
    return {lane.id: LaneCoverage(1.0, lane.position_of(first), lane.position_of(last), speed_mps)}


def cover(near: Iterable[LanePiece], area: ClipArea, velocity_mps: tuple[float, float]) -> dict[str, LaneCoverage]:
    """What an area in SUMO's frame covers of each lane; `velocity_mps` is the ego's, in the same frame.

    `near` are the strips of lanes that the area may touch; lanes come in their order.
    """
    whole_m2 = abs(area_m2(area.ring))
    covers: dict[str, LaneCoverage] = {}
    for strip in near:
        track, parts_m2 = strip.track, 0.0
        first, last = inf, -inf
        for tile in strip.tiles:
            part = area.on(tile)
            if not part:
                continue
            parts_m2 += abs(area_m2(part))
            for x, y in part:
                arc_m = track.arc_on(tile.segment, x, y) if tile.segment is not None else track.project(x, y)[0]
                first, last = min(first, arc_m), max(last, arc_m)
        share = parts_m2 / whole_m2
        if share <= _TOUCH:
            continue
        lane, before = strip.lane, covers.get(strip.lane.id)
        start_m, end_m = lane.position_of(strip.start_m + first), lane.position_of(strip.start_m + last)
        if before is None:
            covers[lane.id] = LaneCoverage(share, start_m, end_m, track.speed_along((first + last) / 2.0, velocity_mps))
        else:
            start_m, end_m = min(start_m, before.start_m), max(end_m, before.end_m)
            covers[lane.id] = LaneCoverage(before.share + share, start_m, end_m, before.speed_mps)
    return covers


def swept(box: Ring, velocity_mps: tuple[float, float], time_s: float) -> Ring:
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
    `at_start` marks the first step: an ego that starts in a driver's lane is
    respected from the beginning.
    """
    decisions: dict[str, ReactionDecision] = {}
    for agent in agents:
        covers = ego.covers if agent.driver.anticipation_s <= 0.0 else ahead[agent.driver.anticipation_s]
        corridor, position_m = agent.corridor, agent.position_m
        overlap, nearest_m, nearest, leads = 0.0, inf, None, False
        for lane, part in covers.items():
            start_m = corridor.get(lane)
            if start_m is None or start_m + part.end_m <= position_m:
                continue  # not his way, or behind him
            overlap += part.share
            leads = leads or lane in ego.centre_lanes
            if start_m + part.start_m < nearest_m:
                nearest_m, nearest = start_m + part.start_m, part
        anchor_m = corridor.get(ego.anchor_lane) if ego.anchor_lane is not None else None
        rear_m = position_m - agent.driver.length_m  # SUMO may brake for whatever is not wholly behind
        sees = anchor_m is not None and anchor_m + ego.anchor_position_m > rear_m
        attention = memory.get(agent.id)
        if attention is None:
            if nearest is None and not sees:
                continue
            attention = memory[agent.id] = ReactionMemory()
        if nearest is None:
            attention.reacting = False
            attention.centre_in_corridor_s = 0.0
            decisions[agent.id] = ReactionDecision(Treatment.IGNORE if sees else Treatment.LEAVE, 0.0, False)
            continue
        overlap = min(1.0, overlap)
        attention.centre_in_corridor_s = attention.centre_in_corridor_s + dt_s if leads else 0.0
        if overlap >= min(agent.driver.react_overlap, FULLY_MERGED):
            attention.reacting = True
        if leads and (at_start or attention.centre_in_corridor_s >= LEADER_AFTER_S - 1e-9):
            attention.reacting = True
        if not attention.reacting:
            decisions[agent.id] = ReactionDecision(Treatment.IGNORE if sees else Treatment.LEAVE, overlap, False)
        elif sees and nearest.speed_mps >= ATHWART * ego.speed_mps and ego.speed_mps >= 0.0:
            _, at_limit = _next_speed_mps(agent, nearest_m - position_m, nearest.speed_mps, dt_s)
            decisions[agent.id] = ReactionDecision(Treatment.LEAVE, overlap, True, at_limit=at_limit)
        else:
            wanted = _next_speed_mps(agent, nearest_m - position_m, nearest.speed_mps, dt_s)
            decisions[agent.id] = ReactionDecision(Treatment.IMPOSE, overlap, True, *wanted)
    return decisions


def yield_to(
    agents: Iterable[Agent],
    things: Mapping[str, Sequence[tuple[str, LaneCoverage]]],
    decisions: Mapping[str, ReactionDecision],
    dt_s: float,
) -> dict[str, ReactionDecision]:
    """`decisions` with the speeds lowered that agents need to follow, or stop before, what is in their corridor.

    `things` are, by SUMO lane, names and covers of pedestrians (nameless) and
    of bodies of other agents, which do not concern their own driver. Everyone
    yields to them, whatever the type.
    """
    decided = dict(decisions)
    for agent in agents:
        leader = _hardest_to_follow(agent, things)
        if leader is None:
            continue
        speed_mps, at_limit = _next_speed_mps(agent, *leader, dt_s)
        before = decided.get(agent.id, ReactionDecision(Treatment.IMPOSE, 0.0, False))
        if before.speed_mps is not None:
            speed_mps = min(speed_mps, before.speed_mps)
        if before.at_limit:
            speed_mps, at_limit = min(speed_mps, _hardest_mps(agent, dt_s)), True
        treatment = Treatment.IGNORE if before.treatment is Treatment.IGNORE else Treatment.IMPOSE
        decided[agent.id] = ReactionDecision(treatment, before.overlap, before.reacting, speed_mps, at_limit)
    return decided


def _hardest_to_follow(
    agent: Agent, things: Mapping[str, Sequence[tuple[str, LaneCoverage]]]
) -> tuple[float, float] | None:
    """Gap and speed, not below 0, of the thing ahead for which IDM brakes hardest: largest wished gap per gap."""
    name, driver, position_m, speed_mps, _, ahead = agent
    comfort_mps2 = 2.0 * sqrt(driver.accel_mps2 * driver.decel_mps2)
    found: tuple[float, float] | None = None
    most = -1.0
    for lane, parts in things.items():
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
    """The speed after a step of braking as hard as the driver can."""
    return max(0.0, agent.speed_mps - agent.driver.emergency_decel_mps2 * dt_s)
