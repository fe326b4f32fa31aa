"""From what a user has to scenes: a recording, a log of nuPlan, or interPlan's own configuration."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from interplan_sumo.errors import InputError
from interplan_sumo.maps.store import find_map
from interplan_sumo.scenario.recorded import RecordedScene
from interplan_sumo.verification.nuplan_scenes import Picked, nuplan_scenes
from interplan_sumo.verification.original_scenes import original_scenes
from interplan_sumo.verification.recorded_scenes import (
    INTERPLAN,
    NUPLAN,
    Moments,
    format_of,
    read_recording,
    recorded_scenes,
)


@dataclass(frozen=True, slots=True)
class SceneSource:
    """What scenes are made of."""

    path: Path
    map: str
    """A map, or the folder of all maps of nuPlan."""
    format: str | None = None
    """None: told by its content."""
    picked: Picked = field(default_factory=Picked)
    logs: tuple[Path, ...] = ()
    """Of interPlan's configuration."""


@dataclass(frozen=True, slots=True)
class Imported:
    """What was made of it."""

    scenes: list[RecordedScene]
    notes: tuple[str, ...]
    """About the recordings."""
    not_made: tuple[tuple[str, str], ...] = ()
    """Scenarios that a configuration names and that could not be made, each with the reason."""


def import_source(source: SceneSource, moments: Moments, folder: Path, *, overwrite: bool = False) -> Imported:
    """The scenes, with the part of their maps that they need in `folder`. InputError if there is none."""
    name = format_of(source.path, source.format)
    if name == INTERPLAN:
        if source.picked != Picked() or moments != Moments():
            raise InputError(
                f"{source.path} says itself when its scenes begin and who drives; leave out --at, --token, --tag, "
                "--count, --ego, --agents, --goal and --duration"
            )
        made, not_made = original_scenes(source.path, source.map, source.logs, folder, overwrite=overwrite)
        return Imported(made, (), not_made)
    if source.logs:
        raise InputError(f"--logs belong to a configuration (--format {INTERPLAN}); give a log itself as the source")
    if name == NUPLAN:
        made, notes = nuplan_scenes(source.path, source.map, source.picked, moments, folder, overwrite=overwrite)
        return Imported(made, notes)
    if source.picked.tokens or source.picked.tags:
        raise InputError(
            f"--token and --tag belong to nuPlan's logs; {source.path} is one of {name}: give times as --at"
        )
    recording = read_recording(source.path, name)
    made = recorded_scenes(recording, find_map(source.map), moments, folder, overwrite=overwrite)
    return Imported(made, recording.notes)
