"""What a plan costs: python -m benchmarks.planner_speed [--planners idm foresight pdm_closed] [--actors 40] [--keep]

Drives each planner through the same traffic on shipped maps, all in turn, so
that a busy machine is busy for all of them: an ego that follows its plans with
tracker and bicycle, and actors that go on along their lanes at their speeds.
Prints the mean, the median, the 90th percentile and the largest processor time
per call of plan(), that of the first call, the mean as a ratio to that of IDM,
and the mean by the clock on the wall, which a busy machine makes longer. A
planner that keeps a plan for several steps has a mean, but hardly a median.
`--keep` puts it all where `make tables` finds it.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from interplan_sumo.dynamics.lqr import follow
from interplan_sumo.maps.store import load_roads
from interplan_sumo.planner import Mission, Observation, Past, load_planner
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import Floats, Polyline
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.signals import Signals
from tools.networks import keep_plan_times

MAPS = ("back_bay", "strip", "one_north", "hazelwood")
DEFAULT = (
    "idm", "idm_mobil", "idm_mobil?published=true", "pdm_closed", "pdm_proposals", "foresight", "foresight?budget=fast",
    "pdm_open", "urban_driver", "gc_pgp", "gameformer", "dtpp", "flow_drive", "pdm_hybrid",
)  # fmt: skip
STEPS = 60
SIGHT_M = 100.0
AWAY_M = 8.0


class Traffic:
    """Cars that follow lanes at constant speed, whatever happens around them."""

    def __init__(self, roads: Roads, rng: np.random.Generator, x_m: float, y_m: float, count: int) -> None:
        """`count` cars within sight of a point, none closer to it or to another than 8 m, if the lanes hold so many."""
        lanes = [lane for lane in roads.lanes_near(x_m, y_m, SIGHT_M) if lane in roads.lanes]
        self._lines: list[Polyline] = []
        arcs: list[float] = []
        places: list[Floats] = [np.array((x_m, y_m))]
        for _ in range(200 * count):
            line = self._onward(roads, lanes[int(rng.integers(len(lanes)))])
            arc_m = float(rng.uniform(0.0, line.length_m))
            place = line.poses_at(arc_m)[0, :2]
            apart = np.hypot(*(np.array(places) - place).T)
            if len(arcs) < count and apart.min() > AWAY_M and apart[0] < 0.9 * SIGHT_M:
                self._lines.append(line)
                arcs.append(arc_m)
                places.append(place)
        self._arc_m = np.array(arcs)
        self._speed_mps = rng.uniform(3.0, 12.0, len(arcs))

    @staticmethod
    def _onward(roads: Roads, lane_id: str) -> Polyline:
        chain = [lane_id]
        while len(chain) < 5 and roads.outgoing(chain[-1]):
            chain.append(roads.outgoing(chain[-1])[0])
        return Polyline(np.concatenate([roads[lane].centerline.points for lane in chain]))

    def at(self, time_s: float) -> Actors:
        arc_m = self._arc_m + self._speed_mps * time_s
        poses = [line.poses_at(a)[0] for line, a in zip(self._lines, arc_m.tolist(), strict=True)]
        x_m, y_m, heading = np.array(poses).T
        count, cos, sin = len(poses), np.cos(heading), np.sin(heading)
        ids = tuple(f"car{i:03d}" for i in range(count))
        length, width = np.full(count, 4.8), np.full(count, 1.9)
        speed = self._speed_mps
        return Actors(ids, np.zeros(count, np.int8), x_m, y_m, heading, length, width, speed * cos, speed * sin)


def scene(name: str, count: int) -> tuple[Mission, EgoState, Traffic]:
    """A route of a few roadblocks on a map, an ego at 9 m/s on its first lane, and traffic around it."""
    roads, rng = load_roads(name), np.random.default_rng(len(name))
    starts = [lane for lane in roads.lanes.values() if lane.centerline.length_m > 60.0 and roads.outgoing(lane.id)]
    chain = [starts[int(rng.integers(len(starts)))].id]
    while len(chain) < 7 and roads.outgoing(chain[-1]):
        chain.append(roads.outgoing(chain[-1])[0])
    chain = chain[: len(chain) - (len(chain) + 1) % 2]  # end on a lane
    first, last = roads[chain[0]].centerline, roads[chain[-1]].centerline
    pose = first.pose_at(max(10.0, first.length_m - 60.0))
    ego = EgoState(0.0, pose.x_m, pose.y_m, pose.heading_rad, vx_mps=9.0)
    mission = Mission(roads, roads.route_through(chain), last.pose_at(last.length_m / 2))
    return mission, ego, Traffic(roads, rng, pose.x_m, pose.y_m, count)


def plan_times_ms(spec: str, mission: Mission, ego: EgoState, traffic: Traffic) -> Floats:
    """One drive; milliseconds (calls, 2) of the processor and of the clock."""
    planner = load_planner(spec)
    planner.start(mission)
    past: list[tuple[EgoState, Actors]] = []
    took: list[tuple[float, float]] = []
    for k in range(STEPS):
        actors = traffic.at(0.1 * k)
        seen = Observation(
            ego.time_s, ego, actors.within(ego.x_m, ego.y_m, SIGHT_M), Signals.none(),
            Past(tuple(e for e, _ in past), tuple(a for _, a in past)),
        )  # fmt: skip
        began, busy = time.perf_counter(), time.thread_time()
        plan = planner.plan(seen)
        took.append((1e3 * (time.thread_time() - busy), 1e3 * (time.perf_counter() - began)))
        past = [*past, (ego, actors)][-20:]
        ego = follow(ego, plan, 0.1, mission.shape)
    return np.array(took)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--planners", nargs="+", default=DEFAULT)
    parser.add_argument("--actors", type=int, default=40)
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--keep", action="store_true", help="put what is found into docs/results")
    arguments = parser.parse_args()
    scenes = [scene(name, arguments.actors) for name in MAPS]
    print(f"{', '.join(f'{len(s[2].at(0.0))} on {name}' for name, s in zip(MAPS, scenes, strict=True))}")
    drives: dict[str, list[Floats]] = {spec: [] for spec in arguments.planners}
    for _ in range(arguments.repeats):
        for mission, ego, traffic in scenes:
            for spec in arguments.planners:
                drives[spec].append(plan_times_ms(spec, mission, ego, traffic))
    later = {spec: np.concatenate([took[1:] for took in runs]) for spec, runs in drives.items()}
    idm_ms = float(later["idm"][:, 0].mean()) if "idm" in later else float("nan")
    kept: list[tuple[object, ...]] = []
    head = ("mean", "median", "90 %", "most", "first", "x IDM", "clock")
    print(f"{'milliseconds per plan':28}" + "".join(f" {title:>8}" for title in head))
    for spec, times_ms in later.items():
        mean, clock = times_ms.mean(axis=0).tolist()
        first = max(took[0, 0] for took in drives[spec])
        shown = (mean, *np.percentile(times_ms[:, 0], (50, 90, 100)).tolist(), first, mean / idm_ms, clock)
        print(f"{spec:28}" + "".join(f" {value:8.2f}" for value in shown))
        kept.append((spec, *(f"{value:.3f}" for value in shown)))
    if arguments.keep:
        keep_plan_times(kept)


if __name__ == "__main__":
    main()
