"""What netconvert makes of an OpenDRIVE file, lane by lane of its roads, beside what is read here."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass, field
from pathlib import Path
from subprocess import TimeoutExpired
from tempfile import TemporaryDirectory
from xml.etree.ElementTree import Element

import numpy as np
from defusedxml.ElementTree import ParseError
from defusedxml.ElementTree import parse as parse_xml

from interplan_sumo.maps.importers.lines import mean_length_m
from interplan_sumo.maps.importers.opendrive.reader import read_network
from interplan_sumo.maps.importers.opendrive.travel import Network, TravelLane
from interplan_sumo.maps.importers.opinion import OpinionPair, SecondOpinion
from interplan_sumo.maps.problem import MapProblem
from interplan_sumo.maps.to_sumo import netconvert
from interplan_sumo.world.geometry import Floats

_OPTIONS = (
    "--output.original-names",
    "--offset.disable-normalization",
    "--no-turnarounds",
    "--no-internal-links",
    "--opendrive.curve-resolution=0.5",
    "--precision=4",
    "--xml-validation=never",
)
_SHARE = 0.01
"""Two readings that differ by no more than this agree."""
_TOTAL_SHARE = 0.015
"""All lanes together: netconvert's edges lie between the reference line and the middle of the lanes, or beside both."""
_LEAST_M = 1.0
_LONGEST_S = 600.0
_CAR = "passenger"
_UNKNOWN_THERE = frozenset(("connectingRamp", "slipLane", "shared"))
"""Kinds of lanes that netconvert 1.28 does not know."""

LaneLink = tuple[str, str]
"""Two lanes, each "road_lane", of which the second follows, directly or through a junction."""


@dataclass(eq=False)
class RoadLanes:
    """Lanes of roads that lie outside junctions, over all their sections."""

    length_m: dict[str, float] = field(default_factory=dict[str, float])
    """By "road_lane", along the reference line."""
    middle_m: dict[str, float] = field(default_factory=dict[str, float])
    """By "road_lane", along the middle of the lane."""
    links: set[LaneLink] = field(default_factory=set[LaneLink])
    """From road to road."""
    kinds: dict[str, str] = field(default_factory=dict[str, str])
    narrow: set[str] = field(default_factory=set[str])
    """Lanes of which a part was left out as too narrow."""


def opinion_of_netconvert(path: Path) -> SecondOpinion:
    """netconvert's reading of a file against ours; MapError if we cannot read it."""
    ours = _ours(read_network(path))
    try:
        theirs = _theirs(path)
    except (OSError, ValueError, TimeoutExpired, ParseError) as error:
        told = [f"netconvert cannot read the file: {' '.join(str(error).split())[:160]}"]
        return _opinion(ours, RoadLanes(), told, [])
    return _opinion(ours, theirs, *_compared(ours, theirs, path.name))


def _opinion(ours: RoadLanes, theirs: RoadLanes, told: list[str], problems: list[MapProblem]) -> SecondOpinion:
    both = ours, theirs
    return SecondOpinion(
        "netconvert",
        lanes=OpinionPair(*(len(one.length_m) for one in both)),
        lane_km=OpinionPair(*(sum(one.length_m.values()) / 1000.0 for one in both)),
        links=OpinionPair(*(len(one.links) for one in both)),
        explanations=tuple(told),
        problems=tuple(problems),
    )


# --- ours --------------------------------------------------------------------------------------------------


def _ours(network: Network) -> RoadLanes:
    found = RoadLanes()
    for lane in network.lanes.values():
        road = lane.stretch.road
        if not road.junction:
            name = _name(lane)
            if lane.along == lane.stretch.along:  # one of two that share a lane of the file
                found.length_m[name] = found.length_m.get(name, 0.0) + lane.stretch.length_m
                found.middle_m[name] = found.middle_m.get(name, 0.0) + mean_length_m(lane.left, lane.right)
            found.kinds[name] = lane.stretch.lane.kind
            found.links |= {(name, _name(end)) for end in _roads_after(network, lane) if end.stretch.road is not road}
    found.narrow.update(_name(lane) for lane in network.narrow)
    return found


def _name(lane: TravelLane) -> str:
    return f"{lane.stretch.road.id}_{lane.stretch.lane.id}"


def _roads_after(network: Network, lane: TravelLane) -> Iterator[TravelLane]:
    """The lanes of roads that one comes to from a lane, directly or through a junction."""
    seen: set[str] = set()
    stack = list(lane.successors)
    while stack:
        id_ = stack.pop()
        if id_ not in seen:
            seen.add(id_)
            onward = network.lanes[id_]
            if onward.stretch.road.junction:
                stack += onward.successors
            else:
                yield onward


# --- theirs ------------------------------------------------------------------------------------------------


def _theirs(path: Path) -> RoadLanes:
    """ValueError with netconvert's message if it refuses the file."""
    with TemporaryDirectory(prefix="interplan-opinion-") as folder:
        options = [f"--opendrive-files={path.resolve()}", *_OPTIONS]
        options += ["--plain-output-prefix=plain", "--output-file=net.xml"]
        done = netconvert(options, folder, longest_s=_LONGEST_S)
        if done.returncode != 0:
            errors = [line for line in done.stderr.splitlines() if line.startswith("Error")]
            raise ValueError(" ".join(errors) or done.stderr[-160:] or f"exit {done.returncode}")
        nodes, edges, connections = (
            parse_xml(Path(folder, f"plain.{part}.xml")).getroot() for part in ("nod", "edg", "con")
        )
    assert nodes is not None
    assert edges is not None
    assert connections is not None
    places = {n.get("id", ""): (float(n.get("x", "nan")), float(n.get("y", "nan"))) for n in nodes.iter("node")}
    return _plain(places, edges, connections)


