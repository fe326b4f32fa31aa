"""The report and the replay in a browser: they ask for nothing, obey mouse and keys, and fit the screen."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from msgspec import structs

from interplan_sumo.report.page.document import page as report_page
from interplan_sumo.report.replay.page import write_replay
from interplan_sumo.report.table import make_table
from interplan_sumo.world.trace import SEEN_BEFORE, ActorTable
from tests.report.rows import drive, stored
from tests.report.tiny_drives import CRUISE_MPS, tiny_drive
from tests.worlds import cars, pedestrians, together

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, ViewportSize

pytestmark = pytest.mark.slow  # CI runs them

NASTY = """<script>alert("1")</script> & 'co'"""
USUAL, NARROW = (1440, 900), (390, 844)
"""Pixels of a screen."""


@dataclass
class OpenPage:
    """A page in the browser, and what it has asked for and complained about so far."""

    page: Page
    requests: list[str] = field(default_factory=list[str])
    errors: list[str] = field(default_factory=list[str])
    """Errors and warnings of the console, what was refused by policy among them, and exceptions that nobody caught."""


def sized(pixels: tuple[int, int]) -> ViewportSize:
    return {"width": pixels[0], "height": pixels[1]}


@contextmanager
def opened(browser: Browser, path: Path, *, dark: bool = False, script: bool = True) -> Generator[OpenPage]:
    page = browser.new_page(
        viewport=sized(USUAL), color_scheme="dark" if dark else "light", java_script_enabled=script
    )  # fmt: skip
    found = OpenPage(page)
    page.on("request", lambda request: found.requests.append(request.url))
    page.on("pageerror", lambda error: found.errors.append(str(error)))
    page.on("console", lambda said: found.errors.append(said.text) if said.type in ("error", "warning") else None)
    page.goto(path.resolve().as_uri())
    yield found
    page.close()


@contextmanager
def reopened(found: OpenPage, ready: str) -> Generator[Page]:
    """The page as if it had just been opened; it asks for nothing, and nothing makes the browser complain."""
    page = found.page
    page.set_viewport_size(sized(USUAL))
    page.goto(page.url.partition("#")[0])
    page.reload()
    page.wait_for_selector(ready)
    yield page
    assert {url.partition("#")[0] for url in found.requests} == {page.url.partition("#")[0]}
    assert found.errors == []


# --- the report ----------------------------------------------------------------------------------

FAMILIES = "construction accident jaywalker nudge overtake lane_change_ltd lane_change_mtd lane_change_htd".split()
PLANNERS = ("foresight", "pdm_closed", "idm_mobil", "idm")
SHOWN = "#all-drives .drives tbody tr:not([hidden])"


@pytest.fixture(scope="module")
def report_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """80 scenarios with 4 planners; every fourth drive ends in a collision."""
    rows = []
    for p, planner in enumerate(PLANNERS):
        for n in range(80):
            hit = (n + p) % 4 == 0
            lost: dict[str, Any] = (
                {"no_collision": 0.0, "no_collision_because": f"drove into vehicle {n} at 3.0 s"} if hit else {}
            )
            rows.append(drive(f"{FAMILIES[n // 10]}/{n % 10}", 0.0 if hit else 1.0, planner=planner, **lost))
    run = stored(*rows)
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(report_page(make_table([run]), [run], path=path), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def report_opened(browser: Browser, report_file: Path) -> Iterator[OpenPage]:
    with opened(browser, report_file) as found:
        yield found


@pytest.fixture
def report(report_opened: OpenPage) -> Iterator[Page]:
    with reopened(report_opened, "#filters") as page:
        yield page


def test_filters_narrow_the_drives_and_say_how_many_are_left(report: Page) -> None:
    assert report.locator(SHOWN).count() == 320
    report.locator("[name=lost]").check()
    assert report.locator(SHOWN).count() == 80
    report.locator("[name=line]").select_option("foresight")
    assert report.locator(SHOWN).count() == 20
    report.locator("[name=family]").select_option("nudge")
    assert report.locator("#count").inner_text() == "2 of 320 drives"
    report.locator("[name=text]").fill("vehicle 36")
    assert report.locator(SHOWN).count() == 1
    report.locator("[name=text]").fill("interplan-sumo replay")  # stands in every row, and is not what anybody searches
    assert report.inner_text("#count") == "0 of 320 drives"
    report.get_by_role("button", name="Clear").click()
    wait_until(report, lambda: report.inner_text("#count") == "320 drives")


def test_headers_sort_a_family_by_keyboard_say_which_way_and_know_numbers(report: Page) -> None:
    family = report.locator(".family").first
    family.locator("summary").first.click()
    family.locator(".every > summary").click()
    button = family.get_by_role("button", name="score", exact=True)
    header, first = family.locator("thead th.score"), family.locator(".drives tbody tr").first
    assert header.get_attribute("aria-sort") == "none"
    for direction, score in (("ascending", "0"), ("descending", "100")):
        button.press("Enter")
        assert header.get_attribute("aria-sort") == direction
        assert first.locator("td.score").inner_text() == score
    button.press("Enter")
    assert first.get_attribute("id") == "drive-0"
    cells = family.locator(".drives tbody tr td.score")
    for number, score in enumerate(("79.6", "79.55", "9.8", "79.1234")):
        cells.nth(number).evaluate("(cell, score) => { cell.dataset.value = score; }", score)
    button.press("Enter")
    values = [float(each) for each in cells.evaluate_all("cells => cells.map((cell) => cell.dataset.value)")]
    assert values == sorted(values)
    assert 79.55 in values
    family.get_by_role("button", name="planner", exact=True).click()
    assert family.locator(".drives tbody td:nth-child(2)").all_inner_texts()[:5] == ["foresight"] * 5


def test_a_cell_leads_to_its_drive_though_it_is_folded_and_a_search_opens_what_it_finds(report: Page) -> None:
    report.locator("[name=family]").select_option("overtake")
    assert report.locator(".family:not([hidden])").count() == 1
    assert report.locator(SHOWN).first.is_visible()
    report.get_by_role("button", name="Clear").click()
    wait_until(report, lambda: report.locator(".family:not([hidden])").count() == 8)
    report.locator(".family summary").first.click()
    report.locator(".heat a").first.click()
    wait_until(report, lambda: report.locator("#drive-0").is_visible())
    assert report.evaluate("document.querySelector(':target').id") == "drive-0"


def test_the_report_fits_every_screen_and_is_short_while_it_is_folded(report: Page) -> None:
    cut = "[...document.querySelectorAll('.scroll, table')].filter((each) => each.scrollWidth > each.clientWidth + 1)"
    for size in (USUAL, NARROW, (768, 1024), (2560, 1440)):
        report.set_viewport_size(sized(size))
        assert report.evaluate("document.documentElement.scrollHeight") < 4 * size[1]
        narrow = size[0] < 900  # the line of titles, which has the colours, is gone there
        assert report.locator(".spread td .swatch").first.is_visible() == narrow
        report.evaluate("document.querySelectorAll('details').forEach((box) => { box.open = true; })")
        assert report.evaluate("document.documentElement.scrollWidth") <= size[0]
        assert report.evaluate(f"{cut}.length") == 0
        report.evaluate("document.querySelectorAll('details').forEach((box) => { box.open = false; })")


@pytest.mark.parametrize(("size", "unfolded"), [(USUAL, 1), (NARROW, 0)])
def test_where_the_points_went_is_folded_on_a_phone_only(size: tuple[int, int], unfolded: int, report: Page) -> None:
    report.set_viewport_size(sized(size))
    report.reload()
    assert report.locator(".unfolded[open]").count() == unfolded


def test_without_a_script_every_drive_is_shown_and_no_dead_control(browser: Browser, report_file: Path) -> None:
    assert report_file.stat().st_size < 400_000
    with opened(browser, report_file, script=False) as plain:
        assert plain.page.locator(".drives tbody tr").count() == 320
        assert plain.page.locator("#filters").is_hidden()
        assert plain.page.locator("thead button").count() == 0


# --- the replay ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def replay_opened(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[OpenPage]:
    """Two drives of 8 s, the first of which hits a car at 3.6 s, of a scenario with a name that looks like a script."""
    path = tmp_path_factory.mktemp("replay") / "drive.html"
    around = together(cars((50.0, 0.0)), pedestrians((40.0, 4.0)))
    first = tiny_drive([CRUISE_MPS] * 80, actors=around, scenario_id=NASTY)
    second = tiny_drive([CRUISE_MPS] * 20 + [0.0] * 40, actors=around, name="pdm_closed", scenario_id=NASTY,
                        fault=("planner", "ValueError: <b>no way</b>"))  # fmt: skip
    write_replay([first, second], path)
    with opened(browser, path) as found:
        yield found


@pytest.fixture
def replay(replay_opened: OpenPage) -> Iterator[Page]:
    with reopened(replay_opened, "html[data-ready]") as page:
        yield page


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


def playing(page: Page) -> bool:
    return page.get_attribute("#play", "aria-label") == "Pause"


def test_it_plays_and_stops_at_the_end(replay: Page) -> None:
    replay.select_option("#rate", "4")
    replay.keyboard.press("Escape")
    replay.click("#play")
    assert playing(replay)
    wait_until(replay, lambda: not playing(replay))
    assert now_s(replay) == 7.9


def test_keys_alone_step_and_jump(replay: Page) -> None:
    for keys, wanted_s in (
        ("ArrowRight ArrowRight", 0.2), ("Shift+ArrowRight", 1.2), ("ArrowLeft", 1.1), ("End", 7.9), ("Home", 0.0),
        ("Shift+ArrowLeft", 0.0), ("n", 3.6), ("n", 3.6), ("End p", 3.6),
    ):  # fmt: skip
        assert pressed(replay, *keys.split()) == wanted_s, keys


def test_space_plays_and_pauses_and_presses_what_tab_has_reached(replay: Page) -> None:
    replay.click("#forward")
    replay.keyboard.press(" ")
    wait_until(replay, lambda: now_s(replay) > 0.2)
    replay.keyboard.press(" ")
    stopped = now_s(replay)
    replay.wait_for_timeout(150)
    assert (playing(replay), now_s(replay)) == (False, stopped)
    pressed(replay, "Home")
    replay.focus("#forward")
    assert pressed(replay, " ") == 0.1
    assert not playing(replay)


def test_it_says_how_to_drive_on_from_a_moment(replay: Page) -> None:
    pressed(replay, "Home", "Shift+ArrowRight", "2")
    replay.click("#take-over")
    said = replay.inner_text("#take-over-command")
    assert said.startswith("interplan-sumo drive '<script>")
    assert said.endswith("--from RUN --planner pdm_closed --at 1.0")
    replay.get_by_role("button", name="Close").click()


def test_a_drive_with_another_seed_is_not_said_to_be_driven_on(browser: Browser, tmp_path: Path) -> None:
    held = tiny_drive([CRUISE_MPS] * 20)
    write_replay([replace(held, row=structs.replace(held.row, seed=1))], tmp_path / "drive.html")
    with opened(browser, tmp_path / "drive.html") as found, reopened(found, "html[data-ready]") as page:
        page.click("#take-over")
        said = page.inner_text("#take-over-box")
        assert "Only drives with seed 0 can be driven on; this one has seed 1." in said
        assert "interplan-sumo drive" not in said


def test_an_address_opens_it_three_seconds_before_what_decided(replay: Page) -> None:
    replay.goto(f"{replay.url.partition('#')[0]}#decides")
    replay.reload()
    replay.wait_for_selector("html[data-ready]")
    assert now_s(replay) == 0.6


def test_it_jumps_to_what_decided_each_drive_and_says_so(replay: Page) -> None:
    assert pressed(replay, "d") == 3.6
    assert "drove into standing vehicle car00" in replay.inner_text("#said")
    assert pressed(replay, "2", "d") == 5.9
    assert "no way" in replay.inner_text("#said")
    pressed(replay, "Home")
    replay.locator(".sheet").first.get_by_role("button", name="drove into").first.click()
    assert now_s(replay) == 3.6
    assert replay.evaluate("document.getElementById('stage').getBoundingClientRect().bottom") > 0  # and one sees it


def test_both_drives_show_the_same_time_and_the_shorter_one_waits_at_its_end(replay: Page) -> None:
    pressed(replay, "End")
    assert replay.locator(".badge").all_inner_texts() == ["time over at 7.9 s", "planner fault at 5.9 s"]
    pressed(replay, "Home")
    assert replay.locator(".badge:visible").count() == 0
    assert replay.locator(".hud b").all_inner_texts() == ["10.0 m/s", "10.0 m/s"]


def test_names_and_messages_are_shown_as_text(replay: Page) -> None:
    assert replay.inner_text("h1") == NASTY
    assert "ValueError: <b>no way</b>" in replay.locator(".verdict").nth(1).inner_text()
    assert replay.locator("main script, main b:text('no way')").count() == 0


def test_a_key_says_who_is_near(replay: Page) -> None:
    who = replay.locator(".who").first
    for said in ("pedestrian ped00", "car car00"):
        pressed(replay, "a")
        assert who.inner_text().startswith(said)
    assert "4.8 x 2.0 m" in who.inner_text()
    pressed(replay, "Escape")
    assert not who.is_visible()


def test_the_bar_a_chart_and_the_address_lead_to_a_time(replay: Page) -> None:
    replay.locator("#time").fill("42")
    assert now_s(replay) == 4.2
    chart = replay.locator(".chart canvas").first
    box = chart.bounding_box()
    assert box is not None
    chart.click(position={"x": box["width"] - 8, "y": 30})
    assert now_s(replay) == 7.9
    pressed(replay, "Home", "Shift+ArrowRight")
    assert replay.get_attribute("#time", "aria-valuetext") == "1.0 seconds"
    assert replay.inner_text("#said") == "1.0 s"
    replay.goto(replay.url + "#t=2.5")
    replay.reload()
    replay.wait_for_selector("html[data-ready]")
    assert now_s(replay) == 2.5


def test_every_control_is_reached_by_tab_and_has_a_name(replay: Page) -> None:
    names: list[str] = []
    for _ in range(60):
        replay.keyboard.press("Tab")
        names.append(replay.evaluate("() => document.activeElement.id || document.activeElement.tagName"))
    wanted = "help-open time to-start back play forward to-end rate decide zoom-out zoom-in fit follow".split()
    assert [name for name in names if name in wanted][: len(wanted)] == wanted
    assert names.count("CANVAS") >= 2
    for control in replay.locator("button:not(.mark), select, input").all():
        assert control.evaluate(
            "(e) => e.getAttribute('aria-label') || e.textContent.trim() || e.labels?.[0]?.textContent"
        )


def test_the_keys_are_told_in_a_dialog_that_escape_closes(replay: Page) -> None:
    replay.keyboard.press("?")
    assert replay.get_by_role("dialog").is_visible()
    replay.keyboard.press("Escape")
    assert not replay.get_by_role("dialog").is_visible()


def test_a_narrow_screen_has_the_drives_one_below_the_other(replay: Page) -> None:
    replay.set_viewport_size(sized(NARROW))
    now_s(replay)
    assert replay.evaluate("document.documentElement.scrollWidth") <= NARROW[0]
    tops = [box["y"] for pane in replay.locator(".pane").all() if (box := pane.bounding_box())]
    assert tops[1] > tops[0]


def test_a_drag_looks_elsewhere_and_f_follows_again(replay: Page) -> None:
    box = replay.locator(".pane canvas").first.bounding_box()
    assert box is not None
    replay.mouse.move(box["x"] + 200, box["y"] + 200)
    replay.mouse.down()
    replay.mouse.move(box["x"] + 100, box["y"] + 180, steps=3)
    replay.mouse.up()
    now_s(replay)
    assert replay.get_attribute("#follow", "aria-pressed") == "false"
    pressed(replay, "f")
    assert replay.get_attribute("#follow", "aria-pressed") == "true"


def test_a_drive_alone_fills_the_page(browser: Browser, tmp_path: Path) -> None:
    write_replay([tiny_drive([CRUISE_MPS] * 20)], tmp_path / "one.html")
    with opened(browser, tmp_path / "one.html", dark=True) as found:
        found.page.wait_for_selector("html[data-ready]")
        assert found.page.locator(".pane").count() == 1
        assert found.page.get_by_label("Other planner").count() == 0
        assert found.page.get_by_label("What the planner saw").count() == 0
        assert found.errors == []


def test_a_switch_shows_what_the_planner_saw(browser: Browser, tmp_path: Path) -> None:
    trace = tiny_drive([CRUISE_MPS] * 20, actors=cars((30.0, 0.0))).trace
    ghosts = ActorTable.of([cars((28.0, 3.0))] * (SEEN_BEFORE + len(trace)))
    seen = tiny_drive([CRUISE_MPS] * 20, trace=replace(trace, seen=ghosts))
    write_replay([seen], tmp_path / "one.html")
    with opened(browser, tmp_path / "one.html") as found:
        found.page.wait_for_selector("html[data-ready]")
        shown = found.page.locator("canvas").first.screenshot()
        found.page.get_by_label("What the planner saw").uncheck()
        found.page.wait_for_timeout(200)
        assert found.page.locator("canvas").first.screenshot() != shown
        assert found.errors == []
