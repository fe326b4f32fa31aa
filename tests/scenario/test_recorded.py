"""Scenes from recordings: start, route and goal of the ego, who surrounds it, and what is said of the rest."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_sumo.errors import ScenarioError, UnknownNameError
from interplan_sumo.scenario.recorded import END_M, ON_LANE_M, RecordedScene, replayed_track, scene
from interplan_sumo.scenario.scenario import LanePosition
from interplan_sumo.tiny_worlds import junction, straight_road
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.recording import RecordedTrack, Recording
from tests.scenario.made_recordings import drives, poses_along, recording, stands, track, turn_through

ROADS = straight_road(lanes=2, length_m=400.0, cuts_m=((100.0, 110.0),))
"""Lanes 11 and 12, connectors 21 and 22, lanes 31 and 32."""


def made(*others: RecordedTrack, **options: object) -> RecordedScene:
    """A scene on `ROADS`, the ego at x = 20 m on the left lane at 10 m/s for 5 s."""
    return scene(recording(drives("ego", 20.0, 0.0, 10.0, steps=51), *others), ROADS, **options)  # type: ignore[arg-type]


def reasons(found: RecordedScene) -> dict[str, str]:
    return dict(found.left_out)


# --- the ego -------------------------------------------------------------------------------------


def test_the_ego_begins_where_the_recorded_car_was() -> None:
    scenario = made(at_s=2.0).scenario
    assert scenario.start == LanePosition("11", 40.0)
    assert scenario.start_speed_mps == pytest.approx(10.0)
    assert (scenario.map, scenario.family) == ("tiny_road", "recorded")


@pytest.mark.parametrize(("left_m", "start_m"), [(0.98, 0.98), (-1.02, -ON_LANE_M)])
def test_it_keeps_its_place_beside_the_centre_line_as_far_as_it_stays_in_its_lane(
    left_m: float, start_m: float
) -> None:
    found = scene(recording(drives("ego", 20.0, left_m, 10.0)), ROADS)
    assert found.scenario.start.left_m == start_m


def test_a_short_track_is_extended_straight_on_and_that_is_said() -> None:
    found = made()
    assert found.scenario.route == ("1", "2", "3")
    assert found.scenario.goal == LanePosition("31", 60.0)  # 20 + 150 - 110
    assert found.notes == ("the track shows 50 m of the way, the goal lies 150 m ahead: straight on",)


@pytest.mark.parametrize(
    ("goal_m", "goal", "note"),
    [
        (49.0, LanePosition("11", 70.0), ""),  # the end of the track, which is farther
        (60.0, LanePosition("11", 80.0), "straight on"),
        (85.0, LanePosition("31", END_M), "straight on"),  # not inside a junction
        (1000.0, LanePosition("31", 290.0 - END_M), "the roads end before 1000 m"),
    ],
)
def test_the_goal_lies_as_far_as_is_wished_on_a_lane_and_off_the_end_of_the_roads(
    goal_m: float, goal: LanePosition, note: str
) -> None:
    found = made(goal_m=goal_m)
    assert found.scenario.goal == goal
    assert note in " ".join(found.notes)
    assert found.scenario.route == (("1",) if goal.lane == "11" else ("1", "2", "3"))


@pytest.mark.parametrize(
    ("steps", "goal"),
    [
        (51, LanePosition("11", 60.0)),  # 40 of 50 m from x = 20 m
        (107, LanePosition("11", 100.0)),  # inside a junction: at the end of the lane before it
        (131, LanePosition("31", 14.0)),
        (16, LanePosition("31", 60.0)),  # so near it would be no goal
    ],
)
def test_where_everyone_is_replayed_the_goal_is_where_the_recorded_car_came(steps: int, goal: LanePosition) -> None:
    log = recording(drives("ego", 20.0, 0.0, 10.0, steps=steps), stands("a", 60.0, 8.0, steps=steps))
    assert scene(log, ROADS, agents="replayed").scenario.goal == goal
    assert scene(log, ROADS, agents="replayed", goal_m=150.0).scenario.goal == LanePosition("31", 60.0)
    assert scene(log, ROADS, agents="sumo").scenario.goal == LanePosition("31", 60.0)


def test_a_shorter_drive_has_a_nearer_goal() -> None:
    log = recording(drives("ego", 20.0, 0.0, 10.0, steps=131), stands("a", 60.0, 8.0, steps=131))
    assert scene(log, ROADS, agents="replayed", duration_s=5.0).scenario.goal == LanePosition("11", 60.0)


@pytest.mark.parametrize(("stub_m", "goal"), [(4.0, LanePosition("11", 95.0 - 1e-3)), (8.0, LanePosition("31", 3.0))])
def test_the_goal_lies_5_m_before_the_edge_of_the_map_also_where_its_last_lane_is_a_stub(
    stub_m: float, goal: LanePosition
) -> None:
    roads = straight_road(length_m=100.0 + stub_m, cuts_m=((95.0, 100.0),))
    found = scene(recording(drives("ego", 20.0, 0.0, 10.0)), roads).scenario.goal
    assert found.lane == goal.lane
    assert found.arc_m == pytest.approx(goal.arc_m, abs=0.01)


def test_the_route_follows_a_lane_change_and_a_turn() -> None:
    ego = track("ego", poses_along(((20.0, 0.0), (40.0, 0.0), (60.0, -3.5), (200.0, -3.5)), 10.0, 90))
    found = scene(recording(ego), ROADS)
    assert (found.scenario.start.lane, found.scenario.goal.lane) == ("11", "32")
    crossing = junction()
    left = next(c for c in crossing.connectors.values() if c.turn.name == "LEFT")
    found = scene(recording(track("ego", turn_through(crossing, left.id)[20:])), crossing)
    assert found.scenario.route == crossing.route_through((left.from_lane_id, left.id, left.to_lane_id))
    assert found.scenario.goal.lane == left.to_lane_id


def test_a_track_that_leaves_the_lanes_is_followed_up_to_there() -> None:
    ego = track("ego", poses_along(((20.0, 0.0), (60.0, 0.0), (60.0, 60.0)), 10.0, 90))
    found = scene(recording(ego), ROADS)
    assert found.scenario.route == ("1", "2", "3")
    assert "leaves the lanes after" in found.notes[0]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"at_s": 5.1}, "lasts from 0 to 5 s, there is no scene at 5.1 s"),
        ({"at_s": float("nan")}, "there is no scene at nan s"),
        ({"goal_m": 5.0}, "goal_m is 5.0, expected more than the ego's length"),
        ({"agents": "replayed", "at_s": 4.5}, "0.5 s are left, expected 1 s or more"),
        ({"duration_s": 0.5}, "0.5 s are left"),
        ({"agents": "replayed"}, "shows nobody but the ego"),
    ],
)
def test_what_cannot_be_a_scene_is_one_line(options: dict[str, object], said: str) -> None:
    with pytest.raises(ScenarioError, match=r"made|goal_m") as error:
        made(**options)  # type: ignore[arg-type]
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_the_ego_must_be_a_vehicle_that_is_there() -> None:
    walker = stands("7", 30.0, 8.0, kind=ActorKind.PEDESTRIAN)
    late = drives("9", 30.0, 0.0, 5.0, first_step=20)
    nameless = recording(drives("8", 20.0, 0.0, 10.0), late, walker, ego_id=None)
    with pytest.raises(ScenarioError, match=r"name a track with --ego, such as .* farthest: 8, 9"):
        scene(nameless, ROADS)
    with pytest.raises(UnknownNameError, match="no vehicle track named '7'"):
        scene(nameless, ROADS, ego_id="7")
    with pytest.raises(ScenarioError, match=r"track 9 is there from 2\.0 to 6\.9 s, not at 1\.0 s"):
        scene(nameless, ROADS, ego_id="9", at_s=1.0)
    assert scene(nameless, ROADS, ego_id="9", at_s=2.0).scenario.start.arc_m == 30.0
    with pytest.raises(ScenarioError, match=r"track 8 is on no lane of map tiny_road at 0 s"):
        scene(recording(drives("8", 20.0, 50.0, 10.0)), ROADS, ego_id="8")


@pytest.mark.parametrize(
    ("log", "said"),
    [
        (recording(drives("ego", 20.0, 0.0, 10.0), crs="EPSG:32611"), "is in EPSG:32611, map tiny_road in EPSG:32632"),
        (recording(stands("ego", 391.0, 0.0)), r"the roads end .* m ahead of track ego"),
    ],
)
def test_a_recording_of_another_frame_or_at_the_end_of_the_roads_is_refused(log: Recording, said: str) -> None:
    with pytest.raises(ScenarioError, match=said):
        scene(log, ROADS)


# --- replayed ------------------------------------------------------------------------------------


def test_everyone_who_is_there_meanwhile_is_replayed_and_the_rest_is_named() -> None:
    found = made(
        drives("a", 50.0, 0.0, 10.0, steps=51),
        drives("b", 60.0, -3.5, 10.0, steps=10),
        stands("c", 70.0, 6.0, steps=21, first_step=30, kind=ActorKind.PEDESTRIAN, size_m=(0.5, 0.5)),
        agents="replayed",
        at_s=1.0,
    )
    scenario = found.scenario
    assert reasons(found) == {"b": "it was gone before"}
    assert [(each.id, each.kind, each.first_step, len(each.x_m)) for each in scenario.replayed] == [
        ("a", "vehicle", 0, 41),
        ("c", "pedestrian", 20, 21),
    ]
    assert scenario.replayed[0].x_m[:3] == (60.0, 61.0, 62.0)
    assert scenario.duration_s == 4.0
    assert not scenario.vehicles


def test_a_shorter_duration_leaves_out_those_who_come_later() -> None:
    others = drives("a", 50.0, 0.0, 10.0, steps=51), stands("c", 70.0, 6.0, steps=10, first_step=40)
    found = made(*others, agents="replayed", duration_s=3.9)
    assert reasons(found) == {"c": "it appears only after the end"}
    assert reasons(made(*others, agents="replayed", duration_s=4.0)) == {}


@settings(max_examples=40)
@given(step_s=st.sampled_from((0.04, 0.1, 0.2, 0.5)), start=st.integers(0, 20), first=st.integers(0, 20))
def test_other_steps_are_interpolated_on_the_straight_line_that_was_driven(
    step_s: float, start: int, first: int
) -> None:
    steps = 30
    at_s = step_s * (first + np.arange(steps))
    poses = np.array([(10.0 * each_s, 0.0, 0.0) for each_s in at_s])
    recorded = RecordedTrack("a", ActorKind.VEHICLE, 4.6, 1.85, first, poses, np.tile((10.0, 0.0), (steps, 1)))
    found = replayed_track(recorded, step_s, start, 200)
    if isinstance(found, str):
        assert first + steps - 1 < start
        return
    times_s = start * step_s + 0.1 * (found.first_step + np.arange(len(found.x_m)))
    np.testing.assert_allclose(found.x_m, 10.0 * times_s, atol=1e-3)
    assert at_s[0] - 1e-6 <= times_s[0]
    assert times_s[-1] <= at_s[-1] + 1e-6
    assert set(found.vx_mps) == {10.0}


def test_headings_are_interpolated_the_short_way_round() -> None:
    poses = np.array(((0.0, 0.0, np.pi - 0.1), (1.0, 0.0, -np.pi + 0.1)))
    recorded = RecordedTrack("a", ActorKind.BICYCLE, 1.8, 0.6, 0, poses, np.zeros((2, 2)))
    found = replayed_track(recorded, 0.2, 0, 10)
    assert not isinstance(found, str)
    assert np.abs(found.heading_rad) == pytest.approx((np.pi - 0.1, np.pi, np.pi - 0.1), abs=1e-4)
    assert found.kind == "bicycle"


# --- driven by SUMO ------------------------------------------------------------------------------


def sumo(*others: RecordedTrack, **options: object) -> RecordedScene:
    return made(*others, agents="sumo", **options)


def test_those_in_lanes_become_vehicles_on_the_centre_line() -> None:
    found = sumo(
        drives("a", 45.0, 0.4, 8.0),
        drives("b", 60.0, -3.2, 8.0, model="truck", size_m=(9.0, 2.5)),
        stands("c", 70.0, 0.5),
    )
    assert [(v.place.lane, v.place.arc_m, v.place.left_m, v.speed_mps, v.kind) for v in found.scenario.vehicles] == [
        ("11", 45.0, 0.0, 8.0, "car"),
        ("12", 60.0, 0.0, 8.0, "truck"),
        ("11", 70.0, 0.0, 0.0, "car"),
    ]
    assert found.left_out == ()
    assert found.scenario.duration_s == 30.0
    assert found.scenario.traffic.density == "none"


@pytest.mark.parametrize(("left_m", "is_parked"), [(0.89, False), (0.91, True)])
def test_what_stands_at_the_edge_of_a_lane_is_an_obstacle(left_m: float, is_parked: bool) -> None:
    scenario = sumo(stands("a", 60.0, left_m, size_m=(4.8, 2.0))).scenario
    assert bool(scenario.obstacles) is is_parked
    assert bool(scenario.vehicles) is not is_parked
    if is_parked:
        (obstacle,) = scenario.obstacles
        pose = obstacle.pose(ROADS)
        assert (pose.x_m, pose.y_m, obstacle.size_m) == (pytest.approx(60.0), pytest.approx(left_m), (4.8, 2.0))


def test_whoever_drives_on_later_is_not_parked() -> None:
    poses = np.concatenate((np.tile((60.0, 1.2, 0.0), (10, 1)), poses_along(((60.0, 1.2), (200.0, 1.2)), 10.0, 30)))
    assert [vehicle.place.arc_m for vehicle in sumo(track("a", poses)).scenario.vehicles] == [60.0]


@pytest.mark.parametrize(("x_m", "reason"), [(99.0, None), (105.0, "it is inside a junction")])
def test_a_vehicle_is_moved_back_into_its_lane_but_not_out_of_a_junction(x_m: float, reason: str | None) -> None:
    found = sumo(drives("a", x_m, 0.0, 8.0))
    if reason is None:
        assert found.scenario.vehicles[0].place.arc_m == pytest.approx(97.7, abs=0.01)
    else:
        assert reasons(found)["a"].startswith(reason)


LEFT_OUT = (
    (drives("across", 60.0, 20.0, 8.0), "off the lanes"),
    (drives("cyclist", 60.0, 0.0, 4.0, kind=ActorKind.BICYCLE), "bicycle"),
    (drives("walker", 60.0, 0.0, 1.0, kind=ActorKind.PEDESTRIAN), "it walks"),
    (stands("bystander", 60.0, 5.0, kind=ActorKind.PEDESTRIAN), "it stands off the road"),
    (drives("later", 60.0, 0.0, 8.0, first_step=3), "it appears later"),
    (drives("gone", 60.0, 0.0, 8.0, steps=1), "it was gone before"),
    (stands("far", 60.0, 12.0), "no lane within 10 m"),
    (stands("behind_goal", 168.0, 2.0), "beyond the goal"),
    (drives("double", 21.0, 0.0, 10.0), "overlaps"),
)


def test_everyone_else_is_left_out_with_a_reason() -> None:
    found = sumo(*(each for each, _ in LEFT_OUT), at_s=0.1)
    assert found.scenario.vehicles == found.scenario.obstacles == ()
    said = reasons(found)
    assert said.keys() == {each.id for each, _ in LEFT_OUT}
    assert all(part in said[each.id] for each, part in LEFT_OUT), said


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        (ActorKind.TRAFFIC_CONE, "cone"),
        (ActorKind.BARRIER, "barrier"),
        (ActorKind.CZONE_SIGN, "sign"),
        (ActorKind.GENERIC_OBJECT, "barrier"),
        (ActorKind.PEDESTRIAN, "worker"),
    ],
)
def test_what_stands_on_the_road_is_an_obstacle_of_its_kind(kind: ActorKind, name: str) -> None:
    (obstacle,) = sumo(stands("a", 60.0, -1.0, kind=kind, size_m=(0.5, 0.4))).scenario.obstacles
    assert (obstacle.kind, obstacle.size_m) == (name, (0.5, 0.4))


@pytest.mark.parametrize(("x_m", "kept"), [(147.0, True), (151.0, False)])
def test_the_goal_lies_well_behind_every_obstacle(x_m: float, kept: bool) -> None:
    assert bool(sumo(stands("a", x_m, 2.0)).scenario.obstacles) is kept  # 2.3 m more to its front, goal at 170


# --- both ----------------------------------------------------------------------------------------


@st.composite
def crowds(draw: st.DrawFn) -> Recording:
    """The ego and up to six others anywhere around it."""
    kinds = st.sampled_from(list(ActorKind))
    others = [
        track(
            f"t{i}",
            poses_along(
                ((draw(st.floats(0.0, 390.0)), draw(st.floats(-9.0, 9.0))), (1000.0, draw(st.floats(-50.0, 50.0)))),
                draw(st.floats(0.0, 20.0)),
                draw(st.integers(1, 60)),
            ),
            draw(kinds),
            first_step=draw(st.integers(0, 40)),
        )
        for i in range(draw(st.integers(1, 6)))
    ]
    return recording(drives("ego", 20.0, 0.0, 10.0, steps=51), *others)


@settings(max_examples=40)
@given(crowd=crowds(), at_s=st.integers(0, 30).map(lambda step: step / 10))
def test_every_track_is_in_the_scene_or_named_with_a_reason(crowd: Recording, at_s: float) -> None:
    others = {each.id for each in crowd.tracks} - {"ego"}
    driven = scene(crowd, ROADS, at_s=at_s)
    driven.scenario.check(ROADS)
    staged = len(driven.scenario.vehicles) + len(driven.scenario.obstacles)
    assert staged + len(driven.left_out) == len(others)
    assert {id for id, _ in driven.left_out} <= others
    if any(each.end_step > round(at_s * 10) for each in crowd.tracks if each.id != "ego"):
        shown = scene(crowd, ROADS, at_s=at_s, agents="replayed")
        shown.scenario.check(ROADS)
        assert {each.id for each in shown.scenario.replayed} | {id for id, _ in shown.left_out} == others
