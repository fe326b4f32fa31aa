"""Lanelet2 files that cannot be used, wholly or in part: one clear line each, whatever is wrong with them."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from interplan_sumo.errors import MapError
from interplan_sumo.maps.importers.lanelet2.count import count_lanelet2
from interplan_sumo.maps.importers.lanelet2.reader import read_lanelet2
from interplan_sumo.maps.importers.source import SourceCount, SourceMap
from tests.maps.lanelet2_files import Encoding, Osm, crossing, mutate


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "map.osm"


def refusal(path: Path, read: Callable[[Path], object] = read_lanelet2) -> str:
    """The one line that reading ends in, without the path."""
    with pytest.raises(MapError) as caught:
        read(path)
    message = str(caught.value)
    assert "\n" not in message
    assert str(path) in message
    return message.replace(str(path), "FILE")


# --- files -----------------------------------------------------------------------------------------------


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    assert refusal(tmp_path / "map.osm").startswith("no map file at FILE")
    assert refusal(tmp_path).startswith("no map file at FILE")


def test_an_empty_file(file: Path) -> None:
    file.touch()
    assert refusal(file) == "FILE: the file is empty; copy or download it again"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"<net/>", "FILE: not an OSM file (its outermost element is <net>); expected <osm>"),
        (b"\x00" * 500, "FILE: not well-formed XML ("),
        (b"SQLite format 3", "FILE: not well-formed XML ("),
        (b"<?xml version='1.0' encoding='klingon'?><osm/>", "FILE: the file cannot be read ("),
        (b"<osm>\xff\xfe</osm>", "FILE: not well-formed XML ("),
        (b"<osm/>", "FILE: its nodes have neither latitudes and longitudes that vary nor local_x and local_y"),
    ],
)
def test_a_file_of_another_kind(content: bytes, message: str, file: Path) -> None:
    file.write_bytes(content)
    assert refusal(file).startswith(message)


@pytest.mark.parametrize("share", [0.001, 0.3, 0.9, 0.999])
def test_a_truncated_file(share: float, file: Path) -> None:
    content = crossing().text()
    file.write_text(content[: int(len(content) * share)])
    assert refusal(file).startswith("FILE: not well-formed XML (")


BOMBS = {
    "entities": "<!DOCTYPE osm [<!ENTITY a 'aaaa'><!ENTITY b '&a;&a;&a;&a;'>]><osm>&b;</osm>",
    "an external entity": "<!DOCTYPE osm [<!ENTITY a SYSTEM 'file:///etc/passwd'>]><osm>&a;</osm>",
    "a document type": "<!DOCTYPE osm SYSTEM 'http://localhost/osm.dtd'><osm/>",
}


@pytest.mark.parametrize("name", BOMBS)
def test_entities_and_document_types_are_refused(name: str, file: Path) -> None:
    file.write_text(BOMBS[name])
    assert refusal(file) == "FILE: declares a document type or entities, which are refused; save it again without them"
    refusal(file, count_lanelet2)


def test_places_beyond_utm(file: Path) -> None:
    file.write_text(crossing().text().replace("lat='49.", "lat='86."))
    assert refusal(file) == "FILE: lies at latitude 86.0, beyond UTM; correct its latitudes"


@pytest.mark.parametrize("id_", ["", "twelve", "1.5", "9" * 40])
def test_an_id_that_is_none(id_: str, file: Path) -> None:
    osm = Osm()
    lane = osm.straight(0.0, 40.0)
    file.write_text(osm.text().replace(f"<relation id='{lane}'", f"<relation id='{id_}'"))
    assert refusal(file) == f"FILE: <relation> has the id {id_[:30]!r}, expected a whole number; give it one"


@pytest.mark.parametrize("id_", ["-17", "649775045257093980", "-9223372036854775808"])
def test_ids_of_editors_are_kept_to_the_last_digit(id_: str, file: Path) -> None:
    osm = Osm()
    lane = osm.straight(0.0, 40.0)
    file.write_text(osm.text().replace(f"<relation id='{lane}'", f"<relation id='{id_}'"))
    assert set(read_lanelet2(file).lanes) == {id_} == set(count_lanelet2(file).lane_length_m)


def test_a_file_without_a_lane_for_cars(file: Path) -> None:
    osm = Osm()
    osm.straight(0.0, 40.0, tags={"subtype": "walkway"})
    assert refusal(osm.write(file)) == ("FILE: holds no lanelet for cars that can be used (1 walkway); check its tags")


# --- lanelets --------------------------------------------------------------------------------------------

A, B, C, D = (0.0, 0.0), (40.0, 0.0), (0.0, -3.0), (40.0, -3.0)


def broken(change: str) -> Osm:
    """One sound lanelet, and another with a fault."""
    osm = Osm()
    osm.straight(0.0, 40.0, 50.0)
    left, right = [A, B], [C, D]
    if change == "crossing":
        left, right = [A, (20.0, 0.0), (30.0, -5.0), B], [C, D]
    elif change == "one line":
        right = left
    elif change == "short":
        left, right = [A, (0.05, 0.0)], [C, (0.05, -3.0)]
    elif change == "narrow":
        left, right = [A, B], [(0.0, -0.2), (40.0, -0.2)]
    elif change == "wide":
        left, right = [A, B], [(0.0, -120.0), (40.0, -120.0)]
    elif change == "one node":
        right = [C]
    elif change == "one place":
        right = [C, (0.0, -3.0), (0.0, -3.0001)]
    lane = int(osm.lanelet(left, right))
    ways = osm.members[lane]
    if change == "no right":
        del ways[1]
    elif change == "two lefts":
        ways.append(("way", ways[1][1], "left"))
    elif change == "unknown way":
        ways[1] = ("way", 4711, "right")
    elif change == "unknown node":
        osm.ways = {(*nodes, 4711) if id_ == ways[0][1] else nodes: id_ for nodes, id_ in osm.ways.items()}
    return osm


FAULTS = {
    "crossing": "lanelet that has boundaries that cross",
    "one line": "lanelet that has boundaries that cross",
    "short": "lanelet that is shorter than 0.1 m",
    "narrow": "lanelet that is narrower than 0.3 m",
    "wide": "lanelet that is wider than 100 m",
    "one node": "lanelet that has a boundary without length",
    "one place": "lanelet that has a boundary without length",
    "no right": "lanelet that names no ways as its right boundary, needs one",
    "two lefts": "lanelet that names 2 ways as its left boundary, needs one",
    "unknown way": "lanelet that names a way that the file lacks",
    "unknown node": "lanelet that names a point that the file lacks or does not place",
}


@pytest.mark.parametrize("change", FAULTS)
def test_lanelets_that_cannot_be_used_are_left_out_with_a_reason(change: str, file: Path) -> None:
    source = read_lanelet2(broken(change).write(file))
    assert len(source.lanes) == 1
    assert [item.reason for item in source.left_out] == [FAULTS[change]]
    drawn = change in ("short", "narrow", "wide")  # the count contradicts where a lane is there but of no use
    assert len(count_lanelet2(file).lane_length_m) == 1 + drawn


def test_boundaries_that_meet_in_a_point_do_not_cross(file: Path) -> None:
    osm = Osm()
    lane = osm.lanelet([A, (20.0, 0.0), D], [C, D])
    assert set(read_lanelet2(osm.write(file)).lanes) == {lane} == set(count_lanelet2(file).lane_length_m)


def test_what_is_marked_as_deleted_is_not_there(file: Path) -> None:
    osm = Osm()
    kept, gone, hidden, torn = (osm.straight(0.0, 40.0, -10.0 * row) for row in range(4))
    text = osm.text().replace(f"<relation id='{gone}'", f"<relation action='delete' id='{gone}'")
    text = text.replace(f"<relation id='{hidden}'", f"<relation visible='false' id='{hidden}'")
    way = osm.members[int(torn)][0][1]
    file.write_text(text.replace(f"<way id='{way}'", f"<way action='delete' id='{way}'"))
    source = read_lanelet2(file)
    assert set(source.lanes) == {kept} == set(count_lanelet2(file).lane_length_m)
    assert [item.id for item in source.left_out] == [torn]


def test_of_two_lanelets_with_one_id_the_first_counts(file: Path) -> None:
    osm = Osm()
    first, second = osm.straight(0.0, 40.0), osm.straight(0.0, 30.0, -10.0)
    file.write_text(osm.text().replace(f"<relation id='{second}'", f"<relation id='{first}'"))
    source = read_lanelet2(file)
    assert np.ptp(source.lanes[first].left[:, 0]) == pytest.approx(40.0, rel=1e-3)
    assert source.reasons == {"lanelet that has an id that another lanelet has": 1}
    assert count_lanelet2(file).lane_length_m[first] == pytest.approx(40.0, rel=1e-3)


def test_a_node_far_from_the_rest_costs_its_lanelet_only(file: Path) -> None:
    osm = Osm()
    kept, lost = osm.straight(0.0, 40.0), osm.straight(0.0, 40.0, -10.0)
    node = osm.nodes[(40.0, -10.0)]
    file.write_text(re.sub(f"<node id='{node}' lat='[^']*'", f"<node id='{node}' lat='-33.0'", osm.text()))
    source = read_lanelet2(file)
    assert set(source.lanes) == {kept}
    assert [item.id for item in source.left_out] == [lost]


def test_stop_lines_that_cannot_be_drawn_are_told(file: Path) -> None:
    osm = crossing()
    line = osm.way((0.0, 0.0), type="stop_line")
    source = read_lanelet2(osm.write(file))
    assert f"1 stop lines cannot be used, such as {line}, which has no length." in source.notes
    assert str(line) not in {stop.id for stop in source.stop_lines}


# --- anything at all -------------------------------------------------------------------------------------


def assert_sound(source: SourceMap) -> None:
    for lane in source.lanes.values():
        assert min(len(lane.left), len(lane.right)) >= 2
        assert np.isfinite(lane.left).all()
        assert np.isfinite(lane.right).all()
        near = {*lane.successors, *lane.predecessors, lane.left_neighbour, lane.right_neighbour} - {None}
        assert near <= source.lanes.keys()
        assert all(lane.id in source.lanes[id_].predecessors for id_ in lane.successors)
        if lane.left_neighbour is not None:
            assert source.lanes[lane.left_neighbour].right_neighbour == lane.id
    assert all(len(line.points) >= 2 and set(line.lane_ids) <= source.lanes.keys() for line in source.stop_lines)
    areas = (*source.crosswalks, *source.walkways, *source.carparks, *source.drivable)
    assert all(area.is_valid and area.area > 0.0 for area in areas)


def survive(seeds: range, file: Path) -> tuple[int, int]:
    """How many damaged files were read and how many refused; anything else raises."""
    read = refused = 0
    encodings: tuple[Encoding, ...] = ("degrees", "local", "both")
    for seed in seeds:
        generator = np.random.default_rng(seed)
        text = crossing().text(encodings[seed % 3])
        how = f"seed {seed}"
        for _ in range(int(generator.integers(1, 4))):
            text, damage = mutate(text, generator)
            how += f", {damage}"
        file.write_text(text, encoding="utf-8")
        start = time.monotonic()
        try:
            found: SourceMap | MapError = read_lanelet2(file)
        except MapError as error:
            found = error
        except Exception as error:
            raise AssertionError(f"{how}: {error!r}") from error
        try:
            counted: SourceCount | MapError = count_lanelet2(file)
        except MapError as error:
            counted = error
        except Exception as error:
            raise AssertionError(f"{how}: counting: {error!r}") from error
        assert time.monotonic() - start < 5.0, how
        if isinstance(found, SourceMap):
            read += 1
            assert_sound(found)
            assert isinstance(counted, SourceCount), how
        else:
            refused += 1
            assert "\n" not in str(found), how
    return read, refused


def test_damaged_files_are_read_or_refused_and_nothing_else(file: Path) -> None:
    read, refused = survive(range(150), file)
    assert read > 60
    assert refused > 15


@pytest.mark.slow
def test_a_thousand_damaged_files(file: Path) -> None:
    read, refused = survive(range(1000, 2000), file)
    assert read > 400
    assert refused > 100
