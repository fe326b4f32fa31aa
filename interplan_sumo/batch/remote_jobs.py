"""Remote jobs: drives on machines that do not see the run folder: what they need is sent, what they write fetched."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from typing import Protocol

from interplan_sumo.batch import custom_references
from interplan_sumo.batch.drive_job import DriveSettings, drive_jobs, place_trace
from interplan_sumo.batch.run_folder import TRAFFIC, trace_place
from interplan_sumo.batch.tasks import OpenGroup, Task
from interplan_sumo.errors import RunFolderError
from interplan_sumo.scenario.files import MAPS
from interplan_sumo.world.files import PART, replacing, writing
from interplan_sumo.world.trace import PLANS_FILE

TRACES = "traces"
PLANS = "plans"
"""Where over there the plans lie that a drive is to be made of."""

Files = dict[str, bytes]
"""Contents by relative path, with forward slashes."""


class Portable(Protocol):
    """Tasks that can be done on another machine, in a folder that stands for the one at home. Picklable."""

    def stage_in(self) -> Files:
        """At home: what must lie in the folder before the first task."""
        ...

    def open_in(self, folder: Path) -> OpenGroup:
        """There: opens groups whose tasks read and write this folder."""
        ...

    def needs(self, task: Task) -> Files:
        """At home: what must lie in the folder for this task alone."""
        ...

    def collect(self, folder: Path) -> Files:
        """There, after each task: what is to come home; it is cleared away or is not collected twice."""
        ...

    def stage_out(self, files: Files) -> None:
        """At home: put what was collected in its place; InputError if that cannot be written."""
        ...


@dataclass(slots=True)
class RemoteJobs:
    """The drives of one run."""

    settings: DriveSettings
    _known: set[str] = field(default_factory=set[str], init=False)
    """The experts that home has."""

    def stage_in(self) -> Files:
        folder = self.settings.folder
        maps = self.settings.maps_beside or folder / MAPS
        files = {path: _read(folder / path) for path in _below(folder, custom_references.FOLDER)}
        files |= {f"{MAPS}/{path}": _read(maps / path) for path in _below(maps, ".")}
        if (types := self.settings.options.traffic) is not None:
            files[f"{TRAFFIC}/{types.name}"] = _read(types)
        return files

    def open_in(self, folder: Path) -> OpenGroup:
        self._known = set(_below(folder, custom_references.FOLDER))
        options = self.settings.options
        if options.traffic is not None:
            options = replace(options, traffic=folder / TRAFFIC / options.traffic.name)
        plans = None if self.settings.plans_of is None else folder / PLANS
        there = replace(self.settings, folder=folder, options=options, maps_beside=folder / MAPS, plans_of=plans)
        return drive_jobs(there)

    def needs(self, task: Task) -> Files:
        if self.settings.plans_of is None:
            return {}
        place = trace_place(task.payload.key)
        return {f"{PLANS}/{place}/{PLANS_FILE}": _read(self.settings.plans_of / place / PLANS_FILE)}

    def collect(self, folder: Path) -> Files:
        fresh = [path for path in _below(folder, custom_references.FOLDER) if path not in self._known]
        self._known.update(fresh)
        files = {path: (folder / path).read_bytes() for path in (*fresh, *_below(folder, TRACES))}
        for fetched in (TRACES, PLANS):
            shutil.rmtree(folder / fetched, ignore_errors=True)
        return files

    def stage_out(self, files: Files) -> None:
        traces: dict[str, Files] = {}
        for path, content in files.items():
            place = PurePosixPath(path)
            if place.parts[0] == TRACES:
                traces.setdefault(str(place.parent), {})[place.name] = content
            else:
                _put(self.settings.folder / path, content)
        for place, parts in traces.items():
            place_trace(self.settings.folder, place, lambda fresh, parts=parts: write_files(fresh, parts))


def write_files(folder: Path, files: Files) -> None:
    """Write files below a folder; OSError if that cannot be."""
    for path, content in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(content)


def _below(folder: Path, part: str) -> Iterator[str]:
    """The finished files in a part of a folder, relative to the folder."""
    for path in sorted((folder / part).rglob("*")):
        place = path.relative_to(folder)
        if path.is_file() and not any(name.startswith(PART) for name in place.parts):
            yield place.as_posix()


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise RunFolderError(f"cannot read {path}: {error.strerror}") from None


def _put(path: Path, content: bytes) -> None:
    """Write a file of the run folder so that it is there as a whole or not at all."""
    with writing(path, kind=RunFolderError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as fresh:
            fresh.write_bytes(content)
