"""The five behaviours, and which of them a scene offers."""

from __future__ import annotations

from enum import StrEnum

from interplan_llm.hybrid.scene import DecisionScene, LaneView


class Behaviour(StrEnum):
    """What can be chosen; the words are the published ones."""

    FOLLOW = "follow_current_lane"
    MERGE_LEFT = "merge_left"
    MERGE_RIGHT = "merge_right"
    OVERTAKE = "overtake_obstacle"
    STOP = "stop_and_wait"


NEAR_S, NEAR_M = 3.0, 15.0
"""A lane that is blocked beyond what is driven in this time, and beyond this, may still be followed."""


def offered(scene: DecisionScene) -> tuple[Behaviour, ...]:
    """The behaviours that make sense, in a fixed order; never empty.

    As published: following is out where the lane is blocked; a merge needs a
    lane, and unless the own lane is blocked one that leads to the goal with
    fewer lane changes; passing is for a blocked lane without another to go
    to. Other than published: a blockage that is still far leaves the
    lane to be followed, for nothing is gained by stopping a hundred metres before it;
    a lane that is blocked as near as the own one is no way out, a
    merge never leads to where no way to the goal is known; passing needs room
    beside the obstacle; and one may wait wherever the lane is blocked, or
    where somebody might step out.
    """
    blocked = scene.current.blocked
    merges = [
        behaviour
        for behaviour, lane in ((Behaviour.MERGE_LEFT, scene.left), (Behaviour.MERGE_RIGHT, scene.right))
        if lane is not None and _worth_merging(scene.current, lane)
    ]
    far = blocked is None or blocked.gap_m > max(NEAR_S * scene.speed_mps, NEAR_M)
    options = [Behaviour.FOLLOW] if far else []
    options += merges
    if blocked is not None and not merges and blocked.passes:
        options.append(Behaviour.OVERTAKE)
    if not far or scene.walkers or scene.covers:
        options.append(Behaviour.STOP)
    return tuple(options)


def _worth_merging(here: LaneView, there: LaneView) -> bool:
    if here.blocked is not None:
        return there.blocked is None or there.blocked.gap_m > here.blocked.gap_m + 20.0
    if there.blocked is not None or there.changes_needed is None:
        return False
    return here.changes_needed is None or there.changes_needed < here.changes_needed
