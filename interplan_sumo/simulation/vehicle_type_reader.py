"""Reads a vehicle-type file, checks it against SUMO's own schema, and says in which line it is wrong."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Final
from xml.sax import SAXParseException
from xml.sax.handler import ContentHandler

import defusedxml
import defusedxml.sax

from interplan_sumo.errors import VehicleTypeError
from interplan_sumo.simulation.number_distributions import NOTATION, NumberDistribution, parse_distribution
from interplan_sumo.simulation.vehicle_type_effects import (
    CANNOT_RUN,
    CLASSES_ON_ROADS,
    LANE_CHANGE_CANNOT_RUN,
    OTHER_CLASSES,
    car_following_models,
    idle_attributes,
)
from interplan_sumo.simulation.vehicle_type_schema import model_of_element, vehicle_type_schema

LARGEST_BYTES: Final = 4_000_000
"""A file of ten thousand types is smaller."""
LONGEST_ECHO: Final = 60
"""So much of a wrong text is repeated in the message."""

# Lowest and highest sensible value of what we or SUMO compute with; SUMO itself accepts nearly anything.
NUMBERS: Final[Mapping[str, tuple[float, float]]] = {
    "length": (0.5, 30.0), "width": (0.3, 4.0), "height": (0.3, 5.0), "minGap": (0.0, 20.0), "maxSpeed": (0.1, 100.0),
    "speedFactor": (0.1, 3.0), "speedDev": (0.0, 1.0), "probability": (0.0, 1e9), "accel": (0.1, 15.0),
    "decel": (0.1, 15.0), "emergencyDecel": (0.1, 20.0), "apparentDecel": (0.1, 20.0), "tau": (0.1, 10.0),
    "delta": (0.1, 20.0), "sigma": (0.0, 1.0), "impatience": (-1.0, 1.0), "desiredMaxSpeed": (0.1, 100.0),
    "actionStepLength": (0.1, 10.0), "stepping": (0.01, 1.0), "collisionMinGapFactor": (0.0, 10.0),
    "minGapLat": (0.0, 10.0), "maxSpeedLat": (0.01, 10.0), "startupDelay": (0.0, 10.0),
    "lcOvertakeDeltaSpeedFactor": (-1.0, 1.0), "jmStopSignWait": (0.0, 1e3), "jmAllwayStopWait": (0.0, 1e3),
}  # fmt: skip
PARAMETERS: Final[Mapping[str, tuple[float, float]]] = {
    "interplan.reactOverlap": (0.0, 1.0),
    "interplan.anticipation": (0.0, 3.0),
    "interplan.reactionTime": (0.0, 2.0),
    "interplan.courtesy": (0.0, 1.0),
    "interplan.relaxation": (0.0, 30.0),
}
SWERVE: Final = "interplan.swerve"
PROFILES: Final = ("maxAccelProfile", "desAccelProfile")
"""Accelerations at the speeds of `speedTable`."""
TRUTHS_AS_NUMBERS: Final = frozenset(["vehdynamics"])
"""True or false by the schema, and read as numbers by SUMO 1.28, which fails at its start at anything else."""
TRUE: Final = frozenset("1 yes true on x".split())
SPREAD: Final = (0.2, 2.0)
"""To these SUMO cuts the spread that speedDev gives to speedFactor."""


@dataclass(frozen=True, slots=True)
class VehicleTypeElement:
    """One vType as it stands in the file, its nested car-following element and its parameters included."""

    id: str
    line: int
    attributes: dict[str, str]
    parameters: dict[str, str] = field(default_factory=dict[str, str])
    spreads: dict[str, NumberDistribution] = field(default_factory=dict[str, NumberDistribution])
    """Of the attributes and parameters that a distribution stands for."""

    @property
    def model(self) -> str:
        """SUMO's name of its car-following model."""
        return self.attributes.get("carFollowModel", "Krauss")


