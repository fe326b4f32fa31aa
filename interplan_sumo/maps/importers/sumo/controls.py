"""Signal programs and right of way of a SUMO network, in the neutral form of imported maps."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Container, Iterable, Mapping
from dataclasses import replace

from interplan_sumo.maps.importers.source import SourceJunction, SourceSignal, SourceWay
from interplan_sumo.maps.network_file import FileConnection, FileJunction, NetworkFile
from interplan_sumo.maps.signal_program import LETTERS, SignalProgram

LAWLESS = frozenset(("unregulated", "traffic_light_unregulated", "rail_crossing", "rail_signal"))
"""Types of junctions in which nobody yields to anybody."""
_TRAINS = frozenset(("rail_crossing", "rail_signal"))
_RUNNING = frozenset(("static", "actuated", "delay_based"))
_NEEDLESS = frozenset(("file", "freq", "show-detectors", "vTypes"))
"""Parameters that write files, draw, or name what lies beyond the network."""


def light_name(way: FileConnection) -> str:
    """Traffic light and link, such as J1/3."""
    return f"{way.light}/{way.light_link}"


def signals_of(file: NetworkFile, ways: Iterable[FileConnection]) -> tuple[tuple[SourceSignal, ...], tuple[str, ...]]:
    """The controllers of some ways, and what of their programs cannot be used."""
    by_light: dict[str, dict[int, list[FileConnection]]] = defaultdict(lambda: defaultdict(list))
    for way in ways:
        if way.light:
            if not way.light_link.isdecimal() or len(way.light_link) > 6:
                raise file.fault(f"connection {way.name}: linkIndex is {way.light_link[:20]!r}, expected a number")
            by_light[way.light][int(way.light_link)].append(way)
    programs: dict[str, list[SignalProgram]] = defaultdict(list)
    tagged: set[str] = set()
    for each in file.programs:
        programs[each.id].append(each.program)
        if each.conditions:
            tagged.add(each.id)
    notes: list[str] = []
    found: list[SourceSignal] = []
    for light, links in by_light.items():
        good = [
            _parameters(file, light, each, notes) for each in programs[light] if _usable(light, each, max(links), notes)
        ]
        if not programs[light]:
            notes.append(f"Traffic light {light}: the file holds no program; it got one of ours.")
        if light in tagged and good:
            notes.append(f"Traffic light {light}: its own switching conditions are left out.")
        count = max((each.links for each in good), default=max(links) + 1)
        names = {index: light_name(members[0]) for index, members in links.items()}
        direct = {
            names[index]: frozenset((way.from_lane, way.to_lane) for way in members)
            for index, members in links.items()
            if not any(way.via for way in members)
        }
        found.append(SourceSignal(light, tuple(names.get(k, "") for k in range(count)), tuple(good), ways=direct))
    return tuple(found), tuple(notes)


def _usable(light: str, program: SignalProgram, last: int, notes: list[str]) -> bool:
    """Whether SUMO can run a program whose links go up to `last`; else there is a note."""
    states = [phase.state for phase in program.phases]
    if program.kind not in _RUNNING:
        reason = f"programs of the type {program.kind} are not carried over"
    elif not states or program.cycle_s <= 0.0 or any(phase.duration_s < 0.0 for phase in program.phases):
        reason = "its phases take no time"
    elif len(set(map(len, states))) > 1 or len(states[0]) <= last:
        reason = "its states are of different lengths, or shorter than its links"
    elif set("".join(states)) - LETTERS:
        reason = "its states hold letters that SUMO does not know"
    elif any(place >= len(states) for phase in program.phases for place in phase.next):
        reason = "a phase leads to one that does not exist"
    else:
        return True
    notes.append(f"Traffic light {light}, program {program.id}: left out, {reason}.")
    return False


def _parameters(file: NetworkFile, light: str, program: SignalProgram, notes: list[str]) -> SignalProgram:
    """The program without parameters that lead out of the network, or name lanes that are called otherwise here."""
    bound = [key for key in program.parameters if key in file.lanes]
    if bound:
        notes.append(f"Traffic light {light}, program {program.id}: SUMO places its detectors, not the file.")
    kept = {key: text for key, text in program.parameters.items() if key not in _NEEDLESS and key not in bound}
    return replace(program, parameters=kept)


def without_trains(file: NetworkFile, ways: Iterable[FileConnection]) -> tuple[list[FileConnection], tuple[str, ...]]:
    """The ways without the lights that only trains switch, and a note about these."""
    crossings = [junction for junction in file.junctions if junction.kind in _TRAINS]
    before = {lane for junction in crossings for lane in junction.incoming}
    ways = [replace(way, light="") if way.light and way.from_lane in before else way for way in ways]
    closed = len({way.from_lane for way in ways} & before)
    return ways, (f"{closed} lanes lead over level crossings: no trains, so always open.",) if closed else ()


def junctions_of(
    file: NetworkFile, ways: Iterable[FileConnection], with_lane: Container[str]
) -> tuple[SourceJunction, ...]:
    """Who yields to whom; `with_lane` are the first internal lanes that became lanes of the map."""
    wanted = {(way.from_lane, way.to_lane): way for way in ways}
    found: list[SourceJunction] = []
    for junction, links in file.links():
        mine = {k: wanted[key] for k, each in enumerate(links) if (key := (each.from_lane, each.to_lane)) in wanted}
        if mine:
            found.append(_junction(file, junction, mine, with_lane))
    return tuple(found)


def _junction(
    file: NetworkFile, junction: FileJunction, ways: Mapping[int, FileConnection], with_lane: Container[str]
) -> SourceJunction:
    lawless = junction.kind in LAWLESS
    try:
        foes, yields = (
            (frozenset[tuple[int, int]](),) * 2
            if lawless
            else (_pairs(rows, ways) for rows in (junction.foes, junction.yields))
        )
    except (KeyError, ValueError) as error:
        raise file.fault(f"junction {junction.id[:40]!r}: its right of way cannot be read ({error})") from None
    return SourceJunction(
        id=junction.id,
        kind=junction.kind,
        ways=tuple(
            SourceWay(
                (way.via,) if way.via in with_lane else (way.from_lane, way.to_lane), "" if lawless else way.state
            )
            for way in ways.values()
        ),
        yields=yields & foes,
        foes=None if lawless or not junction.foes else foes | {(b, a) for a, b in foes},
    )


def _pairs(rows: Mapping[int, frozenset[int]], ways: Mapping[int, FileConnection]) -> frozenset[tuple[int, int]]:
    """Pairs of some links, by their places among these."""
    place = {link: k for k, link in enumerate(ways)}
    return frozenset((k, place[other]) for link, k in place.items() for other in rows.get(link, ()) if other in place)
