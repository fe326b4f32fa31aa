"""What a process of its own costs a planner: python -m benchmarks.planner_process [--actors 40] [--planner P]...

(a) milliseconds per step beside what plan() itself takes, with so many actors on a map with lights: the median on the
    wall, and processor time of both processes
(b) drives per second, scored, with `idm` in its own process beside `idm` in the simulator's

Both sides are measured in turns in the same run. (b) is by processor time, too: on a busy machine that alone holds.
"""

from __future__ import annotations

import argparse
import os
import time
from dataclasses import replace
from pathlib import Path
from statistics import median

import numpy as np

from benchmarks.planner_speed import scene
from interplan_sumo.maps.store import load_roads
from interplan_sumo.metrics.score import score
from interplan_sumo.planner import Mission, Observation, Past, load_planner
from interplan_sumo.planner_process.process import PlannerProcess
from interplan_sumo.planner_seat import InProcess, PlannerSeat
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.suite import expert, find_suite
from interplan_sumo.simulation.episode import drive
from interplan_sumo.world.signals import Signals

STEPS = 300
MAP = "back_bay"


def spent_s(pid: int) -> float:
    """Processor time of a process so far; Linux only, to 10 ms."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def seen_ones(actors: int) -> tuple[Mission, list[Observation]]:
    """What an ego that stands sees on a map with lights while others drive on."""
    mission, ego, traffic = scene(MAP, actors)
    lights = tuple(sorted(id for id, each in mission.roads.connectors.items() if each.has_traffic_light))
    signals = Signals(lights, np.zeros(len(lights), dtype=np.int8))
    times_s = [0.1 * k for k in range(STEPS)]
    frames = [(replace(ego, time_s=at_s), traffic.at(0.02 * at_s)) for at_s in times_s]
    past = Past((ego,) * 20, (frames[0][1],) * 20)
    return mission, [Observation(at.time_s, at, others, signals, past) for at, others in frames]


def step_cost(spec: str, actors: int) -> None:
    """Print part (a) for a planner."""
    mission, seen = seen_ones(actors)
    over_ms: list[float] = []
    with PlannerProcess.of(spec) as seat:
        seat.start(mission)
        seat.plan(seen[0])
        began_s, there_s, own_s = time.process_time(), spent_s(seat.pid), 0.0
        for observation in seen[1:]:
            asked_s = time.perf_counter()
            timed = seat.plan(observation)
            over_ms.append(1e3 * (time.perf_counter() - asked_s - timed.wall_s))
            own_s += timed.wall_s
        here_ms = 1e3 * (time.process_time() - began_s) / len(over_ms)
        both_ms = here_ms + 1e3 * (spent_s(seat.pid) - there_s) / len(over_ms)
    print(
        f"{spec}, {len(seen[0].actors)} actors: {median(over_ms):.2f} ms beside plan() (median), fastest tenth "
        f"{np.quantile(over_ms, 0.1):.2f}; processor {here_ms:.2f} ms here, {both_ms:.2f} ms with the planner's "
        f"process, of which plan() {1e3 * own_s / len(over_ms):.2f} ms on the wall"
    )


def scored(scenario: Scenario, seat: PlannerSeat) -> None:
    trace = drive(scenario, seat).trace
    assert trace is not None
    score(trace, load_roads(scenario.map), expert(scenario), scenario)


def drive_cost(drives: int) -> None:
    """Print part (b)."""
    wall: dict[str, list[float]] = {"own": [], "shared": []}
    processor: dict[str, list[float]] = {"own": [], "shared": []}
    with PlannerProcess.of("idm") as own:
        shared = InProcess(load_planner("idm"))
        scenes = find_suite("smoke==1").scenarios[:4]
        for scenario in (*scenes, *(scenes * drives)[:drives]):  # in the first round maps are read and sent
            for name, seat in (("own", own), ("shared", shared)):
                began = time.perf_counter(), time.process_time() + spent_s(own.pid)
                scored(scenario, seat)
                wall[name].append(time.perf_counter() - began[0])
                processor[name].append(time.process_time() + spent_s(own.pid) - began[1])
    for what, times in (("wall", wall), ("processor", processor)):
        one, other = (sum(times[name][4:]) for name in ("own", "shared"))
        print(f"drives per second with idm, own process / shared, by {what} time: {other / one:.2f} ({drives} drives)")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--actors", type=int, default=40)
    parser.add_argument("--drives", type=int, default=8)
    parser.add_argument("--planner", action="append", help="as run --planner takes it; default straight_ahead, idm")
    asked = parser.parse_args()
    for spec in asked.planner or ("straight_ahead", "idm"):
        step_cost(spec, asked.actors)
    drive_cost(asked.drives)


if __name__ == "__main__":
    main()
