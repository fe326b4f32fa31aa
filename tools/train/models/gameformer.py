"""GameFormer's network and loss: level by level everyone answers to what the others were going to do one level before.

Compact: the same method with a width of 64 instead of 256, two layers, fewer agents and lanes, futures at 2 Hz.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Final, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from interplan_learned.card import Size
from interplan_learned.driving import POSES
from interplan_learned.gameformer.inputs import MODES, PLAN_STEP_S, PLAN_STEPS, SIZES, inputs
from interplan_learned.scene import EGO_CHANNELS, FIELDS, scene_futures, thinned
from interplan_sumo.dataset.columns import Columns
from tools.train.augment import Perturbation, augmented
from tools.train.recipe import Batch, GraphCall, Recipe, TrainingSettings
from tools.train.scene_encoder import (
    AttentionLayer,
    EncodedScene,
    EncoderSize,
    LineEncoder,
    NetworkSize,
    SceneEncoder,
    pose_differences,
)

LEVELS: Final = 2
"""Above level 0: as the published planner was trained."""
ACCELERATION_MPS2: Final = 5.0
LATERAL_MPS2: Final = 4.0
CURVATURE_PER_M: Final = 0.25
"""The plan's controls stay within these. The published ones allow the same curvature at all speeds, so that a
thousandth of it too much for 3 s is a degree at 10 m/s: headings came out 0.1 rad off, here half of it.
"""
LOG_SIGMA: Final = 2.0
"""Logarithms of standard deviations (m) stay within plus and minus this."""
LABEL_SMOOTHING: Final = 0.2
INPUTS: Final = ("ego", "agents", "lanes", "crosswalks", "route_lanes")
_FAR_M: Final = 20.0
"""Networks give futures in these units."""


NETWORKS: Final[Mapping[Size, NetworkSize]] = {
    "compact": NetworkSize(
        encoder=EncoderSize(width=64, heads=4, layers=2),
        settings=TrainingSettings(epochs=8, batch=64, learning_rate=1e-3, patience=8),
    ),
    "published": NetworkSize(
        encoder=EncoderSize(width=256, heads=8, layers=3),
        settings=TrainingSettings(epochs=20, batch=32, learning_rate=1e-4, weight_decay=1e-2, patience=20),
    ),
}


def recipe(size: Size = "compact", perturbed: float = 0.5, past_dropped: float = 0.0) -> Recipe:
    """`perturbed` and `past_dropped` are the shares of samples that start elsewhere or know no past of the ego."""
    seen = SIZES[size]
    return Recipe(
        planner="gameformer",
        what=f"GameFormer ({size}): joint futures over {1 + LEVELS} levels and a plan along the route; to be refined",
        size=size,
        options={"perturbed": perturbed, "past_dropped": past_dropped},
        fields=(*FIELDS, "agent_futures"),
        inputs=partial(inputs, size=size),
        targets=partial(targets, size=size),
        make_model=partial(GameFormer, NETWORKS[size].encoder, seen.predicted, seen.scene.future_steps),
        loss=loss,
        poses=_poses,
        graphs=_graphs,
        keep=lambda columns, _dataset: thinned(columns, seen.scene),
        augmented=partial(augmented, perturbation=Perturbation(share=perturbed), past_dropped=past_dropped),
        settings=NETWORKS[size].settings,
    )


class Level(NamedTuple):
    """What one level predicts of R road users, the ego first, in M modes."""

    means: Tensor
    """(B, R, M, T, 2) in the ego frame."""
    log_sigmas: Tensor
    """(B, R, M, T, 2) of the standard deviation along x and y, in metres."""
    logits: Tensor
    """(B, R, M) of the modes."""


class GameFormerOutput(NamedTuple):
    """What the network makes of a batch."""

    plan: Tensor
    """(B, 80, 3) poses of the ego."""
    levels: tuple[Level, ...]
    """From level 0 up."""


class GameFormer(nn.Module):
    """A scene encoder, a decoder per level and a plan head."""

    def __init__(self, size: EncoderSize, predicted: int, steps: int) -> None:
        super().__init__()
        self.road_users = 1 + predicted
        self.encoder = SceneEncoder(size)
        self.first = FirstLevel(size, self.road_users, steps)
        self.future = FutureEncoder(size.width, PLAN_STEPS * PLAN_STEP_S / steps)
        self.further = nn.ModuleList(FurtherLevel(size, steps) for _ in range(LEVELS))
        self.planner = PlanHead(size)

    def forward(
        self, ego: Tensor, agents: Tensor, lanes: Tensor, crosswalks: Tensor, route_lanes: Tensor
    ) -> GameFormerOutput:
        """From the arrays of `scene.scene_inputs`."""
        scene = self.encoder(ego, agents, lanes, crosswalks)
        now = torch.cat((ego[:, None, -1, :2], agents[:, : self.road_users - 1, -1, :2]), dim=1)
        content, level = self.first(scene, now)
        levels = [level]
        for layer in self.further:
            content, level = layer(scene, now, content, level, self.future(level.means.detach(), now))
            levels.append(level)
        return GameFormerOutput(self.planner(content[:, 0], route_lanes, ego[:, -1]), tuple(levels))


class FirstLevel(nn.Module):
    """Level 0: nobody knows what the others are going to do. Learned queries, one per road user and mode."""

    def __init__(self, size: EncoderSize, road_users: int, steps: int) -> None:
        super().__init__()
        self.mode = nn.Parameter(torch.randn(MODES, size.width))
        self.road_user = nn.Parameter(torch.randn(road_users, 1, size.width))
        self.attention = AttentionLayer(size)
        self.mixture = Mixture(size, steps)

    def forward(self, scene: EncodedScene, now: Tensor) -> tuple[Tensor, Level]:
        """Contents (B, R, M, width) and predictions, from places now (B, R, 2)."""
        tokens = scene.tokens[:, : now.shape[1], None]
        queries = (tokens + self.mode + self.road_user).flatten(1, 2)
        content = self.attention(queries, scene.tokens, scene.empty).unflatten(1, (now.shape[1], MODES))
        return content, self.mixture(content, now)


class FurtherLevel(nn.Module):
    """Level k: everyone knows the others' futures of level k - 1, and not its own."""

    def __init__(self, size: EncoderSize, steps: int) -> None:
        super().__init__()
        self.among = AttentionLayer(size)
        self.attention = AttentionLayer(size)
        self.mixture = Mixture(size, steps)

    def forward(
        self, scene: EncodedScene, now: Tensor, content: Tensor, before: Level, futures: Tensor
    ) -> tuple[Tensor, Level]:
        """Contents and predictions from those of the level before, and its futures as `FutureEncoder` gives them."""
        road_users = now.shape[1]
        empty = scene.empty[:, :road_users]
        expected = (futures * before.logits.softmax(dim=-1)[..., None]).sum(dim=2)
        interaction = self.among(expected, expected, empty)
        tokens = torch.cat((interaction, scene.tokens), dim=1)
        asking = torch.arange(road_users, device=tokens.device).repeat_interleave(MODES)
        own = asking[:, None] == torch.arange(tokens.shape[1], device=tokens.device)
        hidden = torch.cat((empty, scene.empty), dim=1)[:, None] | own
        queries = (content + futures).flatten(1, 2)
        content = self.attention(queries, tokens, hidden).unflatten(1, (road_users, MODES))
        return content, self.mixture(content, now)


