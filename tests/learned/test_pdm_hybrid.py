"""PDM-Hybrid: its third input and its correction by hand, PDM-Closed's plans from samples, and the drive on SUMO."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tiny_dataset import write_untrained

from interplan_learned.driving import POSES, STEP_S
from interplan_learned.pdm_hybrid.planner import CLOSED_PLAN, PdmHybridPlanner, closed_poses, corrected, inputs
from interplan_learned.pdm_open import planner as pdm_open
from interplan_planners.pdm_closed import PdmClosedPlanner
from interplan_sumo import tiny_worlds
from interplan_sumo.dataset.columns import Columns, picked
from interplan_sumo.dataset.reading import Dataset, read_dataset
from interplan_sumo.dynamics import lqr
from interplan_sumo.dynamics.rear_axle import center_of
from interplan_sumo.errors import InputError
from interplan_sumo.features.frame import EgoFrame
from interplan_sumo.features.view import EgoView
from interplan_sumo.planner import Mission, Observation, Past
from interplan_sumo.scenario.suite import find_suite
from interplan_sumo.simulation import episode
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import PACIFICA, EgoShape, EgoState
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.trajectory import Trajectory
from tests.quick import nightly
from tools.train.closed_plans import FIELDS, closed_plans, observation
from tools.train.recipe import find_recipe

NORTH = EgoFrame(100.0, 50.0, np.pi / 2)
AHEAD_S: Floats = np.round(0.1 * np.arange(81, dtype=np.float64), 6)


def plan_north(speed_mps: float = 4.0, now_s: float = 3.0) -> Trajectory:
    """From the origin of `NORTH` straight ahead, every 0.1 s for 8 s."""
    y_m = NORTH.y_m + speed_mps * AHEAD_S + PACIFICA.rear_axle_to_center_m
    return Trajectory(now_s + AHEAD_S, np.full(81, NORTH.x_m), y_m, np.full(81, np.pi / 2), np.full(81, speed_mps))


def test_the_closed_plan_is_given_as_poses_of_the_rear_axle_in_the_ego_frame_left_positive() -> None:
    poses = closed_poses(plan_north(4.0), NORTH, PACIFICA)
    assert poses.shape == (POSES, 3)
    assert poses.dtype == np.float32
    np.testing.assert_allclose(poses[:, 0], 2.0 * np.arange(1, 17), atol=1e-5)  # 4 m/s: 2 m each, the first one ahead
    np.testing.assert_allclose(poses[:, 1:], 0.0, atol=1e-5)
    straight = plan_north()
    heading = straight.heading_rad.copy()
    heading[-1] = np.pi  # at 8 s it heads west, with its rear axle 3 m west of where it was,
    x_m, y_m = straight.x_m.copy(), straight.y_m.copy()
    x_m[-1], y_m[-1] = center_of(NORTH.x_m - 3.0, NORTH.y_m + 30.0, np.pi, PACIFICA)
    last = closed_poses(Trajectory(straight.time_s, x_m, y_m, heading), NORTH, PACIFICA)[-1]
    np.testing.assert_allclose(last, (30.0, 3.0, np.pi / 2), atol=1e-5)  # 30 m ahead and to the left of the ego


def test_the_other_inputs_are_those_of_pdm_open() -> None:
    arrays = {
        "ego_history": np.ones((1, 21, 10), dtype=np.float32),
        "route_centerline": np.ones((1, 120, 3), dtype=np.float32),
        "route_centerline_valid": np.ones((1, 120), dtype=np.bool_),
        CLOSED_PLAN: np.arange(48.0, dtype=np.float32).reshape(1, POSES, 3),
    }
    found = inputs(arrays, 0.4)
    assert found.keys() == {"ego", "centerline", CLOSED_PLAN}
    np.testing.assert_array_equal(found[CLOSED_PLAN], arrays[CLOSED_PLAN])
    for name, values in pdm_open.inputs(arrays, 0.4).items():
        np.testing.assert_array_equal(found[name], values)


def test_up_to_two_seconds_the_plan_is_pdm_closeds_and_from_two_and_a_half_on_it_is_corrected_whole() -> None:
    plan = plan_north()
    found = corrected(plan, np.tile((2.0, 0.5, 0.0), (POSES, 1)), NORTH, PACIFICA)
    np.testing.assert_array_equal(found.time_s, plan.time_s)
    for name in ("x_m", "y_m", "heading_rad"):
        np.testing.assert_array_equal(getattr(found, name)[:21], getattr(plan, name)[:21])  # bit for bit
    forward, left = found.y_m - plan.y_m, plan.x_m - found.x_m  # the ego heads north
    np.testing.assert_allclose(forward[25:], 2.0, atol=1e-9)
    np.testing.assert_allclose(left[25:], 0.5, atol=1e-9)
    np.testing.assert_allclose(forward[20:26], (0.0, 0.4, 0.8, 1.2, 1.6, 2.0), atol=1e-9)


def test_each_pose_has_its_own_correction_interpolated_between_poses_and_turned_about_the_rear_axle() -> None:
    plan = plan_north()
    found = corrected(plan, np.outer(np.arange(1, POSES + 1), (1.0, 0.0, 0.0)), NORTH, PACIFICA)
    np.testing.assert_allclose((found.y_m - plan.y_m)[25:], 2.0 * AHEAD_S[25:], atol=1e-9)  # n m at n half seconds
    found = corrected(plan_north(), np.tile((0.0, 0.0, np.pi / 2), (POSES, 1)), NORTH, PACIFICA)
    ahead_m = PACIFICA.rear_axle_to_center_m
    assert abs(found.heading_rad[-1]) == pytest.approx(np.pi)  # from north to the left: west
    assert (found.x_m[-1], found.y_m[-1]) == pytest.approx((100.0 - ahead_m, 50.0 + 32.0))


def test_a_correction_of_nothing_gives_the_same_plan_whenever_it_begins() -> None:
    for now_s in (0.0, 0.3, 17.7, 29.9):
        plan = plan_north(now_s=now_s)
        found = corrected(plan, np.zeros((POSES, 3)), NORTH, PACIFICA)
        for name in ("x_m", "y_m", "heading_rad"):
            np.testing.assert_allclose(getattr(found, name), getattr(plan, name), atol=1e-9)


@pytest.fixture(scope="module")
def scene() -> tuple[Mission, Observation]:
    """A red light, and one of everything: a car that drives off, a bus, a pedestrian, a bicycle, a cone."""
    roads = tiny_worlds.junction()
    ego = replace(
        tiny_worlds.ego_on(roads, "1", 30.0, 8.0, time_s=4.0), ax_mps2=-0.5, tire_angle_rad=0.02, yaw_rate_radps=0.05,
        tire_rate_radps=-0.1, yaw_acceleration_radps2=0.3,
    )  # fmt: skip
    before = replace(ego, time_s=3.9, x_m=ego.x_m - 0.8, yaw_rate_radps=0.02)
    kinds = (ActorKind.VEHICLE, ActorKind.VEHICLE, ActorKind.PEDESTRIAN, ActorKind.BICYCLE, ActorKind.TRAFFIC_CONE)
    x_m = ego.x_m + np.array((12.0, 20.0, 25.0, 30.0, 35.0))
    around = Actors(
        tuple("abcde"), np.array(kinds), x_m, ego.y_m + np.array((0.0, 4.0, -5.0, -3.0, 2.0)),
        np.array((0.1, np.pi, -np.pi / 2, 0.0, 0.5)), np.array((4.5, 11.0, 0.5, 1.8, 0.4)),
        np.array((1.8, 2.5, 0.5, 0.6, 0.4)), np.array((5.0, -6.0, 0.0, 3.0, 0.0)), np.array((0.5, 0.0, -1.2, 0.0, 0.0)),
    )  # fmt: skip
    signals = tiny_worlds.signals(red=("13", "12"), green=("21",), yellow=("34",))
    return tiny_worlds.mission(roads, ["1", "13", "7"]), Observation(4.0, ego, around, signals, Past((before,), ()))


def sample(mission: Mission, observation: Observation) -> Columns:
    arrays = EgoView(mission).arrays(observation)
    return {
        **{name: values[None] for name, values in arrays.items()},
        "tick": np.array([round(observation.time_s / 0.1)]),
    }


def test_a_sample_gives_back_what_the_planner_saw(scene: tuple[Mission, Observation]) -> None:
    mission, seen = scene
    found = observation(sample(mission, seen), 0)
    for name in EgoState.__slots__:
        assert getattr(found.ego, name) == pytest.approx(getattr(seen.ego, name), abs=1e-5), name
    assert found.time_s == pytest.approx(4.0)
    for name in ("x_m", "y_m", "length_m", "width_m", "vx_mps", "vy_mps"):
        np.testing.assert_allclose(getattr(found.actors, name), getattr(seen.actors, name), atol=1e-5, err_msg=name)
    np.testing.assert_array_equal(found.actors.kind, seen.actors.kind)
    np.testing.assert_allclose(np.cos(found.actors.heading_rad - seen.actors.heading_rad), 1.0)
    assert found.signals.connector_ids == seen.signals.connector_ids
    np.testing.assert_array_equal(found.signals.status, seen.signals.status)


def test_pdm_closed_plans_the_same_in_a_sample_as_on_the_road(scene: tuple[Mission, Observation]) -> None:
    mission, seen = scene
    plans: list[np.ndarray] = []
    for each in (seen, observation(sample(mission, seen), 0)):
        planner = PdmClosedPlanner()
        planner.start(mission)
        plans.append(closed_poses(planner.plan(each), EgoFrame.of(each.ego), mission.shape))
    np.testing.assert_allclose(plans[1], plans[0], atol=1e-3)
    stop_m = 60.0 - 30.0 + mission.shape.rear_axle_to_center_m  # the lane's end, 60 m from its start
    assert stop_m - 3.0 < plans[1][-1, 0] + mission.shape.front_m < stop_m  # it stops at the red light


def test_every_sample_of_a_data_set_gets_a_plan_on_its_own_map(tiny_data: Dataset) -> None:
    columns = tiny_data.split("val").shard(0, (*FIELDS, "ego_future"))
    plans = closed_plans(columns, tiny_data)
    assert plans.shape == (39, POSES, 3)
    assert np.isfinite(plans).all()
    alone = closed_plans(picked(columns, np.array([20])), tiny_data)
    np.testing.assert_array_equal(alone[0], plans[20])  # whatever else is in the data
    off_m = np.abs(plans[:, :4, 1] - columns["ego_future"][:, 4:20:5, 1])
    assert off_m.max() < 1.5  # the expert and PDM-Closed are in the same lane, on bends to both sides


@pytest.mark.parametrize(("spoil", "message"), [
    (shutil.rmtree, r"was made on the map 'gentle', which is none of the shipped ones; put its folder, .* into"),
    (
        lambda folder: (folder / "1.0" / "map.gpkg").write_bytes(b"another"),
        r"is not the map that .* was made on; export the data again",
    ),
])  # fmt: skip
def test_a_map_that_is_missing_or_another_one_is_one_clear_line(
    tiny_folder: Path, tmp_path: Path, spoil: Callable[[Path], object], message: str
) -> None:
    shutil.copytree(tiny_folder, tmp_path / "data")
    spoil(tmp_path / "data" / "maps" / "gentle")
    data = read_dataset(tmp_path / "data")
    columns = data.split("val").shard(0, FIELDS)
    with pytest.raises(InputError, match=message) as error:
        closed_plans(columns, data)
    assert "\n" not in str(error.value)


def test_the_loss_corrects_all_of_the_plan_and_the_held_out_error_only_what_is_driven() -> None:
    torch = pytest.importorskip("torch", reason="needs torch: pip install 'interplan-sumo[train]'")
    from tools.train.models.pdm_offset import loss, poses

    class OneMetreAhead(torch.nn.Module):
        def forward(self, *_seen: object) -> object:
            return torch.tensor((1.0, 0.0, 0.0)).expand(1, POSES, 3)

    batch = {
        "ego": torch.zeros(1, 99), "centerline": torch.zeros(1, 360), CLOSED_PLAN: torch.zeros(1, POSES, 3),
        "wanted": torch.zeros(1, POSES, 3), "wanted_valid": torch.ones(1, POSES, dtype=torch.bool),
    }  # fmt: skip
    assert float(loss(OneMetreAhead(), batch, 0.0)) == pytest.approx(1.0 / 3.0)  # x, y and yaw count alike
    found = poses(OneMetreAhead(), batch)[0].numpy()
    late = STEP_S * np.arange(1, POSES + 1) > 2.0
    np.testing.assert_array_equal(found[:, 0], late.astype(np.float32))
    assert not found[:, 1:].any()


@pytest.fixture(scope="module")
def untrained(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The card of a network that knows nothing: its corrections are of some metres, and noise."""
    torch = pytest.importorskip("torch", reason="needs torch: pip install 'interplan-sumo[train]'")
    torch.manual_seed(0)
    made = find_recipe("pdm_offset")
    batch = {"ego": torch.ones(2, 99), "centerline": torch.ones(2, 360), CLOSED_PLAN: torch.ones(2, POSES, 3)}
    return str(write_untrained(made, made.make_model(), batch, tmp_path_factory.mktemp("untrained")))


