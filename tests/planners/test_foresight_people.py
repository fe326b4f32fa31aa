"""Whom the foresight planner minds who may step out from behind what stands, or stop on the way across."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import inf
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from worlds import cars, ego, mission, observation, pedestrians, signals, straight_road, together

from interplan_planners.foresight.hidden_people import BETWEEN_M, LEAST_MPS, cautious_limits, hiders_near, safe_mps
from interplan_planners.foresight.manoeuvres import Manoeuvres
from interplan_planners.foresight.prediction import Prediction
from interplan_planners.foresight.scene import PlanningScene
from interplan_planners.foresight.static_classification import Stillness
from interplan_sumo.planner import Past
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.signals import Signals
from tests.planners.staging_planners import foresee
from tests.quick import few

WIDTH_M, LIMIT_MPS = 3.5, 12.0
TWO = straight_road(lanes=2, length_m=400.0, limit_mps=LIMIT_MPS)
ALONG = mission(TWO, ("11",))
END_M = 86.0
"""Where what stands beside the way ends."""
BESIDE_M = 2.2
"""From the lane's line to a car that stands in the next lane."""


def standing(beside_m: float = BESIDE_M, length_m: float = 4.6, end_m: float = END_M, name: str = "car") -> Actors:
    """A vehicle whose near side is so far beside the line of lane "11", to the left if that is positive."""
    left_m = np.copysign(abs(beside_m) + 1.0, beside_m)
    return cars((end_m - 0.5 * length_m, left_m, 0.0), length_m=length_m, width_m=2.0, prefix=name)


def limits(*actors: Actors, balk: bool = False, before: Actors | None = None, **changed: Any) -> Floats:
    """What the ego at x = 40 m allows itself on its lane, for each metre of x that its front bumper reaches.

    Actors stay where they are, or balk, where they have been `before`. `changed` is what is otherwise with its
    candidate than with one that keeps the lane.
    """
    start, others = ego(40.0, 0.0, 8.0), together(*actors)
    seen = observation(start, others, past=Past((start,) * 20, (others if before is None else before,) * 20))
    yes, no = np.ones(len(others), np.bool_), np.zeros(len(others), np.bool_)
    traffic = Prediction(TWO).traffic(seen, PACIFICA, 8.0)
    scene = PlanningScene(seen, PACIFICA, traffic, no if balk else yes, no, yes if balk else no)
    manoeuvres = Manoeuvres(ALONG, start, 13.0, 3.6)
    path = replace(manoeuvres.here(start), **changed)
    axle_m, _ = path.path.line.project_point(scene.axle.x_m, scene.axle.y_m)
    allowed = cautious_limits(path, axle_m, scene, hiders_near(scene))
    x_m = np.arange(len(allowed)) - axle_m + scene.axle.x_m + PACIFICA.front_m
    return np.interp(np.arange(150.0), x_m, allowed)


