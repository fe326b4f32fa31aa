"""Who yields at green, for programs of files that only know green: geometry, signs and the file's priorities tell."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace

from interplan_sumo.maps.controls import MapControls
from interplan_sumo.maps.junction_rules import ruled
from interplan_sumo.maps.junctions import Junction, junction, junction_groups, lane_signs
from interplan_sumo.maps.signal_program import GREEN, SignalProgram
from interplan_sumo.world.roads import Roads


def with_yielding_greens(roads: Roads, controls: MapControls, lights: Collection[str]) -> MapControls:
    """The controls with a letter for each connector of some lights: "g" where it yields to who is green, too, else "G".

    Without that letter all who meet would have to yield, or nobody would.
    """
    if not lights:
        return controls
    _, members = junction_groups(roads, [each.connectors for each in controls.junctions if each.meets_known])
    signs = lane_signs(roads)
    meetings = {node: junction(roads, ids, signs) for node, ids in members.items() if controls.links.keys() & set(ids)}
    known = {connector.id for meeting in meetings.values() for connector in meeting.connectors}
    before = _before(ruled(meetings, controls.within(known).junctions))
    signals, links = dict(controls.signals), dict(controls.links)
    for light in lights:
        own = {id_: index for id_, (name, index) in controls.links.items() if name == light}
        first = {id_: before.get(id_, set()) & controls.links.keys() for id_ in own}
        programs = controls.signals[light]
        rows = {id_: tuple("".join(_letters(each, id_, own, first[id_])) for each in programs) for id_ in own}
        columns = list(dict.fromkeys(rows.values()))
        if columns:
            signals[light] = tuple(_with_columns(each, columns, k) for k, each in enumerate(programs))
            links |= {id_: (light, columns.index(row)) for id_, row in rows.items()}
    return replace(controls, signals=signals, links=links)


def _before(meetings: Mapping[str, Junction]) -> dict[str, set[str]]:
    """Connector -> those to which it yields."""
    ids = {node: [connector.id for connector in meeting.connectors] for node, meeting in meetings.items()}
    return {
        id_: {other for other, yields in zip(ids[node], meeting.yields[row], strict=True) if yields}
        for node, meeting in meetings.items()
        for row, id_ in enumerate(ids[node])
    }


def _letters(program: SignalProgram, id_: str, own: Mapping[str, int], first: Collection[str]) -> Iterator[str]:
    """What a connector shows, phase by phase; `first` go before it, of whom those of other lights may be green, too."""
    for phase in program.phases:
        letter = phase.state[own[id_]]
        if letter in GREEN:
            letter = "g" if any(o not in own or phase.state[own[o]] in GREEN for o in first) else "G"
        yield letter


def _with_columns(program: SignalProgram, columns: Collection[tuple[str, ...]], number: int) -> SignalProgram:
    phases = (
        replace(phase, state="".join(column[number][k] for column in columns)) for k, phase in enumerate(program.phases)
    )
    return replace(program, phases=tuple(phases))
