"""What SUMO has from the start besides agents: stopped proxies where obstacles block lanes, lights in their phases."""

from __future__ import annotations

from collections.abc import Iterable

from interplan_sumo.simulation.ego_proxy import NO_LANE_CHANGE
from interplan_sumo.simulation.light_cycles import LightCycles
from interplan_sumo.simulation.network import SumoNetwork
from interplan_sumo.simulation.obstacles import LaneBlockage
from interplan_sumo.simulation.sumo import Commanding, sumo

LEAST_M = 0.5
"""No proxy is shorter."""
FOR_EVER_S = 1e6


def block_lanes(network: SumoNetwork, blocked: Iterable[LaneBlockage]) -> None:
    """Stopped proxies where obstacles block a lane; only SUMO's own cars see them."""
    for i, each in enumerate(blocked):
        name, lane = f"obstacle{i}", network.lanes[each.lane]
        length_m = max(LEAST_M, each.end_m - each.start_m)
        front_m = round(min(max(each.end_m, length_m), lane.length_m) - 0.005, 2)
        with Commanding(f"blocking lane {each.lane} at {each.start_m:.1f} m"):
            sumo.vehicletype.copy("DEFAULT_VEHTYPE", name)
            sumo.vehicletype.setLength(name, length_m)
            sumo.route.add(name, (lane.edge,))
            sumo.vehicle.add(name, name, name, departLane=str(lane.index), departPos=f"{front_m:.2f}", departSpeed="0")
            sumo.vehicle.setStop(name, lane.edge, front_m, lane.index, FOR_EVER_S)
            sumo.vehicle.setLaneChangeMode(name, NO_LANE_CHANGE)


def switch_lights(programs: LightCycles, wanted: LightCycles) -> None:
    """Let lights go on as wanted where their programs begin otherwise."""
    with Commanding("switching lights"):
        for light in sumo.trafficlight.getIDList():
            phases = wanted.phases.get(light, ())
            if phases == programs.phases.get(light, ()):
                continue
            first = phases[0]
            sumo.trafficlight.setPhase(light, first.index)
            if phases[-1].index == first.index:  # it has begun before
                sumo.trafficlight.setPhaseDuration(light, first.duration_s)
