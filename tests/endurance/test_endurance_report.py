"""The endurance report: what its tables, page and figure say of a made-up run, and that names are only text."""

from __future__ import annotations

import json
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np
import pytest

from benchmarks.rate_coverage import ToyWorld, driven
from interplan_sumo.endurance.drawings import RateAxis, axis_top, event_maps, rate_drawings, width_drawing
from interplan_sumo.endurance.formats import endurance_json, endurance_text, report_notes, report_tables
from interplan_sumo.endurance.page import endurance_page, write_endurance_report
from interplan_sumo.endurance.plot import planner_look
from interplan_sumo.endurance.records import SegmentRecord, TrafficCell
from interplan_sumo.endurance.report import EnduranceReport, endurance_report
from interplan_sumo.errors import InputError
from interplan_sumo.report.page.curves import HIGH
from interplan_sumo.report.printing import console

EVIL = "<script>alert(1)</script>"


def of_cell(planner: str, density: float, drivers: str, seed: int, *, naive: float = 0.5) -> list[SegmentRecord]:
    """A toy run, as if driven in a cell of a shipped map."""
    run = driven(ToyWorld(400, naive, 4), np.random.default_rng(seed))
    cell = TrafficCell("greenfield", density, drivers)
    return [msgspec.structs.replace(each, planner=planner, cell=cell) for each in run]


@pytest.fixture(scope="module")
def report() -> EnduranceReport:
    """Two planners, two densities, two populations."""
    return endurance_report(
        segment
        for seed, (planner, density, drivers) in enumerate(
            (planner, density, drivers)
            for planner in ("idm", EVIL)
            for density in (0.25, 0.75)
            for drivers in ("mixed", "assertive")
        )
        for segment in of_cell(planner, density, drivers, seed)
    )


def test_tables_tell_rates_strata_places_cells_and_ratios(report: EnduranceReport) -> None:
    tables = {table.title: table for table in report_tables(report)}
    assert [row[0] for row in tables["Per 1000 km"].rows] == [EVIL, "idm"]
    assert len(tables["Per 1000 km, cell by cell"].rows) == 8
    strata = tables["idm: what makes its at-fault collisions"].rows
    assert [row[0] for row in strata] == ["ordinary", "jaywalker", "cut-in", "total"]
    assert strata[1][-1] == "weighted"
    assert tables["idm: per 1000 km at such places"].columns == ("", "straight")
    assert len(tables["At-fault collisions multiplied by, all else alike"].rows) == 3
    assert all(len(row) == len(table.columns) for table in tables.values() for row in table.rows)


def test_notes_tell_the_bound_of_the_gain_the_mean_weight_and_when_a_rate_is_known(report: EnduranceReport) -> None:
    notes = " ".join(report_notes(report))
    for part in ("30 effective events", "times at most", "mean weight of boosted segments", "known to +-30 % after"):
        assert part in notes
    pilot = " ".join(report_notes(endurance_report(of_cell("idm", 0.5, "mixed", 1)[:100])))
    assert "hours" not in pilot  # nobody measured them
    assert "take" in pilot or "nothing says how far" in pilot


def test_jams_that_were_helped_out_and_kilometres_without_rates_are_told() -> None:
    run = of_cell("idm", 0.5, "mixed", 1)[:20]
    jammed = [msgspec.structs.replace(each, removed_vehicles=1) for each in run]
    assert "more than one in 10 km" in " ".join(report_notes(endurance_report(jammed)))
    assert "more than one" not in " ".join(report_notes(endurance_report(run)))
    boosted = [each for each in run if not each.naive]
    refused = endurance_report(boosted)
    assert "no rates, 0 % of the kilometres are naive" in " ".join(report_notes(refused))
    assert report_tables(refused)[0].rows[0][-1] == "refused"
    assert "refused" in endurance_page(refused)


