"""DTPP's labels and losses by hand, and its network."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from interplan_learned.dtpp.inputs import BRANCH_CHANNELS, BRANCHES, SCENE
from interplan_sumo.dataset.reading import Dataset
from interplan_sumo.world.ego import PACIFICA
from tools.train.data import read_samples
from tools.train.recipe import find_recipe

pytestmark = pytest.mark.slow

if TYPE_CHECKING:
    import torch

    from tools.train.models import dtpp

NEEDS_TORCH = {"torch": "torch", "dtpp": "tools.train.models.dtpp"}


@pytest.fixture(scope="module")
def learned(tiny_data: Dataset) -> tuple[dict[str, Any], dtpp.Dtpp]:
    """A batch of six samples, and a network with random weights."""
    from tools.train.loop import batch_of

    recipe = find_recipe("dtpp")
    samples = read_samples(tiny_data, "val", recipe)
    torch.manual_seed(0)
    batch = batch_of(recipe, samples.picked(np.arange(0, 30, 5)))
    return dict(batch), recipe.make_model().eval()  # type: ignore[return-value]


def answers(model: dtpp.Dtpp, batch: dict[str, Any]) -> dtpp.Answers:
    with torch.no_grad():
        scene = model.encoder(*(batch[name] for name in SCENE))
        return model.decoder(*scene, batch["agents"], *(batch[name] for name in BRANCHES))


def branch(x_m: float, y_m: float, yaw: float = 0.0, steps: int = 16) -> Any:
    """(1, 1, 16, 7) a branch that stands somewhere for some steps."""
    table = torch.zeros(1, 1, 16, len(BRANCH_CHANNELS))
    table[0, 0, :steps, :3] = torch.tensor((x_m, y_m, yaw))
    table[0, 0, :steps, -1] = 1.0
    return table


def test_the_expert_is_near_a_branch_of_both_stages(tiny_data: Dataset) -> None:
    recipe = find_recipe("dtpp")
    held = read_samples(tiny_data, "val", recipe).columns
    made, shown = recipe.targets(held), recipe.inputs(held)
    future, rows = held["ego_future"], np.arange(len(held["ego_future"]))
    assert made["teaches"][:, 0].mean() > 0.6
    for stage, (prefix, frame, most_m) in enumerate((("", 29, 1.5), ("second_", 79, 4.0))):
        nearest = shown["branches"] if not stage else made["second_branches"]
        ends = nearest[rows, made["nearest"][:, stage], (frame + 1) // 5 - 1, :2]
        off_m = np.hypot(*(ends - future[:, frame, :2]).T)
        taught = made["teaches"][:, stage]
        assert future[taught, frame, 3].all(), prefix
        assert off_m[taught].max() <= most_m


@pytest.mark.parametrize(("beside_m", "teaches"), [(1.4, True), (1.6, False)])
def test_samples_teach_while_their_best_branch_ends_within_a_metre_and_a_half(
    tiny_data: Dataset, beside_m: float, teaches: bool
) -> None:
    recipe = find_recipe("dtpp")
    held = dict(read_samples(tiny_data, "val", recipe).columns)
    future = np.zeros_like(held["ego_future"])
    later = recipe.inputs(held)["branches"][:, 4, 5]  # where the fifth branch ends after 3 s
    future[:, :30] = np.concatenate((later[:, None, :3], np.ones_like(later[:, None, :1])), axis=-1)
    across = np.stack((-np.sin(later[:, 2]), np.cos(later[:, 2])), axis=-1)
    future[:, :30, :2] += beside_m * across[:, None]
    made = recipe.targets({**held, "ego_future": future})
    assert (made["teaches"] == [teaches, False]).all()  # nobody knows where it is after 8 s
    assert (made["nearest"][:, 0] == 4).mean() > 0.8


def test_an_agent_at_the_egos_middle_costs_ten_and_two_metres_away_less() -> None:
    ahead_m = PACIFICA.rear_axle_to_center_m
    futures = torch.zeros(1, 1, 2, 16, 2)
    futures[..., 0] = 10.0 + ahead_m
    exists = torch.tensor([[1.0, 0.0]])
    there = dtpp.collision_cost(branch(10.0, 0.0), futures, exists)
    assert float(there) == pytest.approx(10.0, rel=1e-5)
    beside = dtpp.collision_cost(branch(10.0, 2.0), futures, exists)
    assert float(beside) == pytest.approx(10.0 * np.exp(-0.8), rel=1e-5)
    turned = dtpp.collision_cost(branch(10.0 + ahead_m, -ahead_m, np.pi / 2), futures, exists)
    assert float(turned) == pytest.approx(10.0, rel=1e-4)
    both = dtpp.collision_cost(branch(10.0, 0.0, steps=6), futures, torch.ones(1, 2))
    assert float(both) == pytest.approx(20.0, rel=1e-5)


def test_a_stage_is_scored_among_valid_branches_and_predicted_on_the_nearest() -> None:
    branches = branch(0.0, 0.0, steps=6).repeat(2, 3, 1, 1)
    futures = torch.zeros(2, 3, 1, 16, 2)
    futures[:, 1, :, :, 0] = 3.0  # smooth L1 of 3 m along x: 2.5, on average with y 1.25
    futures[:, 0] = futures[:, 2] = 99.0
    futures[:, 1, :, 6:] = 99.0  # beyond the stage
    scores = torch.tensor([[0.0, 0.0, 50.0], [0.0, 0.0, 50.0]])
    valid = torch.tensor([[True, True, False]]).repeat(2, 1)
    batch = {"futures": torch.zeros(2, 1, 16, 2), "futures_valid": torch.ones(2, 1, 16, dtype=torch.bool)}
    found = dtpp.stage_loss(
        dtpp.Answers(scores, futures, torch.full((2, 8), 2.0)), branches, valid, torch.tensor([1, 2]),
        torch.tensor([True, False]), batch,
    )  # fmt: skip
    assert float(found) == pytest.approx(1.25 + np.log(2.0) + 0.01 * 4.0, rel=1e-4)


def test_branches_do_not_see_each_other(learned: tuple[dict[str, Any], dtpp.Dtpp]) -> None:
    batch, model = learned
    before = answers(model, batch)
    changed = {name: batch[name].clone() for name in (*SCENE, *BRANCHES)}
    changed["branches"][:, 3, :, :6] += 1.0
    changed["effort"][:, 3] += 0.5
    after = answers(model, changed)
    others = [k for k in range(before.scores.shape[1]) if k != 3]
    torch.testing.assert_close(after.scores[:, others], before.scores[:, others])
    torch.testing.assert_close(after.futures[:, others], before.futures[:, others])
    assert (after.scores[:, 3] != before.scores[:, 3]).all()
    assert (after.futures[:, 3, 0] != before.futures[:, 3, 0]).any()  # the agents answer to the branch


def test_of_two_branches_that_differ_in_effort_alone_the_faster_and_smoother_scores_higher(
    learned: tuple[dict[str, Any], dtpp.Dtpp],
) -> None:
    batch, model = learned
    given = {name: batch[name].clone() for name in (*SCENE, *BRANCHES)}
    given["branches"][:] = given["branches"][:, :1]
    given["effort"][:] = 0.5
    given["effort"][:, 1, 0] = 0.6
    for k in (1, 2, 3):
        given["effort"][:, 1 + k, k] = 0.6
    found = answers(model, given)
    assert found.weights.shape == (6, 8)
    assert float(found.weights.min()) > 0.0
    scores = found.scores
    assert (scores[:, 1] > scores[:, 0]).all()
    assert (scores[:, 2:5] < scores[:, :1]).all()


def test_empty_agents_change_nothing(learned: tuple[dict[str, Any], dtpp.Dtpp]) -> None:
    batch, model = learned
    alone = {**batch, "agents": torch.zeros_like(batch["agents"])}
    scores = answers(model, alone).scores
    with torch.no_grad():
        scene = model.encoder(*(alone[name] for name in SCENE))
        tokens = scene.tokens.clone()
        tokens[:, 1:9] += 3.0  # of agents that do not exist
        found = model.decoder(tokens, scene.empty, alone["agents"], *(alone[name] for name in BRANCHES)).scores
    torch.testing.assert_close(found, scores)
