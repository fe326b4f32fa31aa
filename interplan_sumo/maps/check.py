"""How faithful a SUMO network is to its map: `check_map` measures, nothing is taken from the conversion's word.

The network is compared with the map lane by lane through
the id map on disk; signal programs must serve everybody and send nobody into
another's path.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from interplan_sumo.maps.controls import MapControls, read_controls
from interplan_sumo.maps.junctions import path_conflicts
from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.network_links import CheckedLink, NetworkSummary, read_network_summary
from interplan_sumo.maps.problem import MapProblem, ProblemKind
from interplan_sumo.maps.rules import lane_layer, schema_problems
from interplan_sumo.maps.schema import CONNECTORS
from interplan_sumo.maps.store import MapFiles
from interplan_sumo.world.geometry import Floats, hausdorff_m
from interplan_sumo.world.roads import Connector, LaneLike, Roads

DEVIATION_BAR_M = 0.05
"""No lane or connector may lie further than this from its source."""
LIMIT_TOLERANCE_MPS = 0.001
_SHORT_M = 1.0  # the nominal length of shorter pieces is dominated by SUMO's smallest one


@dataclass(frozen=True, slots=True)
class Spread:
    """The largest value and the 99th percentile."""

    max: float
    p99: float

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread:
        """0 where there are no values."""
        return cls(float(np.max(values)), float(np.percentile(values, 99))) if values else cls(0.0, 0.0)


@dataclass(frozen=True, slots=True)
class MapReport:
    """What `check_map` found. `problems` has one for every bar missed; without any, the map is ok."""

    name: str
    driving_side: str
    lanes: int
    connectors: int
    lane_km: float
    lane_deviation_m: Spread
    """Hausdorff distance of centre lines."""
    connector_deviation_m: Spread
    lane_length_distortion: Spread
    """How far SUMO's nominal lane lengths are from the true ones, as a share."""
    missing: tuple[str, ...]
    """Lanes and connectors of the map that the network lacks."""
    extra: tuple[str, ...]
    """Connections of the network that the map lacks."""
    wrong_limits: tuple[str, ...]
    lights: int
    light_connectors: int
    light_connectors_covered: int
    problems: tuple[MapProblem, ...]

    @property
    def ok(self) -> bool:
        return not self.problems

    def as_json(self) -> dict[str, Any]:
        """The report as plain data."""
        return {"ok": self.ok, **asdict(self)}


def check_map(files: MapFiles, roads: Roads) -> MapReport:
    """Measure the network of a map against its roads; MapError if a file is missing or damaged."""
    ids = NetworkIds.read(files.ids)
    network = read_network_summary(files.network)
    missing: list[str] = []
    problems: list[MapProblem] = []
    wrong_limits: list[str] = []
    deviation: dict[bool, list[float]] = {True: [], False: []}
    distortion: list[float] = []
    if ids.driving_side != roads.driving_side:
        said = f"its ids are for traffic on the {ids.driving_side}, the map drives on the {roads.driving_side}"
        problems.append(MapProblem("driving_side", "network", files.network.name, said))
    if network.left_hand != (roads.driving_side == "left"):
        said = f"it is {'left' if network.left_hand else 'right'}-hand, the map is not"
        problems.append(MapProblem("driving_side", "network", files.network.name, said))
    for lane in (*roads.lanes.values(), *roads.connectors.values()):
        pieces = ids.pieces.get(lane.id, ())
        if not pieces or any(piece.sumo_lane not in network.lanes for piece in pieces):
            missing.append(lane.id)
            continue
        shapes = [network.lanes[piece.sumo_lane].shape for piece in pieces]
        off_m = _deviation_m(lane, shapes, ids.origin_m)
        deviation[lane.id in roads.lanes].append(off_m)
        if off_m > DEVIATION_BAR_M:
            problems.append(_of(lane, "deviation", f"lies {off_m:.3f} m off its source"))
        limit = lane.speed_limit_mps
        for piece in pieces:
            sumo_lane = network.lanes[piece.sumo_lane]
            assert sumo_lane.speed_mps is not None  # so is every lane of a summary
            assert sumo_lane.length_m is not None
            if limit and abs(sumo_lane.speed_mps - limit) > LIMIT_TOLERANCE_MPS:
                wrong_limits.append(lane.id)
            if piece.length_m >= _SHORT_M:
                distortion.append(abs(sumo_lane.length_m / piece.length_m - 1.0))
    wrong_limits = list(dict.fromkeys(wrong_limits))
    extra = _extra(roads, ids, network)
    problems += [_of(roads[lane_id], "missing", "is missing in the network") for lane_id in missing]
    problems += [MapProblem("extra", "network", way, "is joined there, but not in the map") for way in extra]
    problems += [_of(roads[lane_id], "limit", "has another speed limit in the network") for lane_id in wrong_limits]
    problems += _broken_links(roads, ids, network)
    problems += light_problems(roads, ids, network, read_controls(files.folder))
    problems += schema_problems(roads)
    under_light = [c.id for c in roads.connectors.values() if c.has_traffic_light]
    return MapReport(
        name=files.name,
        driving_side=roads.driving_side,
        lanes=len(roads.lanes),
        connectors=len(roads.connectors),
        lane_km=sum(lane.centerline.length_m for lane in roads.lanes.values()) / 1000.0,
        lane_deviation_m=Spread.of(deviation[True]),
        connector_deviation_m=Spread.of(deviation[False]),
        lane_length_distortion=Spread.of(distortion),
        missing=tuple(missing),
        extra=tuple(extra),
        wrong_limits=tuple(wrong_limits),
        lights=len(network.lights),
        light_connectors=len(under_light),
        light_connectors_covered=sum(1 for connector in under_light if connector in ids.links),
        problems=tuple(problems),
    )


