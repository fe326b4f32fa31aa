"""DTPP's network and loss: how the others answer to each branch of the tree, and what it costs, learned together.

Compact: the same method with a width of 64 instead of 256, two layers, half the branches, futures at 2 Hz.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from interplan_learned.card import Size
from interplan_learned.driving import POSES
from interplan_learned.dtpp.inputs import (
    BRANCH_CHANNELS,
    BRANCHES,
    EFFORT,
    FIELDS,
    SCENE,
    inputs,
    kept,
    shown,
    start_of,
)
from interplan_learned.dtpp.planner import plans
from interplan_learned.dtpp.sizes import SIZES
from interplan_learned.dtpp.tree import (
    FIRST_STEPS,
    STEP_S,
    STEPS,
    Branches,
    TreeStart,
    best_parents,
    first_stage,
    second_stage,
)
from interplan_learned.scene import AGENT_CHANNELS, scene_futures
from interplan_sumo.dataset.columns import Columns
from interplan_sumo.features.view import Arrays
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import Floats
from tools.train.augment import without_past
from tools.train.recipe import Batch, GraphCall, Recipe, TrainingSettings
from tools.train.scene_encoder import (
    AttentionLayer,
    EncodedScene,
    EncoderSize,
    NetworkSize,
    SceneEncoder,
)

LATENTS: Final = 4
"""Learned features of how a branch and the others get along."""
COLLISION_COST: Final = 10.0
COLLISION_PER_M2: Final = 0.2
"""An agent so many metres d from the ego costs `COLLISION_COST` exp(-`COLLISION_PER_M2` d^2)."""
STAGE_WEIGHTS: Final = (1.0, 0.2)
EGO_WEIGHT, SQUARES_WEIGHT = 0.1, 0.01
OFF_M: Final = (1.5, 4.0)
"""Samples whose best branch ends further from the expert than this, after 3 s or 8 s, teach nothing."""
_FAR_M: Final = 20.0
"""Networks give futures in these units."""
_NEVER: Final = -1e4
_VX, _VY, _LENGTH = (AGENT_CHANNELS.index(name) for name in ("vx", "vy", "length"))
_THERE = BRANCH_CHANNELS.index("there")
_START: Final = ("paths", "paths_valid", "speed_mps", "acceleration_mps2", "limit_mps")


NETWORKS: Final[Mapping[Size, NetworkSize]] = {
    "compact": NetworkSize(
        encoder=EncoderSize(width=64, heads=4, layers=2),
        settings=TrainingSettings(epochs=10, batch=64, learning_rate=1e-3, patience=8),
    ),
    "published": NetworkSize(
        encoder=EncoderSize(width=256, heads=8, layers=3),
        settings=TrainingSettings(epochs=30, batch=16, learning_rate=2e-4, weight_decay=1e-2, patience=30),
    ),
}


def recipe(size: Size = "compact", past_dropped: float = 0.0) -> Recipe:
    """`past_dropped` is the share of samples that know no past of the ego.

    Starts are not perturbed, as published: the branches begin where the ego is, whatever it did before.
    """
    return Recipe(
        planner="dtpp",
        what=f"DTPP ({size}): scores of the branches of a tree, given how the agents are predicted to answer to each",
        size=size,
        options={"past_dropped": past_dropped},
        fields=(*FIELDS, "agent_futures"),
        inputs=partial(inputs, size=size),
        targets=partial(targets, size=size),
        make_model=partial(Dtpp, NETWORKS[size].encoder, SIZES[size].scene.agents, SIZES[size].scene.future_steps),
        loss=loss,
        poses=partial(_poses, size=size),
        graphs=_graphs,
        keep=lambda columns, _dataset: dict(kept(columns, size)),
        augmented=partial(without_past, share=past_dropped),
        settings=NETWORKS[size].settings,
    )


class Answers(NamedTuple):
    """What the network makes of M branches, A agents and T steps."""

    scores: Tensor
    """(B, M), higher is better."""
    futures: Tensor
    """(B, M, A, T, 2) in the ego frame: where the agents would be if the ego took this branch."""
    weights: Tensor
    """(B, 4 + LATENTS) of the terms of the cost, none negative."""


class Dtpp(nn.Module):
    """A scene encoder, and a decoder for the branches of either stage."""

    def __init__(self, size: EncoderSize, agents: int, steps: int) -> None:
        super().__init__()
        self.encoder = SceneEncoder(size)
        self.decoder = BranchDecoder(size, agents, steps)
        self.ego = nn.Sequential(nn.Linear(size.width, size.width), nn.ReLU(), nn.Linear(size.width, 2 * steps))
        self.steps = steps

    def expected(self, scene: EncodedScene) -> Tensor:
        """(B, T, 2) where the ego would be: only to learn from, nobody drives it."""
        return _FAR_M * self.ego(scene.tokens[:, 0]).unflatten(-1, (self.steps, 2))


class BranchDecoder(nn.Module):
    """Conditional prediction and cost of all branches in one pass; none of them sees another."""

    def __init__(self, size: EncoderSize, agents: int, steps: int) -> None:
        super().__init__()
        width = size.width
        self.agents, self.steps = agents, steps
        self.branch = BranchEncoder(width)
        self.asks = nn.Linear(2 * width, width)
        self.attention = AttentionLayer(size)
        self.future = nn.Sequential(
            nn.Linear(width, 2 * width), nn.ELU(), nn.Dropout(size.dropout), nn.Linear(2 * width, 2 * steps)
        )
        self.others = nn.Sequential(nn.Linear(width, width), nn.ReLU())
        self.latent = nn.Sequential(nn.Linear(2 * width, width), nn.ELU(), nn.Linear(width, LATENTS))
        self.weigh = nn.Sequential(
            nn.Linear(width, width // 2), nn.ELU(), nn.Linear(width // 2, len(EFFORT) + LATENTS), nn.Softplus()
        )

    def forward(self, tokens: Tensor, empty: Tensor, agents: Tensor, branches: Tensor, effort: Tensor) -> Answers:
        """From the encoder's scene, the agents' tracks (B, A, frames, C), and branches as `inputs.shown` gives them."""
        now = agents[:, :, -1]
        exists = (now[..., _LENGTH] > 0.0).to(tokens.dtype)
        content = self._content(tokens, empty, self.branch(branches))
        futures = self._futures(content[:, :, 1:], now)
        weights = self.weigh(tokens[:, 0])
        others = (self.others(content[:, :, 1:]) * exists[:, None, :, None]).amax(dim=2)
        latent = self.latent(torch.cat((content[:, :, 0], others), dim=-1))
        features = torch.cat((-effort[..., :1], effort[..., 1:], latent), dim=-1)  # to be fast is no cost but a gain
        cost = (features * weights[:, None]).sum(dim=-1) + collision_cost(branches, futures, exists)
        return Answers(-cost, futures, weights)

    def _content(self, tokens: Tensor, empty: Tensor, branches: Tensor) -> Tensor:
        """(B, M, 1 + A, width): what the ego and each agent find in the scene and in one branch (B, M, width)."""
        count, road_users = branches.shape[1], 1 + self.agents
        asking = torch.cat(
            (
                tokens[:, None, :road_users].expand(-1, count, -1, -1),
                branches[:, :, None].expand(-1, -1, road_users, -1),
            ),
            dim=-1,
        )
        number = torch.arange(count, device=tokens.device)
        foreign = number.repeat_interleave(road_users)[:, None] != number
        hidden = torch.cat(
            (
                empty[:, None].expand(-1, count * road_users, -1),
                foreign[None].expand(empty.shape[0], -1, -1),
            ),
            dim=-1,
        )
        found = self.attention(self.asks(asking).flatten(1, 2), torch.cat((tokens, branches), dim=1), hidden)
        return found.unflatten(1, (count, road_users))

    def _futures(self, content: Tensor, now: Tensor) -> Tensor:
        """(B, M, A, T, 2) from contents (B, M, A, width): how far from going on as now."""
        ahead_s = torch.arange(1, self.steps + 1, device=now.device) * (STEPS * STEP_S / self.steps)
        straight = now[:, :, None, :2] + ahead_s[:, None] * now[:, :, None, (_VX, _VY)]
        return straight[:, None] + _FAR_M * self.future(content).unflatten(-1, (self.steps, 2))


class BranchEncoder(nn.Module):
    """A branch as a token: a perceptron for each of its steps, then the maximum over those that there are."""

    scale: Tensor

    def __init__(self, width: int) -> None:
        super().__init__()
        usual = {"x": _FAR_M, "y": _FAR_M, "speed": 10.0, "acceleration": 3.0, "curvature": 0.1}
        scale = torch.tensor([usual.get(name, 1.0) for name in BRANCH_CHANNELS])
        self.register_buffer("scale", scale, persistent=False)
        self.steps = nn.Sequential(
            nn.Linear(len(BRANCH_CHANNELS), width // 2), nn.ReLU(), nn.Linear(width // 2, width), nn.ReLU()
        )
        self.last = nn.Linear(width, width)

    def forward(self, branches: Tensor) -> Tensor:
        """(B, M, width) from (B, M, T, C)."""
        return self.last((self.steps(branches / self.scale) * branches[..., _THERE:]).amax(dim=2))


def collision_cost(branches: Tensor, futures: Tensor, exists: Tensor) -> Tensor:
    """(B, M) how near the agents (B, A) that exist would come: summed over them, the mean over a branch's steps."""
    there = branches[..., _THERE]
    yaw = branches[..., 2]
    middle = branches[..., :2] + PACIFICA.rear_axle_to_center_m * torch.stack((yaw.cos(), yaw.sin()), dim=-1)
    squared = (futures - middle[:, :, None]).square().sum(dim=-1)
    near = ((-COLLISION_PER_M2 * squared).exp() * exists[:, None, :, None]).sum(dim=2)
    return COLLISION_COST * (near * there).sum(dim=-1) / there.sum(dim=-1).clamp(min=1.0)


