"""What holds for every planner of the package, in scenes that are not kind to it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.util import find_spec

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from worlds import (
    cars,
    curved_road,
    ego,
    ego_on,
    junction,
    mission,
    observation,
    pedestrians,
    signals,
    straight_road,
    together,
)

from interplan_sumo.dynamics.lqr import follow
from interplan_sumo.plan_check import check_plan
from interplan_sumo.planner import Mission, Past, Planner, load_planner
from interplan_sumo.testing import assert_planner_conforms
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.geometry import Pose
from interplan_sumo.world.signals import Signals

PLANNERS = ("foresight", "idm", "idm_mobil", "idm_mobil?published=true", "pdm_closed")
LEARNED = ("dtpp", "gameformer", "gc_pgp", "pdm_hybrid", "pdm_open", "urban_driver")
"""May drive badly, but must plan."""
NEEDS_ONNX = pytest.mark.skipif(find_spec("onnxruntime") is None, reason="needs onnxruntime: the extra [learned]")
ALL = (*PLANNERS, *(pytest.param(name, marks=NEEDS_ONNX) for name in LEARNED))
ROAD = straight_road(lanes=1, length_m=300.0, limit_mps=13.9, cuts_m=((120.0, 135.0),))
WIDE = straight_road(lanes=3, length_m=300.0, limit_mps=13.9, cuts_m=((120.0, 135.0),))
BARE = straight_road(lanes=2, length_m=300.0, limit_mps=None)
CROSSING, CROSSING_LEFT = junction(), junction(driving_side="left")
BEND = curved_road(radius_m=15.0, run_in_m=50.0, lanes=2, limit_mps=8.3)


@dataclass(frozen=True, eq=False)
class Scene:
    mission: Mission
    ego: EgoState
    actors: Actors = field(default_factory=Actors.none)
    signals: Signals = field(default_factory=Signals.none)
    ends: Callable[[EgoState], bool] | None = None
    """What must hold after 6 s; without it 2 s are driven."""


def stands(state: EgoState) -> bool:
    return abs(state.vx_mps) < 0.5


def crowd(count: int) -> Actors:
    rng = np.random.default_rng(count)
    rows = np.stack(
        (
            rng.uniform(-20, 260, count),
            rng.uniform(-12, 6, count),
            rng.uniform(0, 12, count),
            rng.uniform(-4, 4, count),
        ),
        axis=1,
    )
    return cars(*(tuple(row) for row in rows.tolist()))


RED = signals(red=("12", "13", "14", "21", "24", "31", "41", "42"))
SCENES: dict[str, Scene] = {
    "standing at a red light": Scene(
        mission(CROSSING, ("1", "14", "8")), ego_on(CROSSING, "1", 56.0), signals=RED, ends=stands
    ),
    "inside the junction when it turns red": Scene(
        mission(CROSSING, ("1", "13", "7")), ego(-2.0, -1.75, 6.0), signals=RED
    ),
    "no road ahead": Scene(mission(WIDE, ("11",)), ego(110.0, 0.0, 8.0), ends=stands),
    "beyond the end of the road": Scene(mission(WIDE, ("31",)), ego(320.0, 0.0, 8.0), ends=stands),
    "goal behind": Scene(mission(WIDE, ("11", "21", "31"), goal_arc_m=5.0), ego(200.0, -3.5, 10.0)),
    "200 agents": Scene(mission(WIDE, ("12", "22", "32")), ego(60.0, -3.5, 8.0), crowd(200)),
    "agents inside the ego": Scene(
        mission(WIDE, ("12", "22", "32")), ego(60.0, -3.5, 8.0),
        together(cars((60.5, -3.6, 2.0), (59.0, -3.0)), pedestrians((61.0, -3.5, 1.0, 1.5))),
    ),
    "surrounded by cones": Scene(
        mission(WIDE, ("12", "22", "32")), ego(60.0, -3.5),
        cars((64, -3.5), (60, -1.7), (60, -5.3), (56, -3.5), kind=ActorKind.TRAFFIC_CONE, length_m=0.5, width_m=0.5),
        ends=stands,
    ),
    "empty road": Scene(mission(ROAD, ("11", "21", "31")), ego(20.0, 0.0, 10.0), ends=lambda e: e.x_m > 80.0),
    "left-hand traffic": Scene(
        mission(CROSSING_LEFT, ("1", "12", "6")), ego_on(CROSSING_LEFT, "1", 20.0, 6.0),
        cars((30.0, -1.75, 8.0, np.pi)), ends=lambda e: e.y_m < -3.0 or abs(e.heading_rad) > 0.2 or e.x_m > -30.0,
    ),
    "backing": Scene(mission(ROAD, ("11", "21", "31")), ego(60.0, 0.0, -1.0), ends=lambda e: e.vx_mps > 0.5),
    "across the lane": Scene(mission(WIDE, ("12", "22", "32")), ego(60.0, -3.5, 3.0, heading_rad=1.4)),
    "off the road": Scene(mission(WIDE, ("12", "22", "32")), ego(60.0, 30.0, 5.0)),
    "a car comes head on": Scene(
        mission(ROAD, ("11", "21", "31")), ego(60.0, 0.0, 10.0), cars((110.0, 0.0, 12.0, np.pi))
    ),
    "no speed limits": Scene(mission(BARE, ("11",)), ego(20.0, 0.0, 8.0), cars((80.0, 0.0, 3.0))),
    "much too fast": Scene(mission(ROAD, ("11", "21", "31")), ego(20.0, 0.0, 35.0)),
    "a narrow bend": Scene(mission(BEND, ("12",)), ego_on(BEND, "12", 30.0, 7.0), ends=lambda e: e.y_m > 5.0),
    "the route leaves the lane": Scene(
        Mission(CROSSING, ("1", "14", "7"), Pose(60.0, -1.75, 0.0)), ego_on(CROSSING, "1", 30.0, 6.0)
    ),
    "a route elsewhere": Scene(Mission(CROSSING, ("6",), Pose(-1.75, -40.0, -1.57)), ego_on(CROSSING, "1", 20.0, 6.0)),
    "unknown lights": Scene(
        mission(CROSSING, ("1", "13", "7")), ego_on(CROSSING, "1", 30.0, 6.0),
        signals=Signals(("999",), np.full(1, 2, dtype=np.int8)),
    ),
}  # fmt: skip


def drive(planner: Planner, scene: Scene, steps: int) -> EgoState:
    """Drive with everybody going on as they do; every plan is checked."""
    planner.start(scene.mission)
    state, a = scene.ego, scene.actors
    seen: list[Actors] = []
    for k in range(steps):
        t = 0.1 * k
        actors = Actors(
            a.ids, a.kind, a.x_m + t * a.vx_mps, a.y_m + t * a.vy_mps, a.heading_rad, a.length_m, a.width_m, a.vx_mps,
            a.vy_mps,
        )  # fmt: skip
        past = Past((state,) * len(seen), tuple(seen))
        plan = planner.plan(observation(state, actors, scene.signals, past))
        check_plan(plan, state, state.time_s)
        assert float(plan.time_s[-1]) - state.time_s >= 7.9
        state = follow(state, plan, 0.1, PACIFICA)
        seen = [*seen, actors][-20:]
    return state


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("spec", [pytest.param(name, marks=NEEDS_ONNX) for name in LEARNED])
def test_every_plan_of_a_network_is_valid(spec: str, name: str) -> None:
    drive(load_planner(spec), SCENES[name], 5)


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("spec", PLANNERS)
def test_every_plan_is_valid(spec: str, name: str) -> None:
    scene = SCENES[name]
    state = drive(load_planner(spec), scene, 20 if scene.ends is None else 60)
    assert scene.ends is None or scene.ends(state), state


@pytest.mark.parametrize("spec", ["idm_mobil", "pdm_closed"])
def test_who_is_in_the_junction_when_it_turns_red_clears_it(spec: str) -> None:
    """nuPlan's IDM, and the published MOBIL with it, stop there."""
    assert drive(load_planner(spec), SCENES["inside the junction when it turns red"], 60).x_m > 10.0


