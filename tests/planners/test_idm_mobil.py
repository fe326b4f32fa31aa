from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from worlds import cars, ego, junction, mission, observation, road_along, straight_road

from interplan_planners.idm import IdmPlanner
from interplan_planners.idm_mobil import IdmMobilPlanner, IdmMobilSettings
from interplan_sumo.dynamics.lqr import follow
from interplan_sumo.plan_check import check_plan
from interplan_sumo.planner import Mission
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import Polyline
from tests.planners.staging_planners import driven

WIDE = straight_road(lanes=3, length_m=600.0, limit_mps=13.9, cuts_m=((400.0, 410.0),))
TO_THE_LEFT = mission(WIDE, ("11", "21", "31"), goal_arc_m=150.0)
STRAIGHT_ON = mission(WIDE, ("12", "22", "32"), goal_arc_m=150.0)
CROSSING = junction()


def started(job: Mission = STRAIGHT_ON, **options: Any) -> IdmMobilPlanner:
    planner = IdmMobilPlanner(IdmMobilSettings(**options))
    planner.start(job)
    return planner


def stream(spacing_m: float) -> Actors:
    """Cars at 10 m/s on the goal lane, evenly spaced, over half a kilometre."""
    return cars(*((x_m, 0.0, 10.0) for x_m in np.arange(-200.0, 300.0, spacing_m).tolist()))


def test_it_changes_lane_after_lane_to_the_goal() -> None:
    states = driven(started(TO_THE_LEFT), ego(20.0, -7.0, 12.0), 160)
    assert states[-1].y_m == pytest.approx(0.0, abs=0.3)
    assert max(abs(s.heading_rad) for s in states) < 0.15
    assert max(abs(s.yaw_rate_radps) for s in states) < 0.2
    assert max(abs(s.vx_mps * s.yaw_rate_radps) for s in states) < 2.0


@pytest.mark.slow
def test_beside_a_stream_it_takes_a_gap() -> None:
    """Cars every 32 m at 10 m/s on the goal lane: it must fit in between, and does without touching."""
    states = driven(started(TO_THE_LEFT), ego(20.0, -3.5, 13.0), 220, stream(32.0))
    assert states[-1].y_m == pytest.approx(0.0, abs=0.5)


def test_no_gap_no_change() -> None:
    states = driven(started(TO_THE_LEFT), ego(20.0, -3.5, 10.0), 60, stream(7.0))
    assert {s.y_m > -3.0 for s in states} == {False}


def test_a_fast_follower_is_let_pass() -> None:
    planner = started(TO_THE_LEFT)
    states = driven(planner, ego(20.0, -3.5, 8.0), 60, cars((2.0, 0.0, 15.0)))
    early = [s.y_m for s in states[:12]]
    assert max(early) < -3.3
    assert states[-1].y_m > -1.0


def test_on_a_connector_it_does_not_change() -> None:
    states = driven(started(TO_THE_LEFT), ego(402.0, -3.5, 8.0), 5)
    assert states[-1].y_m == pytest.approx(-3.5, abs=0.01)


def test_it_gives_up_when_the_gap_closes() -> None:
    """A car that was far behind at first comes at 25 m/s: the change is begun and taken back."""
    planner = started(TO_THE_LEFT)
    state = ego(60.0, -3.5, 10.0)
    manoeuvres: list[tuple[str, str]] = []
    y_m: list[float] = []
    for k in range(80):
        behind = cars((state.x_m - 80.0, 0.0, 10.0)) if k < 8 else cars((state.x_m - 14.0 + 0.3 * (k - 8), 0.0, 20.0))
        plan = planner.plan(observation(state, behind))
        check_plan(plan, state, state.time_s)
        state = follow(state, plan, 0.1)
        assert planner.decision is not None
        manoeuvres.append((planner.decision.manoeuvre, planner.decision.lane))
        y_m.append(state.y_m)
    assert manoeuvres[2] == ("change", "11")
    assert "abort" in dict(manoeuvres)
    assert max(y_m) < -1.75 - PACIFICA.width_m / 2 + 1.2
    assert y_m[-1] == pytest.approx(-3.5, abs=0.6)


def test_it_goes_round_what_stands_in_its_lane_and_comes_back() -> None:
    states = driven(started(), ego(110.0, -3.5, 12.0), 220, cars((200.0, -3.5)))
    assert states[-1].x_m > 260.0
    assert states[-1].y_m == pytest.approx(-3.5, abs=0.5)


def test_behind_a_slow_car_it_changes_only_where_that_costs_nothing() -> None:
    kept = driven(started(), ego(40.0, -3.5, 10.0), 100, cars((90.0, -3.5, 4.0)))
    assert max(abs(s.y_m + 3.5) for s in kept) < 0.1


@pytest.mark.parametrize("name", ["safe_deceleration_mps2", "change_time_s", "change_headway_s", "horizon_s"])
def test_senseless_options_are_refused_by_name(name: str) -> None:
    with pytest.raises(ValueError, match=f"{name} is 0, expected more than 0"):
        IdmMobilSettings(**{name: 0})  # type: ignore[arg-type]


def test_published_it_swerves() -> None:
    states = driven(started(TO_THE_LEFT, published=True), ego(20.0, -3.5, 12.0), 60)
    assert states[-1].y_m == pytest.approx(0.0, abs=0.6)
    assert max(abs(s.heading_rad) for s in states) > 0.2


def test_published_it_minds_no_follower() -> None:
    """On a road to the north its sweep looks west; the corrected planner waits for the car, this one cuts in."""
    line = Polyline(np.array(((0.0, 0.0), (0.0, 600.0))))
    job = mission(road_along(line, lanes=2, limit_mps=13.9), ("11",))
    for planner, cuts_in in ((started(job, published=True), True), (started(job), False)):
        state = ego(3.5, 30.0, 13.0, heading_rad=np.pi / 2)
        for k in range(15):
            plan = planner.plan(observation(state, cars((0.0, 5.0 + 2.0 * k, 20.0, np.pi / 2))))
            state = follow(state, plan, 0.1)
        assert (state.x_m < 3.0) is cuts_in


def test_published_it_slows_down_where_it_is_refused() -> None:
    beside = driven(started(TO_THE_LEFT, published=True), ego(250.0, -3.5, 12.0), 25, cars((250.0, 0.0, 12.0)))
    assert beside[20].vx_mps < 11.5


def test_published_on_one_lane_it_is_nuplans_idm() -> None:
    road = straight_road(lanes=1, length_m=400.0, limit_mps=13.4)
    job = mission(road, ("11",))
    idm = IdmPlanner()
    idm.start(job)
    scene = observation(ego(20.0, 0.1, 9.0), cars((55.0, 0.3, 4.0)))
    plan, other = started(job, published=True).plan(scene), idm.plan(scene)
    assert plan.x_m[:10] == pytest.approx(other.x_m[:10], abs=1e-9)
