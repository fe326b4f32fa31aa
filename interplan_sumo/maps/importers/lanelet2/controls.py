"""Lights, signs and stop lines: at which end of which lane each regulatory element holds."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely

from interplan_sumo.maps.importers.lanelet2.lanelets import UnusableError, points_of
from interplan_sumo.maps.importers.lanelet2.osm import OsmFile, Relation
from interplan_sumo.maps.importers.lanelet2.travel_directions import TravelDirection
from interplan_sumo.maps.importers.source import SourceStopLine
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import StopLineKind

_STOP_SIGNS = frozenset({"stop", "stop_sign", "de206", "usr1-1", "r1-1"})
_YIELD_SIGNS = frozenset({"yield", "yield_sign", "give_way", "de205", "usr1-2", "r1-2"})
_RANK = (
    StopLineKind.TRAFFIC_LIGHT,
    StopLineKind.STOP_SIGN,
    StopLineKind.YIELD,
    StopLineKind.PEDESTRIAN_CROSSING,
    StopLineKind.UNKNOWN,
)
_STOPPING = {
    "traffic_light": StopLineKind.TRAFFIC_LIGHT,
    "all_way_stop": StopLineKind.STOP_SIGN,
    "right_of_way": StopLineKind.YIELD,
    "crosswalk": StopLineKind.PEDESTRIAN_CROSSING,  # this and the next are Autoware's
    "road_marking": StopLineKind.UNKNOWN,
}


@dataclass(frozen=True, eq=False)
class LaneControls:
    """What holds at the ends of lanes, by lane id."""

    lights_at_start: dict[str, tuple[str, ...]]
    lights_at_end: dict[str, tuple[str, ...]]
    sign_at_end: dict[str, StopLineKind]
    stop_lines: tuple[SourceStopLine, ...]
    unusable: tuple[str, ...]
    """Stop lines that cannot be drawn, each with the reason."""
    overruled: frozenset[str]
    """Lanes whose sign counts only while the light there is out."""


@dataclass(frozen=True, slots=True, eq=False)
class _Rule:
    """A regulatory element that lets traffic wait."""

    kind: StopLineKind
    lights: tuple[str, ...]
    lines: tuple[str, ...]
    """Ways at which it holds, of those that the file draws."""
    lanelets: tuple[str, ...]
    """Those that have to wait, by id."""


@dataclass(eq=False)
class _Found:
    """What is gathered rule by rule."""

    lights_at_start: defaultdict[str, dict[str, None]] = field(default_factory=lambda: defaultdict(dict))
    lights_at_end: defaultdict[str, dict[str, None]] = field(default_factory=lambda: defaultdict(dict))
    sign_at_end: dict[str, StopLineKind] = field(default_factory=dict[str, StopLineKind])
    kinds: defaultdict[str, set[StopLineKind]] = field(default_factory=lambda: defaultdict(set))
    """By stop line."""
    waiting: defaultdict[str, dict[str, None]] = field(default_factory=lambda: defaultdict(dict))
    """Lanes by stop line."""


def is_in_intersection(direction: TravelDirection) -> bool:
    """Autoware's editors say so with the turn that a lanelet makes, or the intersection that it lies in."""
    tags = direction.lanelet.tags
    return bool(tags.get("turn_direction")) or tags.get("intersection_area", "no").lower() not in ("", "no")


def controls_of(
    file: OsmFile,
    points: dict[str, tuple[float, float]],
    directions: Sequence[TravelDirection],
    followers: Mapping[str, Sequence[str]],
    predecessors: Mapping[str, Sequence[str]],
) -> LaneControls:
    """What the regulatory elements of a file, and the stop lines that none of them names, say about its lanes."""
    lines, unusable = _stop_lines(file, points)
    by_lanelet: defaultdict[str, list[TravelDirection]] = defaultdict(list)
    for direction in directions:
        by_lanelet[direction.lanelet.id].append(direction)
    found = _Found()
    for rule in _rules(file, directions, lines):
        for line in rule.lines:
            found.kinds[line].add(rule.kind)
        for lanelet in rule.lanelets:
            if lanelet in by_lanelet:
                _apply(rule, by_lanelet[lanelet], lines, predecessors, found)
    overruled = {
        lane
        for lane in found.sign_at_end
        if lane in found.lights_at_end
        or (followers[lane] and all(next_ in found.lights_at_start for next_ in followers[lane]))
    }
    return LaneControls(
        {lane: tuple(lights) for lane, lights in found.lights_at_start.items()},
        {lane: tuple(lights) for lane, lights in found.lights_at_end.items()},
        {lane: sign for lane, sign in found.sign_at_end.items() if lane not in overruled},
        tuple(
            SourceStopLine(
                way,
                line,
                min(found.kinds[way], key=_RANK.index, default=StopLineKind.UNKNOWN),
                tuple(found.waiting[way]),
            )
            for way, line in lines.items()
        ),
        unusable,
        frozenset(overruled),
    )


# --- the rules of the file -----------------------------------------------------------------------------


