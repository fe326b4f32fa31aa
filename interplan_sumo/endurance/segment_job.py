"""Segment job: what a worker does for one segment: drive it, find its events, keep the seconds around each."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from interplan_sumo.batch.drive_job import DriveSettings
from interplan_sumo.batch.records import Fault
from interplan_sumo.endurance.records import Probability, RareKind, SegmentRecord, TrafficCell
from interplan_sumo.endurance.segment_plan import SEGMENT_M

MOST_KEPT: Final = 6
"""So many events of a segment are kept as traces; all are counted."""


@dataclass(frozen=True, slots=True)
class SegmentJob:
    """One segment: the same start and the same traffic for whoever drives."""

    index: int
    cell: TrafficCell
    planner: str
    seed: int
    naive: bool
    natural: dict[RareKind, Probability]
    """Per opportunity and second."""
    drawn_with: dict[RareKind, Probability]
    """Where it is not naive."""

    @property
    def id(self) -> str:
        """Of its trip, as a scenario."""
        cell = self.cell
        return f"endure/{cell.map}-{cell.density:g}-{cell.drivers}-{self.seed}-{self.index}"


@dataclass(frozen=True, slots=True)
class SegmentSettings:
    """What all segments of a command share."""

    drive: DriveSettings
    """Its folder is where the events are kept."""
    map: str
    """Name or folder."""
    maps_beside: Path | None
    """Where the map lies, if it is not a shipped one."""
    types_path: Path
    saturation_per_km: float
    """Vehicles on a kilometre of one lane at which the district carries most."""
    most_m: float = SEGMENT_M
    planner_hashes: dict[str, str] = field(default_factory=dict[str, str])


def empty_record(job: SegmentJob, fault: Fault | None, planner_hash: str | None) -> SegmentRecord:
    """Of a segment in which nobody drove, because of a fault."""
    return SegmentRecord(
        index=job.index, cell=job.cell, planner=job.planner, planner_hash=planner_hash, seed=job.seed,
        naive=job.naive, start="", metres=0.0, seconds=0.0, weighted_metres=0.0, weighted_seconds=0.0,
        final_weight=1.0, natural=job.natural, drawn_with=job.natural if job.naive else job.drawn_with,
        opportunities={}, rare_events=(), events=(), fault=fault,
    )  # fmt: skip
