"""The folder for sumo-gui: SUMO plays in it what was recorded, to the centimetre, and says nothing against it."""

from __future__ import annotations

import gzip
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element

import libsumo
import numpy as np
import pytest
from defusedxml.ElementTree import fromstring, parse

from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.run import run
from interplan_sumo.batch.run_folder import read_run
from interplan_sumo.batch.stored_drive import StoredDrive, StoredDrives
from interplan_sumo.errors import InputError
from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.store import find_map
from interplan_sumo.maps.to_sumo import program_path
from interplan_sumo.report.sumo_gui.folder import BEFORE_S, SHAPES, TRACKS, VIEW, write_sumo_gui
from interplan_sumo.simulation.setup import open_sumo_traffic
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.trace import ActorTable
from tests.quick import few

sumo = pytest.importorskip("sumo", reason="eclipse-sumo is not installed")
SCENARIOS = ("construction/0", "jaywalker/0")
"""Traffic and things that stand; people who walk, off the road too."""


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> dict[str, StoredDrive]:
    """Drives by scenario."""
    folder = tmp_path_factory.mktemp("sumo_gui") / "run"
    run(RunOptions(planners=("straight_ahead",), suite="smoke==1", scenarios=SCENARIOS, out=folder, workers=0))
    stored = StoredDrives(read_run(folder))
    return {row.scenario_id: stored.read(row) for row in stored.run.rows.values()}


