"""CommonRoad files that cannot be used: one clear line each, whatever is wrong with them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from interplan_sumo.errors import MapError
from interplan_sumo.maps.importers.commonroad.count import count_commonroad
from interplan_sumo.maps.importers.commonroad.reader import read_commonroad
from interplan_sumo.recordings.commonroad import read_commonroad_recording
from tests.maps.commonroad_files import lanelet, location, points, rectangle, scenario, sign, state, written
from tests.maps.damaged import assert_sound, mutated, refusal, survive
from tests.quick import few


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    assert refusal(tmp_path / "scenario.xml", read_commonroad) == "no file at FILE; check the path"
    assert refusal(tmp_path, read_commonroad).startswith("FILE: the file cannot be read (")


def test_a_damaged_archive(tmp_path: Path) -> None:
    (tmp_path / "scenario.xml").write_bytes(b"\x1f\x8bno archive")
    assert refusal(tmp_path / "scenario.xml", read_commonroad).startswith("FILE: the file is damaged (")


NESTED = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 10))
ENTITIES = [
    f'<?xml version="1.0"?><!DOCTYPE b [<!ENTITY e0 "ha">{NESTED}]><commonRoad>&e9;</commonRoad>',
    '<?xml version="1.0"?><!DOCTYPE b [<!ENTITY x SYSTEM "file:///etc/hostname">]><commonRoad>&x;</commonRoad>',
]


@pytest.mark.parametrize("text", ENTITIES, ids=["a bomb", "a file outside"])
def test_entities_are_never_expanded(text: str, tmp_path: Path) -> None:
    path = written(tmp_path, text)
    for read in (read_commonroad, read_commonroad_recording):
        assert refusal(path, read).startswith("FILE: declares a document type or entities, which are refused")
    with pytest.raises(MapError):
        count_commonroad(path)


FAR_LINE = f"<stopLine>{points([(0, 0), (5e7, 0)])}</stopLine>"
OWN_ID = "the id is empty or taken; every lanelet needs its own"
FAULTS = [
    *((text, "the file is damaged (") for text in ("", "no xml", "<commonRoad", "<commonRoad><lanelet></commonRoad>")),
    ("<commonRoad>\x00", "the file is damaged ("),
    ("<net><edge/></net>", "its root is <net>, expected <commonRoad>; give such a file"),
    (scenario(), "none of its 0 lanelets is for cars; give a file with a road network"),
    (scenario(lanelet(1) + lanelet(1)), f"lanelet 1: {OWN_ID}"),
    (scenario("<lanelet/>"), f"lanelet without id: {OWN_ID}"),
    (scenario('<lanelet id="a&#10;b"><leftBound><point/></leftBound></lanelet>'), "lanelet a b"),
    (scenario(lanelet(1, (0.0, float("nan")))), "lanelet 1: x of leftBound is 'nan', expected a number"),
    (scenario(lanelet(1).replace("<y>0.0</y>", "")), "lanelet 1: y of leftBound is '', expected a number"),
    (
        scenario(lanelet(1, inner=FAR_LINE)),
        "lanelet 1: stopLine: a point lies outside the reach of EPSG:32631; look at the georeference",
    ),
]


@pytest.mark.parametrize(("text", "message"), FAULTS, ids=[message for _, message in FAULTS])
def test_what_cannot_be_is_named(text: str, message: str, tmp_path: Path) -> None:
    assert refusal(written(tmp_path, text), read_commonroad).startswith(f"FILE: {message}")


def test_an_unknown_version_is_read_with_a_note(tmp_path: Path) -> None:
    source = read_commonroad(written(tmp_path, scenario(lanelet(1), version="2031c")))
    assert any("2031c" in note for note in source.notes)


def test_the_name_is_fit_for_a_folder(tmp_path: Path) -> None:
    assert read_commonroad(written(tmp_path, scenario(lanelet(1), name="../../etc/ x"))).name == "etc-x"
    assert read_commonroad(written(tmp_path, scenario(lanelet(1), name=""))).name == "scenario"


@pytest.mark.parametrize("setting", ["<scaling>0</scaling>", "<scaling>-1</scaling>", "<scaling>x</scaling>"])
def test_a_transformation_that_cannot_be_is_noted(setting: str, tmp_path: Path) -> None:
    place = location("EPSG:32632", (690_000.0, 5_335_000.0)).replace("<scaling>1.0</scaling>", setting)
    source = read_commonroad(written(tmp_path, scenario(place, lanelet(1))))
    assert any("scaling is" in note for note in source.notes)


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


def test_the_undamaged_file_is_read(tmp_path: Path) -> None:
    path = written(tmp_path, everything())
    assert list(read_commonroad(path).lanes) == ["1", "2", "3"]
    assert [track.id for track in read_commonroad_recording(path).tracks] == ["20", "21"]
    assert len(count_commonroad(path).links) == 1


def damage(path: Path, rng: np.random.Generator) -> None:
    path.write_bytes(mutated(everything(), rng))


@pytest.mark.parametrize("seeds", few([30, 500], 1, 1))
def test_damaged_files_are_read_or_refused_and_nothing_else(seeds: int, tmp_path: Path) -> None:
    readers = (read_commonroad, read_commonroad_recording, count_commonroad)
    read, refused = survive(seeds, tmp_path / "scenario.xml", damage, readers, assert_sound)
    assert read > 0.25
    assert refused > 0.2