class FutureEncoder(nn.Module):
    """Futures as tokens: a perceptron for each step, then the maximum over all; the same one for all levels.

    A step is its place, its direction and its velocity. The direction is a unit
    vector that fades out for who stands, not an angle, which would jump there and for who comes towards the ego.
    """

    def __init__(self, width: int, step_s: float) -> None:
        super().__init__()
        self.step_s = step_s
        self.layers = nn.Sequential(nn.Linear(6, width // 4), nn.ReLU(), nn.Linear(width // 4, width))

    def forward(self, means: Tensor, now: Tensor) -> Tensor:
        """(B, R, M, width) from (B, R, M, T, 2) and places now (B, R, 2)."""
        start = now[:, :, None, None].expand(-1, -1, means.shape[2], -1, -1)
        velocity = (means - torch.cat((start, means[:, :, :, :-1]), dim=3)) / self.step_s
        direction = velocity / (velocity.square().sum(dim=-1, keepdim=True) + 0.1).sqrt()
        return self.layers(torch.cat((means / _FAR_M, direction, velocity / 10.0), dim=-1)).amax(dim=3)


class Mixture(nn.Module):
    """Gaussians around futures that begin where everyone is now, and how likely each is."""

    def __init__(self, size: EncoderSize, steps: int) -> None:
        super().__init__()
        width = size.width
        self.steps = steps
        self.futures = nn.Sequential(
            nn.Linear(width, 2 * width), nn.ELU(), nn.Dropout(size.dropout), nn.Linear(2 * width, 4 * steps)
        )
        self.scores = nn.Sequential(nn.Linear(width, width // 4), nn.ELU(), nn.Linear(width // 4, 1))

    def forward(self, content: Tensor, now: Tensor) -> Level:
        found = self.futures(content).unflatten(-1, (self.steps, 4))
        means = now[:, :, None, None] + _FAR_M * found[..., :2]
        return Level(means, found[..., 2:].clamp(-LOG_SIGMA, LOG_SIGMA), self.scores(content)[..., 0])


class PlanHead(nn.Module):
    """Looks at the route, and gives controls that are driven out: a plan that a car could drive."""

    def __init__(self, size: EncoderSize) -> None:
        super().__init__()
        self.route = LineEncoder(("x", "y", "yaw"), size.width)
        self.attention = AttentionLayer(size)
        last = nn.Linear(size.width, 2 * PLAN_STEPS)
        # at first about straight on, as fast as now
        nn.init.uniform_(last.weight, -1e-3, 1e-3)
        nn.init.zeros_(last.bias)
        self.controls = nn.Sequential(nn.Linear(2 * size.width, size.width), nn.ELU(), nn.Dropout(size.dropout), last)

    def forward(self, content: Tensor, route_lanes: Tensor, ego: Tensor) -> Tensor:
        """(B, 80, 3) from the ego's contents (B, M, width) of the last level and its present state (B, C)."""
        tokens, empty = self.route(route_lanes)
        found = torch.cat((content, self.attention(content, tokens, empty)), dim=-1).amax(dim=1)
        return driven(self.controls(found).unflatten(-1, (PLAN_STEPS, 2)).tanh(), ego)


def driven(controls: Tensor, ego: Tensor) -> Tensor:
    """(B, T, 3) poses from controls (B, T, 2) between -1 and 1, shares of the largest acceleration and curvature.

    The largest curvature is that of the narrowest bend, or what `LATERAL_MPS2` allows at
    that speed. `ego` (B, C) is its present state; nobody drives backwards. Sums are
    products with a triangle of ones, which CUDA also computes the same each time.
    """
    summed = torch.ones(controls.shape[1], controls.shape[1], device=controls.device).triu()
    velocity = ego[:, (EGO_CHANNELS.index("vx"), EGO_CHANNELS.index("vy"))]
    speed = velocity.square().sum(dim=-1, keepdim=True).sqrt()
    step_m = PLAN_STEP_S * (speed + ACCELERATION_MPS2 * PLAN_STEP_S * controls[..., 0] @ summed).clamp(min=0.0)
    allowed = LATERAL_MPS2 / (step_m.detach() / PLAN_STEP_S).square().clamp(min=LATERAL_MPS2 / CURVATURE_PER_M)
    yaw = (allowed * controls[..., 1] * step_m) @ summed
    return torch.stack(((step_m * yaw.cos()) @ summed, (step_m * yaw.sin()) @ summed, yaw), dim=-1)


# --- learning ------------------------------------------------------------------------------------


def targets(arrays: Columns, size: Size) -> Columns:
    """Where ego and agents will be, and the ego's next 8 s.

    `futures` (B, R, T, 2) and `futures_valid` (B, R, T) of the ego and of the
    agents that are predicted; `wanted` (B, 80, 3) and `wanted_valid` (B, 80).
    """
    futures, valid = scene_futures(arrays, SIZES[size].scene)
    road_users = 1 + SIZES[size].predicted
    wanted = arrays["ego_future"]
    return {
        "futures": futures[:, :road_users, :, :2],
        "futures_valid": valid[:, :road_users],
        "wanted": wanted[..., :3].astype(np.float32),
        "wanted_valid": wanted[..., 3] > 0.5,
    }


def loss(model: nn.Module, batch: Batch, _done: float) -> Tensor:
    """Every level's loss, and the plan's."""
    outcome: GameFormerOutput = model(*(batch[name] for name in INPUTS))
    levels = [level_loss(level, batch["futures"], batch["futures_valid"]) for level in outcome.levels]
    return torch.stack(levels).sum() + plan_loss(outcome.plan, batch["wanted"], batch["wanted_valid"])


def level_loss(level: Level, futures: Tensor, valid: Tensor) -> Tensor:
    """Negative log likelihood of futures (B, R, T, 2) in the mode nearest to them, and cross-entropy of that mode.

    The nearest mode is each road user's own; steps that are not `valid` (B, R, T) are left out.
    """
    known = valid.any(dim=-1)
    count = valid.sum(dim=-1).clamp(min=1)
    off = futures[:, :, None] - level.means
    distance = (off.detach().square().sum(dim=-1) + 1e-9).sqrt() * valid[:, :, None]
    nearest = (distance.sum(dim=-1) / count[..., None]).argmin(dim=-1)
    rows = nearest[..., None, None, None].expand(-1, -1, 1, *off.shape[3:])
    off, log_sigma = off.gather(2, rows)[:, :, 0], level.log_sigmas.gather(2, rows)[:, :, 0]
    likelihood = (log_sigma + 0.5 * (off * (-log_sigma).exp()).square()).sum(dim=-1)
    scored = functional.cross_entropy(level.logits[known], nearest[known], label_smoothing=LABEL_SMOOTHING)
    return likelihood[valid].mean() + scored


def plan_loss(plan: Tensor, wanted: Tensor, valid: Tensor) -> Tensor:
    """Smooth L1 of x, y and yaw over the steps there are (B, T), and once more of the last of them."""
    off = pose_differences(plan, wanted)
    error = functional.smooth_l1_loss(off, torch.zeros_like(off), reduction="none").mean(dim=-1)
    last = (valid.sum(dim=-1, keepdim=True) - 1).clamp(min=0)
    ends = error.gather(1, last)[:, 0][valid[:, 0]]
    return error[valid].mean() + ends.mean()


def _poses(model: nn.Module, batch: Batch) -> Tensor:
    every = PLAN_STEPS // POSES
    return model(*(batch[name] for name in INPUTS)).plan[:, every - 1 :: every]


class GameFormerPlan(nn.Module):
    """What driving needs: the plan, and the agents' futures (B, A, M, T, 2) and scores (B, A, M) of the last level."""

    def __init__(self, model: nn.Module) -> None:
        super().__init__()
        self.model = model

    def forward(self, *given: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        outcome: GameFormerOutput = self.model(*given)
        last = outcome.levels[-1]
        return outcome.plan, last.means[:, 1:], last.logits[:, 1:]


def _graphs(model: nn.Module, batch: Batch) -> Mapping[str, GraphCall]:
    arguments = {name: batch[name] for name in INPUTS}
    return {"main": GraphCall(module=GameFormerPlan(model), arguments=arguments, outputs=("plan", "futures", "scores"))}
