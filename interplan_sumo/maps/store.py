"""Where maps lie: a folder laid out as nuPlan's maps root, and the maps in it by name."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from interplan_sumo.errors import MapError, UnknownNameError
from interplan_sumo.maps.geopackage import read_map
from interplan_sumo.resources import maps_root
from interplan_sumo.world.roads import Roads

MANIFEST = "nuplan-maps-v1.0.json"
"""nuPlan's list of the maps in a root, under its default version name."""


@dataclass(frozen=True, slots=True)
class MapFiles:
    """One version of one map on disk: `<root>/<name>/<version>/`."""

    name: str
    version: str
    folder: Path

    @property
    def gpkg(self) -> Path:
        """The map itself, in nuPlan's schema."""
        return self.folder / "map.gpkg"

    @property
    def network(self) -> Path:
        """The SUMO network made from it."""
        return self.folder / "map.net.xml.gz"

    @property
    def ids(self) -> Path:
        """Which lane of the map is which lane of the network, and back."""
        return self.folder / "ids.json"


def maps(root: Path | None = None) -> dict[str, MapFiles]:
    """The maps of a root by name, sorted; the shipped ones by default.

    Locations that the root's manifest names but that are not there are left
    out: hardly anyone keeps all of nuPlan's cities. A missing manifest, or one
    that is not nuPlan's, is a MapError.
    """
    root = maps_root() if root is None else Path(root)
    files = (
        MapFiles(name, version, root / name / version) for name, version in sorted(_manifest(root / MANIFEST).items())
    )
    return {file.name: file for file in files if file.gpkg.is_file()}


def find_map(name_or_folder: str | os.PathLike[str]) -> MapFiles:
    """A map by its name among the shipped ones, or by a folder that holds a map.gpkg.

    The folder may be `<name>/<version>` or, where it has one version, `<name>`.
    A bare word is a name before it is a folder. UnknownNameError if it is neither.
    """
    text = os.fspath(name_or_folder)
    known = maps() if _is_folder_name(text) else {}
    if text in known:
        return known[text]
    folder = Path(text).expanduser()
    if folder.name == "map.gpkg":
        folder = folder.parent
    if not (folder / "map.gpkg").is_file():
        versions = sorted(folder.glob("*/map.gpkg")) if folder.is_dir() else []
        if len(versions) > 1:
            names = ", ".join(file.parent.name for file in versions)
            raise MapError(f"{folder} holds several versions of a map ({names}); name one of these folders")
        if not versions:
            raise UnknownNameError("map", text, known or maps(), "A folder must hold a map.gpkg.")
        folder = versions[0].parent
    folder = folder.resolve()
    return MapFiles(folder.parent.name or folder.name, folder.name, folder)


def load_roads(name_or_folder: str | os.PathLike[str]) -> Roads:
    """The roads of a map, found as `find_map` does; read once per process and version of the file."""
    files = find_map(name_or_folder)
    state = files.gpkg.stat()
    return _roads(files, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=16)
def _roads(files: MapFiles, modified_ns: int, size: int) -> Roads:  # noqa: ARG001 (a changed file is another map)
    return read_map(files.gpkg, files.name)


def write_maps_manifest(root: Path) -> None:
    """Write nuPlan's list of the maps in a root: every `<name>/<version>/map.gpkg`.

    nuPlan knows one version of a location, so several are a MapError.
    """
    root = Path(root)
    versions: dict[str, str] = {}
    for file in sorted(root.glob("*/*/map.gpkg")):
        name, version = file.parent.parent.name, file.parent.name
        if name in versions:
            raise MapError(
                f"{root}: {name} has the versions {versions[name]} and {version}; a maps root holds one of each"
            )
        versions[name] = version
    content = {name: {"version": version, "layers": {}} for name, version in sorted(versions.items())}
    (root / MANIFEST).write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def _manifest(path: Path) -> dict[str, str]:
    """Versions by name."""
    try:
        content: Any = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise MapError(f"no {path.name} in {path.parent}; `write_maps_manifest` makes one") from error
    except (OSError, ValueError) as error:
        raise MapError(f"{path} cannot be read ({error})") from error
    if not isinstance(content, Mapping):
        raise MapError(f"{path} is not nuPlan's list of maps")
    versions: dict[str, str] = {}
    for name, entry in content.items():
        version = entry.get("version") if isinstance(entry, Mapping) else None
        if not isinstance(version, str) or not _is_folder_name(version) or not _is_folder_name(str(name)):
            raise MapError(f"{path}: {name}: names no version")
        versions[str(name)] = version
    return versions


def _is_folder_name(text: str) -> bool:
    """Whether the text can only mean a folder right here."""
    return bool(text) and text not in (".", "..") and not set(text) & set("/\\\0")
