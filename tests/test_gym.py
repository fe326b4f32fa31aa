"""The gymnasium environments: what users of gymnasium expect, and the scores of `run`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from worlds import straight_road

import interplan_sumo as ips
from interplan_sumo.errors import UnknownNameError
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.policy import POSE_SPACING_S, POSES, ActionForm, Senses, plan_of
from interplan_sumo.scenario.files import write_scenarios
from interplan_sumo.scenario.scenario import LanePosition, TrafficDemand
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.signals import Signals

gymnasium = pytest.importorskip("gymnasium")

from gymnasium.utils.env_checker import check_env  # noqa: E402

from interplan_sumo.gym import FAILED, GOAL_REACHED, ScenarioEnv  # noqa: E402

SCENE = "nudge/0"


def made(**arguments: Any) -> ScenarioEnv:
    given: dict[str, Any] = {"suite": "smoke==1", "scenarios": SCENE, **arguments}
    return ScenarioEnv(**given)


def creeping(_: object) -> np.ndarray:
    """Brake a little, straight on."""
    return np.array([-0.02, 0.0], dtype=np.float32)


def hurrying(_: object) -> Any:
    """Plain numbers, of which the first is not the same in float32."""
    return [0.6, 0.0]


def straight_on(seen: Any) -> np.ndarray:
    """As a trajectory, at the present speed."""
    ahead_m = float(seen["ego"][0, 0]) * POSE_SPACING_S * np.arange(1, POSES + 1)
    return np.stack((ahead_m, 0.0 * ahead_m, 0.0 * ahead_m), axis=1).astype(np.float32)


def driven(env: ScenarioEnv, policy: Callable[[Any], Any], **options: Any) -> tuple[list[float], dict[str, Any]]:
    """Rewards and last info of an episode; looks at every observation on the way."""
    seen, told = env.reset(seed=0, options=options)
    rewards: list[float] = []
    over = False
    while not over:
        assert env.observation_space.contains(seen)  # type: ignore[arg-type]
        seen, reward, terminated, truncated, told = env.step(policy(seen))
        rewards.append(reward)
        over = terminated or truncated
    return rewards, told


# --- what gymnasium asks for ---------------------------------------------------------------------


@pytest.mark.slow
def test_gymnasiums_own_checks_find_nothing() -> None:
    check_env(gymnasium.make("interplan_sumo/Smoke-v0", scenarios=SCENE).unwrapped)


def test_there_is_an_id_for_everything_each_suite_and_each_family() -> None:
    ids = {name for name in gymnasium.registry if name.startswith("interplan_sumo/")}
    assert len(ids) == 1 + 6 + 8
    sizes = {}
    for name in ("Scenario", "Smoke", "Common", "InterplanLarge", "InterplanHard", "Llm", "LaneChangeHtd"):
        env = gymnasium.make(f"interplan_sumo/{name}-v0")
        sizes[name] = len(env.unwrapped.scenarios)  # type: ignore[attr-defined]
    assert sizes == {
        "Scenario": 80, "Smoke": 8, "Common": 140, "InterplanLarge": 320, "InterplanHard": 100, "Llm": 24,
        "LaneChangeHtd": 10,
    }  # fmt: skip


def test_equal_seeds_begin_and_go_on_equally_and_others_draw_other_scenes() -> None:
    env = made(scenarios=(), seeds=3)
    first, told = env.reset(seed=5)
    step = env.step(hurrying(first))
    again, told_again = env.reset(seed=5)
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(step[0], env.step(hurrying(again))[0])
    assert told == told_again
    assert len({(t["scenario"], t["traffic_seed"]) for t in (env.reset(seed=k)[1] for k in range(4))}) > 1
    env.close()


def test_options_name_the_scene_and_the_seed_of_its_traffic() -> None:
    env = made(scenarios=("nudge/*", "jaywalker/*"))
    for scene in ("nudge/0", "jaywalker/0"):
        _, told = env.reset(options={"scenario": scene, "seed": 7})
        assert (told["scenario"], told["traffic_seed"]) == (scene, 7)
    with pytest.raises(UnknownNameError, match="Did you mean 'nudge/0'"):
        env.reset(options={"scenario": "nuge/0"})
    with pytest.raises(UnknownNameError, match=r"option of reset\(\)"):
        env.reset(options={"scene": "nudge/0"})
    env.close()


@pytest.mark.slow
def test_environments_in_processes_of_their_own_go_side_by_side() -> None:
    envs = gymnasium.make_vec(
        "interplan_sumo/Smoke-v0", 2, "async", vector_kwargs={"context": "spawn"}, scenarios=SCENE
    )
    seen, _ = envs.reset(seed=[0, 0])
    np.testing.assert_array_equal(seen[0], seen[1])
    actions = np.array([[0.5, 0.0], [-1.0, 0.0]], dtype=np.float32)
    for _ in range(3):
        envs.step(actions)
    _, reward, *_ = envs.step(actions)
    assert reward[0] > reward[1]
    envs.close()


def test_the_environment_that_was_reset_last_has_the_traffic() -> None:
    first, second = made(), made()
    seen, _ = first.reset(seed=0)
    second.reset(seed=0)
    with pytest.raises(ips.InputError, match=r"another environment.*AsyncVectorEnv"):
        first.step(creeping(seen))
    second.step(creeping(seen))
    first.close()  # has nothing that it could take from the other
    second.step(creeping(seen))
    first.reset(seed=0)
    first.step(creeping(seen))
    made().reset(seed=0)  # one that is forgotten is in nobody's way
    first.reset(seed=0)
    first.close()
    first.close()


def test_there_is_no_step_before_the_first_reset_nor_after_the_end_nor_of_another_shape() -> None:
    env = made()
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(creeping(None))
    env.reset(seed=0)
    with pytest.raises(ips.InputError, match=r"shape \(3,\), acceleration_steering has \(2,\)"):
        env.step(np.zeros(3, dtype=np.float32))
    driven(env, hurrying)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(creeping(None))


def test_a_picture_is_an_array_of_pixels_that_changes_as_the_ego_moves() -> None:
    pytest.importorskip("matplotlib")
    env = made(render_mode="rgb_array")
    seen, _ = env.reset(seed=0)
    before = env.render()
    env.step(hurrying(seen))
    after = env.render()
    assert before is not None
    assert after is not None
    assert (before.shape, before.dtype) == ((500, 800, 3), np.uint8)
    assert (before != after).any()
    env.close()
    assert made().render() is None


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"observation": "pixels"}, "observation named 'pixels'"),
        ({"action": "steering"}, "action named 'steering'.*acceleration_steering"),
        ({"profile": "nuplam"}, "Did you mean 'nuplan'"),
        ({"render_mode": "human"}, "render mode named 'human'"),
        ({"scenarios": "nuge/0"}, "scenario named 'nuge/0'"),
        ({"suite": "smoke"}, "suite named 'smoke'"),
        ({"seeds": 0}, "seeds is 0"),
        ({"density": "huge"}, "density named 'huge'"),
    ],
)
def test_what_cannot_be_used_is_told_before_the_first_episode(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ips.InputError, match=message):
        made(**arguments)


# --- the same drive as in a run ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("policy", "observation", "action"),
    [
        (hurrying, "vector", "acceleration_steering"),
        (straight_on, "dict", "trajectory"),
    ],
)
def test_a_policy_gets_the_score_and_the_trace_that_run_gives_it(
    policy: Callable[[Any], Any], observation: Any, action: ActionForm
) -> None:
    env = made(observation=observation, action=action, stop_at_failure=False)
    _, told = driven(env, policy)
    planner = ips.PolicyPlanner(policy, observation=observation, action=action)
    (row,) = ips.run(planner, "smoke==1", scenarios=SCENE, workers=0).to_dict("records")
    assert told["trace_hash"] == row["trace_hash"]
    assert told["score"] == row["score"]
    assert told["reached_goal"] == row["reached_goal"]
    assert {name: row[name] for name in told["metrics"]} == told["metrics"]
    assert told["fault"] is None


def test_a_scene_of_ones_own_is_measured_against_the_same_drive(tmp_path: Path) -> None:
    scene = replace(ips.load_scenario(SCENE), id="mine/0", duration_s=3.0, traffic=TrafficDemand())
    write_scenarios((scene,), tmp_path / "mine.yaml")
    rewards, told = driven(ScenarioEnv(scenarios=str(tmp_path / "mine.yaml")), creeping)
    (row,) = ips.run(ips.PolicyPlanner(creeping), scenarios=scene, workers=0).to_dict("records")
    assert (told["trace_hash"], told["score"]) == (row["trace_hash"], row["score"])
    assert len(rewards) == 30


def test_changed_traffic_is_other_traffic() -> None:
    vectors = [made(scenarios="lane_change_mtd/0", **each).reset(seed=0)[0] for each in ({}, {"density": "high"})]
    assert not np.array_equal(vectors[0], vectors[1])  # type: ignore[arg-type]


# --- how an episode ends, and what it pays -------------------------------------------------------


def test_leaving_the_road_or_a_collision_at_fault_ends_the_episode_and_costs() -> None:
    rewards, told = driven(made(), lambda _: np.array([0.0, -0.3], dtype=np.float32))
    assert rewards[-1] < FAILED + 2.0
    assert told["metrics"]["drivable_area"] == 0.0
    rewards, told = driven(made(), hurrying)
    assert rewards[-1] < FAILED + 2.0
    assert told["score"] == 0.0
    assert "drove into" in told["reasons"]["no_collision"]
    longer, _ = driven(made(stop_at_failure=False), hurrying)
    assert len(longer) > len(rewards)


def test_the_goal_ends_the_episode_and_pays_and_progress_sums_up() -> None:
    scene = replace(ips.load_scenario(SCENE), id="mine/0", obstacles=(), traffic=TrafficDemand())
    env = made()
    env.scenarios = {SCENE: replace(scene, id=SCENE)}
    rewards, told = driven(env, lambda _: np.zeros(2, dtype=np.float32))
    assert told["reached_goal"]
    assert rewards[-1] > GOAL_REACHED
    limit_mps = float(env.reset()[0][7])  # type: ignore[index]
    assert limit_mps > env.scenario.start_speed_mps
    start_m = env.reset()[1]["progress_m"]
    assert sum(rewards) - GOAL_REACHED == pytest.approx(0.1 * (told["progress_m"] - start_m), abs=1e-6)
    env.close()


def test_an_action_that_cannot_be_followed_ends_the_episode_with_a_score_of_zero() -> None:
    for action, bad, message in (
        ("acceleration_steering", np.array([np.nan, 0.0]), "not finite"),
        ("trajectory", np.full((POSES, 3), 240.0), "jumps"),
    ):
        env = made(action=action)
        env.reset(seed=0)
        _, reward, terminated, _, told = env.step(bad.astype(np.float32))
        assert (reward, terminated, told["score"]) == (FAILED, True, 0.0)
        assert message in told["fault"]


# --- actions and observations --------------------------------------------------------------------


def test_full_brakes_stop_the_car_and_never_back_it() -> None:
    ego = EgoState(0.0, 10.0, 0.0, 0.0, vx_mps=8.0)
    plan = plan_of([-1.0, 0.0], ego, "acceleration_steering", PACIFICA)
    assert plan.x_m[-1] - 10.0 == pytest.approx(8.0**2 / (2 * 8.0), abs=0.05)
    assert (np.diff(plan.x_m) >= 0.0).all()


def test_the_wheels_turned_left_lead_on_a_circle_to_the_left() -> None:
    ego = EgoState(0.0, 0.0, 0.0, 0.0, vx_mps=5.0)
    plan = plan_of([0.0, 1.0], ego, "acceleration_steering", PACIFICA)
    radius_m = PACIFICA.wheelbase_m / np.tan(0.5)
    assert plan.heading_rad[-1] == pytest.approx(2.0 * 5.0 / radius_m, abs=1e-9)
    rear_y = plan.y_m - PACIFICA.rear_axle_to_center_m * np.sin(plan.heading_rad)
    assert rear_y[-1] == pytest.approx(radius_m * (1.0 - np.cos(plan.heading_rad[-1])), abs=1e-9)


def test_a_trajectory_is_in_the_frame_of_the_ego() -> None:
    ego = EgoState(3.0, 100.0, 50.0, np.pi / 2, vx_mps=5.0)
    action = np.stack((np.arange(1, 9) * 2.5, np.ones(8), np.zeros(8)), axis=1)
    plan = plan_of(action, ego, "trajectory", PACIFICA)
    assert (plan.x_m[0], plan.y_m[0], plan.time_s[0]) == (100.0, 50.0, 3.0)
    assert (plan.x_m[1], plan.y_m[1], plan.time_s[1]) == pytest.approx((99.0, 52.5, 3.5))
    assert plan.time_s[-1] == pytest.approx(7.0)


def test_a_crowd_is_cut_to_the_nearest() -> None:
    roads = straight_road(lanes=2, length_m=400.0)
    goal = LanePosition("11", 390.0).pose(roads)
    count, ego = 30, EgoState(0.0, 20.0, 0.0, 0.0)
    crowd = Actors(
        tuple(f"{k:02}" for k in range(count)), np.zeros(count, dtype=np.int8),
        20.0 + 3.0 * np.arange(count, 0.0, -1.0), np.zeros(count), *np.zeros((5, count)),
    )  # fmt: skip
    seen = Observation(0.0, ego, crowd, Signals.none())
    parts = Senses(Mission(roads, ("1",), goal), seen).parts(seen)
    np.testing.assert_allclose(parts["actors"][:, 0], 3.0 * np.arange(1, 25))
    np.testing.assert_allclose(parts["route"][:, 0], 5.0 * np.arange(1, 17), atol=1e-4)
    assert parts["ego"][0, 6] == pytest.approx(370.0)
    assert parts["light"].tolist() == [[100.0, 0.0]]