def _plain(places: Mapping[str, tuple[float, float]], edges: Element, connections: Element) -> RoadLanes:
    found = RoadLanes()
    names: dict[tuple[str, str], str] = {}
    for edge in edges.iter("edge"):
        shape = _shape(edge, places)
        length_m = float(np.hypot(*np.diff(shape, axis=0).T).sum())
        for lane in edge.iter("lane"):
            name = _original(lane)
            if name and _for_cars(edge, lane):
                names[edge.get("id", ""), lane.get("index", "")] = name
                found.length_m[name] = found.length_m.get(name, 0.0) + length_m
    for way in connections.iter("connection"):
        start = names.get((way.get("from", ""), way.get("fromLane", "")))
        end = names.get((way.get("to", ""), way.get("toLane", "")))
        if start is not None and end is not None and _road(start) != _road(end):
            found.links.add((start, end))
    return found


def _shape(edge: Element, places: Mapping[str, tuple[float, float]]) -> Floats:
    """(N, 2) the line of an edge; a straight one names its nodes only."""
    points = [tuple(map(float, point.split(",")[:2])) for point in edge.get("shape", "").split()]
    return np.array(points if len(points) > 1 else [places[edge.get(key, "")] for key in ("from", "to")])


def _original(lane: Element) -> str:
    return next((p.get("value", "") for p in lane.iter("param") if p.get("key") == "origId"), "")


def _road(name: str) -> str:
    return name.rpartition("_")[0]


def _for_cars(edge: Element, lane: Element) -> bool:
    allowed = lane.get("allow") or (edge.get("allow") if lane.get("disallow") is None else None)
    if allowed is not None:
        return bool({_CAR, "all"} & set(allowed.split()))
    denied = lane.get("disallow") or edge.get("disallow") or ""
    return not {_CAR, "all"} & set(denied.split())


# --- compared ----------------------------------------------------------------------------------------------


def _compared(ours: RoadLanes, theirs: RoadLanes, file: str) -> tuple[list[str], list[MapProblem]]:
    told: list[str] = []
    problems: list[MapProblem] = []
    fewer, more = ours.length_m.keys() - theirs.length_m.keys(), theirs.length_m.keys() - ours.length_m.keys()
    if more:
        told.append(f"{len(more)} lanes are for cars there and left out here, such as {min(more)}.")
    if fewer:
        kinds = Counter(ours.kinds[name] for name in fewer)
        told.append(f"{len(fewer)} lanes are left out there ({', '.join(sorted(kinds))}), such as {min(fewer)}.")
        if sum(count for kind, count in kinds.items() if kind not in _UNKNOWN_THERE) > _SHARE * len(ours.length_m):
            problems.append(_problem(file, f"netconvert has no lane {min(fewer)}, nor {len(fewer) - 1} others"))
    told += _lengths(ours, theirs)
    common = ours.length_m.keys() & theirs.length_m.keys()
    here_m, middle_m, there_m = (
        sum(lengths[name] for name in common - ours.narrow)
        for lengths in (ours.length_m, ours.middle_m, theirs.length_m)
    )
    if min(abs(here_m - there_m), abs(middle_m - there_m)) > max(_LEAST_M, _TOTAL_SHARE * there_m):
        said = f"the lanes that both have are {here_m:.0f} m long here, {there_m:.0f} m in netconvert"
        problems.append(_problem(file, said))
    dropped = ours.links - theirs.links
    if dropped:
        told.append(f"{len(dropped)} links of the file are not kept there, such as {_arrow(dropped)}.")
    added = theirs.links - ours.links
    among = {link for link in added if common.issuperset(link)}
    if added - among:
        told.append(f"{len(added - among)} links there lead to lanes that are left out here.")
    leaving = {start for start, _ in ours.links}
    strange = {link for link in among if link[0] in leaving}
    if among - strange:
        told.append(f"{len(among - strange)} links there are guesses, for lanes from which the file has none.")
    if strange:
        told.append(f"{len(strange)} links there are not in the file, such as {_arrow(strange)}.")
    if len(strange) > _SHARE * max(len(theirs.links), 1):
        problems.append(_problem(file, f"netconvert has {len(strange)} links more, such as {_arrow(strange)}"))
    return told, problems


def _lengths(ours: RoadLanes, theirs: RoadLanes) -> Iterator[str]:
    """Lanes that both have, and of different length."""
    off = {
        name: (length_m, theirs.length_m[name])
        for name, length_m in ours.length_m.items()
        if name in theirs.length_m
        and abs(length_m - theirs.length_m[name]) > max(_LEAST_M, _SHARE * theirs.length_m[name])
    }
    if off:
        name, (here_m, there_m) = max(off.items(), key=lambda item: abs(item[1][0] - item[1][1]))
        yield (
            f"{len(off)} lanes differ in length, such as {name} ({here_m:.1f} m here, {there_m:.1f} m there): "
            "netconvert measures along the middle of an edge, and differs in where a lane is wide enough to be one."
        )


def _arrow(links: Set[LaneLink]) -> str:
    return " to ".join(min(links))


def _problem(file: str, said: str) -> MapProblem:
    return MapProblem("second_opinion", "file", file, said)
