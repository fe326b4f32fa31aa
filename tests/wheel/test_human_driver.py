"""A person as a planner: hands become plans that can be followed, in real time, and a drive waits for its driver."""

from __future__ import annotations

import threading
import time
from collections.abc import Generator
from contextlib import contextmanager
from math import pi

import numpy as np
import pytest

from interplan_sumo.dynamics.lqr import follow
from interplan_sumo.plan_check import check_plan
from interplan_sumo.planner import Mission, Observation, Past
from interplan_sumo.report.replay.drawn_scene import DrawnScene
from interplan_sumo.scenario.route import way_ahead
from interplan_sumo.wheel.cockpit import Act, Cockpit, Hands
from interplan_sumo.wheel.human_driver import SIDEWAYS_MPS2, Handover, HumanDriver, largest_turn_rad
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.signals import Signals
from tests.metrics.staging import scenario_on
from tests.worlds import cars, straight_road

ROADS = straight_road()
SCENARIO = scenario_on(ROADS, ("11", 10.0), ("11", 90.0))
SCENE = DrawnScene.of(ROADS, SCENARIO)
FAST = 1000.0
"""Rate at which nobody waits."""


def seen(ego: EgoState) -> Observation:
    return Observation(ego.time_s, ego, cars((60.0, 0.0)), Signals.none(), Past((), ()))


def seated(cockpit: Cockpit, rate: float = FAST, handover: Handover | None = None) -> HumanDriver:
    person = HumanDriver(cockpit, SCENE, way_ahead(ROADS, SCENARIO), rate=rate, handover=handover)
    person.start(Mission(ROADS, SCENARIO.route, SCENARIO.goal.pose(ROADS)))
    return person


def driven(hands: Hands, steps: int, speed_mps: float = 10.0) -> list[EgoState]:
    """The ego, step by step, while the hands hold the same."""
    cockpit = Cockpit()
    cockpit.watch()
    cockpit.hold(replace_act(hands, "start"))
    person = seated(cockpit)
    egos = [EgoState(0.0, 0.0, 0.0, 0.0, vx_mps=speed_mps)]
    for _ in range(steps):
        ego = egos[-1]
        plan = person.plan(seen(ego))
        check_plan(plan, ego, ego.time_s)
        egos.append(follow(ego, plan, 0.1))
    return egos


def replace_act(hands: Hands, act: Act) -> Hands:
    return Hands(max(hands.number, 1), hands.push, hands.turn, act)


def test_hands_off_keep_speed_and_direction() -> None:
    end = driven(Hands(), 30)[-1]
    assert end.vx_mps == pytest.approx(10.0, abs=0.05)
    assert end.heading_rad == pytest.approx(0.0, abs=1e-3)


def test_throttle_and_brake_do_what_they_are_for_and_the_hardest_braking_comes_at_once() -> None:
    assert driven(Hands(push=1.0), 30)[-1].vx_mps > 14.0
    gentle, hard = (driven(Hands(push=push), 3)[-1].vx_mps for push in (-0.45, -1.0))
    assert hard < gentle < 10.0
    assert driven(Hands(push=-1.0), 40)[-1].vx_mps == pytest.approx(0.0, abs=0.2)


def test_left_is_left_and_no_speed_makes_it_a_skid() -> None:
    for turn in (1.0, -1.0):
        for speed_mps in (2.0, 10.0, 20.0):
            egos = driven(Hands(turn=turn), 20, speed_mps)
            assert np.sign(egos[-1].heading_rad) == turn
            sideways = max(abs(ego.yaw_rate_radps) * ego.vx_mps for ego in egos)
            assert sideways < 1.3 * SIDEWAYS_MPS2
    assert largest_turn_rad(0.0, PACIFICA) == 0.5
    assert 0.0 < largest_turn_rad(30.0, PACIFICA) < 0.02


def test_it_waits_until_somebody_starts_and_while_they_pause() -> None:
    cockpit = Cockpit()
    viewer = cockpit.watch()
    person = seated(cockpit, rate=1.0)
    ego = EgoState(0.0, 0.0, 0.0, 0.0, vx_mps=10.0)
    with planning(person, ego) as done:
        assert not done.wait(0.15)
        cockpit.hold(Hands(1, act="start"))
        assert done.wait(2.0)
    began_s = time.monotonic()
    with planning(person, ego) as done:
        assert done.wait(2.0)
    assert time.monotonic() - began_s > 0.05  # the first step was due at once, this one 0.1 s later
    cockpit.hold(Hands(2, act="pause"))
    with planning(person, ego) as done:
        assert not done.wait(0.25)
        cockpit.hold(Hands(3, act="pause"))
        assert done.wait(2.0)
    cockpit.unwatch(viewer)
    with planning(person, ego) as done:
        assert not done.wait(0.25)  # nobody looks
        cockpit.watch()
        cockpit.hold(Hands(1, act="pause"))
        assert done.wait(2.0)


@contextmanager
def planning(person: HumanDriver, ego: EgoState) -> Generator[threading.Event]:
    """The person plans, in a thread; the event says that it has."""
    done = threading.Event()

    def plan() -> None:
        person.plan(seen(ego))
        done.set()

    thread = threading.Thread(target=plan, daemon=True)
    thread.start()
    yield done
    thread.join(2.0)


def test_the_page_is_told_where_everybody_is_as_planners_see_it() -> None:
    cockpit = Cockpit()
    viewer = cockpit.watch()
    cockpit.hold(Hands(1, act="start"))
    seated(cockpit).plan(seen(EgoState(0.0, 5.0, 0.0, pi / 2, vx_mps=3.0)))
    told = cockpit.events(viewer, 0, 0, 0.0)
    assert told is not None
    text = told[2][0].decode()
    assert '"speed_mps":3.0' in text
    assert '"agents":[["' in text
    assert '"vehicle"' in text
