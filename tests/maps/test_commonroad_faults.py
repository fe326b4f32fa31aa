"""CommonRoad files that cannot be used: one clear line each, whatever is wrong with them."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from interplan_sumo.errors import InputError, MapError
from interplan_sumo.maps.importers.commonroad.count import count_commonroad
from interplan_sumo.maps.importers.commonroad.reader import read_commonroad
from interplan_sumo.maps.importers.source import SourceMap
from interplan_sumo.recordings.commonroad import read_commonroad_recording
from tests.maps.commonroad_files import (
    lanelet,
    location,
    mutated,
    points,
    rectangle,
    scenario,
    sign,
    state,
    written,
)


def refusal(path: Path, read: Callable[[Path], Any] = read_commonroad) -> str:
    """The one line that reading ends in, without the path."""
    with pytest.raises(MapError) as caught:
        read(path)
    message = str(caught.value)
    assert "\n" not in message
    assert str(path) in message
    return message.replace(str(path), "FILE")


# --- files -------------------------------------------------------------------------------------------


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    assert refusal(tmp_path / "scenario.xml") == "no file at FILE; check the path"
    assert refusal(tmp_path).startswith("FILE: the file cannot be read (")


@pytest.mark.parametrize(
    "text", ["", "no xml", "<commonRoad", "<commonRoad><lanelet></commonRoad>", "<commonRoad>\x00"]
)
def test_a_file_that_is_no_xml(text: str, tmp_path: Path) -> None:
    assert refusal(written(tmp_path, text)).startswith("FILE: the file is damaged (")


def test_a_damaged_archive(tmp_path: Path) -> None:
    (tmp_path / "scenario.xml").write_bytes(b"\x1f\x8bno archive")
    assert refusal(tmp_path / "scenario.xml").startswith("FILE: the file is damaged (")


def test_xml_of_another_format(tmp_path: Path) -> None:
    message = refusal(written(tmp_path, "<net><edge/></net>"))
    assert message == "FILE: its root is <net>, expected <commonRoad>; give such a file"


@pytest.mark.parametrize("read", [read_commonroad, read_commonroad_recording])
def test_entities_are_never_expanded(read: Callable[[Path], Any], tmp_path: Path) -> None:
    nested = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 10))
    bomb = f'<?xml version="1.0"?><!DOCTYPE b [<!ENTITY e0 "ha">{nested}]><commonRoad>&e9;</commonRoad>'
    path = written(tmp_path, bomb)
    assert refusal(path, read).startswith("FILE: it defines entities")
    with pytest.raises(MapError):
        count_commonroad(path)


def test_a_file_outside_is_never_read(tmp_path: Path) -> None:
    outside = (
        '<?xml version="1.0"?><!DOCTYPE b [<!ENTITY x SYSTEM "file:///etc/hostname">]><commonRoad>&x;</commonRoad>'
    )
    assert refusal(written(tmp_path, outside)).startswith("FILE: it defines entities")


def test_a_file_without_roads(tmp_path: Path) -> None:
    message = refusal(written(tmp_path, scenario()))
    assert message == "FILE: none of its 0 lanelets is for cars; give a file with a road network"


def test_an_unknown_version_is_read_with_a_note(tmp_path: Path) -> None:
    source = read_commonroad(written(tmp_path, scenario(lanelet(1), version="2031c")))
    assert any("2031c" in note for note in source.notes)


def test_the_name_is_fit_for_a_folder(tmp_path: Path) -> None:
    assert read_commonroad(written(tmp_path, scenario(lanelet(1), name="../../etc/ x"))).name == "etc-x"
    assert read_commonroad(written(tmp_path, scenario(lanelet(1), name=""))).name == "scenario"


# --- elements ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lanelets", "message"),
    [
        (lanelet(1) + lanelet(1), "FILE: lanelet 1: the id is empty or taken; every lanelet needs its own"),
        ("<lanelet/>", "FILE: lanelet without id: the id is empty or taken; every lanelet needs its own"),
        (lanelet(1, (0.0, float("nan"))), "FILE: lanelet 1: x of leftBound is 'nan', expected a number"),
        (lanelet(1).replace("<y>0.0</y>", ""), "FILE: lanelet 1: y of leftBound is '', expected a number"),
        (
            lanelet(1, inner=f"<stopLine>{points([(0, 0), (5e7, 0)])}</stopLine>"),
            "FILE: lanelet 1: stopLine: a point lies outside the reach of EPSG:32631; look at the georeference",
        ),
    ],
)
def test_an_element_that_cannot_be_is_named(lanelets: str, message: str, tmp_path: Path) -> None:
    assert refusal(written(tmp_path, scenario(lanelets))) == message


@pytest.mark.parametrize("setting", ["<scaling>0</scaling>", "<scaling>-1</scaling>", "<scaling>x</scaling>"])
def test_a_transformation_that_cannot_be_is_noted(setting: str, tmp_path: Path) -> None:
    place = location("EPSG:32632", (690_000.0, 5_335_000.0)).replace("<scaling>1.0</scaling>", setting)
    source = read_commonroad(written(tmp_path, scenario(place, lanelet(1))))
    assert any("scaling is" in note for note in source.notes)


def test_a_message_stays_on_one_line_whatever_the_file_names(tmp_path: Path) -> None:
    assert "lanelet a b" in refusal(
        written(tmp_path, scenario('<lanelet id="a&#10;b"><leftBound><point/></leftBound></lanelet>'))
    )


# --- anything at all ---------------------------------------------------------------------------------


def everything() -> str:
    """A scenario with one of each element that is read."""
    inner = "<laneletType>urban</laneletType><userOneWay>car</userOneWay>"
    inner += '<trafficSignRef ref="8"/><trafficLightRef ref="70"/>'
    stop = f'<stopLine>{points([(48, 0), (48, -3.5)])}<trafficLightRef ref="70"/></stopLine>'
    body = f"<type>car</type>{rectangle(inner='<orientation>0.0</orientation><center><x>1.0</x><y>0.0</y></center>')}"
    moves = "".join(state(step, 1.0 * step, -1.7) for step in range(1, 6))
    dynamic = f"{body}{state(0, 0.0, -1.7, tag='initialState')}<trajectory>{moves}</trajectory>"
    incoming = '<incomingLanelet ref="1"/><successorsLeft ref="2"/>'
    corners = f"<shape><polygon>{points([(-1, -1), (3, -1), (3, 1), (-1, 1)])}</polygon></shape>"
    return scenario(
        location("EPSG:32632", (690_000.0, 5_335_000.0)),
        lanelet(1, inner=stop + inner + '<adjacentRight ref="3" drivingDir="same"/>', after=[2]),
        lanelet(2, (50.0, 80.0), inner="<speedLimit>13.9</speedLimit>", before=[1], after=[9]),
        lanelet(3, y=-3.5, inner='<adjacentLeft ref="1" drivingDir="same"/>'),
        lanelet(
            4, y=-9.0, inner="<laneletType>crosswalk</laneletType><userBidirectional>pedestrian</userBidirectional>"
        ),
        sign(8, "274", "8.3"),
        '<trafficLight id="70"><active>true</active></trafficLight>',
        f'<intersection id="90"><incoming id="91">{incoming}</incoming></intersection>',
        f'<dynamicObstacle id="20">{dynamic}</dynamicObstacle>',
        f'<staticObstacle id="21"><type>car</type>{corners}{state(0, 20, -9, tag="initialState")}</staticObstacle>',
        f'<planningProblem id="99">{state(0, 5.0, -1.7, tag="initialState")}</planningProblem>',
    )


def survive(seeds: range, folder: Path) -> tuple[int, int]:
    """How many damaged files were read and how many refused; anything else raises."""
    read = refused = 0
    text = everything()
    for seed in seeds:
        path = folder / "scenario.xml"
        path.write_bytes(mutated(text, np.random.default_rng(seed)))
        start = time.monotonic()
        for reader in (read_commonroad, read_commonroad_recording, count_commonroad):
            try:
                found: Any = reader(path)
            except InputError as error:
                found = error
            except Exception as error:
                raise AssertionError(f"seed {seed}, {reader.__name__}: {error!r}") from error
            if isinstance(found, InputError):
                refused += 1
                assert "\n" not in str(found), seed
            else:
                read += 1
            if isinstance(found, SourceMap):
                assert all(np.isfinite(lane.left).all() for lane in found.lanes.values()), seed
        assert time.monotonic() - start < 10.0, seed
    return read, refused


def test_the_undamaged_file_is_read(tmp_path: Path) -> None:
    path = written(tmp_path, everything())
    assert list(read_commonroad(path).lanes) == ["1", "2", "3"]
    assert [track.id for track in read_commonroad_recording(path).tracks] == ["20", "21"]
    assert len(count_commonroad(path).links) == 1


def test_damaged_files_are_read_or_refused_and_nothing_else(tmp_path: Path) -> None:
    read, refused = survive(range(150), tmp_path)
    assert read > 100
    assert refused > 100


@pytest.mark.slow
def test_two_thousand_damaged_files(tmp_path: Path) -> None:
    read, refused = survive(range(1000, 3000), tmp_path)
    assert read > 1500
    assert refused > 1500
