"""Scenario files: one's own test drives as YAML, written and read without a loss.

A file holds one scenario per YAML document, `format: 1` first, then the fields
of `Scenario` by name; what has its default may be left out. The types of the
dataclasses are the grammar: a new field needs nothing here. Maps that are not
shipped lie beside the file, in a folder `maps` laid out as nuPlan's maps root.
"""

from __future__ import annotations

import re
import types
from collections.abc import Iterable
from dataclasses import MISSING, Field, fields, is_dataclass, replace
from difflib import get_close_matches
from functools import cache
from math import isfinite
from os import PathLike
from pathlib import Path
from typing import Any, Final, Literal, NoReturn, get_args, get_origin, get_type_hints

import yaml

from interplan_sumo.errors import ScenarioError
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.files import writing

FORMAT: Final = 1
"""Of the files; another one is refused."""
SUFFIXES: Final = (".yaml", ".yml")
LINE_LENGTH: Final = 110
LARGEST_BYTES: Final = 10_000_000
"""A file beyond this is no list of scenarios."""
DEEPEST: Final = 100
"""Levels of lists and mappings; a scenario has five."""
MAPS: Final = "maps"
"""The folder beside a scenario file for maps of its own."""

# YAML 1.1 reads 010 as eight, 1:30 as ninety and 1e3 as text; people mean what JSON means.
_NUMBER: Final = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?")
_WHOLE: Final = re.compile(r"[-+]?\d+")
_TEXT_TAGS: Final = tuple(f"tag:yaml.org,2002:{kind}" for kind in ("str", "int", "float", "timestamp"))
_NULL_TAG: Final = "tag:yaml.org,2002:null"

_Path = str | PathLike[str]


def is_scenario_file(text: str) -> bool:
    """Whether what somebody typed means a file rather than an id: by its ending, or because it is there."""
    return text.lower().endswith(SUFFIXES) or Path(text).is_file()


def read_scenario(path: _Path) -> Scenario:
    """The one scenario of a file; ScenarioError as from `read_scenarios`, or if it holds several."""
    scenarios = read_scenarios(path)
    if len(scenarios) != 1:
        raise ScenarioError(
            f"{path} holds {len(scenarios)} scenarios ({', '.join(s.id for s in scenarios)}), expected one"
        )
    (scenario,) = scenarios
    return scenario


def read_scenarios(path: _Path) -> tuple[Scenario, ...]:
    """All scenarios of a file, in its order.

    Raises ScenarioError, one line that names the file, the line, the field and
    what would be right. Whether a scenario fits its map is not looked at here,
    but the scenarios know of the folder `maps` beside the file, if there is one.
    """
    text = _text(path)
    try:
        documents = _documents(text)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f", line {mark.line + 1}" if mark is not None else ""
        raise ScenarioError(f"{path}{where}: this is not YAML: {error.problem or error.context}") from None
    except yaml.YAMLError as error:
        raise ScenarioError(f"{path}: this is not YAML: {' '.join(str(error).split())}") from None
    except RecursionError:
        raise ScenarioError(f"{path}: this is no scenario: lists inside lists without end") from None
    if not documents:
        raise ScenarioError(f"{path} is empty; `interplan-sumo scenarios export ID {path}` writes a scenario to edit")
    file = _File(str(path))
    scenarios = tuple(file.scenario(node) for node in documents)
    lines: dict[str, int] = {}
    for scenario, node in zip(scenarios, documents, strict=True):
        if scenario.id in lines:
            file.fail(node, f"there is a second scenario {scenario.id}, the first is in line {lines[scenario.id]}")
        lines[scenario.id] = _line(node)
    beside = Path(path).resolve().parent / MAPS
    return tuple(replace(scenario, maps_beside=beside) for scenario in scenarios) if beside.is_dir() else scenarios


def write_scenario(scenario: Scenario, path: _Path) -> None:
    """Write a file with one scenario, over what was there; InputError if it cannot be written."""
    write_scenarios((scenario,), path)


