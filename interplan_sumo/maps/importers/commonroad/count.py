"""A second reading of CommonRoad files: which lanelets are for cars, how long they are, what follows what."""

from __future__ import annotations

import itertools
from pathlib import Path
from xml.etree.ElementTree import Element

from interplan_sumo.maps.importers.lines import along, mean_length_m
from interplan_sumo.maps.importers.source import SourceCount
from interplan_sumo.world.commonroad_frame import read_commonroad_file

_CLOSED = {"crosswalk", "sidewalk", "parking", "border", "restricted_area"}
_OPEN_TO_NAMED_CARS = {"bicycleLane", "busLane", "busStop", "shoulder", "restricted"}


def count_commonroad(path: Path) -> SourceCount:
    """What a CommonRoad file holds; MapError if it cannot be read."""
    file = read_commonroad_file(path)
    lanelets = {element.get("id", ""): element for element in file.parts.get("lanelet", ())}
    bounds = {
        id_: [along(file.polyline(element, side)) for side in ("leftBound", "rightBound")]
        for id_, element in lanelets.items()
    }
    drawn = {id_ for id_, lines in bounds.items() if min(map(len, lines)) > 1}
    cars = {id_ for id_ in drawn if _for_cars(lanelets[id_])}
    ways = {(id_, other) for id_ in cars for other in _named(lanelets[id_], "successor")}
    ways |= {(other, id_) for id_ in cars for other in _named(lanelets[id_], "predecessor")}
    return SourceCount(
        lane_length_m={id_: mean_length_m(*bounds[id_]) for id_ in lanelets if id_ in cars},
        links=frozenset(way for way in ways if cars.issuperset(way)),
        leaving=sum(not lanelets.keys() >= set(way) for way in ways),
        crosswalks=sum("crosswalk" in _texts(lanelets[id_], "laneletType") for id_ in drawn),
        left_out=len(lanelets) - len(cars),
    )


def _named(lanelet: Element, tag: str) -> set[str]:
    return {child.get("ref", "") for child in lanelet.iterfind(tag)}


def _texts(lanelet: Element, *tags: str) -> set[str]:
    return {(child.text or "").strip() for child in itertools.chain(*map(lanelet.iterfind, tags))}


def _for_cars(lanelet: Element) -> bool:
    types, users = _texts(lanelet, "laneletType"), _texts(lanelet, "userOneWay", "userBidirectional")
    if types & _CLOSED:
        return False
    return bool(users & {"car", "vehicle"}) or not (users - {"priorityVehicle"} or types & _OPEN_TO_NAMED_CARS)
