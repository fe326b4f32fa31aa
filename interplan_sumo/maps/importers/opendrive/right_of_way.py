"""Controllers and priorities of OpenDRIVE junctions: which lights are green together, and who goes first."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from itertools import product

from interplan_sumo.maps.importers.opendrive.controls import Controls
from interplan_sumo.maps.importers.opendrive.elements import XodrFile, XodrJunction, by_signal
from interplan_sumo.maps.importers.opendrive.travel import Network
from interplan_sumo.maps.importers.source import SourceJunction, SourceSignal, SourceWay
from interplan_sumo.maps.signal_program import SignalPhase, SignalProgram
from interplan_sumo.maps.signals_plan import ALL_RED_S, YELLOW_S

GREEN_S = 20.0
"""OpenDRIVE knows no times."""


def signals_of(
    file: XodrFile, network: Network, controls: Controls
) -> tuple[tuple[SourceSignal, ...], tuple[str, ...]]:
    """For each junction one program in which its controllers get green in turn, and what else is to be told of them.

    The signals of a controller change together; controllers follow in the order
    of their sequence numbers, then of the file. A junction with lights that no
    controller switches, or with a single controller, gets a program of ours.
    """
    controller_of = by_signal(file.controllers)
    order = {controller: number for number, controller in enumerate(file.controllers)}
    found: list[SourceSignal] = []
    other: list[str] = []
    taken: set[str] = set()
    for junction, lights in _lights(network, controls).items():
        stages: dict[str, list[str]] = defaultdict(list)
        for light in lights:
            stages[controller_of.get(light, "")].append(light)
        if taken & set(lights) or "" in stages or len(stages) < 2:
            other += [junction] if set(stages) != {""} else []
            continue
        taken |= set(lights)
        members = [stages[controller] for controller in sorted(stages, key=order.__getitem__)]
        name = re.sub(r"[^\w.-]", "_", junction)
        found.append(SourceSignal(name, tuple(lights), (_in_turn(lights, members),), tells_who_yields=False))
    notes: list[str] = []
    if found:
        said = f"each controller has {GREEN_S:g} s of green in turn, for the file knows no times"
        notes.append(f"At {len(found)} junctions, such as {found[0].id}, {said}.")
    if other:
        said = "have lights without a controller, or one controller for all: programs of ours"
        notes.append(f"{len(other)} junctions, such as {other[0]}, {said}.")
    return tuple(found), tuple(notes)


def _lights(network: Network, controls: Controls) -> dict[str, list[str]]:
    """Junction -> the lights that hold where one comes to it, or on the ways through it."""
    found: dict[str, dict[str, None]] = defaultdict(dict)
    for id_, lights in controls.lights_at_start.items():
        if junction := network.lanes[id_].stretch.road.junction:
            found[junction] |= lights
    for id_, lights in controls.lights_at_end.items():
        onward = (network.lanes[after].stretch.road.junction for after in network.lanes[id_].successors)
        for junction in dict.fromkeys(filter(None, onward)):
            found[junction] |= lights
    return {junction: list(lights) for junction, lights in found.items()}


def _in_turn(lights: Sequence[str], stages: Sequence[Sequence[str]]) -> SignalProgram:
    def phase(seconds: float, letter: str, shown: Sequence[str]) -> SignalPhase:
        return SignalPhase(seconds, "".join(letter if light in shown else "r" for light in lights))

    phases = (
        one
        for stage in stages
        for one in (phase(GREEN_S, "g", stage), phase(max(YELLOW_S), "y", stage), phase(max(ALL_RED_S), "r", ()))
    )
    return SignalProgram("0", tuple(phases))


# --- priorities ----------------------------------------------------------------------------------------


def junctions_of(file: XodrFile, network: Network) -> tuple[tuple[SourceJunction, ...], tuple[str, ...]]:
    """The junctions with priorities between ways that cars take, and a note about the other priorities."""
    entries: dict[str, list[str]] = defaultdict(list)
    for lane in network.lanes.values():
        road = lane.stretch.road
        if road.junction and not any(network.lanes[id_].stretch.road is road for id_ in lane.predecessors):
            entries[road.id].append(lane.id)
    found: list[SourceJunction] = []
    idle = 0
    for junction in file.junctions.values():
        pairs = [(low, high) for high, low in junction.priorities]
        told = [
            (late, first)
            for late, first in pairs
            if (first, late) not in pairs and all(_ways(junction, entries, road) for road in (late, first))
        ]
        idle += len(pairs) - len(told)
        if told:
            found.append(_junction(junction, entries, told))
    said = "name roads without lanes for cars, or contradict each other: they are not kept"
    return tuple(found), (f"{idle} priorities of junctions {said}.",) if idle else ()


def _ways(junction: XodrJunction, entries: Mapping[str, Sequence[str]], road: str) -> list[str]:
    """The lanes by which one enters a connecting road, or those of the connecting roads that leave an incoming one."""
    through = [each.connecting for each in junction.connections if each.incoming == road]
    mine = any(each.connecting == road for each in junction.connections)
    return list(dict.fromkeys(lane for id_ in ([road] if mine else through) for lane in entries.get(id_, ())))


def _junction(
    junction: XodrJunction, entries: Mapping[str, Sequence[str]], told: Sequence[tuple[str, str]]
) -> SourceJunction:
    place: dict[str, int] = {}
    for lane in (lane for pair in told for road in pair for lane in _ways(junction, entries, road)):
        place.setdefault(lane, len(place))

    def pairs() -> Iterator[tuple[int, int]]:
        for late, first in told:
            for one, other in product(_ways(junction, entries, late), _ways(junction, entries, first)):
                yield place[one], place[other]

    return SourceJunction(junction.id, "", tuple(SourceWay((lane,)) for lane in place), frozenset(pairs()))
