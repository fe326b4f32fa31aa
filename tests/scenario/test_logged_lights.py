"""Logged lights: runs of equal status, what scenarios accept, and what they show step by step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from interplan_sumo.errors import ScenarioError
from interplan_sumo.scenario.recorded_lights import AROUND_M, with_recorded_lights
from interplan_sumo.scenario.recorded_parts import LightStatus, LoggedLight
from interplan_sumo.scenario.scenario import LanePosition, Scenario
from interplan_sumo.simulation.lights import LoggedLights
from interplan_sumo.tiny_worlds import junction, straight_road
from interplan_sumo.verification.map_bundling import ALONG_M, KEPT_M
from interplan_sumo.world.recording import Recording
from interplan_sumo.world.signals import SignalStatus

ROADS = junction()
BARE = Scenario(
    "tiny.recorded/0", "recorded", "tiny_junction", LanePosition("1", 10.0), 8.0, LanePosition("7", 30.0),
    ("1", "13", "7"), duration_s=5.0,
)  # fmt: skip
RED = LoggedLight("13", (0, 20), ("red", "green"))


@pytest.mark.parametrize(
    ("steps", "shows", "said"),
    [
        ((), (), "steps begins with []"),
        ((1,), ("red",), "expected 0, the start of the drive"),
        ((0, 5, 5), ("red", "green", "red"), "steps do not increase"),
        ((0, 5), ("red",), "shows has 1 entries, expected 2"),
        ((0,), ("blue",), "shows 'blue', expected one of green, yellow, red, unknown"),
    ],
)
def test_a_light_that_cannot_be_is_refused(steps: tuple[int, ...], shows: tuple[LightStatus, ...], said: str) -> None:
    with pytest.raises(ScenarioError) as error:
        LoggedLight("13", steps, shows)
    assert said in str(error.value)


def test_each_status_holds_until_the_next() -> None:
    assert [RED.at(step) for step in (0, 19, 20, 999)] == [SignalStatus.RED] * 2 + [SignalStatus.GREEN] * 2


def test_a_scenario_refuses_a_connector_twice_and_what_the_map_does_not_control() -> None:
    with pytest.raises(ScenarioError, match="lights holds connector '13' twice"):
        replace(BARE, lights=(RED, RED))
    replace(BARE, lights=(RED,)).check(ROADS)
    with pytest.raises(ScenarioError, match=r"lights\[0\]: map tiny_junction has no connector '99'"):
        replace(BARE, lights=(replace(RED, connector="99"),)).check(ROADS)
    road = straight_road(cuts_m=((50.0, 60.0),))
    unlit = Scenario("a/0", "a", "tiny_road", LanePosition("11", 5.0), 0.0, LanePosition("31", 9.0), ("1", "2", "3"))
    with pytest.raises(ScenarioError, match="no connector with a traffic light '21'"):
        replace(unlit, lights=(replace(RED, connector="21"),)).check(road)


# --- from a recording ------------------------------------------------------------------------------


def recording(step_s: float = 0.1, **lights: list[int]) -> Recording:
    codes = {name.removeprefix("c"): np.array(status, dtype=np.int64) for name, status in lights.items()}
    return Recording("made", ROADS.crs, step_s, (), lights=codes)


@given(status=st.lists(st.integers(0, 3), min_size=1, max_size=80), step=st.integers(0, 20))
def test_every_step_shows_what_was_recorded_and_unknown_after_the_end(status: list[int], step: int) -> None:
    scenario, _ = with_recorded_lights(BARE, recording(c13=status), ROADS, step)
    expected = [*status[step:], *[3] * 51][:51]
    shown = {light.connector: light for light in scenario.lights}
    assert [int(shown["13"].at(k)) if "13" in shown else 3 for k in range(51)] == expected


@pytest.mark.parametrize(("step_s", "change"), [(0.1, 10), (0.2, 20), (0.05, 5)])
def test_a_recording_with_other_steps_is_shown_in_time(step_s: float, change: int) -> None:
    scenario, _ = with_recorded_lights(BARE, recording(step_s, c13=[2] * 10 + [0] * 200), ROADS, 0)
    assert scenario.lights == (LoggedLight("13", (0, change), ("red", "green")),)


def test_lights_that_the_map_does_not_have_are_named() -> None:
    scenario, note = with_recorded_lights(BARE, recording(c13=[2] * 60, c99=[2] * 60), ROADS, 0)
    assert [light.connector for light in scenario.lights] == ["13"]
    assert note == "map tiny_junction has no traffic light at 1 connectors with a recorded one: 99"


@pytest.mark.parametrize(("away_m", "kept"), [(-1.0, True), (1.0, False)])
def test_lights_far_from_the_route_are_left_out(away_m: float, kept: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    from interplan_sumo.scenario import recorded_lights

    connector = ROADS.connectors["24"]
    apart_m = 0.0  # it crosses the route
    monkeypatch.setattr(recorded_lights, "AROUND_M", apart_m - away_m)
    assert connector.has_traffic_light
    scenario, _ = with_recorded_lights(BARE, recording(c24=[2] * 60), ROADS, 0)
    assert bool(scenario.lights) is kept
    assert KEPT_M - ALONG_M / 2.0 - AROUND_M >= 100.0  # more than a connector is long: none is cut off with its map


# --- in a simulation -------------------------------------------------------------------------------


def test_what_switches_is_told_once_and_connectors_without_a_record_are_unknown() -> None:
    links = {"13": ("a", 0), "14": ("a", 1), "24": ("b", 0)}
    lights = LoggedLights.on((RED, LoggedLight("99", (0,), ("red",))), links)
    assert lights.changes(0) == {"13": SignalStatus.RED, "14": SignalStatus.UNKNOWN}
    assert [lights.changes(step) for step in (1, 19, 20, 21)] == [{}, {}, {"13": SignalStatus.GREEN}, {}]
    assert lights.signals(25).connector_ids == ("13",)
