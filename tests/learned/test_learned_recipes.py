"""What every recipe in `tools/train/models` must keep to; a new one is tested by being there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from interplan_learned.driving import POSES
from interplan_sumo.dataset.reading import Dataset
from interplan_sumo.errors import InputError
from tools.train.data import read_samples
from tools.train.recipe import Recipe, fields_of, find_recipe, recipe_names

torch = pytest.importorskip("torch", reason="needs torch: pip install 'interplan-sumo[train]'")


@pytest.fixture(params=recipe_names())
def recipe(request: pytest.FixtureRequest) -> Recipe:
    return find_recipe(request.param)


def test_what_stays_in_memory_gives_the_same_inputs_as_everything(recipe: Recipe, tiny_data: Dataset) -> None:
    everything = tiny_data.split("val").shard(0, fields_of(recipe))
    kept = read_samples(tiny_data, "val", recipe).columns
    again = recipe.inputs(recipe.keep(everything, tiny_data))
    for name, values in recipe.inputs(kept).items():
        assert len(values) == len(everything["ego_future"])
        np.testing.assert_array_equal(values, again[name])


def test_inputs_are_finite_and_of_one_sample_as_of_many(recipe: Recipe, tiny_data: Dataset) -> None:
    samples = read_samples(tiny_data, "val", recipe)
    together = recipe.inputs(samples.columns)
    alone = recipe.inputs(samples.picked(np.array([3])))
    for name, values in together.items():
        assert np.isfinite(values.astype(np.float64)).all(), name
        np.testing.assert_allclose(alone[name][0], values[3], atol=1e-6, err_msg=name)


def test_a_step_of_training_moves_every_weight_that_it_should(recipe: Recipe, tiny_data: Dataset) -> None:
    from tools.train.loop import batch_of

    samples = read_samples(tiny_data, "train", recipe)
    rows = recipe.augmented(samples.picked(np.arange(0, len(samples), 7)), np.random.default_rng(0))
    torch.manual_seed(0)
    model = recipe.make_model()
    loss = recipe.loss(model, batch_of(recipe, rows), 0.0)
    loss.backward()
    assert torch.isfinite(loss)
    grown = [name for name, weights in model.named_parameters() if weights.grad is not None]
    assert all(torch.isfinite(weights.grad).all() for weights in model.parameters() if weights.grad is not None)
    assert len(grown) > len(list(model.parameters())) / 2


def test_the_plan_has_sixteen_poses_and_onnx_gives_the_same(recipe: Recipe, tiny_data: Dataset, tmp_path: Path) -> None:
    pytest.importorskip("onnx", reason="needs onnx: pip install 'interplan-sumo[train]'")
    pytest.importorskip("onnxruntime", reason="needs onnxruntime: pip install 'interplan-sumo[learned]'")
    from tools.train.loop import batch_of
    from tools.train.onnx_export import export_graphs, round_to_half

    samples = read_samples(tiny_data, "val", recipe)
    torch.manual_seed(0)
    model = recipe.make_model().eval()
    round_to_half(model)
    batch = batch_of(recipe, samples.picked(np.arange(4)))
    with torch.no_grad():
        assert recipe.poses(model, batch).shape == (4, POSES, 3)
        graphs = export_graphs(recipe.graphs(model, batch), tmp_path, recipe.planner)  # holds ONNX against torch
    assert sum((tmp_path / each.file).stat().st_size for each in graphs.values()) < 4 << 20


def test_equal_seeds_give_equal_augmented_samples(recipe: Recipe, tiny_data: Dataset) -> None:
    columns = read_samples(tiny_data, "val", recipe).columns
    before = {name: values.copy() for name, values in columns.items()}
    one, other = (recipe.augmented(columns, np.random.default_rng(5)) for _ in range(2))
    for name in columns:
        np.testing.assert_array_equal(one[name], other[name])
        np.testing.assert_array_equal(columns[name], before[name])  # what is kept in memory is not touched


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"planner": "pdm_opn"}, "no planner to train named 'pdm_opn'. Did you mean 'pdm_open'?"),
        ({"planner": "pdm_open", "size": "compct"}, "no size named 'compct'. Did you mean 'compact'?"),
        ({"planner": "pdm_open", "options": {"history": 1}}, "no option of pdm_open's training named 'history'"),
    ],
)
def test_what_there_is_not_is_named(given: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message.replace("?", r"\?")):
        find_recipe(**given)


def test_settings_must_be_positive() -> None:
    settings = find_recipe("pdm_open").settings
    with pytest.raises(InputError, match="epochs is 0, expected more than 0"):
        replace(settings, epochs=0)
