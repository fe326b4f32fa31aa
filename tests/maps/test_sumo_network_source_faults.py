"""SUMO networks that cannot be used: one clear line each, whatever is wrong with them."""

from __future__ import annotations

import builtins
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from interplan_sumo.errors import MapError
from interplan_sumo.maps.importers.sumo.count import count_sumo_network
from interplan_sumo.maps.importers.sumo.reader import read_sumo_network
from tests.maps.damaged import assert_sound, mutated, refusal, survive
from tests.maps.sumo_nets import by_hand, lane, written
from tests.quick import few


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    assert refusal(tmp_path / "a.net.xml", read_sumo_network) == "no file at FILE; check the path"
    with pytest.raises(MapError):
        count_sumo_network(tmp_path / "a.net.xml")


def test_counting_without_sumolib_names_the_way_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name.startswith("sumolib"):
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MapError, match=r"pip install 'interplan-sumo\[maps\]'"):
        count_sumo_network(tmp_path / "a.net.xml")


def on_edge(*lanes: str) -> str:
    return f'<edge id="e">{"".join(lanes)}</edge>'


def placed(offset: str) -> str:
    place = f'<location netOffset="{offset}" projParameter="+proj=utm +zone=32 +datum=WGS84"/>'
    return by_hand(GOOD, location=place)


GOOD = on_edge(lane("e_0", "0,0 9,0"))
ELEMENTS = [
    ("", "no lane for passenger cars; give a network with roads"),
    (on_edge(lane("e_0", "0,0 9")), "lane 'e_0': '9' in its shape is no point"),
    (on_edge(lane("e_0", "0,0 9,x")), "lane 'e_0': shape is 'x', expected a number"),
    (on_edge(lane("e_0", "0,0 inf,0")), "lane 'e_0': shape is 'inf', expected a number"),
    (
        on_edge(lane("e_0", "0,0 9e7,0")),
        "lane e_0: a point lies outside the reach of EPSG:32631; look at the georeference",
    ),
    (
        on_edge(lane("e_0", "0,0 9,0", width="0")),
        "lane 'e_0': width is 0 m, expected more than 0 and less than 100",
    ),
    (GOOD.replace('index="0"', 'index="-1"'), "lane 'e_0': index is '-1', expected a whole number"),
    (GOOD.replace('speed="10"', 'speed=""'), "lane 'e_0': speed is '', expected a number"),
    (
        on_edge(lane("e_0", "0,0 9,0"), lane("e_0", "0,3 9,3", 1)),
        "lane 'e_0': the id is taken; every lane needs its own",
    ),
    (GOOD + GOOD, "edge 'e': the id is empty or taken; every edge needs its own"),
    (
        GOOD + '<connection from="e" to="e" fromLane="0" toLane="0" via=":x_0_0" dir="t" state="M"/>',
        "connection e_0 -> e_0: it runs via ':x_0_0', which is no internal lane of the file",
    ),
]
FILES = [
    *((text, "the file is damaged (") for text in ("", "no xml", "<net", "<net><edge></net>")),
    ("<routes/>", "its root is <routes>, expected <net>; give such a file"),
    (
        '<!DOCTYPE n [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;">]><net>&b;</net>',
        "declares a document type",
    ),
    *((placed(offset), "netOffset is") for offset in ("", "1", "a,b", "nan,0")),
    (by_hand(GOOD + '<succ edge="e" lane="e_0" junction="j"/>'), "netconvert -s"),
    *((by_hand(content), message) for content, message in ELEMENTS),
]


@pytest.mark.parametrize(("text", "message"), FILES, ids=[message for _, message in FILES])
def test_a_network_that_cannot_be_is_named(text: str, message: str, tmp_path: Path) -> None:
    path = written(tmp_path, text)
    assert message in refusal(path, read_sumo_network)
    if text.startswith("<!DOCTYPE"):
        with pytest.raises(MapError):
            count_sumo_network(path)


