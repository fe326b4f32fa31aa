"""Recorded lights: the traffic lights of a recording around a scenario, from its start on."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
import shapely

from interplan_sumo.scenario.recorded_parts import STATUS, LightStatus, LoggedLight
from interplan_sumo.scenario.route import route_centerline
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.geometry import Ints
from interplan_sumo.world.recording import Recording
from interplan_sumo.world.roads import Roads

AROUND_M: Final = 250.0
"""Lights farther than this from the route are left out. Maps that are cut down keep every lane within 400 m of it."""
STEP_S: Final = 0.1
"""Of a scenario."""
NAMED: Final = 5
"""So many connectors are named in a note."""
_NAMES: Final[dict[int, LightStatus]] = {code: name for name, code in STATUS.items()}  # type: ignore[misc]


def with_recorded_lights(scenario: Scenario, recording: Recording, roads: Roads, step: int) -> tuple[Scenario, str]:
    """The scenario with what lights near its route showed from `step` of the recording on, and a note or "".

    After the end of the recording the status is unknown. The note names the
    connectors that the map does not have, or controls by no traffic light.
    """
    route = shapely.LineString(route_centerline(roads, scenario).points)
    lights: list[LoggedLight] = []
    unfit: list[str] = []
    for id_, status in sorted(recording.lights.items()):
        connector = roads.connectors.get(id_)
        if connector is None or not connector.has_traffic_light:
            unfit.append(id_)
        elif route.distance(connector.polygon) <= AROUND_M:
            lights.append(_light(id_, status, recording.step_s, step, round(scenario.duration_s / STEP_S) + 1))
    shown = tuple(light for light in lights if light.shows != ("unknown",))
    more = ", ..." if len(unfit) > NAMED else ""
    names = f"{', '.join(unfit[:NAMED])}{more}"
    note = f"map {roads.name} has no traffic light at {len(unfit)} connectors with a recorded one: {names}"
    return replace(scenario, lights=shown), note if unfit else ""


def _light(connector: str, status: Ints, step_s: float, start: int, steps: int) -> LoggedLight:
    """The runs of equal status over the steps of the drive; each step shows what was recorded last."""
    at = start + np.floor(np.arange(steps) * STEP_S / step_s + 1e-6).astype(np.int64)
    inside = status[np.minimum(at, len(status) - 1)]
    shown = np.where(at < len(status), inside, int(STATUS["unknown"]))
    first = np.flatnonzero(np.append(True, shown[1:] != shown[:-1]))
    return LoggedLight(connector, tuple(first.tolist()), tuple(_NAMES[int(code)] for code in shown[first]))
