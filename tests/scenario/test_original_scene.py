"""interPlan's scenarios on tiny roads: what stands, walks and drives, where they lead, and what cannot be staged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from interplan_sumo.errors import ScenarioError
from interplan_sumo.scenario.original import Letters, Original, PublishedWalk
from interplan_sumo.scenario.original_scene import original_scene
from interplan_sumo.scenario.recorded import END_M, RecordedScene
from interplan_sumo.scenario.scenario import LanePosition, TrafficDemand
from interplan_sumo.tiny_worlds import junction, straight_road
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.recording import Recording
from interplan_sumo.world.roads import Roads
from tests.scenario.made_recordings import drives, recording, track

CROSSING = junction(arm_m=150.0)
Y_M = float(CROSSING["1"].centerline.points[0][1])
WIDE = straight_road(lanes=3, length_m=260.0, cuts_m=((150.0, 170.0),))
TOKEN = "71f182558ee95100"


def logged(roads: Roads = CROSSING, speed_mps: float = 6.0, seconds: float = 30.0) -> Recording:
    """The ego straight on from 100 m before the crossing, and somebody beside it who must not matter."""
    steps = round(seconds * 10) + 1
    ego = drives(TOKEN, -112.0 if roads is CROSSING else 20.0, Y_M if roads is CROSSING else -3.5, speed_mps, steps)
    other = drives("other", -80.0, Y_M, speed_mps, steps)
    return replace(recording(ego, other, ego_id=TOKEN, crs=roads.crs), lights={"13": np.zeros(steps, dtype=np.int64)})


def made(original: Original, roads: Roads = CROSSING, speed_mps: float = 6.0) -> RecordedScene:
    return original_scene(original, logged(roads, speed_mps), roads)


def nudge(**more: object) -> Original:
    """One parked car beside the ego's way."""
    made = Original(f"{TOKEN}-s0", TOKEN, "nudge", Letters(special=0), cars=((-60.0, Y_M - 1.5, 0.1),))
    return replace(made, **more)  # type: ignore[arg-type]


def dense(letters: Letters, **more: object) -> Original:
    return replace(Original(f"{TOKEN}-dhgloa", TOKEN, "lane_change_htd", letters), **more)  # type: ignore[arg-type]


def to(goal: tuple[float, float]) -> Original:
    return dense(Letters(density="low", goal="left"), goal_point=goal)


def test_start_speed_way_and_lights_are_those_of_the_log_and_nobody_recorded_is_there() -> None:
    scenario = made(nudge()).scenario
    assert scenario.id == f"{CROSSING.name}.interplan/{TOKEN}-s0"
    assert (scenario.family, scenario.duration_s, scenario.start_speed_mps) == ("nudge", 30.0, 6.0)
    assert scenario.route == ("1", "13", "7")
    assert scenario.goal.pose(CROSSING).x_m == pytest.approx(-112.0 + 180.0, abs=1.0)
    assert (scenario.vehicles, scenario.replayed, scenario.traffic) == ((), (), TrafficDemand())
    assert scenario.lights[0].shows == ("green",)


def test_a_parked_car_stands_where_it_was_put() -> None:
    (car,) = made(nudge()).scenario.obstacles
    pose = car.pose(CROSSING)
    assert (pose.x_m, pose.y_m, pose.heading_rad) == pytest.approx((-60.0, Y_M - 1.5, 0.1), abs=0.01)
    assert car.size_m == (4.6, 1.85)
    (emptied,) = made(nudge(letters=Letters(keep_logged=0, special=0))).scenario.obstacles
    assert emptied.size_m == (5.176, 2.297)  # as large as the ego, where the log was emptied
    assert original_scene(nudge(), logged(), CROSSING, ("driving_direction",)).scenario.exempt == ("driving_direction",)


def test_cones_buses_and_workers_stand() -> None:
    works = nudge(
        family="construction", cars=(), buses=((-70.0, Y_M - 2.0, 0.0),), cones=((-60.0, Y_M), (-58.0, Y_M)),
        walks=(PublishedWalk((-59.0, Y_M), (-58.0, Y_M)),),
    )  # fmt: skip
    scenario = made(works).scenario
    assert [each.kind for each in scenario.obstacles] == ["bus", "cone", "cone", "worker"]
    assert scenario.obstacles[0].size_m == (7.456, 2.079)
    assert scenario.jaywalkers == ()


@pytest.mark.parametrize(("way_m", "walks"), [(1.49, 0), (1.51, 1), (12.0, 1)])
def test_people_walk_their_way_in_fifteen_seconds_or_stand(way_m: float, walks: int) -> None:
    person = PublishedWalk((-60.0, Y_M - 4.0), (-60.0, Y_M - 4.0 + way_m))
    scenario = made(nudge(family="jaywalker", cars=(), walks=(person,))).scenario
    assert len(scenario.jaywalkers) == walks
    assert len(scenario.obstacles) == 1 - walks
    if walks:
        walker = scenario.jaywalkers[0]
        assert walker.speed_mps == pytest.approx(way_m / 15.0, abs=1e-3)
        assert walker.end.pose(CROSSING).y_m == pytest.approx(person.end[1], abs=0.01)


