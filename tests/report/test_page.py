"""The page: one file that asks nobody for anything and shows text as text."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from interplan_sumo.report.page.document import page
from interplan_sumo.report.page.drives import shown_drives
from interplan_sumo.report.page.figures import band
from interplan_sumo.report.page.html import COLOURS, style_of
from interplan_sumo.report.table import make_table
from interplan_sumo.scenario.suite import find_scenario
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


def test_the_page_loads_nothing_and_runs_only_its_own_script() -> None:
    html = page(make_table([stored(drive("nudge/0", 1.0))]), paper=True)
    seen = read(html)
    assert all(link.startswith("#") for link in seen.loads)
    assert not seen.tags & {"link", "img", "iframe", "object"}
    assert not re.search(r"url\(|@import|https?://|<script ", html)
    assert html.count("<script>") == 1
    (policy,) = re.findall(r'http-equiv="Content-Security-Policy" content="([^"]*)"', html)
    assert policy.startswith("default-src 'none'")
    assert "unsafe" not in policy
    assert not re.search(r"<[^>]*\s(?:style|on\w+)=", html)


def test_whatever_is_shown_is_text() -> None:
    rows = (
        drive(f"nudge/{NASTY}", 0.0, fault=("planner", NASTY)),
        drive("nudge/1", 0.0, no_collision=0.0, no_collision_because=NASTY),
        drive("nudge/2", 1.0, planner=NASTY),
    )
    run = stored(*rows, suite=NASTY, versions={NASTY: NASTY}, command=[NASTY], overrides={"density": NASTY})
    html = page(make_table([run]), [run], title=NASTY)
    assert html.count("<script") == 1
    assert "<script>alert" not in html
    assert read(html).text.count(NASTY) >= 8


def test_a_drive_that_shows_as_100_lost_nothing() -> None:
    rows = [drive("nudge/0", 0.9995, progress=0.999), drive("nudge/1", 0.9994, progress=0.998)]
    whole, lost = shown_drives(make_table([stored(*rows)]))
    assert (whole.reasons, whole.lost) == ((), False)
    assert (lost.reasons, lost.lost) == (("little progress (0.1 points)",), True)


def test_an_incomplete_run_says_so_at_the_top() -> None:
    assert 'role="alert"' not in page(make_table([stored(drive("nudge/0", 1.0))]))
    text = read(page(make_table([stored(drive("nudge/0", 1.0), missing=("nudge/1",))]))).text
    assert "This run is incomplete. No score for: nudge/1 (idm, seed 0)." in text


def test_faults_are_listed_at_the_top_and_lead_to_their_rows_where_all_lost_points_are_told() -> None:
    hit = drive("nudge/2", 0.0, no_collision=0.0, no_collision_because="drove into vehicle 7 at 3.0 s")
    failed = drive("nudge/1", 0.0, fault=("planner", "no plan"))
    html = page(make_table([stored(drive("nudge/0", 1.0), failed, hit)]))
    top, _, rest = html.partition('id="scores"')
    assert '<a href="#drive-1">nudge/1, idm, seed 0</a>: planner fault: no plan' in top
    assert '<tr id="drive-1"' in rest
    assert "at-fault collision (100 points): drove into vehicle 7 at 3.0 s" in read(rest).text


def test_planners_of_a_scenario_stand_side_by_side() -> None:
    rows = [drive(f"nudge/{n}", 1.0, planner=name) for name in ("idm", "pdm_closed") for n in range(2)]
    seen = re.findall(
        r'<tr id="drive-\d+" data-line="(\d)".*?<th scope="row">(.*?)</th>', page(make_table([stored(*rows)]))
    )
    assert seen == [("0", "nudge/0"), ("1", "nudge/0"), ("0", "nudge/1"), ("1", "nudge/1")]


def test_a_cell_of_the_matrix_shows_the_mean_over_seeds_and_leads_to_the_worst_of_its_drives() -> None:
    rows = [drive("nudge/0", 1.0), drive("nudge/0", 0.5, seed=1), drive("nudge/0", 0.0, planner="pdm_closed")]
    html = page(make_table([stored(*rows)]))
    assert '<td class="b2"><a href="#drive-2" title="nudge/0, idm: 75">75</a></td>' in html
    assert '<td class="b0"><a href="#drive-1" title="nudge/0, pdm_closed: 0">0</a></td>' in html


@pytest.mark.parametrize(
    ("score", "expected"),
    [(None, "none"), (0.0, "b0"), (0.1, "b1"), (39.9, "b1"), (40.0, "b2"), (79.9, "b2"), (80.0, "b3"), (99.94, "b3"),
     (99.95, "b4"), (100.0, "b4"), (79.99999998, "b3"), (79.96, "b3"), (79.94, "b2")],
)  # fmt: skip
def test_a_score_has_the_colour_of_its_band_and_what_is_shown_alike_has_one(score: float | None, expected: str) -> None:
    assert band(score) == expected


def test_each_planner_of_a_dozen_has_its_own_colour_on_light_and_dark_pages() -> None:
    style = style_of("page.css")
    for scheme in style.split("@media (prefers-color-scheme: dark)"):
        hues = [re.findall(rf"--h{number}: (#[0-9a-f]{{6}});", scheme) for number in range(COLOURS)]
        assert all(len(found) == 1 for found in hues)
        assert len({found[0] for found in hues}) == COLOURS >= 12
    for number in range(COLOURS):
        assert f".h{number} {{ background: var(--h{number}); fill: var(--h{number}); }}" in style
        assert f".l{number} {{ stroke: var(--h{number}); }}" in style


def test_a_family_is_folded_under_the_mean_of_each_planner_and_says_what_it_asks() -> None:
    rows = [drive("nudge/0", 1.0), drive("nudge/1", 0.5), drive("nudge/0", 0.0, planner="idm_mobil")]
    html = page(make_table([stored(*rows)]))
    (summary,) = re.findall(r'<details class="family" data-family="nudge"><summary>(.*?)</summary>', html, re.DOTALL)
    assert re.findall(r'class="chip (\w+)"[^>]*>([^<]*)<', summary) == [("b2", "75"), ("b0", "0")]
    assert "2 scenes" in summary
    assert " open" not in re.findall(r"<details[^>]*>", html)


def test_a_family_that_is_half_driven_has_no_mean() -> None:
    rows = [drive(f"nudge/{n}", 0.9) for n in range(3)]
    for missing in ((), ("nudge/3",), ("strip.nudge/3",)):
        seen = page(make_table([stored(*rows, missing=missing)]), paper=False)
        assert ("90, mean of 3 drives" in seen, "idm: not all is driven" in seen) == (not missing, bool(missing))


def test_every_column_is_explained() -> None:
    html = page(make_table([stored(drive("nudge/0", 1.0), drive("lane_change_ltd/0", 1.0))]))
    titles = re.findall(r'<th class="n" scope="col" title="[^"]+">([^<]+)</th>', html)
    explained = dict(re.findall(r"<dt>([^<]+)</dt><dd>(.*?)</dd>", html))
    assert {"interPlan", "Nudge", "LTD", "No-Col."} <= set(titles)
    assert all(len(explained[title]) > 20 for title in titles)


def test_a_scene_has_its_drawing_where_it_is_as_it_was_driven() -> None:
    scenario = find_scenario("nudge/0")
    driven = drive("nudge/0", 1.0, scenario_hash=scenario.hash())
    changed = drive("nudge/1", 1.0, scenario_hash="0" * 64)
    run = stored(driven, changed)
    html = page(make_table([run]), [run])
    assert html.count('<svg class="thumbnail"') == 1
    assert re.search(r'<th scope="row"><svg class="thumbnail".*?</svg><span>nudge/0</span>', html)
    assert all(f'class="t-{part}"' in html for part in ("road", "way", "thing", "ego"))


def test_scores_are_counted_by_band() -> None:
    rows = [drive(f"nudge/{n}", score) for n, score in enumerate((0.0, 0.2, 0.5, 0.9, 1.0, 1.0))]
    (spread,) = re.findall(r'<table class="spread">.*?</table>', page(make_table([stored(*rows)])), re.DOTALL)
    assert re.findall(r'<td class="n" data-title="[^"]+"><i class="[^"]+"></i>(\d+)</td>', spread) == [
        "1",
        "1",
        "1",
        "1",
        "2",
    ]


def test_how_the_run_was_made_is_told() -> None:
    run = stored(
        drive("nudge/0", 1.0), suite_hash="cafe" * 16, versions={"sumo": "1.28.0"}, created="2026-01-02T03:04:05Z",
        command=["interplan-sumo", "run", "--scenarios", "nudge/*"], overrides={"density": "high"},
    )  # fmt: skip
    text = read(page(make_table([run]), [run])).text
    for said in ("cafe" * 16, "sumo 1.28.0", "2026-01-02T03:04:05Z", "run --scenarios 'nudge/*'", "density=high"):
        assert said in text


def test_a_replay_that_lies_there_is_linked_and_one_that_does_not_is_told_how_to_make(tmp_path: Path) -> None:
    run = stored(drive("nudge/0", 0.0), drive("nudge/1", 1.0), path=str(tmp_path / "run"))
    table = make_table([run])
    there, _ = shown_drives(table)
    (tmp_path / "report-replays").mkdir()
    (tmp_path / "report-replays" / there.replay).touch()
    html = page(table, [run], path=tmp_path / "report.html")
    assert f'<a href="report-replays/{there.replay}#decides">replay</a>' in html
    assert html.count(">replay</a>") == 1
    assert f"interplan-sumo replay {tmp_path / 'run'} nudge/1 --planner idm --html" in read(html).text
    again = stored(drive("nudge/0", 0.0, trace_hash="driven again"), drive("nudge/1", 1.0), path=str(tmp_path / "run"))
    assert page(make_table([again]), [again], path=tmp_path / "report.html").count(">replay</a>") == 0


def test_how_to_make_a_replay_names_the_run_of_its_line(tmp_path: Path) -> None:
    plain = stored(drive("nudge/0", 1.0), path="runs/plain")
    dense = stored(drive("nudge/0", 0.0), path="runs/dense", overrides={"density": "high"})
    runs = [plain, dense]
    text = read(page(make_table(runs), runs, path=tmp_path / "report.html")).text
    first, second = shown_drives(make_table(runs))
    assert f"interplan-sumo replay runs/plain nudge/0 --planner idm --html {first.replay}" in text
    assert f"interplan-sumo replay runs/dense nudge/0 --planner idm --html {second.replay}" in text


def test_ordinary_driving_stands_first() -> None:
    common = stored(drive("changing_lane/0", 0.87), path="runs/o", suite="common==1", suite_hash="2")
    text = " ".join(read(page(make_table([stored(drive("nudge/0", 0.4)), common]), paper=True)).text.split())
    assert "planner Ordinary interPlan" in text
    assert "idm 87 40" in text
    assert "HybridLLM GPT-3.5 (paper) - 40" in text
    assert "Ordinary" not in read(page(make_table([stored(drive("nudge/0", 0.4))]))).text
