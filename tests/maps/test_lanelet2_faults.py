"""Lanelet2 files that cannot be used, wholly or in part: one clear line each, whatever is wrong with them."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from interplan_sumo.errors import MapError
from interplan_sumo.maps.importers.lanelet2.count import count_lanelet2
from interplan_sumo.maps.importers.lanelet2.reader import read_lanelet2
from interplan_sumo.maps.importers.source import SourceMap
from tests.maps.damaged import assert_sound, mutated, refusal, survive
from tests.maps.lanelet2_files import Encoding, Osm, Point, crossing
from tests.quick import few


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    assert refusal(tmp_path / "map.osm", read_lanelet2).startswith("no file at FILE")
    assert refusal(tmp_path, read_lanelet2).startswith("FILE: the file cannot be read (")


NO_XML = "FILE: the file is damaged ("
BOMB = "FILE: declares a document type or entities, which are refused; save it again without them"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", NO_XML),
        (b"<net/>", "FILE: its root is <net>, expected <osm>; give such a file"),
        (b"\x00" * 500, NO_XML),
        (b"SQLite format 3", NO_XML),
        (b"<?xml version='1.0' encoding='klingon'?><osm/>", NO_XML),
        (b"<osm>\xff\xfe</osm>", NO_XML),
        (b"<osm/>", "FILE: its nodes have neither latitudes and longitudes that vary nor local_x and local_y"),
        (b"<!DOCTYPE osm [<!ENTITY a 'aaaa'><!ENTITY b '&a;&a;&a;&a;'>]><osm>&b;</osm>", BOMB),
        (b"<!DOCTYPE osm [<!ENTITY a SYSTEM 'file:///etc/passwd'>]><osm>&a;</osm>", BOMB),
        (b"<!DOCTYPE osm SYSTEM 'http://localhost/osm.dtd'><osm/>", BOMB),
    ],
)
def test_a_file_of_another_kind(content: bytes, message: str, file: Path) -> None:
    file.write_bytes(content)
    assert refusal(file, read_lanelet2).startswith(message)
    if message == BOMB:
        refusal(file, count_lanelet2)


def test_places_beyond_utm(file: Path) -> None:
    file.write_text(crossing().text().replace("lat='49.", "lat='86."))
    message = "FILE: lies at latitude 86.0, beyond UTM; correct its latitudes"
    assert refusal(file, read_lanelet2) == message


@pytest.mark.parametrize("id_", ["", "twelve", "1.5", "9" * 40])
def test_an_id_that_is_none(id_: str, osm: Osm, file: Path) -> None:
    lane = osm.straight(0.0, 40.0)
    file.write_text(osm.text().replace(f"<relation id='{lane}'", f"<relation id='{id_}'"))
    assert (
        refusal(file, read_lanelet2)
        == f"FILE: <relation> has the id {id_[:30]!r}, expected a whole number; give it one"
    )


@pytest.mark.parametrize("id_", ["-17", "649775045257093980", "-9223372036854775808"])
def test_ids_of_editors_are_kept_to_the_last_digit(id_: str, osm: Osm, file: Path) -> None:
    lane = osm.straight(0.0, 40.0)
    file.write_text(osm.text().replace(f"<relation id='{lane}'", f"<relation id='{id_}'"))
    assert set(read_lanelet2(file).lanes) == {id_} == set(count_lanelet2(file).lane_length_m)


def test_a_file_without_a_lane_for_cars(osm: Osm, file: Path) -> None:
    osm.straight(0.0, 40.0, tags={"subtype": "walkway"})
    assert refusal(osm.write(file), read_lanelet2) == (
        "FILE: holds no lanelet for cars that can be used (1 walkway); check its tags"
    )


A, B, C, D = (0.0, 0.0), (40.0, 0.0), (0.0, -3.0), (40.0, -3.0)


def broken(
    left: Sequence[Point] = (A, B),
    right: Sequence[Point] = (C, D),
    change: Callable[[Osm, list[Any]], object] = lambda _osm, _ways: None,
) -> Osm:
    """One sound lanelet, and another with a fault."""
    osm = Osm()
    osm.straight(0.0, 40.0, 50.0)
    lane = int(osm.lanelet(left, right))
    change(osm, osm.members[lane])
    return osm


def unknown_node(osm: Osm, ways: list[Any]) -> None:
    osm.ways = {(*nodes, 4711) if id_ == ways[0][1] else nodes: id_ for nodes, id_ in osm.ways.items()}


# The fault, its reason, and whether the second count draws the lanelet, as it does where it is there but of no use.
FAULTS = [
    (lambda: broken([A, (20.0, 0.0), (30.0, -5.0), B]), "has boundaries that cross", False),
    (lambda: broken(right=[A, B]), "has boundaries that cross", False),
    (lambda: broken([A, (0.05, 0.0)], [C, (0.05, -3.0)]), "is shorter than 0.1 m", True),
    (lambda: broken(right=[(0.0, -0.2), (40.0, -0.2)]), "is narrower than 0.3 m", True),
    (lambda: broken(right=[(0.0, -120.0), (40.0, -120.0)]), "is wider than 100 m", True),
    (lambda: broken(right=[C]), "has a boundary without length", False),
    (lambda: broken(right=[C, (0.0, -3.0), (0.0, -3.0001)]), "has a boundary without length", False),
    (lambda: broken(change=lambda _, ways: ways.pop()), "names no ways as its right boundary, needs one", False),
    (
        lambda: broken(change=lambda _, ways: ways.append(("way", ways[1][1], "left"))),
        "names 2 ways as its left boundary, needs one",
        False,
    ),
    (
        lambda: broken(change=lambda _, ways: ways.append((*ways.pop()[:1], 4711, "right"))),
        "names a way that the file lacks",
        False,
    ),
    (lambda: broken(change=unknown_node), "names a point that the file lacks or does not place", False),
]


@pytest.mark.parametrize(("fault", "reason", "drawn"), FAULTS)
def test_lanelets_that_cannot_be_used_are_left_out_with_a_reason(
    fault: Callable[[], Osm], reason: str, drawn: bool, file: Path
) -> None:
    source = read_lanelet2(fault().write(file))
    assert len(source.lanes) == 1
    assert [item.reason for item in source.left_out] == [f"lanelet that {reason}"]
    assert len(count_lanelet2(file).lane_length_m) == 1 + drawn


def test_boundaries_that_meet_in_a_point_do_not_cross(osm: Osm, file: Path) -> None:
    lane = osm.lanelet([A, (20.0, 0.0), D], [C, D])
    assert set(read_lanelet2(osm.write(file)).lanes) == {lane} == set(count_lanelet2(file).lane_length_m)


def test_what_is_marked_as_deleted_is_not_there(osm: Osm, file: Path) -> None:
    kept, gone, hidden, torn = (osm.straight(0.0, 40.0, -10.0 * row) for row in range(4))
    text = osm.text().replace(f"<relation id='{gone}'", f"<relation action='delete' id='{gone}'")
    text = text.replace(f"<relation id='{hidden}'", f"<relation visible='false' id='{hidden}'")
    way = osm.members[int(torn)][0][1]
    file.write_text(text.replace(f"<way id='{way}'", f"<way action='delete' id='{way}'"))
    source = read_lanelet2(file)
    assert set(source.lanes) == {kept} == set(count_lanelet2(file).lane_length_m)
    assert [item.id for item in source.left_out] == [torn]


def test_of_two_lanelets_with_one_id_the_first_counts(osm: Osm, file: Path) -> None:
    first, second = osm.straight(0.0, 40.0), osm.straight(0.0, 30.0, -10.0)
    file.write_text(osm.text().replace(f"<relation id='{second}'", f"<relation id='{first}'"))
    source = read_lanelet2(file)
    assert np.ptp(source.lanes[first].left[:, 0]) == pytest.approx(40.0, rel=1e-3)
    assert source.reasons == {"lanelet that has an id that another lanelet has": 1}
    assert count_lanelet2(file).lane_length_m[first] == pytest.approx(40.0, rel=1e-3)


def test_a_node_far_from_the_rest_costs_its_lanelet_only(osm: Osm, file: Path) -> None:
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


def damage(path: Path, rng: np.random.Generator) -> None:
    encodings: tuple[Encoding, ...] = ("degrees", "local", "both")
    path.write_bytes(mutated(crossing().text(encodings[int(rng.integers(3))]), rng))


def read_and_counted(path: Path) -> SourceMap:
    """What can be read can be counted."""
    source = read_lanelet2(path)
    try:
        count_lanelet2(path)
    except MapError as error:
        raise AssertionError("cannot be counted") from error
    return source


@pytest.mark.parametrize("seeds", few([30, 300], 1, 1))
def test_damaged_files_are_read_or_refused_and_nothing_else(seeds: int, file: Path) -> None:
    read, refused = survive(seeds, file, damage, [read_and_counted, count_lanelet2], assert_sound)
    assert read > 0.4
    assert refused > 0.1
