"""The replay in a browser: it plays, obeys keys, says what happens, fits narrow screens and asks for nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from interplan_sumo.report.replay.page import write_replay
from tests.browser import OpenPage, open_page
from tests.report.tiny_drives import CRUISE_MPS, tiny_drive
from tests.worlds import cars, pedestrians, together

pytestmark = pytest.mark.slow  # a browser for each; CI runs them

if TYPE_CHECKING:
    from playwright.sync_api import Page

NASTY = """<script>alert("1")</script> & 'co'"""
NARROW = {"width": 390, "height": 844}
USUAL = {"width": 1440, "height": 900}


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[OpenPage]:
    """Two drives of 8 s, the first of which hits a car at 3.6 s, of a scenario with a name that looks like a script."""
    path = tmp_path_factory.mktemp("replay") / "drive.html"
    around = together(cars((50.0, 0.0)), pedestrians((40.0, 4.0)))
    first = tiny_drive([CRUISE_MPS] * 80, actors=around, scenario_id=NASTY)
    second = tiny_drive([CRUISE_MPS] * 20 + [0.0] * 40, actors=around, name="pdm_closed", scenario_id=NASTY,
                        fault=("planner", "ValueError: <b>no way</b>"))  # fmt: skip
    write_replay([first, second], path)
    with open_page(path) as opened:
        yield opened


@pytest.fixture
def page(shown: OpenPage) -> Iterator[Page]:
    """The page as if it had just been opened; what a test does must not make the browser complain."""
    shown.page.set_viewport_size({"width": USUAL["width"], "height": USUAL["height"]})
    shown.page.reload()
    shown.page.wait_for_selector("html[data-ready]")
    yield shown.page
    assert shown.errors == []


def now_s(page: Page) -> float:
    """The time on the clock, once what was asked for is drawn."""
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return float(page.inner_text("#now"))


def pressed(page: Page, *keys: str) -> float:
    for key in keys:
        page.keyboard.press(key)
    return now_s(page)


def wait_until(page: Page, came: Callable[[], bool]) -> None:
    """Asks from here: the page's policy forbids the browser to evaluate texts, playwright's own too."""
    for _ in range(400):
        if came():
            return
        page.wait_for_timeout(25)
    pytest.fail("waited 10 s in vain")


def test_it_asks_for_nothing_but_the_file_itself(shown: OpenPage, page: Page) -> None:
    page.click("#play")
    wait_until(page, lambda: now_s(page) > 0.3)
    assert set(shown.requests) == {page.url}
    assert page.url.startswith("file://")


def test_it_plays_and_stops_at_the_end(page: Page) -> None:
    page.select_option("#rate", "4")
    page.keyboard.press("Escape")
    page.click("#play")
    assert page.get_attribute("#play", "aria-label") == "Pause"
    wait_until(page, lambda: page.get_attribute("#play", "aria-label") == "Play")
    assert now_s(page) == 7.9


def test_keys_alone_step_and_jump(page: Page) -> None:
    assert pressed(page, "ArrowRight", "ArrowRight") == 0.2
    assert pressed(page, "Shift+ArrowRight") == 1.2
    assert pressed(page, "ArrowLeft") == 1.1
    assert pressed(page, "End") == 7.9
    assert pressed(page, "Home") == 0.0
    assert pressed(page, "Shift+ArrowLeft") == 0.0


def test_space_plays_and_pauses(page: Page) -> None:
    page.keyboard.press(" ")
    wait_until(page, lambda: now_s(page) > 0.2)
    page.keyboard.press(" ")
    assert page.get_attribute("#play", "aria-label") == "Play"
    stopped = now_s(page)
    page.wait_for_timeout(150)
    assert now_s(page) == stopped


def test_space_plays_after_a_click_and_presses_what_tab_has_reached(page: Page) -> None:
    page.click("#forward")
    page.keyboard.press(" ")
    assert page.get_attribute("#play", "aria-label") == "Pause"
    page.keyboard.press(" ")
    pressed(page, "Home")
    page.focus("#forward")
    assert pressed(page, " ") == 0.1
    assert page.get_attribute("#play", "aria-label") == "Play"


def test_it_jumps_to_what_decided_each_drive_and_says_so(page: Page) -> None:
    assert pressed(page, "d") == 3.6
    assert "drove into standing vehicle car00" in page.inner_text("#said")
    assert pressed(page, "2", "d") == 5.9
    assert "no way" in page.inner_text("#said")


def test_the_next_and_the_previous_event_are_one_key_away(page: Page) -> None:
    assert pressed(page, "n") == 3.6
    assert pressed(page, "n") == 3.6  # there is no other
    assert pressed(page, "End", "p") == 3.6


def test_both_drives_show_the_same_time_and_the_shorter_one_waits_at_its_end(page: Page) -> None:
    page.keyboard.press("End")
    now_s(page)
    assert page.locator(".badge").all_inner_texts() == ["time over at 7.9 s", "planner fault at 5.9 s"]
    page.keyboard.press("Home")
    now_s(page)
    assert page.locator(".badge:visible").count() == 0
    assert page.locator(".hud b").all_inner_texts() == ["10.0 m/s", "10.0 m/s"]


def test_names_and_messages_are_shown_as_text(page: Page) -> None:
    assert page.inner_text("h1") == NASTY
    assert "ValueError: <b>no way</b>" in page.locator(".verdict").nth(1).inner_text()
    assert page.locator("main script, main b:text('no way')").count() == 0


def test_a_click_on_a_road_user_says_who_it_is(page: Page) -> None:
    pressed(page, "a")
    who = page.locator(".who").first
    assert who.inner_text().startswith("pedestrian ped00")
    pressed(page, "a")
    assert "standing vehicle" not in who.inner_text()
    assert who.inner_text().startswith("car car00")
    assert "4.8 x 2.0 m" in who.inner_text()
    pressed(page, "Escape")
    assert not who.is_visible()


def test_a_metric_that_lost_points_leads_to_the_moment(page: Page) -> None:
    page.locator(".sheet").first.get_by_role("button", name="drove into").first.click()
    assert now_s(page) == 3.6
    assert page.evaluate("document.getElementById('stage').getBoundingClientRect().bottom") > 0  # and one sees it


def test_the_bar_and_a_chart_lead_to_a_time(page: Page) -> None:
    page.locator("#time").fill("42")
    assert now_s(page) == 4.2
    chart = page.locator(".chart canvas").first
    box = chart.bounding_box()
    assert box is not None
    chart.click(position={"x": box["width"] - 8, "y": 30})
    assert now_s(page) == 7.9


def test_every_control_is_reached_by_tab_and_has_a_name(page: Page) -> None:
    names: list[str] = []
    for _ in range(60):
        page.keyboard.press("Tab")
        names.append(page.evaluate("() => document.activeElement.id || document.activeElement.tagName"))
    wanted = "help-open time to-start back play forward to-end rate decide zoom-out zoom-in fit follow".split()
    assert [name for name in names if name in wanted][: len(wanted)] == wanted
    assert names.count("CANVAS") >= 2
    for control in page.locator("button:not(.mark), select, input").all():
        assert control.evaluate(
            "(e) => e.getAttribute('aria-label') || e.textContent.trim() || e.labels?.[0]?.textContent"
        )


def test_the_time_bar_says_its_value_in_seconds(page: Page) -> None:
    pressed(page, "Shift+ArrowRight")
    assert page.get_attribute("#time", "aria-valuetext") == "1.0 seconds"
    assert page.inner_text("#said") == "1.0 s"


def test_the_keys_are_told_in_a_dialog_that_escape_closes(page: Page) -> None:
    page.keyboard.press("?")
    assert page.get_by_role("dialog").is_visible()
    page.keyboard.press("Escape")
    assert not page.get_by_role("dialog").is_visible()


def test_a_narrow_screen_has_nothing_beside_it(page: Page) -> None:
    page.set_viewport_size({"width": NARROW["width"], "height": NARROW["height"]})
    now_s(page)
    assert page.evaluate("document.documentElement.scrollWidth") <= NARROW["width"]
    tops = [box["y"] for pane in page.locator(".pane").all() if (box := pane.bounding_box())]
    assert tops[1] > tops[0]


def test_a_drag_looks_elsewhere_and_f_follows_again(page: Page) -> None:
    canvas = page.locator(".pane canvas").first
    box = canvas.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 200, box["y"] + 200)
    page.mouse.down()
    page.mouse.move(box["x"] + 100, box["y"] + 180, steps=3)
    page.mouse.up()
    now_s(page)
    assert page.get_attribute("#follow", "aria-pressed") == "false"
    pressed(page, "f")
    assert page.get_attribute("#follow", "aria-pressed") == "true"


def test_the_address_may_name_a_time(page: Page) -> None:
    page.goto(page.url + "#t=2.5")
    page.reload()
    page.wait_for_selector("html[data-ready]")
    assert now_s(page) == 2.5
    page.goto(page.url.partition("#")[0])


def test_a_drive_alone_fills_the_page(tmp_path: Path) -> None:
    write_replay([tiny_drive([CRUISE_MPS] * 20)], tmp_path / "one.html")
    with open_page(tmp_path / "one.html", dark=True) as opened:
        opened.page.wait_for_selector("html[data-ready]")
        assert opened.page.locator(".pane").count() == 1
        assert opened.page.get_by_label("Other planner").count() == 0
        assert opened.errors == []
