"""The maps in nets/: as their plans are drawn and extracts imported today, small, faithful, fit to drive on."""

from __future__ import annotations

import shutil
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import shapely

from interplan_sumo.maps.check import check_map
from interplan_sumo.maps.controls import CONTROLS_FILE
from interplan_sumo.maps.network_file import read_network_file
from interplan_sumo.maps.store import find_map, load_roads, maps
from interplan_sumo.maps.to_sumo import convert
from interplan_sumo.verification.lock import roads_hash
from interplan_sumo.world.geometry import wrap_angle
from interplan_sumo.world.roads import Connector, LaneLike, Roads, StopLineKind, Turn
from tests.maps.sumo_runs import random_traffic
from tests.quick import DISTRICTS, few
from tools.make_maps import PLANS
from tools.make_maps.__main__ import make_map
from tools.make_maps.draw import draw_plan
from tools.make_maps.reading import read_plan
from tools.make_maps.real import LICENCE_FILE, RECIPES, extract_of, make_real_map, read_recipe
from tools.map_yardsticks import tightest_radius_m, yardsticks

BEFORE = {"back_bay", "hazelwood", "one_north", "strip"}
"""Districts of an earlier way of drawing, without plans, on which the official suites stand."""
every_map = pytest.mark.parametrize("name", DISTRICTS)
every_drawn_map = pytest.mark.parametrize("name", PLANS)
every_real_map = pytest.mark.parametrize("name", few(RECIPES, 1))
SMALL_BYTES = 600_000
CARS_APART_M = 2.2
"""Middles of cars that pass one another; at least that far apart are the middles of lanes."""
REAL_KINK_DEG = 11.0
"""Streets of extracts are polylines: SUMO's turns begin with their tightest bend, drawn in chords of a metre."""
REAL_SIDEWAYS_MPS2 = 4.2, 13.0
"""Of lanes and connectors. Where an extract has a vertex, a lane bends within metres; the limits of turns are SUMO's,
by the mean of their bend."""
REAL_CORNERS = 0.01
"""SUMO cuts the corners of walking areas straight, across the edge of turns."""


@pytest.mark.slow
def test_every_plan_and_recipe_is_shipped_and_nothing_else() -> None:
    assert set(maps()) == BEFORE | set(PLANS) | set(RECIPES)
    left = {name for name in maps() if load_roads(name).driving_side == "left"}
    assert left == {"bathurst", "one_north", "queenstown"} & set(maps())


@every_drawn_map
@pytest.mark.nightly
def test_the_shipped_map_is_the_drawn_one(name: str) -> None:
    assert roads_hash(load_roads(name)) == roads_hash(draw_plan(read_plan(PLANS[name])))


@every_real_map
@pytest.mark.slow
def test_the_shipped_map_is_the_imported_one(name: str, tmp_path: Path) -> None:
    assert make_real_map(read_recipe(RECIPES[name]), tmp_path).ok
    made, shipped = maps(tmp_path)[name], find_map(name)
    for file in ("map.net.xml.gz", "ids.json", CONTROLS_FILE, "import.json", LICENCE_FILE):
        assert (made.folder / file).read_bytes() == (shipped.folder / file).read_bytes()
    assert roads_hash(load_roads(made.folder)) == roads_hash(load_roads(name))


@every_real_map
def test_a_map_of_openstreetmap_carries_its_licence(name: str) -> None:
    assert "© OpenStreetMap contributors" in (find_map(name).folder / LICENCE_FILE).read_text(encoding="utf-8")
    assert "Open Database License" in (find_map(name).folder / "import.json").read_text(encoding="utf-8")
    extract = extract_of(read_recipe(RECIPES[name])).read_text(encoding="utf-8")
    assert 'license="ODbL-1.0"' in extract
    assert "user=" not in extract
    assert "uid=" not in extract


@every_real_map
def test_a_real_map_has_streets_that_branch_in_many_places(name: str) -> None:
    found = yardsticks(load_roads(name))
    assert found.lane_km > 3.5
    assert found.per_lane_km > 0.7  # the edge cuts off what would branch; wide streets count lane by lane
    assert found.smallest_radius_m[0] > 25.0


