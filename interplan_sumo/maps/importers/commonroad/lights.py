"""CommonRoad's traffic light cycles as signal programs, one controller for the lights of an intersection."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element

from interplan_sumo.errors import MapError
from interplan_sumo.maps.importers.source import SourceLane, SourceSignal
from interplan_sumo.maps.junctions import Sets
from interplan_sumo.maps.signal_program import GREEN, SignalPhase, SignalProgram
from interplan_sumo.world.commonroad_frame import CommonRoadFile

_LETTERS = {"red": "r", "redYellow": "u", "green": "g", "yellow": "y", "inactive": "o"}
_TURNS = {
    "left": ("Left",), "straight": ("Straight",), "right": ("Right",),
    "leftStraight": ("Left", "Straight"), "straightRight": ("Straight", "Right"), "leftRight": ("Left", "Right"),
}  # fmt: skip
"""Direction of a light -> ends of the names of the elements that say where an incoming lanelet leads."""
_LONGEST_STEP_S = 10.0
_MOST_COLOURS = 200
_LONGEST_CYCLE_MS = 3_600_000


@dataclass(frozen=True, slots=True)
class _Cycle:
    """What one light shows, in milliseconds: SUMO's clock knows no less."""

    length_ms: int
    starts_ms: tuple[int, ...]
    letters: str

    def at(self, time_ms: int) -> str:
        """Its letter at a time after the start of the scenario."""
        for start_ms, letter in zip(reversed(self.starts_ms), reversed(self.letters), strict=True):
            if (time_ms - self.starts_ms[0]) % self.length_ms >= start_ms - self.starts_ms[0]:
                return letter
        return self.letters[0]


def signals_of(file: CommonRoadFile, lanes: Mapping[str, SourceLane], notes: list[str]) -> tuple[SourceSignal, ...]:
    """The controllers of the lights that lanes name; lights whose cycle cannot be used get a program of ours.

    Durations and offsets are time steps of the scenario, as commonroad-io reads
    them. Lights with a direction hold for the ways there only. The file does not
    say who yields to whom at green.
    """
    used = {light for lane in lanes.values() for light in (*lane.lights_at_start, *lane.lights_at_end)}
    if not used:
        return ()
    elements = {each.get("id", ""): each for each in file.parts.get("trafficLight", ())}
    cycles: dict[str, _Cycle] = {}
    faults: dict[str, list[str]] = defaultdict(list)
    for light in sorted(used & elements.keys()):
        try:
            cycles[light] = _cycle(file, elements[light])
        except (ValueError, MapError) as fault:
            faults[str(fault).removeprefix(f"{file.path}: ")[:80]].append(light)
    for why, lights in faults.items():
        more = f" and {len(lights) - 1} more" if len(lights) > 1 else ""
        notes.append(f"Traffic light {lights[0]}{more}: a program of ours, for {why}.")
    ways = _ways(file, lanes, elements)
    return tuple(_controllers(file, lanes, cycles, ways))


def _cycle(file: CommonRoadFile, element: Element) -> _Cycle:
    """The cycle of a light; ValueError says in a few words why it cannot be used."""
    colours = element.findall("cycle/cycleElement")
    if not colours:
        raise ValueError("the file gives it no cycle")
    if len(colours) > _MOST_COLOURS:
        raise ValueError(f"its cycle has {len(colours)} colours, at most {_MOST_COLOURS} can be used")
    step_s = _step_s(file)
    offset = element.find("cycle/timeOffset")
    offset_ms = 0 if offset is None else round(file.number(element, offset, "timeOffset") * step_s * 1000.0)
    starts, letters, at_ms = list[int](), "", 0
    for colour in colours:
        name = (colour.findtext("color") or "").strip()
        length_ms = round(file.number(element, colour.find("duration"), "duration") * step_s * 1000.0)
        if name not in _LETTERS or length_ms < 0:
            raise ValueError("its cycle holds a colour that CommonRoad does not know, or one for less than no time")
        if length_ms:
            starts.append(at_ms)
            letters += _LETTERS[name]
            at_ms += length_ms
    if not set(letters) & GREEN or at_ms > _LONGEST_CYCLE_MS:
        raise ValueError("its cycle holds no green, or lasts longer than an hour")
    return _Cycle(at_ms, tuple(offset_ms % at_ms + start for start in starts), letters)


