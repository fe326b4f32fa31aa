"""nuPlan's planners on our worlds, and ours in nuPlan's hands, with the devkit's own classes."""

from __future__ import annotations

import gc
import pickle
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from devkit import devkit

from interplan_sumo.dynamics.lqr import follow
from interplan_sumo.errors import MapError, PlannerLoadError, UnknownNameError
from interplan_sumo.planner import Mission, Observation, Past, Planner, load_planner
from interplan_sumo.testing import check_planner
from interplan_sumo.tiny_worlds import cars, ego_on, junction, mission, observation, signals, straight_road
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.trajectory import Trajectory

pytestmark = pytest.mark.filterwarnings("ignore")

ROADS = straight_road(lanes=2, length_m=300.0, cuts_m=((100.0, 120.0),))
MISSION = mission(ROADS, ("11", "21", "31"))
PARKED = cars((60.0, 0.0))
SHORT = mission(straight_road(lanes=2, length_m=60.0, cuts_m=((20.0, 30.0),)), ("11", "21", "31"))
BEYOND = cars((62.4, 0.0))
"""A car that stands a metre beyond the end of nuPlan's path, which is at 59 m: half the ego's width is 1.15 m."""
IDM = {
    "target_velocity": 10,
    "min_gap_to_lead_agent": 1.0,
    "headway_time": 1.5,
    "accel_max": 1.0,
    "decel_max": 3.0,
    "planned_trajectory_samples": 16,
    "planned_trajectory_sample_interval": 0.5,
    "occupancy_map_radius": 40,
}
"""As in the devkit's configuration."""


@pytest.fixture(scope="module")
def bridge() -> ModuleType:
    return devkit("interplan_sumo.bridge.nuplan.planner")


@pytest.fixture(scope="module")
def ours() -> ModuleType:
    return devkit("interplan_sumo.bridge.nuplan.ours")


def observed(step: int, speed_mps: float = 5.0) -> Observation:
    """A drive along the left lane, with its past."""

    def ego(k: int) -> Any:
        return ego_on(ROADS, "11", 20.0 + 0.1 * speed_mps * k, speed_mps, time_s=0.1 * k)

    past = tuple(ego(k) for k in range(step - 20, step))
    return observation(ego(step), PARKED, signals(), Past(past, (PARKED,) * 20))


def kind_of(bridge: Any, **changes: Any) -> Any:
    """A class of nuPlan planners that keep what they are given and brake gently."""
    objects = devkit("interplan_sumo.bridge.nuplan.objects")

    class Recorder(bridge.AbstractPlanner):
        requires_scenario = changes.get("requires_scenario", False)

        def name(self) -> str:
            return "recorder"

        def observation_type(self) -> Any:
            return changes.get("observation_type", bridge.DetectionsTracks)

        def initialize(self, initialization: Any) -> None:
            self.told = initialization
            self.asked: list[Any] = []

        def compute_planner_trajectory(self, current_input: Any) -> Any:
            gc.disable()
            self.asked.append((current_input, list(current_input.history.ego_states)))
            ego = objects.our_ego(current_input.history.ego_states[-1])
            ahead_s = np.linspace(0.0, 2.0, 21)
            plan = Trajectory(
                ego.time_s + ahead_s, ego.x_m + 4.0 * ahead_s, np.full(21, ego.y_m), np.full(21, ego.heading_rad)
            )
            return objects.nuplan_plan(plan, objects.vehicle_parameters(objects.PACIFICA))

    return Recorder


def started(bridge: Any) -> tuple[Any, list[Any]]:
    """A planner on its mission, and the planners of nuPlan's made so far."""
    made: list[Any] = []
    kind = kind_of(bridge)

    def make() -> Any:
        made.append(kind())
        return made[-1]

    planner = bridge.NuPlanPlanner(make)
    planner.start(MISSION)
    return planner, made


def test_a_planner_is_told_route_goal_and_map(bridge: Any) -> None:
    _, made = started(bridge)
    told = made[0].told
    assert told.route_roadblock_ids == list(MISSION.route)
    assert (told.mission_goal.x, told.mission_goal.y) == (MISSION.goal.x_m, MISSION.goal.y_m)
    assert told.map_api.map_name == ROADS.name


def test_every_episode_has_a_planner_of_its_own_and_a_route_of_one_block_is_given_twice(bridge: Any) -> None:
    planner, made = started(bridge)
    planner.start(mission(ROADS, ("11",)))
    planner.plan(observed(0))
    assert [len(each.asked) for each in made] == [0, 1]
    assert made[-1].told.route_roadblock_ids == [ROADS["11"].roadblock_id] * 2


def test_the_history_is_a_ring_of_22_samples_that_ends_now(bridge: Any) -> None:
    planner, made = started(bridge)
    for step in range(30):
        planner.plan(observed(step))
        current, states = made[0].asked[-1]
        times = np.array([state.time_us for state in states])
        assert len(states) == len(current.history.observations) == 22
        assert times[-1] == current.iteration.time_us == current.history.current_state[0].time_us
        assert set(np.diff(times)) == {100_000}
        assert current.iteration.index == step
        assert current.history.sample_interval == 0.1
    assert len({id(current.history) for current, _ in made[0].asked}) == 1
    planner.plan(observed(37))  # a jump in time: the history is that of the observation
    assert set(np.diff([state.time_us for state in made[0].asked[-1][1]])) == {100_000}


