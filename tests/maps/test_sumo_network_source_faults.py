"""SUMO networks that cannot be used: one clear line each, whatever is wrong with them."""

from __future__ import annotations

import builtins
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from interplan_sumo.errors import MapError
from interplan_sumo.maps.importers.source import SourceMap
from interplan_sumo.maps.importers.sumo.count import count_sumo_network
from interplan_sumo.maps.importers.sumo.reader import read_sumo_network
from tests.maps.commonroad_files import mutated
from tests.maps.sumo_nets import by_hand, lane, written


def refusal(path: Path) -> str:
    """The one line that reading ends in, without the path."""
    with pytest.raises(MapError) as caught:
        read_sumo_network(path)
    message = str(caught.value)
    assert "\n" not in message
    assert str(path) in message
    return message.replace(str(path), "FILE")


# --- files -------------------------------------------------------------------------------------------


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    assert refusal(tmp_path / "a.net.xml") == "no file at FILE; check the path"
    with pytest.raises(MapError):
        count_sumo_network(tmp_path / "a.net.xml")


@pytest.mark.parametrize("text", ["", "no xml", "<net", "<net><edge></net>"])
def test_a_file_that_is_no_xml(text: str, tmp_path: Path) -> None:
    assert refusal(written(tmp_path, text)).startswith("FILE: the file is damaged (")


def test_a_truncated_archive(tmp_path: Path) -> None:
    (tmp_path / "a.net.xml.gz").write_bytes(b"\x1f\x8b\x08\x00")
    assert refusal(tmp_path / "a.net.xml.gz").startswith("FILE: the file is damaged (")


def test_xml_of_another_format(tmp_path: Path) -> None:
    assert refusal(written(tmp_path, "<routes/>")) == "FILE: its root is <routes>, expected <net>; give such a file"


def test_entities_are_never_expanded(tmp_path: Path) -> None:
    bomb = '<!DOCTYPE n [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;">]><net>&b;</net>'
    path = written(tmp_path, bomb)
    assert refusal(path).startswith("FILE: it defines entities")
    with pytest.raises(MapError):
        count_sumo_network(path)


def test_a_network_without_roads(tmp_path: Path) -> None:
    assert refusal(written(tmp_path, by_hand())) == "FILE: no lane for passenger cars; give a network with roads"


def test_a_network_older_than_connections_names_the_way_out(tmp_path: Path) -> None:
    old = f'<edge id="e">{lane("e_0", "0,0 9,0")}</edge><succ edge="e" lane="e_0" junction="j"/>'
    assert "netconvert -s" in refusal(written(tmp_path, by_hand(old)))


def test_counting_without_sumolib_names_the_way_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name.startswith("sumolib"):
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MapError, match=r"pip install 'interplan-sumo\[maps\]'"):
        count_sumo_network(tmp_path / "a.net.xml")


# --- elements ----------------------------------------------------------------------------------------


def on_edge(*lanes: str) -> str:
    return f'<edge id="e">{"".join(lanes)}</edge>'


GOOD = on_edge(lane("e_0", "0,0 9,0"))
ELEMENTS = {
    "half a point": (on_edge(lane("e_0", "0,0 9")), "FILE: lane 'e_0': '9' in its shape is no point"),
    "no number": (on_edge(lane("e_0", "0,0 9,x")), "FILE: lane 'e_0': shape is 'x', expected a number"),
    "infinite": (on_edge(lane("e_0", "0,0 inf,0")), "FILE: lane 'e_0': shape is 'inf', expected a number"),
    "far away": (
        on_edge(lane("e_0", "0,0 9e7,0")),
        "FILE: lane e_0: a point lies outside the reach of EPSG:32631; look at the georeference",
    ),
    "no width": (
        on_edge(lane("e_0", "0,0 9,0", width="0")),
        "FILE: lane 'e_0': width is 0 m, expected more than 0 and less than 100",
    ),
    "no index": (GOOD.replace('index="0"', 'index="-1"'), "FILE: lane 'e_0': index is '-1', expected a whole number"),
    "no speed": (GOOD.replace('speed="10"', 'speed=""'), "FILE: lane 'e_0': speed is '', expected a number"),
    "two lanes": (
        on_edge(lane("e_0", "0,0 9,0"), lane("e_0", "0,3 9,3", 1)),
        "FILE: lane 'e_0': the id is taken; every lane needs its own",
    ),
    "two edges": (GOOD + GOOD, "FILE: edge 'e': the id is empty or taken; every edge needs its own"),
    "unknown way": (
        GOOD + '<connection from="e" to="e" fromLane="0" toLane="0" via=":x_0_0" dir="t" state="M"/>',
        "FILE: connection e_0 -> e_0: it runs via ':x_0_0', which is no internal lane of the file",
    ),
}