def test_its_plan_is_pdm_closeds_plus_what_its_network_says(untrained: str) -> None:
    roads = tiny_worlds.straight_road(limit_mps=12.0)
    mission = tiny_worlds.mission(roads, list(roads.lanes))
    seen = tiny_worlds.observation(tiny_worlds.ego_on(roads, "11", 20.0, 8.0), tiny_worlds.cars((90.0, 0.0, 3.0)))
    hybrid, closed = PdmHybridPlanner(untrained), PdmClosedPlanner()
    plans: list[Trajectory] = []
    for planner in (hybrid, closed):
        planner.start(mission)
        plans.append(planner.plan(seen))
    one, other = plans
    for name in ("time_s", "x_m", "y_m", "heading_rad"):
        np.testing.assert_array_equal(getattr(one, name)[:21], getattr(other, name)[:21])
    assert np.hypot(one.x_m - other.x_m, one.y_m - other.y_m)[25:].max() > 0.1
    assert one.time_s[-1] == pytest.approx(seen.time_s + 8.0)
    assert hybrid.report()["network"]["options"] == {"history_s": 2.0, "past_dropped": 0.0}


def to_where_the_plan_says(state: EgoState, plan: Trajectory, dt_s: float, _shape: EgoShape) -> EgoState:
    """A tracker that reads the next step only, and makes no error."""
    there = plan.at(round(state.time_s + dt_s, 6))
    speed_mps = float(np.hypot(there.x_m - state.x_m, there.y_m - state.y_m)) / dt_s
    return EgoState(round(state.time_s + dt_s, 6), there.x_m, there.y_m, there.heading_rad, speed_mps)


