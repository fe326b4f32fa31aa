"""Who may go where at a junction: from lane use to pairs of lanes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from interplan_sumo.world.geometry import wrap_angle
from interplan_sumo.world.roads import Turn
from tools.make_maps.layout import Arm, Block
from tools.make_maps.plan import LaneStrip, Plan, PlannedJunction

STRAIGHT_RAD = np.radians(32.0)
"""Two roads that differ by less lead straight on into one another."""

LETTERS = {Turn.LEFT: "L", Turn.STRAIGHT: "T", Turn.RIGHT: "R"}
"""How plans write lane use."""


@dataclass(frozen=True, slots=True)
class PlannedMovement:
    """One connector to be: lanes are counted from the inner one."""

    arriving: Arm
    leaving: Arm
    before: Block
    after: Block
    from_lane: int
    to_lane: int
    turn: Turn


def travel_heading_rad(plan: Plan, arm: Arm, *, arriving: bool) -> float:
    """Direction in which traffic passes the cut of an arm."""
    axis = plan.road[arm.road].axis.pose(arm.cut_m).heading_rad
    along = (arm.sign < 0) == arriving
    return float(wrap_angle(axis if along else axis + np.pi))


def movements(plan: Plan, junction: PlannedJunction, arms: Sequence[Arm]) -> tuple[PlannedMovement, ...]:
    """All connectors of a junction, by approach; ValueError where lanes do not fit."""
    found: list[PlannedMovement] = []
    for arm in arms:
        if arm.arriving is not None:
            found += _from(plan, junction, arm, arm.arriving, arms)
    return tuple(found)


def _from(plan: Plan, junction: PlannedJunction, arm: Arm, block: Block, arms: Sequence[Arm]) -> list[PlannedMovement]:
    heading = travel_heading_rad(plan, arm, arriving=True)
    exits: dict[Turn, list[Arm]] = {Turn.LEFT: [], Turn.STRAIGHT: [], Turn.RIGHT: []}
    for other in arms:
        if other is arm or other.leaving is None or (arm.key, other.key) in junction.banned:
            continue
        bend = float(wrap_angle(travel_heading_rad(plan, other, arriving=False) - heading))
        straight = other.road == arm.road or abs(bend) < STRAIGHT_RAD
        exits[Turn.STRAIGHT if straight else Turn.LEFT if bend > 0.0 else Turn.RIGHT].append(other)
    approach = (junction.approaches or {}).get(arm.key)
    if approach and approach.use:
        letters = approach.use if plan.driving_side == "right" else approach.use[::-1]
    else:
        letters = _lane_use(plan, block, exits)
    offered = {letter for turn, letter in LETTERS.items() if exits[turn]}
    for use in letters:
        if not offered & set(use):
            raise ValueError(f"junction {junction.name}: a lane of {arm.key} leads nowhere ({', '.join(letters)})")
    found: list[PlannedMovement] = []
    for turn, letter in LETTERS.items():
        sources = [i for i, use in enumerate(letters) if letter in use]
        for other in exits[turn]:
            after = other.leaving
            if after is None:
                continue
            targets = after.strips
            if len(sources) > len(targets):
                raise ValueError(
                    f"junction {junction.name}: {len(sources)} lanes of {arm.key} lead into "
                    f"{len(targets)} of {other.key}"
                )
            inner_turn = (turn is Turn.LEFT) == (plan.driving_side == "right")
            if turn is Turn.STRAIGHT:
                shift = best_shift([block.strips[i] for i in sources], targets)
            else:
                shift = 0 if inner_turn else len(targets) - len(sources)
            found += [
                PlannedMovement(arm, other, block, after, lane, shift + i, turn) for i, lane in enumerate(sources)
            ]
    return found


def _lane_use(plan: Plan, block: Block, exits: dict[Turn, list[Arm]]) -> tuple[str, ...]:
    """Turns per lane from the inner one: pockets turn; without a pocket the lane at that side turns as well.

    Where nothing leads straight on, the lanes without a pocket share the turns that have none.
    """
    inner, kerb = (Turn.LEFT, Turn.RIGHT) if plan.driving_side == "right" else (Turn.RIGHT, Turn.LEFT)
    count = len(block.strips)
    inner_pockets, kerb_pockets = range(block.inner_pockets), range(count - block.kerb_pockets, count)
    main = range(block.inner_pockets, count - block.kerb_pockets)
    if exits[Turn.STRAIGHT]:
        lanes = {Turn.STRAIGHT: main, inner: inner_pockets or main[:1], kerb: kerb_pockets or main[-1:]}
    elif not (exits[inner] and exits[kerb]):
        lanes = {inner: range(count), kerb: range(count)}
    elif inner_pockets or kerb_pockets:
        lanes = {inner: inner_pockets or main, kerb: kerb_pockets or main}
    else:
        half = (count + 1) // 2
        lanes = {inner: main[:half], kerb: main[half:] or main}
    return tuple(
        "".join(LETTERS[turn] for turn in lanes if exits[turn] and lane in lanes[turn]) for lane in range(count)
    )


def best_shift(sources: Sequence[LaneStrip], targets: Sequence[LaneStrip]) -> int:
    """How far to count on in the longer of two rows of lanes so that pairs lie as nearly in line as can be."""
    shorter, longer = sorted((sources, targets), key=len)
    shifts = range(len(longer) - len(shorter) + 1)
    miss = [
        sum(abs(a.middle_m - b.middle_m) for a, b in zip(shorter, longer[shift:], strict=False)) for shift in shifts
    ]
    return int(np.argmin(np.round(miss, 6)))


def joint_pairs(before: Sequence[LaneStrip], after: Sequence[LaneStrip]) -> tuple[tuple[int, int], ...]:
    """Lanes that lead into one another across a taper, from the inner one.

    Where lanes are gained the nearest old lane leads into each new one as well;
    where lanes are lost they lead into the nearest lane that goes on.
    """
    shift = best_shift(before, after)
    if len(after) >= len(before):
        last = len(before) - 1
        return tuple((min(max(i - shift, 0), last), i) for i in range(len(after)))
    last = len(after) - 1
    return tuple((i, min(max(i - shift, 0), last)) for i in range(len(before)))
