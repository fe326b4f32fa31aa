"""What one step of the ego costs: python benchmarks/dynamics_speed.py [--repeats 2000]

Times the plan check, the LQR tracker and the bicycle for plans of 81 poses every
0.1 s and of 17 poses every 0.5 s, and one plan of the IDM planner at 40 actors. Best
and median of the repeats, in microseconds.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable

import numpy as np

from interplan_planners.idm import IdmPlanner
from interplan_sumo.dynamics import bicycle, lqr
from interplan_sumo.plan_check import check_plan
from interplan_sumo.tiny_worlds import cars, ego, mission, observation, straight_road
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.trajectory import Trajectory


def plan_of(count: int, step_s: float) -> Trajectory:
    """A gentle bend at 8 m/s."""
    time_s = np.linspace(0.0, step_s * (count - 1), count)
    heading = 0.02 * time_s
    return Trajectory(time_s, 8.0 * np.sin(heading) / 0.02, 8.0 * (1.0 - np.cos(heading)) / 0.02, heading)


def microseconds(call: Callable[[], object], repeats: int) -> tuple[float, float]:
    """Best and median time of a call."""
    took: list[float] = []
    for _ in range(repeats):
        began = time.perf_counter()
        call()
        took.append(1e6 * (time.perf_counter() - began))
    return min(took), statistics.median(took)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=2000)
    repeats: int = parser.parse_args().repeats
    state = EgoState(0.0, 0.0, 0.2, 0.01, vx_mps=8.0, tire_angle_rad=0.01)
    calls: list[tuple[str, Callable[[], object]]] = [("bicycle step", lambda: bicycle.step(state, 0.5, 0.1, 0.1))]
    for plan in (plan_of(81, 0.1), plan_of(17, 0.5)):
        name = f"{len(plan)} poses"
        calls += [
            (f"{name}: plan check", lambda plan=plan: check_plan(plan, state, 0.0)),
            (f"{name}: LQR tracker", lambda plan=plan: lqr.track(state, plan)),
            (f"{name}: LQR tracker + bicycle", lambda plan=plan: lqr.follow(state, plan, 0.1)),
        ]
    road = straight_road(lanes=3, length_m=400.0, cuts_m=((150.0, 160.0),))
    planner = IdmPlanner()
    planner.start(mission(road, ("12", "22", "32")))
    places = [(10.0 * i, -3.5 * lane, 8.0) for i in range(14) for lane in range(3) if (i, lane) not in ((6, 1), (0, 0))]

    def idm_plan() -> Trajectory:
        return planner.plan(observation(ego(60.0, -3.5, 8.0), cars(*places)))

    calls.append((f"IDM plan, {len(places)} actors (scene made anew)", idm_plan))
    print(f"{'microseconds':45} {'best':>8} {'median':>8}")
    for name, call in calls:
        best, median = microseconds(call, repeats)
        print(f"{name:45} {best:8.1f} {median:8.1f}")


if __name__ == "__main__":
    main()