@every_drawn_map
def test_a_drawn_map_is_as_dense_and_bent_as_streets_of_cities(name: str) -> None:
    found = yardsticks(load_roads(name))
    assert 1.4 < found.per_lane_km < 2.3
    assert 15.0 < found.smallest_radius_m[0] < 34.0
    assert 1.45 < found.connectors_per_exit_lane < 2.7
    for value, (low, high) in zip(found.block_length_m, ((7, 45), (18, 114), (53, 209)), strict=True):
        assert low < value < high
    for value, (low, high) in zip(found.lane_width_m, ((2.6, 3.2), (3.0, 5.3), (3.2, 7.9)), strict=True):
        assert low <= round(value, 2) <= high
    assert found.idle_intersections == 0


@every_map
def test_the_shipped_network_is_made_from_the_shipped_map_byte_for_byte(name: str, tmp_path: Path) -> None:
    if (find_map(name).folder / CONTROLS_FILE).exists():
        shutil.copy(find_map(name).folder / CONTROLS_FILE, tmp_path)
    convert(load_roads(name), tmp_path)
    for file in ("map.net.xml.gz", "ids.json"):
        assert (tmp_path / file).read_bytes() == (find_map(name).folder / file).read_bytes()


@every_map
def test_the_shipped_network_is_faithful_and_small(name: str) -> None:
    files = find_map(name)
    report = check_map(files, load_roads(name))
    assert report.ok, report.problems  # nuPlan's rules among them
    assert report.lane_deviation_m.max < 0.01
    assert report.connector_deviation_m.max < 0.01
    assert files.network.stat().st_size + files.ids.stat().st_size < SMALL_BYTES


@pytest.mark.nightly
def test_made_anew_a_map_is_listed_and_its_network_is_the_shipped_one(tmp_path: Path) -> None:
    assert make_map(read_plan(PLANS["south_end"]), tmp_path).ok
    made, shipped = maps(tmp_path)["south_end"], find_map("south_end")
    assert made.network.read_bytes() == shipped.network.read_bytes()
    assert made.ids.read_bytes() == shipped.ids.read_bytes()
    assert roads_hash(load_roads(made.folder)) == roads_hash(load_roads("south_end"))


@every_map
@pytest.mark.slow
def test_traffic_on_shipped_maps_meets_no_accident(name: str, tmp_path: Path) -> None:
    run = random_traffic(find_map(name), load_roads(name), tmp_path, vehicles=100, seed=2)
    assert run.vehicles > 50
    assert run.teleports == 0
    assert run.collisions == 0
    assert [overlap for overlap in run.overlaps if not overlap.askew] == []
    assert run.emergency_brakings <= 0.1 * run.vehicles  # some start within sight of a red light


# --- the roads -------------------------------------------------------------------------------------


def pieces(roads: Roads) -> list[LaneLike]:
    return [*roads.lanes.values(), *roads.connectors.values()]


@every_map
def test_lanes_and_connectors_meet_end_to_end_without_a_kink(name: str) -> None:
    roads = load_roads(name)
    bar_deg = REAL_KINK_DEG if name in RECIPES else 1.0
    for connector in roads.connectors.values():
        before, after = roads.lanes[connector.from_lane_id], roads.lanes[connector.to_lane_id]
        for first, second in ((before.centerline, connector.centerline), (connector.centerline, after.centerline)):
            assert np.hypot(*(first.points[-1] - second.points[0])) < 0.01, connector.id
            kink = wrap_angle(second.segment_heading_rad[0] - first.segment_heading_rad[-1])
            assert abs(np.degrees(kink)) < bar_deg, connector.id


@every_map
def test_every_lane_and_connector_lies_on_the_drivable_area(name: str) -> None:
    roads = load_roads(name)
    paved = shapely.buffer(roads.drivable_area, 1e-3)
    shapely.prepare(paved)
    assert [lane.id for lane in pieces(roads) if not shapely.covers(paved, lane.polygon)] == []
    for lane in pieces(roads):
        assert roads.drivable(lane.centerline.points).all(), lane.id


@every_map
def test_every_lane_can_be_reached_from_the_edge_of_the_map_and_leads_back_to_it(name: str) -> None:
    roads = load_roads(name)
    hull = shapely.union_all([lane.polygon for lane in roads.lanes.values()]).convex_hull
    parks = shapely.union_all([area.polygon for area in roads.carparks])
    for ends, follow in (
        ([i for i in roads.lanes if not roads.incoming(i)], roads.outgoing),
        ([i for i in roads.lanes if not roads.outgoing(i)], roads.incoming),
    ):
        for lane_id in ends:
            end = roads.lanes[lane_id].centerline.points[0 if follow == roads.outgoing else -1]
            # Streets end near the edge of the map, driveways at a car park.
            at_edge = shapely.distance(shapely.boundary(hull), shapely.Point(end)) < 140.0
            assert at_edge or shapely.dwithin(parks, shapely.Point(end), 0.1), lane_id
        seen, queue = set(ends), list(ends)
        while queue:
            lane_id = queue.pop()
            siblings = roads.roadblocks[roads.lanes[lane_id].roadblock_id].lane_ids
            links = [(link, follow(link)[0]) for link in follow(lane_id)]
            for following in (*siblings, *(lane for _, lane in links)):
                if following not in seen:
                    seen.add(following)
                    queue.append(following)
        assert seen == set(roads.lanes)


