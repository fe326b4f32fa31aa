"""MOBIL: whether a lane change is safe, and what it brings to the ego and to those behind (Kesting et al., 2007)."""

from __future__ import annotations

from dataclasses import dataclass, replace

from interplan_planners.common.gaps import GapRules, clearances_needed_m
from interplan_planners.common.idm_policy import IdmDriver, idm_acceleration_mps2
from interplan_planners.common.neighbours import LaneQueue

ENTRY_S = 1.5
"""After this part of a change the car's side crosses the lane line."""
ALONGSIDE_M = 0.5
"""With a smaller gap somebody is alongside."""
HARDEST_BRAKING_MPS2 = 9.0
"""No car brakes harder, whatever the model asks."""


@dataclass(frozen=True, slots=True)
class Side:
    """One lane as a car on it, or beside it, sees it: bumper-to-bumper gaps and speeds along the lane."""

    gap_m: float
    """To the nearest ahead, or to where the lane ends; infinite if there is neither. Negative alongside."""
    lead_mps: float
    follower_gap_m: float
    """To the nearest behind; infinite if there is none. Negative alongside."""
    follower_mps: float
    limit_mps: float

    def later(self, speed_mps: float, ahead_s: float) -> Side:
        """The same lane some time later, if everybody including the car goes on at constant speed."""
        return replace(
            self,
            gap_m=self.gap_m + (self.lead_mps - speed_mps) * ahead_s,
            follower_gap_m=self.follower_gap_m + (speed_mps - self.follower_mps) * ahead_s,
        )

    def closes(self, speed_mps: float, braking_mps2: float, least_gap_m: float, within_s: float) -> bool:
        """Whether a gap gets smaller than one may be within some time, or asks for harder braking to keep it open."""
        soon = self.later(speed_mps, within_s)
        if min(self.gap_m, soon.gap_m, self.follower_gap_m, soon.follower_gap_m) < least_gap_m:
            return True
        own_mps, other_mps = max(speed_mps - self.lead_mps, 0.0), max(self.follower_mps - speed_mps, 0.0)
        return max(own_mps**2 / self.gap_m, other_mps**2 / self.follower_gap_m) > 2.0 * braking_mps2


@dataclass(frozen=True, slots=True)
class MobilVerdict:
    """What MOBIL says of one change."""

    safe: bool
    incentive_mps2: float
    """Own gain, plus politeness times what the two followers gain."""


def side_of(queue: LaneQueue, arc_m: float, half_length_m: float, end_m: float, limit_mps: float) -> Side:
    """A lane as seen by a car whose middle is at an arc length; `end_m` is where something stands or the lane ends."""
    i = queue.ahead_of(arc_m)
    gap_m, lead_mps = end_m - arc_m - half_length_m, 0.0
    if i < len(queue) and float(queue.rear_m[i]) < end_m:
        gap_m, lead_mps = float(queue.rear_m[i]) - arc_m - half_length_m, float(queue.speed_mps[i])
    follower_gap_m, follower_mps = float("inf"), 0.0
    if i > 0:
        follower_gap_m, follower_mps = (
            arc_m - half_length_m - float(queue.front_m[i - 1]),
            float(queue.speed_mps[i - 1]),
        )
    return Side(gap_m, lead_mps, follower_gap_m, max(follower_mps, 0.0), limit_mps)


def judge(
    here: Side,
    there: Side,
    speed_mps: float,
    length_m: float,
    driver: IdmDriver,
    rules: GapRules,
    politeness: float,
    safe_deceleration_mps2: float,
) -> MobilVerdict:
    """MOBIL's criteria for a change from one lane to another.

    Followers are taken to drive as the ego does, towards the limit of their
    lane or their own speed if that is higher. What counts on the new lane are
    the gaps when the ego gets there, `ENTRY_S` from now. Safe means that neither
    the new follower nor the ego must then brake harder than
    `safe_deceleration_mps2`, that both gaps are as large as the rules ask, and
    that nobody is alongside now.
    """
    now, there = there, there.later(speed_mps, ENTRY_S)
    own_before = acceleration(driver, here.limit_mps, speed_mps, here.gap_m, here.lead_mps)
    own_after = acceleration(driver, there.limit_mps, speed_mps, there.gap_m, there.lead_mps)
    new_before = new_after = 0.0
    if there.follower_gap_m < float("inf"):
        new_before = acceleration(
            driver, there.limit_mps, there.follower_mps, there.follower_gap_m + length_m + there.gap_m, there.lead_mps
        )
        new_after = acceleration(driver, there.limit_mps, there.follower_mps, there.follower_gap_m, speed_mps)
    old_gain = 0.0
    if here.follower_gap_m < float("inf"):
        old_before = acceleration(driver, here.limit_mps, here.follower_mps, here.follower_gap_m, speed_mps)
        old_after = acceleration(
            driver, here.limit_mps, here.follower_mps, here.follower_gap_m + length_m + here.gap_m, here.lead_mps
        )
        old_gain = old_after - old_before
    ahead_m, behind_m = clearances_needed_m(rules, speed_mps, there.lead_mps, there.follower_mps)
    safe = (
        min(now.gap_m, now.follower_gap_m) >= ALONGSIDE_M
        and there.gap_m >= float(ahead_m)
        and there.follower_gap_m >= float(behind_m)
        and new_after >= -safe_deceleration_mps2
        and own_after >= -safe_deceleration_mps2
    )
    incentive = own_after - own_before + politeness * (new_after - new_before + old_gain)
    return MobilVerdict(safe, incentive)


def acceleration(driver: IdmDriver, limit_mps: float, speed_mps: float, gap_m: float, lead_mps: float) -> float:
    """IDM's acceleration towards a limit, never braking harder than a car can."""
    wanted = replace(driver, target_speed_mps=max(limit_mps, speed_mps, 0.1))
    return max(-HARDEST_BRAKING_MPS2, idm_acceleration_mps2(wanted, speed_mps, max(gap_m, 0.01), lead_mps))