def test_a_truncated_archive(tmp_path: Path) -> None:
    (tmp_path / "a.net.xml.gz").write_bytes(b"\x1f\x8b\x08\x00")
    assert refusal(tmp_path / "a.net.xml.gz", read_sumo_network).startswith("FILE: the file is damaged (")


def test_ways_that_lead_round_in_internal_lanes_end(tmp_path: Path) -> None:
    text = by_hand(
        GOOD,
        f'<edge id=":j_0" function="internal">{lane(":j_0_0", "9,0 12,0")}</edge>',
        '<connection from="e" to="e" fromLane="0" toLane="0" via=":j_0_0" dir="t" state="M"/>',
        '<connection from=":j_0" to="e" fromLane="0" toLane="0" via=":j_0_0" dir="t" state="M"/>',
    )
    assert list(read_sumo_network(written(tmp_path, text)).lanes) == ["e_0", ":j_0_0"]


def everything() -> str:
    """A network with one of each element that is read."""
    way = '<connection from="{}" to="{}" fromLane="0" toLane="0" {} dir="s" state="m"/>'
    return by_hand(
        f'<edge id=":j_0" function="internal">{lane(":j_0_0", "50,0 52,0 55,1")}</edge>',
        f'<edge id=":j_1" function="internal">{lane(":j_1_0", "55,1 60,3")}</edge>',
        f'<edge id=":j_c" function="crossing" crossingEdges="a">{lane(":j_c_0", "52,-5 52,5", width="4.00")}</edge>',
        f'<edge id=":j_w" function="walkingarea">{lane(":j_w_0", "48,5 52,5 52,9 48,9")}</edge>',
        f'<edge id="a">{lane("a_0", "0,0 20,0 50,0")}{lane("a_1", "0,3.2 20,3.2 50,3.2", 1, width="3.2")}</edge>',
        f'<edge id="b">{lane("b_0", "60,3 90,9")}{lane("b_1", "60,7 90,12", 1, allow="bus")}</edge>',
        '<junction id="j" type="priority" x="55" y="0" incLanes="a_0 a_1" intLanes=":j_0_0" '
        'shape="50,-5 60,-5 60,5 50,5"/>',
        way.format("a", "b", 'via=":j_0_0" tl="j" linkIndex="0"'),
        way.format(":j_0", "b", 'via=":j_1_0"'),
        way.format(":j_1", "b", ""),
        location='<location netOffset="-690000,-5335000" convBoundary="0,0,90,12" origBoundary="11,48,12,49" '
        'projParameter="+proj=utm +zone=32 +datum=WGS84"/>',
    )


def test_the_undamaged_file_is_read(tmp_path: Path) -> None:
    source = read_sumo_network(path := written(tmp_path, everything()))
    assert list(source.lanes) == ["a_0", "a_1", "b_0", ":j_0_0"]
    assert count_sumo_network(path).links == {("a_0", ":j_0_0"), (":j_0_0", "b_0")}


def damage(path: Path, rng: np.random.Generator) -> None:
    path.write_bytes(mutated(everything(), rng))


@pytest.mark.parametrize("seeds", few([30, 500], 1, 1))
def test_damaged_files_are_read_or_refused_and_nothing_else(seeds: int, tmp_path: Path) -> None:
    readers = (read_sumo_network, count_sumo_network)
    read, refused = survive(seeds, tmp_path / "a.net.xml", damage, readers, assert_sound)
    assert read > 0.25
    assert refused > 0.2


def test_a_count_that_fails_on_an_endless_name_is_a_short_line(tmp_path: Path) -> None:
    way = f'<connection from="{"x" * 100_000}" to="a" fromLane="0" toLane="0" dir="s" state="M"/>'
    edge = f'<edge id="a" from="n" to="m">{lane("a_0", "0,0 50,0")}</edge>'
    assert refusal(written(tmp_path, by_hand(edge, way)), count_sumo_network).startswith("FILE: the network cannot be")
