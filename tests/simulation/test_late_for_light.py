"""A light that turns red halts nobody dead: who cannot stop any more drives on, and who can stops."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.store import find_map
from interplan_sumo.simulation.lane_chains import continued_route
from interplan_sumo.simulation.late_for_light import stopping_m
from interplan_sumo.simulation.network import NetworkLink, SumoNetwork, read_network
from interplan_sumo.simulation.spawning import Spawn
from interplan_sumo.simulation.sumo import sumo
from interplan_sumo.simulation.sumo_traffic import SumoTraffic, TrafficSetup
from interplan_sumo.simulation.traffic import EgoPresence
from interplan_sumo.simulation.vehicle_types import VehicleTypes, read_vehicle_types, vehicle_type_file
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.signals import SignalStatus

MAP = "one_north"
APPROACH_M = 70.0
EMERGENCY_MPS2 = 9.0
FAR_EGO = EgoState(0.0, 1e6, 1e6, 0.0, vx_mps=0.0)


@cache
def crossing() -> tuple[SumoNetwork, NetworkLink]:
    network = read_network(find_map(MAP).network)
    return network, next(
        link
        for ways in network.links.values()
        for link in ways
        if link.light is not None and link.direction == "s" and network.lanes[link.from_lane].length_m > APPROACH_M
    )


def types_of(model: str, folder: Path) -> VehicleTypes:
    path = folder / f"{model}.xml"
    text = vehicle_type_file("conservative").read_text()
    path.write_text(text.replace('carFollowModel="IDM"', f'carFollowModel="{model}"'))
    return read_vehicle_types(path)


def approach(behaviour: VehicleTypes, red_at_m: float) -> tuple[float, float]:
    """Where one ends for which the light turns red as it comes so near (from the line; -1: beyond), hardest braking."""
    network, link = crossing()
    ids = NetworkIds.read(find_map(MAP).ids)
    lane = network.lanes[link.from_lane]
    route = (lane.edge, *continued_route(network, link.to_lane, 200.0))
    spawn = Spawn(lane.id, lane.length_m - APPROACH_M, 11.0, behaviour.members[0], route)
    setup = TrafficSetup(
        network, ids, behaviour, FAR_EGO, (lane.edge,), spawns=(spawn,), tokens=("a",), presence=EgoPresence.UNSEEN
    )
    away_m, speeds = [APPROACH_M], [11.0]
    with SumoTraffic(setup) as run:
        light, index = link.light or ("", 0)
        connector = next(name for name, at in ids.links.items() if at == (light, index))
        run.impose_signals({connector: SignalStatus.GREEN})
        switched = False
        for _ in range(150):
            if away_m[-1] <= red_at_m and not switched:
                run.impose_signals({connector: SignalStatus.RED})
                switched = True
            run.observe()
            run.react(FAR_EGO)
            run.advance()
            here = sumo.vehicle.getLaneID("a0")
            passed = here != lane.id
            away_m.append(-1.0 if passed else lane.length_m - sumo.vehicle.getLanePosition("a0"))
            speeds.append(sumo.vehicle.getSpeed("a0"))
            if passed or speeds[-1] == 0.0:
                break
    return away_m[-1], float(-np.diff(speeds).min() / 0.1)


@pytest.mark.parametrize("model", ["IDM", "EIDM", "Krauss", "W99"])
@pytest.mark.parametrize(("red_at_m", "passes"), [(3.0, {True}), (9.0, {True}), (12.0, {True, False}), (20.0, {False})])
def test_red_at_the_last_moment_asks_nobody_for_more_than_its_brakes(
    model: str, red_at_m: float, passes: set[bool], tmp_path: Path
) -> None:
    ends_m, braked_mps2 = approach(types_of(model, tmp_path), red_at_m)
    assert braked_mps2 <= EMERGENCY_MPS2 + 0.05
    assert (ends_m < 0.0) in passes


@pytest.mark.parametrize(("speed_mps", "way_m"), [(0.0, 0.0), (0.9, 0.0), (1.8, 0.09), (2.0, 0.13), (14.4, 10.8)])
def test_how_far_a_car_still_gets_in_steps_of_braking_with_9_mps2(speed_mps: float, way_m: float) -> None:
    assert stopping_m(speed_mps, EMERGENCY_MPS2) == pytest.approx(way_m)
