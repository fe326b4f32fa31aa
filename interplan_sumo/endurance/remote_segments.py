"""Remote segments: segments driven on machines that do not see the folder; the events that they keep are fetched."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from interplan_sumo.batch.remote_jobs import Files, RemoteJobs
from interplan_sumo.batch.run_folder import TRAFFIC
from interplan_sumo.batch.tasks import OpenGroup, Task
from interplan_sumo.endurance.segment_job import SegmentSettings
from interplan_sumo.endurance.segment_worker import segment_jobs
from interplan_sumo.scenario.files import MAPS


@dataclass(slots=True)
class RemoteSegments:
    """The segments of one command on any machine: its drivers go with them, and its map if it is not a shipped one."""

    settings: SegmentSettings
    _kept: RemoteJobs = field(init=False)
    """Fetches what events leave behind, as of drives."""

    def __post_init__(self) -> None:
        self._kept = RemoteJobs(self.settings.drive)

    def stage_in(self) -> Files:
        settings = self.settings
        found = {f"{TRAFFIC}/{settings.types_path.name}": settings.types_path.read_bytes()}
        if settings.maps_beside is not None:
            folder = Path(settings.map)
            for path in sorted(folder.rglob("*")):
                if path.is_file():
                    found[f"{MAPS}/{folder.name}/{path.relative_to(folder).as_posix()}"] = path.read_bytes()
        return found

    def open_in(self, folder: Path) -> OpenGroup:
        there = replace(
            self.settings,
            drive=replace(self.settings.drive, folder=folder),
            types_path=folder / TRAFFIC / self.settings.types_path.name,
        )
        if self.settings.maps_beside is not None:
            maps = folder / MAPS
            there = replace(there, map=str(maps / Path(self.settings.map).name), maps_beside=maps)
        return segment_jobs(there)

    def needs(self, task: Task) -> Files:  # noqa: ARG002 (as the protocol has it)
        return {}

    def collect(self, folder: Path) -> Files:
        return self._kept.collect(folder)

    def stage_out(self, files: Files) -> None:
        self._kept.stage_out(files)
