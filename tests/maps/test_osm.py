"""OpenStreetMap extracts as maps: what is read, on which side one drives, and what cannot be used."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest

from interplan_sumo.maps.check import check_map
from interplan_sumo.maps.importers.importing import check_source, import_map
from interplan_sumo.maps.importers.lanelet2.reader import read_lanelet2
from interplan_sumo.maps.importers.lines import mean_length_m
from interplan_sumo.maps.importers.osm.extract import driving_side, read_extract
from interplan_sumo.maps.importers.osm.left_hand_places import keeps_left
from interplan_sumo.maps.importers.osm.reader import LICENCE, count_osm, read_osm_extract
from interplan_sumo.maps.importers.record import read_record
from interplan_sumo.maps.store import load_roads
from tests.maps.damaged import refusal
from tests.maps.osm_files import MUNICH, crossing, node, osm, roundabout, way, written

LONDON = (-0.1, 51.5)


def test_a_signalled_crossing_has_its_ways_light_limits_and_crosswalks(tmp_path: Path) -> None:
    source = read_osm_extract(written(tmp_path, osm(crossing())))
    assert (source.crs, source.driving_side, source.format, source.name) == (
        "EPSG:32632", "right", "OpenStreetMap", "town",
    )  # fmt: skip
    streets = [lane for lane in source.lanes.values() if not lane.in_intersection]
    ways = [lane for lane in source.lanes.values() if lane.in_intersection]
    assert (len(streets), len(ways)) == (8, 12)
    assert all(lane.lights_at_start for lane in ways)
    assert {round(lane.speed_limit_mps or 0.0, 2) for lane in streets} == {8.33, 13.89}
    assert len(source.crosswalks) == 4
    assert len(source.signals) == 1
    assert source.notes[0] == LICENCE
    assert any("1 of 2 roads name no limit" in note for note in source.notes)
    assert any("1 service roads and tracks" in note for note in source.notes)


def test_the_map_agrees_with_its_network_and_its_extract_and_carries_the_licence(tmp_path: Path) -> None:
    path = written(tmp_path, osm(crossing()))
    files, record = import_map(path, "osm", tmp_path / "town")
    roads = load_roads(files.folder)
    assert check_map(files, roads).problems == ()
    assert check_source(files, roads, record, path).problems == ()
    kept = read_record(files.folder)
    assert kept is not None
    assert LICENCE in kept.notes


@pytest.mark.parametrize(
    ("lanes", "fine"),
    [
        ("30", True),
        ("2;1", True),
        ("31", False),
        ("1000000", False),
        ("9" * 5000, False),
        ("400;500", False),
        ("+400", False),
    ],
)
def test_a_slip_of_the_pen_makes_no_million_lanes(lanes: str, fine: bool, tmp_path: Path) -> None:
    nodes = node(1, 0, 0) + node(2, 200, 0)
    path = written(tmp_path, osm(nodes, way(3, (1, 2), highway="primary", lanes=lanes)))
    if fine:
        assert read_extract(path).roads == 1
    else:
        assert "way 3 has lanes=" in refusal(path, read_osm_extract)


def test_a_street_whose_tags_change_beside_a_crossing_is_one_up_to_it(tmp_path: Path) -> None:
    """Else a street of decimetres is left between the two junctions, and the way through one of them leads back."""
    text = osm(
        *(
            node(id_, x, y)
            for id_, x, y in ((1, 0, 0), (2, -150, 0), (3, 150, 0), (4, 0, -150), (5, 0, 150), (6, -8, 0))
        ),
        way(10, (2, 6), highway="secondary", maxspeed="50"),
        way(11, (6, 1, 3), highway="secondary", maxspeed="30"),
        way(12, (4, 1, 5), highway="tertiary"),
    )
    streets = [one for one in read_osm_extract(written(tmp_path, text)).lanes.values() if not one.in_intersection]
    assert len(streets) == 8
    assert min(mean_length_m(one.left, one.right) for one in streets) > 100.0


def test_archives_are_read_too_whatever_their_name(tmp_path: Path) -> None:
    path = tmp_path / "town_48.1,11.5.osm"
    path.write_bytes(gzip.compress(osm(crossing()).encode()))
    assert set(read_osm_extract(path).lanes) == set(count_osm(path).lane_length_m)


# --- the driving side --------------------------------------------------------------------------------


def test_london_keeps_left_and_its_map_is_drawn_so(tmp_path: Path) -> None:
    source = read_osm_extract(written(tmp_path, osm(crossing(LONDON))))
    assert source.driving_side == "left"
    assert "Traffic keeps left, as is the law where it lies." in source.notes


@pytest.mark.parametrize(
    ("parts", "at", "side", "why"),
    [
        ("", MUNICH, "right", "law"),
        ("", LONDON, "left", "law"),
        (way(20, (1, 2), highway="primary", driving_side="left"), MUNICH, "left", "tags"),
        (roundabout(30, 60, clockwise=True) + roundabout(40, -60, clockwise=True), MUNICH, "left", "roundabouts"),
        (roundabout(30, 60, clockwise=False) + roundabout(40, -60, clockwise=False), MUNICH, "right", "roundabouts"),
        (roundabout(30, 60, clockwise=True), MUNICH, "right", "law"),
        (roundabout(30, 60, clockwise=True) + roundabout(40, -60, clockwise=False), MUNICH, "right", "law"),
    ],
)
def test_tags_go_before_roundabouts_and_these_before_the_place(
    tmp_path: Path, parts: str, at: tuple[float, float], side: str, why: str
) -> None:
    found, said = driving_side(read_extract(written(tmp_path, osm(crossing(at), parts))))
    assert found == side
    assert why in said


@pytest.mark.parametrize(
    ("place", "left"),
    [
        ((-0.13, 51.51), True), ((-6.26, 53.35), True), ((-5.93, 54.6), True), ((1.31, 51.13), True),  # Dover
        ((1.86, 50.95), False), ((-4.49, 48.39), False), ((-1.62, 49.64), False),  # Calais, Brest, Cherbourg
        ((14.51, 35.9), True), ((33.36, 35.17), True), ((35.5, 33.89), False),  # Valletta, Nicosia, Beirut
        ((77.2, 28.6), True), ((72.88, 19.07), True), ((67.0, 24.86), True), ((90.4, 23.8), True), ((85.3, 27.7), True),
        ((69.2, 34.5), False), ((91.1, 29.65), False), ((96.2, 16.8), False),  # Kabul, Lhasa, Rangoon
        ((100.5, 13.75), True), ((98.98, 18.79), True), ((102.6, 17.98), False), ((104.9, 11.55), False),
        ((103.85, 1.29), True), ((101.7, 3.14), True), ((106.8, -6.2), True), ((121.0, 14.6), False),  # Manila
        ((114.16, 22.28), True), ((114.06, 22.56), False), ((113.55, 22.2), True),  # Hong Kong, Shenzhen, Macau
        ((139.7, 35.7), True), ((141.35, 43.06), True), ((126.98, 37.57), False), ((121.5, 25.04), False),
        ((151.2, -33.87), True), ((115.86, -31.95), True), ((174.76, -36.85), True), ((147.2, -9.44), True),
        ((18.4, -33.9), True), ((36.8, -1.29), True), ((28.28, -15.4), True), ((32.58, 0.32), True),
        ((27.48, -11.66), False), ((30.06, -1.95), False), ((13.23, -8.84), False), ((47.5, -18.9), False),
        ((-58.16, 6.8), True), ((-55.2, 5.85), True), ((-52.33, 4.94), False), ((-60.67, 2.82), False),
        ((-76.8, 18.0), True), ((-77.35, 25.05), True), ((-80.2, 25.77), False), ((-82.37, 23.13), False),
        ((-73.99, 40.73), False), ((11.58, 48.14), False),
    ],
)  # fmt: skip
def test_places_are_on_the_side_of_their_law(place: tuple[float, float], left: bool) -> None:
    assert keeps_left(*place) is left


# --- what cannot be used -----------------------------------------------------------------------------


LANELET = '<relation id="9"><member type="way" ref="1" role="left"/><tag k="type" v="lanelet"/></relation>'
FAULTS = [
    ("", "the file is damaged ("),
    ("<net/>", "its root is <net>, expected <osm>; give such a file"),
    (osm(), "the file holds no way that is a road for cars; give an extract with streets"),
    (osm(node(1, 0, 0), way(2, (1, 1), highway="footway")), "the file holds no way that is a road for cars"),
    (osm(way(2, (1, 5), highway="primary")), "its nodes have no latitudes and longitudes; give them"),
    (osm(node(1, 0, 0), way(2, (1, 1), highway="primary")), "netconvert makes no network of it ("),
    (osm(LANELET), "it is a Lanelet2 map, not an extract of OpenStreetMap; give --format lanelet2"),
]


@pytest.mark.parametrize(("text", "said"), FAULTS, ids=[said for _, said in FAULTS])
def test_what_cannot_be_used_is_one_clear_line(text: str, said: str, tmp_path: Path) -> None:
    assert refusal(written(tmp_path, text), read_osm_extract).startswith(f"FILE: {said}")


def test_binary_extracts_are_told_the_way_out(tmp_path: Path) -> None:
    path = written(tmp_path, "", "town.osm.pbf")
    assert "give OSM XML (osmium cat town.osm.pbf -o map.osm)" in refusal(path, read_osm_extract)


def test_the_reader_of_lanelets_knows_an_extract_of_streets(tmp_path: Path) -> None:
    assert "give --format osm" in refusal(written(tmp_path, osm(crossing())), read_lanelet2)
