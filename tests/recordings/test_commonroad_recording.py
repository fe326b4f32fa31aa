"""The traffic of CommonRoad files: boxes, headings, steps, and what is left out."""

from __future__ import annotations

import math
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pyproj
import pytest
import shapely
import shapely.affinity
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_sumo.errors import InputError
from interplan_sumo.maps.importers.commonroad.reader import read_commonroad
from interplan_sumo.recordings.commonroad import read_commonroad_recording
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.frame import UNPLACED_ORIGIN_M
from interplan_sumo.world.geometry import wrap_angle
from interplan_sumo.world.recording import Recording
from tests.maps.commonroad_files import lanelet, location, points, rectangle, scenario, state, written
from tests.realdata import real

MERCATOR = "EPSG:3857"


def read(folder: Path, *parts: str, step_s: str = "0.1") -> Recording:
    return read_commonroad_recording(written(folder, scenario(*parts, step_s=step_s)))


def moving(id_: int, *states: str, kind: str = "car", shape: str | None = None) -> str:
    first, *rest = states
    initial = first.replace("<state>", "<initialState>").replace("</state>", "</initialState>")
    path = f"<trajectory>{''.join(rest)}</trajectory>" if rest else ""
    body = f"<type>{kind}</type>{rectangle() if shape is None else shape}{initial}{path}"
    return f'<dynamicObstacle id="{id_}">{body}</dynamicObstacle>'


def standing(id_: int, shape: str, heading: float = 0.0, kind: str = "car") -> str:
    initial = state(0, 0.0, 0.0, heading, None, tag="initialState")
    return f'<staticObstacle id="{id_}"><type>{kind}</type>{shape}{initial}</staticObstacle>'


def local(recording: Recording, track: int = 0) -> np.ndarray:
    """Poses of a track in the coordinates of its file."""
    return recording.tracks[track].poses - (*UNPLACED_ORIGIN_M, 0.0)


def test_initial_state_and_trajectory_make_one_track(tmp_path: Path) -> None:
    recording = read(tmp_path, moving(7, state(2, 0, 1, 0.5, 4.0), state(3, 1, 2, 0.6, 5.0)))
    (track,) = recording.tracks
    np.testing.assert_allclose(local(recording), [(0, 1, 0.5), (1, 2, 0.6)])
    np.testing.assert_allclose(track.velocity_mps[0], (4 * math.cos(0.5), 4 * math.sin(0.5)))
    assert (track.id, track.first_step, track.end_step, recording.steps) == ("7", 2, 4, 4)
    assert (track.length_m, track.width_m, recording.step_s, recording.ego_id) == (4.5, 1.8, 0.1, None)


def test_obstacles_of_2018b_tell_their_role_in_an_element(tmp_path: Path) -> None:
    initial = state(0, 3.0, 4.0, tag="initialState")
    parts = [
        f'<obstacle id="{i}"><role>{role}</role><type>car</type>{rectangle()}{initial}</obstacle>'
        for i, role in ((1, "dynamic"), (2, "static"))
    ]
    recording = read_commonroad_recording(written(tmp_path, scenario(*parts, version="2018b")))
    assert [track.velocity_mps.tolist() for track in recording.tracks] == [[[10.0, 0.0]], [[0.0, 0.0]]]


def test_an_interval_stands_for_its_middle_and_a_rectangle_for_its_centre(tmp_path: Path) -> None:
    center = "<rectangle><length>1</length><width>1</width><center><x>5.0</x><y>6.0</y></center></rectangle>"
    between = "<intervalStart>0.2</intervalStart><intervalEnd>0.4</intervalEnd>"
    text = state(0, 0, 0, 0.0, 10.0).replace("<orientation><exact>0.0</exact>", f"<orientation>{between}")
    text = text.replace(points([(0, 0)]), center)
    np.testing.assert_allclose(local(read(tmp_path, moving(1, text)))[0], (5.0, 6.0, 0.3))