# --- learning ------------------------------------------------------------------------------------


def targets(arrays: Columns, size: Size) -> Columns:
    """Which branches the expert was nearest to, and where everyone will be.

    The parents of the second stage are the leaves of the first that end nearest to
    the expert. `nearest` (B, 2) is the leaf with the least end error in each
    stage, `teaches` (B, 2) whether it is one to learn from, `first_valid` and
    `second_valid` (B, M) which there are; `futures` (B, A, T, 2) and `wanted`
    (B, T, 2) are those of the agents and of the ego; the rest is what the tree is grown from.
    """
    start, tree = start_of(arrays), SIZES[size].tree
    first = first_stage(start, tree)
    off_first = end_errors(first, arrays["ego_future"])
    second = second_stage(start, first, best_parents(-off_first, first.valid, tree.parents), tree)
    off = off_first, end_errors(second, arrays["ego_future"])
    known = arrays["ego_future"][:, (FIRST_STEPS - 1, STEPS - 1), 3] > 0.5
    near = np.stack([each.min(axis=1) for each in off], axis=1) <= OFF_M
    near |= ~known
    futures, valid = scene_futures(arrays, SIZES[size].scene)
    later = {f"second_{name}": values for name, values in shown(second, start, size).items()}
    return {
        **later,
        "first_valid": first.valid,
        "second_valid": second.valid,
        "nearest": np.stack([each.argmin(axis=1) for each in off], axis=1),
        "teaches": known & near.all(axis=1, keepdims=True),
        "futures": futures[:, 1:, :, :2],
        "futures_valid": valid[:, 1:],
        "wanted": futures[:, 0, :, :2],
        "wanted_valid": valid[:, 0],
        **{name: getattr(start, name) for name in _START},
    }