@pytest.mark.parametrize("spec", ALL)
def test_every_planner_conforms(spec: str) -> None:
    assert_planner_conforms(spec, steps=10)


@pytest.mark.parametrize("spec", PLANNERS)
@settings(max_examples=10)
@given(
    x=st.floats(0.0, 300.0), y=st.floats(-12.0, 6.0), heading=st.floats(-3.2, 3.2), speed=st.floats(-2.0, 25.0),
    seed=st.integers(0, 2**31),
)  # fmt: skip
@example(x=0.0, y=0.0, heading=2.0, speed=11.0, seed=0)  # turned far from its path, near to it with the rear axle
@example(x=126.95, y=4.51, heading=2.28, speed=3.97, seed=1195159440)  # some ways back do not begin where it is
def test_wherever_the_ego_is_the_plan_is_valid(
    spec: str, x: float, y: float, heading: float, speed: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(0, 30))
    rows = np.stack((rng.uniform(x - 40, x + 60, count), rng.uniform(-12, 6, count), rng.uniform(0, 12, count)), axis=1)
    actors = cars(*((*row, float(rng.normal(0.0, 1.0))) for row in rows.tolist()))
    drive(load_planner(spec), Scene(mission(WIDE, ("13", "23", "33")), ego(x, y, speed, heading), actors), 3)


@pytest.mark.parametrize("spec", PLANNERS)
def test_names_of_actors_do_not_matter(spec: str) -> None:
    """The same scene under other ids, in another order: the same plan."""
    actors = crowd(40)
    order = np.random.default_rng(3).permutation(40)
    columns = ("kind", "x_m", "y_m", "heading_rad", "length_m", "width_m", "vx_mps", "vy_mps")
    renamed = Actors(tuple(f"z{i:02d}" for i in range(40)), **{name: getattr(actors, name)[order] for name in columns})
    plans = []
    for seen in (actors, renamed):
        planner = load_planner(spec)
        planner.start(SCENES["200 agents"].mission)
        plans.append(planner.plan(observation(ego(60.0, -3.5, 8.0), seen)))
    assert plans[0].x_m == pytest.approx(plans[1].x_m, abs=1e-9)
    assert plans[0].y_m == pytest.approx(plans[1].y_m, abs=1e-9)


@pytest.mark.parametrize("spec", ALL)
def test_what_a_planner_is_given_stays_as_it_is(spec: str) -> None:
    scene = SCENES["200 agents"]
    before = scene.actors.x_m.tobytes() + scene.mission.roads["12"].centerline.points.tobytes()
    planner = load_planner(spec)
    planner.start(scene.mission)
    planner.plan(observation(scene.ego, scene.actors))
    assert scene.actors.x_m.tobytes() + scene.mission.roads["12"].centerline.points.tobytes() == before