@every_map
def test_bends_fit_the_limit_and_a_car_can_turn(name: str) -> None:
    def bar(lane: LaneLike) -> float:
        return 3.5 if name in PLANS or name in BEFORE else REAL_SIDEWAYS_MPS2[isinstance(lane, Connector)]

    for lane in pieces(load_roads(name)):
        radius_m = tightest_radius_m(lane.centerline)
        assert radius_m > 5.0, lane.id
        assert (lane.speed_limit_mps or 0.0) ** 2 / radius_m < bar(lane), lane.id


@every_map
def test_light_controlled_connectors_stop_at_one_line_of_a_traffic_light_at_their_start(name: str) -> None:
    roads = load_roads(name)
    lit = [connector for connector in roads.connectors.values() if connector.has_traffic_light]
    assert lit
    for connector in lit:
        (line_id,) = connector.stop_line_ids
        line = roads.stop_lines[line_id]
        assert line.kind is StopLineKind.TRAFFIC_LIGHT
        assert line.polygon.intersects(connector.centerline.linestring)
        assert line.polygon.intersects(roads.lanes[connector.from_lane_id].polygon)


@every_map
def test_connectors_turn_the_way_they_say(name: str) -> None:
    for connector in load_roads(name).connectors.values():
        bend = wrap_angle(connector.centerline.segment_heading_rad[-1] - connector.centerline.segment_heading_rad[0])
        if connector.turn is Turn.STRAIGHT:
            assert abs(np.degrees(bend)) < 33.0, connector.id
        else:
            assert (bend > 0.0) == (connector.turn is Turn.LEFT), connector.id


@every_map
def test_crosswalks_lie_on_paved_ground_and_clear_of_the_lanes(name: str) -> None:
    roads = load_roads(name)
    places_ = shapely.union_all([area.polygon for area in (*roads.intersections, *roads.road_segments)])
    lanes_ = shapely.union_all([lane.polygon for lane in roads.lanes.values()])
    least, most_m2 = (0.7, 1.0) if name in RECIPES else (0.97, 0.01)  # to the kerbs of the junction
    assert roads.crosswalks
    for crosswalk in roads.crosswalks:
        paved = crosswalk.polygon.intersection(places_).convex_hull  # a median may lie between
        assert crosswalk.polygon.intersection(paved).area > least * crosswalk.polygon.area, crosswalk.id
        assert crosswalk.polygon.intersection(lanes_).area < most_m2, crosswalk.id


@every_map
def test_nobody_drives_on_a_walkway(name: str) -> None:
    roads = load_roads(name)
    walkways = shapely.union_all([area.polygon for area in roads.walkways])
    assert walkways.intersection(roads.drivable_area).area < (REAL_CORNERS * walkways.area if name in RECIPES else 2.0)
    assert walkways.area > 2000.0


@every_map
def test_streets_beside_one_another_do_not_lie_on_one_another(name: str) -> None:
    roads = load_roads(name)
    lanes = list(roads.lanes.values())
    lines = [lane.centerline.linestring for lane in lanes]
    one, other = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=CARS_APART_M)
    for i, j in zip(one, other, strict=True):
        if lanes[i].roadblock_id < lanes[j].roadblock_id:
            beside = shapely.intersection(lines[i], shapely.buffer(lines[j], CARS_APART_M))
            assert beside.length < 5.0, f"{lanes[i].id} and {lanes[j].id}: {beside.length:.0f} m"


@every_map
def test_paths_that_cross_in_a_junction_are_foes(name: str) -> None:
    file = read_network_file(find_map(name).network)
    for junction, links in file.links():
        paths = [shapely.LineString(file.internal[each.via].shape) if each.via else None for each in links]
        for (i, one), (j, other) in combinations(enumerate(links), 2):
            path, across = paths[i], paths[j]
            if one.from_lane.rpartition("_")[0] != other.from_lane.rpartition("_")[0] and path and across:
                assert j in junction.foes[i] or not path.crosses(across), f"{one.name} and {other.name}"
