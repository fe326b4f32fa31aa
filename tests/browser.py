"""A browser for the tests of pages: an installed Chromium, opened on a file, with its requests and errors on record."""

from __future__ import annotations

import os
import shutil
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

CHROMIUMS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
QUIET = (
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-default-apps",
    "--disable-domain-reliability",
    "--disable-sync",
    "--metrics-recording-only",
    "--no-default-browser-check",
    "--no-first-run",
    "--no-pings",
)
"""What keeps a browser from calling home."""


@dataclass
class OpenPage:
    """A page in a browser, and what it has asked for and complained about so far."""

    page: Page
    requests: list[str] = field(default_factory=list[str])
    """Addresses of everything that was asked for, the file itself first."""
    errors: list[str] = field(default_factory=list[str])
    """Errors and warnings of the console, what was refused by policy among them, and exceptions that nobody caught."""


@contextmanager
def open_page(
    path: Path, *, width: int = 1440, height: int = 900, dark: bool = False, touch: bool = False
) -> Generator[OpenPage]:
    """A file opened in Chromium; skips the test, with the reason, where playwright or a browser is missing."""
    with _chromium() as browser:
        page = browser.new_page(
            viewport={"width": width, "height": height}, color_scheme="dark" if dark else "light", has_touch=touch
        )
        opened = OpenPage(page)
        page.on("request", lambda request: opened.requests.append(request.url))
        page.on("pageerror", lambda error: opened.errors.append(str(error)))
        page.on("console", lambda said: _note(opened, said.type, said.text))
        page.goto(path.resolve().as_uri())
        try:
            yield opened
        finally:
            page.close()


_running: list[Browser] = []
"""The browser that is open: playwright allows one at a time."""


@contextmanager
def _chromium() -> Generator[Browser]:
    if _running:
        yield _running[0]
        return
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    program = next(filter(None, map(shutil.which, CHROMIUMS)), None)
    if program is None:
        pytest.skip(f"no browser on the PATH, looked for {', '.join(CHROMIUMS)}")
    as_root = hasattr(os, "geteuid") and os.geteuid() == 0
    flags = [*QUIET, *(["--no-sandbox"] if as_root else [])]  # Chromium refuses to sandbox what root runs
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=flags)
        _running.append(browser)
        try:
            yield browser
        finally:
            _running.clear()
            browser.close()


def _note(opened: OpenPage, kind: str, text: str) -> None:
    if kind in ("error", "warning"):
        opened.errors.append(f"{kind}: {text}")
