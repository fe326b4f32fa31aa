"""Gathered kilometres: the segments of several folders, if they can be held beside one another."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from interplan_sumo.batch.records import RecordError, decode
from interplan_sumo.endurance.kilometres import ABOUT, AboutEndure, read_segments
from interplan_sumo.endurance.records import SegmentRecord, TrafficCell
from interplan_sumo.errors import InputError, RunFolderError


def read_kilometres(folders: Iterable[Path]) -> list[SegmentRecord]:
    """All segments of these folders, each once.

    RunFolderError for a folder that holds none or is damaged, InputError for
    folders of other code, another traffic, map, drivers or planner than those before them,
    and for segments that two of them hold differently.
    """
    first: dict[tuple[str, str], tuple[Path, str]] = {}
    found: dict[tuple[str, TrafficCell, int, int], tuple[Path, SegmentRecord]] = {}
    for folder in folders:
        segments = read_segments(folder)
        for (kind, name), value in _about(folder).items():
            other, held = first.setdefault((kind, name), (folder, value))
            if held != value:
                raise InputError(f"{other} and {folder} are of different {kind} {name}".rstrip() + "; give only one")
        for each in segments:
            key = (each.planner, each.cell, each.seed, each.index)
            other, record = found.setdefault(key, (folder, each))
            if (record.trace_hash, record.events) != (each.trace_hash, each.events):
                raise InputError(
                    f"{other} and {folder} both hold segment {each.index} of {each.planner}, and not the same; "
                    "give only one, or drive with another --seed"
                )
    return [record for _, record in found.values()]


def _about(folder: Path) -> dict[tuple[str, str], str]:
    """What has to be the same in all folders, by kind and name."""
    path = folder / ABOUT
    try:
        about = decode(path.read_bytes(), AboutEndure)
    except OSError as error:
        raise RunFolderError(f"cannot read {path}: {error.strerror or error}") from None
    except RecordError as error:
        raise RunFolderError(f"{path} is damaged ({error})") from None
    named = {"version of": about.versions, "map": about.maps, "drivers": about.drivers, "planner": about.planners}
    return {("code", ""): about.code, ("traffic version", ""): str(about.traffic_version)} | {
        (kind, name): value for kind, of in named.items() for name, value in of.items()
    }
