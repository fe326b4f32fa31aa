"""Cycles of CommonRoad's lights become programs that SUMO runs, one controller an intersection."""

from __future__ import annotations

from pathlib import Path

import pytest

from interplan_sumo.maps.check import check_map
from interplan_sumo.maps.controls import read_controls
from interplan_sumo.maps.geopackage import read_map
from interplan_sumo.maps.importers.commonroad.reader import read_commonroad
from interplan_sumo.maps.importers.importing import check_source, import_map
from interplan_sumo.maps.importers.source import SourceMap
from tests.maps.commonroad_files import scenario, written

GREEN_FIRST = (("green", 100), ("yellow", 30), ("red", 120))
RED_FIRST = (("red", 130), ("redYellow", 10), ("green", 80), ("yellow", 30))


def light(id_: int, *colours: tuple[str, float | str], offset: int = 0, direction: str = "all") -> str:
    cycle = "".join(
        f"<cycleElement><duration>{steps}</duration><color>{colour}</color></cycleElement>" for colour, steps in colours
    )
    inner = f"<cycle>{cycle}<timeOffset>{offset}</timeOffset></cycle>" if colours else ""
    return f'<trafficLight id="{id_}">{inner}<direction>{direction}</direction></trafficLight>'


def crossing(*lights: str, first: str = "70", step_s: str = "0.1") -> str:
    """Lanelet 1 leads to the east over 2 to 3, and over 4 to the north to 5; 6 leads to the north over 7 to 5."""

    def lit(*ids: str) -> str:
        return "".join(f'<trafficLightRef ref="{id_}"/>' for id_ in ids)

    def lane(id_: int, left: str, right: str, links: str, inner: str = "") -> str:
        def bound(tag: str, text: str) -> str:
            pairs = (pair.split(",") for pair in text.split())
            return f"<{tag}>" + "".join(f"<point><x>{x}</x><y>{y}</y></point>" for x, y in pairs) + f"</{tag}>"

        return f'<lanelet id="{id_}">{bound("leftBound", left)}{bound("rightBound", right)}{links}{inner}</lanelet>'

    def to(*ids: int) -> str:
        return "".join(f'<successor ref="{id_}"/>' for id_ in ids)

    parts = (
        lane(1, "0,0 50,0", "0,-3.5 50,-3.5", to(2, 4), lit(*first.split())),
        lane(2, "50,0 75,0", "50,-3.5 75,-3.5", to(3)),
        lane(3, "75,0 125,0", "75,-3.5 125,-3.5", ""),
        lane(4, "50,0 56,2 60,8 60,15", "50,-3.5 58,-1 63.5,6 63.5,15", to(5)),
        lane(5, "60,15 60,65", "63.5,15 63.5,65", ""),
        lane(6, "60,-65 60,-15", "63.5,-65 63.5,-15", to(7), lit("71")),
        lane(7, "60,-15 60,15", "63.5,-15 63.5,15", to(5)),
    )
    ways = "".join(
        f'<incoming id="9{way_in}"><incomingLanelet ref="{way_in}"/>{turns}</incoming>'
        for way_in, turns in (
            (1, '<successorsStraight ref="2"/><successorsLeft ref="4"/>'),
            (6, '<successorsStraight ref="7"/>'),
        )
    )
    return scenario(*parts, *lights, f'<intersection id="900">{ways}</intersection>', step_s=step_s)


def read(folder: Path, *lights: str, **more: str) -> SourceMap:
    return read_commonroad(written(folder, crossing(*lights, **more)))


def states(source: SourceMap) -> list[tuple[tuple[str, ...], float, list[tuple[float, str]]]]:
    return [
        (signal.lights, program.offset_s, [(phase.duration_s, phase.state) for phase in program.phases])
        for signal in source.signals
        for program in signal.programs
    ]