def test_what_has_no_heading_heads_where_it_moves(tmp_path: Path) -> None:
    states = [state(k, 0.0, 2.0 * k, None, None) for k in range(3)]
    recording = read(tmp_path, moving(1, *states))
    np.testing.assert_allclose(local(recording)[:, 2], math.pi / 2)
    np.testing.assert_allclose(recording.tracks[0].velocity_mps, [(0.0, 20.0)] * 3, atol=1e-9)


def test_a_speed_without_a_heading_points_where_it_moves_and_one_that_stands_keeps_its_heading(tmp_path: Path) -> None:
    states = [state(0, 0, 0, None, 5.0), state(1, 0, -1, None, 5.0), state(2, 0, -1, None, 0.0)]
    recording = read(tmp_path, moving(1, *states))
    np.testing.assert_allclose(local(recording)[:, 2], -math.pi / 2)
    np.testing.assert_allclose(recording.tracks[0].velocity_mps[0], (0.0, -5.0), atol=1e-9)


def test_who_stands_at_first_without_a_heading_has_the_one_of_the_first_metres(tmp_path: Path) -> None:
    states = [
        state(step, 0.0, y, None, speed) for step, (y, speed) in enumerate(((0, 0.0), (0, None), (0, 0), (-2, 9)))
    ]
    states.append(state(4, 0.0, -4.0, None, 9.0))
    recording = read(tmp_path, moving(1, *states))
    np.testing.assert_allclose(local(recording)[:, 2], -math.pi / 2)


def test_two_components_of_velocity_give_the_heading_of_a_point_mass(tmp_path: Path) -> None:
    text = state(0, 0, 0, None, 3.0).replace("</state>", "<velocityY><exact>4.0</exact></velocityY></state>")
    recording = read(tmp_path, moving(1, text))
    assert local(recording)[0, 2] == pytest.approx(math.atan2(4.0, 3.0))
    np.testing.assert_allclose(recording.tracks[0].velocity_mps, [(3.0, 4.0)])


def test_a_gap_makes_two_tracks_and_a_repeated_step_none(tmp_path: Path) -> None:
    states = [state(step, 10.0 * i, 0.0) for i, step in enumerate((0, 1, 1, 2, 5, 6))]
    recording = read(tmp_path, moving(1, *states))
    assert [(track.id, track.first_step, len(track.poses)) for track in recording.tracks] == [
        ("1", 0, 3),
        ("1.2", 5, 2),
    ]
    assert local(recording)[1, 0] == 10.0


def test_a_static_obstacle_stands_through_the_whole_recording(tmp_path: Path) -> None:
    recording = read(tmp_path, moving(1, *(state(k, k, 0) for k in range(5))), standing(2, rectangle(), heading=1.0))
    assert recording.tracks[1].poses.shape == (5, 3)
    assert not recording.tracks[1].velocity_mps.any()


@settings(max_examples=10)
@given(st.floats(-3.0, 3.0), st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(-1.0, 1.0))
def test_a_box_that_lies_beside_its_reference_point_is_where_its_shape_is(
    heading: float, ahead: float, left: float, turn: float
) -> None:
    """The corners by two turns of the plane, one after the other."""
    inner = f"<orientation>{turn}</orientation><center><x>{ahead}</x><y>{left}</y></center>"
    with TemporaryDirectory() as folder:
        obstacle = moving(1, state(0, 10.0, 20.0, heading), shape=rectangle(4.0, 2.0, inner))
        pose = local(read(Path(folder), obstacle))[0]
    box = shapely.affinity.rotate(shapely.box(-2, -1, 2, 1), turn, (0, 0), use_radians=True)
    body = shapely.affinity.translate(box, ahead, left)
    there = shapely.affinity.translate(shapely.affinity.rotate(body, heading, (0, 0), use_radians=True), 10.0, 20.0)
    found = shapely.affinity.rotate(shapely.box(-2, -1, 2, 1), pose[2], (0, 0), use_radians=True)
    found = shapely.affinity.translate(found, pose[0], pose[1])
    assert found.symmetric_difference(there).area < 1e-6


TWO_BOXES = "".join(
    f"<rectangle><length>2</length><width>2</width><center><x>{x}</x><y>0</y></center></rectangle>" for x in (2, 5)
)


