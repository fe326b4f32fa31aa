"""What holds for all tests."""

from __future__ import annotations

import gc
import signal
import sys
from collections.abc import Iterator

import pytest
from hypothesis import settings

# How long an example takes depends on the machine and on what else it does: no test may.
settings.register_profile("interplan", deadline=None)
settings.load_profile("interplan")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # Started in the background (`make test &`), Ctrl-C is ignored; tests send it to runs, which would inherit that.
    signal.signal(signal.SIGINT, signal.default_int_handler)


gc.set_threshold(20_000)
"""Tests leave little garbage and end soon; with the usual 700 looking for it takes one second in fifteen."""


def pytest_collection_finish() -> None:
    """What was collected stays to the end: no later collection of garbage walks it again."""
    gc.freeze()


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """More are slower for networks of this size, much so on a busy machine; where torch is imported at all."""
    torch = sys.modules.get("torch")
    if torch is None:
        yield
        return
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)
