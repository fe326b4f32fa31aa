"""nuPlan's logs: what becomes of their road users and lights, and databases that cannot be used."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from interplan_sumo.errors import InputError, UnknownNameError
from interplan_sumo.recordings import nuplan_db
from interplan_sumo.recordings.gaps import MAX_BRIDGED_STEPS
from interplan_sumo.recordings.nuplan import read_nuplan_log
from interplan_sumo.recordings.nuplan_db import NuplanLog, tokens_held
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.recording import Recording
from interplan_sumo.world.signals import SignalStatus
from tests.maps.damaged import bytes_changed, cut, refusal, survive
from tests.recordings.nuplan_dbs import CATEGORIES, EPSG, Goes, sweep, track_id, write_log

EAST = Goes(100.0, 5.0, 0.0, 8.0)
EGO = Goes(0.0, 0.0, 0.0, 10.0)


def short_log(path: Path, ego: Goes, others: Iterable[Goes] = (), **more: Any) -> Path:
    """Of 10.5 s."""
    return write_log(path, ego, others, frames=211, **more)


def read(path: Path, at: int = 0, duration_s: float = 5.0) -> Recording:
    with NuplanLog(path) as log:
        return log.recording(log.moment(sweep(at)), duration_s)


def test_a_recording_begins_at_its_sweep_and_has_ten_steps_a_second(tmp_path: Path) -> None:
    found = read(short_log(tmp_path / "a.db", EGO, (EAST,)), at=40, duration_s=3.0)
    assert (found.name, found.crs, found.step_s, found.start_step, found.steps) == ("a", f"EPSG:{EPSG}", 0.1, 20, 51)
    assert found.ego_id == sweep(40)
    (car,) = (track for track in found.tracks if track.id != found.ego_id)
    assert (car.id, car.kind, car.first_step, car.end_step) == (track_id(0), ActorKind.VEHICLE, 20, 51)
    assert_allclose(car.poses[:, 0], 100.0 + 8.0 * (2.0 + 0.1 * np.arange(31)))
    assert_allclose(car.velocity_mps, [(8.0, 0.0)] * 31)


@pytest.mark.parametrize(("at", "start"), [(0, 0), (39, 0), (40, 20), (200, 20)])
def test_two_seconds_of_the_ego_come_before_the_moment_where_the_log_has_them(
    at: int, start: int, tmp_path: Path
) -> None:
    found = read(short_log(tmp_path / "a.db", EGO, (EAST,)), at=at)
    ego = next(track for track in found.tracks if track.id == found.ego_id)
    assert (found.start_step, ego.first_step) == (start, 0)
    ahead_m = PACIFICA.rear_axle_to_center_m
    assert ego.poses[start, 0] == pytest.approx(10.0 * 0.05 * at + ahead_m, abs=1e-3)
    assert next(track for track in found.tracks if track.id != found.ego_id).first_step == start


def test_a_hole_before_the_moment_costs_the_past_only(tmp_path: Path) -> None:
    found = read(short_log(tmp_path / "a.db", EGO, missing=range(50, 70)), at=80)
    (ego,) = found.tracks
    assert (ego.first_step, ego.end_step, found.notes) == (15, 71, ())


@pytest.mark.parametrize("heading_rad", [0.0, 2.0, -3.0, math.pi / 2])
def test_the_ego_is_moved_from_its_rear_axle_to_its_box_and_its_velocity_turned(
    heading_rad: float, tmp_path: Path
) -> None:
    found = read(short_log(tmp_path / "a.db", Goes(50.0, 20.0, heading_rad, 6.0)))
    (ego,) = found.tracks
    ahead_m = PACIFICA.rear_axle_to_center_m
    along = np.array((math.cos(heading_rad), math.sin(heading_rad)))
    assert_allclose(ego.poses[0], (*((50.0, 20.0) + ahead_m * along), heading_rad), atol=1e-9)
    assert_allclose(ego.velocity_mps[3], 6.0 * along, atol=1e-9)
    assert (ego.length_m, ego.width_m) == (PACIFICA.length_m, PACIFICA.width_m)


def test_each_category_has_its_kind(tmp_path: Path) -> None:
    others = [Goes(30.0 + 9.0 * k, 4.0, category=category) for k, category in enumerate(CATEGORIES)]
    found = read(short_log(tmp_path / "a.db", EGO, others))
    assert [track.kind for track in found.tracks[1:]] == [nuplan_db.KINDS[category] for category in CATEGORIES]
    assert found.notes == ()


def test_vehicles_are_told_apart_by_their_size(tmp_path: Path) -> None:
    sizes_m = ((6.49, 2.0), (6.5, 2.0), (9.99, 2.5), (10.0, 2.5), (2.79, 1.19), (2.79, 1.2), (2.8, 1.19))
    others = [Goes(30.0 + 20.0 * k, 4.0, size_m=size_m) for k, size_m in enumerate(sizes_m)]
    found = read(short_log(tmp_path / "a.db", EGO, others))
    assert [track.model for track in found.tracks[1:]] == ["car", "truck", "truck", "bus", "motorcycle", "car", "car"]


def test_an_unknown_category_is_a_thing_with_a_note(tmp_path: Path) -> None:
    change = "UPDATE category SET name = 'tram' WHERE name = 'vehicle'"
    found = read(short_log(tmp_path / "a.db", EGO, (EAST,), change=(change,)))
    assert found.tracks[1].kind is ActorKind.GENERIC_OBJECT
    assert "unknown category tram" in found.notes[0]


@pytest.mark.parametrize(("missing", "parts"), [(MAX_BRIDGED_STEPS, 1), (MAX_BRIDGED_STEPS + 1, 2)])
def test_short_gaps_are_filled_and_long_ones_cut_the_track(missing: int, parts: int, tmp_path: Path) -> None:
    frames = [frame for frame in range(101) if not 20 < frame < 22 + 2 * missing]
    found = read(write_log(tmp_path / "a.db", EGO, (Goes(100.0, 5.0, 0.0, 8.0, frames=frames),)))
    others = [track for track in found.tracks if track.id != found.ego_id]
    assert [track.id for track in others] == [track_id(0), f"{track_id(0)}~2"][:parts]
    assert ("filled" if parts == 1 else "cut") in found.notes[0]
    for track in others:
        assert_allclose(track.poses[:, 0], 100.0 + 0.8 * np.arange(track.first_step, track.end_step))


def test_a_log_with_a_long_hole_ends_there_and_says_so(tmp_path: Path) -> None:
    found = read(short_log(tmp_path / "a.db", EGO, missing=range(41, 60)))
    (ego,) = found.tracks
    assert ego.end_step == 21
    assert found.notes == ("The log has a hole after 2.0 s; the recording ends there.",)


def test_single_missing_sweeps_change_nothing(tmp_path: Path) -> None:
    whole = read(short_log(tmp_path / "a.db", EGO, (EAST,)))
    thinned = read(short_log(tmp_path / "b.db", EGO, (EAST,), missing=range(1, 101, 2)))
    for one, other in zip(whole.tracks, thinned.tracks, strict=True):
        assert_allclose(one.poses, other.poses)


def test_missing_velocities_are_taken_from_the_positions_and_things_stand_whatever_theirs_do(tmp_path: Path) -> None:
    cone = Goes(30.0, 4.0, 0.0, 1.0, "traffic_cone", (0.4, 0.4))
    change = "UPDATE lidar_box SET vx = NULL, vy = NULL"
    found = read(short_log(tmp_path / "a.db", EGO, (EAST, cone), change=(change,)))
    assert_allclose(found.tracks[1].velocity_mps, [(8.0, 0.0)] * 51, atol=1e-9)
    assert_allclose(found.tracks[2].velocity_mps, 0.0)
    assert "51 boxes have no velocity" in found.notes[0]


def test_sizes_that_change_from_sweep_to_sweep_are_replaced_by_their_median(tmp_path: Path) -> None:
    path = short_log(tmp_path / "a.db", EGO, (EAST,), change=("UPDATE lidar_box SET length = 9.9 WHERE x < 108",))
    assert read(path).tracks[1].length_m == 4.6


def test_chains_of_tokens_that_run_in_circles_are_not_followed(tmp_path: Path) -> None:
    circles = ("UPDATE lidar_pc SET next_token = token, prev_token = token", "UPDATE lidar_box SET next_token = token")
    spoiled = read(short_log(tmp_path / "a.db", EGO, (EAST,), change=circles))
    assert_allclose(spoiled.tracks[1].poses, read(short_log(tmp_path / "b.db", EGO, (EAST,))).tracks[1].poses)


def test_the_system_of_a_known_city_counts_whatever_the_log_says(tmp_path: Path) -> None:
    found = read(short_log(tmp_path / "a.db", EGO, map_name="us-nv-las-vegas-strip"))
    assert found.crs == "EPSG:32611"
    assert "The log says that its poses are in EPSG:32632" in found.notes[0]


def test_lights_are_known_where_they_were_listed_and_unknown_elsewhere(tmp_path: Path) -> None:
    listed = {frame: "red" if frame < 50 else "green" for frame in range(20, 80)}
    found = read(short_log(tmp_path / "a.db", EGO, lights={13: listed, 24: {0: "unknown"}}))
    assert list(found.lights) == ["13", "24"]
    shown = [SignalStatus(code).name for code in found.lights["13"]]
    assert shown == ["UNKNOWN"] * 10 + ["RED"] * 15 + ["GREEN"] * 15 + ["UNKNOWN"] * 11
    assert (found.lights["24"] == SignalStatus.UNKNOWN).all()


def test_a_step_without_a_sweep_shows_what_the_one_before_did(tmp_path: Path) -> None:
    listed = dict.fromkeys(range(101), "red")
    found = read(short_log(tmp_path / "a.db", EGO, lights={13: listed}, missing=(39, 40, 41), change=(
        "DELETE FROM traffic_light_status WHERE lidar_pc_token NOT IN (SELECT token FROM lidar_pc)",)))  # fmt: skip
    assert (found.lights["13"] == SignalStatus.RED).all()


def test_moments_are_found_by_token_tag_and_time(tmp_path: Path) -> None:
    path = short_log(tmp_path / "a.db", EGO, tags={60: "near_multiple_vehicles", 20: "near_multiple_vehicles"})
    with NuplanLog(path) as log:
        assert [m.token for m in log.moments_tagged("near_multiple_vehicles")] == [sweep(20), sweep(60)]
        assert log.moment(sweep(20).upper()).at_s == pytest.approx(1.0, abs=1e-3)
        assert log.moment_at(2.01).token == sweep(40)
    assert tokens_held(path, (sweep(20), "00" * 8, "2d62-s0")) == {sweep(20)}


def test_moments_that_are_not_there_are_one_line(tmp_path: Path) -> None:
    path = short_log(tmp_path / "a.db", EGO, tags={20: "near_multiple_vehicles"})
    with NuplanLog(path) as log:
        with pytest.raises(InputError, match="there is no lidar_pc 0000000000000000; the token belongs to another log"):
            log.moment("00" * 8)
        with pytest.raises(InputError, match="'2d62-s0' is none of nuPlan's, expected 16 hexadecimal digits"):
            log.moment("2d62-s0")
        with pytest.raises(UnknownNameError, match="Did you mean 'near_multiple_vehicles'"):
            log.moments_tagged("near_multiple_vehicle")
        with pytest.raises(InputError, match=r"the log lasts from 0 to 10\.5 s, there is nothing at 21 s"):
            log.moment_at(21.0)
        with pytest.raises(InputError, match="duration is 0 s"):
            log.recording(log.moment(sweep(0)), 0.0)


@pytest.mark.parametrize("content", [b"", b"SQLite", b"PAR1" * 9])
def test_what_is_no_database_is_one_line(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.db"
    path.write_bytes(content)
    with pytest.raises(InputError, match="is no SQLite database"):
        NuplanLog(path)
    with pytest.raises(InputError, match="cannot read"):
        NuplanLog(tmp_path / "nowhere.db")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("DROP TABLE traffic_light_status", "there is no table traffic_light_status; it is no log of nuPlan"),
        ("DROP TABLE category; CREATE VIEW category AS SELECT token, 'vehicle' AS name FROM track",
         "there is no table category"),
        ("ALTER TABLE lidar_box DROP COLUMN yaw", "table lidar_box has no column yaw"),
        ("DELETE FROM log", "log has 0 rows, expected one"),
        ("DELETE FROM lidar_pc", "lidar_pc is empty"),
        ("UPDATE log SET map_version = '../../etc'", "map_version is '../../etc', expected a name"),
        ("UPDATE log SET map_version = NULL", "log: map_version of row 1 is NULL, expected text"),
        ("UPDATE lidar_pc SET token = x'0102' WHERE timestamp = (SELECT MAX(timestamp) FROM lidar_pc)",
         "lidar_pc: token of row 101 is a blob of 2 bytes, expected a blob of 8 bytes"),
        ("UPDATE lidar_pc SET timestamp = 'now'", "timestamp of row 1 is 'now', expected a whole number"),
        ("UPDATE ego_pose SET x = NULL", "ego_pose: x of row 1 is NULL, expected a number"),
        ("UPDATE ego_pose SET qw = 0, qz = 0", "are no rotation"),
        ("UPDATE ego_pose SET epsg = 32633 WHERE x > 10", "epsg is both 32632 and 32633"),
        ("DELETE FROM ego_pose", "has no ego_pose"),
        ("UPDATE lidar_box SET yaw = NULL", "lidar_box: yaw of row 1 is NULL"),
        ("UPDATE lidar_box SET x = 'east'", "x of row 1 is 'east', expected a number"),
        ("UPDATE lidar_box SET x = 9e999", "x of row 1 is inf, expected a number"),
        ("UPDATE lidar_box SET x = 1e9", "lies beyond"),
        ("UPDATE lidar_box SET length = 0", "measures 0 x 1.85 m, which nothing does"),
        ("UPDATE lidar_box SET vx = 200", "moves at more than 150 m/s"),
        ("UPDATE lidar_box SET track_token = x'07'", "is a blob of 1 bytes"),
        ("DELETE FROM track", "which has no row in track"),
        ("UPDATE track SET category_token = token", "which has no row in track, or no category"),
        ("INSERT INTO lidar_box SELECT x'0000000000000001', lidar_pc_token, track_token, NULL, NULL, x, y, z, width, "
         "length, height, vx, vy, vz, yaw, confidence FROM lidar_box WHERE x < 100.1", "is twice in one sweep"),
        ("INSERT INTO traffic_light_status SELECT token, token, 'x', 'red' FROM lidar_pc",
         "lane_connector_id of row 1 is 'x', expected a whole number"),
    ],
)  # fmt: skip
def test_what_is_no_log_or_cannot_be_is_refused(change: str, said: str, tmp_path: Path) -> None:
    path = write_log(tmp_path / "a.db", EGO, (EAST,), frames=101, change=change.split(";"))
    assert said in refusal(path, read)


def test_a_flood_of_boxes_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = short_log(tmp_path / "a.db", EGO, (EAST,))
    monkeypatch.setattr(nuplan_db, "MOST_BOXES", 51)
    assert len(read(path).tracks) == 2
    monkeypatch.setattr(nuplan_db, "MOST_BOXES", 50)
    with pytest.raises(InputError, match="lidar_box has more than 50 rows in 51 sweeps"):
        read(path)


def test_a_folder_stands_for_the_only_log_in_it(tmp_path: Path) -> None:
    short_log(tmp_path / "a.db", EGO, [EAST])
    assert len(read_nuplan_log(tmp_path)) == 1
    short_log(tmp_path / "b.db", EGO, [EAST])
    with pytest.raises(InputError, match=r"holds 2 logs; name one of them, such as .*a\.db"):
        read_nuplan_log(tmp_path)


def test_a_log_is_read_without_touching_its_folder(tmp_path: Path) -> None:
    path = short_log(tmp_path / "a.db", EGO, (EAST,))
    before = path.read_bytes()
    tmp_path.chmod(0o500)
    try:
        read(path)
    finally:
        tmp_path.chmod(0o700)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["a.db"]


def test_damaged_files_are_read_or_refused_and_nothing_else(tmp_path: Path) -> None:
    whole = write_log(tmp_path / "a.db", EGO, (EAST,), frames=41).read_bytes()

    def damage(path: Path, rng: np.random.Generator) -> None:
        path.write_bytes((bytes_changed, cut)[int(rng.integers(2))](whole, rng))

    _, refused = survive(20, tmp_path / "b.db", damage, [lambda path: read(path, duration_s=1.0)], lambda _: None)
    assert refused > 0.3


def test_an_attached_journal_is_not_replayed(tmp_path: Path) -> None:
    path = short_log(tmp_path / "a.db", EGO, (EAST,))
    (tmp_path / "a.db-journal").write_bytes(b"junk")
    assert len(read(path).tracks) == 2
