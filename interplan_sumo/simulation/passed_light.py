"""The light that the ego has just passed shows green when an episode begins: else it would have run a red light.

Whatever its program would show, it would also cut the ego off from the traffic behind it.
"""

from __future__ import annotations

from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.lane_chains import ChainedLane, upstream_of
from interplan_sumo.simulation.light_cycles import LightCycles
from interplan_sumo.simulation.network import SumoNetwork

PASSED_M = 100.0
"""So far behind the ego a light can be."""


def lights_at_start(network: SumoNetwork, ids: NetworkIds, scenario: Scenario) -> LightCycles:
    """The lights of a scenario when it begins, as its map has them: what a recording shows comes on top."""
    lights = network.lights.later(scenario.light_time_s)
    if scenario.lights:
        return lights
    lane, fraction = ids.sumo_place(scenario.start.lane, scenario.start.arc_m)
    return with_passed_light(network, lights, lane, fraction * network.lanes[lane].length_m)


def with_passed_light(network: SumoNetwork, lights: LightCycles, lane: str, position_m: float) -> LightCycles:
    """Lights of which the next one behind a place on a normal lane, if there is one, has just become green.

    It begins its first phase in which who goes straight on to that place need not yield.
    """
    here = ChainedLane(network.lanes[lane], -position_m, None)
    for part in reversed(upstream_of(network, here, set(), PASSED_M)):
        if part.link is not None and part.link.light is not None and part.end_m > -PASSED_M:
            light, index = part.link.light
            state = next((state for state in lights.states(light) if state[index] == "G"), None)
            return lights if state is None else lights.beginning({light: state})
    return lights
