"""Vehicle-type files: the background's vehicles and how they drive, drawn one by one and handed to SUMO."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from hashlib import blake2b
from pathlib import Path
from typing import Any, Final
from xml.sax.saxutils import quoteattr
from zlib import crc32

import numpy as np

from interplan_sumo.errors import UnknownNameError, VehicleTypeError
from interplan_sumo.resources import routes_root
from interplan_sumo.simulation.vehicle_type_effects import WITHHELD
from interplan_sumo.simulation.vehicle_type_reader import SWERVE, VehicleTypeElement, read_document

ENTRY = "traffic"
"""The one vType or vTypeDistribution that agents are drawn from."""
DECIMALS: Final = 4
"""Of a number that is drawn; SUMO rounds speed factors to as many."""
SLOW_MPS: Final = 7.0
"""25 km/h: cyclists and tractors."""
FASTEST_MPS: Final = 200 / 3.6
"""What SUMO takes for a car's maxSpeed."""

CLASSES: Final[Mapping[str, Mapping[str, float]]] = {
    "bus": {"length": 12.0, "width": 2.5, "accel": 1.2, "decel": 4.0, "emergencyDecel": 7.0, "maxSpeed": 100 / 3.6},
    "coach": {"length": 14.0, "width": 2.6, "accel": 2.0, "decel": 4.0, "emergencyDecel": 7.0, "maxSpeed": 100 / 3.6},
    "delivery": {"length": 6.5, "width": 2.16},
    "emergency": {"length": 6.5, "width": 2.16},
    "truck": {"length": 7.1, "width": 2.4, "accel": 1.3, "decel": 4.0, "emergencyDecel": 7.0, "maxSpeed": 130 / 3.6},
    "trailer": {"length": 16.5, "width": 2.55, "accel": 1.1, "decel": 4.0, "emergencyDecel": 7.0,
                "maxSpeed": 130 / 3.6},
    "motorcycle": {"length": 2.2, "width": 0.9, "accel": 6.0, "decel": 10.0, "emergencyDecel": 10.0},
    "moped": {"length": 2.1, "width": 0.78, "accel": 1.1, "decel": 7.0, "emergencyDecel": 10.0, "maxSpeed": 60 / 3.6},
    "bicycle": {"length": 1.6, "width": 0.65, "minGap": 0.5, "accel": 1.2, "decel": 3.0, "emergencyDecel": 7.0,
                "maxSpeed": 50 / 3.6, "desiredMaxSpeed": 20 / 3.6},
    "scooter": {"length": 1.2, "width": 0.5, "minGap": 0.5, "accel": 1.2, "decel": 3.0, "emergencyDecel": 7.0,
                "maxSpeed": 25 / 3.6, "desiredMaxSpeed": 20 / 3.6},
}  # fmt: skip
"""What SUMO 1.28 takes for attributes that a type of one of these classes leaves out, where that is not a car's."""
CLASS_OF_KIND: Final[Mapping[str, str]] = {
    "car": "passenger", "truck": "truck", "bus": "bus", "motorcycle": "motorcycle",
}  # fmt: skip
"""SUMO's vehicle class of each kind of vehicle that a scenario can place."""


@dataclass(frozen=True, slots=True)
class VehicleType:
    """One vehicle and its driver: what the reaction layer computes with, in numbers. SUMO reads the rest itself."""

    id: str
    length_m: float = 5.0
    width_m: float = 1.8
    height_m: float = 1.5
    tau_s: float = 1.0
    min_gap_m: float = 2.5
    accel_mps2: float = 2.6
    decel_mps2: float = 4.5
    emergency_decel_mps2: float = 9.0
    max_speed_mps: float = FASTEST_MPS
    """The lower one of what it can drive and what its driver wants where there is no limit."""
    speed_factor: float = 1.0
    vehicle_class: str = "passenger"
    react_overlap: float = 0.0
    """Share of the ego's box inside the driver's lane from which the driver reacts, 0 to 1."""
    anticipation_s: float = 0.0
    """Also reacts to the ego's box swept ahead at constant velocity for this long."""
    swerve: bool = False
    """Whether the driver may change lane because of an ego that straddles two lanes."""
    reaction_time_s: float = 0.0
    """From the condition to the first response to the ego, 0 to 2."""
    courtesy: float = 0.0
    """Probability, per encounter, to open a gap for an ego that moves towards the driver's lane, 0 to 1."""
    relaxation_s: float = 0.0
    """Time constant with which the headway, short after somebody cut in, returns to `tau_s`, 0 to 30; 0: at once."""
    car_following_model: str = "Krauss"
    """SUMO's name."""
    left_m: float = 0.0
    """How far to the left of the middle of its lane it keeps."""
    drawn_from: str = ""
    """The file's type, where this one has numbers of its own."""
    drawn: tuple[tuple[str, float], ...] = ()
    """Those numbers, by SUMO's attribute or by parameter."""

    @property
    def is_slow(self) -> bool:
        """Whether a scenario placed it to be in the way of others."""
        return self.max_speed_mps <= SLOW_MPS

    @property
    def name(self) -> str:
        """Under which its behaviour is reported: what the file calls it."""
        return self.drawn_from or self.id


