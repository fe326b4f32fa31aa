"""A call with an end: whatever a server or a name lookup does, the caller goes on in time."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


def within(seconds: float, work: Callable[[], T]) -> T:
    """What `work` returns or raises, or TimeoutError after `seconds`.

    Time limits of sockets hold for one read each and for no name lookup, so
    the work is done in a thread of its own. Late work is left behind in it: a
    daemon thread, which does not keep the process alive.
    """
    done: list[T] = []
    failed: list[BaseException] = []

    def run() -> None:
        try:
            done.append(work())
        except BaseException as error:
            failed.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(max(0.0, seconds))
    if done:
        return done[0]
    if failed:
        raise failed[0]
    raise TimeoutError
