"""Argoverse 2 sensor logs: boxes in the frame of the car become tracks in the frame of the city's map."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from interplan_sumo.errors import InputError
from interplan_sumo.recordings.argoverse2_sensor import (
    EGO_SIZE_M,
    REAR_AXLE_TO_CENTER_M,
    read_argoverse2_sensor_log,
)
from interplan_sumo.recordings.formats import format_of
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.argoverse_frame import city_frame
from tests.realdata import real

NORTH = {"qw": np.sqrt(0.5), "qx": 0.0, "qy": 0.0, "qz": np.sqrt(0.5)}
EAST = {"qw": 1.0, "qx": 0.0, "qy": 0.0, "qz": 0.0}


def boxes(**changed: object) -> pd.DataFrame:
    """A car 10 m ahead of one that measures."""
    row = {"track_uuid": "a", "category": "REGULAR_VEHICLE", "length_m": 4.0, "width_m": 2.0, **EAST, "tx_m": 10.0}
    return pd.DataFrame([row | {"timestamp_ns": 10**17 + step * 10**8, "ty_m": 2.0} | changed for step in range(3)])


def log(folder: Path, rows: pd.DataFrame) -> Path:
    """The one that measures heads north, a metre a step, from 100 m east of the city's origin."""
    poses = [{"timestamp_ns": 10**17 + n * 10**8, **NORTH, "tx_m": 100.0, "ty_m": float(n)} for n in range(3)]
    pd.DataFrame(poses).to_feather(folder / "city_SE3_egovehicle.feather")
    rows.to_feather(folder / "annotations.feather")
    (folder / "log_map_archive_0____PIT_city_1.json").write_text("{}")
    return folder


def test_boxes_go_from_the_car_s_frame_to_the_map_s(tmp_path: Path) -> None:
    found = read_argoverse2_sensor_log(log(tmp_path, boxes()))
    crs, (east_m, north_m) = city_frame("pittsburgh")
    car, _ = found.tracks
    assert found.crs == crs
    assert car.kind is ActorKind.VEHICLE
    expected = [[east_m + 98.0, north_m + 10.0 + step, np.pi / 2.0] for step in range(3)]
    assert car.poses == pytest.approx(np.array(expected), abs=1e-6)
    assert car.velocity_mps == pytest.approx(np.array([[0.0, 10.0]] * 3), abs=1e-5)


@pytest.mark.parametrize(
    ("category", "kind"),
    [("PEDESTRIAN", ActorKind.PEDESTRIAN), ("BICYCLIST", ActorKind.BICYCLE), ("BOLLARD", ActorKind.GENERIC_OBJECT),
     ("CONSTRUCTION_CONE", ActorKind.TRAFFIC_CONE), ("BOX_TRUCK", ActorKind.VEHICLE)],
)  # fmt: skip
def test_categories_become_kinds(category: str, kind: ActorKind, tmp_path: Path) -> None:
    one, _ = read_argoverse2_sensor_log(log(tmp_path, boxes(category=category))).tracks
    assert one.kind is kind


def ego_poses(steps: int = 3) -> list[list[float]]:
    """Middles of the car that measured, whose rear axle `log` places."""
    _, (east_m, north_m) = city_frame("pittsburgh")
    return [[east_m + 100.0, north_m + step + REAR_AXLE_TO_CENTER_M, np.pi / 2.0] for step in range(steps)]


def test_the_box_of_the_car_that_measured_lies_ahead_of_its_rear_axle(tmp_path: Path) -> None:
    own = boxes(track_uuid="me", category="EGO_VEHICLE", tx_m=0.0, ty_m=0.0)
    found = read_argoverse2_sensor_log(log(tmp_path, pd.concat([boxes(), own], ignore_index=True)))
    _, ego = found.tracks
    assert (found.ego_id, ego.id, ego.length_m) == ("me", "me", 4.0)
    assert ego.poses == pytest.approx(np.array(ego_poses()), abs=1e-6)


def test_where_no_box_is_of_the_car_that_measured_its_poses_are_its_track(tmp_path: Path) -> None:
    found = read_argoverse2_sensor_log(log(tmp_path, boxes()))
    _, ego = found.tracks
    assert (found.ego_id, ego.id, ego.kind) == ("ego", "ego", ActorKind.VEHICLE)
    assert (ego.length_m, ego.width_m) == EGO_SIZE_M
    assert ego.poses == pytest.approx(np.array(ego_poses()), abs=1e-6)
    assert any("leave out the car that measured" in note for note in found.notes)


def test_the_car_that_measured_is_there_while_nobody_is_seen(tmp_path: Path) -> None:
    seen = boxes()
    steps = seen["timestamp_ns"].rank(method="dense")
    found = read_argoverse2_sensor_log(log(tmp_path, seen[(steps == 1) | (steps == steps.max())]))
    ego = next(track for track in found.tracks if track.id == found.ego_id)
    assert ego.poses == pytest.approx(np.array(ego_poses()), abs=1e-6)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (boxes().drop(columns="qz"), "column qz is missing"),
        (boxes(tx_m=np.nan), "row 0 holds a number that cannot be"),
        (boxes(length_m=0.0), "row 0 holds a number that cannot be"),
        (boxes(timestamp_ns=7), "has no pose at 7 ns"),
    ],
)
def test_what_cannot_be_is_told(wrong: pd.DataFrame, said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=said):
        read_argoverse2_sensor_log(log(tmp_path, wrong))


def test_a_damaged_file_and_a_log_without_a_map_are_told(tmp_path: Path) -> None:
    folder = log(tmp_path, boxes())
    (folder / "log_map_archive_0____PIT_city_1.json").unlink()
    with pytest.raises(InputError, match="says which city it is in"):
        read_argoverse2_sensor_log(folder)
    (folder / "annotations.feather").write_bytes(b"no feather")
    with pytest.raises(InputError, match="cannot be read"):
        read_argoverse2_sensor_log(folder)


def test_of_several_files_of_boxes_one_is_named(tmp_path: Path) -> None:
    folder = log(tmp_path, boxes())
    shutil.copy(folder / "annotations.feather", folder / "annotations_with_ego.feather")
    with pytest.raises(InputError, match=r"holds annotations.feather, annotations_with_ego.feather; name one of them"):
        read_argoverse2_sensor_log(folder)
    assert read_argoverse2_sensor_log(folder / "annotations_with_ego.feather").tracks


def test_a_real_log_is_known_by_its_files_and_read() -> None:
    folder = real("argoverse2", "pit_71109")
    assert format_of(folder) == "argoverse2_sensor"
    found = read_argoverse2_sensor_log(folder)
    assert found.ego_id is not None
    assert sum(each.kind is ActorKind.VEHICLE for each in found.tracks) > 50
