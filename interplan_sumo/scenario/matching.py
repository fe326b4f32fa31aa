"""Matching: which lanes a recorded path follows, as a chain that is connected in the lane graph.

Every point of the path may lie on each lane near it that heads its way. The
chain is the cheapest way through these (Viterbi): far from the centre line,
turned against it, and changing lane cost.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from interplan_sumo.world.geometry import Floats, wrap_angle
from interplan_sumo.world.roads import Roads

REACH_M: Final = 4.0
"""A lane whose centre line is farther away than this is not the one."""
MOST_TURNED_RAD: Final = float(np.radians(60.0))
SPACING_M: Final = 1.0
"""Of the points of a path that are looked at."""
USUAL_M: Final = 1.0
"""A distance to the centre line that costs 1."""
USUAL_RAD: Final = 0.25
"""An angle to the lane that costs 1."""
LANE_CHANGE_COST: Final = 8.0
MISMATCH_COST_PER_M: Final = 0.5
"""For going farther or less far along the lanes than along the path."""
MOST_LANES_ON: Final = 3
"""Lanes may be so short that a path passes several between two of its points."""


@dataclass(frozen=True, slots=True)
class LaneMatch:
    """A pose seen from a lane or connector."""

    lane: str
    arc_m: float
    left_m: float
    turned_rad: float
    """Heading relative to the lane, counter-clockwise."""

    @property
    def cost(self) -> float:
        """How unlikely it is that this is the lane of the pose."""
        return (self.left_m / USUAL_M) ** 2 + (self.turned_rad / USUAL_RAD) ** 2


@dataclass(frozen=True, slots=True)
class MatchedPath:
    """The lanes that a path follows."""

    chain: tuple[str, ...]
    """Lanes and connectors in driving order; each leads on to the next or lies beside it."""
    first: LaneMatch
    last: LaneMatch
    is_whole: bool
    """Whether all of the path could be followed."""


@dataclass(frozen=True, slots=True)
class _State:
    """The cheapest way to a lane at one point of the path."""

    cost: float
    match: LaneMatch
    before: _State | None
    via: tuple[str, ...]
    """Lanes passed since the state before, this one included."""


def matches(roads: Roads, pose: Floats, reach_m: float = REACH_M) -> list[LaneMatch]:
    """The lanes and connectors that a pose (3,) may lie on, the likeliest first."""
    x_m, y_m, heading_rad = (float(value) for value in pose)
    found: list[LaneMatch] = []
    for lane in roads.lanes_near(x_m, y_m, reach_m):
        line = roads[lane].centerline
        arc_m, left_m = line.project_point(x_m, y_m)
        turned_rad = float(wrap_angle(heading_rad - line.pose_at(arc_m).heading_rad))
        if abs(left_m) <= reach_m and abs(turned_rad) <= MOST_TURNED_RAD:
            found.append(LaneMatch(lane, arc_m, left_m, turned_rad))
    return sorted(found, key=lambda match: (match.cost, match.lane))


def matched_path(roads: Roads, poses: Floats) -> MatchedPath | None:
    """The chain of lanes along poses (K, 3), up to where the path leaves the lanes; None if it begins beside them."""
    path = _thinned(poses)
    states = {match.lane: _State(match.cost, match, None, (match.lane,)) for match in matches(roads, path[0])}
    if not states:
        return None
    followed = 1
    for before, here in pairwise(path):
        further = _further(roads, states, matches(roads, here), float(np.hypot(*(here - before)[:2])))
        if not further:
            break
        states, followed = further, followed + 1
    last = state = min(states.values(), key=lambda each: (each.cost, each.match.lane))
    chain = list(reversed(last.via))
    while state.before is not None:
        state = state.before
        chain += reversed(state.via)
    return MatchedPath(tuple(reversed(chain)), state.match, last.match, followed == len(path))


def _thinned(poses: Floats) -> Floats:
    """Poses at least `SPACING_M` apart, the first among them."""
    kept = [0]
    for row in range(1, len(poses)):
        if np.hypot(*(poses[row] - poses[kept[-1]])[:2]) >= SPACING_M:
            kept.append(row)
    return poses[kept]


def _further(
    roads: Roads, states: Mapping[str, _State], here: list[LaneMatch], travelled_m: float
) -> dict[str, _State]:
    """The cheapest way to each match of the next point from the states of the one before."""
    found: dict[str, _State] = {}
    wanted = {match.lane: match for match in here}
    for state in states.values():
        for lane, via, to_its_start_m, cost in _steps(roads, state.match):
            match = wanted.get(lane)
            if match is None:
                continue
            mismatch_m = abs(to_its_start_m + match.arc_m - travelled_m)
            total = state.cost + match.cost + cost + MISMATCH_COST_PER_M * mismatch_m
            if lane not in found or total < found[lane].cost:
                found[lane] = _State(total, match, state, via)
    return found


def _steps(roads: Roads, match: LaneMatch) -> Iterator[tuple[str, tuple[str, ...], float, float]]:
    """Where one may be next: lane, the lanes passed to get there, metres to its start, and what that costs."""
    lane = match.lane
    yield lane, (), -match.arc_m, 0.0
    for beside in (roads.left_of(lane), roads.right_of(lane)):
        if beside is not None:
            here = roads[lane].centerline.pose_at(match.arc_m)
            arc_m, _ = beside.centerline.project_point(here.x_m, here.y_m)
            yield beside.id, (beside.id,), -arc_m, LANE_CHANGE_COST
    ahead = [(lane, (), roads[lane].centerline.length_m - match.arc_m)]
    for _ in range(MOST_LANES_ON):
        ahead = [
            (after, (*via, after), to_end_m)
            for end, via, to_end_m in ahead
            for after in roads.outgoing(end)
            if after not in via and after != lane
        ]
        for after, via, to_its_start_m in ahead:
            yield after, via, to_its_start_m, 0.0
        ahead = [(after, via, to_m + roads[after].centerline.length_m) for after, via, to_m in ahead]
