"""Recordings as training data: a log of nuPlan gives samples of what the car that measured did."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from interplan_sumo.dataset.drives import DriveSelection
from interplan_sumo.dataset.export import ExportRequest, export
from interplan_sumo.dataset.reading import read_dataset
from interplan_sumo.dataset.recorded import Window, window_frames
from interplan_sumo.errors import InputError
from interplan_sumo.features.schema import BY_NAME, SITUATIONS, channel_index
from interplan_sumo.maps.store import find_map
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.trace import ActorTable, EgoTrack, Trace
from tests.maps.commonroad_files import rectangle, scenario, state, written
from tests.recordings.nuplan_dbs import MAP, X_M, Y_M, Goes, maps_root, write_log

EGO = Goes(X_M + 20.0, Y_M, 0.0, 8.0)  # its rear axle
LEADER = Goes(X_M + 45.0, Y_M, 0.0, 8.0)
WALKER = Goes(X_M + 150.0, Y_M - 8.0, 0.0, 0.0, "pedestrian", (0.8, 0.8))
RED = {13: dict.fromkeys(range(801), "red")}


@pytest.fixture
def maps(tmp_path: Path) -> Path:
    return maps_root(tmp_path)


def request(out: Path, maps: Path, *sources: Path, **choice: object) -> ExportRequest:
    return ExportRequest(
        out,
        recordings=sources,
        map=str(maps),
        workers=0,
        choice=DriveSelection(**choice),  # type: ignore[arg-type]
    )


def test_a_log_gives_samples_of_the_car_that_measured(tmp_path: Path, maps: Path) -> None:
    log = write_log(tmp_path / "drive.db", EGO, (LEADER, WALKER), lights=RED)  # 20 s
    manifest = export(request(tmp_path / "a", maps, log))
    dataset = read_dataset(tmp_path / "a")
    (drive,) = dataset.drives
    assert (drive.origin, drive.source, drive.planner, drive.score) == ("recording", "drive.db", "recorded", None)
    assert (drive.map, drive.route[:3]) == (MAP, ("1", "13", "7"))
    (batch,) = dataset.split("train").batches(1000)
    assert batch["tick"].tolist() == list(range(20, 121, 5))  # 2 s behind and 8 s ahead of each
    np.testing.assert_allclose(batch["origin"][0], (EGO.x_m + 16.0, EGO.y_m, 0.0), atol=0.02)
    steps = np.arange(1, 81)
    np.testing.assert_allclose(batch["ego_future"][:, :, 0] - 0.8 * steps, 0.0, atol=0.05)
    assert batch["ego_future"][..., 3].all()
    np.testing.assert_allclose(batch["ego_history"][..., channel_index("ego_history", "vx")], 8.0, atol=0.05)
    np.testing.assert_allclose(batch["ego_history"][..., channel_index("ego_history", "ax")], 0.0, atol=0.2)
    leader = batch["agents"][:, 0, :, :]
    np.testing.assert_allclose(leader[..., -1, 0], 25.0, atol=0.05)
    assert leader[..., 12].all()
    lights = batch["lanes"][..., channel_index("lanes", "light_red")]
    assert (lights.max(axis=(1, 2)) == 1.0).any()
    assert SITUATIONS[batch["situation"][0]] == "following"
    assert manifest.counts.by_planner == {"recorded": 21}
    assert PACIFICA.length_m == 5.176  # whose rear axle the log tells


def test_windows_of_a_long_log_do_not_share_samples(tmp_path: Path, maps: Path) -> None:
    slow = Goes(X_M + 20.0, Y_M, 0.0, 4.0)
    log = write_log(tmp_path / "drive.db", slow, (Goes(X_M + 60.0, Y_M, 0.0, 4.0),), frames=1001)  # 50 s
    export(request(tmp_path / "a", maps, log))
    dataset = read_dataset(tmp_path / "a")
    (batch,) = dataset.split("train").batches(1000)
    at_m = np.sort(batch["origin"][:, 0])
    assert len(dataset.drives) == 2
    np.testing.assert_allclose(np.diff(at_m), 2.0, atol=0.05)  # half a second each, without a gap or a repetition
    assert set(batch) >= set(BY_NAME)


@pytest.mark.parametrize(("at_s", "last"), [(None, 315), (0.0, 215), (40.0, 215)])
def test_a_recording_that_is_one_window_gives_samples_to_its_end(at_s: float | None, last: int) -> None:
    ego = EgoTrack.of([EgoState(0.1 * frame, 0.8 * frame, 0.0, 0.0, 8.0) for frame in range(400)])
    trace = Trace(ego, ActorTable.of([]), (), (), np.zeros(0))
    frames = window_frames(Window(Path("drive"), "any", at_s, find_map("strip")), trace, 5)
    assert (frames[0], frames[-1]) == (20, last)


def test_logs_of_a_folder_are_held_out_whole_and_a_car_off_the_lanes_is_left_out(tmp_path: Path, maps: Path) -> None:
    faster = Goes(EGO.x_m, EGO.y_m, 0.0, 9.0)
    astray = Goes(X_M + 20.0, Y_M + 60.0, 0.0, 8.0)
    (tmp_path / "logs").mkdir()
    driven = (("a.db", EGO), ("logs/b.db", faster), ("logs/c.db", astray))
    a, *_ = (write_log(tmp_path / name, ego, (LEADER,)) for name, ego in driven)
    manifest = export(request(tmp_path / "data", maps, a, tmp_path / "logs", holdout_seeds=(1,)))
    drives = read_dataset(tmp_path / "data").drives
    assert {(drive.source, drive.split) for drive in drives} == {("a.db", "train"), ("b.db", "val")}
    assert manifest.left_out == {"recorded off the lanes, or alone": 1}


def test_logs_are_numbered_through_folders_and_files(tmp_path: Path, maps: Path) -> None:
    (tmp_path / "logs").mkdir()
    goes = {name: Goes(EGO.x_m, EGO.y_m, 0.0, 7.0 + k) for k, name in enumerate(("logs/a.db", "logs/b.db", "c.db"))}
    *_, last = (write_log(tmp_path / name, ego, (LEADER,)) for name, ego in goes.items())
    export(request(tmp_path / "data", maps, tmp_path / "logs", last, holdout_seeds=(1,)))
    drives = read_dataset(tmp_path / "data").drives
    assert {(drive.source, drive.seed, drive.split) for drive in drives} == {
        ("a.db", 0, "train"), ("b.db", 1, "val"), ("c.db", 2, "train"),
    }  # fmt: skip


def test_a_recording_on_a_map_of_another_place_is_refused_with_the_reason(tmp_path: Path, maps: Path) -> None:
    log = write_log(tmp_path / "drive.db", EGO, (LEADER,))
    with closing(sqlite3.connect(log)) as tables, tables:
        tables.execute("UPDATE ego_pose SET epsg = 32611")
    with pytest.raises(InputError, match=r"drive.db is in EPSG:32611, map tiny-town in EPSG:32632; give the map"):
        export(request(tmp_path / "data", maps, log))


def test_a_recording_that_does_not_say_which_car_measured_is_refused_with_the_reason(
    tmp_path: Path, maps: Path
) -> None:
    car = f'<dynamicObstacle id="7"><type>car</type>{rectangle()}{state(0, 0, 0, 0.0, 4.0, tag="initialState")}'
    file = written(tmp_path, scenario(f"{car}</dynamicObstacle>"))
    with pytest.raises(InputError, match="does not say which car measured"):
        export(request(tmp_path / "data", maps / MAP / "9.1.1", file))


def test_recordings_need_a_map_and_the_error_says_so(tmp_path: Path, maps: Path) -> None:
    log = write_log(tmp_path / "drive.db", EGO, (LEADER,))
    with pytest.raises(InputError, match=r"no map for .*drive.db; give it with --map"):
        export(ExportRequest(tmp_path / "a", recordings=(log,), workers=0))
    config = tmp_path / "interplan.json"
    config.write_text(json.dumps({}))
    with pytest.raises(InputError, match="is no recording of a known format"):
        export(request(tmp_path / "a", maps, config))
    assert not (tmp_path / "a").exists()
