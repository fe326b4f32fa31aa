"""What numbers a suite is made of: python -m benchmarks.suite_numbers interplan==1 --out suite_numbers.png

Histograms over the scenes, places and certificates of a suite, and their quantiles as a table: how far ahead the event
is, how fast one starts, how tight, wide and full the road is, what gaps there are. Replays every certificate once.
Needs the extra [plots].
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from interplan_sumo.families.lane_change import dead_end
from interplan_sumo.maps.store import load_roads
from interplan_sumo.scenario.route import goal_arc_m, route_centerline, start_arc_m
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.sites import lane_width_m
from interplan_sumo.scenario.suite import expert, find_suite
from interplan_sumo.verification.replay import replay
from interplan_sumo.verification.surrounding_traffic import surrounding_traffic
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.lane_changes import lane_changes_needed
from interplan_sumo.world.roads import USUAL_LIMIT_MPS, Roads
from interplan_sumo.world.trace import Trace

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
RADIUS_OVER_M, STRAIGHT_M = 6.0, 300.0
"""A radius is told from the turn over this length of the way; beyond the second a road counts as straight."""
GAPS_AT_S, ASIDE_M, LONGEST_GAP_M = 5.0, 1.5, 100.0
"""Gaps are taken at this time between moving vehicles one of which is ahead of the other, so far aside at most."""
BINS = 20


def main() -> None:
    """Collect the numbers, draw them, print their quantiles."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("suite", help="NAME==VERSION, with certificates")
    parser.add_argument("--out", type=Path, required=True, help="a picture, .png")
    given = parser.parse_args()
    numbers: dict[str, list[float]] = defaultdict(list)
    for scenario in find_suite(given.suite).scenarios:
        roads = load_roads(scenario.map, scenario.maps_beside)
        trace = replay(scenario, expert(scenario))
        for name, value in (*_of_scene(scenario, roads), *_of_drive(trace)):
            numbers[name].append(value)
    print("| | n | " + " | ".join(f"p{100 * q:.0f}" for q in QUANTILES) + " |")
    print("|---|---|" + "---|" * len(QUANTILES))
    for name, values in numbers.items():
        print(f"| {name} | {len(values)} | " + " | ".join(f"{q:.3g}" for q in np.quantile(values, QUANTILES)) + " |")
    _drawn(numbers).savefig(given.out, dpi=110)


def _of_scene(scenario: Scenario, roads: Roads) -> Iterator[tuple[str, float]]:
    line, start_m = route_centerline(roads, scenario), start_arc_m(roads, scenario)
    limit_mps = roads[scenario.start.lane].speed_limit_mps or USUAL_LIMIT_MPS
    if (event_m := _event_m(scenario, roads)) is not None:
        yield "from the ego's front to the event, m", event_m - start_m - PACIFICA.length_m / 2.0
    yield "start speed, m/s", scenario.start_speed_mps
    yield "start speed over the limit", scenario.start_speed_mps / limit_mps
    yield "lane width at the start, m", lane_width_m(roads.lanes[scenario.start.lane], scenario.start.arc_m)
    arcs_m = np.arange(start_m, goal_arc_m(roads, scenario), RADIUS_OVER_M)
    turns_rad = np.abs(np.diff(np.unwrap([line.pose_at(float(arc_m)).heading_rad for arc_m in arcs_m])))
    yield "tightest radius of the way, m", min(RADIUS_OVER_M / max(float(np.max(turns_rad)), 1e-6), STRAIGHT_M)
    for walker in scenario.jaywalkers:
        yield "walking speed, m/s", walker.speed_mps


def _event_m(scenario: Scenario, roads: Roads) -> float | None:
    """Arc length of the route where the first thing stands or walks, or the lane ends for who does not change."""
    line = route_centerline(roads, scenario)
    places = [each.place for each in scenario.obstacles] + [each.start for each in scenario.jaywalkers]
    if not places:
        need = lane_changes_needed(roads, scenario.route, scenario.goal.lane)
        last = dead_end(roads, need, scenario.start.lane, roads[scenario.goal.lane].roadblock_id)
        if last is None:
            return None
        return line.project_point(*roads[last].centerline.points[-1].tolist())[0]
    return min(line.project_point(pose.x_m, pose.y_m)[0] for pose in (place.pose(roads) for place in places))


def _of_drive(trace: Trace) -> Iterator[tuple[str, float]]:
    met = surrounding_traffic(trace)
    yield "vehicles within 100 m, mean of 20 s", met.vehicles
    yield "who crosses the way", float(met.crossing)
    yield "who comes towards the ego", float(met.oncoming)
    for gap_m in _gaps_m(trace).tolist():
        yield "gaps between who moves, m", gap_m


def _gaps_m(trace: Trace) -> Floats:
    """Bumper to bumper, to the nearest one ahead of each moving vehicle within 100 m of the ego."""
    frame = min(round(GAPS_AT_S / 0.1), len(trace) - 1)
    actors = trace.actors.at(frame).within(float(trace.ego.x_m[frame]), float(trace.ego.y_m[frame]), 100.0)
    moving = np.flatnonzero((actors.speed_mps > 1.0) & (actors.length_m > 3.0))
    found: list[float] = []
    for row in moving:
        dx, dy = actors.x_m[moving] - actors.x_m[row], actors.y_m[moving] - actors.y_m[row]
        cosine, sine = np.cos(actors.heading_rad[row]), np.sin(actors.heading_rad[row])
        ahead_m = cosine * dx + sine * dy - (actors.length_m[moving] + actors.length_m[row]) / 2.0
        same_way = (np.abs(cosine * dy - sine * dx) < ASIDE_M) & (ahead_m > 0.0) & (ahead_m < LONGEST_GAP_M)
        if same_way.any():
            found.append(float(ahead_m[same_way].min()))
    return np.array(found)


def _drawn(numbers: dict[str, list[float]]) -> Figure:
    columns = 4
    rows = -(-len(numbers) // columns)
    figure = Figure(figsize=(3.2 * columns, 2.2 * rows), layout="constrained")
    for place, (name, values) in enumerate(numbers.items()):
        axes = figure.add_subplot(rows, columns, place + 1)
        axes.hist(values, bins=BINS, color="#3a6ea5")
        axes.axvline(float(np.median(values)), color="#c44", linewidth=1.2)
        axes.set_title(f"{name} (n = {len(values)})", fontsize=8)
        axes.tick_params(labelsize=7)
        axes.spines[["top", "right"]].set_visible(False)
    return figure


if __name__ == "__main__":
    main()