def _of(lane: LaneLike, kind: ProblemKind, message: str) -> MapProblem:
    return MapProblem(kind, lane_layer(lane), lane.id, message)


def _deviation_m(lane: LaneLike, shapes: Sequence[Floats], origin_m: tuple[float, float]) -> float:
    """Hausdorff distance of the joined SUMO shapes from the centre line, ends in the direction of travel included."""
    points = np.concatenate(shapes) + np.array(origin_m)
    source = lane.centerline
    distance = hausdorff_m(source.points, points, 4)
    ends = (points[0] - source.points[0], points[-1] - source.points[-1])
    return max(distance, *(float(np.hypot(*end)) for end in ends))


def _extra(roads: Roads, ids: NetworkIds, network: NetworkSummary) -> list[str]:
    """Connections that follow neither a connector between its lanes nor one lane across a cut."""
    found: list[str] = []
    for way in network.links:
        source = ids.sources.get(way.via[0]) if way.via else None
        before, after = ids.sources.get(way.from_lane), ids.sources.get(way.to_lane)
        if source is not None and before is not None and after is not None:
            connector = roads.connectors.get(source[0])
            if connector is not None and (before[0], after[0]) == (connector.from_lane_id, connector.to_lane_id):
                continue
            if source[0] in roads.lanes and before[0] == after[0] == source[0]:
                continue
        found.append(f"{way.from_lane} to {way.to_lane}")
    return found


def _broken_links(roads: Roads, ids: NetworkIds, network: NetworkSummary) -> list[MapProblem]:
    """Lanes and connectors whose SUMO lanes are not joined one after the other."""
    onward: dict[str, set[str]] = {}
    for way in network.links:
        for here, there in zip((way.from_lane, *way.via), (*way.via, way.to_lane), strict=True):
            onward.setdefault(here, set()).add(there)
    found: list[MapProblem] = []
    for lane in (*roads.lanes.values(), *roads.connectors.values()):
        chain = [piece.sumo_lane for piece in ids.pieces.get(lane.id, ())]
        for here, there in pairwise(chain):
            if there not in onward.get(here, set()):
                found.append(_of(lane, "broken_link", f"breaks between {here} and {there}"))
    for connector in roads.connectors.values():
        chain = ids.pieces.get(connector.id, ())
        start, end = ids.pieces.get(connector.from_lane_id, ()), ids.pieces.get(connector.to_lane_id, ())
        if chain and start and chain[0].sumo_lane not in onward.get(start[-1].sumo_lane, set()):
            found.append(_of(connector, "broken_link", f"does not leave lane {connector.from_lane_id} in the network"))
        if chain and end and end[0].sumo_lane not in onward.get(chain[-1].sumo_lane, set()):
            found.append(_of(connector, "broken_link", f"does not enter lane {connector.to_lane_id} in the network"))
    return found


