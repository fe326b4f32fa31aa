"""The page in a browser: filters, sorting, the way from a cell to its drive, and how it fits the screen."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest

from interplan_sumo.report.page.document import page
from interplan_sumo.report.table import make_table
from tests.browser import open_page
from tests.report.rows import drive, stored

pytestmark = pytest.mark.slow  # a browser for each; CI runs them

FAMILIES = ("construction", "accident", "jaywalker", "nudge", "overtake", "lane_change_ltd", "lane_change_mtd",
            "lane_change_htd")  # fmt: skip
PLANNERS = ("foresight", "pdm_closed", "idm_mobil", "idm")


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """80 scenarios with 4 planners; every fourth drive ends in a collision."""
    rows = []
    for p, planner in enumerate(PLANNERS):
        for n in range(80):
            changes: dict[str, Any] = {}
            if (n + p) % 4 == 0:
                changes = {"no_collision": 0.0, "no_collision_because": f"drove into vehicle {n} at 3.0 s"}
            score = 0.0 if changes else 1.0
            rows.append(drive(f"{FAMILIES[n // 10]}/{n % 10}", score, planner=planner, **changes))
    run = stored(*rows)
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(page(make_table([run]), [run], path=path), encoding="utf-8")
    return path


SHOWN = "#all-drives tbody tr:not([hidden])"


def test_a_page_of_320_drives_is_there_within_two_seconds_and_asks_for_nothing(report: Path) -> None:
    with open_page(report) as opened:
        began = time.perf_counter()
        opened.page.reload()
        opened.page.locator("#filters").wait_for()
        assert time.perf_counter() - began < 2.0
        assert opened.page.locator(SHOWN).count() == 320
        assert set(opened.requests) == {report.resolve().as_uri()}
        assert opened.errors == []


def test_filters_narrow_the_drives_and_say_how_many_are_left(report: Path) -> None:
    with open_page(report) as opened:
        found = opened.page
        found.locator("[name=lost]").check()
        assert found.locator(SHOWN).count() == 80
        found.locator("[name=line]").select_option("foresight")
        assert found.locator(SHOWN).count() == 20
        found.locator("[name=family]").select_option("nudge")
        assert found.locator("#count").inner_text() == "2 of 320 drives"
        found.locator("[name=text]").fill("vehicle 36")
        assert found.locator(SHOWN).count() == 1
        found.get_by_role("button", name="Clear").click()
        found.wait_for_function("document.getElementById('count').textContent === '320 drives'")


def test_headers_sort_by_keyboard_and_say_which_way(report: Path) -> None:
    with open_page(report) as opened:
        found = opened.page
        button = found.get_by_role("button", name="score", exact=True)
        header = found.locator("#all-drives thead th.score")
        assert header.get_attribute("aria-sort") == "none"
        first = found.locator("#all-drives tbody tr").first
        for direction, score in (("ascending", "0.0"), ("descending", "100.0")):
            button.press("Enter")
            assert header.get_attribute("aria-sort") == direction
            assert first.locator("td.score").inner_text() == score
        button.press("Enter")
        assert first.get_attribute("id") == "drive-0"


def test_scenarios_sort_by_their_number_not_by_their_letters(report: Path) -> None:
    with open_page(report) as opened:
        opened.page.get_by_role("button", name="scenario", exact=True).click()
        ids = opened.page.locator("#all-drives tbody th").all_inner_texts()
        assert ids[:5] == ["accident/0"] * 4 + ["accident/1"]


def test_a_cell_leads_to_its_drive_even_where_a_filter_hides_it(report: Path) -> None:
    with open_page(report) as opened:
        found = opened.page
        found.locator("[name=family]").select_option("overtake")
        found.locator(".heat a").first.click()
        row = found.locator("#drive-0")
        assert row.is_visible()
        assert found.evaluate("document.querySelector(':target').id") == "drive-0"


@pytest.mark.parametrize("width", [1440, 390])
@pytest.mark.parametrize("dark", [False, True])
def test_the_page_is_never_wider_than_the_screen(report: Path, width: int, dark: bool) -> None:
    with open_page(report, width=width, dark=dark) as opened:
        assert opened.page.evaluate("document.documentElement.scrollWidth") <= width


def test_without_a_script_every_drive_is_shown_and_no_dead_control(report: Path) -> None:
    with open_page(report) as opened:
        browser = opened.page.context.browser
        assert browser is not None
        plain = browser.new_page(java_script_enabled=False)
        plain.goto(report.resolve().as_uri())
        assert plain.locator("#all-drives tbody tr").count() == 320
        assert plain.locator("#filters").is_hidden()
        assert plain.locator("thead button").count() == 0
