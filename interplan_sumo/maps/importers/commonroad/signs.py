"""CommonRoad's traffic signs: which of them limit the speed, and which make one stop or yield."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

from interplan_sumo.world.commonroad_frame import CommonRoadFile
from interplan_sumo.world.roads import StopLineKind

# Ids of the countries' own catalogues, as CommonRoad 2020a names them.
_SPEED_LIMITS = frozenset(("274", "274.1", "R2-1", "R15", "C43", "B14", "B31", "3.24", "\u03a1-32", "r301", "R4-1"))
_KINDS = {
    "206": StopLineKind.STOP_SIGN, "R1-1": StopLineKind.STOP_SIGN, "R1-3": StopLineKind.STOP_SIGN,
    "r2": StopLineKind.STOP_SIGN,
    "205": StopLineKind.YIELD, "R1-2": StopLineKind.YIELD, "r1": StopLineKind.YIELD,
}  # fmt: skip
_VALUE = re.compile(r"\s*([0-9.]+(?:[eE][+-]?[0-9]+)?)\s*(kmh|km/h|mph|m/s)?\s*")
_MPS = {"kmh": 1.0 / 3.6, "km/h": 1.0 / 3.6, "mph": 0.44704, "m/s": 1.0}
HIGHEST_LIMIT_MPS = 45.0
"""No country signs more than 160 km/h; the format wants metres per second, and larger values were meant otherwise."""


@dataclass(slots=True)
class Signs:
    """The signs of a file by id."""

    limit_mps: dict[str, float] = field(default_factory=dict[str, float])
    kind: dict[str, StopLineKind] = field(default_factory=dict[str, StopLineKind])
    unusable_limits: int = 0

    def limit_of(self, ids: Iterable[str]) -> float | None:
        """The lowest limit among some signs."""
        return min((self.limit_mps[id_] for id_ in ids if id_ in self.limit_mps), default=None)

    def kind_of(self, ids: Iterable[str]) -> StopLineKind | None:
        """STOP_SIGN before YIELD, None where the signs are neither."""
        return min((self.kind[id_] for id_ in ids if id_ in self.kind), default=None)


def read_signs(file: CommonRoadFile) -> Signs:
    """All signs that matter to a driver's speed or right of way."""
    signs = Signs()
    for sign in file.parts.get("trafficSign", ()):
        id_ = sign.get("id", "")
        for element in sign.iterfind("trafficSignElement"):
            number = (element.findtext("trafficSignID") or "").strip()
            if number in _SPEED_LIMITS:
                _add_limit(signs, id_, element)
            elif number in _KINDS:
                signs.kind[id_] = min(_KINDS[number], signs.kind.get(id_, _KINDS[number]))
    return signs


def usable_limit_mps(text: str | None) -> float | None:
    """A speed as CommonRoad writes it, in m/s; km/h and mph where the text says so; None where it is no limit."""
    match = _VALUE.fullmatch(text or "")
    try:
        value = float(match[1]) * _MPS[match[2] or "m/s"] if match else math.nan
    except ValueError:
        return None
    return value if 0.0 < value <= HIGHEST_LIMIT_MPS else None


def _add_limit(signs: Signs, id_: str, element: Element) -> None:
    limit = usable_limit_mps(element.findtext("additionalValue"))
    if limit is None:
        signs.unusable_limits += 1
    else:
        signs.limit_mps[id_] = min(limit, signs.limit_mps.get(id_, limit))
