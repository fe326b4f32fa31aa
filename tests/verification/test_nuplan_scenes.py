"""Logs of nuPlan on maps of nuPlan: scenes with the recorded traffic and the recorded lights, in both forms."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from interplan_sumo.cli import main
from interplan_sumo.errors import InputError, MapError, UnknownNameError
from interplan_sumo.maps.store import load_roads
from interplan_sumo.recordings.nuplan import picked_moments
from interplan_sumo.recordings.nuplan_db import NuplanLog
from interplan_sumo.scenario.files import read_scenarios
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.setup import open_traffic, start_state
from interplan_sumo.verification.recorded_scenes import recorded_map
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.signals import SignalStatus
from tests.recordings.nuplan_dbs import MAP, X_M, Y_M, Goes, maps_root, sweep, track_id, write_log

pytestmark = pytest.mark.slow
EGO = Goes(X_M + 20.0, Y_M, 0.0, 8.0)
LEADER = Goes(X_M + 45.0, Y_M, 0.0, 8.0)
WALKER = Goes(X_M + 80.0, Y_M - 8.0, 0.0, 0.0, "pedestrian", (0.8, 0.8))


def log(folder: Path, **more: object) -> Path:
    red = {frame: "red" if frame < 200 else "green" for frame in range(401)}
    lights = {13: red, 999: dict.fromkeys(range(401), "green")}
    return write_log(folder / "drive.db", EGO, (LEADER, WALKER), lights=lights, **more)  # type: ignore[arg-type]


def imported(folder: Path, *options: str) -> tuple[Scenario, ...]:
    command = ["scenarios", "import", str(log(folder)), "--map", str(maps_root(folder)), "--out", str(folder / "out")]
    assert main([*command, "--no-certify", *options]) == 0
    return read_scenarios(folder / "out" / "scenarios.yaml")


def test_a_log_gives_scenes_in_both_forms_on_a_map_that_gets_its_network(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    replayed, driven = imported(tmp_path, "--token", sweep(20), "--json")
    said = json.loads(capsys.readouterr().out)
    assert replayed.id == f"{MAP}.recorded/{sweep(20)}-0.0s-replayed"
    assert (len(replayed.replayed), len(driven.vehicles)) == (2, 1)
    assert driven.start_speed_mps == 8.0
    roads = load_roads(MAP, tmp_path / "out" / "maps")
    start = driven.start.pose(roads)
    assert start.x_m == pytest.approx(EGO.x_m + 8.0 + PACIFICA.rear_axle_to_center_m, abs=0.01)
    assert driven.route == ("1", "13", "7")
    assert "has no traffic light at 1 connectors with a recorded one: 999" in "".join(said["scenarios"][0]["notes"])


@pytest.mark.parametrize("form", [0, 1])
def test_recorded_lights_are_what_everyone_sees_at_every_step(form: int, tmp_path: Path) -> None:
    scenario = imported(tmp_path, "--at", "5")[form]
    (light,) = scenario.lights
    assert (light.connector, light.steps[:2], light.shows[:2]) == ("13", (0, 50), ("red", "green"))
    assert light.shows[2:] == (("unknown",) if form else ())  # SUMO drives on after the end of the log
    roads = load_roads(scenario.map, scenario.maps_beside)
    with open_traffic(scenario, roads) as traffic:
        state = start_state(scenario, roads)
        for step in range(60):
            signals = traffic.observe().signals
            status = dict(zip(signals.connector_ids, signals.status.tolist(), strict=True))
            assert status["13"] == (SignalStatus.RED if step < 50 else SignalStatus.GREEN)
            assert all(shown == SignalStatus.UNKNOWN for connector, shown in status.items() if connector != "13")
            traffic.react(state)
            traffic.place_ego(state)
            traffic.advance()


def test_the_command_names_the_log_and_the_way_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root, source = maps_root(tmp_path), log(tmp_path, map_name="us-nv-las-vegas-strip")
    command = ["scenarios", "import", str(source), "--map", str(root), "--out", str(tmp_path / "out"), "--no-certify"]
    assert main(command) == 2
    assert "no map named 'us-nv-las-vegas-strip'. Known: tiny-town." in capsys.readouterr().err
    assert main([*command[:4], str(root / MAP), *command[5:]]) == 2
    assert "is in EPSG:32611, map tiny-town in EPSG:32632" in capsys.readouterr().err
    assert main([*command, "--logs", str(source)]) == 2
    assert "is a log of nuPlan, which takes no --logs; it takes --at, --token" in capsys.readouterr().err
    (tmp_path / "a.xml").write_text("<commonRoad/>")
    assert main([*command[:2], str(tmp_path / "a.xml"), *command[3:], "--tag", "x"]) == 2
    assert "a.xml is a scenario of CommonRoad, which takes no --tag; it takes --at, --ego" in capsys.readouterr().err


def test_two_moments_with_one_other_car_as_the_ego_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["scenarios", "import", str(log(tmp_path)), "--map", str(maps_root(tmp_path)), "--ego", track_id(0)]
    command += ["--out", str(tmp_path / "out"), "--agents", "sumo", "--no-certify", "--at", "0"]
    assert main([*command, "--at", "2"]) == 2
    assert "name one moment at a time with --ego" in capsys.readouterr().err
    assert main(command) == 0


def test_the_map_of_a_log_is_found_in_a_root_in_a_folder_or_by_name(tmp_path: Path) -> None:
    root = maps_root(tmp_path, MAP, "elsewhere")
    assert recorded_map(str(root), MAP).folder == root / MAP / "9.1.1"
    assert recorded_map(str(root / "elsewhere"), MAP).name == "elsewhere"
    assert recorded_map("strip", MAP).name == "strip"
    (root / "nuplan-maps-v1.0.json").unlink()
    assert recorded_map(str(root), MAP).name == MAP
    with pytest.raises(UnknownNameError):
        recorded_map(str(tmp_path / "nowhere"), MAP)
    with pytest.raises((UnknownNameError, MapError)):
        recorded_map(str(tmp_path), MAP)


def test_moments_with_a_tag_lie_apart_and_every_moment_is_taken_once(tmp_path: Path) -> None:
    tags = dict.fromkeys((0, 1, 2, 399, 400), "on_intersection")
    with NuplanLog(log(tmp_path, tags=tags)) as opened:
        found = picked_moments(opened, tag=("on_intersection",), count=5)
        assert [moment.token for moment in found] == [sweep(0), sweep(400)]
        found = picked_moments(opened, (0.0, 2.0), (sweep(0),), ("on_intersection",))
        assert [moment.token for moment in found] == [sweep(0), sweep(40)]
        assert [moment.token for moment in picked_moments(opened)] == [sweep(0)]
        with pytest.raises(InputError, match="count is 0"):
            picked_moments(opened, count=0)
