"""Vehicle-type files: the background's vehicles and how they drive, checked before SUMO sees the file."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import lru_cache
from pathlib import Path
from typing import Any, Final
from xml.sax import SAXParseException
from xml.sax.handler import ContentHandler

import defusedxml
import defusedxml.sax
import numpy as np

from interplan_sumo.errors import UnknownNameError, VehicleTypeError
from interplan_sumo.resources import routes_root

ENTRY = "traffic"
"""The one vType or vTypeDistribution that agents are drawn from."""

# Lowest and highest sensible value of what we or IDM compute with; SUMO itself accepts nearly anything.
NUMBERS: Final[Mapping[str, tuple[float, float]]] = {
    "length": (0.5, 30.0), "width": (0.3, 4.0), "height": (0.3, 5.0), "minGap": (0.0, 20.0), "maxSpeed": (0.1, 100.0),
    "speedFactor": (0.1, 3.0), "speedDev": (0.0, 1.0), "probability": (0.0, 1e9), "accel": (0.1, 15.0),
    "decel": (0.1, 15.0), "emergencyDecel": (0.1, 20.0), "apparentDecel": (0.1, 20.0), "tau": (0.1, 10.0),
    "delta": (0.1, 20.0), "sigma": (0.0, 1.0), "impatience": (-1.0, 1.0), "desiredMaxSpeed": (0.1, 100.0),
    "actionStepLength": (0.1, 10.0), "stepping": (0.01, 1.0), "collisionMinGapFactor": (0.0, 10.0),
    "minGapLat": (0.0, 10.0), "maxSpeedLat": (0.0, 10.0), "startupDelay": (0.0, 10.0),
}  # fmt: skip
OTHER_ATTRIBUTES: Final = frozenset(
    "id vClass color carFollowModel laneChangeModel latAlignment guiShape imgFile emissionClass vTypes probabilities "
    "tauLast apparentDecel cognitiveModel loadingDuration boardingDuration personCapacity containerCapacity "
    "personNumber containerNumber speedFactorPremature osgFile carriageLength locomotiveLength carriageGap "
    "deterministic seed".split()
)
PREFIXES: Final = ("lc", "jm", "cf")
"""Lane-change, junction and car-following attributes, which SUMO checks itself."""
PARAMETERS: Final[Mapping[str, tuple[float, float]]] = {
    "interplan.reactOverlap": (0.0, 1.0),
    "interplan.anticipation": (0.0, 3.0),
    "interplan.reactionTime": (0.0, 2.0),
    "interplan.courtesy": (0.0, 1.0),
    "interplan.relaxation": (0.0, 30.0),
}


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
                "maxSpeed": 50 / 3.6},
}  # fmt: skip
"""What SUMO 1.28 takes for attributes that a type of one of these classes leaves out, where that is not a car's."""
CLASS_OF_KIND: Final[Mapping[str, str]] = {
    "car": "passenger", "truck": "truck", "bus": "bus", "motorcycle": "motorcycle",
}  # fmt: skip
"""SUMO's vehicle class of each kind of vehicle that a scenario can place."""


@dataclass(frozen=True, slots=True)
class VehicleType:
    """One driver-and-vehicle type, with what the reaction layer computes with. SUMO reads the rest itself."""

    id: str
    length_m: float = 5.0
    width_m: float = 1.8
    tau_s: float = 1.0
    min_gap_m: float = 2.5
    accel_mps2: float = 2.6
    decel_mps2: float = 4.5
    emergency_decel_mps2: float = 9.0
    max_speed_mps: float = 200 / 3.6
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