def end_errors(branches: Branches, future: NDArray[Any]) -> Floats:
    """(B, M) distances of the branches' ends from where the expert was then, of `ego_future` (B, 80, 4)."""
    ends = branches.motion[:, :, -1, :2] - future[:, None, branches.motion.shape[2] - 1, :2]
    return np.where(branches.valid, np.hypot(ends[..., 0], ends[..., 1]), np.inf)


def loss(model: nn.Module, batch: Batch, _done: float) -> Tensor:
    """Of both stages, and of what the ego token tells of the ego."""
    assert isinstance(model, Dtpp)
    scene = model.encoder(*(batch[name] for name in SCENE))
    total = EGO_WEIGHT * _smooth(model.expected(scene), batch["wanted"], batch["wanted_valid"])
    for stage, prefix in enumerate(("", "second_")):
        branches = batch[f"{prefix}branches"]
        answers = model.decoder(*scene, batch["agents"], branches, batch[f"{prefix}effort"])
        valid = batch["second_valid" if stage else "first_valid"]
        found = stage_loss(answers, branches, valid, batch["nearest"][:, stage], batch["teaches"][:, stage], batch)
        total = total + STAGE_WEIGHTS[stage] * found
    return total


def stage_loss(
    answers: Answers, branches: Tensor, valid: Tensor, nearest: Tensor, teaches: Tensor, batch: Batch
) -> Tensor:
    """Prediction error of the branch nearest to the expert, and cross-entropy of it among all that are valid."""
    rows = torch.arange(len(nearest), device=nearest.device)
    there = branches[rows, nearest, :, _THERE] > 0.5
    seen = batch["futures_valid"] & there[:, None] & teaches[:, None, None]
    predicted = _smooth(answers.futures[rows, nearest], batch["futures"], seen)
    logits = answers.scores.masked_fill(~valid, _NEVER)
    missed = functional.cross_entropy(logits, nearest, reduction="none") * teaches
    squares = SQUARES_WEIGHT * answers.weights.square().mean()
    return predicted + missed.sum() / teaches.sum().clamp(min=1) + squares


