"""Circumstances: what the ego was doing at a moment and what held it up, in words for the reasons of metrics."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.metrics.association import runs
from interplan_sumo.metrics.collisions import STOPPED_MPS
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.geometry import Floats, Ints
from interplan_sumo.world.signals import SignalStatus

CREEPING_MPS = 0.5
"""Below this an ego that should advance waits."""
SHORTEST_WAIT_S = 1.0
NOTICEABLE_MPS2 = 1.0
"""Less than this is neither braking nor accelerating."""
AHEAD_M = 20.0
"""Whoever is farther ahead holds nobody up that stands."""
BESIDE_M = 0.5
"""So far beside the ego's own width somebody ahead still is in its way."""
CLOSE_M = 1.0
"""Whoever is no farther from its side may hold it up."""
LINE_M = 25.0
"""A light that is farther ahead is not what the ego stands before."""


def ego_doing(facts: Facts, frame: int) -> str:
    """How fast the ego was, whether it braked, and where that was not simply in a lane: `at 8.2 m/s, in a junction`."""
    speed = float(facts.speed_mps[frame])
    said = ["standing" if speed <= STOPPED_MPS else f"at {speed:.1f} m/s"]
    acceleration = float(facts.trace.ego.ax_mps2[frame])
    if acceleration <= -NOTICEABLE_MPS2:
        said.append(f"braking with {-acceleration:.1f} m/s2")
    elif acceleration >= NOTICEABLE_MPS2:
        said.append(f"accelerating with {acceleration:.1f} m/s2")
    if facts.in_intersection[frame]:
        said.append("in a junction")
    elif not facts.places[frame]:
        said.append("between or off the lanes")
    elif facts.body_lanes[frame] is None:
        said.append("across two lanes")
    return ", ".join(said)


def longest_wait(facts: Facts) -> range | None:
    """The frames of the longest stretch of a second or more in which the ego waited."""
    waiting = facts.speed_mps < CREEPING_MPS
    waits = [range(first, end) for first, end in runs(waiting.tolist()) if waiting[first]]
    waits = [wait for wait in waits if len(wait) * facts.step_us * 1e-6 >= SHORTEST_WAIT_S]
    return max(waits, key=len) if waits else None


def how_it_went(facts: Facts) -> str:
    """Where and why the ego waited longest, or how fast it drove if it never did."""
    wait = longest_wait(facts)
    if wait is None:
        return f"it drove {float(facts.speed_mps.mean()):.1f} m/s on average" if facts.frames else "it never drove"
    until = "the end" if wait.stop == facts.frames else f"{facts.time_s[wait.stop]:.1f} s"
    return f"it stood from {facts.time_s[wait.start]:.1f} s to {until} {held_up_by(facts, wait[len(wait) // 2])}"


def held_up_by(facts: Facts, frame: int) -> str:
    """Who or what is ahead of the ego at a moment, or else close beside it."""
    ahead, beside = _nearest(facts, frame)
    red = _red_ahead_m(facts, frame)
    if ahead is not None and (red is None or ahead[1] < red):
        return f"behind {_named(facts, ahead[0])}, {max(0.0, ahead[1]):.1f} m ahead"
    if red is not None:
        return f"before a red light {max(0.0, red):.1f} m ahead"
    if beside is not None:
        return f"beside {_named(facts, beside[0])}, {max(0.0, beside[1]):.1f} m away"
    return f"with nobody within {AHEAD_M:.0f} m ahead in its way"


def _named(facts: Facts, row: int) -> str:
    actors = facts.trace.actors
    kind = ActorKind(int(actors.kind[row]))
    still = "standing " if facts.actor_speed_mps[row] <= STOPPED_MPS and kind.is_agent else ""
    return f"{still}{kind.words} {actors.ids[row]}"


def _nearest(facts: Facts, frame: int) -> tuple[tuple[int, float] | None, tuple[int, float] | None]:
    """Row of the actor table, and gap, of the nearest that is straight ahead, and of the nearest beside the ego."""
    actors, ego, shape = facts.trace.actors, facts.trace.ego, facts.trace.shape
    rows = np.arange(len(actors))[actors.rows(frame)]
    offset = facts.actor_xy[rows] - facts.centre[frame]
    cos, sin = np.cos(ego.heading_rad[frame]), np.sin(ego.heading_rad[frame])
    along, across = offset[:, 0] * cos + offset[:, 1] * sin, offset[:, 1] * cos - offset[:, 0] * sin
    turned = actors.heading_rad[rows] - ego.heading_rad[frame]
    reach = (np.abs(np.cos(turned)) * actors.length_m[rows] + np.abs(np.sin(turned)) * actors.width_m[rows]) / 2
    half = (np.abs(np.sin(turned)) * actors.length_m[rows] + np.abs(np.cos(turned)) * actors.width_m[rows]) / 2
    gap, aside = along - reach - shape.length_m / 2, np.abs(across) - half - shape.width_m / 2
    ahead = (along > 0.0) & (gap <= AHEAD_M) & (aside <= BESIDE_M)
    beside = (np.abs(along) <= reach + shape.length_m / 2) & (aside <= CLOSE_M)
    return _least(rows, gap, ahead), _least(rows, aside, beside)


def _least(rows: Ints, gaps: Floats, met: NDArray[np.bool_]) -> tuple[int, float] | None:
    if not met.any():
        return None
    nearest = int(np.argmin(np.where(met, gaps, np.inf)))
    return int(rows[nearest]), float(gaps[nearest])


def _red_ahead_m(facts: Facts, frame: int) -> float | None:
    """How far ahead of the front bumper the end of the ego's lane is, if every way on shows red there."""
    place = facts.places[frame]
    if not place or place[0] not in facts.roads.lanes:
        return None
    ways = facts.roads.outgoing(place[0])
    if not ways or not set(ways) <= facts.trace.signals[frame].with_status(SignalStatus.RED):
        return None
    line = facts.roads[place[0]].centerline
    away_m = line.length_m - line.project_point(*facts.centre[frame])[0] - facts.trace.shape.length_m / 2
    return away_m if away_m <= LINE_M else None
