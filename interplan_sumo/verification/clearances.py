"""Clearances: how near a drive comes to others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.metrics.diagnostics import distances_m, least
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.world.actors import ActorKind


@dataclass(frozen=True, slots=True)
class Clearance:
    """The nearest that the ego's box comes to others of one kind, metres between the boxes."""

    distance_m: float
    """Infinite where there is nobody."""
    track: str = ""
    time_s: float = 0.0


@dataclass(frozen=True, slots=True)
class NearestApproach:
    """The least clearances of a drive."""

    pedestrians: Clearance = Clearance(np.inf)
    others: Clearance = Clearance(np.inf)


def nearest_approach(facts: Facts) -> NearestApproach:
    """How near the ego comes to whom, over all frames of a drive."""
    on_foot = facts.trace.actors.kind == ActorKind.PEDESTRIAN
    return NearestApproach(_least_clearance(facts, on_foot), _least_clearance(facts, ~on_foot))


def _least_clearance(facts: Facts, among: NDArray[np.bool_]) -> Clearance:
    found = least(facts, distances_m(facts, among))
    if found is None:
        return Clearance(np.inf)
    return Clearance(found["least"], found["track"], round(found["time_s"], 6))  # times are whole microseconds