@dataclass(frozen=True)
class VehicleTypes:
    """A checked vehicle-type file."""

    path: Path
    members: tuple[VehicleType, ...]
    """What `traffic` stands for: one type, or the members of the distribution."""
    probabilities: tuple[float, ...]
    others: tuple[VehicleType, ...] = field(default=())
    """Types that `traffic` does not name."""

    def draw(self, rng: np.random.Generator) -> VehicleType:
        """One member, by probability; one draw from `rng` whatever the file, so that files can be compared."""
        return _drawn(self.members, self.probabilities, rng)

    def draw_kind(self, kind: str, rng: np.random.Generator) -> VehicleType:
        """One member of a kind of vehicle, by probability; VehicleTypeError if there is none."""
        wanted = CLASS_OF_KIND[kind]
        pairs = zip(self.members, self.probabilities, strict=True)
        able = [(member, share) for member, share in pairs if member.vehicle_class == wanted and share > 0.0]
        if not able:
            raise VehicleTypeError(
                f'{self.path}: no vType that {ENTRY!r} stands for is a {kind} (vClass="{wanted}"), but the scenario '
                f"places one; add one to the file, or pass another file with --traffic"
            )
        members, shares = zip(*able, strict=True)
        return _drawn(members, shares, rng)


def _drawn(members: Sequence[VehicleType], shares: Sequence[float], rng: np.random.Generator) -> VehicleType:
    at = rng.random() * sum(shares)
    for member, share in zip(members, shares, strict=True):
        at -= share
        if at < 0.0:
            return member
    return members[-1]


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
    reader = _Reader(path)
    try:
        defusedxml.sax.parse(str(path), reader)
    except SAXParseException as error:
        raise VehicleTypeError(
            f"{path}, line {error.getLineNumber()}: not well-formed XML: {error.getMessage()}"
        ) from None
    except (defusedxml.DefusedXmlException, OSError, UnicodeError) as error:
        raise VehicleTypeError(f"{path}: cannot be read: {error}") from None
    return reader.result()


