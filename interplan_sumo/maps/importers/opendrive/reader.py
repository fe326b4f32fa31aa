"""Reading an OpenDRIVE map: from its roads to lanes, lights, crosswalks and ground."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import shapely

from interplan_sumo.errors import MapError
from interplan_sumo.maps.importers.lines import SHORTEST_M, ring
from interplan_sumo.maps.importers.opendrive.areas import is_crosswalk, is_parking, outlines_of
from interplan_sumo.maps.importers.opendrive.controls import Controls, controls_of, cuts_of
from interplan_sumo.maps.importers.opendrive.elements import (
    UnusableRoadError,
    XodrFile,
    XodrObject,
    XodrRoad,
    XodrSignal,
)
from interplan_sumo.maps.importers.opendrive.file import read_file
from interplan_sumo.maps.importers.opendrive.lane_types import is_ground, is_parking_lane, is_walkway
from interplan_sumo.maps.importers.opendrive.links import Joints, Sides, joints_of
from interplan_sumo.maps.importers.opendrive.right_of_way import junctions_of, signals_of
from interplan_sumo.maps.importers.opendrive.speed_signs import SignLimits, limit_cuts, sign_limits
from interplan_sumo.maps.importers.opendrive.stretches import DrawnStretch, SideStretch, side_stretches
from interplan_sumo.maps.importers.opendrive.travel import Network, TravelLane, network_of
from interplan_sumo.maps.importers.source import LeftOut, SourceLane, SourceMap, SourceStopLine
from interplan_sumo.world.frame import STAND_IN, Frame, utm_frame
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import DrivingSide, StopLineKind

LONGEST_CROSSING_M = 80.0
"""A way through a junction that is longer is a ramp: where it forks or merges, overlaps tell."""
_GAP_M = 0.1


def read_opendrive(path: Path) -> SourceMap:
    """The lanes of an OpenDRIVE file, in the UTM zone of its georeference, else at a place that stands in.

    A lane of the map is a lane of one lane section; its id is
    "road/section/lane". It is cut where its limit changes, where a light
    stands far from a junction, and where it becomes wide enough for cars.
    MapError with one line if the file cannot be read or holds no lane for cars.
    """
    file = read_file(Path(path))
    known = {s.id: s for road in file.roads.values() for s in road.signals if not s.is_reference}
    sides = _sides(file, known)
    joints = joints_of(file, sides)
    network = network_of(sides, joints)
    if not network.lanes:
        why = next(iter(file.faults.values()), "none of its lanes is for cars")
        raise MapError(f"{path}: the file holds no lane for cars ({why}); give one with a road network")
    notes: list[str] = []
    frame = _frame(file, network, notes)
    controls = controls_of(file, known, sides, network)
    limits = sign_limits(file, known, sides, network)
    notes += _notes(file, joints, network, controls)
    if limits.unknown:
        notes.append(
            f"{len(limits.unknown)} signs of speed limits do not tell one for all times, such as "
            f"{limits.unknown[0]}: they are not kept."
        )
    try:
        return _source_map(file, frame, sides, network, controls, limits, notes)
    except MapError as error:
        raise MapError(f"{path}: {error}") from None


def read_network(path: Path) -> Network:
    """The lanes of a file with their links, in its own coordinates; MapError if it cannot be read."""
    file = read_file(Path(path))
    sides = _sides(file, {s.id: s for road in file.roads.values() for s in road.signals if not s.is_reference})
    return network_of(sides, joints_of(file, sides))


def _source_map(
    file: XodrFile,
    frame: Frame,
    sides: Sides,
    network: Network,
    controls: Controls,
    limits: SignLimits,
    notes: Sequence[str],
) -> SourceMap:
    lanes = {lane.id: _lane(frame, lane, controls, limits) for lane in network.lanes.values()}
    stretches = [s for chain in sides.values() for side in chain for s in side.lanes.values()]
    things = [(road, thing) for road in file.roads.values() for thing in road.objects]
    signals, of_signals = signals_of(file, network, controls)
    junctions, of_junctions = junctions_of(file, network)
    return SourceMap(
        name=re.sub(r"[^a-z0-9]+", "_", file.path.stem.lower()).strip("_") or "opendrive",
        format="OpenDRIVE",
        crs=frame.crs,
        driving_side=_driving_side(network),
        lanes=lanes,
        stop_lines=tuple(_stop_lines(frame, network, controls)),
        crosswalks=tuple(_outlines(frame, [(r, t) for r, t in things if is_crosswalk(t)])),
        walkways=tuple(_polygons(frame, [s for s in stretches if is_walkway(s.lane)])),
        carparks=(
            *_outlines(frame, [(r, t) for r, t in things if is_parking(t)]),
            *_polygons(frame, [s for s in stretches if is_parking_lane(s.lane)]),
        ),
        left_out=(*_left_out(frame, stretches, network), *(LeftOut(id_, why) for id_, why in file.faults.items())),
        signals=signals,
        junctions=junctions,
        notes=(*notes, *of_signals, *of_junctions),
    )


def _sides(file: XodrFile, known: dict[str, XodrSignal]) -> dict[tuple[str, bool], list[SideStretch]]:
    """Both sides of every road in stretches; what cannot be drawn is moved from the file's roads to its faults."""
    cuts: dict[str, list[float]] = {}
    for road in file.roads.values():
        cuts.setdefault(road.id, []).extend((*cuts_of(road, known), *limit_cuts(road, known)))
        for link in (road.predecessor, road.successor):
            if link is not None and link.station_m is not None:
                cuts.setdefault(link.id, []).append(link.station_m)
    sides: dict[tuple[str, bool], list[SideStretch]] = {}
    for road in list(file.roads.values()):
        try:
            drawn = {(road.id, left): side_stretches(road, cuts[road.id], left=left) for left in (False, True)}
        except UnusableRoadError as fault:
            file.faults[road.id] = f"road that cannot be drawn: {fault}"
            del file.roads[road.id]
            continue
        sides |= drawn
    return sides


