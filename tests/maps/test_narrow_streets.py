"""Streets that both directions share, forks, drives: lanes, not intersections, and cars that wait for each other."""

from __future__ import annotations

import gzip
from pathlib import Path
from time import process_time

import numpy as np
import pytest
import shapely

from interplan_sumo.maps.geopackage import read_map
from interplan_sumo.maps.geopackage_writer import write_map
from interplan_sumo.maps.importers.build import build
from interplan_sumo.maps.importers.source import SourceLane, SourceMap
from interplan_sumo.maps.rules import schema_problems
from interplan_sumo.maps.store import MapFiles
from interplan_sumo.maps.to_sumo import convert
from interplan_sumo.simulation.sumo import sumo
from interplan_sumo.world.roads import Roads
from tests.maps.source_worlds import fork, lane, linked, straight, world
from tests.maps.sumo_runs import random_traffic
from tests.quick import few

ALLEY = ("there", "back")


def alley(apart_m: float = 0.0, width_m: float = 4.0, length_m: float = 60.0) -> SourceMap:
    """A road of two lanes, an alley that both directions share, and again a road of two lanes."""
    end = 60.0 + length_m
    half = apart_m / 2.0
    lanes = [
        straight("in", 0, 60, -2.0, speed_limit_mps=9.0),
        lane("there", ((60.0, -half), (end, -half)), width_m, speed_limit_mps=8.0),
        straight("on", end, end + 60, -2.0, speed_limit_mps=9.0),
        straight("come", end + 60, end, 2.0, speed_limit_mps=9.0),
        lane("back", ((end, half), (60.0, half)), width_m, speed_limit_mps=8.0),
        straight("leave", 60, 0, 2.0, speed_limit_mps=9.0),
    ]
    ways = (("in", "there"), ("there", "on"), ("come", "back"), ("back", "leave"))
    return world(linked(lanes, ways))


def lane_metres(source: SourceMap, *ids: str) -> float:
    """How much of some lanes of the file lies in lanes of the map."""
    made = build(source)
    rows = [row for key, rows in made.origins.items() if key in made.roads.lanes for row in rows]
    return sum(row.end_m - row.start_m for row in rows if row.source_id in ids)


def files_of(source: SourceMap, folder: Path) -> tuple[MapFiles, Roads]:
    files = MapFiles("tiny", "1.0", folder)
    write_map(build(source).roads, files.gpkg)
    roads = read_map(files.gpkg, "tiny")
    convert(roads, folder)
    return files, roads


@pytest.mark.parametrize(("apart_m", "width_m"), [(0.0, 2.8), (0.0, 4.8), (1.5, 3.0), (2.5, 4.0)])
def test_both_directions_keep_their_lanes_and_centre_lines_on_a_shared_street(apart_m: float, width_m: float) -> None:
    source = alley(apart_m, width_m)
    roads = build(source).roads
    assert lane_metres(source, *ALLEY) > 2 * 60.0 - 2.0
    assert schema_problems(roads) == []
    middles = [(source.lanes[key].left.mean(axis=0) + source.lanes[key].right.mean(axis=0)) / 2.0 for key in ALLEY]
    for middle in map(shapely.Point, middles):
        assert min(each.centerline.linestring.distance(middle) for each in roads.lanes.values()) < 0.01
    middle = shapely.Point(np.mean(middles, axis=0)).buffer(width_m)
    there, back = (s for s in (each.polygon.intersection(middle).area for each in roads.lanes.values()) if s > 0.1)
    assert there == pytest.approx(back, rel=0.02)


def test_the_time_to_part_streets_on_the_same_ground_grows_with_their_length_not_with_its_square() -> None:
    def cpu_s(length_m: float) -> float:
        there, back = [(0.0, 0.0), (length_m, 0.0)], [(length_m, 0.5), (0.0, 0.5)]
        start_s = process_time()
        assert len(build(world({"a": lane("a", there), "b": lane("b", back)})).roads.lanes) == 2
        return process_time() - start_s

    assert cpu_s(5000.0) < 7.0 * cpu_s(1250.0)


@pytest.mark.parametrize(("apart_m", "bidi"), [(0.0, 2), (1.9, 2), (2.1, 0)])
def test_cars_that_cannot_pass_are_made_known_to_sumo(apart_m: float, bidi: int, tmp_path: Path) -> None:
    files, _ = files_of(alley(apart_m), tmp_path)
    assert gzip.decompress(files.network.read_bytes()).count(b"bidi=") == bidi


@pytest.mark.parametrize("apart_m", few([0.0, 1.5], 1))
def test_oncoming_cars_never_meet_in_each_other_on_a_shared_street(apart_m: float, tmp_path: Path) -> None:
    files, roads = files_of(alley(apart_m, 3.0, 30.0), tmp_path / "map")
    for seed in (1, 2):
        run = random_traffic(files, roads, tmp_path / str(seed), vehicles=30, seed=seed)
        assert (run.teleports, run.collisions, run.overlaps) == (0, 0, ())
        assert run.vehicles > 10


