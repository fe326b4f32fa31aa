"""Jaywalkers: who drives on hits one, who brakes touches none, and the checks walk as the simulation does."""

from __future__ import annotations

from math import hypot

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stages import ONE_LANE, family_problems, staged
from worlds import straight_road

from interplan_sumo.families import crossing as checks
from interplan_sumo.families.crossing import approach
from interplan_sumo.scenario.jaywalking import walk
from interplan_sumo.scenario.route import route_centerline
from interplan_sumo.scenario.scenario import Jaywalker, LanePosition, Obstacle, Scenario
from interplan_sumo.simulation.pedestrians import Crowd
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.roads import Roads

MIDDLE_S = 4.2
"""The ego's front is at the crossing 4 s after the trigger; then somebody in the middle of the lane is hit."""


def crossing(
    speed_mps: float = 1.4, wait_m: float | None = None, end_m: float = 4.0, ahead_m: float = 0.0
) -> Jaywalker:
    """From `wait_m` to the right of the lane's middle (by default so that the ego hits it) to its left."""
    start_m = -speed_mps * MIDDLE_S if wait_m is None else -wait_m
    return Jaywalker(LanePosition("11", 120.0, start_m), LanePosition("11", 120.0 + ahead_m, end_m), speed_mps)


def jaywalk(*walkers: Jaywalker, **changes: object) -> Scenario:
    return staged("jaywalker", jaywalkers=walkers, **changes)


def crossing_problems(scenario: Scenario, roads: Roads) -> list[str]:
    """Of everybody's checks and of the family's own."""
    return [*checks.crossing_problems(scenario, roads), *family_problems(scenario, roads)]


def only(found: list[str], *words: str) -> None:
    assert len(found) == 1, found
    assert all(word in found[0] for word in words), found


def test_who_walks_into_the_egos_way_is_a_sound_jaywalker() -> None:
    assert crossing_problems(jaywalk(crossing()), ONE_LANE) == []
    assert crossing_problems(jaywalk(crossing(1.2), crossing(1.7)), ONE_LANE) == []
    assert crossing_problems(staged(), ONE_LANE) == []


@pytest.mark.parametrize(("wait_m", "hits"), [(1.4 * 4.0 + 1.0, True), (1.4 * 4.0 + 3.5, False)])
def test_a_drive_that_holds_lane_and_speed_must_hit_somebody(wait_m: float, hits: bool) -> None:
    """The front takes 4 s, the rear 0.5 s more; the lane of the box is 2.3 m wide, a pedestrian 0.9 m long."""
    found = crossing_problems(jaywalk(crossing(wait_m=wait_m)), straight_road(length_m=300.0, limit_mps=10.0))
    if hits:
        assert found == []
    else:
        only(found, "jaywalkers: a drive that holds its lane and its start speed, 10.0 m/s, misses everyone by")


def test_nor_does_a_drive_at_the_limit_get_by() -> None:
    """At 13.9 m/s the trigger lies 50 m before the crossing, 3.6 s: who is hit late at 10 m/s is not yet there then."""
    late = jaywalk(crossing(wait_m=1.4 * 4.3 + 1.5))
    only(crossing_problems(late, ONE_LANE), "a drive that holds its lane and the limit, 13.9 m/s, misses everyone by")
    assert crossing_problems(late, straight_road(length_m=300.0, limit_mps=10.0)) == []


def test_another_family_may_have_pedestrians_who_miss() -> None:
    early = crossing(wait_m=2.5)
    assert crossing_problems(staged("another", jaywalkers=(early,)), ONE_LANE) == []


def test_who_brakes_from_the_trigger_on_is_never_walked_into() -> None:
    """From 10 m/s the ego stands after 16.7 m: nobody may walk down the lane to there."""
    found = crossing_problems(jaywalk(crossing(), crossing(2.5, 5.0, -0.5, -60.0)), ONE_LANE)
    assert any("jaywalkers[1]: a drive at its start speed, 10.0 m/s, that brakes with 3 m/s2" in text for text in found)
    assert not any("brakes" in text for text in crossing_problems(jaywalk(crossing(ahead_m=-3.0)), ONE_LANE))


@pytest.mark.parametrize(("limit_mps", "sound"), [(13.93, True), (13.95, False), (None, True)])
def test_the_limit_is_50_km_h_or_less(limit_mps: float | None, sound: bool) -> None:
    found = crossing_problems(jaywalk(crossing()), straight_road(length_m=300.0, limit_mps=limit_mps))
    assert (found == []) == sound
    if not sound:
        only(found, "jaywalkers[0].start.lane: the speed limit of lane 11 is", "expected at most 50 km/h")


