"""Light windows: does the way to the goal leave time for the traffic, with the lights as they switch?

Lights do not depend on who drives, so that this is known before anybody does.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Final

import numpy as np

from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.store import find_map
from interplan_sumo.scenario.nominal_drive import nominal_drive, reaches_goal
from interplan_sumo.scenario.route import route_centerline, route_lanes
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.episode import DT_S
from interplan_sumo.simulation.network import read_network
from interplan_sumo.simulation.passed_light import lights_at_start
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.roads import Connector, Roads

DELAYS_S: Final = (5.0, 10.0)
"""Who comes to the lights so much later than on an empty road is still in time: nobody fails for a second."""
RED_FOR_LEADER_S: Final = (-2.0, 6.0)
"""From before a leader comes to its light until after, it is red: whoever follows has stopped by then, too."""
RED_FOR_QUEUE_S: Final = (0.0, 2.0)
"""A queue stands at first."""
STOPPED_S: Final = 3.0
"""Who had to stop for a light is this much later than one who drives through as it turns green."""
TIME_SHARE: Final = 0.7
"""On an empty road one is at the goal line after this share of the time at most: the rest is the traffic's."""


def light_problems(scenario: Scenario, roads: Roads) -> list[str]:
    """Whether lights leave too little time, in one sentence; empty if there is enough."""
    way = LitWay.of(scenario, roads)
    needed_s, most_s = way.time_to_goal_s(), TIME_SHARE * scenario.duration_s
    if needed_s <= most_s:
        missed = [late_s for late_s in DELAYS_S if way.time_to_goal_s(late_s) > scenario.duration_s]
        return [f"who is {missed[0]:.0f} s late misses the light and cannot be in time any more"] if missed else []
    return [f"on an empty road the goal line is {needed_s:.0f} s away with its lights, expected {most_s:.0f} s at most"]


def green_too_soon(scenario: Scenario, roads: Roads) -> list[str]:
    """Whether nobody has to stop in a type of ordinary driving that is about stopping at a light."""
    light = next((each for each in _lights(scenario, roads)), None)
    if light is None or scenario.family not in ("stopping_with_lead", "stationary_in_traffic"):
        return []
    from_s, to_s = RED_FOR_QUEUE_S
    if scenario.family == "stopping_with_lead":
        lead = scenario.vehicles[0]
        left_m = roads[lead.place.lane].centerline.length_m - lead.place.arc_m
        from_s, to_s = (max(left_m / lead.speed_mps + each_s, 0.0) for each_s in RED_FOR_LEADER_S)
    if set(_shown(scenario, light)[int(from_s / DT_S) : int(to_s / DT_S) + 1]) <= set("rus"):
        return []
    return [f"light {light.id} is not red from {from_s:.1f} to {to_s:.1f} s: nobody stops for it"]


def _lights(scenario: Scenario, roads: Roads) -> list[Connector]:
    """The connectors with a traffic light on the way, in order."""
    found = [roads.connectors.get(lane) for lane in route_lanes(roads, scenario)]
    return [each for each in found if each is not None and each.has_traffic_light]


@dataclass(frozen=True, slots=True)
class LitWay:
    """The nominal drive to the goal, and what the lights on its way show."""

    drive_s: float
    """Without any light; infinite if it does not come there."""
    lights: tuple[tuple[float, str], ...]
    """When it comes to each, and SUMO's letter for it in each step."""

    @classmethod
    def of(cls, scenario: Scenario, roads: Roads) -> LitWay:
        """That of a scenario; only lights ahead of its start count."""
        track = nominal_drive(roads, scenario)
        if not reaches_goal(roads, scenario, track):
            return cls(inf, ())
        line = route_centerline(roads, scenario)
        arc_m, _ = line.project(np.stack((track.x_m, track.y_m), axis=1))
        lights: list[tuple[float, str]] = []
        for connector in _lights(scenario, roads):
            begins_m = line.project_point(*connector.centerline.points[0].tolist())[0] - PACIFICA.length_m / 2.0
            at_line = np.flatnonzero(arc_m >= begins_m)
            if len(at_line) > 0 and arc_m[0] < begins_m:
                lights.append((DT_S * int(at_line[0]), _shown(scenario, connector)))
        return cls(float(track.time_us[-1]) * 1e-6, tuple(lights))

    def time_to_goal_s(self, late_s: float = 0.0) -> float:
        """How long it takes with the lights, at the first `late_s` later; infinite if it does not come there."""
        for at_s, shown in self.lights:
            arrives_s = at_s + late_s
            opens_s = _green_from_s(shown, arrives_s)
            if opens_s == inf:
                return inf
            if opens_s > arrives_s:
                late_s += opens_s - arrives_s + STOPPED_S
        return self.drive_s + late_s


def _green_from_s(shown: str, from_s: float) -> float:
    """When a light is green first, from a time on."""
    return next((max(from_s, i * DT_S) for i in range(int(from_s / DT_S), len(shown)) if shown[i] in "Gg"), inf)


def _shown(scenario: Scenario, connector: Connector) -> str:
    """SUMO's letter for a connector in each step, where lights of the map switch by their programs alone."""
    files = find_map(scenario.map, scenario.maps_beside)
    network, ids = read_network(files.network), NetworkIds.read(files.ids)
    lights = lights_at_start(network, ids, scenario)
    light, index = ids.links[connector.id]
    return "".join(lights.at(light, i * DT_S)[index] for i in range(round(scenario.duration_s / DT_S)))
