"""Training: the loss falls, seeds settle the weights, a break changes nothing; what every recipe must keep to."""

from __future__ import annotations

import os
import select
import signal
import time
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from interplan_learned.driving import POSES
from interplan_learned.dtpp import sizes as dtpp_sizes
from interplan_learned.gameformer import inputs as gameformer_inputs
from interplan_learned.gc_pgp import sizes as gc_pgp_sizes
from interplan_sumo import tiny_worlds
from interplan_sumo.dataset.reading import Dataset, read_dataset
from interplan_sumo.errors import InputError, InterplanError
from tools.train.data import Balanced, Samples, held_out_split, read_samples
from tools.train.recipe import Recipe, fields_of, find_recipe, recipe_names

pytestmark = pytest.mark.slow

if TYPE_CHECKING:
    import torch

    from tools.train import crew, loop
    from tools.train.loop import EpochDone, Trained

NEEDS_TORCH = {"torch": "torch", "loop": "tools.train.loop", "crew": "tools.train.crew"}


def trained(
    data: Dataset,
    checkpoint: Path,
    *,
    resume: bool = False,
    until: float = inf,
    max_minutes: float = inf,
    processes: int = 1,
    **settings: Any,
) -> tuple[Trained, list[EpochDone]]:
    """A training with other settings than the usual ones, interrupted after so many epochs."""
    recipe = find_recipe("pdm_open")
    recipe = replace(recipe, settings=replace(recipe.settings, **{"epochs": 4, "batch": 32, **settings}))
    told: list[EpochDone] = []

    def tell(done: EpochDone) -> None:
        told.append(done)
        if done.epoch == until:
            raise KeyboardInterrupt

    samples, held = read_samples(data, "train", recipe), read_samples(data, "val", recipe)
    kept = loop.Checkpoint(checkpoint, resume=resume)
    done = loop.train(
        recipe, samples, held, checkpoint=kept, on_epoch=tell, max_minutes=max_minutes, processes=processes
    )
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


def test_seeds_settle_the_weights_and_so_they_do_over_an_interruption(tiny_data: Dataset, tmp_path: Path) -> None:
    whole, _ = trained(tiny_data, tmp_path / "whole.pt")
    with pytest.raises(KeyboardInterrupt):
        trained(tiny_data, tmp_path / "broken.pt", until=2)
    resumed, told = trained(tiny_data, tmp_path / "broken.pt", resume=True)
    assert [each.epoch for each in told] == [3, 4]
    np.testing.assert_array_equal(weights(whole), weights(resumed))
    other, _ = trained(tiny_data, tmp_path / "other.pt", seed=1)
    assert not np.array_equal(weights(whole), weights(other))


def test_processes_that_share_batches_learn_what_one_learns_and_the_same_each_time(
    tiny_data: Dataset, tmp_path: Path
) -> None:
    alone, _ = trained(tiny_data, tmp_path / "alone.pt")
    shared, told = trained(tiny_data, tmp_path / "shared.pt", processes=2)
    with pytest.raises(KeyboardInterrupt):
        trained(tiny_data, tmp_path / "again.pt", processes=2, until=2)
    again, _ = trained(tiny_data, tmp_path / "again.pt", processes=2, resume=True)
    np.testing.assert_array_equal(weights(shared), weights(again))
    assert told[-1].held_out_m == pytest.approx(alone.held_out_m[-1], rel=0.2)
    assert told[-1].held_out_m != alone.held_out_m[-1]  # another draw of the augmentation


@pytest.mark.parametrize("rows", [1, 7])
@pytest.mark.parametrize("processes", [1, 2, 3])
def test_gradients_of_a_crew_are_those_of_the_whole_batch(processes: int, rows: int) -> None:
    given = torch.linspace(-1.0, 2.0, 2 * rows).view(rows, 2)
    model = torch.nn.Linear(2, 3)
    team = crew.Crew(model, processes)

    def gradients(seen: np.ndarray) -> list[torch.Tensor | None]:
        model.zero_grad(set_to_none=True)
        if len(seen):
            model(given[seen]).square().mean().backward()
        return [each.grad for each in model.parameters()]

    def step() -> None:
        seen = team.part(np.arange(rows))
        gradients(seen)
        team.agree(len(seen) / rows)

    wanted = gradients(np.arange(rows))
    with team.together(step):
        step()
    torch.testing.assert_close([each.grad for each in model.parameters()], wanted)


@pytest.mark.parametrize("rows", [0, 3])
def test_a_training_ends_with_a_process_of_it(rows: int) -> None:
    """Whether that ends at once, or while it waits for the others."""
    team = crew.Crew(torch.nn.Linear(1, 1), 3)

    def work() -> None:
        for _ in range(rows):
            team.agree(0.3)
        if team.rank == 2:
            os._exit(1)
        team.agree(0.3)

    with pytest.raises(InterplanError, match="has ended; go on with --resume"), team.together(work):
        work()


