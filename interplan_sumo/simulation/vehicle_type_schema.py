"""What SUMO's own schema says a vType may hold: its attributes, what each may be, and which models read it.

The schema ships with libsumo, in the package `sumo_data` (data/xsd/types/route.xsd and what it includes).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from math import inf
from pathlib import Path
from typing import cast
from xml.etree.ElementTree import Element

from defusedxml.ElementTree import parse

from interplan_sumo.errors import VehicleTypeError

_XSD = "{http://www.w3.org/2001/XMLSchema}"
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
_WHOLE = re.compile(r"[-+]?\d+", re.ASCII)
_WHOLE_TYPES = {"xsd:int": -inf, "xsd:integer": -inf, "xsd:nonNegativeInteger": 0.0, "xsd:positiveInteger": 1.0}
_MODEL_ELEMENT = "carFollowing-"


@dataclass(frozen=True, slots=True)
class ValueType:
    """What the text of an attribute may be: a simple type of the schema."""

    name: str
    """The schema's, '' where it has none."""
    base: str = "xsd:string"
    lowest: float = -inf
    highest: float = inf
    above: float = -inf
    words: tuple[str, ...] = ()
    pattern: str | None = None
    either: tuple[ValueType, ...] = ()
    """A union: one of these must take the text."""

    def takes(self, text: str) -> bool:
        """Whether the schema allows a text. Numbers must be finite."""
        if self.either:
            return any(each.takes(text) for each in self.either)
        if self.words:
            return text in self.words
        if self.base in _WHOLE_TYPES and not _WHOLE.fullmatch(text):
            return False
        if self.base == "xsd:float" or self.base in _WHOLE_TYPES:
            return bool(_NUMBER.fullmatch(text)) and self._holds(float(text))
        return self.pattern is None or re.fullmatch(self.pattern, text, re.ASCII) is not None

    def _holds(self, number: float) -> bool:
        return self.lowest <= number <= self.highest and number > self.above

    @property
    def is_number(self) -> bool:
        """Whether a number that need not be whole is what it takes, or one of the things that it takes."""
        if self.either:
            return any(each.is_number for each in self.either)
        if self.words or (self.base != "xsd:float" and self.pattern is None):
            return False
        return self.base == "xsd:float" or (self.takes("-1.5e3") and not self.takes("text"))

    def bounds(self) -> tuple[float, float]:
        """Lowest and highest of the numbers that it takes; meant for what `is_number`."""
        if self.either:
            return next(each.bounds() for each in self.either if each.is_number)
        return max(self.lowest, self.above), self.highest

    def expected(self) -> str:
        """What it takes, in words."""
        if self.either:
            return " or ".join(dict.fromkeys(each.expected() for each in self.either))
        if self.words:
            return ", ".join(self.words)
        what = "a whole number" if self.base in _WHOLE_TYPES else "a number"
        if self.is_number or self.base in _WHOLE_TYPES:
            if self.lowest == self.highest:
                return f"{self.lowest:g}"
            if self.lowest > -inf and self.highest < inf:
                return f"{what} from {self.lowest:g} to {self.highest:g}"
            if self.above > -inf:
                return f"{what} above {self.above:g}"
            return f"{what} of at least {self.lowest:g}" if self.lowest > -inf else what
        return f"SUMO's {self.name}" if self.name else "text of SUMO's form"


@dataclass(frozen=True, slots=True)
class VehicleTypeSchema:
    """The part of SUMO's schema that is about vehicle types."""

    attributes: Mapping[str, ValueType]
    """Of a vType."""
    models: Mapping[str, frozenset[str]]
    """Attributes by the car-following model that reads them."""
    distribution: Mapping[str, ValueType]
    """Of a vTypeDistribution."""


def schema_folder() -> Path:
    """Where SUMO's schemas lie; VehicleTypeError if they are not installed."""
    found = find_spec("sumo_data")
    for root in (found.submodule_search_locations or ()) if found is not None else ():
        folder = Path(root) / "data" / "xsd" / "types"
        if (folder / "route.xsd").is_file():
            return folder
    raise VehicleTypeError("SUMO's schemas are not installed; they come with libsumo: pip install sumo-data")


@cache
def vehicle_type_schema() -> VehicleTypeSchema:
    """Read once per process."""
    simple: dict[str, Element] = {}
    composed: dict[str, Element] = {}
    for name in ("base.xsd", "route.xsd"):
        # Entities abbreviate patterns in base.xsd, a file that SUMO ships.
        root = cast(Element, parse(schema_folder() / name, forbid_entities=False).getroot())
        simple.update((each.attrib["name"], each) for each in root.findall(f"{_XSD}simpleType"))
        composed.update((each.attrib["name"], each) for each in root.findall(f"{_XSD}complexType"))
    base = composed["vTypeBaseType"]
    models: dict[str, frozenset[str]] = {}
    for element in base.iter(f"{_XSD}element"):
        if element.attrib["name"].startswith(_MODEL_ELEMENT):
            own = composed[element.attrib["type"]].findall(f"{_XSD}attribute")
            models[element.attrib["name"].removeprefix(_MODEL_ELEMENT)] = frozenset(each.attrib["name"] for each in own)
    return VehicleTypeSchema(
        {"id": _named("idType", simple), **dict(_attributes(base, simple))},
        models,
        dict(_attributes(composed["vTypeDistributionType"], simple)),
    )


def model_of_element(name: str) -> str | None:
    """The car-following model that a nested element such as `carFollowing-IDM` is of; None if it is no such element."""
    model = name.removeprefix(_MODEL_ELEMENT)
    return model if model != name and model in vehicle_type_schema().models else None


def _attributes(element: Element, simple: Mapping[str, Element]) -> Iterator[tuple[str, ValueType]]:
    for each in element.findall(f"{_XSD}attribute"):
        inline = each.find(f"{_XSD}simpleType")
        kind = _value_type("", inline, simple) if inline is not None else _named(each.attrib["type"], simple)
        yield each.attrib["name"], kind


def _named(name: str, simple: Mapping[str, Element]) -> ValueType:
    if name.startswith("xsd:"):
        return ValueType("", name, lowest=_WHOLE_TYPES.get(name, -inf))
    return _value_type(name, simple[name], simple)


def _value_type(name: str, element: Element, simple: Mapping[str, Element]) -> ValueType:
    union = element.find(f"{_XSD}union")
    if union is not None:
        members = [_named(each, simple) for each in union.attrib.get("memberTypes", "").split()]
        members += [_value_type("", each, simple) for each in union.findall(f"{_XSD}simpleType")]
        return ValueType(name, either=tuple(members))
    restriction = element.find(f"{_XSD}restriction")
    assert restriction is not None

    def facet(kind: str) -> list[str]:
        return [each.attrib["value"] for each in restriction.findall(f"{_XSD}{kind}")]

    base = restriction.attrib["base"]
    return ValueType(
        name,
        base,
        lowest=max([_WHOLE_TYPES.get(base, -inf), *map(float, facet("minInclusive"))]),
        highest=min([inf, *map(float, facet("maxInclusive"))]),
        above=max([-inf, *map(float, facet("minExclusive"))]),
        words=tuple(facet("enumeration")),
        pattern=next(iter(facet("pattern")), None),
    )
