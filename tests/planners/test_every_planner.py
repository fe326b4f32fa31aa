"""What holds for every planner of the package, in scenes that are not kind to it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.util import find_spec

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from worlds import cars, curved_road, ego, ego_on, junction, mission, observation, signals, straight_road

from interplan_sumo.planner import Mission, load_planner
from interplan_sumo.testing import assert_planner_conforms
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.geometry import Pose
from interplan_sumo.world.signals import Signals
from tests.planners.staging_planners import driven
from tests.quick import slow

DRIVERS = ("foresight", "idm", "idm_mobil", "pdm_closed", slow("foresight?budget=fast"))
PLANNERS = (*DRIVERS, slow("idm_mobil?published=true"))
NEEDS_ONNX = pytest.mark.skipif(find_spec("onnxruntime") is None, reason="needs onnxruntime: the extra [learned]")
LEARNED = tuple(
    pytest.param(name, marks=(NEEDS_ONNX, *([] if name == "urban_driver" else [pytest.mark.slow])))
    for name in ("dtpp", "flow_drive", "gameformer", "gc_pgp", "pdm_hybrid", "pdm_open", "urban_driver")
)
"""May drive badly, but must plan; one of them in a hurry."""
ROAD = mission(straight_road(lanes=1, length_m=300.0, limit_mps=13.9, cuts_m=((120.0, 135.0),)), ("11", "21", "31"))
ROADS = straight_road(lanes=3, length_m=300.0, limit_mps=13.9, cuts_m=((120.0, 135.0),))
WIDE = mission(ROADS, ("12", "22", "32"))
CROSSING = junction()
AHEAD = mission(CROSSING, ("1", "13", "7"))
BEND = curved_road(radius_m=15.0, run_in_m=50.0, lanes=2, limit_mps=8.3)
RED = signals(red=("12", "13", "14", "21", "24", "31", "41", "42"))
INSIDE = ego(-2.0, -1.75, 6.0)
"""On connector 13."""


@dataclass(frozen=True, eq=False)
class Scene:
    mission: Mission
    ego: EgoState
    actors: Actors = field(default_factory=Actors.none)
    signals: Signals = field(default_factory=Signals.none)
    ends: Callable[[EgoState], bool] | None = None
    """What must hold after 6 s; without it 1 s is driven."""


def stands(state: EgoState) -> bool:
    return abs(state.vx_mps) < 0.5


SCENES: dict[str, Scene] = {
    "inside the junction when it turns red": Scene(AHEAD, INSIDE, signals=RED),
    "no road ahead": Scene(mission(ROADS, ("11",)), ego(110.0, 0.0, 8.0), ends=stands),
    "beyond the end of the road": Scene(mission(ROADS, ("31",)), ego(320.0, 0.0, 8.0), ends=stands),
    "surrounded by cones": Scene(
        WIDE, ego(60.0, -3.5),
        cars((64, -3.5), (60, -1.7), (60, -5.3), (56, -3.5), kind=ActorKind.TRAFFIC_CONE, length_m=0.5, width_m=0.5),
        ends=stands,
    ),
    "backing": Scene(ROAD, ego(60.0, 0.0, -1.0), ends=lambda e: e.vx_mps > 0.5),
    "across the lane": Scene(WIDE, ego(60.0, -3.5, 3.0, heading_rad=1.4)),
    "off the road": Scene(WIDE, ego(60.0, 30.0, 5.0)),
    "a car comes head on": Scene(ROAD, ego(60.0, 0.0, 10.0), cars((110.0, 0.0, 12.0, np.pi))),
    "much too fast": Scene(ROAD, ego(20.0, 0.0, 35.0)),
    "a narrow bend": Scene(mission(BEND, ("12",)), ego_on(BEND, "12", 30.0, 7.0), ends=lambda e: e.y_m > 5.0),
    "the route leaves the lane": Scene(
        Mission(CROSSING, ("1", "14", "7"), Pose(60.0, -1.75, 0.0)), ego_on(CROSSING, "1", 30.0, 6.0)
    ),
    "a route elsewhere": Scene(Mission(CROSSING, ("6",), Pose(-1.75, -40.0, -1.57)), ego_on(CROSSING, "1", 20.0, 6.0)),
    "unknown lights": Scene(
        AHEAD, ego_on(CROSSING, "1", 30.0, 6.0), signals=Signals(("999",), np.full(1, 2, dtype=np.int8))
    ),
}  # fmt: skip
"""What the worlds of the conformance suite do not have."""
ODD_FOR_A_NETWORK = ("beyond the end of the road", "off the road", "a route elsewhere", "unknown lights")


def drive(
    spec: str,
    job: Mission,
    start: EgoState,
    seconds: float,
    actors: Actors | None = None,
    lights: Signals | None = None,
) -> list[EgoState]:
    planner = load_planner(spec)
    planner.start(job)
    return driven(planner, start, round(10 * seconds), actors, lights)


def end_of(spec: str, scene: Scene, steps: int) -> EgoState:
    planner = load_planner(spec)
    planner.start(scene.mission)
    return driven(planner, scene.ego, steps, scene.actors, scene.signals, may_touch=True)[-1]


@pytest.mark.parametrize("name", ODD_FOR_A_NETWORK)
@pytest.mark.parametrize("spec", LEARNED)
def test_every_plan_of_a_network_is_valid(spec: str, name: str) -> None:
    end_of(spec, SCENES[name], 3)


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("spec", PLANNERS)
def test_every_plan_is_valid(spec: str, name: str) -> None:
    scene = SCENES[name]
    state = end_of(spec, scene, 10 if scene.ends is None else 60)
    assert scene.ends is None or scene.ends(state), state


@pytest.mark.parametrize("spec", ["idm_mobil", "pdm_closed"])
def test_who_is_in_the_junction_when_it_turns_red_clears_it(spec: str) -> None:
    """nuPlan's IDM, and the published MOBIL with it, stop there."""
    assert end_of(spec, SCENES["inside the junction when it turns red"], 40).x_m > 10.0


