"""Formats of recorded traffic: what reads each, found by entry point and told by content.

A package adds one by naming a `RecordingFormat` in its `pyproject.toml` under
`interplan_sumo.recording_formats`; ours stand in our own, in the same way.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from interplan_sumo.errors import InputError
from interplan_sumo.registry import Registry
from interplan_sumo.world.recording import Recording

_HEAD_BYTES: Final = 4096


@dataclass(frozen=True, slots=True)
class RecordingFormat:
    """A format of recorded traffic."""

    title: str
    """What people call one, such as "a log of nuPlan"."""
    matches: Callable[[Path], bool]
    """Whether a file or folder is one, by its content; cheap, and without an error for what is something else."""
    read: Callable[..., Recording | Sequence[Recording]]
    """Path -> recording, or one for each scene that is asked for; InputError with one line where it cannot be used."""
    takes: tuple[str, ...] = ()
    """Options of `scenarios import` that `read` takes as keywords, if they are given, beside the path: such as "token".

    One that takes "at" picks the moments itself: scenes begin where its recordings do.
    """
    lasts: Callable[[Path], tuple[float, str]] | None = None
    """Of files much longer than a scene: how many seconds one lasts, and the map it was recorded on."""
    is_folder: bool = False
    """Whether the files of a folder make up one recording."""


RECORDING_FORMATS = Registry("interplan_sumo.recording_formats", "format of recordings", RecordingFormat)
"""By the name that `scenarios import --format` takes."""


def head(path: Path) -> bytes:
    """The first bytes of a file; none of a folder, or of what cannot be read."""
    try:
        with path.open("rb") as file:
            return file.read(_HEAD_BYTES)
    except OSError:
        return b""


def format_of(source: Path, name: str | None = None) -> str:
    """The format that is named, else the one that the content is of; InputError if there is none, or several."""
    if name is not None:
        RECORDING_FORMATS.point(name)
        return name
    if not source.exists():
        raise InputError(f"cannot read {source}: there is no such file or folder")
    found = [each for each in RECORDING_FORMATS if RECORDING_FORMATS[each].matches(source)]
    if len(found) == 1:
        return found[0]
    if found:
        raise InputError(f"{source} may be of the formats {' and '.join(found)}; name one with --format")
    known = ", ".join(RECORDING_FORMATS)
    raise InputError(f"{source} is no recording of a known format ({known}); name one with --format")