def test_who_follows_ends_with_the_first() -> None:
    """However that ends: whoever waits for it sees its lines close."""
    seen, told = os.pipe()
    first = os.fork()
    if first == 0:
        team = crew.Crew(torch.nn.Linear(1, 1), 3)
        with team.together(lambda: team.agree(0.3)):
            os.close(seen)
            time.sleep(0.5)
            os.kill(os.getpid(), signal.SIGKILL)
    os.close(told)
    os.waitpid(first, 0)
    assert select.select([seen], [], [], 20.0)[0] == [seen]
    assert os.read(seen, 1) == b""  # nobody holds the other end any more
    os.close(seen)


def test_what_cannot_learn_together_is_said(tiny_data: Dataset, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="processes is 0, expected 1 or more"):
        trained(tiny_data, tmp_path / "none.pt", processes=0)
    done, _ = trained(tiny_data, tmp_path / "many.pt", processes=3, batch=2, epochs=2)  # one of them never has a row
    assert done.epochs == 2
    with pytest.raises(InputError, match="is of another training"):
        trained(tiny_data, tmp_path / "many.pt", processes=2, batch=2, epochs=2, resume=True)


def test_a_training_whose_plans_are_no_numbers_ends(tiny_data: Dataset, tmp_path: Path) -> None:
    with pytest.raises(InterplanError, match="after epoch 1 the plans are no numbers; give a --learning-rate"):
        trained(tiny_data, tmp_path / "wild.pt", learning_rate=1e30)


def test_it_stops_in_time_and_where_nothing_gets_better(tiny_data: Dataset, tmp_path: Path) -> None:
    done, told = trained(tiny_data, tmp_path / "checkpoint.pt", max_minutes=0.0)
    assert (done.stopped, done.epochs, told) == ("time", 0, [])
    done, _ = trained(tiny_data, tmp_path / "patient.pt", epochs=9, patience=2, learning_rate=1e-12)
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


@pytest.mark.parametrize("planner", ["pdm_open", "pdm_offset"])
def test_a_perceptron_plans_the_same_while_it_learns_as_when_it_drives(tiny_data: Dataset, planner: str) -> None:
    recipe = find_recipe(planner)
    samples = read_samples(tiny_data, "val", recipe)
    batch = loop.batch_of(recipe, samples.picked(np.arange(8)))
    torch.manual_seed(0)
    model = recipe.make_model()
    learning = recipe.poses(model.train(), batch)
    assert torch.equal(learning, recipe.poses(model.eval(), batch))


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


def test_a_share_of_the_drives_is_part_of_a_larger_one(tiny_data: Dataset) -> None:
    recipe = find_recipe("pdm_open")

    def futures(share: float) -> set[bytes]:
        return {each.tobytes() for each in read_samples(tiny_data, "train", recipe, share).columns["ego_future"]}

    few, more, every = (futures(share) for share in (0.4, 0.7, 1.0))
    assert 0 < len(few) < len(more) < len(every)
    assert few < more < every
    for share in (0.0, 1.01):
        with pytest.raises(InputError, match=r"share is .*, expected more than 0 and at most 1"):
            read_samples(tiny_data, "train", recipe, share)
    with pytest.raises(InputError, match="holds no samples of 'train'; take more"):
        read_samples(tiny_data, "train", recipe, 1e-9)


