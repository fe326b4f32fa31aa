"""No collision: did the ego cause a contact?"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from interplan_sumo.metrics.circumstances import ego_doing
from interplan_sumo.metrics.collisions import STOPPED_MPS, Collision, Contact, Group
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.metric import MetricResult, metric

ALLOWED = {Group.VRU: 0, Group.VEHICLE: 0, Group.OBJECT: 1}
"""nuPlan's budgets: each collision takes 1 / (allowed + 1) of its group's factor."""


def first_contact_at_fault(_: Facts, result: MetricResult) -> int:
    """The frame of the first contact that the ego caused."""
    return next(int(contact["frame"]) for contact in result.detail["contacts"] if contact["at_fault"])


@metric(failure="at-fault collision", lost_at=first_contact_at_fault)
def no_collision(facts: Facts) -> MetricResult:
    """1 without any collision at fault, else 0."""
    at_fault = [c for c in facts.collisions if c.at_fault]
    return _result(facts, 0.0 if at_fault else 1.0)


@metric(failure="at-fault collision", lost_at=first_contact_at_fault)
def strict_no_collision(facts: Facts) -> MetricResult:
    """1 without any collision at fault, else 0; nor may the ego come to rest against what already stood there.

    nuPlan lays no contact to an ego at 0.05 m/s or less.
    """
    laid = tuple(replace(c, at_fault=True) if not c.at_fault and crept_into(facts, c) else c for c in facts.collisions)
    return _result(facts, 0.0 if any(c.at_fault for c in laid) else 1.0, laid)


def crept_into(facts: Facts, contact: Collision) -> bool:
    """Whether the ego all but stood when it touched what stood before, and had moved since the frame before."""
    if contact.contact is not Contact.STOPPED_EGO or contact.frame == 0:
        return False
    actors, before = facts.trace.actors, contact.frame - 1
    earlier = actors.rows(before)
    rows = earlier.start + np.flatnonzero(actors.ids[earlier] == contact.track)
    stood = contact.group is Group.OBJECT or bool((facts.actor_speed_mps[[*rows, contact.row]] <= STOPPED_MPS).all())
    moved_m = float(np.hypot(*(facts.centre[contact.frame] - facts.centre[before])))
    came_m = max((float(np.hypot(*(facts.actor_xy[contact.row] - facts.actor_xy[row]))) for row in rows), default=0.0)
    return stood and moved_m > came_m


@metric(failure="at-fault collision", lost_at=first_contact_at_fault)
def nuplan_no_collision(facts: Facts) -> MetricResult:
    """nuPlan's score: 0.5 for one static object, 0 for more, or for any road user."""
    return _result(facts, shared_budget([c.group for c in facts.collisions if c.at_fault]))


def shared_budget(hit: list[Group]) -> float:
    """Product over the groups of max(0, 1 - hits / (allowed + 1))."""
    score = 1.0
    for group, allowed in ALLOWED.items():
        score *= max(0.0, 1.0 - hit.count(group) / (allowed + 1))
    return score


def _result(facts: Facts, score: float, contacts: tuple[Collision, ...] | None = None) -> MetricResult:
    contacts = facts.collisions if contacts is None else contacts
    at_fault = [c for c in contacts if c.at_fault]
    counts = Counter(c.group for c in at_fault)
    energies = {g: [c.energy_mps for c in at_fault if c.group is g] for g in Group}
    detail = {
        "at_fault": len(at_fault),
        "at_fault_with": {g.value: counts[g] for g in Group},
        "energy_mps": {
            g.value: {"max": max(e), "min": min(e), "mean": sum(e) / len(e)} for g, e in energies.items() if e
        },
        "contacts": [{**c.as_dict(), "time_s": float(facts.time_s[c.frame])} for c in contacts],
    }
    return MetricResult(score, detail, reason=_reason(facts, at_fault) if score < 1.0 else None)


_HOW = {
    "stopped_track": "drove into standing",
    "front": "drove into",
    "lateral": "touched, astride two lanes,",
    "stopped_ego": "came to rest against",
}


def _reason(facts: Facts, at_fault: list[Collision]) -> str:
    first = at_fault[0]
    what = first.kind.words
    more = f" and {len(at_fault) - 1} more" if len(at_fault) > 1 else ""
    where = f"{_HOW[first.contact.value]} {what} {first.track}{more}"
    return f"{where} at {facts.time_s[first.frame]:.1f} s, {ego_doing(facts, first.frame)}"
