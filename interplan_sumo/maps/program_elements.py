"""Signal programs as SUMO writes them: <tlLogic> elements, read and written."""

from __future__ import annotations

import math
from xml.etree.ElementTree import Element, SubElement

from interplan_sumo.maps.signal_program import SignalPhase, SignalProgram

_OWN = frozenset(("duration", "state", "minDur", "maxDur", "next", "name"))
_MOST_PHASES = 10_000


def program_of(element: Element) -> SignalProgram:
    """The program of a <tlLogic>; ValueError says in a few words what is wrong with it."""
    phases = element.findall("phase")
    if len(phases) > _MOST_PHASES:
        raise ValueError(f"has {len(phases)} phases, at most {_MOST_PHASES} can be used")
    offset = element.get("offset", "0")
    return SignalProgram(
        id=element.get("programID", "0"),
        phases=tuple(map(_phase, phases)),
        offset_s=0.0 if offset == "begin" else _seconds("offset", offset),
        kind=element.get("type", "static"),
        parameters={each.get("key", ""): each.get("value", "") for each in element.iterfind("param")},
    )


def program_element(light: str, program: SignalProgram) -> Element:
    """The <tlLogic> of one program of a traffic light."""
    head = {"id": light, "type": program.kind, "programID": program.id, "offset": _text(program.offset_s)}
    element = Element("tlLogic", head)
    for phase in program.phases:
        given: dict[str, str] = {"duration": _text(phase.duration_s), "state": phase.state}
        for name, seconds in (("minDur", phase.min_s), ("maxDur", phase.max_s)):
            if seconds is not None:
                given[name] = _text(seconds)
        if phase.name:
            given["name"] = phase.name
        if phase.next:
            given["next"] = " ".join(map(str, phase.next))
        SubElement(element, "phase", {**given, **phase.more})
    for key, value in program.parameters.items():
        SubElement(element, "param", {"key": key, "value": value})
    return element


def _phase(element: Element) -> SignalPhase:
    least, most = (
        None if (text := element.get(name)) is None else _seconds(name, text) for name in ("minDur", "maxDur")
    )
    return SignalPhase(
        duration_s=_seconds("duration", element.get("duration", "")),
        state=element.get("state", ""),
        min_s=least,
        max_s=most,
        next=tuple(_place(text) for text in element.get("next", "").split()),
        name=element.get("name", ""),
        more={name: text for name, text in element.attrib.items() if name not in _OWN},
    )


def _place(text: str) -> int:
    if not text.isdecimal() or len(text) > 6:
        raise ValueError(f"next is {text[:20]!r}, expected numbers of phases")
    return int(text)


def _seconds(what: str, text: str) -> float:
    """Seconds, which SUMO also writes as 1:30:00 and the like."""
    try:
        value = 0.0
        for part in text.split(":"):
            value = value * 60.0 + float(part)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{what} is {text[:20]!r}, expected a number")
    return value


def _text(seconds: float) -> str:
    """As short as it can be written, to the millisecond of SUMO's clock."""
    return f"{seconds:.3f}".rstrip("0").rstrip(".")