@pytest.mark.parametrize(("follow", "scenario_id", "nearer_than_m"), [
    (to_where_the_plan_says, "lane_change_mtd/0", 0.0), nightly((lqr.follow, "nudge/0", 0.05)),
], ids=["perfect", "lqr"])  # fmt: skip
def test_the_drive_is_pdm_closeds(
    untrained: str, follow: Callable[..., EgoState], scenario_id: str, nearer_than_m: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """Hash for hash where the tracker reads the next step only; nuPlan's smooths the whole plan, and feels the rest."""
    monkeypatch.setattr(episode, "follow", follow)
    (found,) = (each for each in find_suite("smoke==1").scenarios if each.id == scenario_id)
    hybrid, closed = (
        episode.drive(replace(found, duration_s=6.0), planner).trace
        for planner in (PdmHybridPlanner(untrained), PdmClosedPlanner())
    )
    assert hybrid is not None
    assert closed is not None
    assert hybrid.hash() != closed.hash()  # their plans differ,
    off_m = np.hypot(hybrid.ego.x_m - closed.ego.x_m, hybrid.ego.y_m - closed.ego.y_m).max()
    assert off_m <= nearer_than_m
    if follow is to_where_the_plan_says:
        assert replace(hybrid, plans=closed.plans).hash() == closed.hash()  # and nothing else does