def write_scenarios(scenarios: Iterable[Scenario], path: _Path) -> None:
    """Write a file with these scenarios, over what was there; InputError if it cannot be written."""
    with writing(path, "give another file"):
        Path(path).write_text("---\n".join(map(scenario_text, scenarios)), encoding="utf-8", newline="\n")


def scenario_text(scenario: Scenario) -> str:
    """A scenario as one YAML document: fields in the order of the class, defaults left out."""
    plain = {"format": FORMAT, **_plain(scenario, Scenario)}
    return yaml.safe_dump(plain, sort_keys=False, width=LINE_LENGTH, default_flow_style=None)


def _documents(text: str) -> list[yaml.Node]:
    """The nodes of all documents; RecursionError if they are nested beyond `DEEPEST`.

    With libyaml where PyYAML has it, six times faster. Its composer overruns
    the stack on deep nesting, so the depth is looked at before; where a file is
    broken PyYAML itself knows better.
    """
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    depth = 0
    try:
        for event in yaml.parse(text, Loader=loader):
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > DEEPEST:
                raise RecursionError
        return list(yaml.compose_all(text, Loader=loader))
    except yaml.YAMLError:
        return list(yaml.compose_all(text, Loader=yaml.SafeLoader))


# --- the dataclasses as grammar ------------------------------------------------------------------


@cache
def _grammar(kind: type) -> dict[str, tuple[Field[Any], Any]]:
    """The fields of a dataclass by name, each with its type; those that are not compared belong to no file."""
    hints = get_type_hints(kind)
    return {field.name: (field, hints[field.name]) for field in fields(kind) if field.compare}


def _is_required(field: Field[Any]) -> bool:
    return field.default is MISSING and field.default_factory is MISSING


def _item(kind: Any) -> Any:
    """X of `tuple[X, ...]`, None for another type."""
    return get_args(kind)[0] if get_origin(kind) is tuple else None


def _optional(kind: Any) -> Any:
    """X of `X | None`, None for another type."""
    rest = [member for member in get_args(kind) if member is not type(None)]
    return rest[0] if isinstance(kind, types.UnionType) and len(rest) == 1 else None


def _expected(kind: Any) -> str:
    """What would be right, in words."""
    if (inner := _optional(kind)) is not None:
        return _expected(inner)
    if (item := _item(kind)) is not None:
        return "a list of text" if item is str else "a list"
    if get_origin(kind) is Literal:
        return f"one of {', '.join(get_args(kind))}"
    if is_dataclass(kind):
        return f"the keys {', '.join(_grammar(kind))}"  # type: ignore[arg-type]
    return {str: "text", float: "a number", int: "a whole number"}[kind]


def _plain(value: Any, kind: Any) -> Any:
    """`value`, of type `kind`, as what YAML has."""
    if (inner := _optional(kind)) is not None:
        return None if value is None else _plain(value, inner)
    if (item := _item(kind)) is not None:
        return [_plain(each, item) for each in value]
    if is_dataclass(kind):
        found: dict[str, Any] = {}
        for name, (field, field_kind) in _grammar(kind).items():  # type: ignore[arg-type]
            plain = _plain(getattr(value, name), field_kind)
            # By their looks: -0.0 equals 0.0 and has another hash.
            if _is_required(field) or repr(plain) != repr(_plain(field.default, field_kind)):
                found[name] = plain
        return found
    return str(value) if get_origin(kind) is Literal else kind(value)  # numbers of numpy become Python's


# --- reading -------------------------------------------------------------------------------------


