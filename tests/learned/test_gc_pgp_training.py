"""GC-PGP's labels and losses by hand, its network, and that it drives."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tiny_dataset import write_untrained

from interplan_learned.gc_pgp.inputs import POLICY_INPUTS
from interplan_learned.gc_pgp.local_graph import NONE
from interplan_learned.gc_pgp.plans import plans
from interplan_learned.gc_pgp.sizes import EDGES, LATENTS, PATH_NODES, SIZES
from interplan_learned.network import load_network
from interplan_sumo.dataset.reading import Dataset
from tools.train.data import read_samples
from tools.train.recipe import Recipe, find_recipe

pytestmark = pytest.mark.slow

if TYPE_CHECKING:
    import torch

    from tools.train.models import gc_pgp

NEEDS_TORCH = {"torch": "torch", "gc_pgp": "tools.train.models.gc_pgp"}
COMPACT = SIZES["compact"]
# rows 0, 1, 2 are nodes 40, 41, 50 of the map; 41 follows 40, 50 lies beside 41
ROWS = np.array([40, 41, 50, NONE])
EDGE_TABLE = np.full((4, EDGES), NONE)
EDGE_TABLE[0, 0], EDGE_TABLE[1, 3], EDGE_TABLE[2, 0] = 1, 2, 1


def way(*nodes: int, whole: bool = True) -> tuple[list[int], dict[int, int]]:
    """The expert's path, and the edge taken by row, from nodes under it."""
    path, edge = gc_pgp.expert_way(np.array(nodes), ROWS, EDGE_TABLE, whole)
    assert path.shape == (PATH_NODES,)
    return path[path != NONE].tolist(), {row: int(edge[row]) for row in np.flatnonzero(edge != NONE).tolist()}


def batch_and_model(data: Dataset) -> tuple[Recipe, dict, gc_pgp.GcPgp]:
    from tools.train.loop import batch_of

    recipe = find_recipe("gc_pgp")
    samples = read_samples(data, "val", recipe)
    torch.manual_seed(0)
    return recipe, dict(batch_of(recipe, samples.picked(np.arange(6)))), recipe.make_model().eval()  # type: ignore[return-value]


def test_the_label_is_the_way_the_expert_takes_while_it_is_known_connected_and_not_too_long() -> None:
    assert way(40, 40, 41, 50, 50) == ([0, 1, 2], {0: 0, 1: 3, 2: EDGES})
    assert way(40, 40) == ([0], {0: EDGES})
    assert way(40, 41, whole=False) == ([0, 1], {0: 0})
    assert way(40, 50, 50) == ([0], {})  # no edge
    assert way(40, 41, 77, 78) == ([0, 1], {0: 0})  # out of the window
    assert way(40, -1, 41, -1) == ([0, 1], {0: 0, 1: EDGES})  # between nodes for a moment
    assert way(77, 40) == ([], {})
    assert way(-1, -1) == ([], {})
    path, edges = way(40, *(41, 50) * 20)
    assert path == [0, *(1, 2) * 7, 1]
    assert edges == {0: 0, 1: 3, 2: 0}


def test_labels_lead_along_the_road_that_was_driven(tiny_data: Dataset) -> None:
    held = read_samples(tiny_data, "train", find_recipe("gc_pgp")).columns
    paths = held["expert_path"]
    assert (paths[:, 0] != NONE).all()
    for row in range(0, len(paths), 20):
        path = paths[row][paths[row] != NONE]
        points = held["node_poses"][row, path].reshape(-1, 3)
        future = held["ego_future"][row]
        for at in future[future[:, 3] > 0.5][::10]:
            assert np.hypot(*(points[:, :2] - at[:2]).T).min() < 2.0
        assert (np.diff(points[:, 0]) > -1.0).all()  # always on


def test_the_likelihood_is_that_of_the_edges_taken() -> None:
    edges = torch.full((1, 2, EDGES), NONE)
    edges[0, 0, :2] = 1
    scores = torch.zeros(1, 2, EDGES + 1)
    scores[0, 0, 1] = float(np.log(2.0))
    batch = {"edges": edges, "expert_edge": torch.tensor([[1, EDGES]])}
    # of two edges and the end: 2 / 4; where there is nothing but the end: 1
    assert float(gc_pgp._edge_loss(scores, batch)) == pytest.approx(np.log(2.0) / 2.0)


