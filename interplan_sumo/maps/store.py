"""Where maps lie: a folder laid out as nuPlan's maps root, and the maps in it by name."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any, Final

from interplan_sumo.errors import MapError, UnknownNameError
from interplan_sumo.maps.geopackage import read_map
from interplan_sumo.resources import maps_root
from interplan_sumo.world.roads import Roads

MANIFEST = "nuplan-maps-v1.0.json"
"""nuPlan's list of the maps in a root, under its default version name."""


SHOWN: Final = "[!.]*"
"""Folders whose name begins with a dot are being written, or were when that was stopped."""


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

    def hash(self) -> str:
        """SHA-256 over the three files; MapError if one cannot be read."""
        digest = hashlib.sha256()
        for path in (self.gpkg, self.network, self.ids):
            try:
                digest.update(hashlib.sha256(path.read_bytes()).digest())
            except OSError as error:
                raise MapError(
                    f"cannot read {path}: {error.strerror or error}; `interplan-sumo maps convert {self.folder}` "
                    "makes the network of a map"
                ) from None
        return digest.hexdigest()


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


def find_map(name_or_folder: str | os.PathLike[str], beside: Path | None = None) -> MapFiles:
    """A map by its name among the shipped ones, or by a folder that holds a map.gpkg.

    `beside` is the maps folder that came along with a scenario: a name may be
    one in there, too. The folder may be `<name>/<version>` or, where it has one
    version, `<name>`. A bare word is a name before it is a folder.
    UnknownNameError if it is neither, MapError if a name is shipped and beside.
    """
    text = os.fspath(name_or_folder)
    if not _is_folder_name(text):
        return _in_folder(Path(text).expanduser(), maps())
    known = maps()
    own = _folders(beside)
    if text in own:
        if text in known:
            raise MapError(
                f"map {text!r} is a shipped one and lies in {beside}, too; rename that folder, and `map` of its "
                "scenarios"
            )
        return _in_folder(own[text])
    return known[text] if text in known else _in_folder(Path(text).expanduser(), (*known, *own))


def _folders(beside: Path | None) -> dict[str, Path]:
    """The folders in the one that came along, by name."""
    return {each.name: each for each in beside.iterdir() if each.is_dir()} if beside and beside.is_dir() else {}


def _in_folder(folder: Path, known: Iterable[str] = ()) -> MapFiles:
    """The map of a folder; `known` are names that could have been meant."""
    text = os.fspath(folder)
    if folder.name == "map.gpkg":
        folder = folder.parent
    if not (folder / "map.gpkg").is_file():
        versions = sorted(folder.glob(f"{SHOWN}/map.gpkg")) if folder.is_dir() else []
        if len(versions) > 1:
            names = ", ".join(file.parent.name for file in versions)
            raise MapError(f"{folder} holds several versions of a map ({names}); name one of these folders")
        if folder.is_file():
            which = "sumo" if ".net.xml" in folder.name else "FORMAT"
            way = f"interplan-sumo maps import {folder} --format {which} --out DIR"
            raise MapError(f"{folder} is a file, not a folder with a map.gpkg; import it: {way}")
        if not versions:
            raise UnknownNameError("map", text, known, "A folder must hold a map.gpkg.")
        folder = versions[0].parent
    folder = folder.resolve()
    return MapFiles(folder.parent.name or folder.name, folder.name, folder)


def load_roads(name_or_folder: str | os.PathLike[str], beside: Path | None = None) -> Roads:
    """The roads of a map, found as `find_map` does; read once per process and version of the file."""
    files = find_map(name_or_folder, beside)
    state = files.gpkg.stat()
    return _roads(files, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=16)
def _roads(files: MapFiles, modified_ns: int, size: int) -> Roads:  # noqa: ARG001 (a changed file is another map)
    return read_map(files.gpkg, files.name)


def is_shipped(files: MapFiles) -> bool:
    """Whether a map is one that comes with the package."""
    shipped = maps().get(files.name)
    return shipped is not None and shipped.folder.resolve() == files.folder.resolve()


def copy_map(files: MapFiles, root: Path) -> MapFiles:
    """Copy a map with all that lies in its folder into a root, in place of what has its name there; its new place.

    Nothing happens if it lies there already. MapError if it cannot be read or written.
    """
    there = MapFiles(files.name, files.version, root / files.name / files.version)
    if there.folder.resolve() == files.folder.resolve():
        return there
    return place_map(there, root, lambda folder: shutil.copytree(files.folder, folder, dirs_exist_ok=True))


def place_map(files: MapFiles, root: Path, fill: Callable[[Path], object]) -> MapFiles:
    """Put a map in its place in a root once `fill` has written all of it into an empty folder, and renew the list."""
    try:
        root.mkdir(parents=True, exist_ok=True)
        fresh = Path(mkdtemp(prefix=".writing-", dir=root))
        try:
            fill(fresh)
            shutil.rmtree(root / files.name, ignore_errors=True)
            files.folder.parent.mkdir()
            fresh.chmod(files.folder.parent.stat().st_mode)  # mkdtemp lets nobody else in
            fresh.rename(files.folder)
        finally:
            shutil.rmtree(fresh, ignore_errors=True)
        write_maps_manifest(root)
    except OSError as error:
        raise MapError(f"cannot put map {files.name} into {root}: {error}") from None
    return files


def write_maps_manifest(root: Path) -> None:
    """Write nuPlan's list of the maps in a root: every `<name>/<version>/map.gpkg`.

    nuPlan knows one version of a location, so several are a MapError.
    """
    root = Path(root)
    versions: dict[str, str] = {}
    for file in sorted(root.glob(f"{SHOWN}/{SHOWN}/map.gpkg")):
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
