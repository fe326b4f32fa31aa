"""Scenario files: what is written is read again unchanged, and every fault is one line that says where it is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_sumo.errors import InputError, ScenarioError
from interplan_sumo.scenario import files
from interplan_sumo.scenario.files import read_scenario, read_scenarios, write_scenario, write_scenarios
from interplan_sumo.scenario.recorded_parts import PAST_COLUMNS, PAST_STEPS, EgoPast, LoggedLight, ReplayedTrack
from interplan_sumo.scenario.scenario import (
    Jaywalker,
    LanePosition,
    Obstacle,
    PlacedVehicle,
    Scenario,
    TrafficDemand,
)

WHOLE = Scenario(
    id="crossing/0",
    family="jaywalker",
    map="one_north",
    start=LanePosition("101010", 20.0),
    start_speed_mps=8.0,
    goal=LanePosition("102020", 35.5),
    route=("10101", "10151", "10202"),
    traffic=TrafficDemand("low", "assertive", "high"),
    obstacles=(
        Obstacle(LanePosition("101010", 60.0, 2.4), "bus", 0.02, width_m=2.5),
        Obstacle(LanePosition("101010", 90.0), "cone"),
    ),
    jaywalkers=(Jaywalker(LanePosition("101010", 67.5, 3.0), LanePosition("101010", 67.5, -8.0), 1.4),),
    occluder=0,
    vehicles=(PlacedVehicle(LanePosition("101010", 8.0), 7.5, "truck"),),
    duration_s=25.0,
    exempt=("driving_direction",),
)
LEAST = Scenario(
    "mine/0", "mine", "strip", LanePosition("402032", 20.0), 12.0, LanePosition("402030", 260.0), ("40203",)
)
RECORDED = replace(
    LEAST,
    id="a\x85b\u2028\ufeff: #'\"\t\n\u00e4\U0001f600 ",
    start=LanePosition("402032", cast("float", np.float64(20.5))),
    replayed=(ReplayedTrack("7~2", "bicycle", 1.8, 0.6, 12, (0.001, -1e6), *[(0.125, -0.0)] * 4),),
    lights=(LoggedLight("13", (0, 20), ("red", "green")), LoggedLight("14", (0,), ("yellow",))),
    past=EgoPast(*[tuple(0.125 * k for k in range(PAST_STEPS))] * len(PAST_COLUMNS)),
)  # fmt: skip
"""What only recordings give, a name of strange characters, and a number of numpy."""
TEXT = """\
format: 1
id: crossing/0
family: jaywalker
map: one_north
start: {lane: '101010', arc_m: 20.0}
start_speed_mps: 8.0
goal: {lane: '102020', arc_m: 35.5}
route: ['10101', '10151', '10202']
traffic: {density: low, behaviour: assertive, oncoming: high}
obstacles:
- place: {lane: '101010', arc_m: 60.0, left_m: 2.4}
  kind: bus
  turned_rad: 0.02
  width_m: 2.5
- place: {lane: '101010', arc_m: 90.0}
  kind: cone
jaywalkers:
- start: {lane: '101010', arc_m: 67.5, left_m: 3.0}
  end: {lane: '101010', arc_m: 67.5, left_m: -8.0}
  speed_mps: 1.4
occluder: 0
vehicles:
- place: {lane: '101010', arc_m: 8.0}
  speed_mps: 7.5
  kind: truck
duration_s: 25.0
exempt: [driving_direction]
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "mine.yaml"
    path.write_text(text, encoding="utf-8")
    return path


# --- round trip ----------------------------------------------------------------------------------

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
NAMES = st.text(st.characters(exclude_categories=("Cs",)), min_size=1, max_size=12)


@settings(max_examples=50)
@given(
    names=st.lists(NAMES, min_size=4, max_size=4),
    numbers=st.tuples(NUMBERS, st.floats(-100.0, 100.0), st.floats(-7.0, 7.0)),
)
def test_any_name_and_number_is_read_again_with_the_same_hash(names: list[str], numbers: tuple[float, ...]) -> None:
    place = LanePosition(names[0], *numbers[:2])
    scenario = replace(
        WHOLE,
        id=names[0],
        family=names[1],
        map=names[2],
        start=place,
        route=tuple(names),
        obstacles=(Obstacle(place, "bus", numbers[2]),),
        exempt=tuple(names),
    )
    (node,) = files.yaml.compose_all(files.scenario_text(scenario), Loader=files.yaml.SafeLoader)
    again = files._File("mine.yaml").scenario(node)
    assert again == scenario
    assert again.hash() == scenario.hash()


