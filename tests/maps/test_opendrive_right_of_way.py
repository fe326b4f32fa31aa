"""Controllers and priorities of OpenDRIVE junctions reach the network."""

from __future__ import annotations

from pathlib import Path

import pytest

from interplan_sumo.maps.check import check_map
from interplan_sumo.maps.controls import read_controls
from interplan_sumo.maps.geopackage import read_map
from interplan_sumo.maps.importers.importing import check_source, import_map
from interplan_sumo.maps.importers.opendrive.reader import read_opendrive
from interplan_sumo.maps.importers.source import SourceMap
from tests.maps.opendrive_files import (
    connection,
    geometry,
    lane,
    road,
    section,
    signal,
    to_junction,
    to_road,
    written,
    xodr,
)

IN_TURN = [(20.0, "gr"), (4.0, "yr"), (3.0, "rr"), (20.0, "rg"), (4.0, "ry"), (3.0, "rr")]


def controller(id_: str, *signals: str, more: str = "") -> str:
    inner = "".join(f'<control signalId="{one}" type=""/>' for one in signals)
    return f'<controller id="{id_}" {more}>{inner}</controller>'


def junction(*parts: str) -> str:
    """From road 1 in the west way 13 leads ahead to 3; from road 5 in the south way 53 bends into 3, too."""
    south = geometry("<line/>", 100.0, place=(110, -110, 1.5707963267948966))
    east = geometry("<line/>", 100.0, place=(120, 0, 0))
    bend = geometry('<arc curvature="-0.1"/>', 15.707963267948966, place=(110, -10, 1.5707963267948966))
    way = section(lane(-1, before=(-1,), after=(-1,)))
    lights = {"1": signal("w", 98), "5": signal("s", 98)}

    def street(id_: str, plan: str | None = None, *, ends: bool) -> str:
        links = ("", to_junction("9")) if ends else (to_junction("9"), "")
        inner = f"<signals>{lights[id_]}</signals>" if id_ in lights else ""
        return road(id_, section(lane(-1)), plan=plan, links=links, inner=inner)

    def through(id_: str, plan: str, before: str) -> str:
        return road(id_, way, plan=plan, head='junction="9"', links=(to_road(before, "end"), to_road("3")))

    return xodr(
        street("1", ends=True),
        street("5", south, ends=True),
        street("3", east, ends=False),
        through("13", geometry("<line/>", 20.0, place=(100, 0, 0)), "1"),
        through("53", bend, "5"),
        *(part for part in parts if part.startswith("<controller")),
        f'<junction id="9">{connection("1", "13", (-1, -1))}{connection("5", "53", (-1, -1))}'
        + "".join(part for part in parts if not part.startswith("<controller"))
        + "</junction>",
    )


def read(folder: Path, *parts: str) -> SourceMap:
    return read_opendrive(written(folder, junction(*parts)))


@pytest.mark.parametrize(
    ("parts", "first"),
    [
        ((controller("a", "w"), controller("b", "s")), "w"),
        ((controller("a", "w", more='sequence="2"'), controller("b", "s", more='sequence="1"')), "s"),
        ((controller("a", "w"), controller("b", "s"), '<controller id="b" sequence="0"/>'), "s"),
    ],
    ids=["file", "sequence of the controllers", "sequence in the junction"],
)
def test_controllers_of_a_junction_are_green_in_turn_in_their_order(
    parts: tuple[str, ...], first: str, tmp_path: Path
) -> None:
    inside = [part.replace("<controller", " <controller") if part.endswith('"0"/>') else part for part in parts]
    source = read(tmp_path, *inside)
    (signal_,) = source.signals
    (program,) = signal_.programs
    turned = [state if first == "w" else state[::-1] for _, state in IN_TURN]
    assert signal_.lights == ("w", "s")
    assert [(phase.duration_s, phase.state) for phase in program.phases] == [
        (seconds, state) for (seconds, _), state in zip(IN_TURN, turned, strict=True)
    ]
    assert any("At 1 junctions, such as 9, each controller has 20 s of green in turn" in note for note in source.notes)


@pytest.mark.parametrize("parts", [(controller("a", "w", "s"),), (controller("a", "w"),)], ids=["one", "not all"])
def test_a_single_controller_or_lights_without_one_are_noted(parts: tuple[str, ...], tmp_path: Path) -> None:
    source = read(tmp_path, *parts)
    assert source.signals == ()
    assert any("1 junctions, such as 9, have lights without a controller" in note for note in source.notes)


def test_without_controllers_nothing_is_said_of_them(tmp_path: Path) -> None:
    source = read(tmp_path)
    assert (source.signals, source.junctions) == ((), ())
    assert not any("controller" in note or "priorit" in note for note in source.notes)


@pytest.mark.parametrize(("high", "low"), [("13", "53"), ("53", "13"), ("5", "1")])
def test_priorities_say_who_yields(high: str, low: str, tmp_path: Path) -> None:
    """Of connecting roads, or of the roads from which these come; against what geometry would say, too."""
    (found,) = read(tmp_path, f'<priority high="{high}" low="{low}"/>').junctions
    ((late, first),) = found.yields
    ways = [way.lanes for way in found.ways]
    assert (ways[first], ways[late]) == ((("13/0/-1",), ("53/0/-1",)) if high == "13" else (("53/0/-1",), ("13/0/-1",)))


def test_priorities_that_no_car_meets_or_that_contradict_each_other_are_noted(tmp_path: Path) -> None:
    pair = '<priority high="13" low="53"/><priority high="53" low="13"/>'
    source = read(tmp_path, pair, '<priority high="13"/>', '<priority high="77" low="13"/>')
    assert source.junctions == ()
    assert any("4 priorities of junctions name roads without lanes for cars" in note for note in source.notes)


@pytest.mark.parametrize("high", ["13", "53"])
def test_the_network_keeps_controllers_and_priorities(high: str, tmp_path: Path) -> None:
    low = "53" if high == "13" else "13"
    lit = (controller("a", "w"), controller("b", "s"))
    for parts in ((f'<priority high="{high}" low="{low}"/>',), (f'<priority high="{high}" low="{low}"/>', *lit)):
        file = written(tmp_path, junction(*parts))
        files, record = import_map(file, "opendrive", tmp_path / "map", overwrite=True)
        roads = read_map(files.gpkg, files.name)
        assert check_map(files, roads).problems == ()
        report = check_source(files, roads, record, file)
        assert report.problems == ()
        assert report.who_yields.map == report.who_yields.file == 1
        assert report.signal_phases.map == report.signal_phases.file == (6 if len(parts) > 1 else 0)
        # Who has green alone yields to nobody.
        letters = {c for each in read_controls(files.folder).signals.values() for p in each[0].phases for c in p.state}
        assert letters <= set("Gyr")