@pytest.mark.parametrize(("start_m", "sound"), [(77.3, True), (77.5, False)])
def test_everybody_still_waits_at_the_start(start_m: float, sound: bool) -> None:
    """120 m - 40 m of trigger - 2.588 m of ego."""
    found = crossing_problems(jaywalk(crossing(), start=LanePosition("11", start_m)), ONE_LANE)
    assert (found == []) == sound
    if not sound:
        only(found, "starts 39.9 m before the crossing and sets this pedestrian off at once, expected more than 40.0 m")


@pytest.mark.parametrize(("end_m", "sound"), [(1.65, True), (1.55, False)])
def test_nobody_stays_in_the_egos_way(end_m: float, sound: bool) -> None:
    """1.1485 m of ego and 0.45 m of pedestrian."""
    found = crossing_problems(jaywalk(crossing(end_m=end_m)), ONE_LANE)
    assert any("jaywalkers[0].end: stands in the way" in text for text in found) != sound


def test_nobody_waits_in_the_egos_way() -> None:
    found = crossing_problems(jaywalk(crossing(wait_m=1.5)), ONE_LANE)
    assert any("jaywalkers[0].start: stands in the way" in text for text in found)


# --- the occluder --------------------------------------------------------------------------------


def hidden(arc_m: float, kind: str = "bus") -> Scenario:
    obstacle = Obstacle(LanePosition("11", arc_m, -3.2), kind)  # type: ignore[arg-type]
    return jaywalk(crossing(), obstacles=(obstacle,), occluder=0)


def test_a_bus_hides_who_waits_behind_it() -> None:
    assert crossing_problems(hidden(112.0), ONE_LANE) == []
    only(
        crossing_problems(hidden(140.0), ONE_LANE),
        "occluder: obstacles[0] never comes between the ego and a pedestrian",
    )


def test_only_what_is_large_hides() -> None:
    assert crossing_problems(hidden(114.0, "truck"), ONE_LANE) == []
    only(
        crossing_problems(hidden(114.0, "car"), ONE_LANE), "occluder: obstacles[0] is a car, expected a bus or a truck"
    )


# --- as the simulation does ----------------------------------------------------------------------


def simulated(scenario: Scenario, roads: Roads, ego_x: np.ndarray, speed_mps: np.ndarray) -> np.ndarray:
    """(W, K, 2) where the simulation's pedestrians are while the ego drives like this."""
    ids = tuple(f"{i:04d}" for i in range(len(scenario.jaywalkers)))
    crowd = Crowd(scenario, roads, route_centerline(roads, scenario), ids, 0.1)
    places = []
    for x_m, v_mps in zip(ego_x, speed_mps, strict=True):
        actors = crowd.observe()
        places.append(np.stack((actors.x_m, actors.y_m), axis=1))
        crowd.notice(EgoState(0.0, float(x_m), 0.0, 0.0, float(v_mps)), PACIFICA)
        crowd.advance()
    return np.array(places).transpose(1, 0, 2)


@settings(max_examples=15)
@given(
    speed_mps=st.floats(1.0, 13.9),
    ways=st.lists(
        st.tuples(st.floats(0.8, 2.0), st.floats(2.0, 9.0), st.floats(2.0, 9.0), st.floats(-6.0, 6.0)),
        min_size=1,
        max_size=3,
    ),
    braking_mps2=st.sampled_from((0.0, 3.0)),
)
def test_pedestrians_walk_as_in_the_simulation(
    speed_mps: float, ways: list[tuple[float, float, float, float]], braking_mps2: float
) -> None:
    scenario = jaywalk(*(crossing(*way) for way in ways))
    walks = [walk(walker, ONE_LANE, route_centerline(ONE_LANE, scenario)) for walker in scenario.jaywalkers]
    drive = approach(scenario, ONE_LANE, walks, speed_mps, braking_mps2)
    x_m = drive.ego.mean(axis=1)[:, 0]
    moving = x_m < 299.0  # the road ends at 300 m, and the ego stays there
    time_s = 0.1 * np.arange(len(x_m))
    trigger_s = 0.1 * drive.set_off.min()
    speeds = np.maximum(0.0, speed_mps - braking_mps2 * np.maximum(0.0, time_s - trigger_s))
    places = simulated(scenario, ONE_LANE, x_m[moving], speeds[moving])
    assert drive.walkers[:, moving, :2] == pytest.approx(places, abs=1e-6)


def test_braking_stops_where_physics_says() -> None:
    scenario = jaywalk(crossing())
    walks = [walk(walker, ONE_LANE, route_centerline(ONE_LANE, scenario)) for walker in scenario.jaywalkers]
    drive = approach(scenario, ONE_LANE, walks, 10.0, 3.0)
    fronts = drive.ego[:, 0, 0]
    assert 39.0 < 120.0 - fronts[int(drive.set_off[0])] <= 40.0  # the first frame within 40 m
    assert fronts[-1] - fronts[int(drive.set_off[0])] == pytest.approx(100.0 / 6.0, abs=1e-6)
    assert hypot(*drive.walkers[0, -1, :2] - (120.0, 4.0)) == pytest.approx(0.0, abs=1e-9)
