"""Junctions: which connectors belong together, where their paths meet, and who goes first.

Everything is worked out from geometry and signs, because the topology of real
maps (dual carriageways, skewed arms, ramps) misleads rules that only look at
the order of the arms around a node.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.world.geometry import wrap_angle
from interplan_sumo.world.roads import USUAL_LIMIT_MPS, Connector, Roads, StopLineKind, Turn

CAR_CORRIDOR_M = 2.0
"""Paths whose corridors of this width overlap are in conflict: a wide car with mirrors."""
_SAME_ARM_RAD = np.radians(30.0)
_SAME_ARM_M = 25.0
_OPPOSITE_RAD = np.radians(50.0)
_STRAIGHT_RAD = np.radians(30.0)
_U_TURN_RAD = np.radians(150.0)
_SIGN_REACH_M = 4.0  # a stop line lies within this of the end of the lane that it holds for


class Movement(IntEnum):
    """What a connector does, in order of right of way."""

    STRAIGHT = 0
    NEAR_TURN = 1
    """Towards the kerb: right where traffic keeps right."""
    FAR_TURN = 2
    """Across the oncoming traffic: left where traffic keeps right."""
    U_TURN = 3


class Sign(IntEnum):
    """What stands at an approach without lights."""

    NONE = 0
    YIELD = 1
    STOP = 2


@dataclass(frozen=True, slots=True)
class JunctionApproach:
    """The lanes that come to a junction on one arm."""

    block_ids: tuple[str, ...]
    heading_rad: float
    lane_count: int
    limit_mps: float
    sign: Sign


@dataclass(frozen=True, eq=False)
class Junction:
    """Connectors that meet, and what follows from their geometry. Rows and columns are in the order of `connectors`."""

    connectors: tuple[Connector, ...]
    approaches: tuple[JunctionApproach, ...]
    approach_of: tuple[int, ...]
    opposite: Mapping[int, int]
    """Approach -> the one that faces it."""
    movements: tuple[Movement, ...]
    conflicts: NDArray[np.bool_]
    """Symmetric: the paths cross, touch or merge. Paths that leave the same lane never do."""
    yields: NDArray[np.bool_]
    """Row yields to column; of two in conflict exactly one, of an all-way stop both."""
    all_way_stop: bool
    kind: str = ""
    """SUMO's type of junction, where the map's file gave it; else it follows from signs and lights."""
    letters: Mapping[int, str] = field(default_factory=dict[int, str])
    """Row -> SUMO's state of a link without a working light, where the file gave it."""

    @property
    def lit(self) -> tuple[int, ...]:
        """Rows under a traffic light."""
        return tuple(i for i, c in enumerate(self.connectors) if c.has_traffic_light)

    @property
    def lit_ids(self) -> tuple[str, ...]:
        """Connectors under a traffic light."""
        return tuple(self.connectors[row].id for row in self.lit)


# --- which connectors belong together ----------------------------------------------------------


class Sets:
    """Disjoint sets; the smallest member names a set."""

    def __init__(self) -> None:
        self.parent: dict[str, str] = {}

    def find(self, key: str) -> str:
        root = key
        while (above := self.parent.setdefault(root, root)) != root:
            root = above
        while self.parent[key] != root:
            self.parent[key], key = root, self.parent[key]
        return root

    def join(self, a: str, b: str) -> None:
        a, b = sorted((self.find(a), self.find(b)))
        self.parent[b] = a


def start_port(block_id: str) -> str:
    """Key of the upstream end of a roadblock."""
    return f"{block_id}<"


def end_port(block_id: str) -> str:
    """Key of the downstream end of a roadblock."""
    return f"{block_id}>"


