"""Recorded scenes: from a recording, a log or a configuration to a folder of scenarios that `run` accepts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Literal

from interplan_sumo.errors import InputError, UnknownNameError
from interplan_sumo.maps.store import MANIFEST, MapFiles, find_map, load_roads, maps
from interplan_sumo.recordings.formats import RECORDING_FORMATS, RecordingFormat, format_of
from interplan_sumo.scenario.files import MAPS
from interplan_sumo.scenario.recorded import Agents, RecordedScene, scene
from interplan_sumo.scenario.scenario import first_twice
from interplan_sumo.verification.certificates import Proof
from interplan_sumo.verification.generation import write_proved
from interplan_sumo.verification.map_bundling import carry_map, own_maps_root
from interplan_sumo.world.csv_tables import write_table
from interplan_sumo.world.recording import Recording

LEFT_OUT: Final = "left_out.csv"


@dataclass(frozen=True, slots=True)
class Moments:
    """Which scenes to make of a recording."""

    at_s: tuple[float, ...] = (0.0,)
    ego_id: str | None = None
    """None takes the car that measured."""
    agents: Literal["sumo", "replayed", "both"] = "both"
    goal_m: float | None = None
    duration_s: float | None = None


_FIELD_OF: Final = {"at": "at_s", "ego": "ego_id", "agents": "agents", "goal": "goal_m", "duration": "duration_s"}
"""Options of `scenarios import` that say which scenes to make of any recording, with their fields of `Moments`."""


@dataclass(frozen=True, slots=True)
class ImportedScenes:
    """What was made of a source."""

    scenes: list[RecordedScene]
    notes: tuple[str, ...] = ()
    """About the recordings."""
    not_made: tuple[tuple[str, str], ...] = ()
    """Scenarios that a configuration names and that could not be made, each with the reason."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneFormat(RecordingFormat):
    """A format that is no recording, but names scenes of some: it makes them itself."""

    scenes: Callable[..., ImportedScenes]
    """(path, map, folder, overwrite=, options that it `takes` as keywords) -> scenes, as `import_scenes`."""


def import_scenes(
    source: Path, map: str, folder: Path, options: Mapping[str, Any], format: str | None = None, *, overwrite: bool
) -> ImportedScenes:
    """The scenes of a source, with the part of their maps that they need in `folder`.

    `map` is a map that was imported, a shipped one, or the folder of all maps
    of nuPlan; `options` are those of `scenarios import` that were given, by
    name. InputError if there is no scene, or the format does not take an option.
    """
    kind = RECORDING_FORMATS[format_of(source, format)]
    takes = kind.takes if isinstance(kind, SceneFormat) else tuple(dict.fromkeys((*kind.takes, *_FIELD_OF)))
    odd = [name for name in options if name not in takes]
    if odd:
        known = ", ".join(f"--{name}" for name in takes)
        raise InputError(f"{source} is {kind.title}, which takes no --{', --'.join(odd)}; it takes {known}")
    asked = {name: value for name, value in options.items() if name in kind.takes}
    if isinstance(kind, SceneFormat):
        return kind.scenes(source, map, folder, overwrite=overwrite, **asked)
    read = kind.read(source, **asked)
    recordings = (read,) if isinstance(read, Recording) else tuple(read)
    if not recordings:
        raise InputError(f"{source}: there is no recording in it")
    files = recorded_map(map, recordings[0].map_name)
    rest = {field: options[name] for name, field in _FIELD_OF.items() if name in options}
    if "at" in kind.takes:
        rest.pop("at_s", None)  # every recording begins at its moment
    scenes = recorded_scenes(recordings, files, Moments(**rest), folder, overwrite=overwrite)
    if len(recordings) == 1:
        return ImportedScenes(scenes, recordings[0].notes)
    return ImportedScenes(scenes, tuple(f"{each.ego_id}: {note}" for each in recordings for note in each.notes))


def recorded_map(map: str, location: str | None) -> MapFiles:
    """The map that a name or folder means for a recording of some location; UnknownNameError if there is none.

    A folder that holds nuPlan's manifest, or one named after the location, is
    the root of all maps.
    """
    root = Path(map).expanduser()
    if location is None:
        return find_map(map)
    if (root / MANIFEST).is_file():
        held = maps(root)
        if location not in held:
            raise UnknownNameError("map", location, held, f"The log was recorded there; {root} lacks it.")
        return held[location]
    return find_map(root / location if (root / location).is_dir() else map)


def recorded_scenes(
    recordings: Sequence[Recording], files: MapFiles, moments: Moments, folder: Path, *, overwrite: bool = False
) -> list[RecordedScene]:
    """The scenes of recordings on one map, with the part of it that they need: in `folder`, unless it is a shipped one.

    ScenarioError if there is no such scene, otherwise as `carry_map`.
    """
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
    twice = first_twice(each.scenario.id for each in made)
    if twice and len(recordings) > 1:
        raise InputError(f"two scenes would be called {twice}; name one moment at a time with --ego")
    if twice:
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


def write_scenes(folder: Path, scenes: Sequence[RecordedScene], proofs: Iterable[Proof]) -> int:
    """Write scenarios, certificates, the report and who was left out; how many are certified."""
    passed = write_proved(folder, [each.scenario for each in scenes], proofs)
    rows = [(each.scenario.id, track, reason) for each in scenes for track, reason in each.left_out]
    write_table(folder / LEFT_OUT, ("scenario_id", "track", "reason"), rows)
    return passed