@dataclass(frozen=True)
class VehicleTypes:
    """A checked vehicle-type file."""

    path: Path
    members: tuple[VehicleType, ...]
    """What `traffic` stands for: one type, or the members of the distribution, at the medians of their spreads."""
    probabilities: tuple[float, ...]
    others: tuple[VehicleType, ...]
    """Types that `traffic` does not name."""
    warnings: tuple[str, ...]
    """What stands in the file and cannot act here, one line each."""
    elements: Mapping[str, VehicleTypeElement]
    """All types as they stand in the file."""

    def draw(self, rng: np.random.Generator) -> VehicleType:
        """One vehicle, its type by probability, its numbers from the type's distributions.

        One draw from `rng` whatever the file, so that files can be compared. SUMO
        knows only vehicles that were drawn before it started.
        """
        return self._drawn(self.members, self.probabilities, rng)

    def draw_kind(self, kind: str, rng: np.random.Generator) -> VehicleType:
        """One vehicle of a kind, by probability; VehicleTypeError if there is none."""
        wanted = CLASS_OF_KIND[kind]
        pairs = zip(self.members, self.probabilities, strict=True)
        able = [(member, share) for member, share in pairs if member.vehicle_class == wanted and share > 0.0]
        if not able:
            raise VehicleTypeError(
                f'{self.path}: no vType that {ENTRY!r} stands for is a {kind} (vClass="{wanted}"), but the scenario '
                f"places one; add one to the file, or pass another file with --traffic"
            )
        members, shares = zip(*able, strict=True)
        return self._drawn(members, shares, rng)

    def _drawn(self, members: Sequence[VehicleType], shares: Sequence[float], rng: np.random.Generator) -> VehicleType:
        share = rng.random()
        return _spread(self.elements[_member_at(members, shares, share * sum(shares)).id], share)

    def sumo_document(
        self,
        drawn: Iterable[VehicleType] = (),
        *,
        besides: frozenset[str] = frozenset(),
        others: Iterable[VehicleTypeElement] = (),
    ) -> str:
        """The file for SUMO: plain numbers only, its own types and those drawn, from it or from `others`.

        Left out is what nothing here reads, but for attributes named in `besides`.
        """
        withheld = WITHHELD - besides
        elements = {**{each.id: each for each in others}, **self.elements}
        known = {each.id: each for each in (*self.members, *self.others)}
        known.update((each.id, each) for each in drawn)
        lines = [_sumo_type(elements[each.name], each, withheld) for each in known.values()]
        return "\n".join(('<?xml version="1.0" encoding="UTF-8"?>', "<additional>", *lines, "</additional>", ""))


def _member_at(members: Sequence[VehicleType], shares: Sequence[float], at: float) -> VehicleType:
    for member, share in zip(members, shares, strict=True):
        at -= share
        if at < 0.0:
            return member
    return members[-1]


def _spread(element: VehicleTypeElement, share: float) -> VehicleType:
    """One vehicle of a type. Each number depends on `share`, 0 to 1, and its own name only.

    So a change to one distribution leaves all other numbers as they are.
    """
    if not element.spreads:
        return _vehicle_type(element, {})
    at = int(share * 2**53)
    drawn = {
        key: round(spread.quantile(np.random.default_rng((at, crc32(key.encode()))).random()), DECIMALS)
        for key, spread in element.spreads.items()
    }
    mark = blake2b(repr(sorted(drawn.items())).encode(), digest_size=6).hexdigest()
    numbers = tuple(sorted(drawn.items()))
    return replace(_vehicle_type(element, drawn), id=f"{element.id}~{mark}", drawn_from=element.id, drawn=numbers)