@pytest.mark.parametrize("apart_m", few([0.0, 1.5], 1))
@pytest.mark.parametrize("first", few([0, 1], 1))
@pytest.mark.parametrize("lead_s", [3.0, 6.0])
def test_who_comes_later_waits_outside_a_long_narrow_street(
    apart_m: float, first: int, lead_s: float, tmp_path: Path
) -> None:
    """Both would stand in the street for good: neither backs up."""
    files, _ = files_of(alley(apart_m, 3.0, 150.0), tmp_path)
    sumo.start(["sumo", "-n", str(files.network), "--no-step-log", "--no-warnings", "--step-length", "0.1"])
    for k, edges in enumerate((["1", "2", "3"], ["4", "5", "6"])):
        sumo.route.add(f"r{k}", edges)
        sumo.vehicle.add(f"v{k}", f"r{k}", depart=str(lead_s * (k != first)), departPos="5")
    sumo.simulationStep(90.0)
    left = sumo.simulation.getMinExpectedNumber()
    sumo.close()
    assert left == 0


@pytest.mark.parametrize(("shared_m", "stay"), [(9.0, False), (12.0, True)])
def test_lanes_that_face_each_other_only_for_a_moment_meet_in_an_intersection(shared_m: float, stay: bool) -> None:
    lanes = linked([straight("a", 0, 60), straight("b", 60 - shared_m + 100, 60 - shared_m)], [])
    assert (lane_metres(world(lanes), "a") > 59.0) == stay


def named(source: SourceMap) -> SourceMap:
    """The map with an intersection somewhere, so that the file is one that names these."""
    far = straight("far", 1000, 1020, in_intersection=True)
    return world({**source.lanes, "far": far})


def test_a_fork_is_a_junction_only_where_the_file_does_not_tell() -> None:
    assert lane_metres(fork(), "on") < 72.0
    assert lane_metres(named(fork()), "on") > 79.0
    assert schema_problems(build(named(fork())).roads) == []


@pytest.mark.parametrize(("length_m", "stays"), [(28.0, False), (33.0, True)])
def test_a_long_free_way_that_the_file_calls_an_intersection_is_a_drive(length_m: float, stays: bool) -> None:
    drive = straight("drive", 60, 60 + length_m, in_intersection=True, speed_limit_mps=3.0)
    lanes = linked([straight("a", 0, 60), drive], [("a", "drive")])
    kept_m = lane_metres(world(lanes), "drive")
    assert kept_m == pytest.approx(length_m - 0.3 if stays else 5.6, abs=0.05)


def crossed(free_m: float) -> dict[str, SourceLane]:
    """A lane that begins so far before a crossing street, behind one at whose end one must stop."""
    side = lane("side", ((60.0, -60.0), (60.0, 60.0)))
    start = 60.0 - 3.5 / 2.0 - free_m
    lanes = [straight("in", 0, start, speed_limit_mps=9.0), straight("box", start, 130.0), side]
    return linked(lanes, [("in", "box")])


@pytest.mark.parametrize(("free_m", "lanes_between"), [(3.0, 0), (9.0, 1)])
def test_an_approach_ends_at_its_stop_line_if_the_junction_begins_within_a_car_length(
    free_m: float, lanes_between: int
) -> None:
    made = build(world(crossed(free_m)))
    stretches = [row for key, rows in made.origins.items() if key in made.roads.lanes for row in rows]
    before = [row for row in stretches if row.source_id == "box" and row.from_share < 0.05]
    assert len(before) == lanes_between
    ends = {key: each.centerline.length_m for key, each in made.roads.lanes.items()}
    assert min(ends.values()) > 5.0


@pytest.mark.parametrize(("first_m", "shortest_m"), [(5.0, 40.0), (7.0, 5.0)])
def test_a_rest_of_less_than_a_car_is_no_lane_but_a_short_lane_of_the_file_is(
    first_m: float, shortest_m: float
) -> None:
    """A street crosses 5 or 7 m behind the start of a lane that has one before it."""
    at = 40.0 + first_m + 3.5 / 2.0 + 0.5
    lanes = [straight("in", 0, 40, speed_limit_mps=9.0), straight("on", 40, 140)]
    side = lane("side", ((at, -60.0), (at, 60.0)))
    made = build(world(linked([*lanes, side], [("in", "on")])))
    assert min(each.centerline.length_m for each in made.roads.lanes.values()) == pytest.approx(shortest_m, abs=2.2)
    short = linked([straight("a", 0, 40), straight("b", 40, 43, speed_limit_mps=5.0)], [("a", "b")])
    assert min(e.centerline.length_m for e in build(world(short)).roads.lanes.values()) == pytest.approx(2.7, abs=0.1)
