"""Signal programs and right of way of a SUMO network are those of its file, as SUMO itself sees them."""

from __future__ import annotations

import re
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from interplan_sumo.errors import MapError
from interplan_sumo.maps.check import check_map
from interplan_sumo.maps.controls import MapControls, read_controls
from interplan_sumo.maps.geopackage import read_map
from interplan_sumo.maps.importers.build import build
from interplan_sumo.maps.importers.carried_controls import carried_controls
from interplan_sumo.maps.importers.control_fidelity import ControlReport, compare_controls
from interplan_sumo.maps.importers.importing import check_source, import_map
from interplan_sumo.maps.importers.lanelet2.reader import read_lanelet2
from interplan_sumo.maps.importers.record import ImportRecord
from interplan_sumo.maps.importers.source import SourceMap, SourceSignal
from interplan_sumo.maps.importers.sumo.reader import read_sumo_network
from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.network_links import read_network_summary
from interplan_sumo.maps.signal_program import SignalPhase, SignalProgram
from interplan_sumo.maps.store import MapFiles
from interplan_sumo.simulation.sumo import sumo
from interplan_sumo.world.roads import Roads
from tests.maps.lanelet2_files import Osm
from tests.maps.source_worlds import linked, straight, world
from tests.maps.sumo_nets import crossroads, edge, made, node
from tests.quick import few


@dataclass(frozen=True)
class Imported:
    """A network, the map made from it, and how."""

    source: Path
    files: MapFiles
    roads: Roads
    record: ImportRecord

    @classmethod
    def of(cls, source: Path, format: str = "sumo") -> Imported:
        files, record = import_map(source, format, source.parent / "imported")
        return cls(source, files, read_map(files.gpkg, "imported"), record)

    def connector(self, way: str) -> str:
        """That which holds a way through the junction."""
        rows = self.record.origins
        (found,) = (id_ for id_ in self.roads.connectors if way in {row.source_id for row in rows[id_]})
        return found

    def against(self, source: SourceMap) -> ControlReport:
        """Its network held against what a file could say."""
        network = read_network_summary(self.files.network)
        return compare_controls(self.roads, self.record.origins, source, NetworkIds.read(self.files.ids), network)


@contextmanager
def running(network: Path, step_s: float = 1.0) -> Generator[None]:
    sumo.start(["sumo", "-n", str(network), "--no-step-log", "--no-warnings", "--step-length", str(step_s)])
    try:
        yield
    finally:
        sumo.close()


def lit(folder: Path, kind: str = "static", change: Callable[[str], str] | None = None) -> Path:
    """A crossing under a light with a phase for left turns, its programs changed as text."""
    path = crossroads(folder, "traffic_light", "--tls.default-type", kind, "--tls.left-green.time", "7")
    if change is not None:
        path.write_text(re.sub(r"<tlLogic.*</tlLogic>", lambda found: change(found[0]), path.read_text(), flags=re.S))
    return path


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Imported:
    """The crossing under a light as it is; not to be changed."""
    return Imported.of(lit(tmp_path_factory.mktemp("plain")))


def second(programs: str) -> str:
    """With another program, which skips a phase."""
    phases = '<phase duration="9" state="{}" next="1"/><phase duration="3" state="{}" name="all red" next="0"/>'
    states = ["G" * 14, "r" * 14]
    return f'{programs}<tlLogic id="c" type="static" programID="night" offset="4">{phases.format(*states)}</tlLogic>'


def timed(programs: str) -> str:
    return programs.replace('offset="0"', 'offset="17"').replace("<phase", '<phase name="a"')


def seen(network: Path, steps: int = 150) -> tuple[list[Any], list[str]]:
    """The programs that SUMO reports, and what the light shows second by second."""
    with running(network):
        logics = sumo.trafficlight.getAllProgramLogics("c")
        programs = [
            (
                each.programID,
                each.type,
                [(p.duration, p.state, p.minDur, p.maxDur, p.next, p.name) for p in each.phases],
            )
            for each in logics
        ]
        shown: list[str] = []
        for _ in range(steps):
            sumo.simulationStep()
            shown.append(sumo.trafficlight.getRedYellowGreenState("c"))
    return programs, shown


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "change"),
    few([("static", second), ("actuated", None), ("static", None), ("static", timed), ("delay_based", None)], 2),
    ids=["two programs", "actuated", "static", "offset and names", "delay based"],
)
def test_sumo_runs_the_programs_of_the_file(kind: str, change: Callable[[str], str] | None, tmp_path: Path) -> None:
    made_map = Imported.of(lit(tmp_path, kind, change))
    assert seen(made_map.files.network) == seen(made_map.source)
    with running(made_map.files.network):
        links = sumo.trafficlight.getControlledLinks("c")
    ids = NetworkIds.read(made_map.files.ids)
    for way, light in ((":c_0_0", 0), (":c_7_0", 7), (":c_10_0", 10)):
        connector = made_map.connector(way)
        assert ids.links[connector] == ("c", light)
        assert links[light][0][2] == ids.pieces[connector][0].sumo_lane
    assert check_map(made_map.files, made_map.roads).problems == ()
    report = check_source(made_map.files, made_map.roads, made_map.record, made_map.source)
    assert report.problems == ()
    assert report.signal_phases.map == report.signal_phases.file > 0


