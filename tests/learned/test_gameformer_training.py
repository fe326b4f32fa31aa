"""GameFormer's network and loss: levels that answer to one another; and it drives, whatever its weights are."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from tiny_dataset import write_untrained

from interplan_learned.gameformer.inputs import MODES, inputs
from interplan_learned.gameformer.planner import GameFormerPlanner, likeliest
from interplan_sumo import tiny_worlds
from interplan_sumo.features.view import EgoView
from interplan_sumo.planner import Mission, Observation
from tools.train.recipe import find_recipe

pytestmark = pytest.mark.slow

if TYPE_CHECKING:
    import torch

    from tools.train import scene_encoder
    from tools.train.models import gameformer as made

NEEDS_TORCH = {
    "torch": "torch", "made": "tools.train.models.gameformer", "scene_encoder": "tools.train.scene_encoder",
}  # fmt: skip
SMALL: dict[str, Any] = {"width": 16, "heads": 2, "layers": 1, "dropout": 0.0}
STEPS = 16


def level(means: object, log_sigma: float = 0.0, logits: object = None) -> made.Level:
    """What is predicted of one scene: means (R, M, T, 2)."""
    mean = torch.as_tensor(means, dtype=torch.float32)[None]
    scores = torch.zeros(mean.shape[:3]) if logits is None else torch.as_tensor(logits, dtype=torch.float32)[None]
    return made.Level(mean, torch.full_like(mean, log_sigma), scores)


def standing(*places: tuple[float, float]) -> Any:
    """A tensor (R, T, 2) of who stays where they are."""
    return torch.tensor(places)[:, None].expand(-1, STEPS, -1).clone()


def test_only_the_mode_nearest_to_the_truth_is_judged_and_each_road_user_has_its_own() -> None:
    truth = standing((0.0, 0.0), (5.0, 0.0))
    far = torch.full_like(truth, 40.0)
    mixed = torch.stack((torch.stack((truth[0], far[0])), torch.stack((far[1], truth[1]))))
    valid = torch.ones(1, 2, STEPS, dtype=torch.bool)
    confused = made.level_loss(level(mixed), truth[None], valid)
    assert float(confused) == pytest.approx(np.log(2.0), abs=1e-4)  # nothing but not knowing which
    right = made.level_loss(level(mixed, logits=((4.0, 0.0), (0.0, 4.0))), truth[None], valid)
    wrong = made.level_loss(level(mixed, logits=((0.0, 4.0), (4.0, 0.0))), truth[None], valid)
    assert float(right) < float(confused) < float(wrong)


def test_the_likelihood_is_a_gaussians_of_what_is_known() -> None:
    truth = standing((1.0, 2.0))
    one_off = level(truth[:, None] + 1.0, log_sigma=0.5)
    found = made.level_loss(one_off, truth[None], torch.ones(1, 1, STEPS, dtype=torch.bool))
    assert float(found) == pytest.approx(2 * (0.5 + 0.5 * np.exp(-1.0)), abs=1e-4)
    truth = standing((0.0, 0.0), (0.0, 0.0))
    means = truth[:, None].repeat(1, 2, 1, 1)
    means[0, :, 8:] += 100.0
    means[1] += 100.0
    valid = torch.zeros(1, 2, STEPS, dtype=torch.bool)
    valid[0, 0, :8] = True
    assert float(made.level_loss(level(means), truth[None], valid)) == pytest.approx(np.log(2.0), abs=1e-4)


def test_a_plan_is_judged_by_its_mean_error_and_once_more_by_its_end() -> None:
    wanted = torch.zeros(1, 80, 3)
    valid = torch.ones(1, 80, dtype=torch.bool)
    plan = wanted.clone()
    plan[0, -1, 0] = 3.5  # smooth L1 of 3.5 is 3, a third of that over x, y and yaw
    assert float(made.plan_loss(plan, wanted, valid)) == pytest.approx(1.0 / 80.0 + 1.0, rel=1e-4)
    valid[0, 40:] = False  # the drive ends after 4 s
    assert float(made.plan_loss(plan, wanted, valid)) == pytest.approx(0.0, abs=1e-6)
    plan[0, :, 2] = 2.0 * torch.pi  # a full turn is none
    assert float(made.plan_loss(plan, wanted, valid)) == pytest.approx(0.0, abs=1e-6)


def driven(acceleration: float, curvature: float, speed_mps: float = 8.0) -> np.ndarray:
    controls = torch.tensor((acceleration, curvature)).expand(1, 80, 2)
    ego = torch.zeros(1, 7)
    ego[0, 3] = speed_mps
    return made.driven(controls, ego)[0].numpy()


def test_controls_are_bounded_without_them_it_goes_straight_on_and_nobody_drives_backwards() -> None:
    poses = driven(0.0, 0.0)
    np.testing.assert_allclose(poses[:, 0], 0.8 * np.arange(1, 81), rtol=1e-5)
    np.testing.assert_array_equal(poses[:, 1:], 0.0)
    np.testing.assert_allclose(np.diff(driven(1.0, 0.0)[:, 0], 2), 0.05, atol=1e-3)  # 5 m/s2
    stopped = driven(-1.0, 0.5)
    np.testing.assert_allclose(stopped[20:], np.broadcast_to(stopped[20], (60, 3)), atol=1e-4)


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(("speed_mps", "radius_m"), [(2.0, 4.0), (4.0, 4.0), (8.0, 16.0), (12.0, 36.0)])
def test_positive_curvature_turns_left_as_narrowly_as_a_car_can(side: float, speed_mps: float, radius_m: float) -> None:
    for share in (1.0, 0.1):
        poses = driven(0.0, share * side, speed_mps)
        assert side * poses[9, 1] > 0.0
        turned = side * share * 0.1 * speed_mps / radius_m * np.arange(1, 81)
        np.testing.assert_allclose(poses[:, 2], turned, rtol=1e-4)


def test_an_untrained_network_goes_on_as_it_does() -> None:
    torch.manual_seed(0)
    ego = torch.zeros(1, 7)
    ego[0, 3] = 8.0
    width = scene_encoder.EncoderSize(**SMALL).width
    head = made.PlanHead(scene_encoder.EncoderSize(**SMALL)).eval()
    plan = head(torch.randn(1, MODES, width), torch.randn(1, 2, 10, 3), ego)[0].detach().numpy()
    np.testing.assert_allclose(plan, driven(0.0, 0.0), atol=0.5)


def test_a_level_answers_to_what_the_others_were_going_to_do() -> None:
    torch.manual_seed(0)
    layer = made.FurtherLevel(scene_encoder.EncoderSize(**SMALL), STEPS).eval()
    empty = torch.zeros(1, 5, dtype=torch.bool)
    empty[0, 2] = True
    scene = scene_encoder.EncodedScene(torch.randn(1, 5, 16), empty)
    now, content = torch.zeros(1, 3, 2), torch.randn(1, 3, MODES, 16)
    before, futures = level(torch.zeros(3, MODES, STEPS, 2)), torch.randn(1, 3, MODES, 16)

    def answer(changed: int | None) -> np.ndarray:
        given = futures.clone()
        if changed is not None:
            given[:, changed] += torch.randn(16)
        with torch.no_grad():
            return layer(scene, now, content, before, given)[1].means[0].numpy()

    plain = answer(None)
    assert not np.allclose(answer(1)[0], plain[0])
    np.testing.assert_array_equal(answer(2)[:2], plain[:2])  # nobody is there


def test_levels_differ_and_the_loss_sees_each() -> None:
    torch.manual_seed(0)
    model = made.GameFormer(scene_encoder.EncoderSize(**SMALL), predicted=2, steps=STEPS).eval()
    batch = {
        "ego": torch.randn(2, 11, 7), "agents": torch.randn(2, 2, 11, 11), "lanes": torch.randn(2, 3, 10, 7),
        "crosswalks": torch.randn(2, 1, 10, 3), "route_lanes": torch.randn(2, 2, 10, 3),
        "futures": torch.randn(2, 3, STEPS, 2), "futures_valid": torch.ones(2, 3, STEPS, dtype=torch.bool),
        "wanted": torch.randn(2, 80, 3), "wanted_valid": torch.ones(2, 80, dtype=torch.bool),
    }  # fmt: skip
    outcome = model(*(batch[name] for name in made.INPUTS))
    assert len(outcome.levels) == 1 + made.LEVELS
    assert outcome.plan.shape == (2, 80, 3)
    for one, other in zip(outcome.levels, outcome.levels[1:], strict=False):
        assert not torch.allclose(one.means, other.means)
    whole = made.loss(model, batch, 0.0)
    parts = [made.level_loss(each, batch["futures"], batch["futures_valid"]) for each in outcome.levels]
    plan = made.plan_loss(outcome.plan, batch["wanted"], batch["wanted_valid"])
    assert float(whole.detach()) == pytest.approx(float((sum(parts) + plan).detach()), rel=1e-5)
    whole.backward()
    gradients = {name: weights.grad for name, weights in model.named_parameters()}
    unmoved = [name for name, gradient in gradients.items() if gradient is None or not gradient.any()]
    # adding to all scores changes nothing
    assert all(name.endswith("scores.2.bias") for name in unmoved)


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The card of a compact network that has learned nothing."""
    from tools.train.onnx_export import round_to_half

    folder = tmp_path_factory.mktemp("gameformer")
    recipe = find_recipe("gameformer")
    torch.manual_seed(0)
    model = recipe.make_model().eval()
    round_to_half(model)
    seen, where = street()
    arrays = {name: values[None].repeat(3, axis=0) for name, values in EgoView(where).arrays(seen).items()}
    batch = {name: torch.from_numpy(values) for name, values in inputs(arrays, "compact").items()}
    return write_untrained(recipe, model, batch, folder)