def test_a_plan_is_that_of_the_box_centre_at_our_times(bridge: Any) -> None:
    planner, _ = started(bridge)
    seen = observed(3)
    plan = planner.plan(seen)
    assert plan.time_s[0] == pytest.approx(seen.time_s)
    assert (plan.x_m[0], plan.y_m[0]) == pytest.approx((seen.ego.x_m, seen.ego.y_m), abs=1e-9)
    assert plan.x_m[-1] == pytest.approx(seen.ego.x_m + 8.0)
    assert gc.isenabled()  # the planner switches it off, for itself only


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [({"requires_scenario": True}, "asks for the scenario"), ({"observation_type": SimpleNamespace}, "tracks only")],
)
def test_what_asks_for_more_than_tracks_is_refused(bridge: Any, changes: dict[str, Any], complaint: str) -> None:
    with pytest.raises(PlannerLoadError, match=complaint):
        bridge.NuPlanPlanner(kind_of(bridge, **changes))


@pytest.mark.parametrize(
    ("module", "name", "options"),
    [
        ("simple_planner", "SimplePlanner", {"horizon_seconds": 10.0, "sampling_time": 0.25, "acceleration": [0, 0]}),
        ("idm_planner", "IDMPlanner", IDM),
    ],
)
def test_planners_of_the_devkit_conform(module: str, name: str, options: dict[str, Any]) -> None:
    scheme = devkit("interplan_sumo.bridge.nuplan.scheme")
    make = scheme.factory(f"nuplan.planning.simulation.planner.{module}:{name}")
    findings = check_planner(make(**options), steps=5)
    assert [finding for finding in findings if finding.severity == "error"] == []


def test_what_stands_in_a_file_is_overruled_by_options(tmp_path: Path) -> None:
    scheme = devkit("interplan_sumo.bridge.nuplan.scheme")
    path = tmp_path / "simple.yaml"
    path.write_text("horizon_seconds: 4.0\nsampling_time: 0.5\nacceleration: [0.0, 0.0]")
    planner = scheme.factory("nuplan.planning.simulation.planner.simple_planner:SimplePlanner")(
        config=str(path), sampling_time=0.25
    )
    planner.start(MISSION)
    plan = planner.plan(observed(0))
    assert plan.time_s[-1] == pytest.approx(4.0)
    assert planner._planner.sampling_time.time_us == 250_000


def driven(planner: Planner, steps: int, job: Mission = MISSION, standing: Actors = PARKED) -> Floats:
    """(steps, 3) where a planner comes to behind a standing car."""
    ego = ego_on(job.roads, "11", 5.0, 8.0)
    planner.start(job)
    egos: list[EgoState] = []
    for _ in range(steps):
        past = Past(tuple(egos[-20:]), (standing,) * len(egos[-20:]))
        egos.append(ego)
        ego = follow(ego, planner.plan(Observation(ego.time_s, ego, standing, signals(), past)), 0.1)
    return np.array([(each.x_m, each.y_m, each.heading_rad) for each in egos])


def test_nuplans_logs_can_hold_a_planner_of_ours(bridge: Any, ours: Any) -> None:
    planner = ours.InterplanSumoPlanner("idm?headway_s=2.0")
    driven(bridge.NuPlanPlanner(lambda: planner), 2)
    again = pickle.loads(pickle.dumps(planner))
    assert again.name() == planner.name() == "interplan-sumo idm?headway_s=2.0"


@pytest.mark.parametrize(("job", "standing"), [(MISSION, PARKED), (SHORT, BEYOND)])
def test_nuplans_idm_planner_and_ours_drive_the_same(bridge: Any, job: Mission, standing: Actors) -> None:
    kind = devkit("nuplan.planning.simulation.planner.idm_planner").IDMPlanner
    here = driven(load_planner("idm"), 60, job, standing)
    there = driven(bridge.NuPlanPlanner(lambda: kind(**IDM)), 60, job, standing)
    np.testing.assert_allclose(there, here, rtol=0, atol=1e-6)


def test_roads_are_found_behind_nuplans_map_and_by_name_in_its_maps_root(
    ours: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    api = devkit("interplan_sumo.bridge.nuplan.map_api")
    assert api.roads_behind(api.map_api(ROADS)) is ROADS
    from interplan_sumo.maps.geopackage_writer import write_map
    from interplan_sumo.maps.store import write_maps_manifest

    write_map(junction(), tmp_path / "my_town" / "1.0" / "map.gpkg")
    write_maps_manifest(tmp_path)
    map_ = SimpleNamespace(map_name="my_town")
    monkeypatch.delenv("NUPLAN_MAPS_ROOT", raising=False)
    with pytest.raises(MapError, match=r"where is map my_town\? Set NUPLAN_MAPS_ROOT"):
        api.roads_behind(map_)
    assert api.roads_behind(map_, tmp_path).lanes.keys() == junction().lanes.keys()
    monkeypatch.setenv("NUPLAN_MAPS_ROOT", str(tmp_path))
    assert api.roads_behind(map_).lanes.keys() == junction().lanes.keys()
    with pytest.raises(UnknownNameError, match=r"no map named 'my_city'. Known: my_town. Looked in"):
        api.roads_behind(SimpleNamespace(map_name="my_city"))
    assert ours.InterplanSumoPlanner("idm").name() == "interplan-sumo idm"
