"""Hundreds of kilometres in one process: what a worker of `endure` comes to, and whether its city does what none can.

    python -m benchmarks.long_drive --km 300 [--planner idm] [--map one_north] [--density 0.25] [--behaviour NAME]
    python -m benchmarks.long_drive --km 100 --hold

It drives the segments of one cell one after the other, planner included, as a worker does: distance per CPU hour, and
the slope of its memory once its cities are warm. With `--hold` everybody in the whole district is held, frame by frame,
against tests/simulation/traffic_invariants.py instead, and it exits 1 if anybody does what none can.
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from interplan_sumo.batch.drive_job import DriveSettings
from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.records import PlannerRecord
from interplan_sumo.endurance.city import STATES
from interplan_sumo.endurance.city_traffic import NearTraffic, open_trip
from interplan_sumo.endurance.driving import city_of, scenario_of
from interplan_sumo.endurance.event_folder import open_event_folder
from interplan_sumo.endurance.kilometres import EVENTS, EndureOptions, SegmentPlan
from interplan_sumo.endurance.rare_events import RareEventDraws
from interplan_sumo.endurance.saturation import saturation_per_km
from interplan_sumo.endurance.segment_job import SegmentJob, SegmentSettings
from interplan_sumo.endurance.segment_worker import segment_jobs
from interplan_sumo.endurance.trip import drive_trip
from interplan_sumo.maps.store import load_roads
from interplan_sumo.metrics.profile import DEFAULT_PROFILE, find_profile
from interplan_sumo.planner_seat import PlannerSeat
from interplan_sumo.scenario.route import forget_lines
from interplan_sumo.simulation.episode import DT_S, Loop, Phase
from interplan_sumo.simulation.setup import start_state
from interplan_sumo.simulation.sumo_traffic import SumoTraffic
from interplan_sumo.world.ego import PACIFICA
from tests.simulation.recorded_frames import FrameRecorder
from tests.simulation.traffic_invariants import Violation, erring, violations

WARM: Final = 4 * STATES
"""After so many segments all states of the city have been warmed up, but for some by chance."""
PAGE_KB: Final = resource.getpagesize() / 1024.0
MOST_TOLD: Final = 30
"""Violations that are printed; all are counted."""
AT_THE_EDGE: Final = ("appears_at_map_end", "leaves_at_map_end")
"""Where a road of the map ends vehicles come and go, in sight or not: they can nowhere else."""


@dataclass(frozen=True, slots=True)
class Driven:
    """One segment."""

    metres: float
    cpu_s: float
    rss_kb: float
    """Of this process, at its end."""


@dataclass(slots=True)
class Held:
    """What the frames of all segments came to."""

    metres: float = 0.0
    agent_s: float = 0.0
    found: list[tuple[int, Violation]] = field(default_factory=list[tuple[int, Violation]])
    """With the number of the segment."""

    @property
    def broken(self) -> list[tuple[int, Violation]]:
        return [each for each in self.found if each[1].kind not in AT_THE_EDGE]


def settings_of(options: EndureOptions) -> SegmentSettings:
    """Those of the workers of `endure`."""
    drive_settings = DriveSettings(options.out / EVENTS, options.run, find_profile(DEFAULT_PROFILE))
    saturation = saturation_per_km(options.map_files.name)
    return SegmentSettings(drive_settings, options.map, None, options.types_path, saturation, options.segment_m)


def driven(options: EndureOptions) -> Iterator[Driven]:
    """Segment after segment, as a worker drives them."""
    open_event_folder(options.out / EVENTS, {options.planner: PlannerRecord("", {})})
    work = segment_jobs(settings_of(options))(options.planner, lambda _: None)
    for job in jobs(options):
        began_s = time.process_time()
        answer, fault = work(job)
        if fault is not None:
            raise SystemExit(f"segment {job.index}: {fault.kind}: {fault.message}")
        yield Driven(answer["segment"]["metres"], time.process_time() - began_s, rss_kb())


def held(options: EndureOptions, seat: PlannerSeat) -> Iterator[Held]:
    """The sum after each segment."""
    settings, total = settings_of(options), Held()
    roads, types = load_roads(settings.map), options.types_path.read_text()
    for job in jobs(options):
        recorder = FrameRecorder(settings.map)
        scenario, state, rng = scenario_of(job, settings)
        scenario, traffic, staging = open_trip(scenario, roads, city_of(settings, job.cell), state, rng, PACIFICA)
        draws = RareEventDraws(job.index, job.natural, None if job.naive else job.drawn_with)
        with traffic:
            edges = recorder.map_ends()
            loop = Loop(scenario, roads, NearTraffic(traffic, start_state(scenario, roads)), PACIFICA, job.seed)
            note = partial(note_frame, recorder, loop, traffic)
            trip = drive_trip(loop, traffic, staging, seat, draws, note, settings.most_m)
        if trip.fault is not None:
            raise SystemExit(f"segment {job.index}: {trip.fault.kind}: {trip.fault.message}")
        drive, bodies = recorder.drive(), erring(recorder.bodies, types)
        total.metres += trip.stretches.metres
        total.agent_s += DT_S * float(drive.there[:, [name in bodies for name in drive.ids]].sum())
        found = violations(
            drive, bodies, standing=frozenset(recorder.standing), walking=frozenset(recorder.walking),
            map_begins=edges[0], map_ends=edges[1],
        )  # fmt: skip
        total.found += [(job.index, each) for each in found]
        forget_lines()
        yield total


def note_frame(recorder: FrameRecorder, loop: Loop, traffic: SumoTraffic, _: Phase) -> None:
    """Take the whole district, once in each step."""
    if len(recorder.frames) < len(loop.record.egos):
        recorder.note(traffic.observe(), loop.ego, frozenset(traffic.behaviours))


def jobs(options: EndureOptions) -> Iterator[SegmentJob]:
    """Numbers without end."""
    number = 0
    while True:
        number += STATES
        yield from SegmentPlan(options, {}).missing(number)[number - STATES :]


def rss_kb() -> float:
    """What this process holds now (Linux)."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE_KB


