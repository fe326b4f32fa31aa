"""Signal programs and right of way of a foreign map, carried over to the connectors that it became."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from interplan_sumo.maps.controls import APART, GOES, OPEN, YIELDS, JunctionRules, MapControls
from interplan_sumo.maps.importers.chains import (
    ConnectorChain,
    connector_chains,
    connectors_by_way,
    lights_by_way,
    lights_passed,
)
from interplan_sumo.maps.importers.greens import with_yielding_greens
from interplan_sumo.maps.importers.record import LaneOrigin
from interplan_sumo.maps.importers.source import SourceJunction, SourceMap, SourceSignal
from interplan_sumo.maps.signal_program import GREEN, SignalProgram
from interplan_sumo.world.roads import Roads

_STRICTER = "rsuyYgoGO"
"""What a light shows, the most restrictive first."""


def carried_controls(
    source: SourceMap, roads: Roads, origins: Mapping[str, Sequence[LaneOrigin]]
) -> tuple[MapControls, tuple[str, ...]]:
    """The controls of a map made from `source`, and a note for each that could not be kept as it is."""
    carrying = _Carrying(source, roads, connector_chains(roads, origins))
    carrying.carry_signals()
    carrying.carry_junctions()
    used = {light for light, _ in carrying.links.values()}
    signals = {light: tuple(programs) for light, programs in carrying.signals.items() if light in used}
    controls = MapControls(signals, carrying.links, tuple(carrying.junctions))
    mute = [signal.id for signal in source.signals if signal.id in signals and not signal.tells_who_yields]
    return with_yielding_greens(roads, controls, mute), tuple(carrying.notes)


@dataclass(eq=False)
class _Carrying:
    source: SourceMap
    roads: Roads
    chains: Mapping[str, ConnectorChain]
    signals: dict[str, list[SignalProgram]] = field(default_factory=dict[str, list[SignalProgram]])
    links: dict[str, tuple[str, int]] = field(default_factory=dict[str, tuple[str, int]])
    junctions: list[JunctionRules] = field(default_factory=list[JunctionRules])
    notes: list[str] = field(default_factory=list[str])
    careful: set[str] = field(default_factory=set[str])
    """Connectors that pass a light which they cannot follow, behind one that they do."""

    # --- signals -----------------------------------------------------------------------------------

    def carry_signals(self) -> None:
        place = {
            light: (signal, index)
            for signal in self.source.signals
            if signal.programs
            for index, light in enumerate(signal.lights)
            if light
        }
        self.signals = {signal.id: list(signal.programs) for signal in self.source.signals if signal.programs}
        only = lights_by_way(self.source)
        by_signal: dict[str, dict[str, list[int]]] = defaultdict(dict)
        for id_, connector in self.roads.connectors.items():
            if not connector.has_traffic_light or id_ not in self.chains:
                continue
            passed = lights_passed(self.chains[id_], self.source.lanes, only)
            found = [place[light] for light in passed if light in place]
            if found:
                first = found[0][0]
                by_signal[first.id][id_] = list(dict.fromkeys(i for signal, i in found if signal is first))
                others = sorted({signal.id for signal, _ in found} - {first.id})
                if others:
                    self.careful.add(id_)
                    said = (
                        f"follows traffic light {first.id} alone; it also passes {', '.join(others)}, and yields there"
                    )
                    self.notes.append(f"connector {id_} {said}")
        for signal in self.source.signals:
            self._link(signal, by_signal.get(signal.id, {}))

    def _link(self, signal: SourceSignal, connectors: Mapping[str, Sequence[int]]) -> None:
        """Tie connectors to their letters; those that pass several lights of a controller get one of their own."""
        added: dict[tuple[int, ...], int] = {}
        for id_, indices in connectors.items():
            key = tuple(indices)
            if len(key) == 1:
                self.links[id_] = signal.id, key[0]
                continue
            passed = f"connector {id_} passes links {', '.join(map(str, key))} of traffic light {signal.id}"
            if all(_ever_green(each, key) for each in signal.programs):
                if key not in added:
                    added[key] = self.signals[signal.id][0].links
                    self.signals[signal.id] = [_with_strictest(each, key) for each in self.signals[signal.id]]
                self.links[id_] = signal.id, added[key]
                self.notes.append(f"{passed}: it shows the strictest of them")
            else:
                self.links[id_] = signal.id, key[0]
                self.careful.add(id_)
                self.notes.append(f"{passed}, never green together: it follows the first, and yields at the others")

    # --- right of way ------------------------------------------------------------------------------

    def carry_junctions(self) -> None:
        over = connectors_by_way(self.source, self.chains)
        ways_of: dict[str, list[tuple[str, ...]]] = defaultdict(list)
        for way, ids in over.items():
            for id_ in ids:
                ways_of[id_].append(way)
        for id_, ways in ways_of.items():
            ways.sort(key=lambda way, lanes=self.chains[id_].lanes: lanes.index(way[-1]))
        decided: dict[tuple[str, str], str] = {}
        for junction in self.source.junctions:
            rows = [(id_, k) for k, way in enumerate(junction.ways) for id_ in over[way.lanes]]
            if not rows:
                continue
            ids = list(dict.fromkeys(id_ for id_, _ in rows))
            place = dict(reversed(rows))
            rules = [
                [self._rule(junction, (one, other), (place[one], place[other]), ways_of) for other in ids]
                for one in ids
            ]
            self._settle(junction, ids, rules, decided)
            lawless = junction.foes is None and not junction.yields and len(ids) > 1
            if lawless:
                said = "has no rules in the file: signs and geometry decide"
                self.notes.append(f"junction {junction.id} ({junction.kind}) {said}")
            self.junctions.append(
                JunctionRules(
                    junction.id,
                    "" if lawless else junction.kind,
                    tuple(ids),
                    tuple(junction.ways[place[id_]].state for id_ in ids),
                    tuple(map("".join, rules)),
                    junction.foes is not None,
                )
            )

    def _rule(
        self,
        junction: SourceJunction,
        pair: tuple[str, str],
        ways: tuple[int, int],
        ways_of: Mapping[str, Sequence[tuple[str, ...]]],
    ) -> str:
        one, other = (self.roads.connectors[id_] for id_ in pair)
        if one is other or one.from_lane_id == other.from_lane_id:
            return APART
        if ways[0] == ways[1]:
            return OPEN
        meet = ways in (junction.foes or ())
        late = [
            id_ in self.careful and ways_of[id_][0] != junction.ways[k].lanes for id_, k in zip(pair, ways, strict=True)
        ]
        if meet and late[0] != late[1]:
            return YIELDS if late[0] else GOES
        if ways in junction.yields:
            return YIELDS
        if junction.foes is None:
            return GOES if ways[::-1] in junction.yields else OPEN
        if meet:
            return GOES
        # Connectors that lead over more than this junction may meet outside of it.
        beyond = one.to_lane_id == other.to_lane_id or any(len(ways_of[id_]) > 1 for id_ in pair)
        return OPEN if beyond else APART

    def _settle(
        self, junction: SourceJunction, ids: Sequence[str], rules: list[list[str]], decided: dict[tuple[str, str], str]
    ) -> None:
        """Leave pairs that an earlier junction has decided to that one."""
        for a, one in enumerate(ids):
            for b in range(a):
                rule = rules[a][b], rules[b][a]
                if not set(rule) & {YIELDS, GOES}:
                    continue
                known = decided.setdefault((one, ids[b]), "".join(rule))
                known = decided.get((ids[b], one), known[::-1])[::-1]
                if known != "".join(rule):
                    rules[a][b] = rules[b][a] = OPEN
                    self.notes.append(
                        f"connectors {one} and {ids[b]} meet twice; junction {junction.id} would have it otherwise"
                    )


def strictest(letters: Iterable[str]) -> str:
    """What holds for who passes several lights at once."""
    return min(letters, key=_STRICTER.index)


def _ever_green(program: SignalProgram, links: Sequence[int]) -> bool:
    return any(strictest(phase.state[k] for k in links) in GREEN for phase in program.phases)


def _with_strictest(program: SignalProgram, links: Sequence[int]) -> SignalProgram:
    """The program with one more letter: the most restrictive of some others."""
    phases = (replace(each, state=each.state + strictest(each.state[k] for k in links)) for each in program.phases)
    return replace(program, phases=tuple(phases))