class _Reader(ContentHandler):
    """Collects types and distributions, with line numbers for the errors."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path
        self._locator: Any = None
        self._types: dict[str, dict[str, Any]] = {}
        self._distributions: dict[str, dict[str, float]] = {}
        self._open_type: str | None = None
        self._open_distribution: str | None = None

    def setDocumentLocator(self, locator: Any) -> None:  # noqa: N802 - the name is sax's
        self._locator = locator

    def _error(self, message: str) -> VehicleTypeError:
        line = self._locator.getLineNumber() if self._locator is not None else "?"
        return VehicleTypeError(f"{self._path}, line {line}: {message}")

    def _number(self, name: str, text: str, lowest: float, highest: float) -> float:
        try:
            value = float(text)
        except ValueError:
            raise self._error(f"{name} is {text!r}, expected a number") from None
        if not lowest <= value <= highest:
            raise self._error(f"{name} is {text}, expected {lowest:g} to {highest:g}")
        return value

    def startElement(self, name: str, attrs: Any) -> None:  # noqa: N802 - the name is sax's
        values: dict[str, str] = dict(attrs.items())
        if name == "vType":
            self._start_type(values)
        elif name == "vTypeDistribution":
            self._start_distribution(values)
        elif name == "param":
            self._parameter(values)
        elif name not in ("additional", "routes"):
            raise self._error(
                f"<{name}> does not belong in a vehicle-type file; it holds vType, vTypeDistribution and param"
            )

    def endElement(self, name: str) -> None:  # noqa: N802 - the name is sax's
        if name == "vType":
            self._open_type = None
        elif name == "vTypeDistribution":
            self._open_distribution = None

    def _start_type(self, values: dict[str, str]) -> None:
        type_id = values.get("id", "")
        if not type_id:
            raise self._error("a vType needs an id")
        if type_id in self._types or type_id in self._distributions:
            raise self._error(f"the id {type_id!r} is used twice")
        if type_id.startswith("interplan_"):
            raise self._error(f"the id {type_id!r} is taken; ids must not begin with interplan_")
        numbers: dict[str, Any] = {}
        for key, text in values.items():
            if key in NUMBERS:
                numbers[key] = self._number(key, text, *NUMBERS[key])
            elif key not in OTHER_ATTRIBUTES and not key.startswith(PREFIXES):
                near = get_close_matches(key, (*NUMBERS, *OTHER_ATTRIBUTES), n=1)
                guess = f"; did you mean {near[0]!r}?" if near else ""
                raise self._error(f"vType {type_id!r} has an unknown attribute {key!r}{guess}")
        numbers["vClass"] = values.get("vClass", "passenger")
        if "carFollowModel" in values:
            numbers["carFollowModel"] = values["carFollowModel"]
        self._types[type_id] = numbers
        self._open_type = type_id
        if self._open_distribution is not None:
            self._distributions[self._open_distribution][type_id] = numbers.get("probability", 1.0)

    def _start_distribution(self, values: dict[str, str]) -> None:
        name = values.get("id", "")
        if not name or name in self._distributions or name in self._types:
            raise self._error(f"a vTypeDistribution needs an id of its own, got {name!r}")
        listed = values.get("vTypes", "").split()
        weights = [self._number("probabilities", p, 0.0, 1e9) for p in values.get("probabilities", "").split()]
        if weights and len(weights) != len(listed):
            raise self._error(f"vTypeDistribution {name!r} has {len(listed)} vTypes and {len(weights)} probabilities")
        for member in listed:
            if member not in self._types:
                raise self._error(f"vTypeDistribution {name!r} names the vType {member!r}, which is not defined above")
        default = [self._types[m].get("probability", 1.0) for m in listed]
        self._distributions[name] = dict(zip(listed, weights or default, strict=True))
        self._open_distribution = name

    def _parameter(self, values: dict[str, str]) -> None:
        key, text = values.get("key", ""), values.get("value", "")
        if self._open_type is None:
            raise self._error("a param belongs inside a vType")
        if key in PARAMETERS:
            self._types[self._open_type][key] = self._number(key, text, *PARAMETERS[key])
        elif key == "interplan.swerve":
            if text not in ("true", "false"):
                raise self._error(f"interplan.swerve is {text!r}, expected true or false")
            self._types[self._open_type][key] = text == "true"
        elif key.startswith("interplan."):
            near = get_close_matches(key, (*PARAMETERS, "interplan.swerve"), n=1)
            guess = f"; did you mean {near[0]!r}?" if near else ""
            raise self._error(f"unknown parameter {key!r}{guess}")

    def result(self) -> VehicleTypes:
        """What was read; VehicleTypeError if there is no entry `traffic`, or an empty one."""
        types = {name: _vehicle_type(name, numbers) for name, numbers in self._types.items()}
        if ENTRY in types:
            members = {ENTRY: 1.0}
        elif ENTRY in self._distributions:
            members = self._distributions[ENTRY]
        else:
            raise VehicleTypeError(
                f"{self._path}: no vType or vTypeDistribution with id {ENTRY!r}, which agents are drawn from"
            )
        if sum(members.values()) <= 0.0:
            raise VehicleTypeError(f"{self._path}: the vTypeDistribution {ENTRY!r} has no member with a probability")
        return VehicleTypes(
            self._path,
            tuple(types[m] for m in members),
            tuple(members.values()),
            tuple(t for name, t in types.items() if name not in members),
        )


def _vehicle_type(name: str, numbers: Mapping[str, Any]) -> VehicleType:
    names = {
        "length": "length_m", "width": "width_m", "tau": "tau_s", "minGap": "min_gap_m", "accel": "accel_mps2",
        "decel": "decel_mps2", "emergencyDecel": "emergency_decel_mps2", "maxSpeed": "max_speed_mps",
        "speedFactor": "speed_factor", "vClass": "vehicle_class", "interplan.reactOverlap": "react_overlap",
        "interplan.anticipation": "anticipation_s", "interplan.swerve": "swerve",
        "interplan.reactionTime": "reaction_time_s", "interplan.courtesy": "courtesy",
        "interplan.relaxation": "relaxation_s", "carFollowModel": "car_following_model",
    }  # fmt: skip
    known: dict[str, Any] = {**CLASSES.get(numbers["vClass"], {}), **numbers}
    return VehicleType(name, **{names[key]: value for key, value in known.items() if key in names})
