"""Family: a process and all that it has started, ended together."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

_ROUNDS = 20
"""A family that forks while it is ended is looked for again this often."""


class _Relation(NamedTuple):
    parent: int
    session: int
    began: int
    """Ticks after the machine did: with its number it is the process's own, numbers alone come again."""


def descendants(pid: int, *, session: int | None = None) -> dict[int, int]:
    """Who descends from a process, or belongs to a session, and when each began; nobody where there is no /proc."""
    relations = dict(_processes())
    found = {each for each, relation in relations.items() if relation.session == session} if session else set[int]()
    wave = {pid, *found}
    while wave:
        wave = {each for each, relation in relations.items() if relation.parent in wave} - found - {pid}
        found |= wave
    return {each: relations[each].began for each in sorted(found - {pid})}


def kill_family(pid: int, *, session: int | None = None, known: Mapping[int, int] | None = None) -> None:
    """Kill a process that was not waited for yet, its group, all its descendants and whoever else is of the session.

    `known` are its `descendants` of a moment ago, which nobody may know for its own since it has ended. Who has ended
    since, and whose number is somebody else's now, is left alone.
    """
    if known:
        now = {each: relation.began for each, relation in _processes()}
        _kill(each for each, began in known.items() if now.get(each) == began)
    for _ in range(_ROUNDS):
        family = descendants(pid, session=session)
        if hasattr(os, "killpg"):
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(pid, signal.SIGKILL)
        _kill((pid, *family))
        if not family:
            return
        _reap(family)


def _kill(pids: Iterable[int]) -> None:
    for each in pids:
        with suppress(ProcessLookupError, PermissionError):
            os.kill(each, getattr(signal, "SIGKILL", signal.SIGTERM))  # Windows has one way to end a process


def _reap(pids: Iterable[int]) -> None:
    """Leave no zombies of those that became children of this process."""
    for each in pids:
        with suppress(ChildProcessError):
            os.waitpid(each, 0)


def _processes() -> Iterable[tuple[int, _Relation]]:
    with suppress(OSError):
        for place in Path("/proc").iterdir():
            if place.name.isdecimal():
                with suppress(OSError, ValueError, IndexError):
                    # pid (name) state parent group session ... began ...; a name may hold blanks and brackets
                    told = (place / "stat").read_bytes().rpartition(b")")[2].split()
                    if told[0] not in (b"Z", b"X"):
                        yield int(place.name), _Relation(*(int(told[field]) for field in (1, 3, 19)))