@dataclass(frozen=True, slots=True)
class VehicleTypeDocument:
    """The vehicle types and distributions of a file, checked."""

    path: Path
    types: Mapping[str, VehicleTypeElement]
    distributions: Mapping[str, Mapping[str, float]]
    """Weights of the types in each vTypeDistribution."""
    warnings: tuple[str, ...]
    """What stands in it and cannot act, one line each."""


def read_document(path: Path) -> VehicleTypeDocument:
    """Read and check a file; VehicleTypeError names the file and the line."""
    reader = _Reader(path)
    try:
        with path.open("rb") as file:
            text = file.read(LARGEST_BYTES + 1)
        if len(text) > LARGEST_BYTES:
            raise VehicleTypeError(f"{path}: larger than {LARGEST_BYTES // 1_000_000} MB, no vehicle-type file is")
        defusedxml.sax.parseString(text, reader)
    except SAXParseException as error:
        raise VehicleTypeError(
            f"{path}, line {error.getLineNumber()}: not well-formed XML: {error.getMessage()}"
        ) from None
    except (defusedxml.DefusedXmlException, OSError, LookupError, UnicodeError) as error:
        raise VehicleTypeError(f"{path}: cannot be read: {error}") from None
    return reader.result()


class _Reader(ContentHandler):
    """Collects types and distributions, with line numbers for the errors."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path
        self._schema = vehicle_type_schema()
        self._locator: Any = None
        self._types: dict[str, VehicleTypeElement] = {}
        self._distributions: dict[str, dict[str, float]] = {}
        self._open_type: VehicleTypeElement | None = None
        self._open_distribution: str | None = None
        self._warned: dict[str, tuple[int, dict[str, None]]] = {}  # by reason: first line, attributes

    def setDocumentLocator(self, locator: Any) -> None:  # noqa: N802 - the name is sax's
        self._locator = locator

    def _line(self) -> int:
        return self._locator.getLineNumber() if self._locator is not None else 0

    def _error(self, message: str) -> VehicleTypeError:
        return VehicleTypeError(f"{self._path}, line {self._line()}: {message}")

    def startElement(self, name: str, attrs: Any) -> None:  # noqa: N802 - the name is sax's
        values: dict[str, str] = dict(attrs.items())
        if name == "vType":
            self._start_type(values)
        elif name == "vTypeDistribution":
            self._start_distribution(values)
        elif name == "param":
            self._parameter(values)
        elif (model := model_of_element(name)) is not None and self._open_type is not None:
            self._open_type.attributes["carFollowModel"] = model
            self._check(self._open_type, values)
        elif name not in ("additional", "routes"):
            raise self._error(
                f"<{_short(name)}> does not belong in a vehicle-type file; it holds vType, vTypeDistribution and param"
            )

    def endElement(self, name: str) -> None:  # noqa: N802 - the name is sax's
        if name == "vTypeDistribution":
            self._open_distribution = None
        elif name == "vType" and self._open_type is not None:
            self._finish(self._open_type)
            self._open_type = None

    def _start_type(self, values: dict[str, str]) -> None:
        reference = values.get("refId")
        if reference is not None and self._open_distribution is not None:
            if reference not in self._types:
                raise self._error(f"refId names the vType {_short(reference)!r}, which is not defined above")
            weight = self._types[reference].attributes.get("probability", "1")
            share = self._plain("probability", values.get("probability", weight), NUMBERS["probability"])
            self._distributions[self._open_distribution][reference] = share
            return
        type_id = values.get("id", "")
        if not type_id:
            raise self._error("a vType needs an id")
        if type_id in self._types or type_id in self._distributions:
            raise self._error(f"the id {_short(type_id)!r} is used twice")
        if type_id.startswith("interplan_"):
            raise self._error(f"the id {_short(type_id)!r} is taken; ids must not begin with interplan_")
        element = VehicleTypeElement(type_id, self._line(), {})
        self._check(element, values)
        self._types[type_id] = self._open_type = element
        if self._open_distribution is not None:
            self._distributions[self._open_distribution][type_id] = float(values.get("probability", 1.0))

    def _check(self, element: VehicleTypeElement, values: Mapping[str, str]) -> None:
        """Take over attributes of a vType, each checked for itself."""
        for name, text in values.items():
            kind = self._schema.attributes.get(name)
            if kind is None:
                guess = _guess(name, self._schema.attributes)
                raise self._error(f"vType {_short(element.id)!r} has an unknown attribute {_short(name)!r}{guess}")
            lowest, highest = NUMBERS.get(name) or (kind.bounds() if kind.is_number else (0.0, 0.0))
            drawn = kind.is_number and name not in ("probability", "speedDev")
            if not (drawn and self._spread(element, name, text, lowest, highest)):
                if name in NUMBERS and (_is_number(text) or not kind.takes(text)):
                    self._plain(name, text, NUMBERS[name])
                if not kind.takes(text):
                    also = f", or {NOTATION}" if drawn else ""
                    raise self._error(f"{name} is {_short(text)!r}, expected {kind.expected()}{also}")
            element.attributes[name] = str(int(text.lower() in TRUE)) if name in TRUTHS_AS_NUMBERS else text

    def _plain(self, name: str, text: str, bounds: tuple[float, float]) -> float:
        if not _is_number(text):
            raise self._error(f"{name} is {_short(text)!r}, expected a number")
        if not bounds[0] <= float(text) <= bounds[1]:
            raise self._error(f"{name} is {_short(text)}, expected {bounds[0]:g} to {bounds[1]:g}")
        return float(text)

    def _spread(self, element: VehicleTypeElement, name: str, text: str, lowest: float, highest: float) -> bool:
        """Whether a distribution stands for a number."""
        try:
            spread = parse_distribution(text)
            element.spreads.pop(name, None)  # of the vType, if its nested element says otherwise
            if spread is not None:
                element.spreads[name] = spread.within(lowest, highest)
        except ValueError as error:
            raise self._error(f"{name} is {_short(text)!r}: {error}") from None
        return spread is not None

    def _start_distribution(self, values: dict[str, str]) -> None:
        name = values.get("id", "")
        if not name or name in self._distributions or name in self._types:
            raise self._error(f"a vTypeDistribution needs an id of its own, got {_short(name)!r}")
        for key, text in values.items():
            kind = self._schema.distribution.get(key)
            if kind is None:
                raise self._error(
                    f"vTypeDistribution {_short(name)!r} has an unknown attribute {_short(key)!r}"
                    f"{_guess(key, self._schema.distribution)}"
                )
            if not kind.takes(text):
                raise self._error(f"{key} is {_short(text)!r}, expected {kind.expected()}")
        listed = values.get("vTypes", "").split()
        weights = [
            self._plain("probabilities", p, NUMBERS["probability"]) for p in values.get("probabilities", "").split()
        ]
        if weights and len(weights) != len(listed):
            raise self._error(
                f"vTypeDistribution {_short(name)!r} has {len(listed)} vTypes and {len(weights)} probabilities"
            )
        for member in listed:
            if member not in self._types:
                raise self._error(
                    f"vTypeDistribution {_short(name)!r} names the vType {_short(member)!r}, which is not defined above"
                )
        default = [float(self._types[m].attributes.get("probability", 1.0)) for m in listed]
        self._distributions[name] = dict(zip(listed, weights or default, strict=True))
        self._open_distribution = name
        if "deterministic" in values:
            self._note({"deterministic": values["deterministic"]}, "Krauss", self._line())

    def _parameter(self, values: dict[str, str]) -> None:
        key, text = values.get("key", ""), values.get("value", "")
        element = self._open_type
        if element is None:
            raise self._error("a param belongs inside a vType")
        if key in PARAMETERS:
            if not self._spread(element, key, text, *PARAMETERS[key]):
                self._plain(key, text, PARAMETERS[key])
        elif key == SWERVE:
            if text not in ("true", "false"):
                raise self._error(f"{SWERVE} is {_short(text)!r}, expected true or false")
        elif key.startswith("interplan."):
            raise self._error(f"unknown parameter {_short(key)!r}{_guess(key, (*PARAMETERS, SWERVE))}")
        element.parameters[key] = text

    def _finish(self, element: VehicleTypeElement) -> None:
        """What can be checked only when all of a vType has been read."""
        values, model, models = element.attributes, element.model, car_following_models()
        if model in CANNOT_RUN:
            raise self._error(f"carFollowModel {model} {CANNOT_RUN[model]}; take another one")
        if model not in models:
            hint = _guess(model, models) or f"; known: {', '.join(models)}"
            raise self._error(f"carFollowModel is {_short(model)!r}, which SUMO has not{hint}")
        changes = values.get("laneChangeModel", "")
        if changes in LANE_CHANGE_CANNOT_RUN:
            raise self._error(f"laneChangeModel {changes} {LANE_CHANGE_CANNOT_RUN[changes]}; take another one")
        kind = values.get("vClass", "passenger")
        if kind in OTHER_CLASSES:
            raise self._error(f"vClass is {kind!r}, which does not drive on roads")
        if kind not in CLASSES_ON_ROADS:
            hint = _guess(kind, CLASSES_ON_ROADS) or f"; known: {', '.join(sorted(CLASSES_ON_ROADS))}"
            raise self._error(f"vClass is {_short(kind)!r}, which SUMO has not{hint}")
        lengths = {key: self._table(key, values[key]) for key in ("speedTable", *PROFILES) if key in values}
        for key in PROFILES:
            many, speeds = lengths.get(key), lengths.get("speedTable", 0)
            if many is not None and many != speeds:
                raise self._error(f"{key} has {many} numbers and speedTable {speeds}; they belong in pairs")
        if (spread := self._speed_spread(element)) is not None:
            element.spreads["speedFactor"] = spread
        self._note(values, model, element.line, element.parameters)

    def _table(self, key: str, text: str) -> int:
        numbers = text.split()
        for each in numbers:
            self._plain(key, each, (0.0, 100.0))
        return len(numbers)

    def _speed_spread(self, element: VehicleTypeElement) -> NumberDistribution | None:
        """The spread of desired speeds: SUMO lets speedDev overrule the deviation that speedFactor has."""
        deviation = float(element.attributes.get("speedDev", 0.0))
        given = element.spreads.get("speedFactor")
        if "speedDev" not in element.attributes or (given is None and deviation == 0.0):
            return given
        if given is None:
            factor = float(element.attributes.get("speedFactor", 1.0))
            given = NumberDistribution("normal", factor, deviation, *SPREAD)
        elif deviation == 0.0:
            self._warned["speedDev 0 takes the spread of speedFactor away, as in SUMO; leave speedDev out"] = (
                element.line,
                {"the distribution of speedFactor": None},
            )
        try:
            return replace(given, second=deviation).within(*NUMBERS["speedFactor"])
        except ValueError:
            what = f"speedFactor {given.first:g} with speedDev {deviation:g}"
            raise self._error(f"{what} is hardly ever from {given.lowest:g} to {given.highest:g}") from None

    def _note(self, attributes: Iterable[str], model: str, line: int, parameters: Iterable[str] = ()) -> None:
        """Remember what cannot act."""
        for idle in idle_attributes(attributes, model, parameters):
            self._warned.setdefault(idle.reason, (line, {}))[1][idle.attribute] = None

    def result(self) -> VehicleTypeDocument:
        """What was read."""
        warnings = [
            f"{self._path}, line {line}: {', '.join(names)} cannot act: {reason}"
            for reason, (line, names) in self._warned.items()
        ]
        return VehicleTypeDocument(self._path, self._types, self._distributions, tuple(warnings))


def _is_number(text: str) -> bool:
    return re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", text, re.ASCII) is not None


def _short(text: str) -> str:
    """A text from the file, as far as a message repeats it."""
    return text if len(text) <= LONGEST_ECHO else f"{text[:LONGEST_ECHO]}..."


def _guess(name: str, known: Iterable[str]) -> str:
    near = get_close_matches(name[:LONGEST_ECHO], known, n=1)
    return f"; did you mean {near[0]!r}?" if near else ""
