"""Signal programs: stages, greens and clearance times for a junction under a traffic light.

A *stage* is a set of movements that run together. Two movements in conflict are
never both green with priority; a turn across oncoming traffic may be green with
the duty to yield ("g") where design practice allows permissive turns.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from interplan_sumo.maps.junctions import Junction, Movement
from interplan_sumo.world.roads import USUAL_LIMIT_MPS, Roads

# Times of urban practice (MUTCD, ITE): yellow 1 s + v / (2 * 3.05 m/s2), all red until the longest path is clear.
REACTION_S = 1.0
COMFORTABLE_BRAKING_MPS2 = 3.05
YELLOW_S = (3.0, 4.0)
ALL_RED_S = (1.0, 3.0)
GREEN_S = (14.0, 30.0)
TURN_GREEN_S = (7.0, 14.0)
CROSSING_S = 12.0
"""Red for the cars where nothing but pedestrians crosses."""
GREEN_PER_LANE_S = 6.0
PERMISSIVE_LANES = 2
"""Turning across more oncoming lanes than this waits for a green arrow."""

Stage = dict[int, str]
"""Row of the junction -> "G" or "g"; rows not named are red."""


@dataclass(frozen=True, slots=True)
class Program:
    """A fixed-time program: phases of (seconds, state), one letter per link."""

    links: tuple[str, ...]
    """Connector ids in the order of the state string."""
    phases: tuple[tuple[float, str], ...]
    offset_s: float


def program(roads: Roads, junction: Junction, number: int) -> Program:
    """The program of a junction with lights; `number` spreads the offsets of neighbouring junctions."""
    stages = _stages(junction)
    lit = junction.lit
    limits = [c.speed_limit_mps or _limit(roads, c.from_lane_id) for c in junction.connectors]
    phases: list[tuple[float, str]] = []
    for k, stage in enumerate(stages):
        following = stages[(k + 1) % len(stages)]
        phases.append((_green_s(junction, stage), _state(lit, stage)))
        # An arrow that becomes a duty to yield ends first: the oncoming traffic must not start into a turning car.
        losing = [i for i in stage if i not in following or (stage[i] == "G" and following[i] == "g")]
        if not losing:
            continue
        staying = {i: stage[i] for i in stage if i not in losing}
        speed = max(limits[i] for i in losing)
        yellow = _within(REACTION_S + speed / (2 * COMFORTABLE_BRAKING_MPS2), YELLOW_S)
        clearing = max(junction.connectors[i].centerline.length_m / limits[i] for i in losing)
        phases.append((round(yellow, 1), _state(lit, staying | dict.fromkeys(losing, "y"))))
        phases.append((round(_within(clearing, ALL_RED_S), 1), _state(lit, staying)))
    cycle_s = sum(duration for duration, _ in phases)
    golden = (math.sqrt(5.0) - 1.0) / 2.0  # spreads any number of junctions evenly over the cycle
    return Program(
        tuple(junction.connectors[i].id for i in lit), tuple(phases), float(round((number * golden) % 1.0 * cycle_s))
    )


def _limit(roads: Roads, lane_id: str) -> float:
    return roads.lanes[lane_id].speed_limit_mps or USUAL_LIMIT_MPS


def _within(value: float, bounds: tuple[float, float]) -> float:
    return min(bounds[1], max(bounds[0], value))


def _state(lit: Sequence[int], letters: dict[int, str]) -> str:
    return "".join(letters.get(i, "r") for i in lit)


def _green_s(junction: Junction, stage: Stage) -> float:
    """Longer the more lanes are served; turn arrows are short, a stage without cars is the pedestrians'."""
    strong = [i for i, letter in stage.items() if letter == "G"]
    if not strong:
        return CROSSING_S
    main = [i for i in strong if junction.movements[i] is not Movement.NEAR_TURN] or strong
    turning = all(junction.movements[i] in (Movement.FAR_TURN, Movement.U_TURN) for i in main)
    lanes: dict[int, set[str]] = {}
    for i in main:
        lanes.setdefault(junction.approach_of[i], set()).add(junction.connectors[i].from_lane_id)
    wanted = GREEN_PER_LANE_S * (1 + max(len(used) for used in lanes.values()))
    return round(_within(wanted, TURN_GREEN_S if turning else GREEN_S))


# --- stages ------------------------------------------------------------------------------------


def _stages(junction: Junction) -> list[Stage]:
    lit = junction.lit
    stages: list[Stage] = []
    done: set[int] = set()
    for approach in sorted({junction.approach_of[i] for i in lit}):
        if approach in done:
            continue
        facing = junction.opposite.get(approach)
        pair = [approach] if facing is None or not _rows(junction, facing) else [approach, facing]
        done.update(pair)
        stages += _axis_stages(junction, pair)
    for row in lit:  # whoever got no green by the rules of practice gets a stage of its own
        if not any(row in stage for stage in stages):
            home = next((s for s in stages if _joins(junction, row, s)), None)
            if home is None:
                stages.append({row: "G"})
            else:
                home[row] = "G"
    for stage in stages:
        _add_turn_arrows(junction, stage, stages)
    if len(stages) == 1:
        stages.append({})
    return stages


def _rows(junction: Junction, approach: int) -> list[int]:
    return [i for i in junction.lit if junction.approach_of[i] == approach]