def slope_mb_per_100_km(segments: list[Driven]) -> tuple[float, float]:
    """By least squares, with its standard error as if the residuals were independent."""
    km = np.cumsum([each.metres for each in segments]) / 1000.0
    mb = np.array([each.rss_kb for each in segments]) / 1024.0
    (slope, _), covariance = np.polyfit(km, mb, 1, cov=True)
    return 100.0 * float(slope), 100.0 * float(np.sqrt(covariance[0, 0]))


def main() -> None:
    """Drive, tell, and fail if anybody does what none can."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--planner", default="idm")
    parser.add_argument("--map", default="one_north")
    parser.add_argument("--density", type=float, default=0.25)
    parser.add_argument("--behaviour", default="measured_city")
    parser.add_argument("--km", type=float, default=100.0)
    parser.add_argument("--hold", action="store_true", help="hold every frame against what none can do")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        run = RunOptions(workers=0, in_process=True)
        options = EndureOptions(
            given.planner, given.map, given.km, Path(folder).resolve(), density=given.density,
            behaviour=given.behaviour, run=run,
        )  # fmt: skip
        if given.hold:
            tell_held(options)
        else:
            tell_driven(options)


def tell_driven(options: EndureOptions) -> None:
    segments: list[Driven] = []
    km = 0.0
    for each in driven(options):
        segments.append(each)
        km += each.metres / 1000.0
        if len(segments) % STATES == 0:
            print(f"{km:.0f} km, {each.rss_kb / 1024:.0f} MB", flush=True)
        if km >= options.km:
            break
    cpu_h = sum(each.cpu_s for each in segments) / 3600.0
    print(f"{len(segments)} segments, {km:.1f} km, {km / cpu_h:.0f} km per CPU hour")
    if len(segments) > WARM + STATES:
        slope, error = slope_mb_per_100_km(segments[WARM:])
        print(f"after the first {WARM} segments: {slope:+.2f} +- {error:.2f} MB per 100 km")


def tell_held(options: EndureOptions) -> None:
    seat = settings_of(options).drive.seat(options.planner)
    total, printed = Held(), 0
    for count, total in enumerate(held(options, seat), start=1):
        for number, each in total.broken[printed:MOST_TOLD]:
            print(f"segment {number}, frame {each.frame}: {each.kind} {each.agent} {each.value:.3f} {each.detail}")
        printed = len(total.broken)
        if count % STATES == 0:
            print(f"{total.metres / 1000:.0f} km, {total.agent_s / 3600:.0f} agent-hours", flush=True)
        if total.metres >= 1000.0 * options.km:
            break
    kinds = Counter(each.kind for _, each in total.found)
    print(f"{total.metres / 1000:.1f} km, {total.agent_s / 3600:.0f} agent-hours: {dict(kinds) or 'nothing'}")
    sys.exit(1 if total.broken else 0)


if __name__ == "__main__":
    main()
