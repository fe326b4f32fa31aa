"""What holds for all tests."""

from __future__ import annotations

import gc
import os
import shutil
import signal
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from playwright.sync_api import Browser

# How long an example takes depends on the machine and on what else it does: no test may.
# `--hypothesis-profile=thorough` looks at twenty times as many.
settings.register_profile("interplan", deadline=None, max_examples=50)
settings.register_profile("thorough", deadline=None, max_examples=1000)
settings.load_profile("interplan")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # Started in the background (`make test &`), Ctrl-C is ignored; tests send it to runs, which would inherit that.
    signal.signal(signal.SIGINT, signal.default_int_handler)

CHROMIUMS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
QUIET = (
    "--disable-background-networking", "--disable-component-update", "--disable-default-apps",
    "--disable-domain-reliability", "--disable-sync", "--metrics-recording-only", "--no-default-browser-check",
    "--no-first-run", "--no-pings",
)  # fmt: skip
"""What keeps a browser from calling home."""

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


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """One installed Chromium for all tests here; skips them where playwright or a browser is missing."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    program = next(filter(None, map(shutil.which, CHROMIUMS)), None)
    if program is None:
        pytest.skip(f"no browser on the PATH, looked for {', '.join(CHROMIUMS)}")
    as_root = hasattr(os, "geteuid") and os.geteuid() == 0
    flags = [*QUIET, *(["--no-sandbox"] if as_root else [])]  # Chromium refuses to sandbox what root runs
    with sync_api.sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=program, args=flags)
        yield running
        running.close()
