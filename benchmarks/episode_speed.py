"""How fast the closed loop is beside bare SUMO, all in one run: python benchmarks/episode_speed.py [--agents 150]

(a) bare libsumo: SUMO's steps, the ego moved, position, angle, speed and lane of every vehicle read, in traffic of (b)
(b) the whole episode with StraightAhead: reactions and recording included
(c) the same with scoring

Then what the reactions cost per step beside SUMO's own step in the same run, with the ego in its lane and astride two.

More agents than the scenario has are found on the oncoming lanes and farther up and down the road.
Times are CPU seconds; the three are taken from one drive, so that a noisy machine is noisy for all of them, and the
traffic is the same.
"""

from __future__ import annotations

import argparse
import statistics
import time
from dataclasses import replace
from itertools import pairwise
from math import cos, sin

import libsumo

from interplan_planners.idm import IdmPlanner
from interplan_planners.straight_ahead import StraightAhead
from interplan_sumo.maps.store import load_roads
from interplan_sumo.metrics.score import score
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.suite import find_scenario
from interplan_sumo.simulation.episode import Episode, EpisodeOptions, run_loop
from interplan_sumo.simulation.setup import open_traffic
from interplan_sumo.simulation.spawning import AHEAD_M, BEHIND_M

MANY = 100


def reach_m(agents: int) -> tuple[float, float]:
    """How far behind and ahead of the ego lanes are filled."""
    return (1000.0, 1000.0) if agents > MANY else (BEHIND_M, AHEAD_M)


def astride_m(scenario: Scenario) -> float:
    """Lateral offset at which the ego is astride its lane and a neighbour: left positive."""
    return -1.6 if load_roads(scenario.map).right_of(scenario.start.lane) is not None else 1.6


def episode(scenario: Scenario, agents: int) -> tuple[float, float, float, int, int]:
    """(Steps per second of bare libsumo, of the episode, and with scoring, mean number of vehicles, steps)."""
    roads, clock, vehicle = load_roads(scenario.map), time.process_time, libsumo.vehicle
    step, move = libsumo.simulationStep, vehicle.moveToXY
    bare_s = reading_s = vehicles = 0.0

    def timed_step() -> None:
        nonlocal bare_s, reading_s, vehicles
        began = clock()
        step()
        stepped = clock()
        names = vehicle.getIDList()
        for name in names:
            vehicle.getPosition(name)
            vehicle.getAngle(name)
            vehicle.getSpeed(name)
            vehicle.getLaneID(name)
        read = clock()
        bare_s, reading_s, vehicles = bare_s + read - began, reading_s + read - stepped, vehicles + len(names)

    def timed_move(*place: str | float) -> None:
        nonlocal bare_s
        began = clock()
        move(*place)
        bare_s += clock() - began

    with open_traffic(scenario, roads, most_agents=agents, reach_m=reach_m(agents)) as traffic:
        libsumo.simulationStep, vehicle.moveToXY = timed_step, timed_move  # type: ignore[assignment]
        try:
            began = clock()
            drive: Episode = run_loop(
                scenario, roads, StraightAhead(), traffic, options=EpisodeOptions(), on_phase=lambda _: None
            )
            driven_s = clock() - began - reading_s
        finally:
            libsumo.simulationStep, vehicle.moveToXY = step, move  # type: ignore[method-assign]
    trace = drive.trace
    assert trace is not None
    assert drive.fault is None, drive.fault
    scoring = clock()
    score(trace, roads, trace.ego, scenario)  # against itself: this is about time
    scored_s, steps = clock() - scoring, len(trace)
    return steps / bare_s, steps / driven_s, steps / (driven_s + scored_s), round(vehicles / steps), steps


def reactions(scenario: Scenario, agents: int, beside_m: float) -> tuple[float, float, float]:
    """Seconds per step that reacting, placing the ego and SUMO's step take while the ego drives as IDM does.

    It keeps `beside_m` to the left of where IDM drives, and so never drives through the cars ahead.
    """
    roads = load_roads(scenario.map)
    with open_traffic(scenario, roads, most_agents=agents, reach_m=reach_m(agents)) as traffic:
        drive = run_loop(scenario, roads, IdmPlanner(), traffic, options=EpisodeOptions(), on_phase=lambda _: None)
    assert drive.trace is not None
    states = [drive.trace.ego.state(k) for k in range(len(drive.trace))]
    egos = [
        replace(s, x_m=s.x_m - beside_m * sin(s.heading_rad), y_m=s.y_m + beside_m * cos(s.heading_rad)) for s in states
    ]
    steps = len(egos) - 1
    clock, step, spent = time.process_time, libsumo.simulationStep, [0.0, 0.0, 0.0]

    def timed_step() -> None:
        began = clock()
        step()
        spent[2] += clock() - began

    with open_traffic(scenario, roads, most_agents=agents, reach_m=reach_m(agents)) as traffic:
        libsumo.simulationStep = timed_step  # type: ignore[assignment]
        try:
            for now, then in pairwise(egos):
                traffic.observe()
                began = clock()
                traffic.react(now)
                reacted = clock()
                traffic.place_ego(then)
                spent[0] += reacted - began
                spent[1] += clock() - reacted
                traffic.advance()
        finally:
            libsumo.simulationStep = step
    react_s, place_s, step_s = (each / steps for each in spent)
    return react_s, place_s, step_s


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", default="lane_change_htd/6")
    parser.add_argument("--agents", type=int, default=40)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    scenario = find_scenario(options.scenario)
    if options.agents > MANY:
        scenario = replace(scenario, traffic=replace(scenario.traffic, oncoming="high"))
    rates: list[tuple[float, float, float]] = []
    count = steps = 0
    for _ in range(options.repeats + 1):  # the first one warms up
        plain, driven, scored, count, steps = episode(scenario, options.agents)
        rates.append((plain, driven, scored))
    a, b, c = (statistics.median(column) for column in zip(*rates[1:], strict=True))
    ratio_b = statistics.median(r[1] / r[0] for r in rates[1:])
    ratio_c = statistics.median(r[2] / r[0] for r in rates[1:])
    print(f"{options.scenario}, {count} vehicles on average, median of {options.repeats} runs of {steps} steps")
    print(f"(a) bare libsumo            {a:8.0f} steps/s")
    print(f"(b) episode                 {b:8.0f} steps/s   {ratio_b:.2f} of (a)")
    print(f"(c) episode and scoring     {c:8.0f} steps/s   {ratio_c:.2f} of (a)")
    for name, beside_m in (("in its lane", 0.0), ("astride two lanes", astride_m(scenario))):
        rows = [reactions(scenario, options.agents, beside_m) for _ in range(options.repeats + 1)][1:]
        react_us, place_us, step_us = (1e6 * statistics.median(column) for column in zip(*rows, strict=True))
        ratio = statistics.median(react / step for react, _, step in rows)
        print(
            f"ego {name:17s} reactions {react_us:4.0f} us ({ratio:.2f} of SUMO's step), "
            f"placing it {place_us:3.0f} us, SUMO's step {step_us:4.0f} us"
        )


if __name__ == "__main__":
    main()
