"""The objects of an Argoverse 2 map file, field by field; every fault is a MapError that names file, id and field."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from interplan_sumo.errors import MapError
from interplan_sumo.world.geometry import Floats

LAYERS = ("lane_segments", "pedestrian_crossings", "drivable_areas")
MAX_FILE_BYTES = 200 * 2**20
"""The map of one log has a fifth of a megabyte: a thousand times that is something else."""
MAX_COORDINATE_M = 100_000.0
"""No city reaches further from its origin."""
_MAX_ID = 2**63


@dataclass(frozen=True, slots=True)
class Item:
    """One object of a layer: its fields are read through checks."""

    path: Path
    layer: str
    id: str
    fields: Mapping[str, Any]

    def fault(self, what: str) -> NoReturn:
        """MapError about this object."""
        raise MapError(f"{self.path}: {self.layer} {self.id}: {what}")

    def value(self, field: str) -> Any:
        if field not in self.fields:
            self.fault(f"has no {field}")
        return self.fields[field]

    def text(self, field: str) -> str:
        """A word, such as a type."""
        value = self.value(field)
        if not isinstance(value, str) or not value.isidentifier() or len(value) > 40:
            self.fault(f"{field} is {_brief(value)}, expected a word")
        return value

    def flag(self, field: str) -> bool:
        value = self.value(field)
        if not isinstance(value, bool):
            self.fault(f"{field} is {_brief(value)}, expected true or false")
        return value

    def link(self, field: str) -> str | None:
        """The id of another object, None where the file has null."""
        value = self.value(field)
        return None if value is None else self._other(field, value)

    def links(self, field: str) -> tuple[str, ...]:
        """Ids of other objects, each once."""
        value = self.value(field)
        if not isinstance(value, list):
            self.fault(f"{field} is {_brief(value)}, expected a list of ids")
        return tuple(dict.fromkeys(self._other(field, entry) for entry in value))

    def _other(self, field: str, value: Any) -> str:
        if not is_id(value):
            self.fault(f"{field} holds {_brief(value)}, expected a whole number")
        if str(value) == self.id:
            self.fault(f"{field} names the object itself")
        return str(value)

    def line(self, field: str, least: int = 2) -> Floats:
        """(N, 3) x, y and height of the points of a line, at least `least`; repeated ones are dropped."""
        value = self.value(field)
        if not isinstance(value, list):
            self.fault(f"{field} is {_brief(value)}, expected a list of points")
        try:
            numbers = [point[axis] for point in value for axis in ("x", "y", "z")]
        except (TypeError, LookupError):
            self.fault(f"{field} holds a point without x, y and z")
        for number in numbers:
            if type(number) not in (int, float) or not abs(number) <= MAX_COORDINATE_M:
                self.fault(
                    f"{field} has the coordinate {_brief(number)}, expected metres, at most {MAX_COORDINATE_M:g}"
                )
        points = np.array(numbers, dtype=np.float64).reshape(-1, 3)
        repeated = np.zeros(len(points), dtype=np.bool_)
        repeated[1:] = (points[1:, :2] == points[:-1, :2]).all(axis=1)
        line = points[~repeated]
        if len(line) < least:
            self.fault(f"{field} has {len(line)} distinct points, needs {least}")
        return line


def map_file(path: Path) -> Path:
    """The map file itself, where `path` is a folder that holds one."""
    path = Path(path)
    if not path.is_dir():
        return path
    files = sorted(path.glob("log_map_archive_*.json"))
    if len(files) != 1:
        raise MapError(f"{path}: holds {len(files) or 'no'} files log_map_archive_*.json; name one file")
    return files[0]


def items(path: Path) -> dict[str, list[Item]]:
    """The objects of each layer of a file, in the file's order."""
    content = _content(path)
    return {layer: _layer(path, content, layer) for layer in LAYERS}


def is_id(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < _MAX_ID


def _content(path: Path) -> dict[str, Any]:
    try:
        if not path.is_file():
            raise MapError(f"no map file at {path}; Argoverse 2's are called log_map_archive_*.json")
        if path.stat().st_size > MAX_FILE_BYTES:
            raise MapError(f"{path}: the file is larger than {MAX_FILE_BYTES >> 20} MB; it is no map of one log")
        content = json.loads(path.read_bytes(), object_pairs_hook=_once)
    except _TwiceError as error:
        raise MapError(f"{path}: the key {_brief(error.args[0])} appears twice in one object") from error
    except OSError as error:
        raise MapError(f"{path}: cannot be read ({error.strerror})") from error
    except (ValueError, RecursionError) as error:
        raise MapError(f"{path}: not a JSON file ({' '.join(str(error).split())[:120]})") from error
    if not isinstance(content, dict):
        raise MapError(f"{path}: not an Argoverse 2 map (no object with {LAYERS[0]})")
    return content


class _TwiceError(Exception):
    """A key that an object has twice."""


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in pairs:
        if name in found:
            raise _TwiceError(name)
        found[name] = value
    return found


def _layer(path: Path, content: dict[str, Any], layer: str) -> list[Item]:
    if layer not in content:
        raise MapError(f"{path}: not an Argoverse 2 map (no {layer})")
    rows = content[layer]
    if not isinstance(rows, dict):
        raise MapError(f"{path}: {layer} is {_brief(rows)}, expected objects by id")
    if not rows and layer == LAYERS[0]:
        raise MapError(f"{path}: {layer} is empty; there is no road on this map")
    found: list[Item] = []
    for key, fields in rows.items():
        if not isinstance(fields, dict):
            raise MapError(f"{path}: {layer} {_brief(key)}: is {_brief(fields)}, expected an object")
        id_ = fields.get("id")
        if not is_id(id_) or str(id_) != key:
            raise MapError(f"{path}: {layer} {_brief(key)}: its id is {_brief(id_)}; both must be the same")
        found.append(Item(path, layer, key, fields))
    return found


def _brief(value: Any) -> str:
    """A value in at most 40 characters on one line."""
    if isinstance(value, (list, dict)):
        return f"a {'list' if isinstance(value, list) else 'object'} of {len(value)}"
    return repr(value)[:40]
