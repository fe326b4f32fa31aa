"""UrbanDriver's network and loss: what its plans depend on and what not; and it drives, whatever its weights are."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from interplan_learned.urban_driver.planner import SIZES
from interplan_sumo.dataset.reading import Dataset
from tools.train.data import read_samples
from tools.train.recipe import find_recipe

pytestmark = pytest.mark.slow

if TYPE_CHECKING:
    import torch

    from tools.train.models import urban_driver as made

NEEDS_TORCH = {"torch": "torch", "made": "tools.train.models.urban_driver"}
Tensors = dict[str, Any]


@pytest.fixture(scope="module")
def model() -> made.UrbanDriver:
    """With random weights."""
    torch.manual_seed(0)
    return find_recipe("urban_driver").make_model().eval()  # type: ignore[return-value]


@pytest.fixture(scope="module")
def scene() -> Tensors:
    """Two scenes of random numbers: vehicles and lines in some rows, some of them seen for a while only."""
    size, rng = SIZES["compact"], np.random.default_rng(0)
    rows = sum(count for _, count in size.lines)
    there = rng.random((2, size.vehicles)) < 0.6
    frames = rng.integers(1, 6, (2, size.vehicles, 1))
    given = {
        "ego": rng.normal(size=(2, 5, 3)),
        "ego_valid": np.ones((2, 5), dtype=np.bool_),
        "vehicles": rng.normal(size=(2, size.vehicles, 5, 8)),
        "vehicles_valid": there[..., None] & (np.arange(5) < frames),
        "lines": rng.normal(size=(2, rows, 20, 6)),
        "lines_valid": rng.random((2, rows)) < 0.6,
    }
    return {name: torch.from_numpy(v if v.dtype == np.bool_ else v.astype(np.float32)) for name, v in given.items()}


def poses(model: made.UrbanDriver, scene: Tensors) -> Any:
    with torch.no_grad():
        return model(*(scene[name] for name in made.INPUTS))


def same(one: Any, other: Any) -> bool:
    return torch.allclose(one, other, rtol=1e-4, atol=1e-4)


def test_polylines_are_encoded_in_parts_while_it_learns_and_come_out_the_same(
    model: made.UrbanDriver, scene: Tensors, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = poses(model, scene)
    monkeypatch.setattr(made, "AT_ONCE", 7)
    assert int(scene["lines_valid"].sum()) % 7 > 0
    in_parts = poses(model.train(), scene)
    model.eval()  # it is shared
    assert same(in_parts, whole)


def test_order_empty_rows_and_an_unknown_past_do_not_matter(model: made.UrbanDriver, scene: Tensors) -> None:
    mixed, rng = dict(scene), np.random.default_rng(1)
    order = rng.permutation(scene["vehicles"].shape[1])
    for name in ("vehicles", "vehicles_valid"):
        mixed[name] = scene[name][:, order]
    parts: list[np.ndarray] = []
    for _, count in SIZES["compact"].lines:
        parts.append(sum(map(len, parts)) + rng.permutation(count))
    for name in ("lines", "lines_valid"):
        mixed[name] = scene[name][:, np.concatenate(parts)]
    assert same(poses(model, mixed), poses(model, scene))
    spoilt = dict(scene)
    spoilt["vehicles"] = scene["vehicles"] + 50.0 * ~scene["vehicles_valid"][..., None]
    spoilt["lines"] = scene["lines"] + 50.0 * ~scene["lines_valid"][..., None, None]
    assert same(poses(model, spoilt), poses(model, scene))
    short = {**scene, "ego_valid": torch.arange(5).expand(2, -1) < 2}
    spoilt = {**short, "ego": scene["ego"] + 50.0 * ~short["ego_valid"][..., None]}
    assert same(poses(model, spoilt), poses(model, short))
    assert not same(poses(model, short), poses(model, scene))


def test_everything_that_exists_matters_and_so_does_its_direction(model: made.UrbanDriver, scene: Tensors) -> None:
    before = poses(model, scene)
    for name in ("ego", "vehicles", "lines"):
        assert not same(poses(model, {**scene, name: scene[name] + 0.5}), before), name
    for name in ("vehicles_valid", "lines_valid"):
        assert not same(poses(model, {**scene, name: torch.zeros_like(scene[name])}), before), name
    assert not same(poses(model, {**scene, "lines": scene["lines"].flip(2)}), before)


def test_the_same_line_as_another_kind_is_something_else(model: made.UrbanDriver, scene: Tensors) -> None:
    first, other = 0, SIZES["compact"].lanes  # a lane, a left boundary
    found: list[Any] = []
    for row in (first, other):
        lines, valid = torch.zeros_like(scene["lines"]), torch.zeros_like(scene["lines_valid"])
        lines[:, row], valid[:, row] = scene["lines"][:, 0], True
        found.append(poses(model, {**scene, "lines": lines, "lines_valid": valid}))
    assert not same(*found)
    assert torch.bincount(model.kinds).tolist() == [1, 16, *(count for _, count in SIZES["compact"].lines)]
    assert model.kind.num_embeddings == 2 + len(SIZES["compact"].lines)


def test_tokens_have_equal_length_and_the_ego_alone_asks(model: made.UrbanDriver, scene: Tensors) -> None:
    given: list[Any] = []
    hook = model.attention.register_forward_pre_hook(lambda _module, arguments: given.extend(arguments))
    poses(model, scene)
    hook.remove()
    tokens, keys, there = given
    lengths = tokens.norm(dim=-1)
    assert torch.allclose(lengths[there], torch.tensor(8.0), atol=1e-4)  # the root of 64
    assert not lengths[~there].any()
    assert there[:, 0].all()
    torch.testing.assert_close(keys - tokens, model.kind(model.kinds).expand_as(keys), atol=1e-5, rtol=0.0)
    with torch.no_grad():
        spoilt = tokens + 5.0 * ~there[..., None]
        torch.testing.assert_close(model.attention(spoilt, keys, there), model.attention(tokens, keys, there))


def test_points_are_numbered_by_sines_and_cosines() -> None:
    table = made.sinusoids(20, 64)
    assert table[0].tolist() == [0.0, 1.0] * 32
    np.testing.assert_allclose(table[3, :2], (np.sin(3.0), np.cos(3.0)), rtol=1e-6)
    np.testing.assert_allclose(table[19, -2], np.sin(19.0 * 1e4 ** (-62 / 64)), rtol=1e-5)


def test_the_loss_is_the_mean_absolute_error_of_the_poses_there_are() -> None:
    plans, wanted = torch.zeros(1, 16, 3), torch.zeros(1, 16, 3)
    valid = torch.arange(16)[None] < 4
    plans[0, 0, 0], plans[0, 1, 1], plans[0, 2, 2], plans[0, 4:] = 3.0, -2.0, 0.5, 99.0
    assert float(made.plan_loss(plans, wanted, valid)) == pytest.approx(5.5 / 12.0, rel=1e-5)
    plans[0, 2, 2] = -2.0 * torch.pi  # a full turn is none
    assert float(made.plan_loss(plans, wanted, valid)) == pytest.approx(5.0 / 12.0, rel=1e-5)


def test_perturbed_starts_and_lost_vehicles_reach_the_network(tiny_data: Dataset) -> None:
    plain = find_recipe("urban_driver", options={"perturbed": 0.0, "agents_dropped": 0.0})
    rows = read_samples(tiny_data, "train", plain).columns
    before = plain.inputs(rows)
    for name, values in plain.inputs(plain.augmented(rows, np.random.default_rng(0))).items():
        np.testing.assert_array_equal(values, before[name])
    moved = find_recipe("urban_driver", options={"perturbed": 1.0, "agents_dropped": 0.0})
    after = moved.inputs(moved.augmented(rows, np.random.default_rng(0)))
    np.testing.assert_allclose(after["ego"][:, 0], 0.0, atol=1e-5)  # it is the ego's frame again
    assert np.abs(after["ego"][:, 1:, 1] - before["ego"][:, 1:, 1]).max() > 0.1
    assert np.abs(after["lines"] - before["lines"]).max() > 0.1
    lost = find_recipe("urban_driver", options={"perturbed": 0.0, "agents_dropped": 1.0})
    seen = lost.inputs(lost.augmented(rows, np.random.default_rng(0)))["vehicles_valid"][..., 0].sum()
    assert 0.3 < seen / before["vehicles_valid"][..., 0].sum() < 0.7
