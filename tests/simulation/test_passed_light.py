"""The light that the ego has just passed is green at the start, for it and for those behind it."""

from __future__ import annotations

from dataclasses import replace

from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.store import find_map, load_roads
from interplan_sumo.scenario.recorded_parts import LoggedLight
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.network import SumoNetwork, read_network
from interplan_sumo.simulation.passed_light import PASSED_M, with_passed_light
from interplan_sumo.simulation.setup import open_traffic
from interplan_sumo.simulation.sumo import sumo
from tests.scenes import scene

PASSED = scene("lane_change_htd/4")
"""Starts 12 m behind a light of which the program begins red for it."""


def network_of(scenario: Scenario) -> SumoNetwork:
    return read_network(find_map(scenario.map).network)


def place(scenario: Scenario) -> tuple[str, float]:
    ids, network = NetworkIds.read(find_map(scenario.map).ids), network_of(scenario)
    lane, share = ids.sumo_place(scenario.start.lane, scenario.start.arc_m)
    return lane, share * network.lanes[lane].length_m


def passed(network: SumoNetwork) -> tuple[str, str]:
    """The light that PASSED has behind it, and what it shows first."""
    shown = with_passed_light(network, network.lights, *place(PASSED)).shown
    ((light, state),) = shown.items() - network.lights.shown.items()
    return light, state


def test_it_begins_with_the_first_phase_that_is_green_for_the_way_to_the_ego() -> None:
    network, (lane, position_m) = network_of(PASSED), place(PASSED)
    (straight,) = (link for link in network.incoming[lane] if link.direction == "s")
    assert straight.light is not None
    light, index = straight.light
    for time_s in (0.0, 7.0, 33.3):
        lights = network.lights.later(time_s)
        changed = with_passed_light(network, lights, lane, position_m)
        first = next(each for each in lights.states(light) if each[index] == "G")
        assert changed == lights.beginning({light: first})
        assert changed.shown == {**lights.shown, light: first}
    assert network.lights.shown[light][index] == "r"


def test_a_light_that_is_far_behind_keeps_its_program() -> None:
    network, (lane, position_m) = network_of(PASSED), place(PASSED)
    (link,) = (link for link in network.incoming[lane] if link.direction == "s")
    junction_m = sum(network.lanes[inner].length_m for inner in link.via)
    assert position_m + junction_m < PASSED_M
    lights = network.lights
    assert with_passed_light(network, lights, lane, PASSED_M - junction_m - 0.1) != lights
    assert with_passed_light(network, lights, lane, PASSED_M - junction_m + 0.1) == lights


def test_sumo_shows_it_for_the_whole_phase_and_goes_on_with_the_program() -> None:
    network = network_of(PASSED)
    light, state = passed(network)
    programs = network.lights.states(light)
    with open_traffic(PASSED, load_roads(PASSED.map), most_agents=0) as traffic:
        shown = [sumo.trafficlight.getRedYellowGreenState(light)]
        assert sumo.trafficlight.getNextSwitch(light) - sumo.simulation.getTime() >= 10.0
        while shown[-1] == state:
            traffic.advance()
            shown.append(sumo.trafficlight.getRedYellowGreenState(light))
    assert shown[-1] == programs[(programs.index(state) + 1) % len(programs)]


def test_what_was_recorded_of_lights_is_not_touched() -> None:
    light, _ = passed(network_of(PASSED))
    links = NetworkIds.read(find_map(PASSED.map).ids).links
    connector, (_, index) = next(item for item in links.items() if item[1][0] == light)
    recorded = replace(PASSED, lights=(LoggedLight(connector, (0,), ("red",)),))
    with open_traffic(recorded, load_roads(PASSED.map), most_agents=0):
        assert sumo.trafficlight.getRedYellowGreenState(light)[index] == "r"
        assert sumo.trafficlight.getProgram(light) == "online"