def merge(folder: Path) -> Path:
    """Two roads that join into one lane like a zipper."""
    nodes = [node("a", -100, 30), node("b", -100, -30), node("c", 0, 0, "zipper"), node("d", 100, 0)]
    return made(folder, nodes, [edge("ac", "a", "c"), edge("bc", "b", "c"), edge("cd", "c", "d")])


KINDS = ("priority_stop", "right_before_left", "left_before_right", "allway_stop", "traffic_light")


@pytest.mark.parametrize("kind", few(["priority", "zipper", *KINDS, "traffic_light_right_on_red"], 2))
def test_right_of_way_is_that_of_the_file(kind: str, tmp_path: Path) -> None:
    made_map = Imported.of(merge(tmp_path) if kind == "zipper" else crossroads(tmp_path, kind))
    report = check_source(made_map.files, made_map.roads, made_map.record, made_map.source)
    assert report.problems == ()
    assert report.who_yields.map == report.who_yields.file > 0
    assert check_map(made_map.files, made_map.roads).problems == ()


def test_where_the_file_has_no_rules_signs_and_geometry_decide_and_a_note_says_so(tmp_path: Path) -> None:
    made_map = Imported.of(crossroads(tmp_path, "unregulated"))
    assert any("junction c (unregulated) has no rules in the file" in note for note in made_map.record.notes)
    network = read_network_summary(made_map.files.network)
    assert any(network.yields["I1"].values())


def first_through(made_map: Imported, ways: Mapping[str, str]) -> str:
    """Of cars on some ways that come to a junction at the same time, the one that leaves it first."""
    ids = NetworkIds.read(made_map.files.ids)
    with running(made_map.files.network, 0.1):
        for name, way in ways.items():
            connector = made_map.roads.connectors[made_map.connector(way)]
            lanes = ids.pieces[connector.from_lane_id][-1], ids.pieces[connector.to_lane_id][0]
            sumo.route.add(name, [piece.sumo_lane.rpartition("_")[0] for piece in lanes])
            sumo.vehicle.add(name, name, departPos="20", departSpeed="10", departLane=lanes[0].sumo_lane[-1])
            sumo.vehicle.setSpeedMode(name, 31)
        while True:
            sumo.simulationStep()
            for name in ways:
                here = sumo.vehicle.getRoadID(name) if name in sumo.vehicle.getIDList() else ""
                if here and here == sumo.vehicle.getRoute(name)[1]:
                    return name


@pytest.mark.parametrize(("kind", "first"), few([("right_before_left", "north"), ("priority", "east")], 1))
def test_at_right_before_left_the_car_on_the_left_waits(kind: str, first: str, tmp_path: Path) -> None:
    made_map = Imported.of(crossroads(tmp_path, kind, lanes=1))
    lanes = read_sumo_network(made_map.source).lanes
    ways = {
        name: next(way for way in lanes[start].successors if lanes[way].successors == (end,))
        for name, start, end in (("east", "wc_0", "ce_0"), ("north", "sc_0", "cn_0"))
    }
    assert first_through(made_map, ways) == first


# --- the check finds what differs --------------------------------------------------------------------


def other_phase(program: SignalProgram, **changes: Any) -> SignalProgram:
    return replace(program, phases=(replace(program.phases[0], **changes), *program.phases[1:]))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda p: replace(p, kind="actuated"), "its type is static, in the file actuated"),
        (lambda p: replace(p, offset_s=3.0), "its offset is 0.0, in the file 3.0"),
        (lambda p: replace(p, id="1"), "has the programs 0, in the file another set"),
        (lambda p: replace(p, phases=p.phases[1:]), "its number of phases"),
        (lambda p: other_phase(p, duration_s=1.0), "phase 0"),
        (lambda p: other_phase(p, max_s=50.0), "to 50"),
        (lambda p: other_phase(p, next=(1,)), "then 1"),
        (lambda p: other_phase(p, state="r" * 14), "shows other letters than light c in the file"),
    ],
)
def test_the_check_names_what_differs_in_a_program(
    change: Callable[[SignalProgram], SignalProgram], said: str, plain: Imported
) -> None:
    source = read_sumo_network(plain.source)
    assert plain.against(source).problems == ()
    (signal,) = source.signals
    changed = replace(signal, programs=tuple(map(change, signal.programs)))
    problems = plain.against(replace(source, signals=(changed,))).problems
    assert problems
    assert {problem.kind for problem in problems} == {"signal"}
    assert any(said in problem.message for problem in problems)


def test_the_check_names_pairs_whose_right_of_way_differs(tmp_path: Path) -> None:
    made_map = Imported.of(crossroads(tmp_path, "right_before_left"))
    source = read_sumo_network(made_map.source)
    (junction,) = (each for each in source.junctions if each.id == "c")
    pair = min(junction.yields)
    turned = replace(junction, yields=junction.yields - {pair} | {pair[::-1]})
    problems = made_map.against(replace(source, junctions=(turned,))).problems
    assert len(problems) == 2
    assert {problem.kind for problem in problems} == {"right_of_way"}