def test_lights_of_an_intersection_with_cycles_of_one_length_are_one_program(tmp_path: Path) -> None:
    source = read(tmp_path, light(70, *GREEN_FIRST), light(71, *RED_FIRST))
    wanted = [(10.0, "gr"), (3.0, "yr"), (1.0, "ru"), (8.0, "rg"), (3.0, "ry")]
    assert states(source) == [(("70", "71"), 0.0, wanted)]


def test_durations_and_offsets_are_time_steps_of_the_scenario(tmp_path: Path) -> None:
    source = read(tmp_path, light(70, *GREEN_FIRST, offset=300), light(71, *RED_FIRST, offset=50), step_s="0.2")
    ((_, start_s, phases),) = states(source)
    shown = {start_s + sum(seconds for seconds, _ in phases[:k]): state for k, (_, state) in enumerate(phases)}
    # 70 is green from 10 to 30 s, 71 from 38 s on for 16 s, of cycles of 50 s.
    assert sum(seconds for seconds, _ in phases) == 50.0
    assert [shown[at_s] for at_s in (10.0, 30.0, 36.0, 38.0)] == ["gr", "yr", "ru", "rg"]


def test_cycles_of_other_lengths_are_controllers_of_their_own(tmp_path: Path) -> None:
    source = read(tmp_path, light(70, *GREEN_FIRST), light(71, *RED_FIRST, ("red", 10)))
    assert [signal.lights for signal in source.signals] == [("70",), ("71",)]


def test_a_light_with_a_direction_holds_for_the_way_there_only(tmp_path: Path) -> None:
    lights = light(70, *GREEN_FIRST, direction="straight"), light(72, *RED_FIRST, direction="left")
    (signal,) = read(tmp_path, *lights, first="70 72").signals
    assert signal.ways == {"70": {("1", "2")}, "72": {("1", "4")}}
    (alone,) = read(tmp_path, lights[1], first="72").signals
    assert alone.ways == {"72": {("1", "4"), ("1", "2")}}  # no other light is there for the way ahead


@pytest.mark.parametrize(
    ("colours", "step_s", "why"),
    [
        ((), "0.1", "the file gives it no cycle"),
        ((("red", 10), ("yellow", 10)), "0.1", "its cycle holds no green"),
        ((("blue", 10), ("green", 10)), "0.1", "a colour that CommonRoad does not know"),
        ((("green", "x"),), "0.1", "trafficLight 70: duration is 'x', expected a number"),
        (GREEN_FIRST, "0", "the time step of the scenario is no time"),
        ((("green", 40_000),), "0.1", "longer than an hour"),
        ((("green", 1), ("red", 1)) * 101, "0.1", "202 colours, at most 200"),
    ],
)
def test_a_cycle_that_cannot_be_used_is_a_note(
    colours: tuple[tuple[str, float | str], ...], step_s: str, why: str, tmp_path: Path
) -> None:
    source = read(tmp_path, light(70, *colours), step_s=step_s)
    assert source.signals == ()
    assert [why in note for note in source.notes if "Traffic light 70: a program of ours, for" in note] == [True]


def test_the_network_runs_them_and_who_merges_yields_at_green_only_to_those_who_are_green(tmp_path: Path) -> None:
    """The turn and the way to the north merge: of two that are green at once one yields, else nobody does."""
    for red, letters in (((("green", 130), ("red", 120)), {"g", "G"}), (RED_FIRST, {"G"})):
        file = written(tmp_path, crossing(light(70, *GREEN_FIRST), light(71, *red)))
        files, record = import_map(file, "commonroad", tmp_path / "map", overwrite=True)
        roads = read_map(files.gpkg, files.name)
        controls = read_controls(files.folder)
        assert len(controls.links) == 3
        (program,) = controls.signals["70"]
        assert {letter for phase in program.phases for letter in phase.state if letter in "gG"} == letters
        assert check_map(files, roads).problems == ()
        report = check_source(files, roads, record, file)
        assert report.problems == ()
        assert report.signal_phases.map == report.signal_phases.file == len(program.phases)