def _axis_stages(junction: Junction, pair: Sequence[int]) -> list[Stage]:
    """The stages of one road: of two approaches that face each other, or of a single one."""
    if len(pair) == 1:
        return _split(junction, _rows(junction, pair[0]))
    sides = [_rows(junction, approach) for approach in pair]
    turns = [[i for i in rows if junction.movements[i] >= Movement.FAR_TURN] for rows in sides]
    ahead = [[i for i in rows if junction.movements[i] < Movement.FAR_TURN] for rows in sides]
    if _clash(junction, ahead[0], ahead[1]):  # skewed arms: one side after the other
        return [stage for rows in sides for stage in _split(junction, rows)]
    own_lane = [_own_lanes(junction, t, a) for t, a in zip(turns, ahead, strict=True)]
    protected_only = [
        bool(turns[k]) and _oncoming_lanes(junction, turns[k], ahead[1 - k]) > PERMISSIVE_LANES for k in range(2)
    ]
    if any(p and not own for p, own in zip(protected_only, own_lane, strict=True)):
        return [stage for rows in sides for stage in _split(junction, rows)]
    stages: list[Stage] = []
    arrows = [turns[k] if own_lane[k] else [] for k in range(2)]
    if all(arrows) and not _clash(junction, *arrows):
        stages.append(dict.fromkeys((*arrows[0], *arrows[1]), "G"))
    else:
        for k in range(2):
            if arrows[k]:
                stages += _split(junction, [*arrows[k], *ahead[k]])
    through: Stage = dict.fromkeys((*ahead[0], *ahead[1]), "G")
    for k in range(2):
        if not protected_only[k]:
            through |= dict.fromkeys(turns[k], "g")
    if any(letter == "G" for letter in through.values()):
        stages += _repaired(junction, through)
    elif not stages:
        return [stage for rows in sides for stage in _split(junction, rows)]
    return stages


def _split(junction: Junction, rows: Sequence[int]) -> list[Stage]:
    return _repaired(junction, dict.fromkeys(rows, "G")) if rows else []


def _repaired(junction: Junction, stage: Stage) -> list[Stage]:
    """The stage without conflicting priority greens: who must yield anyway gets "g", or else a stage of its own."""
    left: Stage = dict(stage)
    later: list[int] = []
    for i in sorted(stage):
        for j in sorted(stage):
            if i < j and i in left and j in left and junction.conflicts[i, j] and left[i] == left[j] == "G":
                loser = i if junction.yields[i, j] else j
                winner = j if loser == i else i
                merging = junction.connectors[i].to_lane_id == junction.connectors[j].to_lane_id
                if merging or junction.movements[loser] > junction.movements[winner]:
                    left[loser] = "g"
                else:
                    del left[loser]
                    later.append(loser)
    # whoever yields must yield to every priority green that it meets
    for i, letter in list(left.items()):
        if letter == "g" and any(
            junction.conflicts[i, j] and not junction.yields[i, j] for j, other in left.items() if other == "G"
        ):
            del left[i]
            later.append(i)
    return [left, *(_split(junction, later) if len(later) < len(stage) else [{i: "G"} for i in later])]


def _clash(junction: Junction, first: Iterable[int], second: Iterable[int]) -> bool:
    """Whether paths of the two sets cross; merging into one lane does not count, the weaker yields there."""
    second = tuple(second)
    return any(
        junction.conflicts[i, j] and junction.connectors[i].to_lane_id != junction.connectors[j].to_lane_id
        for i in first
        for j in second
    )


def _own_lanes(junction: Junction, turns: Sequence[int], ahead: Sequence[int]) -> bool:
    """Whether the turns have lanes that nobody else uses."""
    shared = {junction.connectors[i].from_lane_id for i in ahead}
    return bool(turns) and not any(junction.connectors[i].from_lane_id in shared for i in turns)


def _oncoming_lanes(junction: Junction, turns: Sequence[int], oncoming: Sequence[int]) -> int:
    return max(len({junction.connectors[j].from_lane_id for j in oncoming if junction.conflicts[i, j]}) for i in turns)


def _joins(junction: Junction, row: int, stage: Stage) -> bool:
    return bool(stage) and not any(junction.conflicts[row, other] for other in stage)


def _add_turn_arrows(junction: Junction, stage: Stage, stages: Sequence[Stage]) -> None:
    """Near-side turns from lanes of their own also run with the arrows of the cross street's far-side turns.

    Never in every stage: pedestrians want to cross there, too.
    """
    near = [i for i in junction.lit if junction.movements[i] is Movement.NEAR_TURN]
    others = {junction.connectors[i].from_lane_id for i in junction.lit if i not in near}
    arrows = {
        junction.approach_of[i] for i, s in stage.items() if s == "G" and junction.movements[i] >= Movement.FAR_TURN
    }
    for i in near:
        approach = junction.approach_of[i]
        crossing = arrows - {approach, junction.opposite.get(approach, approach)}
        own_lane = junction.connectors[i].from_lane_id not in others
        elsewhere = sum(i in s for s in stages)
        if i not in stage and crossing and own_lane and elsewhere + 1 < len(stages) and _joins(junction, i, stage):
            stage[i] = "G"