def test_a_step_at_which_somebody_begins_to_walk_is_noted() -> None:
    person = PublishedWalk((-60.0, Y_M - 4.0), (-60.0, Y_M + 4.0), 50)
    found = made(nudge(family="jaywalker", cars=(), walks=(person,)))
    assert "begins when the ego is near, not at a step" in found.notes[-1]


# --- traffic ---------------------------------------------------------------------------------------


def test_density_and_policy_are_the_demand_and_assertive_where_nothing_is_said() -> None:
    letters = Letters(density="high", goal="straight", policy="conservative")
    assert made(dense(letters)).scenario.traffic == TrafficDemand("high", "conservative")
    assert made(nudge(letters=Letters(density="medium"))).scenario.traffic == TrafficDemand("medium", "assertive")


def test_a_road_that_runs_against_the_ego_is_filled_and_another_is_noted() -> None:
    letters = Letters(density="low")
    filled = made(nudge(letters=letters, filled_at=((-60.0, -Y_M),)))
    assert filled.scenario.traffic == TrafficDemand("low", "assertive", "low")
    along = CROSSING["4"].centerline.points[5]
    other = made(nudge(letters=letters, filled_at=((float(along[0]), float(along[1])),)))
    assert other.scenario.traffic.oncoming == "none"
    assert "is not filled: it does not run against the ego's" in other.notes[-1]


def test_single_cars_begin_on_the_nearest_lane_or_are_named() -> None:
    found = made(dense(Letters(density="low", goal="straight"), moving=((-50.0, Y_M + 0.5, 3.0), (-50.0, 90.0, 0.0))))
    (car,) = found.scenario.vehicles
    assert (car.place.lane, car.speed_mps, car.place.left_m) == ("1", 3.0, 0.0)
    assert "the single car at (-50.00, 90.00) is left out: it is on no lane" in found.notes


# --- goals -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("side", "lane"), [("left", "8"), ("straight", "7"), ("right", "6")])
def test_a_goal_side_turns_that_way_at_the_junction(side: str, lane: str) -> None:
    found = made(dense(Letters(density="low", goal=side))).scenario  # type: ignore[arg-type]
    assert (found.route[0], found.goal.lane) == ("1", lane)
    out = CROSSING[found.goal.lane].centerline
    assert found.goal.arc_m == pytest.approx(out.length_m - END_M, abs=0.01)


def test_a_goal_side_leads_no_farther_than_the_log_did() -> None:
    found = made(dense(Letters(density="low", goal="left")), speed_mps=1.0).scenario
    assert (found.route, found.goal.lane) == (("1",), "1")


def test_a_goal_point_is_on_its_lane_whatever_the_lane_of_the_start() -> None:
    found = made(to((230.0, 0.0)), WIDE).scenario
    assert (found.start.lane, found.goal) == ("12", LanePosition("31", 60.0))
    assert found.route == ("1", "2", "3")


@pytest.mark.parametrize(("length_m", "reached"), [(310.0, True), (360.0, False)])
def test_a_goal_farther_than_interplan_looks_is_refused(length_m: float, reached: bool) -> None:
    roads = straight_road(lanes=3, length_m=length_m + 10.0, cuts_m=((150.0, 170.0),))
    if reached:
        assert made(to((length_m, 0.0)), roads).scenario.goal.lane == "31"
    else:
        with pytest.raises(ScenarioError, match="lies more than 300 m from the ego"):
            made(to((length_m, 0.0)), roads)


# --- what cannot be staged -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("original", "roads", "said"),
    [
        (nudge(cars=((900.0, 0.0, 0.0),)), CROSSING, "s0: the car at (900.00, 0.00) stands beside no lane"),
        (nudge(walks=(PublishedWalk((900.0, 0.0), (900.0, 9.0)),)), CROSSING, "walks beside no lane"),
        (to((230.0, 60.0)), WIDE, "no lane lies within 20 m of the goal (230.00, 60.00)"),
        (to((700.0, 0.0)), WIDE, "no lane lies within 20 m"),
        (to((-100.0, -Y_M)), CROSSING, "no way leads from lane 1 to the goal (-100.00, 1.75) on lane 5"),
    ],
)
def test_what_cannot_be_staged_is_one_line(original: Original, roads: Roads, said: str) -> None:
    with pytest.raises(ScenarioError) as error:
        made(original, roads)
    assert said in str(error.value)


def test_an_ego_beside_the_lanes_is_one_line() -> None:
    log = recording(track(TOKEN, np.tile((0.0, 500.0, 0.0), (301, 1)), ActorKind.VEHICLE), ego_id=TOKEN)
    with pytest.raises(ScenarioError, match="is on no lane of map"):
        original_scene(nudge(), log, CROSSING)