@pytest.mark.parametrize("scenario", [WHOLE, LEAST, RECORDED], ids=("whole", "least", "recorded"))
def test_a_file_holds_what_was_written(scenario: Scenario, tmp_path: Path) -> None:
    write_scenario(scenario, tmp_path / "mine.yaml")
    assert read_scenario(tmp_path / "mine.yaml") == scenario
    assert read_scenario(tmp_path / "mine.yaml").hash() == scenario.hash()


def test_a_file_can_be_read_by_people_and_leaves_defaults_out(tmp_path: Path) -> None:
    assert files.scenario_text(WHOLE) == TEXT
    assert files.scenario_text(LEAST).splitlines()[-1] == "route: ['40203']"
    assert read_scenario(written(tmp_path, TEXT)) == WHOLE


def test_several_scenarios_are_several_documents_in_order(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    write_scenarios((WHOLE, LEAST), path)
    assert read_scenarios(path) == (WHOLE, LEAST)
    with pytest.raises(ScenarioError, match=r"mine\.yaml holds 2 scenarios \(crossing/0, mine/0\), expected one"):
        read_scenario(path)


@pytest.mark.parametrize(
    ("number", "value"),
    [("20", 20.0), ("+20.", 20.0), (".5", 0.5), ("010", 10.0), ("-0.0", -0.0), ("1e308", 1e308)],
)
def test_numbers_mean_what_people_mean(number: str, value: float, tmp_path: Path) -> None:
    found = read_scenario(written(tmp_path, TEXT.replace("arc_m: 60.0", f"arc_m: {number}")))
    assert str(found.obstacles[0].place.arc_m) == str(value)


def test_ids_of_digits_need_no_quotes_and_repeated_parts_can_be_named_once(tmp_path: Path) -> None:
    bare = (
        TEXT.replace("'", "")
        .replace("start: {lane", "start: &here {lane", 1)
        .replace("place: {lane: 101010, arc_m: 8.0}", "place: *here")
    )
    found = read_scenario(written(tmp_path, bare))
    assert replace(found, vehicles=WHOLE.vehicles) == WHOLE
    assert found.vehicles[0].place == WHOLE.start


# --- faults --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("format: 1\n", "", "line 1: there is no format; begin the scenario with `format: 1`"),
        ("format: 1", "format: 2", "line 1: format is 2, this version reads one format, 1"),
        ("format: 1", "format: yes", "line 1: format is yes, expected a whole number"),
        ("format: 1", "format: 1\nformat: 1", "line 2: format is 1, this version reads one format, 1"),
        ("id: crossing/0\n", "", "line 1: id is missing, expected text"),
        ("id: crossing/0", "id:", "line 2: id is empty, expected text"),
        ("id: crossing/0", "id: yes", "id is yes, expected text. If the text is meant, put it in quotes: 'yes'"),
        ("id: crossing/0", "id: a\nid: b", "line 3: id is given twice; leave one out"),
        ("arc_m: 60.0", "arc_m: far", "line 11: obstacles[0].place.arc_m is far, expected a number"),
        ("arc_m: 60.0", "arc_m: '60'", "line 11: obstacles[0].place.arc_m is '60', expected a number"),
        ("arc_m: 60.0", "arc_m: true", "line 11: obstacles[0].place.arc_m is true, expected a number"),
        ("arc_m: 60.0", "arc_m: .nan", "line 11: obstacles[0].place.arc_m is .nan, expected a number"),
        ("arc_m: 60.0", "arc_m: 1e999", "line 11: obstacles[0].place.arc_m is 1e999, expected a number"),
        ("arc_m: 60.0", "arc_m: 1:30", "line 11: obstacles[0].place.arc_m is 1:30, expected a number"),
        ("arc_m: 60.0", "arc_m: 60.0, arc_m: 1", "line 11: obstacles[0].place.arc_m is given twice; leave one out"),
        (", arc_m: 60.0", "", "line 11: obstacles[0].place.arc_m is missing, expected a number"),
        (
            "arc_m: 60.0",
            "arc: 60.0",
            "line 11: there is no field obstacles[0].place.arc. Did you mean obstacles[0].place.arc_m?",
        ),
        ("arc_m: 60.0", "zz: 1", "there is no field obstacles[0].place.zz. Known are: lane, arc_m, left_m"),
        ("arc_m: 60.0", "[1]: 1", "there is no field obstacles[0].place.a list. Known are"),
        (
            "kind: bus",
            "kind: buss",
            "line 12: obstacles[0].kind is buss, expected one of car, van, bus, truck, cone, barrier, sign, worker, "
            "person, door. Did you mean 'bus'?",
        ),
        ("kind: bus", "kind: tank", "obstacles[0].kind is tank, expected one of car, van, bus, truck, cone, barrier"),
        ("kind: bus", "kind: {a: 1}", "obstacles[0].kind is a mapping, expected one of car"),
        ("density: low", "density: null", "traffic.density is empty, expected one of none, rare, sparse, low, medium"),
        ("oncoming: high", "flow: true", "there is no field traffic.flow. Known are: density, behaviour, oncoming"),
        ("width_m: 2.5", "width_m: wide", "obstacles[0].width_m is wide, expected a number"),
        ("occluder: 0", "occluder: 0.0", "line 21: occluder is 0.0, expected a whole number"),
        ("occluder: 0", "occluder: 2", "line 1: crossing/0: occluder is 2, expected the index of one of 2 obstacles"),
        ("route: ['10101', '10151', '10202']", "route: 10101", "line 8: route is 10101, expected a list of text"),
        ("'10151'", "[10151]", "line 8: route[1] is a list, expected text"),
        ("exempt: [driving_direction]", "exempt: {a: 1}", "exempt is a mapping, expected a list of text"),
        ("obstacles:\n", "obstacle:\n", "line 10: there is no field obstacle. Did you mean obstacles?"),
        ("start: {lane: '101010', arc_m: 20.0}", "start: 3", "start is 3, expected the keys lane, arc_m, left_m"),
        ("speed_mps: 1.4", "speed_mps: 9", "crossing/0: jaywalkers[0].speed_mps is 9.0, expected 0.1 to 5"),
        ("start: {lane", "start: {lane: {", "line 5: this is not YAML: "),
        ("id: ", "id:\t\t- {", "this is not YAML: "),
        ("id: crossing/0", "id: !!binary aGVsbG8=", "line 2: id is aGVsbG8=, expected text"),
        (TEXT, f"{TEXT}---\n{TEXT}", "line 29: there is a second scenario crossing/0, the first is in line 1"),
        (TEXT, f"{TEXT}---\n", "line 29: this is empty, expected a scenario: the keys id, family, map, start"),
        (TEXT, "- 1", "line 1: this is a list, expected a scenario"),
        (TEXT, "", "is empty; `interplan-sumo scenarios export ID"),
        (TEXT, "a: \x07", "this is not YAML: "),
    ],
)  # fmt: skip
def test_a_fault_is_one_line_that_names_the_file_and_what_would_be_right(
    old: str, new: str, message: str, tmp_path: Path
) -> None:
    assert old in TEXT
    path = written(tmp_path, TEXT.replace(old, new, 1))
    with pytest.raises(ScenarioError) as caught:
        read_scenarios(path)
    said = str(caught.value)
    assert said.startswith(str(path))
    assert message in said
    assert "\n" not in said


