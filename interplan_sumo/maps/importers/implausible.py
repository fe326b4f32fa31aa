"""Lanes of a file that no street can have: endless ones, spikes, and those whose boundaries run against each other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from interplan_sumo.errors import MapError
from interplan_sumo.maps.importers.cross_sections import CrossSections
from interplan_sumo.maps.importers.lines import SHORTEST_M
from interplan_sumo.maps.importers.source import SourceLane, SourceMap
from interplan_sumo.world.geometry import Floats

LONGEST_STRAIGHT_M = 12_000.0
"""Between two points of a boundary; one wrong digit of a coordinate makes more, and metres cost time and memory."""
LONGEST_M = 100_000.0
"""From fork to fork."""
SPIKE_M = 1000.0
"""Out and straight back by this is a wrong coordinate; a lane that lies on itself for so long takes minutes."""
_STRAIGHT_BACK_COS = -0.9


def plausible(source: SourceMap) -> tuple[SourceMap, tuple[str, ...]]:
    """The map without lanes that have no middle to drive along, and a note for each.

    MapError names an endless lane or one that leads out and straight back.
    """
    for lane in source.lanes.values():
        for boundary in (lane.left, lane.right):
            steps = np.diff(boundary, axis=0)
            steps_m = np.hypot(*steps.T)
            if steps_m.max() > LONGEST_STRAIGHT_M or steps_m.sum() > LONGEST_M:
                whole_km, straight_km = steps_m.sum() / 1000.0, steps_m.max() / 1000.0
                said = f"is {whole_km:.0f} km long, {straight_km:.0f} km of them in one straight"
                raise MapError(f"{source.name}: lane {lane.id} {said}; look at its coordinates")
            if (out_m := _spike_m(steps, steps_m)) > SPIKE_M:
                said = f"leads {out_m / 1000.0:.1f} km out and straight back"
                raise MapError(f"{source.name}: lane {lane.id} {said}; look at its coordinates")
    flat = [id_ for id_, lane in source.lanes.items() if _is_flat(lane)]
    if not flat:
        return source, ()
    notes = tuple(f"{id_}: left out, its boundaries run against each other" for id_ in flat)
    return replace(source, lanes=_without(source.lanes, frozenset(flat))), notes


def _spike_m(steps: Floats, steps_m: Floats) -> float:
    """How far a boundary leads out before it turns back on the spot; 0 if it never does."""
    both_m = np.minimum(steps_m[:-1], steps_m[1:])
    back = np.einsum("ij,ij->i", steps[:-1], steps[1:]) < _STRAIGHT_BACK_COS * steps_m[:-1] * steps_m[1:]
    return float(np.max(both_m[back], initial=0.0))


def _is_flat(lane: SourceLane) -> bool:
    ends = (lane.left[[0, -1]] + lane.right[[0, -1]]) / 2.0
    if np.hypot(*(ends[1] - ends[0])) > SHORTEST_M:  # so is nearly every lane
        return False
    return CrossSections.of([lane.left, lane.right]).length_m < SHORTEST_M


def _without(lanes: Mapping[str, SourceLane], gone: frozenset[str]) -> dict[str, SourceLane]:
    def kept(id_: str | None) -> str | None:
        return None if id_ in gone else id_

    return {
        id_: replace(lane, left_neighbour=kept(lane.left_neighbour), right_neighbour=kept(lane.right_neighbour))
        for id_, lane in lanes.items()
        if id_ not in gone
    }
