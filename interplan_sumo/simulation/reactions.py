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

Nothing here knows SUMO: arrays and names in, decisions out.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from math import cos, sin

import numpy as np
import shapely

from interplan_sumo.simulation.anchor import LOCAL_M
from interplan_sumo.simulation.idm import acceleration_mps2
from interplan_sumo.simulation.network import Network, NetworkLane, NetworkLink
from interplan_sumo.simulation.vehicle_types import VehicleType
from interplan_sumo.world.geometry import Floats, Polyline

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


@dataclass(frozen=True, slots=True)
class Cover:
    """What the ego's box covers of one SUMO lane."""

    share: float
    """Of the box's area, 0 to 1."""
    start_m: float
    """Lane position where the covered part begins."""
    end_m: float
    speed_mps: float
    """The ego's speed along the lane, negative when it comes towards its traffic."""


@dataclass(frozen=True, slots=True)
class EgoOnNetwork:
    """The ego as the reaction layer needs it, in SUMO's frame."""

    covers: Mapping[str, Cover]
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


@dataclass(frozen=True, slots=True)
class Agent:
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
class Attention:
    """What is remembered of one agent from step to step."""

    reacting: bool = False
    centre_in_corridor_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Decision:
    """The outcome for one agent."""

    treatment: Treatment
    overlap: float
    """f at this step."""
    reacting: bool
    speed_mps: float | None = None
    """The speed to impose for the next step; None: SUMO's own."""


def cover_of_one_lane(
    lane: NetworkLane, near_m: float, corners: Floats, velocity_mps: tuple[float, float]
) -> dict[str, Cover] | None:
    """What a box (4, 2) in SUMO's frame covers if it lies wholly inside one normal lane; None if it does not.

    The quick way for most steps: normal lanes do not overlap, so there is
    nothing else to find. `near_m` is a lane position within a box length.
    """
    if lane.internal:
        return None
    here_m = lane.arc_of(near_m)
    arcs, lateral = lane.line.project(corners, (here_m - LOCAL_M, here_m + LOCAL_M))
    first, last = float(arcs.min()), float(arcs.max())
    if max(-lateral.min(), lateral.max()) > lane.width_m / 2.0 or first <= 0.0 or last >= lane.line.length_m:
        return None
    return {
        lane.id: Cover(
            1.0, lane.position_of(first), lane.position_of(last), _along(lane.line, first, last, velocity_mps)
        )
    }


def _along(line: Polyline, first_m: float, last_m: float, velocity_mps: tuple[float, float]) -> float:
    """The part of a velocity along a line at the middle between two arc lengths."""
    heading = line.segment_heading_rad[line.arc_m[1:-1].searchsorted((first_m + last_m) / 2.0)]
    return velocity_mps[0] * cos(heading) + velocity_mps[1] * sin(heading)


def cover(network: Network, box: shapely.Polygon, velocity_mps: tuple[float, float]) -> dict[str, Cover]:
    """What a box in SUMO's frame covers of each lane; `velocity_mps` is the ego's, in the same frame."""
    strips, tree = network.strips
    hits = np.sort(tree.query(box))
    parts = shapely.intersection(tree.geometries[hits], box)
    shares = shapely.area(parts) / box.area
    covers: dict[str, Cover] = {}
    for i in np.flatnonzero(shares > _TOUCH):
        strip = strips[hits[i]]
        lane = strip.lane
        arcs, _ = strip.line.project(shapely.get_coordinates(parts[i]))
        first, last = float(arcs.min()), float(arcs.max())
        start_m, end_m = lane.position_of(strip.start_m + first), lane.position_of(strip.start_m + last)
        before = covers.get(lane.id)
        if before is None:
            covers[lane.id] = Cover(float(shares[i]), start_m, end_m, _along(strip.line, first, last, velocity_mps))
        else:
            share, start_m, end_m = (
                before.share + float(shares[i]),
                min(start_m, before.start_m),
                max(end_m, before.end_m),
            )
            covers[lane.id] = Cover(share, start_m, end_m, before.speed_mps)
    return covers


def swept(box: shapely.Polygon, velocity_mps: tuple[float, float], time_s: float) -> shapely.Polygon:
    """The area that a box covers in `time_s` at constant velocity and heading."""
    if time_s <= 0.0 or velocity_mps == (0.0, 0.0):
        return box
    there = shapely.transform(box, lambda xy: xy + np.multiply(velocity_mps, time_s))
    hull = shapely.convex_hull(shapely.union(box, there))
    return hull if isinstance(hull, shapely.Polygon) else box


def corridor(network: Network, lane: str, route: tuple[str, ...]) -> dict[str, float]:
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


def _link_onward(network: Network, lane: str, route: tuple[str, ...]) -> NetworkLink | None:
    edge = network.lanes[lane].edge
    if edge not in route[:-1]:
        return None
    following = route[route.index(edge) + 1]
    return next((x for x in network.links[lane] if network.lanes[x.to_lane].edge == following), None)


