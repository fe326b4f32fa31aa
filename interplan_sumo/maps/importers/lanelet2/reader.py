"""Reading a Lanelet2 map: from the elements of the file to lanes, areas, lights and stop lines."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from interplan_sumo.maps.importers.lanelet2.areas import Grounds
from interplan_sumo.maps.importers.lanelet2.controls import LaneControls, controls_of, is_in_intersection
from interplan_sumo.maps.importers.lanelet2.frame import frame_of
from interplan_sumo.maps.importers.lanelet2.lanelets import (
    Kind,
    Lanelet,
    UnusableError,
    check_drivable,
    kind_of,
    lanelet_of,
)
from interplan_sumo.maps.importers.lanelet2.limits import Limit, LimitOrigin, limit_of
from interplan_sumo.maps.importers.lanelet2.osm import OsmFile, read_osm
from interplan_sumo.maps.importers.lanelet2.right_of_way import junctions_of
from interplan_sumo.maps.importers.lanelet2.travel_directions import (
    TWO_WAY_WIDTH_M,
    TravelDirection,
    driving_side,
    followers,
    is_two_way,
    predecessors,
    right_neighbours,
    travel_directions_of,
)
from interplan_sumo.maps.importers.source import LeftOut, SourceLane, SourceMap

FORMAT = "Lanelet2"


def read_lanelet2(path: Path) -> SourceMap:
    """The map in one Lanelet2 file, in UTM metres, or in the file's own metres where nothing places it.

    A lanelet that cars may drive in both directions becomes two lanes, each
    over its half, the second with ":back" after the id; one that is too narrow
    for two keeps its own direction only. MapError with one line if the file
    cannot be read or holds no lane for cars.
    """
    path = Path(path)
    file = read_osm(path)
    frame = frame_of(file)
    grounds = Grounds()
    if not any(file.of_type("lanelet")) and any("highway" in way.tags for way in file.ways.values()):
        file.fault("is an extract of OpenStreetMap, not a Lanelet2 map; give --format osm")
    lanelets = _car_lanelets(file, frame.points, grounds)
    if not lanelets:
        reasons = ", ".join(f"{count} {reason}" for reason, count in _reasons(grounds.left_out))
        file.fault(f"holds no lanelet for cars that can be used{f' ({reasons})' if reasons else ''}; check its tags")
    grounds.add_areas(file, frame.points)
    shown = driving_side(lanelets)
    side = shown or "right"
    directions = travel_directions_of(lanelets, side)
    onward = followers(directions)
    before = predecessors(onward)
    controls = controls_of(file, frame.points, directions, onward, before)
    limits = _limits(file, lanelets)
    junctions, contested = junctions_of(file, directions, onward, before, controls.overruled)
    return SourceMap(
        name=_name(path),
        format=FORMAT,
        crs=frame.crs,
        driving_side=side,
        lanes=_lanes(directions, onward, controls, limits),
        stop_lines=controls.stop_lines,
        junctions=junctions,
        crosswalks=tuple(grounds.crosswalks),
        walkways=tuple(grounds.walkways),
        carparks=tuple(grounds.carparks),
        drivable=tuple(grounds.drivable),
        left_out=tuple(grounds.left_out),
        notes=(
            *frame.notes,
            *(() if shown else ("No two lanes show on which side traffic keeps: the right is assumed.",)),
            *_limit_notes(limits.values()),
            *_lane_notes(lanelets, directions, onward),
            *_control_notes(controls),
            *contested,
            *_unusable("stop lines", controls.unusable),
            *_area_notes(grounds),
            *_unusable("areas", grounds.unusable),
        ),
    )


def _car_lanelets(file: OsmFile, points: dict[str, tuple[float, float]], grounds: Grounds) -> list[Lanelet]:
    """The lanelets for cars; all others go to the grounds or are left out there, with the reason."""
    found: list[Lanelet] = []
    seen: set[str] = set()
    for relation in file.of_type("lanelet"):
        try:
            if relation.id in seen:
                raise UnusableError("has an id that another lanelet has")
            seen.add(relation.id)
            lanelet = lanelet_of(file, points, relation)
            if kind_of(relation.tags) is Kind.LANE:
                check_drivable(lanelet)
        except UnusableError as error:
            grounds.left_out.append(LeftOut(relation.id, f"lanelet that {error}"))
            continue
        if kind_of(lanelet.tags) is Kind.LANE:
            found.append(lanelet)
        else:
            grounds.add_lanelet(lanelet)
    return found


def _lanes(
    directions: Sequence[TravelDirection],
    onward: Mapping[str, tuple[str, ...]],
    controls: LaneControls,
    limits: Mapping[str, Limit],
) -> dict[str, SourceLane]:
    before = predecessors(onward)
    to_right = right_neighbours(directions)
    to_left = {right: left for left, right in to_right.items()}
    return {
        direction.id: SourceLane(
            id=direction.id,
            left=direction.left,
            right=direction.right,
            successors=onward[direction.id],
            predecessors=before[direction.id],
            left_neighbour=to_left.get(direction.id),
            right_neighbour=to_right.get(direction.id),
            speed_limit_mps=limits[direction.lanelet.id].mps,
            in_intersection=is_in_intersection(direction),
            lights_at_start=controls.lights_at_start.get(direction.id, ()),
            lights_at_end=controls.lights_at_end.get(direction.id, ()),
            sign_at_end=controls.sign_at_end.get(direction.id),
        )
        for direction in directions
    }


def _limits(file: OsmFile, lanelets: Iterable[Lanelet]) -> dict[str, Limit]:
    rules = {rule.id: rule for rule in file.of_type("regulatory_element")}
    return {
        lanelet.id: limit_of(file, lanelet.tags, tuple(rules[id_] for id_ in lanelet.rules if id_ in rules))
        for lanelet in lanelets
    }


def _name(path: Path) -> str:
    return re.sub(r"[^a-z0-9]+", "_", path.stem.lower()).strip("_") or "lanelet2"


# --- notes ---------------------------------------------------------------------------------------------


def _limit_notes(limits: Iterable[Limit]) -> list[str]:
    limits = list(limits)
    counts = Counter(limit.origin for limit in limits)
    unreadable = [limit.unreadable for limit in limits if limit.unreadable is not None]
    notes = [
        f"Speed limits: {counts[LimitOrigin.FILE]} lanelets have one in the file, "
        f"{counts[LimitOrigin.LAW]} the one that Lanelet2's rules assume (German law), "
        f"{counts[LimitOrigin.NOWHERE]} none."
    ]
    if unreadable:
        notes.append(f"{len(unreadable)} lanelets have a speed limit that is no speed, such as {unreadable[0][:20]!r}.")
    return notes


def _lane_notes(
    lanelets: Sequence[Lanelet], directions: Sequence[TravelDirection], onward: Mapping[str, Sequence[str]]
) -> list[str]:
    notes: list[str] = []
    split = sum(direction.is_back for direction in directions)
    narrow = sum(map(is_two_way, lanelets)) - split
    if split:
        notes.append(f"{split} lanelets for both directions are split into two lanes along their middle.")
    if narrow:
        notes.append(
            f"{narrow} lanelets for both directions are narrower than {TWO_WAY_WIDTH_M:g} m: "
            "only their own direction is kept."
        )
    if len(directions) > 1 and not any(onward.values()):
        notes.append("No lanelet follows another: where they meet, they name different points.")
    return notes


def _control_notes(controls: LaneControls) -> list[str]:
    if not controls.overruled:
        return []
    return [
        f"{len(controls.overruled)} lanes have a sign that counts only while the light there is out: it is not kept."
    ]


def _area_notes(grounds: Grounds) -> list[str]:
    if not grounds.passed_over:
        return []
    kinds = ", ".join(f"{count} {kind[:30]}" for kind, count in sorted(grounds.passed_over.items()))
    return [f"Areas passed over: {kinds}."]


def _unusable(what: str, which: Sequence[str]) -> list[str]:
    return [f"{len(which)} {what} cannot be used, such as {which[0]}."] if which else []


def _reasons(left_out: Iterable[LeftOut]) -> list[tuple[str, int]]:
    return Counter(item.reason for item in left_out).most_common(3)