def junction_groups(
    roads: Roads, together: Iterable[Sequence[str]] = ()
) -> tuple[dict[str, str], dict[str, tuple[str, ...]]]:
    """Roadblock end -> node id, and node id -> its connectors in map order.

    Connectors belong to one node when they share the end of a roadblock or an
    intersection, when their paths cross, or when they are named `together`. Node ids are "I<intersection>",
    "N<connector>" for joints, "<roadblock>.in" and "<roadblock>.out" at loose ends.
    """
    sets = Sets()
    by_intersection: dict[str, str] = {}
    for connector in roads.connectors.values():
        port = end_port(roads.lanes[connector.from_lane_id].roadblock_id)
        sets.join(port, start_port(roads.lanes[connector.to_lane_id].roadblock_id))
        intersection = roads.roadblocks[connector.roadblock_id].intersection_id
        if intersection is not None:
            sets.join(port, by_intersection.setdefault(intersection, port))
    rows = list(roads.connectors.values())
    pairs = [(rows[i], rows[j]) for i, j in _crossing_pairs(rows)]
    pairs += [(roads.connectors[a], roads.connectors[b]) for group in together for a, b in pairwise(group)]
    for one, other in pairs:
        a, b = (end_port(roads.lanes[each.from_lane_id].roadblock_id) for each in (one, other))
        sets.join(a, b)
    members: dict[str, list[str]] = defaultdict(list)
    inside: dict[str, set[str]] = defaultdict(set)
    for connector in rows:
        root = sets.find(end_port(roads.lanes[connector.from_lane_id].roadblock_id))
        members[root].append(connector.id)
        intersection = roads.roadblocks[connector.roadblock_id].intersection_id
        if intersection is not None:
            inside[root].add(intersection)
    names = {
        root: f"I{min(inside[root], key=_number)}" if inside[root] else f"N{min(found, key=_number)}"
        for root, found in members.items()
    }
    nodes: dict[str, str] = {}
    for block in roads.roadblocks.values():
        if not block.is_connector:
            nodes[start_port(block.id)] = names.get(sets.find(start_port(block.id)), f"{block.id}.in")
            nodes[end_port(block.id)] = names.get(sets.find(end_port(block.id)), f"{block.id}.out")
    return nodes, {names[root]: tuple(found) for root, found in members.items()}


def _number(id_: str) -> tuple[int, str]:
    return (int(id_) if id_.isdigit() else 0, id_)


def _crossing_pairs(connectors: Sequence[Connector]) -> list[tuple[int, int]]:
    """Pairs of connectors whose centre lines properly cross, by row."""
    if not connectors:
        return []
    lines = np.array([c.centerline.linestring for c in connectors])
    first, second = shapely.STRtree(lines).query(lines, predicate="crosses")
    return [(int(i), int(j)) for i, j in zip(first, second, strict=True) if i < j]


# --- what happens in one junction --------------------------------------------------------------


def junction(roads: Roads, connector_ids: Iterable[str], signs: Mapping[str, Sign]) -> Junction:
    """The junction of these connectors; `signs` are those of `lane_signs`."""
    connectors = tuple(roads.connectors[c] for c in connector_ids)
    approaches, of_block = _approaches(roads, connectors, signs)
    approach_of = tuple(of_block[roads.lanes[c.from_lane_id].roadblock_id] for c in connectors)
    movements = tuple(_movement(c, roads.driving_side == "right") for c in connectors)
    opposite = _opposites(approaches)
    conflicts = path_conflicts(roads, connectors)
    busy = sorted({a for i, a in enumerate(approach_of) if conflicts[i].any()})
    lit = any(c.has_traffic_light for c in connectors)
    all_way = not lit and len(busy) > 1 and all(approaches[a].sign is Sign.STOP for a in busy)
    if all_way:
        yields = conflicts.copy()
    else:
        strength = _strengths(approaches, approach_of, movements, opposite)
        ranks = [
            (
                bool(lit) and not c.has_traffic_light,
                *((Sign.NONE, 0) if c.has_traffic_light else (approaches[a].sign, strength[a])),
                m,
                round(_swerve_m(c), 1),
                row,
            )
            for row, (c, a, m) in enumerate(zip(connectors, approach_of, movements, strict=True))
        ]
        yields = conflicts & np.array([[one > other for other in ranks] for one in ranks], dtype=np.bool_)
    return Junction(connectors, approaches, approach_of, opposite, movements, conflicts, yields, all_way)


