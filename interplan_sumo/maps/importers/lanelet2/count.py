"""A second reading of Lanelet2 files: which lanelets are for cars, how long they are, which begin where one ends."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely

from interplan_sumo.maps.importers.lanelet2.frame import frame_of
from interplan_sumo.maps.importers.lanelet2.lanelets import UnusableError, lanelet_of
from interplan_sumo.maps.importers.lanelet2.osm import OsmFile, Relation, read_osm
from interplan_sumo.maps.importers.lines import mean_length_m
from interplan_sumo.maps.importers.source import SourceCount
from interplan_sumo.world.geometry import Floats

_FOR_CARS = ("road", "highway", "play_street", "exit", "")
_YES, _NO = ("yes", "true", "1"), ("no", "false", "0")
_TWO_LANES_M, _FLAT_M2 = 4.5, 0.01


class _Lanelet(NamedTuple):
    """A lanelet with the nodes and points of its boundaries, which run with the traffic."""

    nodes: tuple[Sequence[str], Sequence[str]]
    points: tuple[Floats, Floats]
    is_split: bool


def count_lanelet2(path: Path) -> SourceCount:
    """What a Lanelet2 file holds; MapError if it cannot be read."""
    file = read_osm(Path(path))
    places = frame_of(file).points
    lanes: dict[str, _Lanelet] = {}
    count = crosswalks = 0
    for relation in file.of_type("lanelet"):
        count += 1
        lanelet = None if relation.id in lanes else _lanelet(file, places, relation)
        if lanelet is not None and _is_for_cars(relation.tags):
            lanes[relation.id] = lanelet
        crosswalks += lanelet is not None and relation.tags.get("subtype") == "crosswalk"
    own = (0.25, 0.75) if _keeps_right(lanes.values()) else (0.75, 0.25)
    lengths: dict[str, float] = {}
    starts: defaultdict[tuple[str, str], list[str]] = defaultdict(list)
    ends: dict[str, tuple[str, str]] = {}
    for id_, lanelet in lanes.items():
        left, right = lanelet.nodes
        starts[left[0], right[0]].append(id_)
        ends[id_] = left[-1], right[-1]
        sides_m = np.array([mean_length_m(side, side) for side in lanelet.points])
        lengths[id_] = float(sides_m @ (own if lanelet.is_split else (0.5, 0.5)))
        if lanelet.is_split:
            back = f"{id_}:back"
            starts[right[-1], left[-1]].append(back)
            ends[back], lengths[back] = (right[0], left[0]), float(sides_m @ own[::-1])
    links = {(lane, onward) for lane, end in ends.items() for onward in starts[end]}
    turning = {(id_, f"{id_}:back") for id_ in lanes} | {(f"{id_}:back", id_) for id_ in lanes}
    return SourceCount(lengths, frozenset(links - turning), crosswalks=crosswalks, left_out=count - len(lanes))


def _keeps_right(lanes: Collection[_Lanelet]) -> bool:
    """Oncoming lanes have their left boundaries in common where traffic keeps right, else their right ones."""
    bounds = [{tuple(lane.nodes[side]) for lane in lanes if not lane.is_split} for side in (0, 1)]
    shared = [sum(nodes[::-1] in side for nodes in side) for side in bounds]
    return shared[0] >= shared[1]


def _is_for_cars(tags: Mapping[str, str]) -> bool:
    subtype = tags.get("subtype", "")
    if subtype == "crosswalk" or tags.get("no_drivable_lane", "").lower() in _YES:
        return False
    users = {key[12:]: value.lower() in _YES for key, value in tags.items() if key.startswith("participant:")}
    cars = [may for user, may in users.items() if user in ("vehicle", "vehicle:car") or user[:12] == "vehicle:car:"]
    return any(cars) or (not cars and not any(users.values()) and subtype in _FOR_CARS)


def _lanelet(file: OsmFile, places: dict[str, tuple[float, float]], relation: Relation) -> _Lanelet | None:
    """A lanelet; None if it cannot be drawn, or is for cars and its sides cross."""
    try:
        drawn = lanelet_of(file, places, relation)
    except UnusableError:
        return None
    left, right = drawn.left.points, drawn.right.points
    ring = shapely.make_valid(shapely.Polygon(np.concatenate((right, left[::-1]))))
    crossing = shapely.LineString(left).crosses(shapely.LineString(right))
    if _is_for_cars(relation.tags) and (crossing or ring.area < _FLAT_M2):
        return None
    width_m = ring.area / mean_length_m(left, right)
    tags = relation.tags
    one_way = tags.get("one_way:vehicle:car", tags.get("one_way:vehicle", tags.get("one_way", "yes")))
    is_split = one_way.lower() in _NO and width_m >= _TWO_LANES_M
    return _Lanelet((drawn.left.nodes, drawn.right.nodes), (left, right), is_split)