def street(x_m: float = 30.0, y_m: float = 0.0) -> tuple[Observation, Mission]:
    """A road with two lanes, one car standing ahead and one coming up from behind."""
    roads = tiny_worlds.straight_road(2)
    ego = tiny_worlds.ego(x_m, y_m, 8.0)
    actors = tiny_worlds.cars((60.0, 0.0), (10.0, -3.5, 9.0))
    return tiny_worlds.observation(ego, actors), tiny_worlds.mission(roads, ["11"])


def test_the_likeliest_future_of_each_agent_is_taken() -> None:
    futures = np.arange(2 * 3)[:, None, None].reshape(2, 3, 1, 1) + np.zeros((2, 3, 16, 2))
    chosen = likeliest(futures, np.array(((0.0, 2.0, 1.0), (3.0, 2.0, 1.0))))
    assert chosen[:, 0, 0].tolist() == [1.0, 3.0]


def test_it_drives_along_the_path_and_stays_there(weights: Path) -> None:
    planner = GameFormerPlanner(weights=str(weights))
    seen, where = street()
    planner.start(where)
    for step in range(20):
        plan = planner.plan(seen)
        assert plan.time_s[-1] - plan.time_s[0] == pytest.approx(8.0)
        np.testing.assert_allclose(plan.heading_rad, 0.0, atol=0.8)
        pose = plan.at(plan.time_s[1])
        moved_m = pose.x_m - seen.ego.x_m
        ego = tiny_worlds.ego(pose.x_m, pose.y_m, moved_m / 0.1, pose.heading_rad, 0.1 * (step + 1))
        seen = tiny_worlds.observation(ego, seen.actors)
    assert planner.report()["steps"] == 20
    assert planner.report()["without_reference_path"] == 0


def test_off_the_route_it_drives_the_plan_of_the_network(weights: Path) -> None:
    planner = GameFormerPlanner(weights=str(weights))
    seen, where = street(y_m=20.0)
    planner.start(where)
    plan = planner.plan(seen)
    assert plan.y_m[0] == pytest.approx(20.0)
    assert planner.report()["without_reference_path"] == 1
    planner.start(where)
    assert planner.report()["without_reference_path"] == 0