def _sumo_type(element: VehicleTypeElement, driver: VehicleType, withheld: frozenset[str]) -> str:
    numbers = dict(driver.drawn) or _middle(element)
    values = {key: text for key, text in element.attributes.items() if key not in withheld}
    values.update((key, repr(value)) for key, value in numbers.items() if not key.startswith("interplan."))
    if "speedFactor" in element.spreads:
        values["speedDev"] = "0"
    text = " ".join(f"{key}={quoteattr(text)}" for key, text in {**values, "id": driver.id}.items())
    own = {key: text for key, text in element.parameters.items() if not key.startswith("interplan.")}
    inner = "".join(f"<param key={quoteattr(key)} value={quoteattr(text)}/>" for key, text in own.items())
    return f"    <vType {text}>{inner}</vType>" if inner else f"    <vType {text}/>"


def _middle(element: VehicleTypeElement) -> dict[str, float]:
    """The numbers in the middle of a type's distributions."""
    return {key: round(spread.quantile(0.5), DECIMALS) for key, spread in element.spreads.items()}


def vehicle_type_file(behaviour: str) -> Path:
    """The shipped file of a behaviour; UnknownNameError if there is none."""
    path = routes_root() / f"{behaviour}.xml"
    if not path.is_file() or not re.fullmatch(r"\w+", behaviour):
        raise UnknownNameError("behaviour", behaviour, (p.stem for p in routes_root().glob("*.xml")))
    return path


def read_vehicle_types(path: Path) -> VehicleTypes:
    """Read and check a file; VehicleTypeError names the file and the line. Cached until the file changes."""
    try:
        stat = path.stat()
    except OSError:
        raise VehicleTypeError(f"no vehicle-type file at {path}") from None
    return _read(path, stat.st_mtime_ns, stat.st_size)


@lru_cache(maxsize=64)
def _read(path: Path, _mtime_ns: int, _size: int) -> VehicleTypes:
    document = read_document(path)
    types = {name: _vehicle_type(element, _middle(element)) for name, element in document.types.items()}
    if ENTRY in types:
        members: Mapping[str, float] = {ENTRY: 1.0}
    elif ENTRY in document.distributions:
        members = document.distributions[ENTRY]
    else:
        raise VehicleTypeError(f"{path}: no vType or vTypeDistribution with id {ENTRY!r}, which agents are drawn from")
    if sum(members.values()) <= 0.0:
        raise VehicleTypeError(f"{path}: the vTypeDistribution {ENTRY!r} has no member with a probability")
    return VehicleTypes(
        path,
        tuple(types[name] for name in members),
        tuple(members.values()),
        tuple(each for name, each in types.items() if name not in members),
        document.warnings,
        document.types,
    )


_FIELDS: Final[Mapping[str, str]] = {
    "length": "length_m", "width": "width_m", "tau": "tau_s", "minGap": "min_gap_m", "accel": "accel_mps2",
    "decel": "decel_mps2", "emergencyDecel": "emergency_decel_mps2", "maxSpeed": "max_speed_mps",
    "speedFactor": "speed_factor", "interplan.reactOverlap": "react_overlap",
    "interplan.anticipation": "anticipation_s", "interplan.reactionTime": "reaction_time_s",
    "interplan.courtesy": "courtesy", "interplan.relaxation": "relaxation_s",
}  # fmt: skip


def _vehicle_type(element: VehicleTypeElement, drawn: Mapping[str, float]) -> VehicleType:
    """A type with the numbers that distributions stand for."""
    kind = element.attributes.get("vClass", "passenger")
    numbers: dict[str, float] = {**CLASSES.get(kind, {}), **dict(_plain_numbers(element)), **drawn}
    if "speedFactor" in numbers:
        numbers["speedFactor"] = round(numbers["speedFactor"], DECIMALS)
    fields: dict[str, Any] = {_FIELDS[key]: value for key, value in numbers.items() if key in _FIELDS}
    if "desiredMaxSpeed" in numbers:
        desired_mps = numbers["desiredMaxSpeed"] * numbers.get("speedFactor", 1.0)
        fields["max_speed_mps"] = min(numbers.get("maxSpeed", FASTEST_MPS), desired_mps)
    return VehicleType(
        element.id,
        **fields,
        vehicle_class=kind,
        swerve=element.parameters.get(SWERVE) == "true",
        car_following_model=element.model,
    )


def _plain_numbers(element: VehicleTypeElement) -> Iterator[tuple[str, float]]:
    for key, text in (*element.attributes.items(), *element.parameters.items()):
        if key in (*_FIELDS, "desiredMaxSpeed") and key not in element.spreads:
            yield key, float(text)