@pytest.mark.parametrize("spec", [*PLANNERS, *LEARNED])
def test_every_planner_conforms(spec: str) -> None:
    assert_planner_conforms(spec, steps=6)


@pytest.mark.parametrize("spec", PLANNERS)
@settings(max_examples=5)
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
    end_of(spec, Scene(mission(ROADS, ("13", "23", "33")), ego(x, y, speed, heading), actors), 3)


@pytest.mark.parametrize("spec", PLANNERS)
def test_names_of_actors_do_not_matter(spec: str) -> None:
    """The same scene under other ids, in another order: the same plan."""
    rng = np.random.default_rng(3)
    rows = [tuple(row) for row in rng.uniform((-20, -12, 0, -4), (260, 6, 12, 4), (40, 4)).tolist()]
    plans = []
    for seen in (cars(*rows), cars(*reversed(rows), prefix="z")):
        planner = load_planner(spec)
        planner.start(WIDE)
        plans.append(planner.plan(observation(ego(60.0, -3.5, 8.0), seen)))
    assert plans[0].time_s[-1] >= 7.9
    assert plans[0].x_m == pytest.approx(plans[1].x_m, abs=1e-9)
    assert plans[0].y_m == pytest.approx(plans[1].y_m, abs=1e-9)


@pytest.mark.parametrize("spec", DRIVERS)
def test_on_a_free_road_it_keeps_its_lane_and_the_limit(spec: str) -> None:
    job = mission(straight_road(lanes=3, length_m=3000.0, limit_mps=13.9), ("12",))
    states = drive(spec, job, ego(20.0, -3.5, 12.5), 8.0)
    assert max(state.vx_mps for state in states) <= 13.95
    assert states[-1].vx_mps == pytest.approx(13.9, abs=0.5)
    assert max(abs(state.y_m + 3.5) for state in states) < 0.1


@pytest.mark.parametrize("spec", DRIVERS)
def test_it_follows_whoever_is_ahead(spec: str) -> None:
    state = drive(spec, ROAD, ego(30.0, 0.0, 8.0), 15.0, cars((50.0, 0.0, 6.0)))[-1]
    assert state.vx_mps == pytest.approx(6.0, abs=0.4)
    # In a steady flow IDM keeps (s0 + v T) / sqrt(1 - (v / v0)^4) = 10.2 m; a lead frozen in the plan adds some.
    assert 5.0 < 50.0 + 15.0 * 6.0 - 2.4 - state.x_m - PACIFICA.length_m / 2 < 14.0


@pytest.mark.parametrize("spec", DRIVERS)
def test_it_stops_behind_what_fills_the_road(spec: str) -> None:
    wall = cars((110.0, 0.0), (110.0, -3.5), (110.0, -7.0))
    state = drive(spec, WIDE, ego(60.0, -3.5, 10.0), 12.0, wall)[-1]
    assert state.vx_mps < 0.3
    assert 0.3 < 110.0 - 2.4 - state.x_m - PACIFICA.length_m / 2 < 5.0


@pytest.mark.parametrize("spec", DRIVERS)
def test_it_stops_at_red_and_goes_when_it_turns_green(spec: str) -> None:
    job = mission(CROSSING, ("1", "14", "8"))
    red = drive(spec, job, ego_on(CROSSING, "1", 30.0, 8.0), 12.0, lights=signals(red=("12", "13", "14")))[-1]
    assert red.vx_mps < 0.3
    assert -17.0 < red.x_m + PACIFICA.length_m / 2 < -12.0
    assert drive(spec, job, red, 6.0, lights=signals(green=("14",)))[-1].x_m > -8.0
