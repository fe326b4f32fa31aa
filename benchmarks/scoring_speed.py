"""What one score costs: a 30 s drive among traffic that stays around the ego, under every profile.

    python benchmarks/scoring_speed.py [actors ...]

Prints the median of ten scores per profile, then each metric of the first
profile on facts that others have already derived.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np

from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.metric import METRICS
from interplan_sumo.metrics.profile import PROFILES
from interplan_sumo.metrics.score import score, score_facts
from interplan_sumo.scenario.scenario import LanePosition, Scenario
from interplan_sumo.tiny_worlds import LANE_WIDTH_M, drive_through, road_along
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.geometry import Polyline
from interplan_sumo.world.roads import LaneLike, Roads
from interplan_sumo.world.trace import Trace

FRAMES = 300
LANES = 4
REPEATS = 10


def winding_road(length_m: float = 1200.0, blocks: int = 12) -> Roads:
    """A road of four lanes in gentle bends, cut into blocks by short connectors."""
    arc = np.arange(0.0, length_m, 2.0)
    line = Polyline(np.column_stack((arc, 30.0 * np.sin(arc / 150.0))))
    cuts = [(at, at + 12.0) for at in np.linspace(80.0, line.length_m - 80.0, blocks)]
    return road_along(line, LANES, 13.0, cuts)


def drive(roads: Roads, actors: int) -> Trace:
    """The ego at 12 m/s with two lane changes, the actors beside, ahead and behind it at 10 to 14 m/s."""
    middle = Polyline(np.concatenate([lane.centerline.points for lane in _chain(roads)]))
    seconds = np.arange(FRAMES) * 0.1
    poses = middle.poses_at(100.0 + 12.0 * seconds)
    left = LANE_WIDTH_M * (np.tanh(seconds - 8.0) - np.tanh(seconds - 20.0)) / 2
    poses[:, 0] -= left * np.sin(poses[:, 2])
    poses[:, 1] += left * np.cos(poses[:, 2])
    rng = np.random.default_rng(0)
    ahead = rng.uniform(-60.0, 90.0, actors)
    pace = rng.uniform(10.0, 14.0, actors)
    lane = np.arange(actors) % LANES
    around = [_actors(middle, 100.0 + ahead + pace * t, lane, pace) for t in seconds]
    return drive_through(poses, np.full(FRAMES, 12.0), around)


def _chain(roads: Roads) -> list[LaneLike]:
    """The second lane from the left, from end to end."""
    blocks = sorted(roads.roadblocks.values(), key=lambda block: int(block.id))
    return [roads[block.lane_ids[1]] for block in blocks]


def _actors(middle: Polyline, arc: np.ndarray, lane: np.ndarray, speed: np.ndarray) -> Actors:
    x, y, heading = middle.poses_at(arc).T
    left = (1 - lane) * LANE_WIDTH_M
    count = len(arc)
    return Actors(
        tuple(f"v{i:03d}" for i in range(count)), np.full(count, ActorKind.VEHICLE),
        x - left * np.sin(heading), y + left * np.cos(heading), heading, np.full(count, 4.8), np.full(count, 2.0),
        speed * np.cos(heading), speed * np.sin(heading),
    )  # fmt: skip


def milliseconds(work: Callable[[], object]) -> float:
    """Median processor time of `REPEATS` calls after one to warm up."""
    work()
    took: list[float] = []
    for _ in range(REPEATS):
        start = time.process_time()
        work()
        took.append(time.process_time() - start)
    return float(np.median(took)) * 1e3


def main(counts: list[int]) -> None:
    roads = winding_road()
    first, last = roads.roadblocks["1"], max(roads.roadblocks.values(), key=lambda block: int(block.id))
    route = tuple(sorted(roads.roadblocks, key=int))
    scenario = Scenario(
        "lane_change_mtd/0", "lane_change_mtd", "tiny_road", LanePosition(first.lane_ids[1], 20.0), 12.0,
        LanePosition(last.lane_ids[2], 60.0), route,
    )  # fmt: skip
    print(f"{len(roads.lanes)} lanes, {len(roads.connectors)} connectors, {FRAMES} frames")
    for count in counts:
        trace = drive(roads, count)
        print(f"\n{count} actors")
        for profile in PROFILES:
            cost = milliseconds(lambda trace=trace, p=profile: score(trace, roads, trace.ego, scenario, p))
            print(f"  {profile:<24}{cost:8.1f} ms")
        facts = Facts(trace, roads, trace.ego, scenario)
        for name in score_facts(facts).metrics:
            print(f"    {name:<22}{milliseconds(lambda m=METRICS[name], f=facts: m.judge(f)):8.2f} ms")


if __name__ == "__main__":
    main([int(count) for count in sys.argv[1:]] or [40, 60])
