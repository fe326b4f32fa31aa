"""Argoverse 2 scenarios: what becomes of their road users, and scenario files that cannot be used."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from interplan_sumo.maps.importers.argoverse2.reader import read_argoverse2
from interplan_sumo.recordings import argoverse2
from interplan_sumo.recordings.argoverse2 import TYPES, read_argoverse2_recording
from interplan_sumo.recordings.gaps import MAX_BRIDGED_STEPS
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.argoverse_frame import city_frame
from interplan_sumo.world.geometry import wrap_angle
from interplan_sumo.world.recording import Recording
from tests.maps.damaged import bytes_changed, cut, refusal, survive
from tests.realdata import real

NAME = "scenario_0123abcd-0000-4000-8000-000000000000.parquet"

THINGS = ("riderless_bicycle", "static", "background", "construction", "unknown")

Columns = dict[str, list[Any]]


def drive(id_: str, steps: Sequence[int], type_: str = "vehicle", speed_mps: float = 10.0) -> Columns:
    """Somebody who goes east at one speed, seen at some steps."""
    count = len(steps)
    return {
        "observed": [True] * count,
        "track_id": [id_] * count,
        "object_type": [type_] * count,
        "timestep": list(steps),
        "position_x": [speed_mps * 0.1 * step for step in steps],
        "position_y": [5.0] * count,
        "heading": [0.0] * count,
        "velocity_x": [speed_mps] * count,
        "velocity_y": [0.0] * count,
        "city": ["austin"] * count,
    }


def scene(*drives: Columns) -> Columns:
    """All of them in one table."""
    return {name: [value for one in drives for value in one[name]] for name in drives[0]}


def written(columns: Columns | pa.Table, folder: Path, name: str = NAME) -> Path:
    path = folder / name
    pq.write_table(columns if isinstance(columns, pa.Table) else pa.table(columns), path)
    return path


def read(columns: Columns, folder: Path) -> Recording:
    return read_argoverse2_recording(written(columns, folder))


def test_a_road_user_becomes_a_track_in_the_frame_of_the_city(tmp_path: Path) -> None:
    found = read(drive("7", range(3, 9)), tmp_path)
    (track,) = found.tracks
    crs, origin_m = city_frame("ATX")
    assert (found.name, found.crs, found.step_s, found.ego_id) == ("argoverse2-austin-0123abcd", crs, 0.1, None)
    assert (track.id, track.first_step, track.end_step, found.steps) == ("7", 3, 9, 9)
    assert_allclose(track.poses[:, :2] - origin_m, [(float(step), 5.0) for step in range(3, 9)], atol=1e-6)
    assert_allclose(track.velocity_mps, [(10.0, 0.0)] * 6)


def test_tracks_are_sorted_by_id_and_step_whatever_the_order_of_the_rows(tmp_path: Path) -> None:
    columns = scene(drive("b", range(4)), drive("AV", range(4)), drive("a", range(4)))
    order = np.random.default_rng(0).permutation(12)
    found = read({name: [values[row] for row in order] for name, values in columns.items()}, tmp_path)
    assert [track.id for track in found.tracks] == ["AV", "a", "b"]
    assert all((np.diff(track.poses[:, 0]) > 0.0).all() for track in found.tracks)
    assert found.ego_id == "AV"


@pytest.mark.parametrize(
    ("type_", "kind", "model"),
    [
        ("vehicle", ActorKind.VEHICLE, "car"),
        ("bus", ActorKind.VEHICLE, "bus"),
        ("motorcyclist", ActorKind.VEHICLE, "motorcycle"),
        ("cyclist", ActorKind.BICYCLE, "car"),
        ("pedestrian", ActorKind.PEDESTRIAN, "car"),
        *((thing, ActorKind.GENERIC_OBJECT, "car") for thing in THINGS),
    ],
)
def test_each_type_has_its_kind_and_size(type_: str, kind: ActorKind, model: str, tmp_path: Path) -> None:
    found = read(drive("7", range(4), type_), tmp_path)
    (track,) = found.tracks
    assert (track.kind, track.model) == (kind, model)
    assert (track.length_m, track.width_m) == (TYPES[type_].length_m, TYPES[type_].width_m)
    assert found.notes == (argoverse2.SIZES_NOTE,)


def test_a_type_that_nobody_knows_is_a_thing_with_a_note(tmp_path: Path) -> None:
    found = read(drive("7", range(4), "tram"), tmp_path)
    assert found.tracks[0].kind == ActorKind.GENERIC_OBJECT
    assert "unknown type tram" in found.notes[1]


@pytest.mark.parametrize(("missing", "parts"), [(MAX_BRIDGED_STEPS, 1), (MAX_BRIDGED_STEPS + 1, 2)])
def test_short_gaps_are_filled_and_long_ones_cut_the_track(missing: int, parts: int, tmp_path: Path) -> None:
    steps = [0, 1, 2, *range(3 + missing, 20)]
    found = read(drive("7", steps), tmp_path)
    assert [track.id for track in found.tracks] == ["7", "7~2"][:parts]
    assert sum(len(track.poses) for track in found.tracks) == (20 if parts == 1 else len(steps))
    assert ("filled" if parts == 1 else "cut") in found.notes[1]
    for track in found.tracks:
        at_m = track.poses[:, 0] - city_frame("ATX")[1][0]
        assert_allclose(at_m, np.arange(track.first_step, track.end_step), atol=1e-6)


def test_headings_are_filled_the_short_way_round(tmp_path: Path) -> None:
    columns = drive("7", [0, 2])
    columns["heading"] = [3.1, -3.1]
    (track,) = read(columns, tmp_path).tracks
    assert abs(wrap_angle(track.poses[1, 2] - np.pi)) < 1e-9
    assert (np.abs(track.poses[:, 2]) <= np.pi).all()


@pytest.mark.parametrize(("share", "noted"), [(0.85, True), (0.95, False)])
def test_positions_that_lag_behind_the_velocity_at_the_ends_are_noted(
    share: float, noted: bool, tmp_path: Path
) -> None:
    columns = drive("7", range(30))
    columns["velocity_x"] = [10.0 / share] * 30
    notes = read(columns, tmp_path).notes
    assert (f"advance by {share:.0%} of" in notes[-1]) is noted


@settings(max_examples=20)
@given(seen=st.sets(st.integers(0, 60), min_size=1))
def test_every_step_that_was_seen_is_in_one_track(seen: set[int], tmp_path_factory: pytest.TempPathFactory) -> None:
    found = read(drive("7", sorted(seen)), tmp_path_factory.mktemp("scenario"))
    covered = [step for track in found.tracks for step in range(track.first_step, track.end_step)]
    assert len(covered) == len(set(covered))
    assert seen <= set(covered)
    assert {track.first_step for track in found.tracks} <= seen


def test_a_folder_stands_for_the_one_scenario_in_it(tmp_path: Path) -> None:
    assert refusal(tmp_path / "scenario_1.parquet", read_argoverse2_recording).startswith("no recording at FILE")
    assert refusal(tmp_path, read_argoverse2_recording).startswith("FILE: holds no files scenario_*.parquet")
    written(drive("7", range(4)), tmp_path)
    assert len(read_argoverse2_recording(tmp_path).tracks) == 1
    written(drive("7", range(4)), tmp_path, "scenario_2.parquet")
    assert refusal(tmp_path, read_argoverse2_recording).startswith("FILE: holds 2 files")


@pytest.mark.parametrize("content", [b"", b"PAR1", b"PAR1" + bytes(100) + b"PAR1", b"{}", bytes(5000)])
def test_a_file_of_another_kind(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / NAME
    path.write_bytes(content)
    assert refusal(path, read_argoverse2_recording).startswith("FILE: not a Parquet file that can be read (")


@pytest.mark.parametrize("column", [*argoverse2.TEXTS, *argoverse2.NUMBERS])
def test_a_column_of_another_type_or_none_is_named(column: str, tmp_path: Path) -> None:
    columns = drive("7", range(4))
    is_text = column in argoverse2.TEXTS
    path = written(columns | {column: [1, 2, 3, 4] if is_text else ["1", "2", "3", "4"]}, tmp_path)
    held = "int64, expected text" if is_text else "string, expected numbers"
    assert refusal(path, read_argoverse2_recording) == f"FILE: column {column} holds {held}"
    del columns[column]
    assert refusal(written(columns, tmp_path), read_argoverse2_recording).startswith(
        f"FILE: column {column} is missing"
    )


def test_a_scenario_without_rows_or_of_a_city_that_argoverse_does_not_cover(tmp_path: Path) -> None:
    path = written(drive("7", range(4)) | {"city": ["gotham"] * 4}, tmp_path)
    assert refusal(path, read_argoverse2_recording).startswith("FILE: column city: no Argoverse city named 'gotham'.")
    table = pa.table(drive("7", range(4))).slice(0, 0)
    assert refusal(written(table, tmp_path), read_argoverse2_recording).startswith("FILE: has 0 rows, expected 1 to ")


def test_a_file_that_is_too_large(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(drive("7", range(4)), tmp_path)
    monkeypatch.setattr(argoverse2, "MAX_FILE_BYTES", path.stat().st_size)
    assert read_argoverse2_recording(path).tracks
    monkeypatch.setattr(argoverse2, "MAX_FILE_BYTES", path.stat().st_size - 1)
    assert refusal(path, read_argoverse2_recording).startswith("FILE: the file is larger than")
    monkeypatch.undo()
    monkeypatch.setattr(argoverse2, "MAX_ROWS", 3)
    assert refusal(path, read_argoverse2_recording) == "FILE: has 4 rows, expected 1 to 3"


def changed(column: str, row: int, value: Any) -> Callable[[Columns], None]:
    def change(columns: Columns) -> None:
        columns[column][row] = value

    return change


FAULTS: dict[str, tuple[Callable[[Columns], None], str]] = {
    "twice at a time": (changed("timestep", 2, 1), "track 7, timestep 1: appears twice"),
    "two types": (
        changed("object_type", 2, "bus"),
        "track 7, timestep 2: object_type is 'bus', before it was 'vehicle'",
    ),
    "no position": (changed("position_x", 2, None), "row 2: position_x is nan"),
    "infinite": (changed("velocity_y", 1, float("inf")), "row 1: velocity_y is inf"),
    "beyond the city": (
        changed("position_y", 1, -100_001.0),
        "track 7, timestep 1: position_x or position_y lies beyond 100000 m",
    ),
    "faster than anything": (changed("velocity_x", 1, 151.0), "track 7, timestep 1: its velocity is above 150 m/s"),
    "degrees": (changed("heading", 3, 180.0), "track 7, timestep 3: heading is not in radians"),
    "before the start": (changed("timestep", 0, -1), "row 0: timestep is -1, expected 0 to 35999"),
    "after an hour": (changed("timestep", 3, 36_000), "row 3: timestep is 36000, expected 0 to 35999"),
    "no id": (changed("track_id", 1, None), "row 1: track_id is None, expected a word"),
    "an id of two lines": (changed("track_id", 1, "7\n8"), r"row 1: track_id is '7\n8', expected a word"),
    "two cities": (changed("city", 1, "miami"), "column city names more than one city"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_rows_that_cannot_be_are_named(name: str, tmp_path: Path) -> None:
    change, message = FAULTS[name]
    columns = drive("7", range(4))
    change(columns)
    assert refusal(written(columns, tmp_path), read_argoverse2_recording) == f"FILE: {message}"


def test_damaged_files_are_read_or_refused_and_nothing_else(tmp_path: Path) -> None:
    path = written(scene(drive("AV", range(20)), drive("7", range(5, 25), "bus")), tmp_path)
    whole = path.read_bytes()

    def damage(path: Path, rng: np.random.Generator) -> None:
        path.write_bytes((cut if rng.random() < 0.1 else bytes_changed)(whole, rng))

    read, refused = survive(60, path, damage, [read_argoverse2_recording], lambda _: None)
    assert read > 0.02
    assert refused > 0.2


@pytest.fixture(scope="module")
def austin() -> Recording:
    return read_argoverse2_recording(real("argoverse2", "austin_0a1e6f0a"))


def test_the_real_scenario_has_what_its_publishers_put_in(austin: Recording) -> None:
    assert len(austin.tracks) == 58
    assert austin.steps == 110
    assert austin.ego_id == "AV"
    assert sum(len(track.poses) for track in austin.tracks) == 2434
    assert sum(track.kind == ActorKind.PEDESTRIAN for track in austin.tracks) == 12
    assert any("smoothed" in note for note in austin.notes)


def test_real_vehicles_move_on_imported_lanes(austin: Recording) -> None:
    """On drivable ground, that is: the recording reaches further than the map. Two cars are off the lanes there."""
    source = read_argoverse2(real("argoverse2", "austin_0a1e6f0a"))
    assert (source.name, source.crs) == (austin.name, austin.crs)
    lanes = [shapely.Polygon(np.concatenate((lane.left, lane.right[::-1]))) for lane in source.lanes.values()]
    poses = np.concatenate(
        [each.poses[np.hypot(*each.velocity_mps.T) > 1.0] for each in austin.tracks if each.kind == ActorKind.VEHICLE]
    )
    mapped = poses[shapely.contains_xy(shapely.union_all(source.drivable), poses[:, :2])]
    assert len(mapped) > 350
    assert shapely.contains_xy(shapely.union_all(lanes), mapped[:, :2]).mean() > 0.85