def _lane(frame: Frame, lane: TravelLane, controls: Controls, limits: SignLimits) -> SourceLane:
    road = lane.stretch.road
    return SourceLane(
        id=lane.id,
        left=frame.points(lane.left),
        right=frame.points(lane.right),
        successors=tuple(lane.successors),
        predecessors=tuple(lane.predecessors),
        left_neighbour=lane.left_neighbour,
        right_neighbour=lane.right_neighbour,
        speed_limit_mps=limits.limit_mps.get(lane.id, lane.stretch.limit_mps),
        in_intersection=bool(road.junction) and road.length_m <= LONGEST_CROSSING_M,
        lights_at_start=tuple(controls.lights_at_start.get(lane.id, ())),
        lights_at_end=tuple(controls.lights_at_end.get(lane.id, ())),
        sign_at_end=controls.sign_at_end.get(lane.id),
    )


def _frame(file: XodrFile, network: Network, notes: list[str]) -> Frame:
    header = file.header
    if header is None or not header.reference:
        notes.append("The file does not say where it lies: its coordinates are kept, at a place that stands in.")
        return STAND_IN
    x, y = next(iter(network.lanes.values())).left[0].tolist()
    try:
        return utm_frame(header.reference, (x, y), header.shift_m, header.turn_rad)
    except MapError as error:
        notes.append(f"The georeference cannot be used ({error}): the map was put at a place that stands in.")
        return STAND_IN


def _driving_side(network: Network) -> DrivingSide:
    """The side on which most lanes are driven."""
    left = sum(lane.stretch.road.left_hand for lane in network.lanes.values())
    return "left" if 2 * left > len(network.lanes) else "right"


