"""The page: one file that asks nobody for anything and shows text as text."""

from __future__ import annotations

import re
from html.parser import HTMLParser

from interplan_sumo.report.page import page
from interplan_sumo.report.table import make_table
from tests.report.rows import drive, stored

NASTY = "<script>alert('x')</script>&\"'"


class Tags(HTMLParser):
    """Collects what a browser would see as tags, and what it would load."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.loads: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.loads += [str(value) for name, value in attrs if name in ("src", "href", "srcset", "data", "action")]

    def handle_data(self, data: str) -> None:
        self.text += data


def read(html: str) -> Tags:
    tags = Tags()
    tags.feed(html)
    return tags


def test_the_page_loads_nothing_and_runs_nothing() -> None:
    html = page(make_table([stored(drive("nudge/0", 1.0))]), paper=True)
    seen = read(html)
    assert seen.loads == []
    assert not seen.tags & {"script", "link", "img", "iframe", "object"}
    assert not re.search(r"url\(|@import|https?://", html)


def test_whatever_is_shown_is_text() -> None:
    rows = (
        drive(f"nudge/{NASTY}", 0.0, fault=("planner", NASTY)),
        drive("nudge/1", 0.0, no_collision=0.0, no_collision_because=NASTY),
        drive("nudge/2", 1.0, planner=NASTY),
    )
    html = page(make_table([stored(*rows, suite=NASTY)]), title=NASTY)
    seen = read(html)
    assert "script" not in seen.tags
    assert seen.text.count(NASTY) >= 6


def test_every_drive_is_there_with_what_cost_points() -> None:
    rows = (
        drive("nudge/0", 1.0),
        drive("nudge/1", 0.0, no_collision=0.0, no_collision_because="drove into vehicle 7 at 3.0 s"),
        drive("nudge/2", 0.0, fault=("planner", "plan() raised ValueError")),
    )
    text = read(page(make_table([stored(*rows)]))).text
    assert "at-fault collision: drove into vehicle 7 at 3.0 s" in text
    assert "planner fault: plan() raised ValueError" in text
    assert all(f"nudge/{n}" in text for n in range(3))


def test_an_incomplete_run_says_so_at_the_top() -> None:
    text = read(page(make_table([stored(drive("nudge/0", 1.0), missing=("nudge/1",))]))).text
    assert "This run is incomplete. No score for: nudge/1 (idm, seed 0)." in text


def test_a_complete_run_does_not() -> None:
    assert 'role="alert"' not in page(make_table([stored(drive("nudge/0", 1.0))]))


def test_ordinary_driving_stands_first() -> None:
    common = stored(drive("changing_lane/0", 0.87), path="runs/o", suite="common==1", suite_hash="2")
    text = read(page(make_table([stored(drive("nudge/0", 0.4)), common]), paper=True)).text
    assert "plannerOrdinaryinterPlan" in text
    assert "idm8740" in text
    assert "HybridLLM GPT-3.5 (paper)-40" in text
    assert "Ordinary" not in read(page(make_table([stored(drive("nudge/0", 0.4))]))).text
