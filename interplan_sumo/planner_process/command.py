"""Command: what starts the process of a planner: our host for one in Python, or a program of its own."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import sys
from typing import Final

from interplan_sumo.errors import PlannerLoadError
from interplan_sumo.planner import EXEC

_HOST: Final = (
    "import json, sys; about = json.loads(sys.argv[1]); sys.path[:] = about['path']; "
    "from interplan_sumo.planner_process.host import run; run(about)"
)


def command_of(spec: str) -> list[str]:
    """The words of a command: those of `exec:COMMAND`, split as a shell does, or the host with the planner's name.

    The host finds modules where this process does. PlannerLoadError if there is no such program.
    """
    if not spec.startswith(f"{EXEC}:"):
        about = {"planner": spec, "path": [each or os.getcwd() for each in sys.path]}
        return [sys.executable, "-c", _HOST, json.dumps(about)]
    try:
        command = shlex.split(spec.removeprefix(f"{EXEC}:"))
    except ValueError as error:
        raise PlannerLoadError(f"planner {spec!r} is no command: {error}") from None
    if not command or shutil.which(command[0]) is None:
        what = command[0] if command else ""
        raise PlannerLoadError(f"planner {spec!r}: there is no program {what!r}, or it may not be run")
    return command