def lane_signs(roads: Roads) -> dict[str, Sign]:
    """Lanes at whose end a stop or yield line lies, with the sign that it stands for."""
    kinds = {StopLineKind.STOP_SIGN: Sign.STOP, StopLineKind.YIELD: Sign.YIELD}
    lines = [line for line in roads.stop_lines.values() if line.kind in kinds]
    lanes = [lane for lane in roads.lanes.values() if roads.outgoing(lane.id)]
    found: dict[str, Sign] = {}
    if not lines or not lanes:
        return found
    tips = []
    for lane in lanes:
        line = lane.centerline
        tip = line.between(max(0.0, line.length_m - _SIGN_REACH_M), line.length_m).points
        heading = line.segment_heading_rad[-1]
        ahead = tip[-1] + np.array([np.cos(heading), np.sin(heading)])
        tips.append(shapely.LineString(np.concatenate((tip, ahead[None]))))
    tree = shapely.STRtree([line.polygon for line in lines])
    for row, hit in zip(*tree.query(tips, predicate="intersects"), strict=True):
        lane_id = lanes[int(row)].id
        found[lane_id] = max(found.get(lane_id, Sign.NONE), kinds[lines[int(hit)].kind])
    return found


def _approaches(
    roads: Roads, connectors: Sequence[Connector], signs: Mapping[str, Sign]
) -> tuple[tuple[JunctionApproach, ...], dict[str, int]]:
    """Arms of a junction: roadblocks that arrive side by side count as one."""
    arms: list[list[tuple[str, float, np.ndarray]]] = []
    for block_id in dict.fromkeys(roads.lanes[c.from_lane_id].roadblock_id for c in connectors):
        ends = [roads.lanes[lane].centerline for lane in roads.roadblocks[block_id].lane_ids]
        headings = [line.segment_heading_rad[-1] for line in ends]
        heading = float(np.arctan2(np.mean(np.sin(headings)), np.mean(np.cos(headings))))
        place = np.mean([line.points[-1] for line in ends], axis=0)
        for arm in arms:
            _, other_heading, other_place = arm[0]
            turned = abs(wrap_angle(heading - other_heading))
            if turned < _SAME_ARM_RAD and np.hypot(*(place - other_place)) < _SAME_ARM_M:
                arm.append((block_id, heading, place))
                break
        else:
            arms.append([(block_id, heading, place)])
    approaches: list[JunctionApproach] = []
    of_block: dict[str, int] = {}
    used = {c.from_lane_id for c in connectors}
    for arm in arms:
        lanes = [roads.lanes[lane] for block, _, _ in arm for lane in roads.roadblocks[block].lane_ids]
        signed = [signs.get(lane.id, Sign.NONE) for lane in lanes if lane.id in used]
        approaches.append(
            JunctionApproach(
                block_ids=tuple(block for block, _, _ in arm),
                heading_rad=arm[0][1],
                lane_count=len(lanes),
                limit_mps=max((lane.speed_limit_mps or USUAL_LIMIT_MPS) for lane in lanes),
                sign=max(signed, default=Sign.NONE),
            )
        )
        of_block |= {block: len(approaches) - 1 for block, _, _ in arm}
    return tuple(approaches), of_block


def turn_rad(connector: Connector) -> float:
    """How far a connector turns from its start to its end, left positive, in [-pi, pi)."""
    headings = connector.centerline.segment_heading_rad
    return float(wrap_angle(headings[-1] - headings[0]))


def _swerve_m(connector: Connector) -> float:
    """How far a connector ends to the side of where it heads at its start."""
    line = connector.centerline
    heading = line.segment_heading_rad[0]
    moved = line.points[-1] - line.points[0]
    return abs(float(-np.sin(heading) * moved[0] + np.cos(heading) * moved[1]))


