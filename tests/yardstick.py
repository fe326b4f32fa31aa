"""Time as a ratio to what a plain loop takes on the same machine at the same time: a slow machine fails no test."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from time import process_time


@contextmanager
def at_most(loops: float) -> Generator[None]:
    """What is done inside takes no more time of the processor than so many loops of a million steps."""
    began_s = process_time()
    yield
    ended_s = process_time()
    for _ in range(1_000_000):
        pass
    assert (ended_s - began_s) / (process_time() - ended_s) < loops
