"""Redo: drives of a run folder that are done again, and what is noted until all of them have been."""

from __future__ import annotations

from collections.abc import Container
from pathlib import Path
from typing import Final

from msgspec import DecodeError, json

from interplan_sumo.batch.records import Manifest
from interplan_sumo.batch.results import RESULTS, read_briefs, write_lines
from interplan_sumo.world.files import replacing

REDO: Final = "redo.json"


class Redo:
    """The planners whose drives in a folder are to be done again.

    Their rows go once. Until all have driven, a note says whose have gone, and of which version of them: the same
    command goes on with what is done since. OSError if something cannot be written.
    """

    def __init__(self, folder: Path, asked: Container[str]) -> None:
        self._results, self._note = folder / RESULTS, folder / REDO
        self._asked = asked

    def __contains__(self, planner: str) -> bool:
        return planner in self._asked

    def take_away_rows(self, wanted: Manifest) -> None:
        """Those of planners that are to drive again, but for what they have driven since the note was made."""
        begun = self._begun()
        asked = (name for request in wanted.requests for name in request.planners if name in self._asked)
        now = {name: wanted.planners[name].hash if name in wanted.planners else "" for name in asked}
        away = {name for name, hash in now.items() if begun.get(name) != hash}
        if any(key[1] in away for _, key, _ in read_briefs(self._results)):
            write_lines(self._results, (line for line, key, _ in read_briefs(self._results) if key[1] not in away))
        if away:
            self._write(begun | now)

    def strike_out(self, manifest: Manifest) -> None:
        """Take from the note who has driven all that the folder asks of it."""
        if begun := self._begun():
            done = {key for _, key, _ in read_briefs(self._results)}
            lacking = {key[1] for key in manifest.keys if key not in done}
            self._write({name: hash for name, hash in begun.items() if name in lacking})

    def _begun(self) -> dict[str, str]:
        """Hashes of planners by name; empty for those that exist in a process only."""
        try:
            return json.decode(self._note.read_bytes(), type=dict[str, str])
        except (FileNotFoundError, DecodeError):
            return {}

    def _write(self, begun: dict[str, str]) -> None:
        if begun:
            with replacing(self._note) as fresh:
                fresh.write_bytes(json.encode(begun) + b"\n")
        else:
            self._note.unlink(missing_ok=True)
