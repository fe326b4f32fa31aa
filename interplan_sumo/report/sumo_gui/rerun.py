"""A drive's scenario for plain SUMO: the traffic as it stood at the start, for SUMO to drive on by itself."""

from __future__ import annotations

from pathlib import Path

from interplan_sumo.batch.run_folder import read_run
from interplan_sumo.batch.stored_drive import StoredDrive
from interplan_sumo.batch.traffic_files import recorded_vehicle_types
from interplan_sumo.maps.store import find_map
from interplan_sumo.report.sumo_gui.xml import tag
from interplan_sumo.simulation.network import SumoNetwork, read_network
from interplan_sumo.simulation.setup import open_sumo_traffic
from interplan_sumo.simulation.sumo import Commanding, sumo
from interplan_sumo.simulation.vehicle_type_effects import DRAWING
from interplan_sumo.simulation.vehicle_types import read_vehicle_types, vehicle_type_file

STANDS_S = 1e6
"""Obstacles stop for so long."""


def types_of(drive: StoredDrive) -> Path:
    """The vehicle-type file that a drive was simulated with; InputError if it is not there any more."""
    given = recorded_vehicle_types(drive.run_folder, read_run(drive.run_folder).manifest)
    return given or vehicle_type_file(drive.scenario.traffic.behaviour)


def traffic_at_start(drive: StoredDrive, types_file: Path) -> tuple[list[str], list[str], str]:
    """Elements of a route file, lights for an additional file, and the file of vehicle types. Opens SUMO.

    Everybody at t = 0, on their lanes, with speed and route; obstacles stand
    still. The ego is among them, as a car that SUMO drives. Lights go on from
    where they are then.
    """
    types = read_vehicle_types(types_file)
    network = read_network(find_map(drive.scenario.map, drive.scenario.maps_beside).network)
    simulation = open_sumo_traffic(drive.scenario, drive.roads, seed=drive.row.seed, vehicle_types=types_file)
    with simulation, Commanding("reading the traffic at the start"):
        names: list[str] = sorted(sumo.vehicle.getIDList())
        known = simulation.drivers
        others = dict.fromkeys(kind for name in names if (kind := _type_of(name)) not in known)
        document = types.sumo_document(known.values(), besides=DRAWING)
        lights = [_light(light) for light in sorted(sumo.trafficlight.getIDList()) if _has_cycle(light)]
        return [*(_type(kind) for kind in others), *(_vehicle(name, network) for name in names)], lights, document


def _has_cycle(light: str) -> bool:
    """Whether a light shows the phases of a program of fixed durations one after the other."""
    now = sumo.trafficlight.getProgram(light)
    return any(each.programID == now and each.type == 0 for each in sumo.trafficlight.getAllProgramLogics(light))


def _light(light: str) -> str:
    """The offset with which a light's program begins where it is now."""
    get = sumo.trafficlight
    now = get.getProgram(light)
    (program,) = (each for each in get.getAllProgramLogics(light) if each.programID == now)
    durations_s = [phase.duration for phase in program.phases]
    index, left_s = get.getPhase(light), get.getNextSwitch(light) - sumo.simulation.getTime()
    return tag("tlLogic", id=light, programID=now, offset=f"{left_s - sum(durations_s[: index + 1]):.2f}")


def _type_of(name: str) -> str:
    """The type of a vehicle, before SUMO made it a type of its own to change a number."""
    kind: str = sumo.vehicle.getTypeID(name)
    return kind.removesuffix(f"@{name}")


def _type(kind: str) -> str:
    """A type that the simulation made: of the ego or of an obstacle."""
    get = sumo.vehicletype
    return tag("vType", id=kind, length=f"{get.getLength(kind):.3f}", width=f"{get.getWidth(kind):.3f}")


def _vehicle(name: str, network: SumoNetwork) -> str:
    get = sumo.vehicle
    lane, position_m = network.lanes[get.getLaneID(name)], float(get.getLanePosition(name))
    if lane.internal:  # SUMO lets nobody depart inside a junction
        lane = network.lanes[network.ways_through(lane.id)[0].from_lane]
        position_m = lane.length_m
    route = list(get.getRoute(name))
    limit_mps = lane.limit_mps * float(get.getSpeedFactor(name))
    stops = get.getStops(name, 1)
    inner = tag("route", edges=" ".join(route[route.index(lane.edge) :]))
    if stops:
        end_m = min(float(stops[0].endPos), lane.length_m)
        inner += tag("stop", lane=lane.id, endPos=f"{end_m:.2f}", duration=f"{STANDS_S:.0f}")
    return tag(
        "vehicle", inner, id=name, type=_type_of(name), depart="0", departLane=lane.index,
        departPos=f"{min(position_m, lane.length_m):.3f}",
        departSpeed=f"{min(max(0.0, float(get.getSpeed(name))), limit_mps):.3f}",
    )  # fmt: skip
