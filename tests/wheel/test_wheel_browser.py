"""The wheel in a browser: a person presses keys, sees the ego obey, and is scored."""

from __future__ import annotations

import json
import queue
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.run_folder import read_run
from interplan_sumo.scenario.files import write_scenarios
from interplan_sumo.wheel.server import WheelServer
from interplan_sumo.wheel.session import Seating, Session
from tests.scenes import scene

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = pytest.mark.slow

PAD = "{connected: true, axes: [0.3], buttons: [0, 0, 0, 0, 0, 0, {value: 0.8}, {value: 0}]}"
"""A gamepad whose left trigger is pulled: it brakes."""


@pytest.fixture
def served(tmp_path: Path) -> Iterator[WheelServer]:
    """A scene of 4 s in real time, in a thread."""
    write_scenarios([replace(scene("nudge/0"), duration_s=4.0)], tmp_path / "mine.yaml")
    seating = Seating.of(RunOptions(scenarios=(str(tmp_path / "mine.yaml"),)), tmp_path / "run")
    opened: queue.Queue[WheelServer] = queue.Queue()
    thread = threading.Thread(target=Session(seating).drive, args=(opened.put,), daemon=True)
    thread.start()
    yield opened.get(timeout=30.0)
    thread.join(30.0)
    assert not thread.is_alive()


def wait_for(page: Page, state: str) -> None:
    """Asks from here: the page's policy forbids the browser to evaluate texts, playwright's own too."""
    for _ in range(1200):
        if page.get_attribute("html", "data-state") == state:
            return
        page.wait_for_timeout(25)
    pytest.fail(f"waited 30 s for {state}, it is {page.get_attribute('html', 'data-state')}")


def test_keys_and_a_gamepad_drive_and_the_score_is_shown(browser: Browser, served: WheelServer, tmp_path: Path) -> None:
    page = browser.new_page(viewport={"width": 390, "height": 844})
    troubles: list[str] = []
    asked: list[str] = []
    page.on("console", lambda said: troubles.append(said.text) if said.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: troubles.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    page.goto(served.address)
    wait_for(page, "ready")
    before = page.locator("#map").screenshot()
    page.keyboard.press("Enter")
    wait_for(page, "driving")
    page.keyboard.down("ArrowUp")
    page.keyboard.down("ArrowLeft")
    page.wait_for_timeout(700)
    page.keyboard.up("ArrowLeft")
    page.keyboard.press("p")
    wait_for(page, "paused")
    shown = page.inner_text("#time")
    page.wait_for_timeout(300)
    assert page.inner_text("#time") == shown
    assert page.locator("#map").screenshot() != before
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    about, menu = page.locator("#about").bounding_box(), page.locator("#menu").bounding_box()
    assert about
    assert menu
    assert about["x"] + about["width"] <= menu["x"]
    page.keyboard.up("ArrowUp")
    page.keyboard.press("p")
    wait_for(page, "driving")
    before_kmh = int(page.inner_text("#speed"))
    page.evaluate(f"navigator.getGamepads = () => [{PAD}]")
    wait_for(page, "end")
    assert int(page.inner_text("#speed")) < before_kmh - 5
    assert page.inner_text("#score").endswith("of 100")
    assert json.loads(page.get_attribute("#pace", "data-delays") or "[]")
    page.click("#next")
    wait_for(page, "over")
    (row,) = read_run(tmp_path / "run").rows.values()
    assert row.planner == "human"
    assert row.fault is None
    assert page.inner_text("#score") == f"{round(100.0 * (row.score or 0.0), 1):g} of 100"
    assert troubles == []
    assert all(url.startswith(served.address) for url in asked)
    page.close()
