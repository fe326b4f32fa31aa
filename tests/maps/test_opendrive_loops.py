"""Edges inside tight bends: the loops that they make are cut out, and ramps that cross themselves are not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely

from interplan_sumo.maps.check import check_map
from interplan_sumo.maps.geopackage import read_map
from interplan_sumo.maps.importers.importing import check_source, import_map
from interplan_sumo.maps.importers.lines import length_m
from interplan_sumo.maps.importers.opendrive.loops import without_loops
from interplan_sumo.maps.importers.opendrive.reader import read_opendrive
from tests.maps.opendrive_files import geometry, lane, road, section, to_road, written, xodr


def chain(width_m: float) -> tuple[str, str, str]:
    """A lane, the one after it, and the one after that."""
    return (
        lane(-1, width=width_m, after=(-1,)),
        lane(-1, width=width_m, before=(-1,), after=(-1,)),
        lane(-1, width=width_m, before=(-1,)),
    )


def circle(radius_m: float, turns: float) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    angle = np.linspace(0.0, 2.0 * np.pi * turns, 200)
    return np.stack((radius_m * np.cos(angle) + angle, radius_m * np.sin(angle)), axis=1)


def test_a_loop_is_cut_at_its_crossing() -> None:
    line = np.array([(0.0, 0), (10, 0), (12, 2), (10, 4), (8, 2), (10, -2), (10, -10)])
    assert without_loops(line, 10.0).tolist() == [[0, 0], [9, 0], [10, -2], [10, -10]]
    assert without_loops(line, 1.0) is not line
    assert len(without_loops(line, 1.0)) == len(line)


def test_what_does_not_cross_itself_stays_the_same_and_so_does_a_ramp() -> None:
    bend, ramp = circle(20.0, 0.8), circle(20.0, 1.8)
    assert without_loops(bend, 5.0) is bend
    assert not shapely.LineString(ramp).is_simple
    assert np.array_equal(without_loops(ramp, 5.0), ramp)


def test_the_inner_edge_of_a_bend_of_short_straight_pieces_does_not_run_back(tmp_path: Path) -> None:
    """A quarter circle of 9 m radius in nine chords, with a lane up to 7 m to its inside."""
    angle = np.radians(np.arange(0.0, 91.0, 10.0))
    corners = 9.0 * np.stack((np.sin(angle), 1.0 - np.cos(angle)), axis=1)
    steps = np.diff(corners, axis=0)
    lengths = np.hypot(*steps.T)
    stations = np.concatenate(([0.0], np.cumsum(lengths)))
    places = [(*corners[k], np.arctan2(steps[k, 1], steps[k, 0])) for k in range(9)]
    plan = "".join(geometry("<line/>", lengths[k], stations[k], places[k]) for k in range(9))
    source = read_opendrive(written(tmp_path, xodr(road("1", section(lane(1, width=3.5), lane(2)), plan=plan))))
    inside = shapely.LineString(source.lanes["1/0/2"].right[:, :2])
    assert inside.is_simple
    assert inside.length < 0.5 * np.pi * 2.0 + 2.0


def test_a_corner_as_tight_as_its_lane_is_wide_is_a_way_around_it(tmp_path: Path) -> None:
    """A turn to the right about the lane's own edge, which is a point there."""
    turn = geometry('<arc curvature="-0.25"/>', 4.0 * np.pi / 2.0, place=(100, 0, 0))
    away = geometry(place=(104, -4, -np.pi / 2.0))
    to, around, on = map(section, chain(4.0))
    roads = (
        road("1", to, links=("", to_road("2"))),
        road("2", around, plan=turn, links=(to_road("1", "end"), to_road("3"))),
        road("3", on, plan=away, links=(to_road("2", "end"), "")),
    )
    file = written(tmp_path, xodr(*roads))
    corner = read_opendrive(file).lanes["2/0/-1"]
    assert length_m(corner.left) == pytest.approx(2.0 * np.pi, abs=0.05)
    assert length_m(corner.right) == pytest.approx(0.1 * np.pi, abs=0.01)
    files, record = import_map(file, "opendrive", tmp_path / "corner")
    roads_of = read_map(files.gpkg, "corner")
    assert check_map(files, roads_of).problems == ()
    assert check_source(files, roads_of, record, file).problems == ()


def test_a_lane_that_is_short_only_inside_a_bend_is_passed_over(tmp_path: Path) -> None:
    """A section of 12 cm of the reference line, of which a lane to the inside has less than SUMO's 10 cm."""
    starts_m = (0.0, 5.0, 5.12)
    sections = [section(each, s=s) for s, each in zip(starts_m, chain(3.5), strict=True)]
    bend = geometry('<arc curvature="-0.1"/>', 10.0)
    file = written(tmp_path, xodr(road("1", *sections, plan=bend)))
    assert read_opendrive(file).lanes["1/0/-1"].successors == ("1/2/-1",)
    _, record = import_map(file, "opendrive", tmp_path / "bend")
    assert not [note for note in record.notes if "1/1/-1" in note]
