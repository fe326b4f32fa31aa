"""Conversion to SUMO: faithful, complete, repeatable, and traffic drives on it without accidents."""

from __future__ import annotations

import gzip
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
import pytest
from defusedxml.ElementTree import fromstring

from interplan_sumo.errors import MapError
from interplan_sumo.maps.check import check_map
from interplan_sumo.maps.geopackage import read_map
from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.network_links import read_network_summary
from interplan_sumo.maps.store import MapFiles
from interplan_sumo.maps.to_sumo import IDS_FILE, NETWORK_FILE, convert, network
from interplan_sumo.world.roads import DrivingSide, Roads, StopLineKind
from tests.maps.map_files import GOLDEN_MAPS
from tests.maps.road_worlds import GridPlan, Ways, beside, crossing, grid_city, small_roads, straight
from tests.maps.sumo_runs import random_traffic
from tests.quick import few

ASCII = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
"""An environment in which text is ASCII unless somebody says otherwise; on Windows it is that of the country."""
NAMES = ("gs-boulevard", "gs-cross", "gs-curve", "gs-merge-lht")
TARGET_M = 0.01


def golden(name: str) -> Roads:
    return read_map(GOLDEN_MAPS / name / "1.0" / "map.gpkg")


def converted(roads: Roads, root: Path) -> MapFiles:
    files = MapFiles(roads.name, "1.0", root / roads.name / "1.0")
    convert(roads, files.folder)
    return files


def document(files: MapFiles) -> Element:
    return fromstring(gzip.decompress(files.network.read_bytes()))


WORLDS: dict[str, Callable[[], Roads]] = {
    "grid": lambda: grid_city(GridPlan(columns=3, rows=2, lanes=2, limits_mps=(13.89, 8.33, None, 16.67))),
    "grid, left, turned": lambda: grid_city(GridPlan(columns=3, rows=3, lanes=2, side="left", rotation_rad=0.3)),
    "grid without lights": lambda: grid_city(GridPlan(columns=3, rows=3, lanes=1, signals=False)),
    "crossing": crossing,
    "crossing, left": lambda: crossing(side="left"),
    "crossing with lights": lambda: crossing(lit=True),
    "one lane, nothing else": lambda: small_roads({"1": [straight((0, 0), (30, 0))]}),
    "ragged": lambda: small_roads(
        {
            "1": [straight((0, 0), (100, 0)), straight((15, -3.5), (80, -3.5)), straight((8, -7), (100, -7))],
            "2": [beside(straight((130, 0), (200, 0)), 3.5 * k) for k in range(3)],
        },
        [Ways("1", "2", ((0, 0), (1, 1), (2, 2)))],
    ),
}


@cache
def world(name: str) -> Roads:
    return WORLDS[name]() if name in WORLDS else golden(name)


@pytest.mark.parametrize("name", [*WORLDS, *NAMES])
def test_maps_convert_within_a_centimetre_with_every_connector_and_no_other(name: str, tmp_path: Path) -> None:
    roads = world(name)
    report = check_map(converted(roads, tmp_path), roads)
    assert report.missing == ()
    assert report.extra == ()
    assert report.wrong_limits == ()
    assert report.lane_deviation_m.max < TARGET_M
    assert report.connector_deviation_m.max < TARGET_M
    assert report.light_connectors_covered == report.light_connectors
    assert report.lane_length_distortion.max < 0.06
    assert [p for p in report.problems if p.kind in ("light", "broken_link")] == []
    assert report.ok or name in WORLDS, "the golden maps pass as a whole"


def test_the_returned_ids_are_those_on_disk(tmp_path: Path) -> None:
    ids = convert(world("ragged"), tmp_path)
    assert (tmp_path / NETWORK_FILE).is_file()
    read = NetworkIds.read(tmp_path / IDS_FILE)
    assert read.links == ids.links
    assert read.pieces.keys() == ids.pieces.keys()
    for lane_id, pieces in ids.pieces.items():
        assert pieces[0].start_m == 0.0
        assert pieces[-1].end_m == pytest.approx(world("ragged")[lane_id].centerline.length_m)


@pytest.mark.parametrize("name", ["grid", "grid, left, turned", "ragged"])
def test_places_in_the_network_are_those_of_the_map(name: str, tmp_path: Path) -> None:
    roads = world(name)
    files = converted(roads, tmp_path)
    ids, net = NetworkIds.read(files.ids), read_network_summary(files.network)
    for lane in (*roads.lanes.values(), *roads.connectors.values()):
        for arc_m in np.linspace(0.0, lane.centerline.length_m, 7):
            sumo_lane, fraction = ids.sumo_place(lane.id, float(arc_m))
            points = net.lanes[sumo_lane].shape
            steps = np.hypot(*np.diff(points, axis=0).T)
            along = fraction * steps.sum()
            at = np.concatenate(([0.0], np.cumsum(steps)))
            place = [np.interp(along, at, points[:, k]) + ids.origin_m[k] for k in range(2)]
            true = lane.centerline.pose_at(float(arc_m))
            assert np.hypot(place[0] - true.x_m, place[1] - true.y_m) < 0.02


