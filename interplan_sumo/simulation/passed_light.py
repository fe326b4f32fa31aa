"""The light that the ego has just passed shows green when an episode begins: else it would have run a red light.

Whatever its program would show, it would also cut the ego off from the traffic behind it.
"""

from __future__ import annotations

from collections.abc import Mapping

from interplan_sumo.simulation.lane_chains import ChainedLane, upstream_of
from interplan_sumo.simulation.network import SumoNetwork

PASSED_M = 100.0
"""So far behind the ego a light can be."""


def passed_light(network: SumoNetwork, lane: str, position_m: float) -> Mapping[str, str]:
    """The state at the start of the next light behind a place on a normal lane, by its id; empty if there is none.

    It is the first state of its program in which who goes straight on to that place need not yield.
    """
    here = ChainedLane(network.lanes[lane], -position_m, None)
    for part in reversed(upstream_of(network, here, set(), PASSED_M)):
        if part.link is not None and part.link.light is not None and part.end_m > -PASSED_M:
            light, index = part.link.light
            state = next((state for state in network.programs[light] if state[index] == "G"), None)
            return {light: state} if state is not None else {}
    return {}
