"""Reactions: which agent reacts to the ego, from when, and how, decided per agent and step.

SUMO sees the ego as a car on the centre line of one lane. Whether an agent
sees it is not left to SUMO: the share f of the ego's box inside the agent's
own corridor (its lane and what continues it) is held against a threshold of
its vehicle type. The condition to react is f > 0 and f >= min(threshold, 0.98),
or an ego whose centre has been ahead in the corridor for 2 s, or courtesy: an
ego that moves towards the agent's lane, to which it has made up its mind to
give way. Who does so is told what to do until the ego is in its lane: SUMO's
junctions know nothing of merging. It reacts from its reaction time later on, until f = 0 and the ego
has turned away. Only what begins ahead of its front bumper concerns it, and
nothing while the ego's whole box is behind that. From this follows a mode:

| reacts | SUMO sees the ego in the corridor | mode |
|---|---|---|
| no | no | SUMO: the agent is left to SUMO |
| no | yes | IGNORE_EGO: SUMO is told to overlook the ego |
| out of courtesy | either | IGNORE_EGO, and no harder than the gap needs |
| yes | yes, driving the agent's way | SUMO, which follows the ego |
| yes | no, or out of order, oncoming, backing, crossing | OVERRIDE_SPEED: what its own car-following model wants |

Nothing here knows SUMO: arrays and names in, decisions out. The small values
are tuples, not data classes: a step makes dozens of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from math import inf
from typing import NamedTuple

from interplan_sumo.simulation.idm import SMALLEST_GAP_M
from interplan_sumo.simulation.vehicle_types import VehicleType

FULLY_MERGED = 0.98
"""Overlap from which the ego counts as fully merged: a box never lies to the last per cent in one lane."""
LEADER_AFTER_S = 2.0
"""After this time with its centre in an agent's corridor the ego is its leader whatever the overlap."""
LEAST_ALIGNMENT = 0.85
"""Below this cosine between the ego's motion and the lane SUMO's idea of the ego is too wrong to follow."""
ENCOUNTER_S = 3.0
"""An ego that has neither touched nor approached an agent's lane for this long, and does so again, is met anew."""
CLOSEST_M = 0.5
"""So near somebody courteous lets the ego come while it makes room, and nobody closes up farther.

Not where the standstill gap is less anyway."""
STANDING_MPS = 0.5
NOTICEABLE_MPS2 = 0.05
"""Nobody minds what makes it brake by less than this: half of what counts as a reaction."""
COMING = "coming"
"""In place of a name: somebody on foot who will cross a lane, but not just yet."""
CONTACT_SHARE = 0.5
"""An ego with more of its box than this in the lane, beside the front of an agent that reacts to it, touches it."""
_LEAST_MPS = 1e-6
_ROUNDING_S = 1e-9

FollowSpeed = Callable[[str, float, float, float, str], float]
"""Speed in m/s that an agent's own car-following model wants for the next step, not bounded by its brakes.

Of its name, its speed, the gap from bumper to bumper in m, the leader's speed, not below 0, and who that is: an agent
by name, or '' for the ego, an obstacle, a pedestrian.
"""


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
    approached: Mapping[str, LaneCoverage] = {}
    """SUMO lanes that it moves towards, or farther into, with the stretch that it is beside."""
    braking_mps2: float = 0.0
    """How hard it brakes."""
    in_junction: bool = False
    """Whether SUMO sees it inside a junction, where it concerns agents on other lanes as well."""
    out_of_order: bool = False
    """Whether SUMO has passed it through others on the anchor lane, and so may have it behind who is behind it."""


class Agent(NamedTuple):
    """What a decision needs to know of one agent."""

    id: str
    driver: VehicleType
    position_m: float
    """Of the front bumper on its lane."""
    speed_mps: float
    corridor: Mapping[str, float]
    """SUMO lane ahead -> distance from the start of the agent's own lane to the start of that lane."""
    ego_behind: bool = False
    """Whether the ego's whole box is behind the front bumper."""


@dataclass(slots=True)
class ReactionMemory:
    """What is remembered of one agent from step to step."""

    reacting: bool = False
    centre_in_corridor_s: float = 0.0
    condition_s: float = 0.0
    """How long there has been reason to react."""
    courteous: bool | None = None
    """Whether it gives way to the ego in this encounter; None: there is none."""
    overlooked: bool = False
    """Whether SUMO was told to overlook the ego in the step before."""
    apart_s: float = 0.0
    """How long the ego has kept away from its lane."""