@pytest.mark.parametrize("name", ELEMENTS)
def test_an_element_that_cannot_be_is_named(name: str, tmp_path: Path) -> None:
    content, message = ELEMENTS[name]
    assert refusal(written(tmp_path, by_hand(content))) == message


@pytest.mark.parametrize("offset", ["", "1", "a,b", "nan,0"])
def test_an_offset_that_cannot_be_is_named(offset: str, tmp_path: Path) -> None:
    place = f'<location netOffset="{offset}" projParameter="+proj=utm +zone=32 +datum=WGS84"/>'
    assert "netOffset is" in refusal(written(tmp_path, by_hand(GOOD, location=place)))


def test_ways_that_lead_round_in_internal_lanes_end(tmp_path: Path) -> None:
    text = by_hand(
        GOOD,
        f'<edge id=":j_0" function="internal">{lane(":j_0_0", "9,0 12,0")}</edge>',
        '<connection from="e" to="e" fromLane="0" toLane="0" via=":j_0_0" dir="t" state="M"/>',
        '<connection from=":j_0" to="e" fromLane="0" toLane="0" via=":j_0_0" dir="t" state="M"/>',
    )
    assert list(read_sumo_network(written(tmp_path, text)).lanes) == ["e_0", ":j_0_0"]


# --- anything at all ---------------------------------------------------------------------------------


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


def survive(seeds: range, folder: Path) -> tuple[int, int]:
    """How many damaged files were read and how many refused; anything else raises."""
    read = refused = 0
    text = everything()
    for seed in seeds:
        path = folder / "a.net.xml"
        path.write_bytes(mutated(text, np.random.default_rng(seed)))
        start = time.monotonic()
        for reader in (read_sumo_network, count_sumo_network):
            try:
                found: Any = reader(path)
            except MapError as error:
                found = error
            except Exception as error:
                raise AssertionError(f"seed {seed}, {reader.__name__}: {error!r}") from error
            if isinstance(found, MapError):
                refused += 1
                assert "\n" not in str(found), seed
            else:
                read += 1
            if isinstance(found, SourceMap):
                for one in found.lanes.values():
                    assert np.isfinite(one.left).all(), seed
                    assert np.isfinite(one.right).all(), seed
        assert time.monotonic() - start < 10.0, seed
    return read, refused


def test_the_undamaged_file_is_read(tmp_path: Path) -> None:
    source = read_sumo_network(path := written(tmp_path, everything()))
    assert list(source.lanes) == ["a_0", "a_1", "b_0", ":j_0_0"]
    assert count_sumo_network(path).links == {("a_0", ":j_0_0"), (":j_0_0", "b_0")}


def test_damaged_files_are_read_or_refused_and_nothing_else(tmp_path: Path) -> None:
    read, refused = survive(range(150), tmp_path)
    assert read > 80
    assert refused > 60


@pytest.mark.slow
def test_two_thousand_damaged_files(tmp_path: Path) -> None:
    read, refused = survive(range(1000, 3000), tmp_path)
    assert read > 1000
    assert refused > 1000
