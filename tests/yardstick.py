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
    took_s = process_time() - began_s
    assert took_s < loops * loop_s(), f"{took_s:.2f} s, a loop {loop_s():.3f} s"


def loop_s() -> float:
    """What a loop of a million steps takes."""
    began_s = process_time()
    for _ in range(1_000_000):
        pass
    return process_time() - began_s