def _movement(connector: Connector, keeps_right: bool) -> Movement:
    """From the geometry; the map's own word decides only between straight and a slight turn."""
    angle = turn_rad(connector) * (1.0 if keeps_right else -1.0)
    if abs(angle) > _U_TURN_RAD or connector.turn is Turn.U_TURN:
        return Movement.U_TURN
    if connector.turn is Turn.STRAIGHT:
        straight = 2 * _STRAIGHT_RAD
    elif connector.turn in (Turn.LEFT, Turn.RIGHT):
        straight = _STRAIGHT_RAD / 2
    else:
        straight = _STRAIGHT_RAD
    if abs(angle) <= straight:
        return Movement.STRAIGHT
    return Movement.FAR_TURN if angle > 0.0 else Movement.NEAR_TURN


def _opposites(approaches: Sequence[JunctionApproach]) -> dict[int, int]:
    """Pairs of approaches that face each other, each the other's best match."""
    count = len(approaches)
    off = np.full((count, count), np.inf)
    for i, a in enumerate(approaches):
        for j, b in enumerate(approaches):
            if i != j:
                off[i, j] = abs(wrap_angle(a.heading_rad - b.heading_rad + np.pi))
    found: dict[int, int] = {}
    for i in range(count):
        if count > 1:
            j = int(np.argmin(off[i]))
            if off[i, j] < _OPPOSITE_RAD and int(np.argmin(off[j])) == i:
                found[i] = j
    return found


def _strengths(
    approaches: Sequence[JunctionApproach],
    approach_of: Sequence[int],
    movements: Sequence[Movement],
    opposite: Mapping[int, int],
) -> list[int]:
    """Rank of each approach, 0 for the major road; approaches that face each other share theirs.

    A road that goes on beats one that ends here, then the faster, then the
    wider, then the two-way one beats.
    """
    straight = {a for a, m in zip(approach_of, movements, strict=True) if m is Movement.STRAIGHT}
    keys: list[tuple[int, float, int, int, int]] = []
    for i in range(len(approaches)):
        both = [i, opposite[i]] if i in opposite else [i]
        keys.append(
            (
                -int(any(k in straight for k in both)),
                -round(max(approaches[k].limit_mps for k in both), 1),
                -max(approaches[k].lane_count for k in both),
                -len(both),
                min(both),
            )
        )
    order = sorted(set(keys))
    return [order.index(key) for key in keys]


def path_conflicts(roads: Roads, connectors: Sequence[Connector]) -> NDArray[np.bool_]:
    """(N, N) which pairs of connectors cannot be driven at the same time."""
    count = len(connectors)
    conflicts = np.zeros((count, count), dtype=np.bool_)
    if count < 2:
        return conflicts
    lines = np.array([c.centerline.linestring for c in connectors])
    corridors = shapely.buffer(lines, CAR_CORRIDOR_M / 2, cap_style="flat")
    first, second = shapely.STRtree(corridors).query(corridors, predicate="intersects")
    for i, j in zip(first.tolist(), second.tolist(), strict=True):
        if i >= j or connectors[i].from_lane_id == connectors[j].from_lane_id:
            continue
        if connectors[i].to_lane_id == connectors[j].to_lane_id:
            meet = True
        elif _block(roads, connectors[i]) == _block(roads, connectors[j]):
            meet = bool(shapely.crosses(lines[i], lines[j]))  # neighbours may run close, as on any road
        else:
            meet = bool(shapely.area(shapely.intersection(corridors[i], corridors[j])) > 0.1)
        conflicts[i, j] = conflicts[j, i] = meet
    return conflicts


def _block(roads: Roads, connector: Connector) -> str:
    return roads.lanes[connector.from_lane_id].roadblock_id


def brushing_m(one: Connector, other: Connector) -> tuple[float, float] | None:
    """From where to where a path runs within a car's width of another one that it does not cross; None if it does.

    SUMO finds crossings of centre lines by itself, but not paths that merely brush past each other.
    """
    line, foe = one.centerline, other.centerline.linestring
    if one.to_lane_id == other.to_lane_id or line.linestring.intersects(foe):
        return None
    arc = np.linspace(0.0, line.length_m, max(2, int(np.ceil(line.length_m / 0.25))))
    near = arc[shapely.distance(shapely.points(line.poses_at(arc)[:, :2]), foe) < CAR_CORRIDOR_M]
    return (float(near[0]), float(near[-1])) if near.size else None
