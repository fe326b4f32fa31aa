"""Light cycles are what SUMO's lights show, from any moment on."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from interplan_sumo.errors import ScenarioError
from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.store import find_map, load_roads
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.light_cycles import SOON_S, LightCycles, Phase
from interplan_sumo.simulation.lights import Lights
from interplan_sumo.simulation.network import read_network
from interplan_sumo.simulation.passed_light import with_passed_light
from interplan_sumo.simulation.setup import open_traffic
from tests.scenes import scene

DURATIONS = st.lists(st.integers(1, 600), min_size=1, max_size=6)
TIMES = st.integers(0, 3000)


def cycles(tenths: list[int]) -> LightCycles:
    """One light whose phases have these lengths, each with a state of its own."""
    return LightCycles({"c": tuple(Phase(i, chr(97 + i), n / 10) for i, n in enumerate(tenths))})


@given(DURATIONS, TIMES, TIMES)
def test_what_comes_later_does_not_depend_on_the_steps_that_lead_there(tenths: list[int], a: int, b: int) -> None:
    lights = cycles(tenths)
    assert lights.later(a / 10).later(b / 10) == lights.later((a + b) / 10)
    assert lights.later(a / 10).at("c", b / 10) == lights.at("c", (a + b) / 10)


@given(DURATIONS, TIMES)
def test_a_cycle_is_as_long_as_before_and_its_states_come_in_their_order(tenths: list[int], a: int) -> None:
    lights, later = cycles(tenths), cycles(tenths).later(a / 10)
    assert sum(phase.duration_s for phase in later.phases["c"]) == pytest.approx(sum(tenths) / 10)
    at = lights.states("c").index(later.shown["c"])
    assert later.states("c") == (*lights.states("c")[at:], *lights.states("c")[:at])
    assert later.beginning({"c": "a"}) == lights


@pytest.mark.parametrize(("left_s", "stays"), [(SOON_S, False), (SOON_S + 0.1, True)])
def test_a_green_that_is_about_to_switch_does_not_stay(left_s: float, stays: bool) -> None:
    phases = (Phase(0, "Gr", 30.0), Phase(1, "rG", 30.0))
    lights = LightCycles({"c": phases}).later(30.0 - left_s)
    assert lights.stay_green("c", 0) is stays
    assert not lights.stay_green("c", 1)


@pytest.mark.parametrize("name", ["lane_change_htd/0", "lane_change_htd/4"])
@pytest.mark.parametrize("light_time_s", [0.0, 13.0, 47.3])
def test_sumo_shows_what_the_cycles_say_step_by_step(name: str, light_time_s: float) -> None:
    scenario = replace(scene(name), light_time_s=light_time_s)
    files = find_map(scenario.map)
    network, ids = read_network(files.network), NetworkIds.read(files.ids)
    lane, share = ids.sumo_place(scenario.start.lane, scenario.start.arc_m)
    lights = network.lights.later(light_time_s)
    lights = with_passed_light(network, lights, lane, share * network.lanes[lane].length_m)
    known = Lights(ids.links)
    with open_traffic(scenario, load_roads(scenario.map), most_agents=0) as traffic:
        for step in range(500):
            expected = known.signals([lights.at(light, step * 0.1) for light in known.ids])
            assert traffic.observe().signals.status.tolist() == expected.status.tolist(), step
            traffic.advance()


@pytest.mark.parametrize("light_time_s", [-0.1, float("nan"), float("inf")])
def test_lights_have_run_for_some_time(light_time_s: float) -> None:
    with pytest.raises(ScenarioError, match=r"light_time_s is .*, expected 0 to 3600"):
        replace(scene("nudge/0"), light_time_s=light_time_s)


def test_a_scene_whose_lights_begin_with_their_programs_keeps_its_hash() -> None:
    plain: Scenario = scene("nudge/0")
    assert "light_time_s" not in plain.canonical()
    assert replace(plain, light_time_s=5.0).hash() != plain.hash()