SHORTEST_YELLOW_S = 2.5
"""Shorter ones cannot be obeyed at the speeds of a town."""
_LETTERS = frozenset("Ggyr")


def light_problems(roads: Roads, ids: NetworkIds, network: NetworkSummary, controls: MapControls) -> list[MapProblem]:
    """One for each fault: a connector without its light, a path that never gets green, conflicting greens.

    Programs that the map took over from its file are as they are: they only have to be the same in the network.
    """
    problems: list[MapProblem] = []
    by_start = {way.via[0]: way for way in network.links if way.via}
    groups: dict[str, list[tuple[Connector, CheckedLink]]] = defaultdict(list)
    for connector in roads.connectors.values():
        pieces = ids.pieces.get(connector.id)
        way = by_start.get(pieces[0].sumo_lane) if pieces else None
        if way is None:
            continue  # reported as missing
        named = ids.links.get(connector.id)
        if way.light != named:
            said = f"has the light {way.light} in the network, {named} in the id map"
            problems.append(MapProblem("light", CONNECTORS, connector.id, said))
        elif connector.has_traffic_light != (named is not None):
            said = f"has {'no' if named is None else 'a'} light in the network only"
            problems.append(MapProblem("light", CONNECTORS, connector.id, said))
        elif named is not None:
            groups[named[0]].append((connector, way))
    for light, members in groups.items():
        phases = network.lights.get(light)
        carried = any(controls.links.get(connector.id) == way.light for connector, way in members)
        if carried and network.programs.get(light) != controls.signals[light]:
            problems.append(MapProblem("light", "light", light, "has other programs than the map took over"))
        elif carried:
            continue
        elif phases is None:
            problems.append(MapProblem("light", "light", light, "has no program"))
        elif any(way.light is not None and way.light[1] >= len(state) for _, way in members for _, state in phases):
            problems.append(MapProblem("light", "light", light, "has states shorter than its links"))
        elif any(set(state) - _LETTERS for _, state in phases):
            said = f"shows letters other than {', '.join(sorted(_LETTERS))}"
            problems.append(MapProblem("light", "light", light, said))
        else:
            problems += _program_problems(roads, network, light, members, phases)
    return problems


def _program_problems(
    roads: Roads,
    network: NetworkSummary,
    light: str,
    members: Sequence[tuple[Connector, CheckedLink]],
    phases: Sequence[tuple[float, str]],
) -> Iterator[MapProblem]:
    connectors = [connector for connector, _ in members]
    index = [way.light[1] if way.light else 0 for _, way in members]
    conflicts = path_conflicts(roads, connectors)
    for i, (connector, way) in enumerate(members):
        letters = [state[index[i]] for _, state in phases]
        if not any(letter in "Gg" for letter in letters):
            yield MapProblem("light", "light", light, f"connector {connector.id} never gets green")
        for (_, before), (seconds, after) in pairwise((*phases, phases[0])):
            if before[index[i]] in "Gg" and after[index[i]] == "r":
                said = f"connector {connector.id} turns from green to red without yellow"
                yield MapProblem("light", "light", light, said)
            if after[index[i]] == "y" and seconds < SHORTEST_YELLOW_S:
                yield MapProblem("light", "light", light, f"connector {connector.id} has {seconds:g} s of yellow")
        for j in range(i):
            if conflicts[i, j]:
                pairs = {(state[index[i]], state[index[j]]) for _, state in phases}
                faults = sorted(pair for pair in pairs if _collide(network, pair, (way, members[j][1])))
                if faults:
                    shown = " and ".join(faults[0])
                    said = f"connectors {connector.id} and {connectors[j].id} meet and both show {shown}"
                    yield MapProblem("light", "light", light, said)


def _collide(network: NetworkSummary, letters: tuple[str, str], ways: tuple[CheckedLink, CheckedLink]) -> bool:
    """Whether two paths that meet are both open and neither must yield; a path that runs out ("y") yields like "g"."""
    if not all(letter in "Ggy" for letter in letters) or letters == ("y", "y"):
        return False
    one, other = ways
    return not (
        (letters[0] in "gy" and other.link in network.yields[one.node].get(one.link, frozenset()))
        or (letters[1] in "gy" and one.link in network.yields[other.node].get(other.link, frozenset()))
    )