def test_the_check_names_a_pair_once_though_its_connectors_lead_over_several_ways(tmp_path: Path) -> None:
    osm = Osm(next_id=1)
    straight_on = {"turn_direction": "straight"}
    osm.straight(0.0, 50.0, 1.5), osm.straight(70.0, 120.0, 1.5)
    east = osm.straight(50.0, 70.0, 1.5, tags=straight_on)
    for start_m, end_m in ((-60.0, -10.0), (10.0, 60.0)):
        osm.lanelet([(58.5, start_m), (58.5, end_m)], [(61.5, start_m), (61.5, end_m)])
    north = osm.lanelet([(58.5, -10.0), (58.5, 10.0)], [(61.5, -10.0), (61.5, 10.0)], straight_on)
    osm.rule("right_of_way", ("relation", int(east), "yield"), ("relation", int(north), "right_of_way"))
    made_map = Imported.of(osm.write(tmp_path / "crossing.osm"), "lanelet2")
    source = read_lanelet2(made_map.source)
    assert made_map.against(source).yields == (1, 1)
    (junction,) = source.junctions
    turned = replace(junction, yields=frozenset(pair[::-1] for pair in junction.yields))
    problems = made_map.against(replace(source, junctions=(turned,))).problems
    assert len(problems) == 2
    assert {problem.kind for problem in problems} == {"right_of_way"}


# --- what cannot be kept as it is --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "said"),
    few(
        [
            (lambda text: text.replace('type="static"', 'type="NEMA"'), "programs of the type NEMA"),
            (lambda text: text.replace('state="', 'state="x'), "letters that SUMO does not know"),
            (lambda text: re.sub(r'state="\w+"', 'state="rG"', text), "shorter than its links"),
            (lambda text: re.sub(r'duration="\w+"', 'duration="0"', text), "take no time"),
            (lambda text: text.replace("<phase", '<phase next="99"', 1), "leads to one that does not exist"),
            (lambda _: "", "the file holds no program"),
        ],
        2,
        often=6,
    ),
)
def test_a_program_that_cannot_run_is_replaced_by_ours_with_a_note(
    change: Callable[[str], str], said: str, tmp_path: Path
) -> None:
    made_map = Imported.of(lit(tmp_path, change=change))
    assert [note for note in made_map.record.notes if said in note]
    assert read_controls(made_map.files.folder).signals == {}
    assert check_map(made_map.files, made_map.roads).problems == ()


def two_lights(states: Sequence[str]) -> tuple[MapControls, tuple[str, ...]]:
    """The controls of a lane through an intersection in which one passes two lights of one controller."""
    lanes = [
        straight("in", 0, 50),
        straight("first", 50, 60, in_intersection=True, lights_at_start=("a",)),
        straight("second", 60, 70, in_intersection=True, lights_at_start=("b",)),
        straight("out", 70, 130),
    ]
    phases = tuple(SignalPhase(20.0, state) for state in states)
    signal = SourceSignal("s", ("a", "b"), (SignalProgram("0", phases),))
    source = world(linked(lanes, (("in", "first"), ("first", "second"), ("second", "out"))), signals=(signal,))
    built = build(source)
    return carried_controls(source, built.roads, built.origins)


def test_who_passes_two_lights_is_shown_the_stricter() -> None:
    controls, notes = two_lights(("Gr", "yG", "GG"))
    assert [phase.state for phase in controls.signals["s"][0].phases] == ["Grr", "yGy", "GGG"]
    assert list(controls.links.values()) == [("s", 2)]
    assert "shows the strictest" in notes[0]


def test_who_passes_two_lights_that_are_never_green_together_follows_the_first() -> None:
    controls, notes = two_lights(("Gr", "yr", "rG"))
    assert list(controls.links.values()) == [("s", 0)]
    assert "follows the first" in notes[0]


# --- on disk -----------------------------------------------------------------------------------------


def test_controls_are_read_as_they_were_written_and_of_a_part_only_that_stays(tmp_path: Path) -> None:
    made_map = Imported.of(lit(tmp_path, "actuated"))
    controls = read_controls(made_map.files.folder)
    controls.write(tmp_path)
    assert read_controls(tmp_path) == controls
    kept = list(controls.links)[:3]
    part = controls.within(kept)
    assert list(part.links) == kept
    assert {id_ for rules in part.junctions for id_ in rules.connectors} == set(kept)
    MapControls().write(tmp_path)
    assert not (tmp_path / "controls.json").exists()


@pytest.mark.parametrize("text", ["[]", '{"version": 2}', '{"version": 1, "links": {"1": ["c", 0]}}', "{"])
def test_damaged_controls_are_named(text: str, tmp_path: Path) -> None:
    (tmp_path / "controls.json").write_text(text)
    with pytest.raises(MapError, match="does not hold the controls of a map"):
        read_controls(tmp_path)
