"""What perception costs per step beside the simulation's own step: python benchmarks/perception_speed.py [--agents 40]

One drive of StraightAhead with full perception is recorded; then every mode looks at its frames again.
All modes take their turns on the same frames, so that a noisy machine is noisy for all of them.
"""

from __future__ import annotations

import argparse
import statistics
import time
from dataclasses import replace

from interplan_planners.straight_ahead import StraightAhead
from interplan_sumo.maps.store import load_roads
from interplan_sumo.scenario.suite import find_scenario
from interplan_sumo.simulation.episode import DT_S, EpisodeOptions, run_loop
from interplan_sumo.simulation.perception import Perception
from interplan_sumo.simulation.setup import open_traffic

MODES = ("full", "occluded", "noisy", "late", "occluded+noisy+late")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", default="lane_change_htd/3")
    parser.add_argument("--agents", type=int, default=40)
    parser.add_argument("--repeats", type=int, default=5)
    asked = parser.parse_args()
    scenario = find_scenario(asked.scenario)
    roads = load_roads(scenario.map)
    with open_traffic(scenario, roads, most_agents=asked.agents) as traffic:
        episode = run_loop(scenario, roads, StraightAhead(), traffic, options=EpisodeOptions(), on_phase=lambda _: None)
        heights_m = dict(traffic.heights_m)
    trace = episode.trace
    assert trace is not None
    steps = len(trace) - 1
    step_ms = 1e3 * episode.times_s["simulation"] / steps
    egos = [trace.ego.state(k) for k in range(len(trace))]
    frames = [trace.actors.at(k) for k in range(len(trace))]
    taken_ms: dict[str, list[float]] = {mode: [] for mode in MODES}
    near = 0.0
    for _ in range(asked.repeats):
        for mode in MODES:
            seeing = Perception(replace(scenario, perception=mode), roads, heights_m, 0, DT_S)
            seeing.first(egos[0], frames[0])
            began = time.perf_counter()
            seen = [seeing.look(ego, actors) for ego, actors in zip(egos[1:], frames[1:], strict=True)]
            taken_ms[mode].append(1e3 * (time.perf_counter() - began) / steps)
            near = max(near, statistics.mean(map(len, seen)))
    mean = statistics.mean(map(len, frames))
    print(f"{scenario.id}: {mean:.0f} actors, {near:.0f} within 100 m; a step of the simulation takes {step_ms:.2f} ms")
    for mode, taken in taken_ms.items():
        best = min(taken)
        print(f"{mode:20} {best:.3f} ms per step (median {statistics.median(taken):.3f}), {best / step_ms:.3f} of it")


if __name__ == "__main__":
    main()
