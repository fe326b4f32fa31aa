"""Gaps between the cars of a lane: which one a car beside it can get into, and how it must drive to do so."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from interplan_planners.common.neighbours import LaneQueue

_FAR_M = 1e6
OWN_HEADWAY_S = 0.3
"""To its own lead while it gets beside a gap."""
WAITING_PER_S = 0.3
"""How much acceleration a second of waiting is worth, in m/s2."""


@dataclass(frozen=True, slots=True)
class GapRules:
    """What makes a gap large enough, and what reaching one may ask for."""

    min_gap_m: float = 1.0
    headway_s: float = 0.5
    """To the car ahead at the ego's speed and from the car behind at its own; smaller than when following."""
    braking_mps2: float = 2.0
    """With which whoever closes up takes off the difference in speed; positive."""
    hardest_braking_mps2: float = 2.5
    """The most that the ego spends to reach a gap; positive."""
    acceleration_mps2: float = 1.5
    longest_wait_s: float = 10.0
    step_s: float = 0.5


@dataclass(frozen=True, slots=True)
class GapChoice:
    """How to get beside a gap."""

    index: int
    """The gap is behind the car with this index in the queue; the length of the queue: ahead of all."""
    acceleration_mps2: float
    """Constant until then."""
    wait_s: float


@dataclass(frozen=True, slots=True)
class Ego:
    """The ego as the search sees it, in arc lengths of the lane that it wants to change to."""

    arc_m: float
    """Of its middle."""
    speed_mps: float
    length_m: float


def clearances_needed_m(rules: GapRules, speed_mps: Any, ahead_mps: Any, behind_mps: Any) -> tuple[Any, Any]:
    """What must be free before and behind cars, so that nobody brakes harder than the rules say; floats or arrays."""
    return gap_ahead_m(rules, speed_mps, ahead_mps), gap_ahead_m(rules, behind_mps, speed_mps)


def gap_ahead_m(rules: GapRules, speed_mps: Any, ahead_mps: Any) -> Any:
    """What must be free between cars and those ahead of them; floats or arrays."""
    closing = np.maximum(speed_mps - ahead_mps, 0.0)
    return rules.min_gap_m + rules.headway_s * speed_mps + closing**2 / (2.0 * rules.braking_mps2)


def best_gap(
    ego: Ego, queue: LaneQueue, rules: GapRules, limit_mps: float, lead: tuple[float, float] | None, room_m: float
) -> GapChoice | None:
    """The gap in a queue that is reached with the least effort, or None if there is none within the rules.

    All others go on at their speed. The ego drives with one acceleration until
    it is beside the gap, keeps behind its own `lead` (gap from its front bumper
    and speed), and must not travel farther than `room_m`. Effort is the
    acceleration's magnitude plus what waiting is worth.
    """
    times = rules.step_s * np.arange(1, round(rules.longest_wait_s / rules.step_s) + 1)
    pushes = np.unique(np.append(np.linspace(-rules.hardest_braking_mps2, rules.acceleration_mps2, 9), 0.0))
    t, a = times[None, :], pushes[:, None]
    # speeds stay between standing and the limit; whoever is faster already keeps its speed
    top = max(limit_mps, ego.speed_mps)
    until = np.where(a < 0.0, ego.speed_mps / np.maximum(-a, 1e-9), (top - ego.speed_mps) / np.maximum(a, 1e-9))
    pushed = np.minimum(t, np.where(a == 0.0, np.inf, until))
    speed = np.clip(ego.speed_mps + a * pushed, 0.0, top)
    way = ego.speed_mps * pushed + 0.5 * a * pushed**2 + speed * (t - pushed)

    nowhere = np.array([_FAR_M])
    standing = np.zeros(1)
    rear = np.concatenate((-nowhere, queue.front_m))[:, None, None]  # of a gap: the front bumper behind it
    front = np.concatenate((queue.rear_m, nowhere))[:, None, None]
    rear_mps = np.concatenate((standing, queue.speed_mps))[:, None, None]
    front_mps = np.concatenate((queue.speed_mps, standing))[:, None, None]
    before, behind = clearances_needed_m(rules, speed[None], front_mps, np.maximum(rear_mps, 0.0))
    at = ego.arc_m + way
    half_m = 0.5 * ego.length_m
    fits = (front + front_mps * t - at - half_m >= before) & (at - half_m - rear - rear_mps * t >= behind)
    fits &= way <= room_m
    if lead is not None:
        gap_m, lead_mps = lead
        fits &= gap_m + lead_mps * t - way >= rules.min_gap_m + OWN_HEADWAY_S * speed
    if not fits.any():
        return None
    effort = np.where(fits, np.abs(a) + WAITING_PER_S * t, np.inf)
    gap, push, time = np.unravel_index(int(effort.argmin()), effort.shape)
    return GapChoice(int(gap), float(pushes[push]), float(times[time]))
