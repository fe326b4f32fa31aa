"""Events of a trip: what rates count, found in its frames by the benchmark's own metrics."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
import shapely

from interplan_sumo.endurance.records import EventKind, EventRecord, PlaceKind, RareKind
from interplan_sumo.endurance.staged import StagedSpan
from interplan_sumo.endurance.trip import Trip
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.forced_braking import COURTEOUS_MPS2, laid_to_the_ego
from interplan_sumo.metrics.no_collision import crept_into
from interplan_sumo.metrics.red_lights import HARDEST_STOP_MPS2, red_light_runs
from interplan_sumo.metrics.time_to_collision import row_times_s
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import Roads, Turn

NEAR_MISS_S: Final = 1.0
"""A time to collision below this is a near miss; with one other it is one until it has been longer for `APART_S`."""
HARD_BRAKING_MPS2: Final = COURTEOUS_MPS2
"""Who is made to brake harder by the ego has been made to brake hard."""
APART_S: Final = 3.0
"""What follows the same with the same other within this time is part of it."""
LEADS_TO_S: Final = 5.0
"""A rare event that is over for no longer than this may have led to what happens."""


@dataclass(frozen=True, slots=True)
class FoundEvent:
    """An event and the frame that it is in."""

    frame: int
    record: EventRecord


def find_events(trip: Trip, facts: Facts, spans: list[StagedSpan]) -> list[FoundEvent]:
    """All that rates count, in the order of time.

    Of the run-out only what a rare event led to: its own kilometres do not count.
    """
    moments: list[tuple[int, EventKind, bool, str | None]] = []
    for contact in facts.collisions:
        moments.append((contact.frame, "collision", contact.at_fault or crept_into(facts, contact), contact.track))
    hit = {contact.track: contact.frame for contact in facts.collisions}
    moments.extend((frame, "near_miss", True, other) for frame, other in _near_misses(facts, hit))
    moments.extend((frame, "hard_braking", True, other) for frame, other in _hard_braking(facts, hit))
    for run in red_light_runs(facts):
        if run["stop_mps2"] <= HARDEST_STOP_MPS2:
            frame = int(facts.time_s.searchsorted(run["time_s"] - 1e-6))
            moments.append((frame, "red_light", True, None))
    if trip.end == "stall":
        moments.append((facts.frames - 1, "stall", True, None))
    if trip.end == "off_road":
        moments.append((facts.frames - 1, "off_road", True, None))
    driven_m = driven(facts)
    found: list[FoundEvent] = []
    for frame, kind, at_fault, other in sorted(moments, key=lambda each: (each[0], each[1], each[3] or "")):
        time_s = float(facts.time_s[frame])
        rare = rare_at(spans, time_s)
        if frame > trip.counted_frames and rare is None:
            continue
        record = EventRecord(
            kind, round(time_s, 1), round(float(driven_m[frame]), 2), place_at(facts, frame), at_fault, other, rare,
            trip.weights[frame], round(float(facts.centre[frame, 0]), 2), round(float(facts.centre[frame, 1]), 2),
        )  # fmt: skip
        found.append(FoundEvent(frame, record))
    return found


def driven(facts: Facts) -> Floats:
    """(N,) metres that the ego has driven up to each frame."""
    steps = np.hypot(*np.diff(facts.centre, axis=0).T) if facts.frames > 1 else np.zeros(0)
    return np.concatenate(([0.0], np.cumsum(steps)))


def metres_by_place(trip: Trip, facts: Facts) -> dict[PlaceKind, float]:
    """How far was driven on each kind of place, without the run-out."""
    metres = np.diff(driven(facts))[: trip.counted_frames]
    found: dict[PlaceKind, float] = {}
    for frame, step_m in enumerate(metres.tolist()):
        place = place_at(facts, frame)
        found[place] = found.get(place, 0.0) + step_m
    return {place: round(found[place], 3) for place in sorted(found)}


def rare_at(spans: list[StagedSpan], time_s: float) -> RareKind | None:
    """The rare event that was under way, or over for less than `LEADS_TO_S`: the last one that began."""
    for span in reversed(spans):
        if span.began_s <= time_s + 1e-6:
            ended_s = time_s if span.ended_s is None else span.ended_s
            return span.kind if time_s <= ended_s + LEADS_TO_S else None
    return None


def _near_misses(facts: Facts, hit: dict[str, int]) -> list[tuple[int, str]]:
    """The first frame of each, and with whom; what ended in a contact is that."""
    times_s = row_times_s(facts)
    rows = np.flatnonzero(times_s < NEAR_MISS_S)
    actors = facts.trace.actors
    return _apart([(int(actors.frame[row]), str(actors.ids[row])) for row in rows.tolist()], facts, hit)


def _hard_braking(facts: Facts, hit: dict[str, int]) -> list[tuple[int, str]]:
    forced = laid_to_the_ego(facts)
    if forced is None:
        return []
    rows = forced.rows[forced.braking_mps2 > HARD_BRAKING_MPS2]
    actors = facts.trace.actors
    return _apart([(int(actors.frame[row]), str(actors.ids[row])) for row in rows.tolist()], facts, hit)


def _apart(moments: list[tuple[int, str]], facts: Facts, hit: dict[str, int]) -> list[tuple[int, str]]:
    """The first of each stretch with one other; none that leads to a contact with it within `APART_S`."""
    window = round(APART_S * 1e6 / facts.step_us)
    last: dict[str, int] = {}
    found: list[tuple[int, str]] = []
    for frame, other in moments:
        if other not in last or frame - last[other] > window:
            found.append((frame, other))
        last[other] = frame
    return [(frame, other) for frame, other in found if not (other in hit and hit[other] - frame <= window)]


# --- where -----------------------------------------------------------------------------------------


def place_at(facts: Facts, frame: int) -> PlaceKind:
    """The kind of place that the ego is on."""
    place = facts.places[frame]
    if not place or place[0] in facts.roads.lanes:
        return "straight"
    return _kinds(facts.roads)[place[0]]


@lru_cache(maxsize=8)
def _kinds(roads: Roads) -> dict[str, PlaceKind]:
    """Of each connector: a turn, a crossing of others, a merge with others, or no more than a piece of road."""
    names = list(roads.connectors)
    lines = [roads.connectors[name].centerline.linestring for name in names]
    one, two = shapely.STRtree(lines).query(lines, predicate="intersects")
    crossed: set[str] = set()
    for here, there in zip(one.tolist(), two.tolist(), strict=True):
        a, b = roads.connectors[names[here]], roads.connectors[names[there]]
        if a.from_lane_id != b.from_lane_id and a.to_lane_id != b.to_lane_id:
            crossed.add(names[here])
    found: dict[str, PlaceKind] = {}
    for name, connector in roads.connectors.items():
        if connector.turn in (Turn.LEFT, Turn.RIGHT, Turn.U_TURN):
            found[name] = "turn"
        elif name in crossed:
            found[name] = "crossing"
        else:
            found[name] = "merge" if len(roads.incoming(connector.to_lane_id)) > 1 else "straight"
    return found