@pytest.mark.parametrize("side", ["right", "left"])
def test_lane_zero_is_at_the_kerb(side: DrivingSide, tmp_path: Path) -> None:
    lines = [beside(straight((0, 0), (60, 0)), 3.5 * k) for k in range(3)]
    files = converted(small_roads({"1": lines}, side=side), tmp_path)
    assert NetworkIds.read(files.ids).pieces["10" if side == "left" else "12"][0].sumo_lane == "1_0"
    assert (document(files).get("lefthand") == "true") is (side == "left")


def test_lanes_of_one_road_keep_their_own_limit_and_width(tmp_path: Path) -> None:
    roads = small_roads({"1": [beside(straight((0, 0), (60, 0)), 3.5 * k) for k in range(2)]})
    slow = replace(roads.lanes["11"], speed_limit_mps=8.33)
    narrow = replace(roads.lanes["10"], polygon=roads.lanes["10"].centerline.linestring.buffer(1.5, cap_style="flat"))
    root = document(converted(replace(roads, lanes={"10": narrow, "11": slow}), tmp_path))
    lanes = {lane.attrib["id"]: lane.attrib for lane in root.iterfind("edge/lane")}
    assert [float(lanes[f"1_{k}"]["speed"]) for k in (0, 1)] == [8.33, 13.89]
    assert [float(lanes[f"1_{k}"]["width"]) for k in (0, 1)] == [3.5, 3.0]


def test_a_lane_without_a_limit_gets_the_usual_one_and_a_connector_that_of_its_lanes(tmp_path: Path) -> None:
    groups = {"1": [straight((0, 0), (50, 0))], "2": [straight((60, 0), (100, 0))]}
    roads = small_roads(groups, [Ways("1", "2", limit_mps=None)], limits={"1": None, "2": 8.0})
    files = converted(roads, tmp_path)
    ids, net = NetworkIds.read(files.ids), read_network_summary(files.network)
    assert net.lanes[ids.pieces["10"][0].sumo_lane].speed_mps == 13.89
    assert net.lanes[ids.pieces["70000"][0].sumo_lane].speed_mps == 8.0
    assert check_map(files, roads).wrong_limits == ()


# --- right of way ------------------------------------------------------------------------------


STOP, YIELD = StopLineKind.STOP_SIGN, StopLineKind.YIELD
FAST = {"12": 19.0, "14": 19.0, "22": 19.0, "24": 19.0}


@pytest.mark.parametrize(
    ("signs", "limits", "expected", "type_"),
    [
        ({}, FAST, {"12 24": "M", "11 23": "m", "12 23": "m"}, "priority"),  # the last one turns across the oncoming
        ({"12": STOP, "14": STOP}, {}, {"12 24": "s", "14 22": "s", "12 21": "s", "11 23": "M"}, "priority_stop"),
        ({"12": YIELD}, {}, {"12 24": "m", "13 21": "M"}, "priority"),
        ({f"1{k}": STOP for k in range(1, 5)}, {}, {"11 22": "w", "12 21": "w", "13 24": "w"}, "allway_stop"),
    ],
)
def test_signs_and_else_the_major_road_tell_who_goes_first(
    signs: dict[str, StopLineKind], limits: dict[str, float], expected: dict[str, str], type_: str, tmp_path: Path
) -> None:
    root = document(converted(crossing(signs=signs, limits=limits), tmp_path))
    found = {
        f"{c.attrib['from']} {c.attrib['to']}": c.attrib["state"]
        for c in root.iterfind("connection")
        if not c.attrib["from"].startswith(":")
    }
    assert {way: found[way] for way in expected} == expected
    assert next(j.get("type") for j in root.iterfind("junction") if j.get("id") == "I900") == type_


def test_who_has_the_right_of_way_without_a_light_need_not_keep_the_junction_clear(tmp_path: Path) -> None:
    """SUMO's cars stop before a junction as soon as the last one beyond brakes; who yields, or has a light, does."""
    lit = document(converted(world("grid"), tmp_path / "lit"))
    signed = document(converted(crossing(limits=FAST), tmp_path / "signed"))
    found = {
        (each.get("state") == "M" and each.get("tl") is None, each.get("keepClear", "1") == "1")
        for root in (lit, signed)
        for each in root.iterfind("connection")
        if not each.attrib["from"].startswith(":")
    }
    assert found == {(True, False), (False, True)}