def test_the_error_is_that_of_the_best_mode_over_the_time_there_is() -> None:
    found = torch.zeros(1, 4, 16, 2)
    found[0, 2:, :, 1] = torch.tensor([[9.0], [11.0]])  # a mode of 10 m beside, of two
    wanted, valid = torch.zeros(1, 16, 2), torch.ones(1, 16, dtype=torch.bool)
    wanted[0, :, 1] = 7.0
    wanted[0, 8:], valid[0, 8:] = 99.0, False
    batch = {"wanted": wanted, "wanted_valid": valid}
    assert float(gc_pgp._least_error(found, batch, 2)) == pytest.approx(3.0, abs=1e-4)


def test_first_the_experts_traversals_are_decoded_then_sampled_ones(tiny_data: Dataset) -> None:
    recipe, batch, model = batch_and_model(tiny_data)
    given: list[tuple[int, ...]] = []
    model.decoder.register_forward_pre_hook(lambda _module, arguments: given.append(arguments[2].shape))
    for done in (0.2, 0.3):
        recipe.loss(model, batch, done)
    assert given == [(6, 1, PATH_NODES), (6, COMPACT.train_traversals, PATH_NODES)]


def test_a_trajectory_depends_on_its_own_traversal_its_order_and_noise_alone(tiny_data: Dataset) -> None:
    _, batch, model = batch_and_model(tiny_data)
    with torch.no_grad():
        _, ego, nodes = model.policy(*(batch[name] for name in POLICY_INPUTS))
        paths = batch["expert_path"][:, None].repeat(1, 3, 1)
        paths[:, 1, 1:] = NONE
        noise = torch.zeros(6, 3, LATENTS)
        noise[:, 2] = 1.0
        found = model.decoder(ego, nodes, paths, noise)
        alone = model.decoder(ego, nodes, paths[:, :1], noise[:, :1])
        empty = model.decoder(ego, nodes, torch.full_like(paths, NONE), noise)
        paths = torch.tensor([[0, 1, 2], [2, 1, 0]]).expand(6, -1, -1)
        paths = torch.nn.functional.pad(paths, (0, PATH_NODES - 3), value=NONE)
        turned = model.decoder(ego, nodes, paths, torch.zeros(6, 2, LATENTS))
    torch.testing.assert_close(found[:, :1], alone)
    assert not torch.allclose(found[:, 0], found[:, 1])
    assert not torch.allclose(found[:, 0], found[:, 2])
    assert torch.isfinite(empty).all()
    assert not torch.allclose(turned[:, 0], turned[:, 1])


def test_empty_rows_and_who_is_far_away_change_nothing(tiny_data: Dataset) -> None:
    _, batch, model = batch_and_model(tiny_data)
    with torch.no_grad():
        before = model.policy(*(batch[name] for name in POLICY_INPUTS))
        spoilt = dict(batch)
        spoilt["nodes"] = batch["nodes"] + 5.0 * ~batch["nodes_valid"][..., None, None]
        spoilt["agents"] = batch["agents"] + 5.0 * ~batch["agents_valid"][..., None, None]
        after = model.policy(*(spoilt[name] for name in POLICY_INPUTS))
        there = batch["nodes_valid"]
        torch.testing.assert_close(before[0][there], after[0][there])
        alone = {**batch, "near_agents": torch.zeros_like(batch["near_agents"])}
        other = {**alone, "agents": batch["agents"] + 1.0}
        torch.testing.assert_close(
            *(model.policy(*(each[name] for name in POLICY_INPUTS))[2] for each in (alone, other))
        )


def test_the_plan_at_the_wheel_is_that_of_the_training(tmp_path: Path, tiny_data: Dataset) -> None:
    recipe, batch, model = batch_and_model(tiny_data)
    with torch.no_grad():
        wanted = recipe.poses(model, batch).numpy()
    network = load_network("gc_pgp", str(write_untrained(recipe, model, batch, tmp_path)))
    given = {name: values.numpy() for name, values in batch.items()}
    policy = network.run({name: given[name] for name in POLICY_INPUTS}, "policy")

    def decoded(paths: np.ndarray, noise: np.ndarray) -> np.ndarray:
        codes = {name: policy[name] for name in ("ego_code", "node_codes")}
        return network.run({**codes, "paths": paths, "noise": noise}, "decoder")["trajectories"]

    np.testing.assert_allclose(plans(given, policy["scores"], decoded, COMPACT), wanted, atol=1e-3)
