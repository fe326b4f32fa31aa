"""interPlan's scenarios from a user's copy of nuPlan: configuration, logs and maps in, scenes out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, NoReturn

from interplan_sumo.errors import InputError
from interplan_sumo.families import find_family, original_names
from interplan_sumo.maps.store import MapFiles, load_roads
from interplan_sumo.recordings.formats import head
from interplan_sumo.recordings.nuplan_db import NuplanLog, log_files, tokens_held
from interplan_sumo.scenario.original import read_original
from interplan_sumo.scenario.original_config import TOKENS, Configuration, known_tokens, read_configuration
from interplan_sumo.scenario.original_scene import DURATION_S, original_scene
from interplan_sumo.scenario.recorded import RecordedScene
from interplan_sumo.verification.recorded_scenes import ImportedScenes, SceneFormat, carried, recorded_map
from interplan_sumo.world.recording import Recording

SAID_OF_LOG: Final = "The log "
"""How notes of a recording begin that concern the ego; those about others do not matter, for they are left out."""


@dataclass(frozen=True, slots=True)
class _Cut:
    """The piece of a log that begins at a token, and its map."""

    recording: Recording
    files: MapFiles


def original_scenes(
    source: Path, map: str, folder: Path, *, logs: Sequence[Path] = (), overwrite: bool = False
) -> ImportedScenes:
    """The scenes of a configuration, with the part of each map that they need in `folder`; what was not made, and why.

    `map` is the folder of nuPlan's maps, `logs` are its .db files or folders of
    them. InputError if the configuration cannot be read or nothing can be made.
    """
    if not logs:
        raise InputError(
            f"{source} names scenarios of nuPlan's logs; give these as --logs, .db files or folders of them"
        )
    configuration = read_configuration(source)
    cuts, problems = _cuts(configuration, logs, map)
    made: dict[str, tuple[MapFiles, list[RecordedScene]]] = {}
    not_made: list[tuple[str, str]] = []
    for name in configuration.names:
        try:
            token = name.partition("-")[0]
            original = read_original(name, configuration.details.get(token, {}), original_names())
            cut = cuts.get(token)
            if cut is None:
                raise InputError(problems[token])
            scene = original_scene(
                original, cut.recording, load_roads(cut.files.folder), find_family(original.family).exempt
            )
            notes = (*(note for note in cut.recording.notes if note.startswith(SAID_OF_LOG)), *scene.notes)
            made.setdefault(cut.files.name, (cut.files, []))[1].append(replace(scene, notes=notes))
        except InputError as error:
            not_made.append((name, str(error)))
    if not made:
        name, reason = not_made[0]
        raise InputError(f"{source}: none of its {len(not_made)} scenarios can be made; the first, {name}: {reason}")
    scenes = [
        scene
        for files, part in made.values()
        for scene in carried(part, files, folder, overwrite=overwrite)
    ]  # fmt: skip
    return ImportedScenes(scenes, not_made=tuple(not_made))


def _cuts(configuration: Configuration, logs: Sequence[Path], map: str) -> tuple[dict[str, _Cut], dict[str, str]]:
    """By token what is in the logs, and why the others are not."""
    tokens = known_tokens(configuration.names)
    files = log_files(logs)
    named = [file for file in files if file.stem in configuration.logs]
    held, problems = _held(named or files, tokens)
    cuts: dict[str, _Cut] = {}
    for file in sorted(set(held.values())):
        try:
            with NuplanLog(file) as log:
                there = recorded_map(map, log.map_name)
                for token in (token for token, path in held.items() if path == file):
                    try:
                        cuts[token] = _Cut(log.recording(log.moment(token), DURATION_S), there)
                    except InputError as error:
                        problems[token] = str(error)
        except InputError as error:
            problems |= {token: str(error) for token, path in held.items() if path == file}
    return cuts, problems


def _held(files: Sequence[Path], tokens: Sequence[str]) -> tuple[dict[str, Path], dict[str, str]]:
    """Which log holds each token, the first of several; for the others that none does, and which could not be read."""
    held: dict[str, Path] = {}
    broken: list[str] = []
    for file in files:
        missing = [token for token in tokens if token not in held]
        try:
            held |= dict.fromkeys(tokens_held(file, missing), file)
        except InputError as error:
            broken.append(str(error))
    unread = f"; {len(broken)} could not be read, such as {broken[0]}" if broken else ""
    reason = "token {} is in none of the {} logs{}"
    return held, {token: reason.format(token, len(files), unread) for token in tokens if token not in held}


def _read(path: Path) -> NoReturn:
    raise InputError(f"{path}: interPlan's configuration is no recording; give nuPlan's logs themselves")


def _is_configuration(path: Path) -> bool:
    return not path.is_dir() and TOKENS.encode() in head(path)


FORMAT = SceneFormat(
    title="a configuration of interPlan",
    matches=_is_configuration,
    read=_read,
    takes=("logs",),
    scenes=original_scenes,
)