class _File:
    """Turns the nodes of one file into values of given types; `field` is the path to a node, empty for a document."""

    def __init__(self, name: str) -> None:
        self._name = name

    def fail(self, node: yaml.Node, text: str) -> NoReturn:
        raise ScenarioError(f"{self._name}, line {_line(node)}: {text}")

    def scenario(self, node: yaml.Node) -> Scenario:
        if not isinstance(node, yaml.MappingNode):
            self.fail(node, f"this is {_said(node)}, expected a scenario: {_expected(Scenario)}")
        versions = [value for key, value in node.value if key.value == "format"]
        if not versions:
            self.fail(node, f"there is no format; begin the scenario with `format: {FORMAT}`")
        if (written := self.value(versions[-1], int, "format")) != FORMAT or len(versions) > 1:
            self.fail(versions[-1], f"format is {written}, this version reads one format, {FORMAT}")
        return self._record(node, [pair for pair in node.value if pair[0].value != "format"], Scenario, "")

    def value(self, node: yaml.Node, kind: Any, field: str) -> Any:
        if (inner := _optional(kind)) is not None:
            return None if node.tag == _NULL_TAG else self.value(node, inner, field)
        if (item := _item(kind)) is not None and isinstance(node, yaml.SequenceNode):
            return tuple(self.value(each, item, f"{field}[{i}]") for i, each in enumerate(node.value))
        if is_dataclass(kind) and isinstance(node, yaml.MappingNode):
            return self._record(node, node.value, kind, f"{field}.")  # type: ignore[arg-type]
        found = _scalar(node, kind) if isinstance(node, yaml.ScalarNode) else None
        if found is not None:
            return found
        text = f"{field} is {_said(node)}, expected {_expected(kind)}"
        if get_origin(kind) is Literal and (near := get_close_matches(str(node.value), get_args(kind), n=1)):
            text += f". Did you mean {near[0]!r}?"
        elif kind is str and isinstance(node, yaml.ScalarNode):
            text += f". If the text is meant, put it in quotes: '{node.value}'"
        return self.fail(node, text)

    def _record(self, node: yaml.Node, pairs: list[tuple[yaml.Node, yaml.Node]], kind: type, prefix: str) -> Any:
        known = _grammar(kind)
        values: dict[str, Any] = {}
        for key, value in pairs:
            name = key.value if isinstance(key, yaml.ScalarNode) else ""
            if name not in known:
                near = get_close_matches(name, known, n=1)
                guess = f"Did you mean {prefix}{near[0]}?" if near else f"Known are: {', '.join(known)}"
                self.fail(key, f"there is no field {prefix}{name or _said(key)}. {guess}")
            if name in values:
                self.fail(key, f"{prefix}{name} is given twice; leave one out")
            values[name] = self.value(value, known[name][1], f"{prefix}{name}")
        for name, (field, field_kind) in known.items():
            if _is_required(field) and name not in values:
                self.fail(node, f"{prefix}{name} is missing, expected {_expected(field_kind)}")
        try:
            return kind(**values)
        except ScenarioError as error:
            return self.fail(node, str(error))


def _line(node: yaml.Node) -> int:
    return node.start_mark.line + 1


def _scalar(node: yaml.ScalarNode, kind: Any) -> Any:
    """A text, number or name of a choice; None if the node is none. Only bare words can be numbers."""
    text: str = node.value
    is_bare = not node.style
    if kind is float:
        number = float(text) if is_bare and _NUMBER.fullmatch(text) else float("nan")
        return number if isfinite(number) else None
    if kind is int:
        return int(text) if is_bare and _WHOLE.fullmatch(text) else None
    if kind is str:  # an id of digits needs no quotes
        return text if node.tag in _TEXT_TAGS else None
    return text if text in get_args(kind) else None


def _said(node: yaml.Node) -> str:
    """A node in an error message."""
    if isinstance(node, yaml.MappingNode):
        return "a mapping"
    if isinstance(node, yaml.SequenceNode):
        return "a list"
    if node.tag == _NULL_TAG:
        return "empty"
    text = str(node.value)
    is_bare = isinstance(node, yaml.ScalarNode) and not node.style
    shown = text if len(text) <= 60 else f"{text[:57]}..."
    return shown if is_bare else repr(shown)


def _text(path: _Path) -> str:
    try:
        with Path(path).open("rb") as file:
            data = file.read(LARGEST_BYTES + 1)
    except OSError as error:
        raise ScenarioError(f"cannot read {path}: {error.strerror or error}") from None
    if len(data) > LARGEST_BYTES:
        raise ScenarioError(f"{path} is larger than {LARGEST_BYTES // 1_000_000} MB; this is no list of scenarios")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ScenarioError(f"{path} is not UTF-8 text (byte {error.start})") from None