def test_paths_that_brush_past_each_other_are_told_to_sumo(tmp_path: Path) -> None:
    groups = {
        "1": [straight((-60, 0), (-10, 0))], "2": [straight((10, 0), (60, 0))],
        "3": [straight((60, 1.5), (10, 1.5))], "4": [straight((-10, 1.5), (-60, 1.5))],
    }  # fmt: skip
    root = document(converted(small_roads(groups, [Ways("1", "2"), Ways("3", "4")]), tmp_path))
    told = {
        (c.attrib["from"], f.attrib["from"], float(f.attrib["startPos"]), float(f.attrib["endPos"]))
        for c in root.iterfind("connection")
        for f in c.iterfind("conflict")
    }
    assert told == {("1", "3", 0.0, 20.0), ("3", "1", 0.0, 20.0)}


def test_oncoming_inner_lanes_know_each_other(tmp_path: Path) -> None:
    lines = {"1": [straight((0, -1.75), (80, -1.75))], "2": [straight((80, 1.75), (0, 1.75))]}
    root = document(converted(small_roads(lines), tmp_path))
    pairs = {lane.attrib["id"]: n.attrib["lane"] for lane in root.iterfind("edge/lane") for n in lane.iterfind("neigh")}
    assert pairs == {"1_0": "2_0", "2_0": "1_0"}


# --- bad input ---------------------------------------------------------------------------------


def test_a_map_without_lanes_is_refused(tmp_path: Path) -> None:
    roads = Roads("void", "EPSG:32611", "right", {}, {}, {})
    with pytest.raises(MapError, match="void has no lanes"):
        convert(roads, tmp_path)


def test_without_netconvert_the_way_out_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("interplan_sumo.maps.to_sumo.find_spec", lambda _: None)
    with pytest.raises(MapError, match=r"pip install 'interplan-sumo\[maps\]'"):
        convert(world("crossing"), tmp_path)
    assert not list(tmp_path.iterdir())


def test_what_netconvert_says_is_passed_on() -> None:
    files = {"node-files": "<nodes/>", "edge-files": '<edges><edge id="e" from="a" to="b"/></edges>'}
    with pytest.raises(MapError, match=r"netconvert refused the map: .*a.*"):
        network(files, left_hand=False)


@pytest.mark.parametrize("name", ["crossing", "crossing with lights"])
def test_two_connectors_between_the_same_lanes_leave_one_missing(name: str, tmp_path: Path) -> None:
    roads = world(name)
    twin = replace(next(iter(roads.connectors.values())), id="99999")
    block = roads.roadblocks[twin.roadblock_id]
    blocks = {**roads.roadblocks, block.id: replace(block, lane_ids=(*block.lane_ids, "99999"))}
    doubled = replace(roads, connectors={**roads.connectors, "99999": twin}, roadblocks=blocks)
    report = check_map(converted(doubled, tmp_path), doubled)
    assert report.missing == ("99999",)
    assert not report.ok


# --- traffic -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", few(["gs-merge-lht", "gs-cross", "grid without lights"], 1))
def test_a_minute_of_random_traffic_passes_without_accident(name: str, tmp_path: Path) -> None:
    roads = world(name)
    run = random_traffic(converted(roads, tmp_path), roads, tmp_path / "run", vehicles=40, seed=5)
    assert run.vehicles >= 9
    assert run.mean_speed_mps > 1.0
    assert run.teleports == 0
    assert run.collisions == 0
    assert [o for o in run.overlaps if not o.askew] == []
    assert run.emergency_brakings <= 0.1 * run.vehicles  # some start within sight of a red light


def test_what_netconvert_says_of_names_is_read_whatever_the_encoding_of_the_system() -> None:
    code = r"""
from interplan_sumo.errors import MapError
from interplan_sumo.maps.to_sumo import network
nodes = '<nodes><node id="a" x="0" y="0"/><node id="b" x="100" y="0"/></nodes>'
edges = '<edges><edge id="e" from="a" to="\u0141\xf3d\u017a" numLanes="1" speed="10"/></edges>'
try:
    network({"node-files": nodes, "edge-files": edges}, left_hand=False)
except MapError as error:
    print(ascii(str(error)))
"""
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, env={**os.environ, **ASCII}, capture_output=True, check=False)
    assert rb"to-node '\u0141\xf3d\u017a' is not known" in done.stdout, done.stderr