def test_text_and_json_hold_what_the_report_holds(report: EnduranceReport) -> None:
    place = console()
    with place.capture() as said:
        for part in endurance_text(report):
            place.print(part)
    assert "at-fault collisions" in said.get()
    document = json.loads(json.dumps(endurance_json(report), allow_nan=False))
    total = document["planners"][1]["measures"]["at_fault_collision"]["total"]
    assert total["interval"][0] < total["per_1000_km"] < total["interval"][1]
    assert len(document["cells"]) == 8


class Tags(HTMLParser):
    """Which elements there are."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.seen: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: object) -> None:  # noqa: ARG002
        self.seen.append(tag)


def test_the_page_shows_all_drawings_and_names_stay_text(report: EnduranceReport) -> None:
    text = endurance_page(report, f"interplan-sumo endure {EVIL}")
    tags = Tags(text).seen
    assert "script" not in tags
    assert tags.count("svg") == 2 + 1 + 1  # populations, a district, widths
    assert "&lt;script&gt;" in text


def test_a_drawing_has_a_mark_for_each_cell_and_a_dot_for_each_event(report: EnduranceReport) -> None:
    panels = rate_drawings(report)
    assert [(each.title, [len(planner.marks) for planner in each.planners]) for each in panels] == [
        ("assertive, greenfield", [2, 2]),
        ("mixed, greenfield", [2, 2]),
    ]
    assert all(planner.path and planner.band for each in panels for planner in each.planners)
    (district,) = event_maps(report)
    assert len(district.dots) == len(report.events["greenfield"]) > 0
    assert len(district.roads) > 1000
    widths = width_drawing(report)
    assert widths is not None
    heights = [mark.y for mark in widths.planners[0].marks]
    assert heights[-1] > heights[0]  # down, as more is driven


def test_little_driving_has_a_page_without_pictures_of_what_is_not_known() -> None:
    report = endurance_report(of_cell("idm", 0.5, "mixed", 1)[:4])
    assert width_drawing(report) is None
    text = endurance_page(report)
    assert "How far between" in text
    assert "Density and drivers" not in text


@pytest.mark.parametrize(
    ("values", "top"), [([], 1.0), ([3.9], 4.0), ([4.1], 8.0), ([99.0], 100.0), ([0.0007], 0.0008)]
)
def test_axes_end_at_a_round_number(values: list[float], top: float) -> None:
    assert axis_top(values) == pytest.approx(top)


def test_rates_that_differ_by_powers_of_ten_can_be_told_apart_on_one_axis_and_0_has_a_place() -> None:
    axis = RateAxis(10.0, 4000.0)
    assert axis.marked == [0.0, 10.0, 100.0, 1000.0]
    bottom, *heights, top = map(axis.y, (0.0, 10.0, 100.0, 1000.0, 4000.0))
    assert (bottom, top) == (HIGH, 0.0)
    assert all(below - above > 0.1 * HIGH for below, above in pairwise((bottom, *heights)))
    assert RateAxis(1.0, 8.0).marked == [0.0, 2.0, 4.0, 6.0, 8.0]


def test_no_two_of_many_planners_look_alike_in_the_figure() -> None:
    assert len({tuple(planner_look(number).values()) for number in range(24)}) == 24


def test_page_and_figure_are_written_or_refused_in_a_line(report: EnduranceReport, tmp_path: Path) -> None:
    write_endurance_report(report, page=tmp_path / "a.html", plot=tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(InputError, match="cannot write"):
        write_endurance_report(report, page=tmp_path / "no" / "a.html")
    with pytest.raises(InputError, match="cannot write"):
        write_endurance_report(report, plot=tmp_path / "a.nonsense")


@pytest.mark.parametrize(("measure", "wanted"), [("crashes", 0.3), ("at_fault_collision", 0.0), ("stall", 3.0)])
def test_what_cannot_be_asked_for_is_refused(measure: str, wanted: float) -> None:
    with pytest.raises(InputError):
        endurance_report([], measure=measure, wanted=wanted)  # type: ignore[arg-type]
