"""Awake: a clock for limits that counts only while this process runs, so that a paused machine is nobody's fault."""

from __future__ import annotations

import time
from collections.abc import Callable

LONGEST_STEP_S = 1.0
"""Who waits looks at the clock far more often: what lies beyond this between two looks is a pause."""


class AwakeClock:
    """Seconds since it was made, of which at most LONGEST_STEP_S count from one look at it to the next."""

    def __init__(self, monotonic: Callable[[], float] = time.monotonic) -> None:
        self._monotonic = monotonic
        self._before_s = monotonic()
        self._counted_s = 0.0

    def now_s(self) -> float:
        at_s = self._monotonic()
        self._counted_s += min(at_s - self._before_s, LONGEST_STEP_S)
        self._before_s = at_s
        return self._counted_s
