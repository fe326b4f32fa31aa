"""Reading recordings: the plain form, and those of the importers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from realdata import real

from interplan_sumo.errors import InputError
from interplan_sumo.realism.tracks import of_recording, open_recording, open_recordings, place_of, read_tracks
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.recording import RecordedTrack, Recording
from tests.maps.commonroad_files import rectangle, scenario, state
from tests.recordings.nuplan_dbs import Goes, track_id, write_log
from tests.recordings.test_argoverse2_recording import drive
from tests.recordings.test_argoverse2_recording import written as argoverse


def table(**changed: object) -> pd.DataFrame:
    """Two boxes of one vehicle, half a metre apart."""
    return pd.DataFrame(
        {
            "track": ["a", "a"], "type": ["veh", "veh"], "time_s": [0.0, 0.1], "x_m": [0.0, 0.5], "y_m": [0.0, 0.0],
            "heading_rad": [0.0, 0.0], "speed_mps": [5.0, np.nan], "length_m": [4.0, 5.0], "width_m": [2.0, 2.0],
        }
        | changed
    )  # fmt: skip


def written(folder: Path, rows: pd.DataFrame, name: str = "town_3.parquet") -> Path:
    rows.to_parquet(folder / name)
    return folder / name


def test_the_plain_form_is_read_as_it_stands(tmp_path: Path) -> None:
    found = read_tracks(written(tmp_path, table()))
    (only,) = found.tracks
    assert (found.name, found.place, only.id, only.kind) == ("town_3", "town", "a", "vehicle")
    assert only.x_m.tolist() == [0.0, 0.5]
    assert only.length_m == 4.5, "the middle of the recorded lengths"
    assert np.isnan(only.speed_mps[1])


def test_speeds_may_be_missing_altogether(tmp_path: Path) -> None:
    (only,) = read_tracks(written(tmp_path, table().drop(columns="speed_mps"))).tracks
    assert np.isnan(only.speed_mps).all()


def test_who_is_unseen_for_longer_than_half_a_second_is_another(tmp_path: Path) -> None:
    assert [each.id for each in read_tracks(written(tmp_path, table(time_s=[0.0, 0.5]))).tracks] == ["a"]
    assert [each.id for each in read_tracks(written(tmp_path, table(time_s=[0.0, 0.6]))).tracks] == ["a", "a~2"]


def test_of_two_boxes_at_one_time_the_first_is_kept(tmp_path: Path) -> None:
    (only,) = read_tracks(written(tmp_path, table(time_s=[0.1, 0.1]))).tracks
    assert only.x_m.tolist() == [0.0]


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"type": ["veh", "ghost"]}, "row 1, track 'a': type is not one of veh, ped, bike"),
        ({"type": ["veh", "ped"]}, "is of several types: ped, veh"),
        ({"x_m": [0.0, np.inf]}, "row 1, track 'a': x_m or y_m"),
        ({"length_m": [0.0, 4.0]}, "row 0, track 'a': length_m or width_m"),
        ({"time_s": ["now", "then"]}, "cannot be read as tracks"),
    ],
)
def test_what_cannot_be_is_told_by_row(tmp_path: Path, wrong: dict[str, object], said: str) -> None:
    with pytest.raises(InputError, match=said):
        read_tracks(written(tmp_path, table(**wrong)))


def test_what_is_no_recording_is_told_in_a_line(tmp_path: Path) -> None:
    other = tmp_path / "readme.txt"
    other.write_text("no tracks")
    with pytest.raises(InputError, match="is no recording: neither"):
        open_recording(other)
    with pytest.raises(InputError, match="is no file of tracks"):
        read_tracks(other)
    with pytest.raises(InputError, match="no such file"):
        open_recording(tmp_path / "nothing")


def test_a_folder_of_plain_files_is_all_of_them(tmp_path: Path) -> None:
    for name in ("b_1.parquet", "a_1.parquet"):
        written(tmp_path, table(), name)
    assert [each.name for each in open_recordings([tmp_path])] == ["a_1", "b_1"]


def test_nothing_in_a_folder_is_dropped_for_being_damaged_or_of_another_format(tmp_path: Path) -> None:
    written(tmp_path, table(), "a_1.parquet")
    car = f'<dynamicObstacle id="7"><type>car</type>{rectangle()}{state(0, 0, 0, tag="initialState")}</dynamicObstacle>'
    (tmp_path / "DEU_B-1_1_T-1.xml").write_text(scenario(car, name="DEU_B-1_1_T-1"))
    assert [each.name for each in open_recordings([tmp_path])] == ["DEU_B-1_1_T-1", "a_1"]
    for rows in (table().drop(columns="width_m"), pd.DataFrame()):
        written(tmp_path, rows, "b_1.parquet")
        with pytest.raises(InputError, match=r"b_1\.parquet"):
            open_recordings([tmp_path])
    (tmp_path / "b_1.parquet").write_bytes(b"cut")
    with pytest.raises(InputError, match=r"b_1\.parquet is no recording"):
        open_recordings([tmp_path])


def test_a_long_log_is_read_to_its_end_in_parts(tmp_path: Path) -> None:
    (tmp_path / "logs").mkdir()
    ego, other = Goes(0.0, 0.0, 0.0, 1.0), Goes(30.0, 0.0, 0.0, 1.0)
    log = write_log(tmp_path / "logs" / "drive.db", ego, (other,), frames=2 * 250 * 10 + 1)  # 250 s
    found = open_recordings([log])
    assert [each.name for each in found] == [f"drive from {at} s" for at in (0, 83, 167)]
    there = [track for each in found for track in each.tracks if track.id == track_id(0)]
    np.testing.assert_allclose([track.x_m[0] for track in there], (30.0, 30.0 + 250 / 3, 30.0 + 500 / 3), atol=0.06)
    assert there[-1].x_m[-1] == pytest.approx(280.0, abs=0.06)
    own = [track for each in found for track in each.tracks if track.id != track_id(0)]
    assert sum(len(track.x_m) for track in own) == sum(len(track.x_m) for track in there)  # nobody is seen twice
    assert [each.name for each in open_recordings([tmp_path])] == [each.name for each in found], "a folder of one log"


def test_a_folder_of_recordings_of_one_format_is_all_of_them(tmp_path: Path) -> None:
    for name in ("one", "other"):
        write_log(tmp_path / f"{name}.db", Goes(0.0, 0.0, 0.0, 5.0), frames=61)
    assert [each.name for each in open_recordings([tmp_path])] == ["one", "other"]


def test_a_folder_of_files_of_commonroad_is_all_of_them(tmp_path: Path) -> None:
    car = f'<dynamicObstacle id="7"><type>car</type>{rectangle()}{state(0, 0, 0, tag="initialState")}</dynamicObstacle>'
    for name in ("DEU_B-1_1_T-1", "DEU_A-1_1_T-1"):
        (tmp_path / f"{name}.xml").write_text(scenario(car, name=name))
    (tmp_path / "notes.txt").write_text("of no format")
    assert [each.name for each in open_recordings([tmp_path])] == ["DEU_A-1_1_T-1", "DEU_B-1_1_T-1"]


def test_a_folder_of_scenarios_of_argoverse_is_all_of_them(tmp_path: Path) -> None:
    for name in ("b", "a"):
        argoverse(drive("7", range(3, 9)), tmp_path, f"scenario_{name}.parquet")
    assert [each.name for each in open_recordings([tmp_path])] == ["argoverse2-austin-a", "argoverse2-austin-b"]


def test_things_of_an_imported_recording_are_left_out() -> None:
    def one(id_: str, kind: ActorKind) -> RecordedTrack:
        poses = np.array([[1.0, 2.0, 0.0], [1.5, 2.0, 0.0]])
        return RecordedTrack(id_, kind, 4.0, 2.0, 3, poses, np.full((2, 2), (3.0, 4.0)))

    found = of_recording(
        Recording("r", "EPSG:32611", 0.1, (one("car", ActorKind.VEHICLE), one("cone", ActorKind.TRAFFIC_CONE)))
    )
    (car,) = found.tracks
    assert car.time_s == pytest.approx([0.3, 0.4])
    assert car.speed_mps.tolist() == [5.0, 5.0]


def test_a_place_is_a_name_without_its_numbers() -> None:
    assert [place_of(name) for name in ("fzi_k729_03", "fzi_k733_2018", "main-street", "7")] == [
        "fzi_k729", "fzi_k733", "main-street", "7"
    ]  # fmt: skip


@pytest.mark.parametrize(
    "parts",
    [
        ("commonroad", "USA_Lanker-1_1_T-1.xml"),
        ("argoverse2", "austin_0a1e6f0a", "scenario_0a1e6f0a-1817-4a98-b02e-db8c9327d151.parquet"),
        ("tracks", "ngsim_lankershim_1.parquet"),
    ],
)
def test_recordings_of_others_hold_vehicles(parts: tuple[str, ...]) -> None:
    (found,) = open_recording(real(*parts))
    assert sum(each.kind == "vehicle" for each in found.tracks) > 10