def test_null_takes_back_what_may_be_missing(tmp_path: Path) -> None:
    found = read_scenario(written(tmp_path, TEXT.replace("width_m: 2.5", "width_m: null")))
    assert found.obstacles[0].width_m is None


def test_a_file_that_cannot_be_read_or_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"cannot read .*nowhere\.yaml: No such file"):
        read_scenarios(tmp_path / "nowhere.yaml")
    with pytest.raises(ScenarioError, match=r"cannot read .*: Is a directory"):
        read_scenarios(tmp_path)
    with pytest.raises(InputError, match=r"cannot write .*mine\.yaml: No such file or directory; give another file"):
        write_scenario(LEAST, tmp_path / "no" / "mine.yaml")
    (tmp_path / "bytes.yaml").write_bytes(b"id: \xff")
    with pytest.raises(ScenarioError, match=r"bytes\.yaml is not UTF-8 text \(byte 4\)"):
        read_scenarios(tmp_path / "bytes.yaml")


def test_a_file_of_any_size_is_not_read_to_its_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path, TEXT)
    monkeypatch.setattr(files, "LARGEST_BYTES", len(TEXT))
    assert read_scenario(path) == WHOLE
    monkeypatch.setattr(files, "LARGEST_BYTES", len(TEXT) - 1)
    with pytest.raises(ScenarioError, match="is larger than"):
        read_scenario(path)


def test_a_name_means_a_file_by_its_ending_or_because_it_is_there(tmp_path: Path) -> None:
    assert files.is_scenario_file("mine.yaml")
    assert files.is_scenario_file("MINE.YML")
    assert not files.is_scenario_file("nudge/0")
    assert not files.is_scenario_file("nudge/*")
    (tmp_path / "plain").write_text("")
    assert files.is_scenario_file(str(tmp_path / "plain"))
    assert not files.is_scenario_file(str(tmp_path))
