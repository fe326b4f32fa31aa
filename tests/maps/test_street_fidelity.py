"""The check of an imported map names streets that became something else, stubs, and centre lines beside the file's."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

from interplan_sumo.maps.importers.build import build
from interplan_sumo.maps.importers.source import SourceLane, SourceMap
from interplan_sumo.maps.importers.street_fidelity import StreetReport, compare_streets
from interplan_sumo.maps.problem import MapProblem
from interplan_sumo.world.geometry import Polyline
from tests.maps.source_worlds import crossing, junction_with_flags, lane, linked, road_of_two, straight, world


def compared(built: SourceMap, read: SourceMap | None = None) -> tuple[StreetReport, tuple[MapProblem, ...]]:
    """A map made of one file, held against another one, else its own."""
    made = build(built)
    return compare_streets(made.roads, made.origins, read or built, "tiny")


def test_a_faithful_import_has_no_problem() -> None:
    report, problems = compared(junction_with_flags())
    assert problems == ()
    assert report.names_intersections
    assert report.street_km == pytest.approx(0.15, rel=0.01)
    assert report.lost_share < 0.01
    assert report.deviation_m.max < 0.01


@pytest.mark.parametrize(("aside_m", "told"), [(0.34, False), (0.36, True)])
def test_a_centre_line_beside_the_files_is_named(aside_m: float, told: bool) -> None:
    """One vertex of it; far fewer than one in a hundred would be needed for the mean."""
    made = build(road_of_two())
    key, own = next(iter(made.roads.lanes.items()))
    points = own.centerline.points.copy()
    points[60] += np.array((0.0, aside_m))
    roads = replace(made.roads, lanes={**made.roads.lanes, key: replace(own, centerline=Polyline(points))})
    _, problems = compare_streets(roads, made.origins, road_of_two(), "tiny")
    assert [(p.kind, p.layer, p.id) for p in problems] == ([("deviation", "lanes_polygons", key)] if told else [])


@pytest.mark.parametrize(("aside_m", "told"), [(0.19, False), (0.21, True)])
def test_many_vertices_a_little_aside_are_a_problem_of_the_file(aside_m: float, told: bool) -> None:
    moved = world({"a": straight("a", 0, 100, aside_m)})
    _, problems = compared(moved, world({"a": straight("a", 0, 100)}))
    assert [(p.kind, p.layer) for p in problems] == ([("deviation", "file")] if told else [])


def test_oncoming_lanes_are_not_taken_for_ones_own() -> None:
    """A lane that runs with the file's, and one against it: there is nothing to compare that with."""
    _, problems = compared(world({"a": straight("a", 100, 0)}), world({"a": straight("a", 0, 100)}))
    assert {p.kind for p in problems} == {"deviation"}


@pytest.mark.parametrize(("before_m", "told"), [(700.0, False), (600.0, True)])
def test_streets_that_became_connectors_are_counted(before_m: float, told: bool) -> None:
    """20 m of 720 or of 620, where the file names its intersections."""
    between = straight("between", 0, 20, in_intersection=True)
    lanes = [straight("in", -before_m, 0), between, straight("out", 20, 28, in_intersection=True)]
    built = world(linked(lanes, [("in", "between"), ("between", "out")]))
    read = world({**built.lanes, "between": replace(between, in_intersection=False)})
    report, problems = compared(built, read)
    assert report.lost_share == pytest.approx(20.0 / (before_m + 20.0), rel=0.05)
    assert [p.kind for p in problems] == (["street"] if told else [])


def test_a_file_that_names_no_intersections_is_measured_and_not_judged() -> None:
    report, problems = compared(crossing())
    assert not report.names_intersections
    assert report.lost_share == pytest.approx(0.05, abs=0.015)
    assert problems == ()


@pytest.mark.parametrize(("in_file_m", "stubs"), [(5.0, 0), (40.0, 1)])
def test_a_short_lane_is_a_stub_if_the_files_is_long(in_file_m: float, stubs: int) -> None:
    flagged = lane("far", ((900.0, 0.0), (940.0, 0.0)), in_intersection=True)
    built = world({"a": straight("a", 0, 4.9), "far": flagged})
    report, problems = compared(built, world({"a": straight("a", 0, in_file_m), "far": flagged}))
    assert report.stubs == stubs
    assert ("lanes_polygons" in {p.layer for p in problems if p.kind == "street"}) == bool(stubs)


def test_the_comparison_of_a_long_winding_lane_takes_little_longer_than_that_of_short_ones() -> None:
    """4 km in one lane, or in forty."""

    def winding(id: str, start_m: float, end_m: float, y_m: float) -> SourceLane:
        x_m = np.arange(start_m, end_m + 0.5)
        return lane(id, np.stack((x_m, y_m + 20.0 * np.sin(x_m / 50.0)), axis=1).tolist())

    def cpu_s(source: SourceMap) -> float:
        made = build(source)
        start_s = time.process_time()
        report, _ = compare_streets(made.roads, made.origins, source, "tiny")
        assert report.lost_share < 0.01
        return time.process_time() - start_s

    short_s = cpu_s(world({str(n): winding(str(n), 0.0, 100.0, 100.0 * n) for n in range(40)}))
    assert cpu_s(world({"a": winding("a", 0.0, 4000.0, 0.0)})) < 3.0 * short_s
