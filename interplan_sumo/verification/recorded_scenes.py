"""Recorded scenes: from the file of a recording to a folder of scenarios that `run` accepts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

from interplan_sumo.errors import InputError, UnknownNameError
from interplan_sumo.maps.store import MapFiles, load_roads
from interplan_sumo.scenario.files import MAPS
from interplan_sumo.scenario.recorded import GOAL_M, Agents, RecordedScene, scene
from interplan_sumo.verification.certificates import SearchResult
from interplan_sumo.verification.generation import write_proved, write_rows
from interplan_sumo.verification.map_bundling import carry_map, own_maps_root
from interplan_sumo.world.recording import Recording

LEFT_OUT: Final = "left_out.csv"
_PARQUET: Final = b"PAR1"
_COMMONROAD: Final = b"<commonRoad"
_SQLITE: Final = b"SQLite format 3"
_HEAD_BYTES: Final = 4096
NUPLAN: Final = "nuplan"
INTERPLAN: Final = "interplan"


@dataclass(frozen=True, slots=True)
class Moments:
    """Which scenes to make of a recording."""

    at_s: tuple[float, ...] = (0.0,)
    ego_id: str | None = None
    """None takes the car that measured."""
    agents: Literal["sumo", "replayed", "both"] = "both"
    goal_m: float = GOAL_M
    duration_s: float | None = None


def _argoverse2() -> Callable[[Path], Recording]:
    from interplan_sumo.recordings.argoverse2 import read_argoverse2_recording

    return read_argoverse2_recording


def _commonroad() -> Callable[[Path], Recording]:
    from interplan_sumo.recordings.commonroad import read_commonroad_recording

    return read_commonroad_recording


FORMATS: Final[dict[str, Callable[[], Callable[[Path], Recording]]]] = {
    "argoverse2": _argoverse2,
    "commonroad": _commonroad,
}
"""Readers of files that are one recording, by the name that the command takes."""
NAMES: Final = (*FORMATS, NUPLAN, INTERPLAN)
"""All formats: a log of nuPlan holds many scenes, a configuration of interPlan names some."""


def read_recording(source: Path, format: str | None = None) -> Recording:
    """A recording of a known format, told by its content if it is not named; InputError if it cannot be read."""
    return FORMATS[format_of(source, format)]()(source)


def format_of(source: Path, format: str | None = None) -> str:
    """The format that is named, else that of the first bytes; a folder holds Parquet files. InputError if unknown."""
    if format is not None:
        if format not in NAMES:
            raise UnknownNameError("format of recordings", format, NAMES)
        return format
    if source.is_dir():
        return "argoverse2"
    try:
        with source.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except OSError as error:
        raise InputError(f"cannot read {source}: {error.strerror or error}") from None
    if head.startswith(_PARQUET):
        return "argoverse2"
    if _COMMONROAD in head:
        return "commonroad"
    if head.startswith(_SQLITE):
        return NUPLAN
    raise InputError(f"{source} is no recording of a known format ({', '.join(NAMES)}); name one with --format")


def recorded_scenes(
    recording: Recording, files: MapFiles, moments: Moments, folder: Path, *, overwrite: bool = False
) -> list[RecordedScene]:
    """The scenes, on the part of the map that they need: in `folder`, unless the map is a shipped one.

    ScenarioError if there is no such scene, otherwise as `carry_map`.
    """
    return scenes_of((recording,), files, moments, folder, overwrite=overwrite)


def scenes_of(
    recordings: Sequence[Recording], files: MapFiles, moments: Moments, folder: Path, *, overwrite: bool = False
) -> list[RecordedScene]:
    """`recorded_scenes` of several recordings on one map."""
    roads = load_roads(files.folder)
    forms: tuple[Agents, ...] = ("replayed", "sumo") if moments.agents == "both" else (moments.agents,)
    made = [
        scene(
            recording, roads, ego_id=moments.ego_id, at_s=at_s, agents=agents,
            goal_m=moments.goal_m, duration_s=moments.duration_s,
        )
        for recording in recordings
        for at_s in dict.fromkeys(moments.at_s)
        for agents in forms
    ]  # fmt: skip
    ids = [each.scenario.id for each in made]
    if len(set(ids)) < len(ids) and len(recordings) > 1:
        twice = next(id for i, id in enumerate(ids) if id in ids[:i])
        raise InputError(f"two scenes would be called {twice}; name one moment at a time with --ego")
    if len(set(ids)) < len(ids):
        raise InputError(f"two of the times {', '.join(f'{at_s:g}' for at_s in moments.at_s)} s are the same step")
    return carried(made, files, folder, overwrite=overwrite)


def carried(
    made: list[RecordedScene], files: MapFiles, folder: Path, *, overwrite: bool = False
) -> list[RecordedScene]:
    """The scenes with what they need of their map in `folder`; as they are if the map is a shipped one."""
    if own_maps_root(files) is None:
        return made
    roads = load_roads(files.folder)
    carry_map(files, roads, [each.scenario for each in made], folder / MAPS, overwrite=overwrite)
    beside = folder.resolve() / MAPS
    return [replace(each, scenario=replace(each.scenario, maps_beside=beside)) for each in made]


def write_scenes(folder: Path, scenes: Sequence[RecordedScene], verdicts: Iterable[SearchResult]) -> int:
    """Write scenarios, certificates, the report and who was left out; how many are certified."""
    passed = write_proved(folder, [each.scenario for each in scenes], verdicts)
    rows = [(each.scenario.id, track, reason) for each in scenes for track, reason in each.left_out]
    write_rows(folder / LEFT_OUT, ("scenario_id", "track", "reason"), rows)
    return passed
