"""Signals and right of way of an imported map against its file, program by program and junction by junction.

What the SUMO network says is compared with what the file says; what lies
between the two on disk is not asked.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations

from interplan_sumo.maps.importers.carried_controls import strictest
from interplan_sumo.maps.importers.chains import (
    ConnectorChain,
    connector_chains,
    connectors_by_way,
    lights_by_way,
    lights_passed,
)
from interplan_sumo.maps.importers.record import LaneOrigin
from interplan_sumo.maps.importers.source import SourceJunction, SourceMap, SourceSignal
from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.network_links import CheckedLink, NetworkSummary
from interplan_sumo.maps.problem import MapProblem
from interplan_sumo.maps.schema import CONNECTORS
from interplan_sumo.maps.signal_program import SignalPhase, SignalProgram
from interplan_sumo.world.roads import Roads

_SECONDS = 0.001
_TELLING = frozenset("=swZ")
"""States of links whose drivers behave otherwise than at M and m."""


@dataclass(frozen=True, slots=True)
class ControlReport:
    """What the file holds of signals and right of way, what of it the network does, and every difference."""

    phases: tuple[int, int]
    """Phases of programs in the file; those of them whose times and letters are the same in the map."""
    yields: tuple[int, int]
    """Pairs of ways in the file of which one yields; those that do so in the map."""
    problems: tuple[MapProblem, ...]


def compare_controls(
    roads: Roads,
    origins: Mapping[str, Sequence[LaneOrigin]],
    source: SourceMap,
    ids: NetworkIds,
    network: NetworkSummary,
) -> ControlReport:
    """The network of an imported map against its file."""
    comparing = _Comparing(roads, source, connector_chains(roads, origins), ids, network)
    return comparing.report()


@dataclass(frozen=True, eq=False)
class _Comparing:
    roads: Roads
    source: SourceMap
    chains: Mapping[str, ConnectorChain]
    ids: NetworkIds
    network: NetworkSummary

    def report(self) -> ControlReport:
        found = [*self._signals()]
        wrong = sum(count for count, _ in found)
        total = sum(len(each.phases) for signal in self.source.signals for each in signal.programs)
        problems = [problem for _, problems in found for problem in problems]
        settled, pairs = 0, 0
        by_start = {way.via[0]: way for way in self.network.links if way.via}
        built = {
            id_: by_start[pieces[0].sumo_lane]
            for id_, pieces in self.ids.pieces.items()
            if id_ in self.roads.connectors and pieces[0].sumo_lane in by_start
        }
        over = connectors_by_way(self.source, self.chains)
        for junction in self.source.junctions:
            count, faults = self._junction(junction, over, built)
            pairs += count
            settled += count - len(faults)
            problems += faults
            problems += self._letters(junction, over, built)
        return ControlReport((total, total - wrong), (pairs, settled), tuple(problems))

    # --- signals -----------------------------------------------------------------------------------

    def _signals(self) -> Iterator[tuple[int, list[MapProblem]]]:
        """Per controller how many of its phases are otherwise, and the differences."""
        place = {
            light: (signal, k)
            for signal in self.source.signals
            if signal.programs
            for k, light in enumerate(signal.lights)
            if light
        }
        only = lights_by_way(self.source)
        members: dict[str, dict[str, list[tuple[SourceSignal, int]]]] = {each.id: {} for each in self.source.signals}
        for id_, chain in self.chains.items():
            found = [place[one] for one in lights_passed(chain, self.source.lanes, only) if one in place]
            if found:
                members[found[0][0].id][id_] = found
        for signal in self.source.signals:
            if signal.programs and members[signal.id]:
                yield self._signal(signal, members[signal.id])

    def _signal(
        self, signal: SourceSignal, members: Mapping[str, Sequence[tuple[SourceSignal, int]]]
    ) -> tuple[int, list[MapProblem]]:
        faults: list[MapProblem] = []
        wrong: set[tuple[int, int]] = set()
        alike: set[str] = set()
        for connector, passed in members.items():
            link = self.ids.links.get(connector)
            if link is None:
                faults.append(MapProblem("signal", CONNECTORS, connector, f"has no light; in the file {signal.id}"))
                wrong |= {(p, k) for p, each in enumerate(signal.programs) for k in range(len(each.phases))}
                continue
            here = self.network.programs.get(link[0], ())
            if link[0] not in alike:
                different = list(_different_times(signal, here))
                wrong |= {at for at, _ in different}
                faults += [MapProblem("signal", "light", signal.id, said) for _, said in different]
                alike.add(link[0])
            shown = [k for each, k in passed if each is signal]
            differing = dict(_different_letters(signal, here, shown, link[1]))
            wrong |= differing.keys()
            if differing:
                more = f", and in {len(differing) - 1} more phases" if len(differing) > 1 else ""
                said = f"shows other letters than light {signal.id} in the file: {next(iter(differing.values()))}{more}"
                faults.append(MapProblem("signal", CONNECTORS, connector, said))
            others = sorted({each.id for each, _ in passed} - {signal.id})
            if others:
                said = f"follows light {signal.id} only; in the file one passes {', '.join(others)}, too"
                faults.append(MapProblem("signal", CONNECTORS, connector, said))
        return len(wrong), faults

    # --- right of way ------------------------------------------------------------------------------

    def _junction(
        self, junction: SourceJunction, over: Mapping[tuple[str, ...], list[str]], built: Mapping[str, CheckedLink]
    ) -> tuple[int, list[MapProblem]]:
        """How many pairs the file decides, and those that the network decides otherwise; each pair counts once."""
        faults: list[MapProblem] = []
        told: set[tuple[str, str, bool]] = set()
        if junction.foes is None and not junction.yields:
            return 0, faults
        count = 0
        rows = [(id_, k) for k, way in enumerate(junction.ways) for id_ in over[way.lanes] if id_ in built]
        for (one, a), (other, b) in permutations(rows, 2):
            here, there = built[one], built[other]
            if a == b or here.from_lane == there.from_lane:
                continue
            wanted = (a, b) in junction.yields
            meet = here.node == there.node and there.link in self.network.foes[here.node].get(here.link, frozenset())
            if junction.foes is None and not (meet and (wanted or (b, a) in junction.yields)):
                continue
            yields = meet and there.link in self.network.yields[here.node].get(here.link, frozenset())
            in_file = (a, b) in junction.foes if junction.foes is not None else True
            if not in_file and yields and (here.to_lane == there.to_lane or self._meet_elsewhere(one, other)):
                continue
            if (one, other, wanted) in told:  # by other ways that the same two connectors lead over
                continue
            told.add((one, other, wanted))
            count += wanted or yields
            if yields != wanted:
                said = f"{'yields' if yields else 'does not yield'} to {other}; in the file it "
                said += f"{'does' if wanted else 'does not'} (junction {junction.id})"
                faults.append(MapProblem("right_of_way", CONNECTORS, one, said))
        return count, faults

    def _meet_elsewhere(self, one: str, other: str) -> bool:
        """Whether one of two connectors leads over more than one way through junctions."""
        return any(len(self.chains[id_].lanes) > 3 for id_ in (one, other))

    def _letters(
        self, junction: SourceJunction, over: Mapping[tuple[str, ...], list[str]], built: Mapping[str, CheckedLink]
    ) -> Iterator[MapProblem]:
        for way in junction.ways:
            for id_ in over[way.lanes]:
                link = built.get(id_)
                if link is None or link.light is not None or link.state == way.state or not way.state:
                    continue
                if {link.state, way.state} & _TELLING:
                    said = f"is of state {link.state}, in the file {way.state} (junction {junction.id})"
                    yield MapProblem("right_of_way", CONNECTORS, id_, said)


def _different_letters(
    signal: SourceSignal, here: Sequence[SignalProgram], lights: Sequence[int], index: int
) -> Iterator[tuple[tuple[int, int], str]]:
    """(program, phase) and what a connector that passes some lights shows there."""
    for p, (own, other) in enumerate(zip(signal.programs, here, strict=False)):
        for k, (phase, there) in enumerate(zip(own.phases, other.phases, strict=False)):
            wanted, shown = strictest(phase.state[light] for light in lights), there.state[index]
            if wanted != shown and (signal.tells_who_yields or wanted.lower() != shown.lower()):
                yield (p, k), f"{shown} for {wanted} in phase {k} of program {own.id}"


def _different_times(signal: SourceSignal, here: Sequence[SignalProgram]) -> Iterator[tuple[tuple[int, int], str]]:
    """(program, phase) and what is different about it, letters apart."""
    if [each.id for each in here] != [each.id for each in signal.programs]:
        names = ", ".join(each.id for each in here) or "none"
        for p, own in enumerate(signal.programs):
            yield from (((p, k), f"has the programs {names}, in the file another set") for k in range(len(own.phases)))
        return
    for p, (own, other) in enumerate(zip(signal.programs, here, strict=True)):
        for what, one, two in (
            ("type", own.kind, other.kind),
            ("offset", own.offset_s, other.offset_s),
            ("number of phases", len(own.phases), len(other.phases)),
            ("parameters", own.parameters, other.parameters),
        ):
            if one != two:
                yield (p, -1), f"program {own.id}: its {what} is {two}, in the file {one}"
        for k, (phase, there) in enumerate(zip(own.phases, other.phases, strict=False)):
            if _times(phase) != _times(there):
                yield (p, k), f"program {own.id}, phase {k}: {_in_words(there)}; in the file {_in_words(phase)}"


def _times(phase: SignalPhase) -> tuple[object, ...]:
    seconds = (phase.duration_s, phase.min_s, phase.max_s)
    return (*(None if each is None else round(each / _SECONDS) for each in seconds), phase.next, phase.name, phase.more)


def _in_words(phase: SignalPhase) -> str:
    bounds = f" (from {phase.min_s} to {phase.max_s})" if phase.min_s is not None or phase.max_s is not None else ""
    return f"{phase.duration_s:g} s{bounds}, then {' or '.join(map(str, phase.next)) or 'the next'}"