def _link_through(network: Network, internal: str, route: tuple[str, ...]) -> NetworkLink | None:
    pairs = set(pairwise(route))
    for way in network.ways_through(internal):
        if (network.lanes[way.from_lane].edge, network.lanes[way.to_lane].edge) in pairs:
            return way
    return None


def decide(
    agents: Iterable[Agent],
    ego: EgoOnNetwork,
    ahead: Mapping[float, Mapping[str, Cover]],
    memory: dict[str, Attention],
    dt_s: float,
    *,
    at_start: bool = False,
) -> dict[str, Decision]:
    """The decision for each agent; `memory` is updated, agents that need none are left out.

    `ahead` holds, per anticipation time above 0, what the ego's swept box covers.
    `at_start` marks the first step: an ego that starts in a driver's lane is
    respected from the beginning.
    """
    decisions: dict[str, Decision] = {}
    for agent in agents:
        covers = ego.covers if agent.driver.anticipation_s <= 0.0 else ahead[agent.driver.anticipation_s]
        met = [(agent.corridor[lane], covers[lane], lane) for lane in covers if lane in agent.corridor]
        met = [(start_m, part, lane) for start_m, part, lane in met if start_m + part.end_m > agent.position_m]
        overlap = min(1.0, sum(part.share for _, part, _ in met))
        anchor_m = agent.corridor.get(ego.anchor_lane) if ego.anchor_lane is not None else None
        rear_m = agent.position_m - agent.driver.length_m  # SUMO may brake for whatever is not wholly behind
        sees = anchor_m is not None and anchor_m + ego.anchor_position_m > rear_m
        attention = memory.get(agent.id)
        if attention is None:
            if not met and not sees:
                continue
            attention = memory[agent.id] = Attention()
        if not met:
            attention.reacting = False
            attention.centre_in_corridor_s = 0.0
            decisions[agent.id] = Decision(Treatment.IGNORE if sees else Treatment.LEAVE, 0.0, False)
            continue
        leads = any(lane in ego.centre_lanes for _, _, lane in met)
        attention.centre_in_corridor_s = attention.centre_in_corridor_s + dt_s if leads else 0.0
        if overlap >= min(agent.driver.react_overlap, FULLY_MERGED):
            attention.reacting = True
        if leads and (at_start or attention.centre_in_corridor_s >= LEADER_AFTER_S - 1e-9):
            attention.reacting = True
        if not attention.reacting:
            decisions[agent.id] = Decision(Treatment.IGNORE if sees else Treatment.LEAVE, overlap, False)
            continue
        start_m, part, _ = min(met, key=lambda m: m[0] + m[1].start_m)
        if sees and part.speed_mps >= ATHWART * ego.speed_mps and ego.speed_mps >= 0.0:
            decisions[agent.id] = Decision(Treatment.LEAVE, overlap, True)
            continue
        speed_mps = _next_speed_mps(agent, start_m + part.start_m - agent.position_m, part.speed_mps, dt_s)
        decisions[agent.id] = Decision(Treatment.IMPOSE, overlap, True, speed_mps)
    return decisions


def yield_to(
    agents: Iterable[Agent],
    things: Iterable[tuple[str, Mapping[str, Cover]]],
    decisions: dict[str, Decision],
    dt_s: float,
) -> dict[str, Decision]:
    """`decisions` with the speeds lowered that agents need to follow, or stop before, what is in their corridor.

    `things` are names and covers of pedestrians (nameless) and of bodies of
    other agents, which do not concern their own driver. Everyone yields to
    them, whatever the type.
    """
    decided = dict(decisions)
    listed = list(things)
    for agent in agents:
        speeds_mps = [
            _next_speed_mps(
                agent, agent.corridor[lane] + part.start_m - agent.position_m, max(0.0, part.speed_mps), dt_s
            )
            for name, covers in listed
            if name != agent.id
            for lane, part in covers.items()
            if lane in agent.corridor and agent.corridor[lane] + part.end_m > agent.position_m
        ]
        if not speeds_mps:
            continue
        before = decided.get(agent.id, Decision(Treatment.IMPOSE, 0.0, False))
        if before.speed_mps is not None:
            speeds_mps.append(before.speed_mps)
        treatment = Treatment.IGNORE if before.treatment is Treatment.IGNORE else Treatment.IMPOSE
        decided[agent.id] = Decision(treatment, before.overlap, before.reacting, min(speeds_mps))
    return decided


def _next_speed_mps(agent: Agent, gap_m: float, leader_mps: float, dt_s: float) -> float:
    acceleration = acceleration_mps2(agent.driver, agent.speed_mps, agent.limit_mps, gap_m, leader_mps)
    return max(0.0, agent.speed_mps + max(acceleration, -agent.driver.emergency_decel_mps2) * dt_s)