class ReactionDecision(NamedTuple):
    """The outcome for one agent."""

    mode: Mode
    overlap: float
    """f at this step."""
    reacting: bool
    speed_mps: float | None = None
    """The most for the next step, within what the agent's motor and brakes can do; None: SUMO's own."""


def decide(
    agents: Iterable[Agent],
    ego: EgoOnNetwork,
    ahead: Mapping[float, Mapping[str, LaneCoverage]],
    memory: dict[str, ReactionMemory],
    drivers: DriverModels,
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
        driver, corridor = agent.driver, agent.corridor
        swept = driver.anticipation_s > 0.0
        met = _met(agent, ahead.get(driver.anticipation_s, ego.coverage), ego.centre_lanes)
        anchor_m = corridor.get(ego.anchor_lane) if ego.anchor_lane is not None else None
        remembered = memory.get(agent.id)
        rear_m = agent.position_m - driver.length_m  # SUMO may brake for whatever is not wholly behind
        sumo_sees_ego = anchor_m is not None and anchor_m + ego.anchor_position_m > rear_m
        if anchor_m == 0.0 and remembered is not None and remembered.overlooked:
            sumo_sees_ego = True  # SUMO keeps the order of the cars on a lane, even if one has passed through another
        approached = _approached(agent, ego.approached) if driver.courtesy > 0.0 and not agent.ego_behind else None
        if remembered is None:
            if met is None and not sumo_sees_ego and approached is None:
                continue
            remembered = memory[agent.id] = ReactionMemory()
        if met is not None and met.gap_m < 0.0 and not (remembered.reacting and met.share > CONTACT_SHARE):
            met = None  # it begins beside or behind the front bumper
        if swept and agent.ego_behind:
            met = None
        _encounter(remembered, agent, met is not None, approached is not None, drivers)
        reason = _reason(remembered, driver, met, at_start, drivers.dt_s)
        remembered.condition_s = remembered.condition_s + drivers.dt_s if reason else 0.0
        late = not at_start and remembered.condition_s - drivers.dt_s < driver.reaction_time_s - _ROUNDING_S
        if met is None and not (reason and approached is not None):
            remembered.reacting = False
        elif reason and not late:
            if met is not None and not remembered.reacting:
                drivers.cut_in(agent.id, met.gap_m - driver.min_gap_m, agent.speed_mps)
            remembered.reacting = True
        share = 0.0 if met is None else met.share
        if not remembered.reacting:
            overlooks = sumo_sees_ego or (remembered.courteous is True and ego.in_junction)
            decisions[agent.id] = ReactionDecision(Mode.IGNORE_EGO if overlooks else Mode.SUMO, share, False)
        elif remembered.courteous:
            decisions[agent.id] = _courteously(agent, met, approached, ego, sumo_sees_ego, drivers)
        else:
            gap_m, leader_mps = (met.gap_m, met.speed_mps) if met is not None else (inf, 0.0)
            if met is not None and sumo_sees_ego and _leads_on(ego, leader_mps):
                decisions[agent.id] = ReactionDecision(Mode.SUMO, share, True)
            else:
                speed_mps = drivers.next_speed_mps(agent, gap_m, leader_mps)
                decisions[agent.id] = ReactionDecision(Mode.OVERRIDE_SPEED, share, True, speed_mps)
        remembered.overlooked = decisions[agent.id].mode is Mode.IGNORE_EGO
    return decisions


def _leads_on(ego: EgoOnNetwork, leader_mps: float) -> bool:
    """Whether the ego, this fast along the agent's lane, is SUMO's leader there, and drives the way that it does."""
    return leader_mps >= LEAST_ALIGNMENT * ego.speed_mps and ego.speed_mps >= 0.0 and not ego.out_of_order


def _courteously(
    agent: Agent,
    met: _Met | None,
    approached: tuple[float, float] | None,
    ego: EgoOnNetwork,
    sumo_sees_ego: bool,
    drivers: DriverModels,
) -> ReactionDecision:
    """What an agent does that gives way: it opens a gap behind the ego's whole box, of which `met` may be a corner.

    It is left to SUMO once the ego is in its lane and its own model content.
    """
    places = [place for place in (approached, met and (met.gap_m, met.speed_mps)) if place is not None]
    gap_m, leader_mps = min(places, default=(inf, 0.0))
    own_mps = drivers.next_speed_mps(agent, gap_m, leader_mps)
    gentle_mps = _gently_mps(agent, gap_m, leader_mps, ego.braking_mps2, drivers.dt_s)
    share = 0.0 if met is None else met.share
    if own_mps >= gentle_mps and share >= FULLY_MERGED and sumo_sees_ego and _leads_on(ego, leader_mps):
        return ReactionDecision(Mode.SUMO, share, True)
    return ReactionDecision(Mode.IGNORE_EGO, share, True, max(own_mps, gentle_mps))


def _gently_mps(agent: Agent, gap_m: float, leader_mps: float, leader_brakes_mps2: float, dt_s: float) -> float:
    """The speed after a step of comfortable braking, or harder where only that keeps it from the ego."""
    driver, closing_mps = agent.driver, max(0.0, agent.speed_mps - leader_mps)
    room_m = max(gap_m - min(driver.min_gap_m, CLOSEST_M), SMALLEST_GAP_M)
    needed_mps2 = closing_mps * closing_mps / (2.0 * room_m) + leader_brakes_mps2
    hardest_mps2 = min(max(driver.decel_mps2, needed_mps2), driver.emergency_decel_mps2)
    return max(0.0, agent.speed_mps - hardest_mps2 * dt_s)


class _Met(NamedTuple):
    """The ego in an agent's corridor."""

    share: float
    """Of its box."""
    gap_m: float
    """From the agent's front bumper to where the ego begins, negative beside the agent."""
    speed_mps: float
    """Along the lane where it begins."""
    leads: bool
    """Whether its centre is in the corridor."""


def _met(agent: Agent, coverage: Mapping[str, LaneCoverage], centre_lanes: frozenset[str]) -> _Met | None:
    """What of the ego is not wholly behind the agent's front bumper."""
    corridor, position_m = agent.corridor, agent.position_m
    share, begins_m, speed_mps, leads = 0.0, inf, 0.0, False
    for lane, part in coverage.items():
        start_m = corridor.get(lane)
        if start_m is None or start_m + part.end_m <= position_m:
            continue
        share += part.share
        leads = leads or lane in centre_lanes
        if start_m + part.start_m < begins_m:
            begins_m, speed_mps = start_m + part.start_m, part.speed_mps
    return None if begins_m == inf else _Met(min(1.0, share), begins_m - position_m, speed_mps, leads)


def _approached(agent: Agent, approached: Mapping[str, LaneCoverage]) -> tuple[float, float] | None:
    """Gap to the rear, and speed, of an ego that moves towards the agent's corridor ahead of its front bumper."""
    for lane, part in approached.items():
        start_m = agent.corridor.get(lane)
        if start_m is not None and start_m + part.start_m >= agent.position_m:
            return start_m + part.start_m - agent.position_m, part.speed_mps
    return None


def _encounter(
    remembered: ReactionMemory, agent: Agent, touched: bool, approached: bool, drivers: DriverModels
) -> None:
    """Begin an encounter with an ego that moves towards the lane, end one with an ego that has kept away."""
    if touched or approached:
        remembered.apart_s = 0.0
        if approached and not touched and remembered.courteous is None:
            remembered.courteous = drivers.chance(agent.id) < agent.driver.courtesy
    elif remembered.courteous is not None:
        remembered.apart_s += drivers.dt_s
        if remembered.apart_s >= ENCOUNTER_S - _ROUNDING_S:
            remembered.courteous, remembered.apart_s = None, 0.0


def _reason(remembered: ReactionMemory, driver: VehicleType, met: _Met | None, at_start: bool, dt_s: float) -> bool:
    """Whether there is reason to react; keeps count of how long the ego has been the leader."""
    leads = met is not None and met.leads
    remembered.centre_in_corridor_s = remembered.centre_in_corridor_s + dt_s if leads else 0.0
    if met is None:
        return bool(remembered.courteous)
    led = leads and (at_start or remembered.centre_in_corridor_s >= LEADER_AFTER_S - _ROUNDING_S)
    return led or bool(remembered.courteous) or met.share >= min(driver.react_overlap, FULLY_MERGED)


@dataclass(frozen=True, slots=True)
class DriverModels:
    """How agents drive: their own car-following models, and chance."""

    follow: FollowSpeed
    chance: Callable[[str], float]
    """The next number from 0 to 1 that falls to an agent by name."""
    cut_in: Callable[[str, float, float], None]
    """To be told when the ego is new ahead of an agent: its name, the gap beyond its standstill gap, its speed."""
    dt_s: float

    def next_speed_mps(self, agent: Agent, gap_m: float, leader_mps: float, leader: str = "") -> float:
        """What the agent's own model wants behind a leader, as far as its motor and brakes allow.

        A leader that comes towards it (negative speed) is met where both would
        be if neither braked: the agent stops before that. Some models pull away
        in a gap below their standstill gap: nobody closes up farther there.
        """
        speed_mps = agent.speed_mps
        if leader_mps < 0.0:
            gap_m, leader_mps = gap_m * speed_mps / max(speed_mps - leader_mps, _LEAST_MPS), 0.0
        wanted_mps = self.follow(agent.id, speed_mps, max(gap_m, SMALLEST_GAP_M), leader_mps, leader)
        if gap_m < min(agent.driver.min_gap_m, CLOSEST_M):
            wanted_mps = min(wanted_mps, leader_mps)
        hardest_mps = speed_mps - agent.driver.emergency_decel_mps2 * self.dt_s
        return max(0.0, hardest_mps, min(wanted_mps, speed_mps + agent.driver.accel_mps2 * self.dt_s))


def yield_to(
    agents: Iterable[Agent],
    obstructions: Mapping[str, Sequence[tuple[str, LaneCoverage]]],
    decisions: Mapping[str, ReactionDecision],
    drivers: DriverModels,
) -> dict[str, ReactionDecision]:
    """`decisions` with the speeds lowered that agents need to follow, or stop before, what is in their corridor.

    `obstructions` are, by SUMO lane, names and coverage of pedestrians (nameless, or
    `COMING`) and of other agents' bodies; an agent's own body does not concern it.
    Everyone yields to them, whatever the type. Who can no longer stop before somebody
    that is only coming drives on, and is gone by then.
    """
    decided = dict(decisions)
    for agent in agents:
        wanted = [
            drivers.next_speed_mps(agent, *leader) for leader in sorted(_leaders(agent, obstructions, drivers.dt_s))
        ]
        if wanted and min(wanted) < drivers.next_speed_mps(agent, inf, 0.0) - NOTICEABLE_MPS2 * drivers.dt_s:
            decided[agent.id] = no_faster(decided.get(agent.id), min(wanted))
    return decided


def no_faster(before: ReactionDecision | None, most_mps: float) -> ReactionDecision:
    """A decision, or none, with a bound of the speed."""
    if before is None:
        return ReactionDecision(Mode.OVERRIDE_SPEED, 0.0, False, most_mps)
    mode = Mode.IGNORE_EGO if before.mode is Mode.IGNORE_EGO else Mode.OVERRIDE_SPEED
    speed_mps = most_mps if before.speed_mps is None else min(most_mps, before.speed_mps)
    return ReactionDecision(mode, before.overlap, before.reacting, speed_mps)


def _leaders(
    agent: Agent, obstructions: Mapping[str, Sequence[tuple[str, LaneCoverage]]], dt_s: float
) -> set[tuple[float, float, str]]:
    """Gap, speed, not below 0, and name of everything in the corridor that is not behind the front bumper.

    People have no name. Who stands waits for those beside it, too: they walk on, whoever is in their way.
    """
    stands = agent.speed_mps < STANDING_MPS
    beside_m = agent.position_m - (agent.driver.length_m if stands else 0.0)
    stops_m = agent.speed_mps * (dt_s + agent.speed_mps / (2.0 * agent.driver.emergency_decel_mps2))
    found: set[tuple[float, float, str]] = set()
    for lane, parts in obstructions.items():
        start_m = agent.corridor.get(lane)
        if start_m is None:
            continue
        for other, part in parts:
            on_foot = other in ("", COMING)
            if other == agent.id or start_m + part.end_m <= (beside_m if on_foot else agent.position_m):
                continue
            gap_m = start_m + part.start_m - agent.position_m
            if other != COMING or stands or gap_m >= stops_m:
                found.add((gap_m, max(0.0, part.speed_mps), "" if on_foot else other))
    return found