@pytest.mark.parametrize("length_m", [3.5, 4.6, 6.9, 12.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_beside_whatever_hides_people_it_is_slow_before_the_end_and_only_there(length_m: float, side: float) -> None:
    allowed = limits(standing(side * BESIDE_M, length_m))
    assert allowed[82:86] == pytest.approx(LEAST_MPS, abs=0.05)
    assert allowed[88] == pytest.approx(LIMIT_MPS)
    assert allowed[40] > 9.0


def test_what_stands_behind_the_ego_and_who_is_on_foot_hide_nobody() -> None:
    assert limits(standing(end_m=34.0)).min() == pytest.approx(LIMIT_MPS)
    assert limits(pedestrians((80.0, -2.6))).min() == pytest.approx(LIMIT_MPS)


@given(beside_m=st.floats(1.6, 8.0), more_m=st.floats(0.0, 4.0))
@settings(max_examples=40)
def test_the_farther_beside_it_stands_the_faster_the_ego_may_be_and_never_slower_than_the_least(
    beside_m: float, more_m: float
) -> None:
    near, far = (limits(standing(-each)) for each in (beside_m, beside_m + more_m))
    assert (near <= far + 1e-6).all()
    assert near.min() >= LEAST_MPS - 1e-6
    assert limits(standing(beside_m)) == pytest.approx(near)


def test_from_far_enough_away_nobody_gets_into_the_way_unseen() -> None:
    assert limits(standing(-3.0)).min() < 9.0
    assert limits(standing(-4.5)).min() == pytest.approx(LIMIT_MPS)


@pytest.mark.parametrize(("gap_m", "open_between"), [(BETWEEN_M - 0.1, False), (BETWEEN_M + 0.1, True)])
def test_in_a_row_people_come_out_where_they_fit_through(gap_m: float, open_between: bool) -> None:
    row = limits(standing(-BESIDE_M), standing(-BESIDE_M, end_m=END_M + gap_m + 12.0, length_m=12.0, name="next"))
    assert (row[83] == pytest.approx(LEAST_MPS, abs=0.05)) == open_between
    assert row[96] == pytest.approx(LEAST_MPS, abs=0.05)


@pytest.mark.parametrize(
    ("over_m", "leaves_m", "settles_m", "slow"),
    [(30.0, 60.0, 120.0, False), (inf, 60.0, 120.0, True), (30.0, 105.0, 120.0, True), (30.0, 60.0, 90.0, True)],
)
def test_only_what_it_passes_on_a_lane_of_others_does_not_make_it_slow(
    over_m: float, leaves_m: float, settles_m: float, slow: bool
) -> None:
    allowed = limits(standing(-BESIDE_M), kind="pass", over_m=over_m, leaves_m=leaves_m, settles_m=settles_m)
    assert (allowed.min() < 5.0) == slow


# --- who brakes for somebody -----------------------------------------------------------------------


def brakes(mps: float, by_mps2: float, x_m: float = 60.0, y_m: float = -WIDTH_M) -> tuple[Actors, Actors]:
    """Somebody on the lane beside now, and half a second before."""
    return cars((x_m, y_m, mps)), cars((x_m - 0.5 * mps, y_m, mps + 0.5 * by_mps2))


def balking(
    now: Actors, before: Actors, roads: Roads = TWO, signals: Signals | None = None, memory: Stillness | None = None,
    time_s: float = 5.0,
) -> list[bool]:  # fmt: skip
    """Who balks."""
    start = ego(20.0, 0.0, 8.0, time_s=time_s)
    seen = observation(start, now, signals, past=Past((start,) * 20, (before,) * 20))
    prediction = Prediction(roads)
    _, _, found = (memory or Stillness()).found(seen, prediction.traffic(seen, PACIFICA, 8.0), prediction)
    return found.tolist()


@pytest.mark.parametrize(("mps", "by_mps2", "does"), [
    (9.0, 4.0, True), (9.0, 2.2, True), (9.0, 1.8, False), (9.0, 0.0, False), (2.0, 0.0, True), (2.0, -1.5, False),
    (3.4, 0.0, False), (0.0, 3.0, True),
])  # fmt: skip
def test_who_brakes_hard_or_crawls_on_a_free_road_balks(mps: float, by_mps2: float, does: bool) -> None:
    assert balking(*brakes(mps, by_mps2)) == [does]


def test_who_has_a_reason_to_brake_does_not_balk() -> None:
    now, before = brakes(9.0, 4.0)
    assert balking(together(now, cars((75.0, -WIDTH_M, 4.0), prefix="lead")), before)[0] is False
    assert balking(together(now, cars((95.0, -WIDTH_M, 9.0), prefix="lead")), before)[0] is True
    now, before = brakes(9.0, 4.0, x_m=330.0, y_m=0.0)
    lit = straight_road(lanes=1, length_m=400.0, limit_mps=LIMIT_MPS, cuts_m=((350.0, 365.0),))
    for lights in (signals(red=("21",)), signals(yellow=("21",))):
        assert balking(now, before, lit, lights) == [False]


@pytest.mark.parametrize("lane_m", [100.0, 350.0])
def test_who_stands_at_a_red_light_waits_however_long_its_lane_is(lane_m: float) -> None:
    roads = straight_road(lanes=1, length_m=lane_m + 60.0, limit_mps=LIMIT_MPS, cuts_m=((lane_m, lane_m + 15.0),))
    waits, start, prediction = cars((lane_m - 4.0, 0.0)), ego(lane_m - 40.0), Prediction(roads)
    for lights, stays in ((signals(red=("21",)), False), (signals(green=("21",)), True)):
        seen = observation(start, waits, lights, past=Past((start,) * 20, (waits,) * 20))
        found, _, _ = Stillness().found(seen, prediction.traffic(seen, PACIFICA, 8.0), prediction)
        assert found.tolist() == [stays]


def test_for_two_seconds_after_that_who_is_slow_still_may_have_a_reason() -> None:
    memory = Stillness()
    assert balking(*brakes(6.0, 4.0), memory=memory, time_s=5.0) == [True]
    assert balking(*brakes(4.0, -2.0), memory=memory, time_s=6.9) == [True]
    assert balking(*brakes(5.5, -2.0), memory=memory, time_s=6.9) == [False]
    assert balking(*brakes(4.0, -2.0), memory=memory, time_s=7.1) == [False]


@pytest.mark.parametrize(("mps", "stops_m"), [(8.0, 8.0), (4.0, 2.0)])
def test_who_brakes_beside_the_ego_hides_people_before_where_it_will_stand(mps: float, stops_m: float) -> None:
    now, before = brakes(mps, 4.0)
    allowed = limits(now, before=before, balk=True)
    front_m = 60.0 + 0.5 * float(now.length_m[0]) + stops_m
    assert allowed[int(front_m) - 1] == pytest.approx(
        float(safe_mps(np.array(WIDTH_M - 0.5 * now.width_m), 0.5 * PACIFICA.width_m, PACIFICA.front_m)[0]), abs=0.3
    )
    assert allowed[int(front_m) + 3] == pytest.approx(LIMIT_MPS)
    towards = cars((60.0, -WIDTH_M, 6.0, np.pi))
    assert limits(towards, before=before, balk=True).min() == pytest.approx(LIMIT_MPS)
    leads = cars((60.0, 0.0, 4.0))
    assert limits(leads, before=leads, balk=True).min() == pytest.approx(LIMIT_MPS)


# --- in closed loop --------------------------------------------------------------------------------


def fronts(states: list[EgoState]) -> tuple[Floats, Floats]:
    """Where the front bumper is by time, and the speeds."""
    return np.array([s.x_m + 0.5 * PACIFICA.length_m for s in states]), np.array([s.vx_mps for s in states])


@pytest.mark.slow
@pytest.mark.parametrize("side", few([1.0, -1.0], 1))
def test_it_drives_so(side: float) -> None:
    lane, line_m = ("12", -WIDTH_M) if side > 0.0 else ("11", 0.0)
    van = cars((END_M - 3.0, line_m + side * WIDTH_M, 0.0), length_m=6.0)
    front_m, speeds = fronts(foresee(mission(TWO, (lane,)), ego(30.0, line_m, 11.0), van, seconds=11.0))
    assert speeds[(front_m > END_M - 4.0) & (front_m < END_M - 1.0)].max() < 5.5
    assert speeds.max() > 9.0


def stepping_out(at_s: float, speed_mps: float) -> Callable[[float], Actors]:
    """A parked car, and who comes out before it into sight at some time and walks on across the road."""

    def everybody(time_s: float) -> Actors:
        if time_s < at_s:
            return standing(-BESIDE_M)
        walker = (END_M + 0.9, -BESIDE_M - 0.5 + speed_mps * (time_s - at_s), speed_mps, np.pi / 2)
        return together(standing(-BESIDE_M), pedestrians(walker))

    return everybody


@pytest.mark.slow
@pytest.mark.parametrize("at_s", few([4.4, 3.0, 5.1], 1))
def test_whoever_steps_out_is_not_hit(at_s: float) -> None:
    states = foresee(ALONG, ego(30.0, 0.0, 11.0), stepping_out(at_s, 1.4), seconds=12.0)  # which looks at every touch
    assert states[-1].x_m > END_M


def stopping(until_m: float) -> Callable[[float], Actors]:
    """Who walks from the right across the road and stops where y is so large."""

    def everybody(time_s: float) -> Actors:
        y_m = min(-6.0 + 1.4 * time_s, until_m)
        return pedestrians((75.0, y_m, 1.4 if y_m < until_m else 0.0, np.pi / 2))

    return everybody


@pytest.mark.slow
@pytest.mark.parametrize("until_m", few([0.0, -1.2, 1.2], 1))
@pytest.mark.parametrize("x_m", few([28.0, 36.0], 1))
def test_who_stops_midway_is_not_hit_whenever_that_is(until_m: float, x_m: float) -> None:
    front_m, _ = fronts(foresee(ALONG, ego(x_m, 0.0, 11.0), stopping(until_m), seconds=8.0))
    assert front_m[-1] > 65.0
