"""What the hybrid sees of a step, and which behaviours that offers."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from worlds import cars, ego, ego_on, junction, mission, observation, pedestrians, signals, straight_road, unmoved

from interplan_llm.hybrid.behaviours import Behaviour, offered
from interplan_llm.hybrid.scene import CLEARANCE_M, BlockedLane, DecisionScene, SceneObserver
from interplan_sumo.planner import Mission, Past
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.signals import Signals

WIDE = straight_road(lanes=3, length_m=500.0, limit_mps=12.0)
MIDDLE = mission(WIDE, ("12",), goal_arc_m=200.0)
TO_THE_LEFT = mission(WIDE, ("11",), goal_arc_m=200.0)
NARROW = straight_road(lanes=1, length_m=300.0, limit_mps=12.0)
ALONE = mission(NARROW, ("11",))
HALF_M = PACIFICA.length_m / 2
OWN_Y = -3.5
"""Of the middle lane."""


def seen(
    actors: Actors | None = None,
    job: Mission = MIDDLE,
    speed_mps: float = 8.0,
    y_m: float = OWN_Y,
    lights: Signals | None = None,
    x_m: float = 100.0,
) -> DecisionScene:
    """The scene around an ego; whoever stands has been standing for two seconds."""
    return SceneObserver(job, 15.0).scene(unmoved(ego(x_m, y_m, speed_mps), actors, lights))


def blockage(scene: DecisionScene) -> BlockedLane:
    assert scene.current.blocked is not None
    return scene.current.blocked


def cones(*places: tuple[float, float]) -> Actors:
    return cars(*places, kind=ActorKind.TRAFFIC_CONE, length_m=0.4, width_m=0.4, prefix="cone")


def test_an_empty_road_has_three_free_lanes() -> None:
    scene = seen()
    assert scene.current.way.lanes == ("12",)
    assert (scene.left and scene.left.way.lanes, scene.right and scene.right.way.lanes) == (("11",), ("13",))
    assert scene.current.ahead is scene.current.behind is scene.current.blocked is None
    assert scene.limit_mps == pytest.approx(12.0)
    assert scene.goal_m == pytest.approx(100.0)
    assert seen(y_m=0.0).left is None
    assert seen(y_m=-7.0).right is None


def test_gaps_run_from_bumper_to_bumper() -> None:
    scene = seen(cars((130.0, OWN_Y, 6.0), (80.0, OWN_Y, 9.0)))
    assert scene.current.ahead is not None
    assert scene.current.ahead.gap_m == pytest.approx(30.0 - HALF_M - 2.4)
    assert scene.current.ahead.speed_mps == pytest.approx(6.0)
    assert scene.current.behind is not None
    assert scene.current.behind.gap_m == pytest.approx(20.0 - HALF_M - 2.4)


def test_a_car_beside_the_ego_has_no_gap() -> None:
    scene = seen(cars((101.0, 0.0, 8.0)))
    assert scene.left is not None
    assert scene.left.ahead is not None
    assert scene.left.ahead.gap_m == 0.0


def test_the_nearest_of_several_is_told() -> None:
    scene = seen(cars((150.0, OWN_Y, 6.0), (125.0, OWN_Y, 7.0), (70.0, OWN_Y, 7.0), (85.0, OWN_Y, 9.0)))
    assert scene.current.ahead is not None
    assert scene.current.behind is not None
    assert (scene.current.ahead.speed_mps, scene.current.behind.speed_mps) == pytest.approx((7.0, 9.0))


@pytest.mark.parametrize(("y_m", "there"), [(OWN_Y + 1.9, True), (OWN_Y + 2.1, False)])
def test_who_reaches_within_a_metre_of_the_centre_line_is_on_the_lane(y_m: float, there: bool) -> None:
    assert (seen(cars((130.0, y_m, 6.0))).current.ahead is not None) is there


def test_a_car_that_stands_blocks_and_is_nobody_to_follow() -> None:
    scene = seen(cars((130.0, OWN_Y)))
    assert scene.current.ahead is None
    assert blockage(scene).kind == "stopped vehicle"
    assert blockage(scene).gap_m == pytest.approx(30.0 - HALF_M - 2.4)


def test_a_car_that_has_just_stopped_does_not_block_yet() -> None:
    state = ego(100.0, OWN_Y, 8.0)
    moved = Past((state,) * 20, (cars((129.0, OWN_Y, 1.0)),) * 20)
    scene = SceneObserver(MIDDLE, 15.0).scene(observation(state, cars((130.0, OWN_Y)), None, moved))
    assert scene.current.blocked is None
    assert scene.current.ahead is not None


def test_cones_near_one_another_are_one_blockage() -> None:
    found = blockage(seen(cones((130.0, OWN_Y), (138.0, OWN_Y + 1.0), (146.0, OWN_Y - 1.0))))
    assert found.kind == "cones"
    assert found.start_m == pytest.approx(129.8)
    assert found.end_m == pytest.approx(146.2)


def test_cones_far_behind_the_first_are_another_blockage() -> None:
    assert blockage(seen(cones((130.0, OWN_Y), (146.0, OWN_Y)))).end_m == pytest.approx(130.2)


def test_passing_keeps_clear_of_the_obstacle_and_takes_the_smaller_shift() -> None:
    found = blockage(seen(cones((130.0, OWN_Y - 0.5))))
    (side, offset_m), (other, other_m) = found.passes
    assert (side, other) == ("left", "right")
    assert offset_m == pytest.approx(-0.5 + 0.2 + PACIFICA.width_m / 2 + CLEARANCE_M)
    assert other_m == pytest.approx(-0.5 - 0.2 - PACIFICA.width_m / 2 - CLEARANCE_M)


def test_beyond_the_edge_of_the_road_and_where_something_else_stands_there_is_no_passing() -> None:
    assert blockage(seen(cars((130.0, 0.0)), job=ALONE, y_m=0.0)).passes == ()
    found = blockage(seen(cars((130.0, OWN_Y), (131.0, 0.0), (131.0, -7.0))))
    assert found.passes == ()


def test_what_is_beside_the_ego_blocks_until_it_is_past() -> None:
    beside = seen(cars((99.0, OWN_Y)), y_m=-1.0)
    assert beside.current.blocked is None or beside.current.blocked.gap_m == 0.0
    assert seen(cars((94.0, OWN_Y))).current.blocked is None


def test_what_lies_behind_the_ego_leaves_room_beside_what_it_is_passing() -> None:
    behind, beside = (93.8, OWN_Y + 0.8), (96.5, OWN_Y - 1.3)  # the first ends 1.2 m behind the ego and sticks out
    found = blockage(seen(cars(behind, beside), y_m=OWN_Y + 1.3))
    assert found.passes[0] == ("left", pytest.approx(-0.3 + PACIFICA.width_m / 2 + CLEARANCE_M))


def test_cars_that_wait_for_a_light_do_not_block() -> None:
    job = mission(junction(), ("1", "13", "7"))
    state = ego_on(job.roads, "1", 20.0, 5.0)
    waiting = cars((-16.0, -1.75))
    past = Past((state,) * 20, (waiting,) * 20)
    red, green = (
        SceneObserver(job, 15.0).scene(observation(state, waiting, lights, past))
        for lights in (signals(red=["13"]), signals(green=["13"]))
    )
    assert red.current.blocked is None
    assert red.current.ahead is not None
    assert red.light == ("red", pytest.approx(40.0 - HALF_M, abs=0.5))
    assert green.current.blocked is not None
    assert green.light is None


def test_an_oncoming_car_comes_with_both_speeds() -> None:
    scene = seen(cars((160.0, -0.5, 10.0, 3.14159265)), speed_mps=8.0)
    assert scene.oncoming is not None
    assert scene.oncoming.gap_m == pytest.approx(60.0 - HALF_M - 2.4)
    assert scene.oncoming.closing_mps == pytest.approx(18.0)
    assert scene.oncoming.meets_in_s == pytest.approx(scene.oncoming.gap_m / 18.0)


@pytest.mark.parametrize(
    "others",
    [
        cars((160.0, -0.5, 10.0)),
        cars((60.0, -0.5, 10.0, 3.14159265)),
        cars((160.0, 4.0, 10.0, 3.14159265)),
        cars((160.0, -0.5, 0.0, 3.14159265)),
    ],
    ids=["same direction", "behind", "too far aside", "parked"],
)
def test_who_does_not_come_towards_the_ego_is_not_oncoming(others: Actors) -> None:
    assert seen(others).oncoming is None


def test_a_pedestrian_beside_the_lane_is_told_with_the_way_that_is_left() -> None:
    scene = seen(pedestrians((130.0, -7.5, 1.4, 1.5707963)))
    (walker,) = scene.walkers
    assert walker.ahead_m == pytest.approx(30.0 - HALF_M)
    assert walker.aside_m == pytest.approx(-4.0)
    assert walker.towards_mps == pytest.approx(1.4)


def test_a_bus_that_stands_beside_the_lane_hides_people() -> None:
    bus = cars((130.0, -7.0), length_m=12.0, width_m=2.5, prefix="bus")
    assert [(c.side, pytest.approx(c.ahead_m)) for c in seen(bus).covers] == [("right", 36.0 - HALF_M)]
    assert seen(cars((130.0, -7.0))).covers == ()


MERGE_LEFT, MERGE_RIGHT, FOLLOW, STOP = Behaviour.MERGE_LEFT, Behaviour.MERGE_RIGHT, Behaviour.FOLLOW, Behaviour.STOP


@pytest.mark.parametrize(
    ("scene", "options"),
    [
        (lambda: seen(), (FOLLOW,)),
        (lambda: seen(job=TO_THE_LEFT), (FOLLOW, MERGE_LEFT)),
        (lambda: seen(job=TO_THE_LEFT, y_m=0.0), (FOLLOW,)),  # is there already
        (lambda: seen(cars((150.0, 0.0)), job=TO_THE_LEFT), (FOLLOW,)),  # into a blocked lane
        (lambda: seen(cars((130.0, OWN_Y)), speed_mps=10.0), (MERGE_LEFT, MERGE_RIGHT, STOP)),  # round what is near
        (lambda: seen(pedestrians((130.0, -8.0))), (FOLLOW, STOP)),  # who might step out
    ],
)
def test_what_is_offered(scene: Callable[[], DecisionScene], options: tuple[Behaviour, ...]) -> None:
    assert offered(scene()) == options


def test_a_lane_blocked_far_ahead_may_be_followed_for_now() -> None:
    assert offered(seen(cars((170.0, OWN_Y)), speed_mps=5.0))[0] is FOLLOW


def test_without_another_lane_one_passes_or_waits() -> None:
    wide = straight_road(lanes=1, length_m=300.0)
    aside = cars((125.0, -1.7), width_m=1.6)
    options = offered(seen(aside, job=mission(wide, ("11",)), y_m=0.0))
    assert Behaviour.FOLLOW not in options
    assert options[-1] is Behaviour.STOP
    in_the_way = offered(seen(cars((125.0, 0.0)), job=mission(wide, ("11",)), y_m=0.0))
    assert in_the_way == (Behaviour.STOP,)
