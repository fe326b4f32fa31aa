"""Ways across: part by part, with stands in between, by whoever takes them."""

from __future__ import annotations

import numpy as np
import pytest
from worlds import straight_road

from interplan_sumo.errors import ScenarioError
from interplan_sumo.scenario.jaywalking import PedestrianWalk, walk
from interplan_sumo.scenario.scenario import Jaywalker, LanePosition, Scenario, WalkStage

ROAD = straight_road(lanes=1, length_m=200.0)
LINE = ROAD["11"].centerline


def at(left_m: float, arc_m: float = 50.0) -> LanePosition:
    return LanePosition("11", arc_m, left_m)


def taken(*via: WalkStage, end_m: float = 4.0) -> PedestrianWalk:
    """From 4 m to the right of the lane's middle on, the last part at 2 m/s."""
    return walk(Jaywalker(at(-4.0), at(end_m), 2.0, via), ROAD, LINE)


def places(way: PedestrianWalk, *at_s: float) -> list[float]:
    return way.poses(np.array(at_s))[:, 1].tolist()


def test_who_walks_straight_across_stands_before_and_after() -> None:
    way = taken()
    assert places(way, -1.0, 0.0, 1.0, 4.0, 9.0) == pytest.approx([-4.0, -4.0, -2.0, 4.0, 4.0])
    assert [way.speed_mps(at_s) for at_s in (-1.0, 0.0, 3.9, 4.1)] == pytest.approx([0.0, 2.0, 2.0, 0.0])


def test_who_stops_midway_goes_on_when_the_time_is_over() -> None:
    way = taken(WalkStage(at(0.0), 1.0, 3.0))
    assert places(way, 4.0, 6.9, 8.0) == pytest.approx([0.0, 0.0, 2.0])
    assert [way.speed_mps(at_s) for at_s in (3.9, 5.0, 7.1)] == pytest.approx([1.0, 0.0, 2.0])
    assert way.duration_s == pytest.approx(9.0)
    assert way.conflict_m == pytest.approx(50.0)


def test_who_turns_back_comes_to_rest_where_it_began_facing_the_way_it_came() -> None:
    way = taken(WalkStage(at(0.5), 1.5), end_m=-4.0)
    assert places(way, 3.0, 99.0) == pytest.approx([0.5, -4.0])
    assert way.poses(np.array([1.0, 4.0]))[:, 2] == pytest.approx([np.pi / 2.0, -np.pi / 2.0])


def test_a_wait_before_the_first_step_delays_the_walk() -> None:
    way = taken(WalkStage(at(-4.0), 1.0, 1.5))
    assert places(way, 1.4, 2.5) == pytest.approx([-4.0, -2.0])
    assert way.speed_mps(1.0) == 0.0
    assert way.poses(np.array([-1.0]))[0, 2] == pytest.approx(np.pi / 2.0)  # looks where it will go


def test_the_way_crosses_the_route_where_it_first_does() -> None:
    way = taken(WalkStage(at(1.0, 60.0), 1.0), WalkStage(at(-1.0, 70.0), 1.0), end_m=4.0)
    assert 50.0 < way.conflict_m < 60.0


@pytest.mark.parametrize(
    ("stage", "said"),
    [
        (WalkStage(at(0.0), 9.0), r"via\[0\].speed_mps is 9.0, expected 0.1 to 5"),
        (WalkStage(at(0.0), 1.0, -1.0), r"via\[0\].wait_s is -1.0, expected 0 to 30"),
        (WalkStage(at(0.0), 1.0, 31.0), r"via\[0\].wait_s is 31.0"),
    ],
)
def test_what_cannot_be_is_refused(stage: WalkStage, said: str) -> None:
    with pytest.raises(ScenarioError, match=said):
        Scenario(
            "a/0", "a", "test", at(0.0, 10.0), 5.0, at(0.0, 150.0), ("1",),
            jaywalkers=(Jaywalker(at(-4.0), at(4.0), 1.0, (stage,)),),
        )  # fmt: skip


def test_a_plain_walk_is_written_and_hashed_as_before_there_were_others() -> None:
    scenario = Scenario(
        "a/0", "a", "test", at(0.0, 10.0), 5.0, at(0.0, 150.0), ("1",), jaywalkers=(Jaywalker(at(-4.0), at(4.0), 1.0),)
    )
    (plain,) = scenario.canonical()["jaywalkers"]  # type: ignore[misc]
    assert set(plain) == {"start", "end", "speed_mps"}
