"""Driving: from a job to its record, with SUMO: the trip, its events, and the seconds around them on the disk."""

from __future__ import annotations

import hashlib
import time
from pathlib import Path
from typing import Any

import numpy as np

from interplan_sumo.batch.drive_job import place_trace
from interplan_sumo.batch.records import Fault
from interplan_sumo.batch.tasks import KilledFromOutsideError, Publish
from interplan_sumo.endurance.city import STATES, City
from interplan_sumo.endurance.city_traffic import NearTraffic, open_trip
from interplan_sumo.endurance.cut_out import cut_scenario, cut_trace, window
from interplan_sumo.endurance.event_folder import KeptEvent, event_score, write_event
from interplan_sumo.endurance.events import FoundEvent, find_events, metres_by_place
from interplan_sumo.endurance.rare_events import RareEventDraws
from interplan_sumo.endurance.records import SegmentRecord, TrafficCell
from interplan_sumo.endurance.segment_job import MOST_KEPT, SegmentJob, SegmentSettings, empty_record
from interplan_sumo.endurance.segment_plan import drawn_scenario
from interplan_sumo.endurance.trip import Trip, drive_trip
from interplan_sumo.errors import TrafficError
from interplan_sumo.maps.store import load_roads
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.planner_process.process import PlannerProcess
from interplan_sumo.planner_seat import PlannerSeat
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.episode import Loop
from interplan_sumo.simulation.setup import start_state
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.trace import Trace


def driven_segment(job: SegmentJob, settings: SegmentSettings, seat: PlannerSeat, publish: Publish) -> SegmentRecord:
    """Drive a segment; whatever goes wrong with planner or traffic is in the record."""
    began = time.perf_counter()
    planner_hash = settings.planner_hashes.get(job.planner)
    publish("setup")
    roads = load_roads(settings.map)
    scenario, state, rng = scenario_of(job, settings)
    try:
        scenario, traffic, staging = open_trip(scenario, roads, city_of(settings, job.cell), state, rng, PACIFICA)
    except TrafficError as error:
        return empty_record(job, Fault("traffic", str(error)), planner_hash)
    draws = RareEventDraws(_segment_seed(job), job.natural, None if job.naive else job.drawn_with)
    with traffic:
        near = NearTraffic(traffic, start_state(scenario, roads))
        loop = Loop(scenario, roads, near, PACIFICA, job.seed)
        trip = drive_trip(loop, traffic, staging, seat, draws, publish, settings.most_m)
        trace = loop.trace()
    if isinstance(seat, PlannerProcess) and seat.has_ended and seat.killed_from_outside:
        raise KilledFromOutsideError("" if trip.fault is None else trip.fault.message)
    publish("score")
    found: list[FoundEvent] = []
    places = {}
    if trace is not None:
        facts = Facts(trace, roads, trace.ego, scenario)
        found = find_events(trip, facts, staging.spans)
        places = metres_by_place(trip, facts)
        publish("store")
        _keep(job, settings, trip, trace, found)
    driven = trip.stretches
    return SegmentRecord(
        index=job.index,
        cell=job.cell,
        planner=job.planner,
        planner_hash=planner_hash,
        seed=job.seed,
        naive=job.naive,
        start=scenario.start.lane,
        metres=round(driven.metres, 3),
        seconds=round(driven.seconds, 1),
        weighted_metres=driven.weighted_metres if not job.naive else round(driven.metres, 3),
        weighted_seconds=driven.weighted_seconds if not job.naive else round(driven.seconds, 1),
        final_weight=draws.weight,
        natural=dict(draws.natural),
        drawn_with=dict(draws.drawn_with),
        opportunities={kind: number for kind, number in draws.opportunities.items() if number},
        rare_events=tuple(trip.rare_events),
        events=tuple(each.record for each in found),
        metres_at=places,
        plan_ms=None if not loop.record.plan_wall_s else 1e3 * trip.plan_s / len(loop.record.plan_wall_s),
        wall_s=round(time.perf_counter() - began, 3),
        trace_hash=None if trace is None else trip_hash(trace),
        fault=None if trip.fault is None else Fault(trip.fault.kind, trip.fault.message),
    )


def _segment_seed(job: SegmentJob) -> int:
    return int.from_bytes(hashlib.sha256(f"{job.id} draws".encode()).digest()[:8])


def trip_hash(trace: Trace) -> str:
    """SHA-256 over where everybody was, equal for equal trips; micrometres, as `Trace.hash` has them."""
    digest = hashlib.sha256()
    ego, actors = trace.ego, trace.actors
    for column in (ego.x_m, ego.y_m, ego.heading_rad, ego.vx_mps, actors.x_m, actors.y_m, actors.heading_rad):
        digest.update(np.round(column * 1e6).astype("<i8").tobytes())
    digest.update(actors.starts.astype("<i8").tobytes())
    digest.update("\0".join(actors.ids.tolist()).encode())
    last: Any = None
    for signals in trace.signals:
        if signals is not last:
            digest.update(signals.status.astype(np.int8).tobytes())
            last = signals
    return digest.hexdigest()


def city_of(settings: SegmentSettings, cell: TrafficCell) -> City:
    """The district at the density of a cell."""
    return City(settings.map, cell.density * settings.saturation_per_km, settings.types_path)


def scenario_of(job: SegmentJob, settings: SegmentSettings) -> tuple[Scenario, int, np.random.Generator]:
    """The trip of a segment, the state of the city that it begins in, and what is drawn from later."""
    roads = load_roads(settings.map)
    digest = hashlib.sha256(job.id.encode()).digest()
    rng = np.random.default_rng(np.frombuffer(digest, dtype=np.uint32))
    state = int(rng.integers(STATES))
    return drawn_scenario(job.id, roads, rng, settings.maps_beside), state, rng


# --- what is kept ----------------------------------------------------------------------------------


def event_id(job: SegmentJob, number: int) -> str:
    """Of the scenario that an event is cut out as."""
    return f"{job.id}.{number}"


def _keep(job: SegmentJob, settings: SegmentSettings, trip: Trip, trace: Trace, found: list[FoundEvent]) -> None:
    """The seconds around the first few events, most serious kinds first; RunFolderError if they cannot be written."""
    order = ("collision", "off_road", "red_light", "stall", "hard_braking", "near_miss")
    ranked = sorted(range(len(found)), key=lambda row: (order.index(found[row].record.kind), row))
    for row in sorted(ranked[:MOST_KEPT]):
        each = found[row]
        first, end = window(trace, each.frame, trip.loop.roads)
        if end - first < 2:
            continue
        name = event_id(job, row)
        scenario = cut_scenario(name, trip.loop.scenario, trip.loop.roads, trace, first, end)
        if scenario is None:
            continue
        _store(job, settings, each, cut_trace(trace, first, end), scenario, first)


def _store(
    job: SegmentJob, settings: SegmentSettings, each: FoundEvent, cut: Trace, scenario: Scenario, first: int
) -> None:
    """Trace, scenario and score of one event, in their place as a whole."""
    folder = settings.drive.folder
    sheet, site = event_score(scenario, cut, settings.drive.profile, folder)
    event = KeptEvent(
        scenario.id, scenario.hash(), job.planner, settings.planner_hashes.get(job.planner), job.index,
        each.record.kind, round((each.frame - first) * cut.dt_s, 1), cut.hash(), sheet, site,
    )  # fmt: skip

    def write(fresh: Path) -> None:
        cut.write(fresh)
        write_event(fresh, event, scenario)

    place_trace(folder, event.place, write)
