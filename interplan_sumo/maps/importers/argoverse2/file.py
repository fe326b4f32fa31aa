"""The objects of an Argoverse 2 map file, checked; every fault is a MapError that names file, layer, id and field."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec
import numpy as np
import shapely

from interplan_sumo.errors import MapError
from interplan_sumo.world.geometry import Floats

MAX_FILE_BYTES = 200 * 2**20
"""The map of one log has a fifth of a megabyte: a thousand times that is something else."""
_Id = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
_Word = Annotated[str, msgspec.Meta(pattern=r"\A[^\W\d]\w{0,39}\Z")]
_Metres = Annotated[float, msgspec.Meta(ge=-100_000.0, le=100_000.0)]  # no city reaches further from its origin


class _Point(msgspec.Struct):
    x: _Metres
    y: _Metres
    z: _Metres


class Item(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """One object; its lines (N, 3) are x, y and height in city coordinates, no two points the same in the plane."""

    id: _Id


class ArgoverseLane(Item, frozen=True, eq=False):
    """A lane of any type."""

    type: _Word = msgspec.field(name="lane_type")
    left: Floats = msgspec.field(name="left_lane_boundary")
    right: Floats = msgspec.field(name="right_lane_boundary")
    in_intersection: bool = msgspec.field(name="is_intersection")
    successors: tuple[_Id, ...]
    predecessors: tuple[_Id, ...]
    left_neighbour: _Id | None = msgspec.field(name="left_neighbor_id")
    right_neighbour: _Id | None = msgspec.field(name="right_neighbor_id")

    def __post_init__(self) -> None:
        if self.id in (*self.successors, *self.predecessors, self.left_neighbour, self.right_neighbour):
            raise ValueError("names itself beside, before or behind it")
        if not valid_parts(self.ring):
            raise ValueError("left_lane_boundary and right_lane_boundary enclose no surface")

    @property
    def ring(self) -> shapely.Polygon:
        """Its surface, which may cross itself."""
        return shapely.Polygon(np.concatenate((self.left, self.right[::-1]))[:, :2])


class PedestrianCrossing(Item, frozen=True, eq=False):
    """Its two edges, each drawn in any direction."""

    edge1: Floats
    edge2: Floats


class DrivableArea(Item, frozen=True, eq=False):
    """A stretch of road."""

    area_boundary: Floats

    def __post_init__(self) -> None:
        if len(self.area_boundary) < 3:
            raise ValueError(f"area_boundary has {len(self.area_boundary)} distinct points, needs 3")


class MapArchive(msgspec.Struct):
    """A file; the objects of each layer in the file's order."""

    lane_segments: list[ArgoverseLane]
    pedestrian_crossings: list[PedestrianCrossing]
    drivable_areas: list[DrivableArea]


_T = TypeVar("_T", bound=Item)


def map_file(path: Path) -> Path:
    """The map file itself, where `path` is a folder that holds one."""
    path = Path(path)
    if not path.is_dir():
        return path
    files = sorted(path.glob("log_map_archive_*.json"))
    if len(files) != 1:
        raise MapError(f"{path}: holds {len(files) or 'no'} files log_map_archive_*.json; name one file")
    return files[0]


def read_archive(path: Path) -> MapArchive:
    """The objects of a file, in the file's order."""
    content = _content(path)
    archive = MapArchive(
        _layer(path, content, "lane_segments", ArgoverseLane),
        _layer(path, content, "pedestrian_crossings", PedestrianCrossing),
        _layer(path, content, "drivable_areas", DrivableArea),
    )
    if not archive.lane_segments:
        raise MapError(f"{path}: lane_segments is empty; there is no road on this map")
    return archive


def valid_parts(outline: shapely.Geometry) -> list[shapely.Polygon]:
    """The valid polygons within an outline: one, if it does not cross itself."""
    parts = shapely.get_parts(shapely.get_parts(shapely.make_valid(outline)))  # a collection may hold a MultiPolygon
    return [part for part in parts if isinstance(part, shapely.Polygon) and part.area > 0.0]


def _content(path: Path) -> dict[str, Any]:
    try:
        if not path.is_file():
            raise MapError(f"no map file at {path}; Argoverse 2's are called log_map_archive_*.json")
        if path.stat().st_size > MAX_FILE_BYTES:
            raise MapError(f"{path}: the file is larger than {MAX_FILE_BYTES >> 20} MB; it is no map of one log")
        content = json.loads(path.read_bytes(), object_pairs_hook=_once)
    except _TwiceError as error:
        raise MapError(f"{path}: the key {error.args[0][:40]!r} appears twice in one object") from error
    except OSError as error:
        raise MapError(f"{path}: cannot be read ({error.strerror})") from error
    except (ValueError, RecursionError) as error:
        raise MapError(f"{path}: not a JSON file ({' '.join(str(error).split())[:120]})") from error
    if not isinstance(content, dict):
        raise MapError(f"{path}: not an Argoverse 2 map (no object with lane_segments)")
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


def _layer(path: Path, content: dict[str, Any], layer: str, kind: type[_T]) -> list[_T]:
    if layer not in content:
        raise MapError(f"{path}: not an Argoverse 2 map (no {layer})")
    rows = content[layer]
    if not isinstance(rows, dict):
        raise MapError(f"{path}: {layer} is no object, expected objects by id")
    found: list[_T] = []
    for key, fields in rows.items():
        try:
            item = msgspec.convert(fields, kind, dec_hook=_line)
        except msgspec.ValidationError as error:
            raise MapError(f"{path}: {layer} {key[:40]!r}: {error}") from error
        if str(item.id) != key:
            raise MapError(f"{path}: {layer} {key[:40]!r}: its id is {item.id}; both must be the same")
        found.append(item)
    return found


def _line(_kind: type, given: Any) -> Floats:
    try:
        points = np.array([(p.x, p.y, p.z) for p in msgspec.convert(given, list[_Point])]).reshape(-1, 3)
    except msgspec.ValidationError as error:  # as a ValueError it gets the field's name, too
        raise ValueError(str(error)) from None
    repeated = np.zeros(len(points), dtype=np.bool_)
    repeated[1:] = (points[1:, :2] == points[:-1, :2]).all(axis=1)
    line = points[~repeated]
    if len(line) < 2:
        raise ValueError(f"{len(line)} distinct points, a line needs 2")
    return line
