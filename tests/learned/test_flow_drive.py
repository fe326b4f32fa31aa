"""FlowDrive: plans as what the flow sees and back, the steps that carry noise to an end, what the network looks at."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tiny_dataset import write_untrained

from interplan_learned.driving import POSES
from interplan_learned.flow_drive.planner import CENTRE, CHANNELS, SPREAD, FlowDrivePlanner, carried, poses, told
from interplan_sumo import tiny_worlds
from interplan_sumo.dataset.reading import Dataset
from interplan_sumo.errors import InputError
from tools.train.data import read_samples
from tools.train.recipe import Recipe, find_recipe

if TYPE_CHECKING:
    import torch

    from tools.train import loop
    from tools.train.models import flow_drive as made

NEEDS_TORCH = {"torch": "torch", "made": "tools.train.models.flow_drive", "loop": "tools.train.loop"}
SHAPE = (2, 3, POSES, len(CHANNELS))


@given(x_m=st.floats(-50, 150), y_m=st.floats(-60, 60), yaw_rad=st.floats(-3.1, 3.1))
def test_poses_told_to_the_flow_come_back(x_m: float, y_m: float, yaw_rad: float) -> None:
    wanted = np.tile((x_m, y_m, yaw_rad), (1, POSES, 1))
    np.testing.assert_allclose(poses(told(wanted)), wanted, atol=1e-3)


def test_straight_on_at_six_metres_a_second_is_the_middle_of_all_plans() -> None:
    ahead_s = 0.5 * np.arange(1, POSES + 1)
    straight = np.stack((6.0 * ahead_s, 0.0 * ahead_s, 0.0 * ahead_s), axis=-1)
    np.testing.assert_allclose(told(straight), 0.0, atol=1e-6)
    assert CENTRE.shape == SPREAD.shape == (POSES, len(CHANNELS))


@given(seed=st.integers(0, 1000), steps=st.integers(1, 8))
def test_a_flow_that_knows_its_end_gets_there_from_any_noise_along_a_straight_line(seed: int, steps: int) -> None:
    rng = np.random.default_rng(seed)
    noise, end = rng.standard_normal(SHAPE), rng.standard_normal(SHAPE)
    asked: list[tuple[float, Any]] = []

    def ends(plans: np.ndarray, time: np.ndarray) -> np.ndarray:
        assert time.shape == (2, 3, 1)
        asked.append((float(time[0, 0, 0]), plans))
        return end

    np.testing.assert_allclose(carried(noise, ends, steps), end, atol=1e-5)
    assert [time for time, _ in asked] == pytest.approx([step / steps for step in range(steps)])
    for time, plans in asked:
        np.testing.assert_allclose(plans, (1.0 - time) * noise + time * end, atol=1e-5)


@pytest.mark.parametrize(("options", "message"), [
    ({"steps": 0}, "steps is 0, expected 1 to 100"),
    ({"steps": 101}, "steps is 101, expected 1 to 100"),
    ({"temperature": -0.1}, "temperature is -0.1, expected 0 to 2"),
    ({"temperature": 2.5}, "temperature is 2.5, expected 0 to 2"),
])  # fmt: skip
def test_what_no_flow_can_be_asked_for_is_said(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        FlowDrivePlanner(**options)


def test_it_has_one_size() -> None:
    with pytest.raises(InputError, match="flow_drive has no published network"):
        find_recipe("flow_drive", "published")


@pytest.fixture(scope="module")
def recipe() -> Recipe:
    return find_recipe("flow_drive")


@pytest.fixture(scope="module")
def batch(recipe: Recipe, tiny_data: Dataset) -> Any:
    held = read_samples(tiny_data, "val", recipe)
    return loop.batch_of(recipe, held.picked(np.arange(4)))


@pytest.fixture(scope="module")
def model(recipe: Recipe) -> made.FlowDrive:
    """With random weights, also where a block begins with none."""
    torch.manual_seed(0)
    model = recipe.make_model().eval()
    for weights in model.parameters():
        if weights.dim() > 1:
            torch.nn.init.normal_(weights, std=0.1)
    return model  # type: ignore[return-value]


def ends(model: made.FlowDrive, batch: Any, plans: Any, time: float = 0.5) -> Any:
    with torch.no_grad():
        tokens, empty = model.conditions(*(batch[name] for name in made.SEEN))
        return model.flow(tokens, empty, plans, torch.full((*plans.shape[:2], 1), time))


@pytest.mark.slow
def test_plans_of_one_scene_do_not_see_one_another(model: made.FlowDrive, batch: Any) -> None:
    plans = torch.randn(4, 3, POSES, len(CHANNELS), generator=torch.Generator().manual_seed(0))
    together = ends(model, batch, plans)
    torch.testing.assert_close(ends(model, batch, plans[:, 1:2])[:, 0], together[:, 1], rtol=1e-4, atol=1e-4)
    other = plans.clone()
    other[:, 0] += 1.0
    changed = ends(model, batch, other)
    torch.testing.assert_close(changed[:, 1:], together[:, 1:])
    assert not torch.allclose(changed[:, 0], together[:, 0], atol=1e-2)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ego", "agents", "lanes", "route_lanes"])
def test_what_it_sees_moves_where_the_flow_ends(model: made.FlowDrive, batch: Any, name: str) -> None:
    plans = torch.zeros(4, 1, POSES, len(CHANNELS))
    moved = {**batch, name: torch.where(batch[name] != 0.0, batch[name] + 5.0, batch[name])}
    assert not torch.allclose(ends(model, moved, plans), ends(model, batch, plans), atol=1e-3)
    assert not torch.allclose(ends(model, batch, plans, 0.0), ends(model, batch, plans, 0.9), atol=1e-3)


@pytest.mark.slow
def test_poses_after_the_end_of_a_drive_ask_for_nothing(model: made.FlowDrive, batch: Any) -> None:
    ended = {**batch, "wanted_valid": batch["wanted_valid"].clone()}
    ended["wanted_valid"][:, 8:] = False
    far = {**ended, "wanted": ended["wanted"].clone()}
    far["wanted"][:, 8:] = 100.0
    losses = []
    for each in (ended, far):
        torch.manual_seed(1)
        losses.append(float(made.loss(model, each, 0.0).detach()))
    assert losses[0] == losses[1]


@pytest.mark.nightly
def test_it_learns_where_a_few_drives_went(recipe: Recipe, tiny_data: Dataset, tmp_path: Path) -> None:
    quick = replace(recipe, settings=replace(recipe.settings, epochs=8, batch=32, learning_rate=3e-3))
    train, held = (read_samples(tiny_data, split, recipe) for split in ("train", "val"))
    done = loop.train(quick, train, held, checkpoint=loop.Checkpoint(tmp_path / "checkpoint.pt"))
    error_m = loop.held_out_errors(recipe, done.model, held)["ade"]
    assert error_m < loop.constant_velocity_errors(held)["ade"]


@pytest.mark.slow
def test_it_drives_with_any_weights_the_same_way_each_time(
    recipe: Recipe, model: made.FlowDrive, batch: Any, tmp_path: Path
) -> None:
    weights = str(write_untrained(recipe, model, batch, tmp_path))
    roads = tiny_worlds.straight_road()
    (lane,) = roads.lanes
    ego = tiny_worlds.ego_on(roads, lane, 20.0, 8.0)

    def driven(**options: Any) -> Any:
        planner = FlowDrivePlanner(weights=weights, **options)
        planner.start(tiny_worlds.mission(roads, [lane]))
        return planner.plan(tiny_worlds.observation(ego))

    plan, again, other = driven(), driven(), driven(seed=1)
    assert (plan.x_m[0], plan.y_m[0]) == pytest.approx((ego.x_m, ego.y_m))
    assert plan.time_s[-1] == pytest.approx(ego.time_s + 8.0)
    np.testing.assert_array_equal(plan.x_m, again.x_m)
    assert not np.array_equal(plan.x_m, other.x_m)
    np.testing.assert_array_equal(driven(temperature=0.0).x_m, driven(temperature=0.0, seed=1).x_m)
