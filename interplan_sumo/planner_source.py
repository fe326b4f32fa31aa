"""Planner source: what makes a planner what it is: its files, its options, its weights, and a hash over them.

Nothing of the planner is imported. Its files are those of its package (or its module, or its program), of what they
import from beside them, and those that its options name. Libraries, which have versions, are none of them.
"""

from __future__ import annotations

import hashlib
import importlib.util
import re
import shlex
import shutil
import sys
import sysconfig
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.machinery import ModuleSpec
from pathlib import Path
from typing import Any, Final

import yaml

from interplan_sumo.errors import InputError
from interplan_sumo.planner import EXEC, PLANNERS, split_spec
from interplan_sumo.planner_options import OptionLoader

RECORDS: Final = frozenset((".jsonl", ".log", ".db", ".sqlite"))
"""Files that a planner writes, such as answers of language models: what its options name so is none of its source."""
LARGE_BYTES: Final = 64 << 20
"""Of a file beyond this, only its size and pieces all over it count."""
_PIECES, _PIECE_BYTES = 64, 1 << 16
_IMPORTS = re.compile(
    r"^[ \t]*(?:from[ \t]+([A-Za-z_][\w.]*)[ \t]+import[ \t]+(\([^)]*|[^\n#;]+)|import[ \t]+([^\n#;]+))", re.MULTILINE
)
_OWN = "interplan_sumo"


@dataclass(frozen=True, slots=True)
class PlannerSource:
    """The files of a planner."""

    hash: str
    """SHA-256 over names and contents of the files, and its options."""
    files: dict[str, str]
    """The first 16 digits of each one's SHA-256, by its name."""

    @classmethod
    def of(cls, spec: str) -> PlannerSource:
        """Of the planner that `run --planner` takes; InputError if one of its files cannot be read."""
        name, query = split_spec(spec)
        if name.startswith(f"{EXEC}:"):
            words = shlex.split(name.removeprefix(f"{EXEC}:"))
            places = _named([shutil.which(words[0]) or words[0], *words[1:]])
        else:
            places = {**_modules(_module(name)), **_named(_values(query))}
        files = {each: _digest(place)[:16] for each, place in sorted(places.items())}
        about = "\n".join((query, *(f"{each} {digest}" for each, digest in files.items())))
        return cls(hashlib.sha256(about.encode(errors="surrogateescape")).hexdigest(), files)


def changed_files(then: dict[str, str], now: dict[str, str]) -> list[str]:
    """The names of the files that are not as they were."""
    return [name for name in sorted({*then, *now}) if then.get(name) != now.get(name)]


def _module(name: str) -> str:
    """The module that a planner comes from."""
    if ":" not in name:
        return PLANNERS.point(name).value.partition(":")[0]
    return name.split(":")[-2]


def _modules(planner: str) -> dict[str, Path]:
    """The files of a module's package, and of those that they import which are no libraries."""
    found: dict[str, Path] = {}
    seen, left = set[str](), [planner]
    while left:
        unit = _unit_of(left.pop())
        if unit is None or unit.name in seen:
            continue
        seen.add(unit.name)
        if len(seen) > 1 and _is_library(unit):
            continue
        files = _files_of(unit)
        found |= files
        for file in files.values():
            if file.suffix == ".py":
                left += _imported(file)
    return found


def _unit_of(module: str) -> ModuleSpec | None:
    """The outermost package that a module belongs to, or the module itself; folders without `__init__` are none."""
    parts = module.split(".")
    for count in range(1, len(parts) + 1):
        try:
            spec = importlib.util.find_spec(".".join(parts[:count]))  # imports nothing: all before it are mere folders
        except (ImportError, ValueError):
            return None
        if spec is None or spec.has_location:
            return spec
    return None


@cache
def _libraries() -> frozenset[Path]:
    names = ("stdlib", "platstdlib", "purelib", "platlib")
    return frozenset(Path(sysconfig.get_path(each)).resolve() for each in names)


def _files_of(unit: ModuleSpec) -> dict[str, Path]:
    """The files of a package or module, by names that say which it is."""
    if unit.submodule_search_locations is not None:
        folders = [Path(each).resolve() for each in unit.submodule_search_locations]
        return {f"{unit.name}/{name}": path for folder in folders for name, path in _below(folder)}
    file = Path(unit.origin or "").resolve()
    return {unit.name.replace(".", "/") + file.suffix: file} if file.is_file() else {}


def _is_library(unit: ModuleSpec) -> bool:
    place = Path(unit.origin or "").resolve()
    return bool(_libraries() & {*place.parents}) or {"site-packages", "dist-packages"} & {*place.parts} != set()


def _below(folder: Path) -> Iterator[tuple[str, Path]]:
    """What lies in a folder, but for what Python or an editor leaves there."""
    for path in sorted(folder.rglob("*")):
        place = path.relative_to(folder)
        hidden = any(part.startswith(".") or part == "__pycache__" for part in place.parts)
        if path.is_file() and not hidden and path.suffix != ".pyc":
            yield place.as_posix(), path


def _imported(file: Path) -> Iterator[str]:
    """Names that a file imports and that may be modules beside it."""
    for module, names, several in _IMPORTS.findall(_read(file).decode(errors="replace")):
        found = [each.split()[0] for each in (several or names).strip("( \n").split(",") if each.split()]
        for name in [module, *(f"{module}.{each}" for each in found)] if module else found:
            top = name.partition(".")[0]
            if name.replace(".", "").isidentifier() and top not in sys.stdlib_module_names and top != _OWN:
                yield name


def _values(query: str) -> Iterator[str]:
    """The texts among the values of options."""

    def texts(value: Any) -> Iterator[str]:
        if isinstance(value, str):
            yield value
        elif isinstance(value, list):
            for each in value:
                yield from texts(each)

    for pair in filter(None, query.split("&")):
        with suppress(yaml.YAMLError):
            yield from texts(yaml.load(pair.partition("=")[2], OptionLoader))  # a safe loader


def _named(texts: Iterable[str]) -> dict[str, Path]:
    """The files that are named, and what lies in folders that are."""
    found: dict[str, Path] = {}
    for text in texts:
        with suppress(OSError, ValueError):
            place = Path(text).expanduser()
            if place.suffix in RECORDS:
                continue
            if place.is_file():
                found[text] = place
            elif place.is_dir() and text not in ("", ".", "/"):
                found |= {f"{text}/{name}": path for name, path in _below(place)}
    return found


def _digest(file: Path) -> str:
    try:
        size = file.stat().st_size
        if size <= LARGE_BYTES:
            return hashlib.sha256(_read(file)).hexdigest()
        digest = hashlib.sha256(str(size).encode())
        with file.open("rb") as content:
            for piece in range(_PIECES):
                content.seek(piece * (size - _PIECE_BYTES) // (_PIECES - 1))
                digest.update(content.read(_PIECE_BYTES))
        return digest.hexdigest()
    except OSError as error:
        raise InputError(f"cannot read {file}, which belongs to a planner: {error.strerror or error}") from None


def _read(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise InputError(f"cannot read {file}, which belongs to a planner: {error.strerror or error}") from None
