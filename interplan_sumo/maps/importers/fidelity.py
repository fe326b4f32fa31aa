"""Is everything there? An imported map against the file that it was made from, as one or two readers see it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Container, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from itertools import pairwise

from interplan_sumo.maps.importers.control_fidelity import ControlReport
from interplan_sumo.maps.importers.lines import mean_length_m
from interplan_sumo.maps.importers.record import ImportRecord, LaneOrigin
from interplan_sumo.maps.importers.source import SourceCount, SourceMap
from interplan_sumo.maps.importers.street_fidelity import StreetReport
from interplan_sumo.maps.problem import MapProblem
from interplan_sumo.maps.schema import CONNECTORS
from interplan_sumo.world.roads import Roads

LENGTH_SHARE = 0.12
"""Two readings of a lane may differ by this share of its length, since smooth centre lines cut corners,"""
LENGTH_M = 1.5
"""or by so much: where the sides of a short, wide lane differ, so do middles drawn in different ways."""
TOTAL_SHARE = 0.015
"""All lanes together may differ by this share."""
COVERED_M = 1.5
"""A lane may lack so much at its ends: joints and margins where nothing follows."""
LIMIT_MPS = 0.01
_START, _END = 1e-4, 1.0 - 1e-4


@dataclass(frozen=True, slots=True)
class Pair:
    """A figure of the file beside that of the map."""

    file: float
    map: float


@dataclass(frozen=True, slots=True)
class SourceReport:
    """What the file holds, and what the map holds of it."""

    file: str
    format: str
    second_reader: bool
    """Whether other code than the importer's counted the file."""
    lanes: Pair
    lane_km: Pair
    links: Pair
    lanes_at_lights: Pair
    lanes_with_limit: Pair
    crosswalks: Pair
    left_out: Pair
    leaving: int
    """Links that lead beyond the file."""
    problems: tuple[MapProblem, ...]
    signal_phases: Pair = Pair(0, 0)
    """Of the signal programs; in the map those that are the same."""
    who_yields: Pair = Pair(0, 0)
    """Pairs of ways of which one yields to the other; in the map those of them of which the same one does."""
    streets: StreetReport | None = None


def compare(roads: Roads, record: ImportRecord, source: SourceMap, counted: SourceCount | None) -> SourceReport:
    """The map, by its record, against its file: lights and limits as read, all else as counted where that was done."""
    count = count_of(source) if counted is None else counted
    found = _Found(roads, record)
    lights = frozenset(id_ for id_, lane in source.lanes.items() if lane.lights_at_start or lane.lights_at_end)
    limits_mps = {id_: lane.speed_limit_mps for id_, lane in source.lanes.items() if lane.speed_limit_mps is not None}
    file_links, map_links = count.links, found.links()
    lit, unknown = found.lit(lights)
    limits = found.limits(limits_mps)
    file_m, map_m = sum(count.lane_length_m.values()), sum(found.length_m.values())
    left_out = sum(map(len, record.left_out.values()))
    problems = [
        *_different("lane", count.lane_length_m, found.covered),
        *_lengths(count, found),
        *_total(record.file, file_m, map_m),
        *_different("link", map(_arrow, file_links), map(_arrow, map_links)),
        *(
            MapProblem("light", "lane", lane, "lies at a traffic light in the file, and at none in the map")
            for lane in sorted(lights - lit)
        ),
        *(MapProblem("light", CONNECTORS, id_, "lies under a traffic light that the file lacks") for id_ in unknown),
        *_limit_problems(limits_mps, limits),
    ]
    if count.crosswalks != len(roads.crosswalks):
        said = f"has {count.crosswalks} crosswalks, the map {len(roads.crosswalks)}"
        problems.append(MapProblem("count", "file", record.file, said))
    if count.left_out != left_out:
        said = f"has {count.left_out} lanes that are not for cars, the import left out {left_out}"
        problems.append(MapProblem("count", "file", record.file, said))
    return SourceReport(
        file=record.file,
        format=record.format,
        second_reader=counted is not None,
        lanes=Pair(len(count.lane_length_m), len(found.covered)),
        lane_km=Pair(file_m / 1000.0, map_m / 1000.0),
        links=Pair(len(file_links), len(map_links)),
        lanes_at_lights=Pair(len(lights), len(lit)),
        lanes_with_limit=Pair(len(limits_mps), len(limits)),
        crosswalks=Pair(count.crosswalks, len(roads.crosswalks)),
        left_out=Pair(count.left_out, left_out),
        leaving=count.leaving,
        problems=tuple(problems),
    )


def with_streets(report: SourceReport, streets: StreetReport, problems: Sequence[MapProblem]) -> SourceReport:
    """The report with what became of streets."""
    return replace(report, problems=(*report.problems, *problems), streets=streets)


def with_controls(report: SourceReport, controls: ControlReport) -> SourceReport:
    """The report with what became of signals and right of way."""
    phases, yields = Pair(*controls.phases), Pair(*controls.yields)
    return replace(report, problems=(*report.problems, *controls.problems), signal_phases=phases, who_yields=yields)


def count_of(source: SourceMap) -> SourceCount:
    """What the importer's own reading of a file holds; a lane is as long as its two boundaries are in the mean."""
    lanes = source.lanes
    ends = {(id_, onward) for id_, lane in lanes.items() for onward in lane.successors}
    ends |= {(before, id_) for id_, lane in lanes.items() for before in lane.predecessors}
    inside = {(start, end) for start, end in ends if start in lanes and end in lanes}
    return SourceCount(
        {id_: mean_length_m(lane.left, lane.right) for id_, lane in lanes.items()},
        frozenset(inside),
        len(ends - inside),
        len(source.crosswalks),
        len(source.left_out),
    )


