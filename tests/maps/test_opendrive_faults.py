"""OpenDRIVE files that cannot be used: one clear line each, and what is left of those with a bad road."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from interplan_sumo.maps.importers.opendrive.reader import read_opendrive
from tests.maps.damaged import assert_sound, mutated, refusal, survive
from tests.maps.opendrive_files import crossing, cubic, geometry, lane, road, section, signal, written, xodr
from tests.quick import few
from tests.realdata import real


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    assert refusal(tmp_path / "town.xodr", read_opendrive) == "no file at FILE; check the path"


NO_CARS = "holds no lane for cars ("
FAULTS = [
    ("", "the file is damaged ("),
    ("<OpenDRIVE><road>", "the file is damaged ("),
    ("<osm/>", "its root is <osm>, expected <OpenDRIVE>; give such a file"),
    ('<?xml version="1.0"?><!DOCTYPE b [<!ENTITY e "ha">]><OpenDRIVE>&e;</OpenDRIVE>', "declares a document type"),
    (xodr(), "the file holds no road; give one with a road network"),
    (xodr(road("1", section(lane(-1, "sidewalk")))), NO_CARS + "none of its lanes is for cars)"),
    (xodr(road("1", plan="")), "its <planView> has no geometry with a length"),
    (xodr(road("1", plan=geometry(length=float("nan")))), "length of <geometry> is 'nan', expected a number"),
    (xodr(road("1", plan=geometry("<loop/>"))), "a <geometry> has no shape that is known"),
    (xodr(road("1", plan=geometry('<arc curvature="50"/>'))), "a curvature of 50 winds up too tightly to be a road"),
    (xodr(road("1", plan=geometry(length=1e8))), "it is longer than 100 km"),
    (xodr(road("1", section(lane(-1), lane(-1)))), "a lane on its right has the id -1"),
    (xodr(road("1", section(lane(-1, width=[(0, 1e300)])))), "a of <width> is '1e+300', expected a number"),
]


@pytest.mark.parametrize(("text", "said"), FAULTS)
def test_what_cannot_be_used_is_one_clear_line(text: str, said: str, tmp_path: Path) -> None:
    assert said in refusal(written(tmp_path, text), read_opendrive)


def test_a_bad_road_is_left_out_and_told_and_the_others_stay(tmp_path: Path) -> None:
    bad = [road("2", plan=""), road("3", plan=geometry('<arc curvature="nan"/>')), road("1")]
    source = read_opendrive(written(tmp_path, xodr(road("1"), *bad)))
    assert set(source.lanes) == {"1/0/-1"}
    assert {item.id: item.reason for item in source.left_out} == {
        "2": "road that cannot be read: its <planView> has no geometry with a length",
        "3": "road that cannot be read: curvature of <arc> is 'nan', expected a number",
        "1 (again)": "road with the id of another",
    }


def everything() -> str:
    """A file with one of each element that is read."""
    corners = "".join(f'<cornerRoad s="{s}" t="{t}"/>' for s, t in ((50, -4), (53, -4), (53, 4)))
    crosswalk = f'<object id="1" type="crosswalk" s="50" t="0"><outline>{corners}</outline></object>'
    line = signal("l", 99, "294", 'dynamic="no" orientation="+"')
    inner = f"<objects>{crosswalk}</objects><signals>{signal('s', 98)}{line}</signals>"
    inner += '<type s="0" type="town"><speed max="30" unit="mph"/></type>'
    bends = geometry('<spiral curvStart="0" curvEnd="0.02"/>', 40.0, place=(0, 99, 0))
    bends += geometry(
        '<paramPoly3 aU="0" bU="30" cU="1" dU="0" aV="0" bV="0" cV="5" dV="0"/>', 31.0, 40.0, (39, 104, 0.4)
    )
    widths = [(0, 0.0, 0.1), (35, 3.5)]
    offsets = cubic("laneOffset", "s", (20, 0.0, 0.01))
    header = '<header><geoReference>+proj=utm +zone=32</geoReference><offset x="692000" y="5337000"/></header>'
    return xodr(
        crossing(west=inner),
        road("7", section(lane(-1), lane(-2, width=widths), lane(-3, "sidewalk")), plan=bends, offsets=offsets),
        header=header,
    )


def test_the_undamaged_file_is_read(tmp_path: Path) -> None:
    source = read_opendrive(written(tmp_path, everything()))
    assert len(source.lanes) == 11
    assert (len(source.crosswalks), len(source.stop_lines), len(source.walkways)) == (1, 1, 2)
    assert_sound(source)


@pytest.mark.parametrize("seeds", few([30, 1000], 1, 1))
def test_damaged_files_are_read_or_refused_and_nothing_else(seeds: int, tmp_path: Path) -> None:
    text = everything()

    def damage(path: Path, chance: np.random.Generator) -> None:
        path.write_bytes(mutated(text, chance))

    read, refused = survive(seeds, tmp_path / "town.xodr", damage, [read_opendrive], assert_sound)
    assert read > 0.4
    assert refused > 0.1


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["e6mini-lht.xodr", "fabriksgatan_traffic_lights.xodr"])
def test_damaged_real_files_are_read_or_refused_and_nothing_else(tmp_path: Path, name: str) -> None:
    text = real("opendrive", name).read_text(encoding="utf-8")

    def damage(path: Path, chance: np.random.Generator) -> None:
        path.write_bytes(mutated(text, chance))

    read, _ = survive(60, tmp_path / "town.xodr", damage, [read_opendrive], assert_sound)
    assert read > 0.4