def test_a_trained_planner_drives_from_its_card(tiny_folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("onnx", reason="needs onnx: pip install 'interplan-sumo[train]'")
    pytest.importorskip("onnxruntime", reason="needs onnxruntime: pip install 'interplan-sumo[learned]'")
    from interplan_learned.pdm_open.planner import PdmOpenPlanner
    from tools.train.session import TrainRequest, train_planner

    card = train_planner(
        TrainRequest(
            planner="pdm_open", data=tiny_folder, out=tmp_path / "out", work=tmp_path / "work",
            options={"history_s": 0.0}, settings={"epochs": 3}, share=0.7,
        ),
        lambda _done: None,
    )  # fmt: skip
    data, recipe = read_dataset(tiny_folder), find_recipe("pdm_open")
    whole, part = (len(read_samples(data, "train", recipe, share)) for share in (1.0, 0.7))
    assert whole == 234
    assert card.data["samples"] == {"train": part, "val": 39}
    assert len(card.training["held_out_m"]) == card.training["epochs_done"] == 3
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


@pytest.fixture(params=recipe_names(), scope="module")
def recipe(request: pytest.FixtureRequest) -> Recipe:
    return find_recipe(request.param)


@pytest.fixture(scope="module")
def held(recipe: Recipe, tiny_data: Dataset) -> Samples:
    """Samples as this recipe keeps them; not to be changed."""
    return read_samples(tiny_data, "val", recipe)


def test_what_stays_in_memory_gives_the_same_inputs_as_everything(
    recipe: Recipe, held: Samples, tiny_data: Dataset
) -> None:
    everything = tiny_data.split("val").shard(0, fields_of(recipe))
    again = recipe.inputs(recipe.keep(everything, tiny_data))
    for name, values in recipe.inputs(held.columns).items():
        assert len(values) == len(everything["ego_future"])
        np.testing.assert_array_equal(values, again[name])


def test_inputs_are_finite_and_of_one_sample_as_of_many(recipe: Recipe, held: Samples) -> None:
    together = recipe.inputs(held.columns)
    alone = recipe.inputs(held.picked(np.array([3])))
    for name, values in together.items():
        assert np.isfinite(values.astype(np.float64)).all(), name
        np.testing.assert_allclose(alone[name][0], values[3], atol=1e-6, err_msg=name)


def test_steps_of_training_reach_the_weights_and_lower_the_loss(recipe: Recipe, held: Samples) -> None:
    from tools.train.loop import batch_of

    rows = recipe.augmented(held.picked(np.arange(len(held))), np.random.default_rng(0))
    torch.manual_seed(0)
    model, batch, losses = recipe.make_model(), batch_of(recipe, rows), list[float]()
    rule = torch.optim.AdamW(model.parameters(), lr=3e-3)
    for _ in range(6):
        rule.zero_grad()
        loss = recipe.loss(model, batch, 0.0)
        loss.backward()
        gradients = [weights.grad for weights in model.parameters() if weights.grad is not None]
        assert all(torch.isfinite(each).all() for each in gradients)
        assert len(gradients) > len(list(model.parameters())) / 2
        rule.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < losses[0]


def test_plans_have_sixteen_poses_alone_as_among_others_and_onnx_gives_the_same(
    recipe: Recipe, held: Samples, tmp_path: Path
) -> None:
    pytest.importorskip("onnx", reason="needs onnx: pip install 'interplan-sumo[train]'")
    pytest.importorskip("onnxruntime", reason="needs onnxruntime: pip install 'interplan-sumo[learned]'")
    from tools.train.loop import batch_of
    from tools.train.onnx_export import export_graphs, round_to_half

    torch.manual_seed(0)
    model = recipe.make_model().eval()
    round_to_half(model)
    batch = batch_of(recipe, held.picked(np.arange(4)))
    with torch.no_grad():
        plans = recipe.poses(model, batch)
        alone = recipe.poses(model, {name: values[2:3] for name, values in batch.items()})
        assert plans.shape == (4, POSES, 3)
        torch.testing.assert_close(alone[0], plans[2], rtol=1e-3, atol=1e-3)
        graphs = export_graphs(recipe.graphs(model, batch), tmp_path, recipe.planner)  # holds ONNX against torch
    assert sum((tmp_path / each.file).stat().st_size for each in graphs.values()) < 4 << 20


def test_equal_seeds_give_equal_augmented_samples(recipe: Recipe, held: Samples) -> None:
    columns = held.columns
    before = {name: values.copy() for name, values in columns.items()}
    one, other = (recipe.augmented(columns, np.random.default_rng(5)) for _ in range(2))
    for name in columns:
        np.testing.assert_array_equal(one[name], other[name])
        np.testing.assert_array_equal(columns[name], before[name])  # what is kept in memory is not touched


def test_published_sizes_have_the_published_numbers() -> None:
    from tools.train.models.dtpp import NETWORKS

    made = {name: find_recipe(name, "published") for name in ("dtpp", "gameformer", "gc_pgp", "urban_driver")}
    assert {each.size for each in made.values()} == {"published"}
    tree, graph = dtpp_sizes.SIZES["published"].tree, gc_pgp_sizes.SIZES["published"]
    assert (tree.branches, tree.first_speeds, tree.second_speeds, tree.parents) == (30, 10, 5, 5)
    assert NETWORKS["published"].encoder.width == 256
    assert (gameformer_inputs.SIZES["published"].scene.agents, gameformer_inputs.SIZES["published"].predicted) == (
        20,
        10,
    )
    assert made["gameformer"].settings.epochs == 20
    assert (graph.train_traversals, graph.heads, graph.attention, graph.clusters) == (1000, 32, 128, 10)
    network, settings = made["urban_driver"].make_model(), made["urban_driver"].settings
    assert network.width == 256
    assert torch.bincount(network.kinds).tolist() == [1, 30, 30, 30, 30, 20, 20, 30]  # type: ignore[arg-type]
    widths = [each.out_features for each in network.head if isinstance(each, torch.nn.Linear)]  # type: ignore[union-attr]
    assert widths == [1024, 1024, 48]
    assert (settings.epochs, settings.batch, settings.learning_rate) == (100, 64, 1e-4)


@pytest.mark.parametrize(("given", "message"), [
    ({"planner": "pdm_opn"}, "no planner to train named 'pdm_opn'. Did you mean 'pdm_open'?"),
    ({"planner": "pdm_open", "size": "compct"}, "no size named 'compct'. Did you mean 'compact'?"),
    ({"planner": "pdm_open", "options": {"history": 1}}, "no option of pdm_open's training named 'history'"),
])  # fmt: skip
def test_what_there_is_not_is_named(given: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message.replace("?", r"\?")):
        find_recipe(**given)


def test_settings_must_be_positive() -> None:
    settings = find_recipe("pdm_open").settings
    with pytest.raises(InputError, match="epochs is 0, expected more than 0"):
        replace(settings, epochs=0)