class _Found:
    """What the map holds of each lane of the file."""

    def __init__(self, roads: Roads, record: ImportRecord) -> None:
        self._roads = roads
        self._origins = {key: rows for key, rows in record.origins.items() if key in roads}
        stretches: dict[str, list[LaneOrigin]] = defaultdict(list)
        for rows in self._origins.values():
            for row in rows:
                stretches[row.source_id].append(row)
        self.covered: dict[str, float] = {}
        """By lane of the file: the share of it that lies on the map."""
        self.length_m: dict[str, float] = {}
        """By lane of the file: the length of what lies on the map, no stretch twice."""
        for source_id, rows in stretches.items():
            self.covered[source_id], self.length_m[source_id] = _once(rows)

    def links(self) -> frozenset[tuple[str, str]]:
        """(from, to) of the lanes of the file that the map joins."""
        found: set[tuple[str, str]] = set()
        for rows in self._origins.values():
            found.update(_steps(rows))
        for id_, connector in self._roads.connectors.items():
            start, end = self._origins.get(connector.from_lane_id), self._origins.get(connector.to_lane_id)
            if start and end:
                found.update(_steps((start[-1], *self._origins.get(id_, ()), end[0])))
        return frozenset(found)

    def lit(self, in_file: Set[str]) -> tuple[frozenset[str], list[str]]:
        """Lanes at a light that lie before, on or behind a connector under one; connectors without such a lane."""
        found: set[str] = set()
        unknown: list[str] = []
        for id_, connector in self._roads.connectors.items():
            if connector.has_traffic_light:
                start = self._origins.get(connector.from_lane_id, ())
                end = self._origins.get(connector.to_lane_id, ())
                near = {row.source_id for row in (*start[-1:], *self._origins.get(id_, ()), *end[:1])} & in_file
                found |= near
                if not near:
                    unknown.append(id_)
        return frozenset(found), unknown

    def limits(self, in_file: Container[str]) -> dict[str, float]:
        """Lanes of the file with the limit that the map gives them: that of its lanes, else the highest of its ways.

        A way over several lanes takes the lowest of their limits, so a lane
        without one in the file may lie under its neighbour's: such are left out.
        """
        on_lanes: dict[str, float] = {}
        on_ways: dict[str, list[float]] = defaultdict(list)
        for id_, rows in self._origins.items():
            limit = self._roads[id_].speed_limit_mps
            for row in rows:
                if limit is not None and id_ in self._roads.lanes:
                    on_lanes[row.source_id] = limit
                elif limit is not None:
                    on_ways[row.source_id].append(limit)
        return {key: max(values) for key, values in on_ways.items() if key in in_file} | on_lanes


def _once(rows: Iterable[LaneOrigin]) -> tuple[float, float]:
    """The share of a lane that some stretches cover, and the length of that, counting no part twice."""
    at, share, length_m = 0.0, 0.0, 0.0
    for row in sorted(rows, key=lambda row: (row.from_share, -row.to_share)):
        first = max(at, row.from_share)
        if row.to_share > first:
            part = row.to_share - first
            share += part
            length_m += part / (row.to_share - row.from_share) * (row.end_m - row.start_m)
            at = row.to_share
    return share, length_m


def _steps(rows: Iterable[LaneOrigin]) -> Iterable[tuple[str, str]]:
    """Pairs of lanes of the file of which one ends where the other begins."""
    for here, there in pairwise(rows):
        if here.source_id != there.source_id and here.to_share >= _END and there.from_share <= _START:
            yield here.source_id, there.source_id


def _arrow(link: tuple[str, str]) -> str:
    return f"{link[0]} to {link[1]}"


def _different(what: str, in_file: Iterable[str], in_map: Iterable[str]) -> list[MapProblem]:
    file, map_ = frozenset(in_file), frozenset(in_map)
    return [
        *(MapProblem("missing", what, key, "of the file is missing in the map") for key in sorted(file - map_)),
        *(MapProblem("extra", what, key, "of the map is not in the file") for key in sorted(map_ - file)),
    ]


def _lengths(count: SourceCount, found: _Found) -> Iterable[MapProblem]:
    for lane, length_m in count.lane_length_m.items():
        if lane not in found.covered:
            continue
        share = found.covered[lane]
        if (1.0 - share) * length_m > COVERED_M:
            said = f"{(1.0 - share) * length_m:.1f} of its {length_m:.1f} m are missing in the map"
            yield MapProblem("length", "lane", lane, said)
        elif abs(found.length_m[lane] / share - length_m) > max(LENGTH_M, LENGTH_SHARE * length_m):
            said = f"is {length_m:.2f} m long in the file, {found.length_m[lane] / share:.2f} m in the map"
            yield MapProblem("length", "lane", lane, said)


def _total(file: str, file_m: float, map_m: float) -> Iterable[MapProblem]:
    if abs(file_m - map_m) > max(LENGTH_M, TOTAL_SHARE * file_m):
        said = f"all lanes together are {file_m:.1f} m long in the file, {map_m:.1f} m in the map"
        yield MapProblem("length", "file", file, said)


def _limit_problems(in_file: Mapping[str, float], in_map: Mapping[str, float]) -> Iterable[MapProblem]:
    for lane, limit in in_file.items():
        known = in_map.get(lane)
        if known is None:
            yield MapProblem("limit", "lane", lane, f"the file's limit of {limit:.2f} m/s is missing in the map")
        elif known - limit > LIMIT_MPS:
            said = f"a limit of {limit:.2f} m/s in the file, of {known:.2f} m/s in the map"
            yield MapProblem("limit", "lane", lane, said)
    for lane in sorted(in_map.keys() - in_file.keys()):
        yield MapProblem("limit", "lane", lane, f"the map has a limit of {in_map[lane]:.2f} m/s, the file has none")