@pytest.mark.parametrize(
    ("shape", "ahead_m", "size_m"),
    [
        (f"<shape><polygon>{points([(-1, -1), (3, 0), (-1, 1)])}</polygon></shape>", 1.0, (4.0, 2.0)),
        (f"<shape>{TWO_BOXES}</shape>", 3.5, (5.0, 2.0)),
        (rectangle(inner="<originXShift>-1.5</originXShift>"), 1.5, (4.5, 1.8)),  # the rear axle
        ("<shape><circle><radius>0.4</radius></circle></shape>", 0.0, (0.8, 0.8)),
    ],
    ids=["polygon", "two boxes", "shifted origin", "circle"],
)
def test_what_moves_has_a_box_along_its_heading(
    shape: str, ahead_m: float, size_m: tuple[float, float], tmp_path: Path
) -> None:
    recording = read(tmp_path, moving(1, state(0, 0, 0, math.pi / 2), shape=shape))
    np.testing.assert_allclose(local(recording)[0], (0.0, ahead_m, math.pi / 2), atol=1e-9)
    assert (recording.tracks[0].length_m, recording.tracks[0].width_m) == pytest.approx(size_m)


def test_a_polygon_that_stands_gets_the_smallest_box(tmp_path: Path) -> None:
    """A wall at 45 degrees, 10 m long and 1 m thick."""
    ahead, aside = np.array([1.0, 1.0]) / math.sqrt(2.0), np.array([-1.0, 1.0]) / math.sqrt(2.0)
    ring = [tuple(5.0 * a * ahead + 0.5 * b * aside) for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    recording = read(tmp_path, standing(1, f"<shape><polygon>{points(ring)}</polygon></shape>", kind="roadBoundary"))
    track = recording.tracks[0]
    assert (track.length_m, track.width_m) == (pytest.approx(10.0), pytest.approx(1.0))
    assert wrap_angle(2.0 * (local(recording)[0, 2] - math.pi / 4)) == pytest.approx(0.0, abs=1e-6)
    assert track.kind == ActorKind.BARRIER


@pytest.mark.parametrize(
    ("type_", "kind", "model"),
    [
        ("car", ActorKind.VEHICLE, "car"),
        ("truck", ActorKind.VEHICLE, "truck"),
        ("bus", ActorKind.VEHICLE, "bus"),
        ("motorcycle", ActorKind.VEHICLE, "motorcycle"),
        ("bicycle", ActorKind.BICYCLE, "car"),
        ("pedestrian", ActorKind.PEDESTRIAN, "car"),
        ("constructionZone", ActorKind.BARRIER, "car"),
        ("hovercraft", ActorKind.GENERIC_OBJECT, "car"),
    ],
)
def test_a_type_tells_kind_and_model(type_: str, kind: ActorKind, model: str, tmp_path: Path) -> None:
    track = read(tmp_path, moving(1, state(0, 0, 0), kind=type_)).tracks[0]
    assert (track.kind, track.model) == (kind, model)


def test_tracks_and_lanes_lie_in_one_frame(tmp_path: Path) -> None:
    """A car on the middle of a lanelet stays on it in a frame of stretched metres."""
    to_mercator = pyproj.Transformer.from_crs("EPSG:4326", MERCATOR, always_xy=True)
    shift = to_mercator.transform(11.58, 48.14)
    states = (state(k, 10.0 * k, -1.75, 0.0, 100.0) for k in range(5))
    path = written(tmp_path, scenario(location(MERCATOR, shift), lanelet(1, (0.0, 50.0)), moving(2, *states)))
    lane, recording = read_commonroad(path).lanes["1"], read_commonroad_recording(path)
    assert recording.crs == "EPSG:32632"
    (track,) = recording.tracks
    middle = shapely.LineString((lane.left + lane.right) / 2.0)
    assert shapely.distance(shapely.points(track.poses[:, :2]), middle).max() < 1e-3
    along = np.diff(track.poses[:, :2], axis=0)
    np.testing.assert_allclose(along / recording.step_s, track.velocity_mps[:-1], rtol=1e-4)
    np.testing.assert_allclose(np.arctan2(along[:, 1], along[:, 0]), track.poses[:-1, 2], atol=1e-5)


def test_what_makes_no_track_is_noted(tmp_path: Path) -> None:
    areas = moving(1, state(0, 0, 0)).replace("</initialState>", "</initialState><occupancySet/>")
    shapeless = moving(2, state(0, 0, 0), shape="<shape/>")
    on_a_lanelet = moving(3, state(0, 0, 0).replace(points([(0, 0)]), '<lanelet ref="1"/>'))
    recording = read(tmp_path, areas, shapeless, on_a_lanelet, "<phantomObstacle/><environmentObstacle/>")
    assert recording.tracks == ()
    assert sum(note.startswith("Not read, ") for note in recording.notes) == 5


def test_a_planning_problem_is_a_note_and_no_track(tmp_path: Path) -> None:
    recording = read(
        tmp_path, f'<planningProblem id="5">{state(0, 1.0, 2.0, 0.5, 7.0, tag="initialState")}</planningProblem>'
    )
    assert recording.tracks == ()
    assert (
        "Planning problem 5 starts at step 0 at 500001.00, 1000002.00, heading 0.500 rad, 7.00 m/s." in recording.notes
    )


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        (moving(1, state(-1, 0, 0)), "dynamicObstacle 1: time is -1.0, expected a step between 0 and 36000"),
        (moving(1, state(0, 0, 0), shape=rectangle(0.0)), "the shape measures 0 x 1.8 m, which nothing does"),
        (moving(1, state(0, 0, 0, 0.0, 1001.0)), "it moves at more than 1000 m/s"),
        (moving(1, state(0, 0, 0)).replace("<x>0</x>", "<x>a</x>"), "x of position is 'a', expected a number"),
        (moving(1, state(0, 0, 0)) + moving(1, state(0, 0, 0)), "two obstacles have the id '1'"),
    ],
)
def test_an_obstacle_that_cannot_be_is_named(parts: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        read(tmp_path, parts)
    assert message in str(caught.value)
    assert str(tmp_path / "scenario.xml") in str(caught.value)


@pytest.mark.parametrize("step_s", ["", "0", "-0.1", "nan", "1e9"])
def test_a_time_step_that_cannot_be_is_named(step_s: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="timeStepSize is"):
        read(tmp_path, moving(1, state(0, 0, 0)), step_s=step_s)


@pytest.fixture(scope="module")
def lankershim() -> Recording:
    return read_commonroad_recording(real("commonroad", "USA_Lanker-1_1_T-1.xml"))


def test_real_cars_move_as_fast_as_they_say_and_where_they_head(lankershim: Recording) -> None:
    differences, errors_deg = [], []
    for track in lankershim.tracks:
        moved_mps = np.diff(track.poses[:, :2], axis=0) / lankershim.step_s
        differences.append(np.hypot(*moved_mps.T) - np.hypot(*track.velocity_mps.T)[1:])
        fast = np.hypot(*moved_mps.T) > 3.0
        turned = np.arctan2(moved_mps[:, 1], moved_mps[:, 0]) - track.poses[1:, 2]
        errors_deg.append(np.degrees(np.abs(wrap_angle(turned[fast]))))
    assert np.median(np.abs(np.concatenate(differences))) < 0.3
    assert np.median(np.concatenate(errors_deg)) < 3.0


def test_the_real_recording_has_what_its_publishers_put_in_on_the_lanes_of_the_same_file(lankershim: Recording) -> None:
    assert (len(lankershim.tracks), lankershim.steps) == (24, 41)  # the initial state and 40 more
    assert all(track.kind == ActorKind.VEHICLE for track in lankershim.tracks)
    source = read_commonroad(real("commonroad", "USA_Lanker-1_1_T-1.xml"))
    assert source.crs == lankershim.crs
    rings = [shapely.Polygon(np.concatenate((lane.left, lane.right[::-1]))) for lane in source.lanes.values()]
    ground = shapely.union_all(rings)
    poses = np.concatenate([track.poses for track in lankershim.tracks])
    assert len(poses) == 938
    assert shapely.contains_xy(ground, poses[:, :2]).mean() > 0.95