def _smooth(found: Tensor, wanted: Tensor, valid: Tensor) -> Tensor:
    """Mean smooth L1 of points (..., 2) where they are valid (...); 0 where none is."""
    error = functional.smooth_l1_loss(found, wanted, reduction="none").mean(dim=-1) * valid
    return error.sum() / valid.sum().clamp(min=1)


# --- driving -------------------------------------------------------------------------------------


def _poses(model: nn.Module, batch: Batch, size: Size) -> Tensor:
    assert isinstance(model, Dtpp)
    scene = model.encoder(*(batch[name] for name in SCENE))
    device = batch["agents"].device

    def decode(branches: Arrays) -> NDArray[Any]:
        given = [torch.from_numpy(branches[name]).to(device) for name in BRANCHES]
        return model.decoder(*scene, batch["agents"], *given).scores.detach().cpu().numpy()

    start = TreeStart(**{name: batch[name].cpu().numpy() for name in _START})
    every = STEPS // POSES
    return torch.from_numpy(plans(start, decode, size)[:, every - 1 :: every].astype(np.float32))


class Encoding(nn.Module):
    """The scene's tokens, and which of them are empty."""

    def __init__(self, encoder: SceneEncoder) -> None:
        super().__init__()
        self.encoder = encoder

    def forward(self, *given: Tensor) -> tuple[Tensor, Tensor]:
        scene: EncodedScene = self.encoder(*given)
        return scene.tokens, scene.empty


class Scoring(nn.Module):
    """Scores, and the futures they are made with."""

    def __init__(self, decoder: BranchDecoder) -> None:
        super().__init__()
        self.decoder = decoder

    def forward(self, *given: Tensor) -> tuple[Tensor, Tensor]:
        answers: Answers = self.decoder(*given)
        return answers.scores, answers.futures


def _graphs(model: nn.Module, batch: Batch) -> Mapping[str, GraphCall]:
    assert isinstance(model, Dtpp)
    seen = {name: batch[name] for name in SCENE}
    with torch.no_grad():
        scene = model.encoder(*seen.values())
    decoded = {"tokens": scene.tokens, "empty": scene.empty, **{name: batch[name] for name in ("agents", *BRANCHES)}}
    return {
        "encoder": GraphCall(module=Encoding(model.encoder), arguments=seen, outputs=("tokens", "empty")),
        "decoder": GraphCall(module=Scoring(model.decoder), arguments=decoded, outputs=("scores", "futures")),
    }
