"""Folders of recorded scenes: formats are told by content, and everything that was left out is listed."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import pytest

from interplan_sumo.cli import main
from interplan_sumo.errors import InputError, UnknownNameError
from interplan_sumo.maps.store import find_map, load_roads
from interplan_sumo.scenario.files import read_scenarios
from interplan_sumo.verification.recorded_scenes import LEFT_OUT, Moments, import_scenes, recorded_scenes, write_scenes
from interplan_sumo.verification.start_checks import validate
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.recording import Recording
from tests.maps import commonroad_files as commonroad
from tests.realdata import real
from tests.scenario.made_recordings import recording, track

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (
            b"lane,x,y\n",
            "is no recording of a known format (argoverse2, argoverse2_sensor, commonroad, interplan, nuplan); "
            "name one with --format",
        ),
        (b"<commonRoad", "unclosed token"),
        (b"PAR1junk", "not a Parquet file"),
    ],
)
def test_a_file_is_taken_for_what_it_begins_with(tmp_path: Path, content: bytes, said: str) -> None:
    file = tmp_path / "recording.txt"
    file.write_bytes(content)
    with pytest.raises(InputError) as error:
        import_scenes(file, "strip", tmp_path / "out", {}, overwrite=False)
    assert said in str(error.value)


def test_a_missing_file_and_an_unknown_format_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot read .*nowhere"):
        import_scenes(tmp_path / "nowhere", "strip", tmp_path, {}, overwrite=False)
    with pytest.raises(UnknownNameError, match="Did you mean 'argoverse2'"):
        import_scenes(tmp_path, "strip", tmp_path, {}, "argoverse", overwrite=False)


def two_cars() -> Recording:
    roads = load_roads("strip")
    lane = max(roads.lanes.values(), key=lambda each: (each.centerline.length_m, each.id))
    along = [lane.centerline.poses_at([begin_m + k for k in range(30)]) for begin_m in (5.0, 30.0)]
    cyclist = track("c", along[1] + (0.0, 0.0, 0.0), ActorKind.BICYCLE)
    return recording(track("ego", along[0]), track("a", along[1]), cyclist, crs=roads.crs)


def test_scenes_on_a_shipped_map_carry_no_map_and_list_who_is_left_out(tmp_path: Path) -> None:
    made = recorded_scenes((two_cars(),), find_map("strip"), Moments((0.0, 1.0), agents="sumo"), tmp_path)
    assert write_scenes(tmp_path, made, ()) == 0
    scenarios = read_scenarios(tmp_path / "scenarios.yaml")
    assert [each.id for each in scenarios] == ["strip.recorded/ego-0.0s-sumo", "strip.recorded/ego-1.0s-sumo"]
    assert not (tmp_path / "maps").exists()
    assert validate(scenarios[0]) == []
    with (tmp_path / LEFT_OUT).open() as file:
        assert [row["track"] for row in csv.DictReader(file)] == ["c", "c"]


def test_times_that_are_one_step_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="are the same step"):
        recorded_scenes((two_cars(),), find_map("strip"), Moments((1.0, 1.01)), tmp_path)


def test_replayed_road_users_are_not_blamed_for_braking_hard_but_for_overlaps(tmp_path: Path) -> None:
    made = recorded_scenes((two_cars(),), find_map("strip"), Moments(agents="replayed"), tmp_path)
    (problem,) = validate(made[0].scenario)  # the cyclist is where the car is
    assert "overlap at the start" in problem


def test_a_real_recording_on_its_imported_map_is_a_scene_in_both_forms(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = real("argoverse2", "austin_0a1e6f0a")
    assert main(["maps", "import", str(source), "--format", "argoverse2", "--out", str(tmp_path / "austin")]) == 0
    capsys.readouterr()
    command = ["scenarios", "import", str(source), "--map", str(tmp_path / "austin"), "--no-certify", "--json"]
    assert main([*command, "--out", str(tmp_path / "scenes")]) == 0
    said = json.loads(capsys.readouterr().out)
    shutil.rmtree(tmp_path / "austin")
    replayed, driven = said["scenarios"]
    assert replayed["replayed"] + len(replayed["left_out"]) == 57
    assert driven["vehicles"] + driven["obstacles"] + len(driven["left_out"]) == 57
    assert all(row["reason"] for row in driven["left_out"])
    scenarios = read_scenarios(tmp_path / "scenes" / "scenarios.yaml")
    assert [validate(each) for each in scenarios] == [[], []]


def car(id: int, x_m: float, speed_mps: float, steps: int = 40) -> str:
    """A CommonRoad car on the middle of a lanelet whose left bound lies at y = 0."""
    first = commonroad.state(0, x_m, -1.75, speed=speed_mps, tag="initialState")
    later = "".join(commonroad.state(k, x_m + 0.1 * k * speed_mps, -1.75, speed=speed_mps) for k in range(1, steps))
    shape = "<shape><rectangle><length>4.5</length><width>1.8</width></rectangle></shape>"
    return (
        f'<dynamicObstacle id="{id}"><type>car</type>{shape}{first}<trajectory>{later}</trajectory></dynamicObstacle>'
    )


def test_one_file_gives_a_map_and_scenes_that_are_driven_on_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    road = commonroad.lanelet(1, (0.0, 100.0), after=(2,)) + commonroad.lanelet(2, (100.0, 300.0), before=(1,))
    source = commonroad.written(tmp_path, commonroad.scenario(road, car(7, 10.0, 8.0), car(8, 40.0, 8.0)))
    maps = ["maps", "import", str(source), "--format", "commonroad", "--out", str(tmp_path / "road")]
    assert main(maps) == 0
    command = ["scenarios", "import", str(source), "--map", str(tmp_path / "road"), "--out", str(tmp_path / "scenes")]
    assert main(command) == 2
    assert "name a track with --ego, such as one of those that go farthest: 7, 8" in capsys.readouterr().err
    assert main([*command, "--ego", "7", "--workers", "0"]) == 0
    said = capsys.readouterr()
    assert "road.recorded/7-0.0s-replayed: 3.9 s; vehicles 0, obstacles 0, replayed 1, left out 0" in said.out
    assert "road.recorded/7-0.0s-sumo: 30 s; vehicles 1, obstacles 0, replayed 0, left out 0" in said.out
    assert "2 scenarios, 2 certified" in said.out
    assert main([*command, "--ego", "7", "--no-certify"]) == 2
    assert "scenarios.yaml exists" in capsys.readouterr().err
    assert main([*command, "--ego", "7", "--no-certify", "--overwrite", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["certified"] is None