def _step_s(file: CommonRoadFile) -> float:
    try:
        step_s = float(file.attributes.get("timeStepSize", ""))
    except ValueError:
        step_s = math.nan
    if not 0.0 < step_s <= _LONGEST_STEP_S:
        raise ValueError("the time step of the scenario is no time")
    return step_s


# --- which lights belong together ------------------------------------------------------------------------


def _ways(
    file: CommonRoadFile, lanes: Mapping[str, SourceLane], elements: Mapping[str, Element]
) -> dict[str, frozenset[tuple[str, str]]]:
    """Light with a direction -> the ways out of its lanes that lead there, and those that no light of them names."""
    leads: dict[str, dict[str, set[str]]] = defaultdict(lambda: defaultdict(set))
    for way_in in (each for crossing in file.parts.get("intersection", ()) for each in crossing.iterfind("incoming")):
        for turn in ("Left", "Straight", "Right"):
            onward = {each.get("ref", "") for each in way_in.iterfind(f"successors{turn}")}
            for lane in way_in.iterfind("incomingLanelet"):
                leads[lane.get("ref", "")][turn] |= onward
    found: dict[str, set[tuple[str, str]]] = defaultdict(set)
    for id_, lane in lanes.items():
        named = {
            light: {after for turn in turns for after in leads[id_][turn] if after in lane.successors}
            for light in lane.lights_at_end
            if light in elements and (turns := _TURNS.get((elements[light].findtext("direction") or "").strip()))
        }
        rest = set(lane.successors).difference(*named.values())
        for light, onward in named.items():
            found[light] |= {(id_, after) for after in onward | rest}
    return {light: frozenset(pairs) for light, pairs in found.items() if pairs}


def _controllers(
    file: CommonRoadFile,
    lanes: Mapping[str, SourceLane],
    cycles: Mapping[str, _Cycle],
    ways: Mapping[str, frozenset[tuple[str, str]]],
) -> Iterator[SourceSignal]:
    """Lights of one intersection whose cycles are of one length share a controller."""
    together = Sets()
    for crossing in file.parts.get("intersection", ()):
        held = [
            light
            for way_in in crossing.iterfind("incoming")
            for each in way_in
            if (lane := lanes.get(each.get("ref", "")))
            for light in (lane.lights_at_end if each.tag == "incomingLanelet" else lane.lights_at_start)
            if light in cycles
        ]
        for light in held[1:]:
            together.join(held[0], light)
    groups: dict[tuple[str, int], list[str]] = defaultdict(list)
    for light, cycle in cycles.items():
        groups[together.find(light), cycle.length_ms].append(light)
    for members in groups.values():
        own = {light: ways[light] for light in members if light in ways}
        program = _merged([cycles[light] for light in members])
        yield SourceSignal(members[0], tuple(members), (program,), tells_who_yields=False, ways=own)


def _merged(cycles: Sequence[_Cycle]) -> SignalProgram:
    """One program that shows what each of some lights of equal cycles shows, a letter each."""
    length_ms = cycles[0].length_ms
    cuts = sorted({start % length_ms for cycle in cycles for start in cycle.starts_ms})
    ends = (*cuts[1:], cuts[0] + length_ms)
    phases = (SignalPhase((end - start) / 1000.0, _state(cycles, start)) for start, end in zip(cuts, ends, strict=True))
    return SignalProgram("0", tuple(phases), offset_s=cuts[0] / 1000.0)


def _state(cycles: Iterable[_Cycle], time_ms: int) -> str:
    return "".join(cycle.at(time_ms) for cycle in cycles)
