"""Training: the loss falls, seeds settle the weights, a break changes nothing, and the result drives."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from interplan_sumo import tiny_worlds
from interplan_sumo.dataset.reading import Dataset
from interplan_sumo.errors import InputError
from tools.train.data import Balanced, held_out_split, read_samples
from tools.train.recipe import find_recipe

if TYPE_CHECKING:
    import torch

    from tools.train import loop
    from tools.train.loop import EpochDone, Trained

NEEDS_TORCH = {"torch": "torch", "loop": "tools.train.loop"}


def trained(
    data: Dataset, checkpoint: Path, epochs: int = 4, seed: int = 0, **more: Any
) -> tuple[Trained, list[EpochDone]]:
    recipe = find_recipe("pdm_open")
    recipe = replace(recipe, settings=replace(recipe.settings, epochs=epochs, seed=seed, batch=32))
    told: list[EpochDone] = []
    samples, held = read_samples(data, "train", recipe), read_samples(data, "val", recipe)
    done = loop.train(recipe, samples, held, checkpoint=checkpoint, on_epoch=told.append, **more)
    return done, told


def weights(done: Trained) -> np.ndarray:
    return torch.cat([each.detach().ravel() for each in done.model.parameters()]).numpy()


def test_the_loss_falls_and_the_plans_beat_constant_velocity(tiny_data: Dataset, tmp_path: Path) -> None:
    done, told = trained(tiny_data, tmp_path / "checkpoint.pt", epochs=15)
    assert told[-1].loss < told[0].loss / 3.0
    assert told[-1].best_m == min(each.held_out_m for each in told)
    assert told[done.best_epoch - 1].held_out_m == told[-1].best_m
    assert done.stopped == "epochs"
    held = read_samples(tiny_data, "val", find_recipe("pdm_open"))
    assert told[-1].best_m < loop.constant_velocity_errors(held)["ade"]


def test_equal_seeds_give_equal_weights_and_others_do_not(tiny_data: Dataset, tmp_path: Path) -> None:
    one, _ = trained(tiny_data, tmp_path / "one.pt", epochs=2)
    same, _ = trained(tiny_data, tmp_path / "same.pt", epochs=2)
    other, _ = trained(tiny_data, tmp_path / "other.pt", epochs=2, seed=1)
    np.testing.assert_array_equal(weights(one), weights(same))
    assert not np.array_equal(weights(one), weights(other))


def test_a_training_that_was_interrupted_comes_to_the_same_weights(tiny_data: Dataset, tmp_path: Path) -> None:
    class BrokenOffError(Exception):
        pass

    def interrupt(done: EpochDone) -> None:
        if done.epoch == 2:
            raise BrokenOffError

    whole, _ = trained(tiny_data, tmp_path / "whole.pt")
    recipe = find_recipe("pdm_open")
    recipe = replace(recipe, settings=replace(recipe.settings, epochs=4, batch=32))
    samples, held = read_samples(tiny_data, "train", recipe), read_samples(tiny_data, "val", recipe)
    with pytest.raises(BrokenOffError):
        loop.train(recipe, samples, held, checkpoint=tmp_path / "broken.pt", on_epoch=interrupt)
    resumed, told = trained(tiny_data, tmp_path / "broken.pt", resume=True)
    assert [each.epoch for each in told] == [3, 4]
    np.testing.assert_array_equal(weights(whole), weights(resumed))


def test_it_stops_in_time_and_where_nothing_gets_better(tiny_data: Dataset, tmp_path: Path) -> None:
    done, told = trained(tiny_data, tmp_path / "checkpoint.pt", max_minutes=0.0)
    assert (done.stopped, done.epochs, told) == ("time", 0, [])
    recipe = find_recipe("pdm_open")
    recipe = replace(recipe, settings=replace(recipe.settings, epochs=9, patience=2, learning_rate=1e-12))
    samples = read_samples(tiny_data, "val", recipe)
    done = loop.train(recipe, samples, samples, checkpoint=tmp_path / "patient.pt")
    assert done.stopped == "patience"
    assert done.epochs == done.best_epoch + 2


def test_a_checkpoint_of_another_training_is_refused(tiny_data: Dataset, tmp_path: Path) -> None:
    checkpoint = tmp_path / "checkpoint.pt"
    with pytest.raises(InputError, match=r"there is no checkpoint .* train without --resume"):
        trained(tiny_data, checkpoint, resume=True)
    trained(tiny_data, checkpoint, epochs=1)
    with pytest.raises(InputError, match="is of another training"):
        trained(tiny_data, checkpoint, epochs=1, seed=1, resume=True)
    checkpoint.write_bytes(b"no checkpoint")
    with pytest.raises(InputError, match="cannot read the checkpoint"):
        trained(tiny_data, checkpoint, epochs=1, resume=True)


def test_rare_futures_are_drawn_more_often() -> None:
    future = np.zeros((100, 80, 4), dtype=np.float32)
    future[..., 3] = 1.0
    future[:96, :, 0] = np.linspace(1.0, 80.0, 80)
    future[96:, :, 1] = 20.0
    drawn = Balanced(future).draw(np.random.default_rng(0))
    assert len(drawn) == 100
    assert 10 <= np.count_nonzero(drawn >= 96) <= 25  # 2 of 11.8 by the root of their counts, 4 of 100 without


def test_without_other_seeds_other_maps_are_held_out(tiny_data: Dataset) -> None:
    assert held_out_split(tiny_data) == "val"
    with pytest.raises(InputError, match=r"no samples in its split 'test'; export with --holdout-seeds"):
        read_samples(tiny_data, "test", find_recipe("pdm_open"))


def test_a_trained_planner_drives_from_its_card(tiny_folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("onnx", reason="needs onnx: pip install 'interplan-sumo[train]'")
    pytest.importorskip("onnxruntime", reason="needs onnxruntime: pip install 'interplan-sumo[learned]'")
    from interplan_learned.pdm_open import PdmOpenPlanner
    from tools.train.session import TrainRequest, train_planner

    card = train_planner(
        TrainRequest(
            planner="pdm_open", data=tiny_folder, out=tmp_path / "out", work=tmp_path / "work",
            options={"history_s": 0.0}, settings={"epochs": 3},
        ),
        lambda _done: None,
    )  # fmt: skip
    assert card.data["samples"] == {"train": 234, "val": 39}
    assert card.errors["val"]["network"]["ade"] > 0.0
    planner = PdmOpenPlanner(weights=str(tmp_path / "out" / "pdm_open.json"))
    roads = tiny_worlds.straight_road()
    (lane,) = roads.lanes
    planner.start(tiny_worlds.mission(roads, [lane]))
    ego = tiny_worlds.ego_on(roads, lane, 20.0, 8.0)
    plan = planner.plan(tiny_worlds.observation(ego))
    assert (plan.x_m[0], plan.y_m[0]) == pytest.approx((ego.x_m, ego.y_m))
    assert plan.time_s[-1] == pytest.approx(ego.time_s + 8.0)
    assert planner.report()["network"]["options"]["history_s"] == 0.0
