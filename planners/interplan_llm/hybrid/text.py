"""A scene in words: what a language model reads before it chooses."""

from __future__ import annotations

from collections.abc import Sequence

from interplan_llm.hybrid.behaviours import Behaviour
from interplan_llm.hybrid.scene import BlockedLane, DecisionScene, LaneView, Occluder, Oncoming, Other, Walker
from interplan_llm.models.protocol import Message

MEANINGS = {
    Behaviour.FOLLOW: "stay in the own lane behind whoever is ahead",
    Behaviour.MERGE_LEFT: "change to the left lane",
    Behaviour.MERGE_RIGHT: "change to the right lane",
    Behaviour.OVERTAKE: "drive around what blocks the own lane and come back",
    Behaviour.STOP: "brake, stand and wait",
}
STANDING_MPS = 0.3
REMEMBERED = 5
"""Decisions of the past that a prompt with memory holds."""

_ROLE = (
    "You choose what an automated car does for the next second. Be safe first: no collision, no one forced to brake "
    "hard. Then reach the goal lane, pass what blocks the way, and do not stand without a reason. Distances are in "
    "metres from bumper to bumper, speeds in m/s."
)
_SHORT = "Answer with one of the options and nothing else."
_THOUGHTS = (
    "Think in at most three short sentences about what matters and what each option would lead to, then end "
    "with the option you choose between double angle brackets, such as <<{example}>>."
)


def messages(
    scene: DecisionScene,
    options: Sequence[Behaviour],
    past: Sequence[tuple[float, Behaviour]] = (),
    *,
    thoughts: bool = False,
) -> tuple[Message, Message]:
    """The question about a scene: who you are and how to answer, and what there is to see.

    `past` are decisions with their times in seconds, oldest first; the last
    few are told, with the advice to have a reason for a change of mind.
    """
    form = _THOUGHTS.format(example=options[0]) if thoughts else _SHORT
    return Message("system", f"{_ROLE} {form}"), Message("user", "\n".join(_lines(scene, options, past)))


def _lines(scene: DecisionScene, options: Sequence[Behaviour], past: Sequence[tuple[float, Behaviour]]) -> list[str]:
    told = [
        f"Own speed {scene.speed_mps:.1f}, limit {scene.limit_mps:.1f}.",
        _goal(scene),
        f"Own lane: {_lane(scene.current, own=True)}",
        f"Left lane: {_lane(scene.left) if scene.left is not None else 'none.'}",
        f"Right lane: {_lane(scene.right) if scene.right is not None else 'none.'}",
    ]
    if scene.current.blocked is not None:
        told += [_way_round(scene.current.blocked)]
    if scene.oncoming is not None:
        told += [_oncoming(scene.oncoming)]
    if scene.light is not None:
        told += [f"Light: {scene.light[0]} in {scene.light[1]:.0f}."]
    told += [_cover(cover) for cover in scene.covers[:2]]
    told += [_walker(walker) for walker in scene.walkers[:2]]
    if past:
        said = ", ".join(f"{behaviour} {scene.time_s - time_s:.0f} s ago" for time_s, behaviour in past[-REMEMBERED:])
        told += [f"You chose: {said}. Change your mind only for a reason."]
    told += ["Options:", *(f"- {option}: {MEANINGS[option]}" for option in options)]
    return told


def _goal(scene: DecisionScene) -> str:
    needed = scene.current.changes_needed
    if needed == 0:
        return f"The own lane leads to the goal, {scene.goal_m:.0f} ahead."
    for name, lane in (("left", scene.left), ("right", scene.right)):
        if lane is not None and lane.changes_needed is not None and (needed is None or lane.changes_needed < needed):
            count = lane.changes_needed + 1
            return f"The goal is {count} lane{'s' if count > 1 else ''} to the {name}, {scene.goal_m:.0f} ahead."
    return f"No lane change from here leads to the goal; the way ends {scene.goal_m:.0f} ahead."


def _lane(lane: LaneView, *, own: bool = False) -> str:
    parts = [] if lane.blocked is None else [f"blocked by {_what(lane.blocked)} {_where(lane.blocked.gap_m, 'ahead')}"]
    parts += [_other(lane.ahead, "ahead", own=own)] if lane.ahead is not None else []
    parts += [_other(lane.behind, "behind", own=own)] if lane.behind is not None else []
    return ("; ".join(parts) or "free") + "."


def _other(other: Other, where: str, *, own: bool) -> str:
    speed = "standing" if abs(other.speed_mps) < STANDING_MPS else f"at {other.speed_mps:.1f}"
    if own or other.gap_m > 0.0:
        return f"{other.kind} {_where(other.gap_m, where)} {speed}"
    return f"{other.kind} right beside you {speed}"


def _where(gap_m: float, where: str) -> str:
    return f"{gap_m:.0f} {where}" if gap_m > 0.0 else "beside you"


def _what(blocked: BlockedLane) -> str:
    return blocked.kind if blocked.kind == "cones" else f"a {blocked.kind}"


def _way_round(blocked: BlockedLane) -> str:
    if not blocked.passes:
        return "There is no room to drive around it."
    side, offset_m = blocked.passes[0]
    where = "over the lane of oncoming traffic" if blocked.against_traffic else "with room"
    return f"Driving around it is possible on the {side}, {where}, {abs(offset_m):.1f} beside the lane's middle."


def _oncoming(oncoming: Oncoming) -> str:
    return (
        f"Oncoming: vehicle {oncoming.gap_m:.0f} ahead at {oncoming.speed_mps:.1f}, "
        f"you meet in {oncoming.meets_in_s:.1f} s."
    )


def _cover(cover: Occluder) -> str:
    return (
        f"A long vehicle, perhaps a bus at a stop, stands on the {cover.side} {cover.ahead_m:.0f} ahead "
        "and hides who may step out."
    )


def _walker(walker: Walker) -> str:
    side = "left" if walker.aside_m > 0.0 else "right"
    moves = (
        f"walks towards your lane at {walker.towards_mps:.1f}"
        if walker.towards_mps > STANDING_MPS
        else "stands"
        if walker.towards_mps > -STANDING_MPS
        else "walks away from your lane"
    )
    return f"A pedestrian {walker.ahead_m:.0f} ahead, {abs(walker.aside_m):.0f} to the {side}, {moves}."