def _rules(file: OsmFile, directions: Sequence[TravelDirection], lines: Mapping[str, Floats]) -> Iterator[_Rule]:
    naming: defaultdict[str, dict[str, None]] = defaultdict(dict)
    for direction in directions:
        for rule in direction.lanelet.rules:
            naming[rule][direction.lanelet.id] = None
    for relation in file.of_type("regulatory_element"):
        kind = _kind(file, relation)
        if kind is None:
            continue
        waiting = relation.tags["subtype"] in ("right_of_way", "all_way_stop")
        drawn = tuple(way for way in _line_ids(file, relation) if way in lines)
        if kind is StopLineKind.YIELD and any(_is_sign(file, way, _STOP_SIGNS) for way in drawn):
            kind = StopLineKind.STOP_SIGN
        yield _Rule(
            kind,
            relation.refs("refers") or (relation.id,),
            drawn,
            relation.refs("yield", "relation") if waiting else tuple(naming[relation.id]),
        )


def _kind(file: OsmFile, rule: Relation) -> StopLineKind | None:
    """Why one stops for a rule; None for rules that let nobody wait."""
    subtype = rule.tags.get("subtype", "")
    if subtype not in ("right_of_way", "traffic_sign"):
        return _STOPPING.get(subtype)
    signs = rule.refs("refers")
    if rule.tags.get("sign_type", "").lower() in _STOP_SIGNS or any(_is_sign(file, s, _STOP_SIGNS) for s in signs):
        return StopLineKind.STOP_SIGN
    if rule.tags.get("sign_type", "").lower() in _YIELD_SIGNS or any(_is_sign(file, s, _YIELD_SIGNS) for s in signs):
        return StopLineKind.YIELD
    return _STOPPING.get(subtype)


def _is_sign(file: OsmFile, way: str, signs: frozenset[str]) -> bool:
    tags = file.ways[way].tags if way in file.ways else {}
    return not signs.isdisjoint((tags.get("subtype", "").lower(), tags.get("sign_type", "").lower()))


def _line_ids(file: OsmFile, rule: Relation) -> tuple[str, ...]:
    """The lines at which a rule holds; Autoware's road markings refer to theirs."""
    if rule.tags.get("subtype") != "road_marking":
        return rule.refs("ref_line")
    return tuple(ref for ref in rule.refs("refers") if ref in file.ways and _is_stop_line(file.ways[ref].tags))


def _is_stop_line(tags: Mapping[str, str]) -> bool:
    return tags.get("type") in ("stop_line", "stopline")


def _stop_lines(file: OsmFile, points: dict[str, tuple[float, float]]) -> tuple[dict[str, Floats], tuple[str, ...]]:
    """The vertices of every stop line by way id, and those that cannot be drawn."""
    named = [way for rule in file.of_type("regulatory_element") if _kind(file, rule) for way in _line_ids(file, rule)]
    drawn = [way.id for way in file.ways.values() if _is_stop_line(way.tags)]
    lines: dict[str, Floats] = {}
    unusable: list[str] = []
    for way in dict.fromkeys((*named, *drawn)):
        try:
            line = points_of(file, points, way)
            if len(line) < 2 or np.ptp(line, axis=0).max() < 1e-3:
                raise UnusableError("has no length")
            lines[way] = line
        except UnusableError as error:
            unusable.append(f"{way}, which {error}")
    return lines, tuple(unusable)


# --- their place on the lanes --------------------------------------------------------------------------


def _apply(
    rule: _Rule,
    directions: Sequence[TravelDirection],
    lines: Mapping[str, Floats],
    predecessors: Mapping[str, Sequence[str]],
    found: _Found,
) -> None:
    direction, at_start, line = _place(rule, directions, lines)
    before = predecessors[direction.id] if at_start else (direction.id,)
    if line is not None:
        waiting = before if before and not is_in_intersection(direction) else (direction.id,)
        found.waiting[line].update(dict.fromkeys(waiting))
    if rule.kind is StopLineKind.TRAFFIC_LIGHT:
        lights = found.lights_at_start if at_start else found.lights_at_end
        lights[direction.id].update(dict.fromkeys(rule.lights))
    elif rule.kind in (StopLineKind.STOP_SIGN, StopLineKind.YIELD):
        for lane in before:
            if found.sign_at_end.get(lane) is not StopLineKind.STOP_SIGN:
                found.sign_at_end[lane] = rule.kind


def _place(
    rule: _Rule, directions: Sequence[TravelDirection], lines: Mapping[str, Floats]
) -> tuple[TravelDirection, bool, str | None]:
    """The lane of a lanelet on which a rule holds, whether it does so at its start, and the nearest of its lines.

    A rule holds at that end of the lanelet to which its line is nearer;
    without a line at the end, as in Lanelet2, but at the start of a lanelet
    inside an intersection. The start of a lanelet that is split for two
    directions is the end of its way back.
    """
    direction, *back = directions
    left, right = direction.lanelet.left.points, direction.lanelet.right.points
    start, end = (shapely.Point((left[vertex] + right[vertex]) / 2.0) for vertex in (0, -1))
    shapes = {way: shapely.LineString(lines[way]) for way in rule.lines}
    gaps = {way: (start.distance(shape), end.distance(shape)) for way, shape in shapes.items()}
    line = min(gaps, key=lambda way: min(gaps[way]), default=None)
    at_start = is_in_intersection(direction) if line is None else gaps[line][0] < gaps[line][1]
    return (back[0], False, line) if at_start and back else (direction, at_start, line)
