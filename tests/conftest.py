"""What holds for all tests."""

from __future__ import annotations

import gc
import signal

from hypothesis import settings

# How long an example takes depends on the machine and on what else it does: no test may.
settings.register_profile("interplan", deadline=None)
settings.load_profile("interplan")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # Started in the background (`make test &`), Ctrl-C is ignored; tests send it to runs, which would inherit that.
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_finish() -> None:
    """What was collected stays to the end: no later collection of garbage walks it again."""
    gc.freeze()
