"""CommonRoad scenarios (XML, versions 2018b and 2020a) as maps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
import shapely

from interplan_sumo.errors import MapError
from interplan_sumo.maps.importers.commonroad.lights import signals_of
from interplan_sumo.maps.importers.commonroad.signs import Signs, read_signs, usable_limit_mps
from interplan_sumo.maps.importers.lines import TORN_M, along, ring
from interplan_sumo.maps.importers.source import LeftOut, SourceLane, SourceMap, SourceStopLine
from interplan_sumo.world.commonroad_frame import CommonRoadFile, read_commonroad_file
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import DrivingSide, StopLineKind

# Types that are no lane for cars, the most telling first. Cars named as users overrule those that they may drive on.
_NEVER = {
    "crosswalk": "crosswalk",
    "sidewalk": "sidewalk",
    "parking": "car park",
    "border": "border",
    "restricted_area": "restricted area",
}
_UNLESS_CARS = {
    "bicycleLane": "bicycle lane",
    "busLane": "bus lane",
    "busStop": "bus stop",
    "shoulder": "shoulder",
    "restricted": "restricted lane",
}
_CARS = frozenset(("vehicle", "car"))
_WALKERS, _TRAINS = frozenset(("pedestrian",)), frozenset(("train",))
_SAYS_NOTHING = "priorityVehicle"
"""Priority vehicles may drive anywhere; converters name them where they name nobody else."""
_CLOSED_GROUND = frozenset(("crosswalk", "sidewalk", "border", "footway", "railway"))
_CLEARLY_M2 = 1.0
"""Bounds shorter than a step zigzag in many files; so little area tells nothing of their sides."""
# ISO 3166 codes of countries that drive on the left.
_LEFT = frozenset(
    "AIA ATG AUS BGD BHS BMU BRB BRN BTN BWA CXR CYM CYP DMA FJI FLK GBR GGY GRD GUY HKG IDN IMN IND IRL JAM JEY JPN "
    "KEN KIR KNA LCA LKA LSO MAC MDV MLT MOZ MSR MUS MWI MYS NAM NPL NRU NZL PAK PNG SGP SHN SLB SUR SWZ SYC TCA THA "
    "TLS TON TTO TUV TZA UGA VCT VGB VIR WSM ZAF ZMB ZWE".split()
)


@dataclass(frozen=True, slots=True, eq=False)
class _Lanelet:
    """A lanelet as it stands in the file."""

    element: Element
    id: str
    left: Floats
    right: Floats
    reason: str | None
    """Why it is no lane for cars; None for one that is."""

    def refs(self, tag: str) -> tuple[str, ...]:
        """The ids that children of this tag name, in the order of the file, each once."""
        return tuple(dict.fromkeys(child.get("ref", "") for child in self.element.iterfind(tag)))

    def texts(self, *tags: str) -> frozenset[str]:
        return frozenset((child.text or "").strip() for tag in tags for child in self.element.iterfind(tag))

    @property
    def polygon(self) -> shapely.Polygon | None:
        return ring(np.concatenate((self.left, self.right[::-1])))


def read_commonroad(path: Path) -> SourceMap:
    """The lanelets of a CommonRoad file, in the UTM zone of its georeference, else at a place that stands in.

    A lanelet is a lane for cars unless its type or its users say otherwise.
    Speed limits are metres per second, in both versions and whatever the
    country, as commonroad-io reads them too; a unit in the text is heeded.
    Signs and lights hold at the end of the last of the lanelets that name them
    in a row; a light that a lanelet inside an intersection names holds at its
    start. MapError names the file and the lanelet.
    """
    file = read_commonroad_file(path)
    notes = list(file.notes)
    lanelets = _lanelets(file, notes)
    signs = read_signs(file)
    cars = {id_: lanelet for id_, lanelet in lanelets.items() if lanelet.reason is None}
    if not cars:
        raise MapError(
            f"{file.path}: none of its {len(lanelets)} lanelets is for cars; give a file with a road network"
        )
    lanes = _lanes(file, lanelets, cars, signs, notes)
    signals = signals_of(file, lanes, notes)
    return SourceMap(
        name=file.name,
        format="CommonRoad",
        crs=file.frame.crs,
        driving_side=_driving_side(file, cars.values(), notes),
        lanes=lanes,
        stop_lines=tuple(_stop_lines(file, cars, lanes, signs)),
        crosswalks=_polygons(lanelets, ("crosswalk",)),
        walkways=_polygons(lanelets, ("sidewalk", "footway")),
        carparks=_polygons(lanelets, ("car park",)),
        left_out=tuple(
            LeftOut(one.id, one.reason, None if one.reason in _CLOSED_GROUND else one.polygon)
            for one in lanelets.values()
            if one.reason is not None
        ),
        signals=signals,
        notes=tuple(notes),
    )


# --- lanelets ----------------------------------------------------------------------------------------


def _lanelets(file: CommonRoadFile, notes: list[str]) -> dict[str, _Lanelet]:
    found: dict[str, _Lanelet] = {}
    swapped = 0
    for element in file.parts.get("lanelet", ()):
        id_ = element.get("id", "").strip()
        if not id_ or id_ in found:
            raise file.fault(element, "the id is empty or taken; every lanelet needs its own")
        left, right = along(file.polyline(element, "leftBound")), along(file.polyline(element, "rightBound"))
        if len(left) and len(right) and _area_to_the_right_m2(left, right) < -_CLEARLY_M2:
            left, right = right, left
            swapped += 1
        lanelet = _Lanelet(element, id_, left, right, None)
        short = len(left) < 2 or len(right) < 2
        found[id_] = replace(lanelet, reason="lanelet without length" if short else _reason(lanelet))
    if swapped:
        notes.append(f"The bounds of {_number(swapped, 'lanelet')} stood on the wrong sides and were swapped.")
    return found


def _area_to_the_right_m2(left: Floats, right: Floats) -> float:
    """The area between the bounds, negative where `right` lies on the left."""
    x, y = (np.concatenate((left, right[::-1])) - left[0]).T
    return float(np.dot(np.roll(x, -1), y) - np.dot(x, np.roll(y, -1))) / 2.0


def _reason(lanelet: _Lanelet) -> str | None:
    types = lanelet.texts("laneletType")
    users = lanelet.texts("userOneWay", "userBidirectional") - {_SAYS_NOTHING}
    for kind, reason in _NEVER.items():
        if kind in types:
            return reason
    if users & _CARS:
        return None
    for kind, reason in _UNLESS_CARS.items():
        if kind in types:
            return reason
    if not users:
        return None
    if users <= _WALKERS:
        return "footway"
    if users <= _TRAINS:
        return "railway"
    return f"lane for {' and '.join(sorted(users))} only"


def _polygons(lanelets: Mapping[str, _Lanelet], reasons: Sequence[str]) -> tuple[shapely.Polygon, ...]:
    shapes = (one.polygon for one in lanelets.values() if one.reason in reasons)
    return tuple(shape for shape in shapes if shape is not None)


# --- lanes -------------------------------------------------------------------------------------------


def _lanes(
    file: CommonRoadFile, lanelets: Mapping[str, _Lanelet], cars: Mapping[str, _Lanelet], signs: Signs, notes: list[str]
) -> dict[str, SourceLane]:
    after, before = _links(lanelets, cars, notes)
    left, right = _neighbours(cars)
    inside = _in_intersections(file, cars)
    dark = frozenset(
        light.get("id", "")
        for light in file.parts.get("trafficLight", ())
        if (light.findtext("active") or "").strip() == "false"
    )
    lights = {id_: tuple(one for one in _named(cars[id_], "trafficLightRef") if one not in dark) for id_ in cars}
    sign_ids = {id_: _named(cars[id_], "trafficSignRef") for id_ in cars}
    limits = {id_: _limit(cars[id_], signs, sign_ids[id_]) for id_ in cars}
    unusable = signs.unusable_limits + sum(odd for _, odd in limits.values())
    if unusable:
        notes.append(f"{_number(unusable, 'speed limit')} could not be used: no number, or more than 160 km/h.")
    both_ways = sum(bool(one.texts("userBidirectional") & _CARS) for one in cars.values())
    if both_ways:
        notes.append(f"{_number(both_ways, 'lanelet')} may be driven both ways; the direction of the bounds was kept.")
    return {
        id_: SourceLane(
            id=id_,
            left=lanelet.left,
            right=lanelet.right,
            successors=after[id_],
            predecessors=before[id_],
            left_neighbour=left.get(id_),
            right_neighbour=right.get(id_),
            speed_limit_mps=limits[id_][0],
            in_intersection=id_ in inside,
            lights_at_start=lights[id_] if id_ in inside else (),
            lights_at_end=() if id_ in inside else _last_named(lights, after, inside, id_),
            sign_at_end=signs.kind_of(
                _first_named(sign_ids, before, id_) if id_ in inside else _last_named(sign_ids, after, inside, id_)
            ),
        )
        for id_, lanelet in cars.items()
    }


def _links(
    lanelets: Mapping[str, _Lanelet], cars: Mapping[str, _Lanelet], notes: list[str]
) -> tuple[dict[str, tuple[str, ...]], dict[str, tuple[str, ...]]]:
    """Successors and predecessors of every lane for cars, the same from both ends; those beyond the file are kept.

    Lanelets that follow each other share points: links over a gap are left out.
    """
    after: dict[str, dict[str, None]] = {id_: {} for id_ in cars}
    before: dict[str, dict[str, None]] = {id_: {} for id_ in cars}
    for id_, lanelet in cars.items():
        for tag, mine, theirs in (("successor", after, before), ("predecessor", before, after)):
            for other in lanelet.refs(tag):
                if other in cars or other not in lanelets:
                    mine[id_][other] = None
                if other in cars:
                    theirs[other][id_] = None
    torn = {
        (id_, other): gap_m
        for id_, others in after.items()
        for other in others
        if other in cars and (gap_m := _gap_m(cars[id_], cars[other])) > TORN_M
    }
    for id_, other in torn:
        del after[id_][other], before[other][id_]
    if torn:
        (id_, other), gap_m = next(iter(torn.items()))
        said = (
            f"{_number(len(torn), 'link')} between lanelets that lie apart, such as {id_} and {other} ({gap_m:.0f} m)"
        )
        notes.append(f"{said}: not kept.")
    return {id_: tuple(ids) for id_, ids in after.items()}, {id_: tuple(ids) for id_, ids in before.items()}


def _gap_m(before: _Lanelet, after: _Lanelet) -> float:
    """How far the middle of a lanelet's end lies from that of the other one's beginning."""
    return float(np.hypot(*(after.left[0] + after.right[0] - before.left[-1] - before.right[-1]))) / 2.0


def _neighbours(cars: Mapping[str, _Lanelet]) -> tuple[dict[str, str], dict[str, str]]:
    """Lane -> the lane on its left, and on its right, of the same direction; the same from both sides."""
    left: dict[str, str] = {}
    right: dict[str, str] = {}
    for tag, mine, theirs in (("adjacentLeft", left, right), ("adjacentRight", right, left)):
        for id_, lanelet in cars.items():
            beside = lanelet.element.find(tag)
            other = beside.get("ref", "") if beside is not None and beside.get("drivingDir") == "same" else ""
            if other in cars and other != id_:
                mine[id_] = other
                theirs.setdefault(other, id_)
    return left, right


def _in_intersections(file: CommonRoadFile, cars: Mapping[str, _Lanelet]) -> frozenset[str]:
    """Lanes by which one passes an intersection; not those by which one also comes to the next."""
    through, incoming = set[str](), set[str]()
    for way_in in (one for crossing in file.parts.get("intersection", ()) for one in crossing.iterfind("incoming")):
        incoming |= {child.get("ref", "") for child in way_in.iterfind("incomingLanelet")}
        through |= {child.get("ref", "") for child in way_in if child.tag.startswith("successors")}
    typed = {id_ for id_, lanelet in cars.items() if "intersection" in lanelet.texts("laneletType")}
    return frozenset(((through - incoming) & cars.keys()) | typed)


def _named(lanelet: _Lanelet, tag: str) -> tuple[str, ...]:
    """Signs or lights that a lanelet or its stop line names."""
    return tuple(dict.fromkeys((*lanelet.refs(tag), *lanelet.refs(f"stopLine/{tag}"))))


def _last_named(
    named: Mapping[str, tuple[str, ...]], after: Mapping[str, tuple[str, ...]], inside: frozenset[str], id_: str
) -> tuple[str, ...]:
    """What a lane names and none of the lanes before the intersection that follow it names again."""
    again = {one for other in after[id_] if other in named and other not in inside for one in named[other]}
    return tuple(one for one in named[id_] if one not in again)


def _first_named(
    named: Mapping[str, tuple[str, ...]], before: Mapping[str, tuple[str, ...]], id_: str
) -> tuple[str, ...]:
    """What a lane within an intersection names and none of the lanes that lead to it has named before."""
    already = {one for other in before[id_] if other in named for one in named[other]}
    return tuple(one for one in named[id_] if one not in already)


def _limit(lanelet: _Lanelet, signs: Signs, sign_ids: Iterable[str]) -> tuple[float | None, bool]:
    """The limit of a lane by its own element (2018b) or its signs (2020a), and whether its own cannot be used."""
    own = lanelet.element.find("speedLimit")
    limit = usable_limit_mps(own.text) if own is not None else None
    known = [one for one in (limit, signs.limit_of(sign_ids)) if one is not None]
    return min(known, default=None), own is not None and limit is None


# --- stop lines and sides ----------------------------------------------------------------------------


def _stop_lines(
    file: CommonRoadFile, cars: Mapping[str, _Lanelet], lanes: Mapping[str, SourceLane], signs: Signs
) -> Iterable[SourceStopLine]:
    for id_, lanelet in cars.items():
        element = lanelet.element.find("stopLine")
        if element is None:
            continue
        drawn = along(file.polyline(lanelet.element, "stopLine"))
        points = drawn if len(drawn) >= 2 else np.stack((lanelet.left[-1], lanelet.right[-1]))
        lane = lanes[id_]
        lit = element.find("trafficLightRef") is not None or bool(lane.lights_at_end)
        kind = signs.kind_of(lanelet.refs("stopLine/trafficSignRef")) or lane.sign_at_end or StopLineKind.UNKNOWN
        yield SourceStopLine(id_, points, StopLineKind.TRAFFIC_LIGHT if lit else kind, (id_,))


def _driving_side(file: CommonRoadFile, cars: Iterable[_Lanelet], notes: list[str]) -> DrivingSide:
    """The side by the lanelets of opposite direction, else by the country, else right."""
    facing = {"adjacentLeft": 0, "adjacentRight": 0}
    for lanelet in cars:
        for tag in facing:
            beside = lanelet.element.find(tag)
            facing[tag] += beside is not None and beside.get("drivingDir") == "opposite"
    if facing["adjacentLeft"] != facing["adjacentRight"]:
        return "right" if facing["adjacentLeft"] > facing["adjacentRight"] else "left"
    if file.country in _LEFT:
        return "left"
    notes.append("No lanelets of opposite directions adjoin; traffic was taken to keep right, as most countries do.")
    return "right"


def _number(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"
