"""The rules that stand in for a language model: merging into gaps, passing, waiting for people."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from worlds import cars, ego, mission, pedestrians, straight_road, together, unmoved

from interplan_llm.hybrid.behaviours import Behaviour, offered
from interplan_llm.hybrid.choosers import RuleChooser
from interplan_llm.hybrid.scene import BlockedLane, DecisionScene, Oncoming, SceneObserver
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import PACIFICA

ROAD = straight_road(lanes=3, length_m=500.0, limit_mps=12.0)
TO_THE_LEFT = mission(ROAD, ("11",), goal_arc_m=200.0)
OWN_Y, LEFT_Y = -3.5, 0.0
HALF_M, CAR_HALF_M = PACIFICA.length_m / 2, 2.4
UPWARDS = 1.5707963
PASSING = (Behaviour.OVERTAKE, Behaviour.STOP)


def seen(*others: Actors, speed_mps: float = 8.0) -> DecisionScene:
    """An ego at 100 m in the middle of three lanes, the goal to its left; who stands has stood for two seconds."""
    everyone = together(*others) if others else None
    return SceneObserver(TO_THE_LEFT, 15.0).scene(unmoved(ego(100.0, OWN_Y, speed_mps), everyone))


def chosen(
    scene: DecisionScene, options: tuple[Behaviour, ...] | None = None, now: Behaviour | None = None
) -> Behaviour:
    chooser = RuleChooser()
    chooser.start(TO_THE_LEFT)
    return chooser.choose(scene, offered(scene) if options is None else options, now)[0]


def left_ahead(gap_m: float, speed_mps: float = 8.0) -> Actors:
    return cars((100.0 + HALF_M + gap_m + CAR_HALF_M, LEFT_Y, speed_mps), prefix="ahead")


def left_behind(gap_m: float, speed_mps: float = 8.0) -> Actors:
    return cars((100.0 - HALF_M - gap_m - CAR_HALF_M, LEFT_Y, speed_mps), prefix="behind")


def test_without_anybody_the_goal_lane_is_taken() -> None:
    assert chosen(seen()) is Behaviour.MERGE_LEFT


@pytest.mark.parametrize(
    ("others", "needed_m"),
    [
        (left_ahead, 5.0),  # 1 m and half a second at 8 m/s
        (left_behind, 5.0),
        (lambda gap_m: left_ahead(gap_m, 4.0), 9.0),  # and 4 m/s taken off with 2 m/s^2
        (lambda gap_m: left_behind(gap_m, 12.0), 11.0),  # 1 m, half a second at 12 m/s, and 4 m/s taken off
    ],
    ids=["ahead", "behind", "slower ahead", "faster behind"],
)
def test_a_merge_asks_for_a_gap_that_nobody_has_to_brake_hard_for(
    others: Callable[[float], Actors], needed_m: float
) -> None:
    assert chosen(seen(others(needed_m + 0.2))) is Behaviour.MERGE_LEFT
    assert chosen(seen(others(needed_m - 0.2))) is Behaviour.FOLLOW


def test_both_ends_of_a_gap_count() -> None:
    assert chosen(seen(left_ahead(5.2), left_behind(5.2))) is Behaviour.MERGE_LEFT
    assert chosen(seen(left_ahead(5.2), left_behind(4.8))) is Behaviour.FOLLOW
    assert chosen(seen(left_ahead(4.8), left_behind(5.2))) is Behaviour.FOLLOW


@pytest.mark.parametrize(
    ("gap_m", "behaviour"), [(4.8, Behaviour.MERGE_LEFT), (2.7, Behaviour.MERGE_LEFT), (2.3, Behaviour.FOLLOW)]
)
def test_a_merge_under_way_goes_on_in_half_the_gap(gap_m: float, behaviour: Behaviour) -> None:
    assert chosen(seen(left_behind(gap_m)), now=Behaviour.MERGE_LEFT) is behaviour


def test_round_an_obstacle_the_side_that_is_under_way_comes_first() -> None:
    scene = seen(cars((125.0, OWN_Y)))
    assert chosen(scene) is Behaviour.MERGE_LEFT
    assert chosen(scene, now=Behaviour.MERGE_RIGHT) is Behaviour.MERGE_RIGHT


def test_a_blocked_lane_without_a_gap_beside_it_is_waited_in() -> None:
    beside = cars((100.0, LEFT_Y, 8.0), (100.0, 2 * OWN_Y, 8.0), prefix="beside")
    assert chosen(seen(cars((125.0, OWN_Y)), beside)) is Behaviour.STOP


def blocked(gap_m: float, against_traffic: bool, meets_in_s: float | None = None) -> DecisionScene:
    """5 m of obstacle ahead in the own lane, and somebody who comes at 10 m/s; the ego drives 8 m/s."""
    scene = seen()
    start_m = scene.current.arc_m + HALF_M + gap_m
    obstacle = BlockedLane("barrier", max(gap_m, 0.0), start_m, start_m + 5.0, (("left", 3.0),), against_traffic)
    comes = None if meets_in_s is None else Oncoming(18.0 * meets_in_s, 10.0, 18.0)
    return replace(scene, current=replace(scene.current, blocked=obstacle), left=None, right=None, oncoming=comes)


# Half a car, 20 m, the obstacle, a car and 12 m are 44.8 m: at 10 m/s, the mean of speed and limit, 4.48 s; and 3 s.
@pytest.mark.parametrize(("meets_in_s", "behaviour"), [(7.6, Behaviour.OVERTAKE), (7.4, Behaviour.STOP)])
def test_the_oncoming_lane_is_used_only_if_who_comes_is_met_after_it(meets_in_s: float, behaviour: Behaviour) -> None:
    assert chosen(blocked(20.0, True, meets_in_s), PASSING) is behaviour


def test_nobody_who_comes_and_no_oncoming_lane_to_use_are_reasons_to_pass() -> None:
    assert chosen(blocked(20.0, True), PASSING) is Behaviour.OVERTAKE
    assert chosen(blocked(20.0, False, 1.0), PASSING) is Behaviour.OVERTAKE


def test_a_pass_is_called_off_before_the_obstacle_and_not_beside_it() -> None:
    assert chosen(blocked(1.0, True, 1.0), PASSING, Behaviour.OVERTAKE) is Behaviour.STOP
    assert chosen(blocked(-1.0, True, 1.0), PASSING, Behaviour.OVERTAKE) is Behaviour.OVERTAKE
    assert chosen(blocked(-1.0, True, 1.0), PASSING, Behaviour.STOP) is Behaviour.STOP


def walker(ahead_m: float, aside_m: float, speed_mps: float = 1.0, heading_rad: float = UPWARDS) -> Actors:
    return pedestrians((100.0 + HALF_M + ahead_m, OWN_Y + aside_m, speed_mps, heading_rad))


@pytest.mark.parametrize(
    ("person", "waits"),
    [
        # The ego is there in 2 s, the spare time is 2 s, and the way to the lane's middle is walked at 1 m/s.
        (walker(16.0, -3.9), True),
        (walker(16.0, -4.1), False),
        (walker(16.0, -3.9, heading_rad=-UPWARDS), False),  # walks away
        (walker(16.0, -3.9, speed_mps=0.0), False),
        (walker(16.0, -1.9, heading_rad=-UPWARDS), True),  # still on the lane
        (walker(16.0, -2.1, heading_rad=-UPWARDS), False),
        # The ego cares for who is met within 2 s and half its speed in m/s, which makes 6 s: 48 m at 8 m/s.
        (walker(47.5, 0.0), True),
        (walker(48.5, 0.0), False),
    ],
)
def test_who_is_on_the_lane_when_the_ego_is_there_is_waited_for(person: Actors, waits: bool) -> None:
    assert chosen(seen(person)) is (Behaviour.STOP if waits else Behaviour.MERGE_LEFT)


def test_who_works_among_the_cones_is_passed_with_them() -> None:
    cones = cars((120.0, OWN_Y), (130.0, OWN_Y), kind=ActorKind.TRAFFIC_CONE, length_m=0.4, width_m=0.4, prefix="cone")
    options = (Behaviour.OVERTAKE, Behaviour.STOP)
    assert chosen(seen(cones, walker(22.0, -1.0, speed_mps=0.0)), options) is Behaviour.OVERTAKE
    assert chosen(seen(cones, walker(22.0, -1.0, speed_mps=1.0)), options) is Behaviour.STOP
    assert chosen(seen(cones, walker(10.0, -1.0)), options) is Behaviour.STOP


# From 8 to 4.5 m/s at 2 m/s^2 are 10.9 m, and the next decision is 8 m away.
@pytest.mark.parametrize(
    ("ahead_m", "speed_mps", "slows"),
    [(18.5, 8.0, True), (19.5, 8.0, False), (4.0 - HALF_M, 4.6, True), (4.0 - HALF_M, 4.4, False)],
)
def test_before_a_bus_that_hides_people_the_ego_slows_down(ahead_m: float, speed_mps: float, slows: bool) -> None:
    bus = cars((100.0 + HALF_M + ahead_m - 6.0, 2 * OWN_Y), length_m=12.0, width_m=2.5, prefix="bus")
    options = (Behaviour.FOLLOW, Behaviour.STOP)
    assert (chosen(seen(bus, speed_mps=speed_mps), options) is Behaviour.STOP) is slows
