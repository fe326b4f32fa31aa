"""Figures in the prose of README and docs: what a cell of a table says, so that nobody types them either.

A figure stands before a comment that says where it is from:

    PDM with the lanes beside has 54<!-- planners[pdm_proposals, interPlan] --> points

| comment | the figure |
|---|---|
| `TABLE[ROW, COLUMN]` | the first number of a cell; a row goes by the name in its first cell, or its first words |
| `TABLE[WORDS]` | of a sentence: the first number after these words |
| `CELL - CELL` | by how much the first is more |
| `least TABLE[ROW/ROW, COLUMN]`, `most ...` | of several rows; `*` are all |
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple, TypeAlias

_NUMBER: Final = re.compile(r"-?\d+(?:,\d{3})*(?:\.\d+)?")
FIGURE: Final = re.compile(
    rf"(?:(?<!\w){_NUMBER.pattern}|{_NUMBER.pattern.removeprefix('-?')})<!-- (?P<source>[^>]*\[[^>]*\]) -->"
)
_TERM: Final = re.compile(r"(?:(?P<of>least|most) )?(?P<table>[a-z_]+)\[(?P<row>[^],]+)(?:, (?P<column>[^]]+))?\]")
_NAME: Final = re.compile(r"`([^`]*)`")

Tables: TypeAlias = Callable[[str], Sequence[str]]
"""The lines of a table by its name: a title line, a line of dashes and rows, cells between bars; or one sentence."""


class Figure(NamedTuple):
    """A number as it is written."""

    value: float
    text: str

    @property
    def decimals(self) -> int:
        return len(self.text.partition(".")[2])


def with_figures(text: str, tables: Tables) -> str:
    """A text with its figures made anew. LookupError, with the comment, for what no table has."""

    def made(found: re.Match[str]) -> str:
        try:
            return f"{figure(found['source'], tables)}<!-- {found['source']} -->"
        except LookupError as error:
            raise LookupError(f"{found[0]}: {error.args[0]}") from None

    return FIGURE.sub(made, text)


def figure(source: str, tables: Tables) -> str:
    """What a comment asks for. LookupError if there is no such thing."""
    first, minus, second = source.partition(" - ")
    found = _term(first, tables)
    if not minus:
        return found.text
    less = _term(second, tables)
    return f"{found.value - less.value:.{max(found.decimals, less.decimals)}f}"


def _term(source: str, tables: Tables) -> Figure:
    asked = _TERM.fullmatch(source)
    if asked is None:
        raise LookupError(f"{source!r} is no cell; write TABLE[ROW, COLUMN]")
    lines = tables(asked["table"])
    if asked["column"] is None:
        return _number(" ".join(lines).partition(asked["row"])[2], source)
    if len(lines) == 1:
        raise LookupError(f"{asked['table']} is a sentence; write the words before the number in brackets")
    titles, _, *rows = (_cells(line) for line in lines)
    if asked["column"] not in titles:
        raise LookupError(f"no column {asked['column']!r} in {titles}")
    column = titles.index(asked["column"])
    by_name: dict[str, list[str]] = {}
    for row in rows:
        by_name.setdefault(_name(row[0]), []).append(row[column])
    names = list(by_name) if asked["row"] == "*" else asked["row"].split("/")
    for name in names:
        if len(by_name.get(name, ())) != 1:
            raise LookupError(f"{len(by_name.get(name, ()))} rows are {name!r}, of {list(by_name)}")
    if len(names) > 1 and not asked["of"]:
        raise LookupError("several rows; write least or most before them")
    figures = [_number(by_name[name][0], source) for name in names]
    return (min if asked["of"] == "least" else max)(figures)


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.split("|")]


def _name(cell: str) -> str:
    quoted = _NAME.search(cell)
    return quoted[1] if quoted else cell.partition(",")[0]


def _number(text: str, source: str) -> Figure:
    found = _NUMBER.search(text)
    if found is None:
        raise LookupError(f"no number for {source!r}")
    return Figure(float(found[0].replace(",", "")), found[0])
