"""Planner source: what makes a planner what it is: its files, its options, its weights, and a hash over them.

Nothing of the planner is imported. Its files are its module (or its program), whatever that imports, directly or not,
which is no library, all that lies in the packages of these and is no Python, and what its options name; but not what
lies beside modules of a package inside them, none of which is imported. A package in which a file of the planner loads
code by name belongs to it as a whole. Libraries have versions, and are none of them.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
import re
import shlex
import shutil
import sys
import sysconfig
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.machinery import ModuleSpec
from pathlib import Path, PurePosixPath
from typing import Any, Final
from urllib.parse import unquote

import yaml

from interplan_sumo.errors import InputError
from interplan_sumo.planner import EXEC, PLANNERS, split_spec
from interplan_sumo.planner_options import OptionLoader

RECORDS: Final = frozenset((".jsonl", ".log", ".db", ".sqlite"))
"""Files that a planner writes, such as answers of language models: what its options name so is none of its source.

But for one that is told to `replay`, which reads them.
"""
_SIGN: Final = re.compile(r"([\s?&=:,;+@#|])")
"""Between the words of options, and of texts that name more than a file, such as `embedded:FILE+lora:FILE@0.5`."""
LARGE_BYTES: Final = 64 << 20
"""Of a file beyond this, only its size and pieces all over it count."""
_PIECES, _PIECE_BYTES = 64, 1 << 16
_BY_NAME: Final = frozenset(("PLANNERS", "__import__", "eval", "exec", "importlib", "load_planner", "pkgutil", "runpy"))
"""What a file loads with these is not told by its imports."""
_DATA: Final = "importlib.resources"
"""Loads no code."""
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
            places = _named([shutil.which(words[0]) or words[0], *words[1:]], name)
        else:
            places = {**_modules(_module(name)), **_named(_values(query), query)}
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
    """The files of a module, of what it imports that is no library, and the data of their packages."""
    found: dict[str, Path] = {}
    units: dict[str, tuple[dict[str, Path], dict[str, str]]] = {}
    seen, left = set[str](), [planner]
    while left:
        module = left.pop()
        if module in seen:
            continue
        seen.add(module)
        unit = _unit_of(module)
        if unit is None or (found and _is_library(unit)):
            continue
        if unit.name not in units:
            files = _files_of(unit)
            units[unit.name] = files, _homes(files)
        every, homes = units[unit.name]
        places = _places(module, unit)
        fresh = {name: file for name, file in every.items() if homes[name] in places}
        while fresh := {name: file for name, file in fresh.items() if name not in found}:
            found |= fresh
            imports = [_Imports.of(file, _package(name)) for name, file in fresh.items() if file.suffix == ".py"]
            left += [name for each in imports for name in each.modules]
            fresh = every if any(each.by_name for each in imports) else {}
    return found


def _places(module: str, unit: ModuleSpec) -> set[str]:
    """What the files of a module and of the packages around it may be called."""
    if unit.submodule_search_locations is None:
        return set(_files_of(unit))
    inner = [*filter(None, module.removeprefix(unit.name).split("."))]
    around = [f"{unit.name}/" + "".join(f"{part}/" for part in inner[:count]) for count in range(len(inner) + 1)]
    return {f"{each}__init__.py" for each in around} | {f"{around[-1].rstrip('/')}.py"}


def _homes(every: Mapping[str, Path]) -> dict[str, str]:
    """The Python file that each one of a unit comes with: itself, or what makes a package of the modules around it.

    A package without modules holds data for those around it.
    """
    packages = {name.rpartition("/")[0] for name in every if name.endswith(".py") and not name.endswith("/__init__.py")}
    packages |= {name.partition("/")[0] for name in every}

    def home(name: str) -> str:
        around = (parent.as_posix() for parent in PurePosixPath(name).parents)
        return next((f"{folder}/__init__.py" for folder in around if folder in packages), name)

    return {name: name if file.suffix == ".py" else home(name) for name, file in every.items()}


def _package(name: str) -> str:
    """The package of a file that is called so, as its relative imports mean it."""
    return name.rpartition("/")[0].replace("/", ".")


@dataclass(frozen=True, slots=True)
class _Imports:
    """What a file says that it loads."""

    modules: list[str]
    """Names that may be modules which are no libraries."""
    by_name: bool
    """Whether it may load others, too."""

    @classmethod
    def of(cls, file: Path, package: str) -> _Imports:
        try:
            tree = ast.parse(_read(file))
        except (SyntaxError, ValueError):
            return cls([], True)
        found, used = list[str](), set[str]()
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                found += [each.name for each in node.names]
            elif isinstance(node, ast.ImportFrom):
                beside = package.split(".")[: package.count(".") + 2 - node.level] if node.level else []
                module = ".".join([*beside, *filter(None, [node.module])])
                found += [module, *(f"{module}.{each.name}" for each in node.names)]
                used |= {each.name for each in node.names}
            elif isinstance(node, ast.Name):
                used.add(node.id)
        used |= {each.partition(".")[0] for each in found if not each.startswith(_DATA)}
        outside = sys.stdlib_module_names | {_OWN}
        return cls([each for each in found if each.partition(".")[0] not in outside], not _BY_NAME.isdisjoint(used))


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


def _named(texts: Iterable[str], options: str) -> dict[str, Path]:
    """The files that texts of these options name, and what lies in folders that they name."""
    written = frozenset[str]() if "replay" in _SIGN.split(options) else RECORDS
    found: dict[str, Path] = {}
    for text in texts:
        for name, place in _mentioned(text).items():
            if place.is_file() and place.suffix not in written:
                found[name] = place
            elif place.is_dir() and name not in ("", ".", "/"):
                found |= {f"{name}/{below}": path for below, path in _below(place)}
    return found


def _mentioned(text: str) -> dict[str, Path]:
    """What a text names: a file or a folder as a whole, or else the files whose names stand between signs of it."""
    if (whole := _place(text)) is not None:
        return {text: whole}
    words = _SIGN.split(text)  # each second one is a sign
    parts = (
        "".join(words[first:end]) for first in range(0, len(words), 2) for end in range(first + 1, len(words) + 1, 2)
    )
    return {part: place for part in parts if (place := _place(part)) is not None and place.is_file()}


def _place(name: str) -> Path | None:
    """The file or folder of a name, which may be written as in a URL; None if there is none."""
    for each in dict.fromkeys((name, unquote(name))):
        with suppress(OSError, ValueError, RuntimeError):
            place = Path(each).expanduser()
            if place.exists():
                return place
    return None


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