def _stop_lines(frame: Frame, network: Network, controls: Controls) -> Iterator[SourceStopLine]:
    for id_, points, lane_ids in controls.lines:
        onward = [after for lane in lane_ids for after in network.lanes[lane].successors]
        lit = any(lane in controls.lights_at_end for lane in lane_ids)
        lit |= any(lane in controls.lights_at_start for lane in onward)
        signs = [controls.sign_at_end[lane] for lane in lane_ids if lane in controls.sign_at_end]
        kind = StopLineKind.TRAFFIC_LIGHT if lit else min(signs, default=StopLineKind.UNKNOWN)
        yield SourceStopLine(id_, frame.points(points), kind, lane_ids)


# --- what is no lane -----------------------------------------------------------------------------------


def _outlines(frame: Frame, things: Sequence[tuple[XodrRoad, XodrObject]]) -> Iterator[shapely.Polygon]:
    for road, thing in things:
        for outline in outlines_of(road, thing):
            if np.isfinite(outline).all():
                polygon = ring(frame.points(outline))
                if polygon is not None:
                    yield polygon


def _polygon(frame: Frame, inner: Floats, outer: Floats) -> shapely.Polygon | None:
    return ring(frame.points(np.concatenate((inner, outer[::-1]))))


def _polygons(frame: Frame, stretches: Sequence[DrawnStretch]) -> Iterator[shapely.Polygon]:
    for stretch in stretches:
        polygon = _polygon(frame, stretch.inner, stretch.outer)
        if polygon is not None:
            yield polygon


def _left_out(frame: Frame, stretches: Sequence[DrawnStretch], network: Network) -> Iterator[LeftOut]:
    for stretch in stretches:
        wide = stretch.width_m.max() >= SHORTEST_M and stretch.length_m >= SHORTEST_M
        if stretch.reason is not None and wide:
            ground = is_ground(stretch.lane)
            yield LeftOut(stretch.id, stretch.reason, _polygon(frame, stretch.inner, stretch.outer) if ground else None)
    for lane in network.narrow:
        yield LeftOut(lane.id, "end of a lane, too narrow for cars", _polygon(frame, lane.left, lane.right))


# --- notes ---------------------------------------------------------------------------------------------


def _notes(file: XodrFile, joints: Joints, network: Network, controls: Controls) -> Iterator[str]:
    if not all(road.is_flat for road in file.roads.values()):
        yield "Heights and slopes are not kept: the map is flat, and roads that pass over others cross them."
    left = sum(road.left_hand for road in file.roads.values())
    if 0 < left < len(file.roads):
        yield f"{left} of {len(file.roads)} roads are driven on the left, the others on the right."
    if network.split:
        yield f"{network.split} lanes for both directions are split into two along their middle."
    if network.one_way:
        yield f"{network.one_way} lanes for both directions are too narrow for two: only their own direction is kept."
    if joints.beyond:
        yield f"{joints.beyond} links lead to roads or lanes that the file lacks."
    if network.opposed:
        yield f"{network.opposed} links join lanes that run against each other: they are not kept."
    if network.torn:
        a, b, gap_m = network.torn[0]
        where = f"such as {a} and {b} ({gap_m:.0f} m)"
        yield f"{len(network.torn)} links join lanes that lie apart, {where}: they are not kept."
    torn = [road.id for road in file.roads.values() if road.reference.gaps_m().max(initial=0.0) > _GAP_M]
    if torn:
        yield f"The reference lines of {len(torn)} roads have gaps, such as that of road {torn[0]}."
    if controls.idle:
        yield f"{len(controls.idle)} lights hold for no lane for cars, such as {controls.idle[0]}."
    if controls.idle_signs:
        where = f"such as {controls.idle_signs[0]}"
        yield f"{len(controls.idle_signs)} stop and yield signs hold at no end of a road for cars, {where}."
    if controls.leading_nowhere:
        where = f"such as {next(iter(controls.leading_nowhere))}"
        yield f"{len(controls.leading_nowhere)} lights stand where the map ends, {where}: they are not kept."
    kinds = sorted({j.kind for j in file.junctions.values()} - {"default", "direct", "virtual"})
    if kinds:
        yield f"Junctions of type {', '.join(kinds)[:60]} are not kept."