def simulated(configuration: Path) -> list[tuple[float, str, float, float, float]]:
    """(time, id, x, y, angle) of everybody in every step to the end; SUMO may complain of nothing."""
    places = configuration.with_suffix(".out.xml")
    command = [program_path("sumo"), "-c", configuration, "--fcd-output", places, "--precision", "4"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
    return list(_rows(tree(places)))


def tree(path: Path) -> Element:
    root = parse(path).getroot()
    assert root is not None
    return root


def value(path: Path, name: str) -> str | None:
    (found,) = tree(path).iter(name)
    return found.get("value")


def recorded(folder: Path) -> list[tuple[float, str, float, float, float]]:
    return list(_rows(fromstring(gzip.decompress((folder / TRACKS).read_bytes()))))


def _rows(root: Element) -> Iterator[tuple[float, str, float, float, float]]:
    for step in root:
        for one in step:
            x_m, y_m, angle_deg = (float(one.attrib[name]) for name in ("x", "y", "angle"))
            yield round(float(step.attrib["time"]), 2), one.attrib["id"], x_m, y_m, angle_deg


@pytest.mark.parametrize(("scenario", "at_s"), few([(SCENARIOS[1], 0.0), (SCENARIOS[0], None)], 1))
def test_sumo_plays_the_drive_to_its_end_with_everybody_where_they_were(
    drives: dict[str, StoredDrive], tmp_path: Path, scenario: str, at_s: float | None
) -> None:
    played = simulated(write_sumo_gui(drives[scenario], tmp_path, at_s=at_s))
    begin_s = min(time_s for time_s, *_ in played)
    wanted = {(time_s, name): place for time_s, name, *place in recorded(tmp_path) if time_s >= begin_s}
    found = {(time_s, name): place for time_s, name, *place in played}
    assert found.keys() == wanted.keys()
    for key in sorted(wanted):
        if key[0] > begin_s:  # in the first step SUMO puts everybody on the middle of a lane
            assert found[key] == pytest.approx(wanted[key], abs=0.01), key


@pytest.mark.slow
def test_who_leaves_or_comes_on_the_way_does_so_in_sumo(drives: dict[str, StoredDrive], tmp_path: Path) -> None:
    drive = drives["construction/0"]
    rows = drive.trace.actors.to_frame()
    driving = rows[rows["behaviour"] != ""].groupby("track_token")["frame"]
    leaving, coming = driving.count().nlargest(2).index
    rows = rows[(rows["track_token"] != leaving) | (rows["frame"] < 60)]
    rows = rows[(rows["track_token"] != coming) | rows["frame"].between(90, 110)]
    changed = replace(drive.trace, actors=ActorTable.from_frame(rows, len(drive.trace)))
    played = simulated(write_sumo_gui(replace(drive, trace=changed), tmp_path, at_s=0.0))
    begin_s = min(time_s for time_s, *_ in played)
    assert {(t, name) for t, name, *_ in played} == {(t, name) for t, name, *_ in recorded(tmp_path) if t >= begin_s}
    times_s = {name: [t for t, each, *_ in played if each == name] for name in (leaving, coming)}
    assert max(times_s[leaving], default=0.0) < 6.2
    assert max(times_s[coming]) < 11.2


def test_the_tracks_are_those_of_the_trace(drives: dict[str, StoredDrive], tmp_path: Path) -> None:
    drive = drives["jaywalker/0"]
    write_sumo_gui(drive, tmp_path)
    origin = NetworkIds.read(find_map(drive.scenario.map).ids).origin_m
    ego, half_m = drive.trace.ego, drive.trace.shape.length_m / 2.0
    fronts = [(x_m, y_m) for _, name, x_m, y_m, _ in recorded(tmp_path) if name == "ego"]
    ahead = half_m * np.stack((np.cos(ego.heading_rad), np.sin(ego.heading_rad)), axis=1)
    wanted = np.stack((ego.x_m, ego.y_m), axis=1) + ahead - origin
    assert np.array(fronts) == pytest.approx(wanted, abs=0.002)


def test_everybody_is_in_the_tracks_or_among_the_shapes(drives: dict[str, StoredDrive], tmp_path: Path) -> None:
    drive = drives["construction/0"]
    write_sumo_gui(drive, tmp_path)
    moving = {name for _, name, *_ in recorded(tmp_path)} - {"ego"}
    shapes = {shape.get("id") for shape in tree(tmp_path / SHAPES)}
    actors = drive.trace.actors
    for name, kind in set(zip(actors.ids, actors.kind, strict=True)):
        assert (name in moving) != (f"{ActorKind(kind).name.lower()}_{name}" in shapes)
    assert any(str(shape).startswith("traffic_cone_") for shape in shapes)


def test_playback_opens_shortly_before_the_moment_and_pauses_there(
    drives: dict[str, StoredDrive], tmp_path: Path
) -> None:
    path = write_sumo_gui(drives["construction/0"], tmp_path, at_s=9.0)
    assert value(path, "begin") == f"{9.0 - BEFORE_S:.2f}"
    assert value(tmp_path / VIEW, "breakpoint") == "9.00"


def test_the_same_start_runs_in_plain_sumo(drives: dict[str, StoredDrive], tmp_path: Path) -> None:
    drive = drives["construction/0"]
    path = write_sumo_gui(drive, tmp_path)
    rows = simulated(path.with_name("rerun.sumocfg"))
    first = [row for row in rows if row[0] == 0.0]
    origin = NetworkIds.read(find_map(drive.scenario.map).ids).origin_m
    actors = drive.trace.actors.at(0)
    driving = {name for name, word in zip(drive.trace.actors.ids, drive.trace.actors.behaviour, strict=True) if word}
    places = np.array([(x_m, y_m) for _, _, x_m, y_m, _ in first])
    for row, name in enumerate(actors.ids):
        if name in driving:
            ahead_m = actors.length_m[row] / 2.0
            x_m = actors.x_m[row] + ahead_m * np.cos(actors.heading_rad[row]) - origin[0]
            y_m = actors.y_m[row] + ahead_m * np.sin(actors.heading_rad[row]) - origin[1]
            assert np.hypot(places[:, 0] - x_m, places[:, 1] - y_m).min() < 0.1


def test_the_lights_of_the_rerun_begin_where_those_of_the_drive_do(
    drives: dict[str, StoredDrive], tmp_path: Path
) -> None:
    """The one that the ego has just passed is green, whatever its program begins with."""
    drive = drives["jaywalker/0"]
    lights = libsumo.trafficlight
    with open_sumo_traffic(drive.scenario, drive.roads, seed=drive.row.seed):
        then = {light: lights.getRedYellowGreenState(light) for light in lights.getIDList()}
        begin = {light: lights.getAllProgramLogics(light)[0].phases[0].state for light in then}
    libsumo.start(["sumo", "-c", str(write_sumo_gui(drive, tmp_path).with_name("rerun.sumocfg"))])
    try:
        libsumo.simulationStep()
        assert {light: lights.getRedYellowGreenState(light) for light in then} == then != begin
    finally:
        libsumo.close()


@pytest.mark.slow
def test_the_folder_can_be_moved_and_equal_calls_write_equal_files(
    drives: dict[str, StoredDrive], tmp_path: Path
) -> None:
    for name in ("a", "b"):
        write_sumo_gui(drives["jaywalker/0"], tmp_path / name)
    for file in (tmp_path / "a").iterdir():
        assert file.read_bytes() == (tmp_path / "b" / file.name).read_bytes(), file.name
    shutil.move(tmp_path / "a", tmp_path / "there")
    assert simulated(tmp_path / "there" / "playback.sumocfg")
    for file in (tmp_path / "there").glob("*.*cfg"):
        assert str(tmp_path) not in file.read_text(encoding="utf-8")


def test_a_moment_outside_the_drive_and_a_folder_that_cannot_be_are_refused(
    drives: dict[str, StoredDrive], tmp_path: Path
) -> None:
    for at_s in (-0.1, 1000.0):
        with pytest.raises(InputError, match="the drive has 0 to"):
            write_sumo_gui(drives["jaywalker/0"], tmp_path, at_s=at_s)
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"cannot write .*; give another folder"):
        write_sumo_gui(drives["jaywalker/0"], tmp_path / "file" / "folder")


def test_an_ego_far_from_all_roads_is_said(drives: dict[str, StoredDrive], tmp_path: Path) -> None:
    drive = drives["jaywalker/0"]
    strayed = replace(drive.trace, ego=replace(drive.trace.ego, x_m=drive.trace.ego.x_m + 5000.0))
    with pytest.raises(InputError, match="the ego goes farther than 60 m from all lanes"):
        write_sumo_gui(replace(drive, trace=strayed), tmp_path, at_s=0.0)
