"""Deaths: how a process ended, in words, and whether that was its own doing."""

from __future__ import annotations

import signal

from interplan_sumo.errors import PlannerLoadError


class KilledWhileBuiltError(PlannerLoadError):
    """Somebody else ended a planner before it could drive; it may be built again."""


def death(exit_code: int | None) -> str:
    """How a process ended, in words."""
    if exit_code is None:
        return "closed its connection"
    if exit_code >= 0:
        return f"exited with code {exit_code}"
    try:
        return f"was killed by {signal.Signals(-exit_code).name}"
    except ValueError:
        return f"was killed by signal {-exit_code}"


def killed_from_outside(exit_code: int | None) -> bool:
    """Whether the end looks like somebody else's doing (an operator, the out-of-memory killer) and not a crash."""
    outside = {getattr(signal, name, None) for name in ("SIGKILL", "SIGTERM", "SIGINT", "SIGHUP")}
    return exit_code is not None and exit_code < 0 and -exit_code in {int(s) for s in outside if s is not None}
