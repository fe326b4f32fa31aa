"""Records of endless driving: what one segment leaves behind for rates, small enough to keep for every kilometre.

Weights are likelihood ratios: how probable what was drawn in a segment is at
the natural probabilities of rare events, over how probable it was where these
were boosted (`rare_events`). A naive segment has the weight 1 throughout.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Final, Literal, get_args

import msgspec
from msgspec import Meta, Struct

from interplan_sumo.batch.records import Count, Fault, Seconds

EventKind = Literal["collision", "near_miss", "hard_braking", "red_light", "stall", "off_road"]
"""What happens to or because of the ego; hard braking is that of others because of the ego."""
RareKind = Literal["jaywalker", "blocked_lane", "cut_in", "hard_braking_ahead", "red_light_runner", "door", "crosswalk"]
"""What the world does."""
PlaceKind = Literal["straight", "turn", "merge", "crossing"]
"""Where on the road the ego is."""
RARE_KINDS: Final[tuple[RareKind, ...]] = get_args(RareKind)
PLACE_KINDS: Final[tuple[PlaceKind, ...]] = get_args(PlaceKind)

Metres = Annotated[float, Meta(ge=0.0, le=1e9)]
Probability = Annotated[float, Meta(ge=0.0, le=1.0)]
LikelihoodRatio = Annotated[float, Meta(ge=0.0)]
Counts = dict[RareKind, Count]
"""Of rare events, opportunity-seconds or draws, by kind; what is not named is 0."""


class TrafficCell(Struct, frozen=True, order=True):
    """One kind of traffic that rates are told of."""

    map: str
    density: Annotated[float, Meta(gt=0.0, le=10.0)]
    """As a fraction of the district's saturation."""
    drivers: str
    """The behaviour, or the name of the vehicle-type file."""


class RareEventRecord(Struct, frozen=True):
    """A rare event that began."""

    kind: RareKind
    time_s: Seconds
    """Since the start of the segment."""
    opportunity: str
    """Which of those that there were."""
    weight_before: LikelihoodRatio
    """Of the segment up to this draw, without it."""
    weight: LikelihoodRatio
    """With it: that of everything that happens until the next draw."""
    passed: Counts
    """Draws since the start of the segment in which nothing began."""
    place: PlaceKind | None = None


class EventRecord(Struct, frozen=True):
    """Something that rates count."""

    kind: EventKind
    time_s: Seconds
    """Since the start of the segment."""
    distance_m: Metres
    """That the ego had driven."""
    place: PlaceKind
    at_fault: bool
    """Of collisions: whether the ego caused it; true of what only the ego can do."""
    other: str | None
    """Who else took part."""
    rare: RareKind | None
    """The rare event that was active: the last one that began."""
    weight: LikelihoodRatio
    """Of the segment, stopped here."""
    x: float
    """Metres in the map's frame, as `y`."""
    y: float


class SegmentRecord(Struct, frozen=True, kw_only=True):
    """What one job gave: one or two kilometres of one planner in one cell, from one start with one seed."""

    index: Count
    """Among the segments of its planner, cell and seed; batches of the stop rule are by it."""
    cell: TrafficCell
    planner: str
    planner_hash: str | None
    seed: Count
    naive: bool
    """Whether rare events had their natural probabilities."""
    start: str
    """Edge or lane: segments from one start are a cluster."""
    metres: Metres
    """That the ego drove, those while a rare event was active included."""
    seconds: Seconds
    """Of simulated driving, as `metres`."""
    weighted_metres: Metres
    """Sum over stretches between draws of the weight there times their length; `metres` where naive."""
    weighted_seconds: Seconds
    final_weight: LikelihoodRatio
    natural: dict[RareKind, Probability]
    """The probability that a rare event begins in one second of one opportunity."""
    drawn_with: dict[RareKind, Probability]
    """The probability that it was drawn with; the natural one where naive."""
    opportunities: Counts
    """Opportunity-seconds in which was drawn."""
    rare_events: tuple[RareEventRecord, ...]
    """In the order in which they began."""
    events: tuple[EventRecord, ...]
    """In the order in which they happened."""
    metres_at: dict[PlaceKind, Metres] = {}
    """By kind of place; sums to `metres`."""
    removed_vehicles: Count = 0
    """That had stood in a jam for too long."""
    plan_ms: float | None = None
    """Mean time that the planner took for a plan."""
    wall_s: Seconds = 0.0
    """Of the whole job."""
    trace_hash: str | None = None
    fault: Fault | None = None
    """Why the segment ended early; what came before counts."""

    def __post_init__(self) -> None:
        if self.naive and (self.final_weight != 1.0 or self.natural != self.drawn_with):
            raise ValueError("a naive segment has the weight 1 and natural probabilities")
        begun = {each.kind for each in self.rare_events}
        for kind in begun | self.opportunities.keys():
            if kind not in self.natural or kind not in self.drawn_with:
                raise ValueError(f"{kind} has opportunities and no probability")
        for event in self.events:
            if event.rare is not None and event.rare not in begun:
                raise ValueError(f"an event is said to be of a {event.rare}, and none began")

    @property
    def begun(self) -> Counts:
        """How many rare events of each kind began."""
        found: Counts = {}
        for each in self.rare_events:
            found[each.kind] = found.get(each.kind, 0) + 1
        return found


def likelihood_ratio(
    natural: Mapping[RareKind, float], drawn_with: Mapping[RareKind, float], passed: Counts, begun: Counts
) -> float:
    """The weight of draws of which so many passed and so many began: the product of (1 - p) / (1 - q) and p / q.

    So the weight under other natural probabilities than those that were
    thought of while driving can be had from the same records.
    """
    weight = 1.0
    for kind, number in passed.items():
        weight *= ((1.0 - natural[kind]) / (1.0 - drawn_with[kind])) ** number
    for kind, number in begun.items():
        weight *= (natural[kind] / drawn_with[kind]) ** number
    return weight


_decoder = msgspec.json.Decoder(SegmentRecord)


def segment_of(line: bytes) -> SegmentRecord:
    """A record from its line of JSON; RecordError if it is none."""
    from interplan_sumo.batch.records import decoded

    return decoded(_decoder, line)
