"""Audit: is a scenario sound, and what does it ask? The classes of the paper's look at the hard cases of nuPlan."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from interplan_sumo.families import families
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.verification.start_checks import start_problems
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.geometry import wrap_angle
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import Trace

DEFECTS: Final = ("noisy objects", "unsafe start", "unsafe agents")
"""What makes a low score say nothing about the planner."""
BASIC: Final = "basic driving"
"""What a scenario asks that is of no family."""
JUMP_M: Final = 0.5
"""An object is noisy if it moves by this much more or less than its velocity says in one step of 0.1 s,"""
TURN_RAD: Final = 0.5
"""or turns by this much in one step, which people on foot may,"""
NEAR_M: Final = 50.0
"""or comes or goes within this distance of the ego."""


@dataclass(frozen=True, slots=True)
class AuditFinding:
    """What an audit says of one scenario."""

    scenario_id: str
    kind: str
    """A defect, if it has one; else what it asks."""
    details: tuple[str, ...] = ()
    """What is wrong, sentence by sentence."""


def finding(scenario: Scenario, roads: Roads, trace: Trace, no_collision: Mapping[str, Any]) -> AuditFinding:
    """The class of a scenario that was driven; `no_collision` is the detail of that metric. Opens SUMO once."""
    noisy = noisy_objects(trace)
    if noisy:
        return AuditFinding(scenario.id, "noisy objects", noisy)
    unsafe = tuple(start_problems(scenario, roads))
    if unsafe:
        return AuditFinding(scenario.id, "unsafe start", unsafe)
    agents = unsafe_agents(no_collision)
    if agents:
        return AuditFinding(scenario.id, "unsafe agents", agents)
    return AuditFinding(scenario.id, asks(scenario, roads))


def classes() -> tuple[str, ...]:
    """What scenarios can ask, each once."""
    asked = [each.audit_class or each.title.lower() for each in families().values() if each.asks is not None]
    return (*dict.fromkeys(asked), BASIC)


def asks(scenario: Scenario, roads: Roads) -> str:
    """What a scenario asks of a planner, by what is in it, whatever its family says."""
    for family in families().values():
        if family.asks is not None and family.asks(scenario, roads):
            return family.audit_class or family.title.lower()
    return BASIC


def unsafe_agents(no_collision: Mapping[str, Any]) -> tuple[str, ...]:
    """Contacts that were not the ego's fault."""
    return tuple(
        f"{contact['track']} ran into the ego at {contact['time_s']:.1f} s"
        for contact in no_collision.get("contacts", ())
        if not contact["at_fault"]
    )


def noisy_objects(trace: Trace) -> tuple[str, ...]:
    """Objects that jump, spin, or come and go beside the ego, be it for some frames."""
    actors = trace.actors
    found: list[str] = []
    order = np.lexsort((actors.frame, actors.ids.astype(str)))
    ids, frame = actors.ids[order].astype(str), actors.frame[order]
    x, y = actors.x_m[order], actors.y_m[order]
    same = (ids[1:] == ids[:-1]) & (frame[1:] == frame[:-1] + 1)  # in two frames that follow one another
    for column, velocity in ((x, actors.vx_mps[order]), (y, actors.vy_mps[order])):
        mean = (velocity[1:] + velocity[:-1]) / 2.0
        jumps = same & (np.abs(np.diff(column) - 0.1 * mean) > JUMP_M)
        found += [f"{ids[i]} jumps at {frame[i + 1] * 0.1:.1f} s" for i in np.flatnonzero(jumps)]
    turn = np.abs(wrap_angle(np.diff(actors.heading_rad[order])))
    spins = same & (turn > TURN_RAD) & (actors.kind[order][1:] != ActorKind.PEDESTRIAN)
    found += [f"{ids[i]} spins at {frame[i + 1] * 0.1:.1f} s" for i in np.flatnonzero(spins)]
    comes, goes = np.append(True, ~same) & (frame > 0), np.append(~same, True) & (frame < len(trace.ego) - 1)
    for what, rows in (("appears", np.flatnonzero(comes)), ("vanishes", np.flatnonzero(goes))):
        ego_x, ego_y = trace.ego.x_m[frame[rows]], trace.ego.y_m[frame[rows]]
        near = np.hypot(x[rows] - ego_x, y[rows] - ego_y) < NEAR_M
        found += [f"{ids[i]} {what} beside the ego at {frame[i] * 0.1:.1f} s" for i in rows[near]]
    return tuple(dict.fromkeys(found))
