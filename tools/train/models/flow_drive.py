"""FlowDrive's network and loss: a rectified flow, told by where it ends, through blocks that the scene modulates.

Small enough for two processor cores: a width of 64, sixteen poses.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from interplan_learned.card import Size
from interplan_learned.driving import POSES
from interplan_learned.flow_drive.planner import CHANNELS, SCENE, carried, inputs, poses, told
from interplan_learned.scene import FIELDS, thinned
from interplan_sumo.dataset.columns import Columns
from interplan_sumo.errors import InputError
from tools.train.augment import Perturbation, augmented
from tools.train.metrics import wanted_poses
from tools.train.recipe import Batch, GraphCall, Recipe, TrainingSettings
from tools.train.scene_encoder import Attention, EncoderSize, LineEncoder, NetworkSize, SceneEncoder, sinusoids

SEEN: Final = ("ego", "agents", "lanes", "crosswalks", "route_lanes")
DRAWS: Final = 4
"""Of time and noise for each sample and step: scenes are dear, noise is not."""
STEPS: Final = 4
"""Of the flow, where held-out samples are looked at; as the planner drives."""
BLOCKS: Final = 3
"""Of the decoder, which is as wide as the encoder."""
_TIMES: Final = 64
"""Sines and cosines that tell the time of the flow."""


NETWORK: Final = NetworkSize(
    encoder=EncoderSize(width=64, heads=4, layers=2),
    settings=TrainingSettings(epochs=10, batch=64, learning_rate=1e-3, patience=8),
)


def recipe(size: Size = "compact", perturbed: float = 0.5, past_dropped: float = 0.0) -> Recipe:
    """`perturbed` and `past_dropped` are the shares of samples that start elsewhere or know no past of the ego.

    There is one size, ours: which numbers the published network has we do not know.
    """
    if size != "compact":
        raise InputError(f"flow_drive has no {size} network, its numbers are not known here; leave --size away")
    return Recipe(
        planner="flow_drive",
        what="FlowDrive (compact): a rectified flow from noise to 8 s of poses, given the scene",
        size=size,
        options={"perturbed": perturbed, "past_dropped": past_dropped},
        fields=FIELDS,
        inputs=inputs,
        targets=targets,
        make_model=partial(FlowDrive, NETWORK.encoder),
        loss=loss,
        poses=_poses,
        graphs=_graphs,
        keep=lambda columns, _dataset: thinned(columns, SCENE),
        augmented=partial(augmented, perturbation=Perturbation(share=perturbed), past_dropped=past_dropped),
        settings=NETWORK.settings,
    )


class Conditions(NamedTuple):
    """What the flow is given of a batch of scenes."""

    tokens: Tensor
    """(B, S, width): the scene, then the route."""
    empty: Tensor
    """(B, S) bool, as `EncodedScene.empty`."""


class FlowDrive(nn.Module):
    """A scene encoder, and the blocks that say where a plan on its way ends."""

    def __init__(self, size: EncoderSize) -> None:
        super().__init__()
        self.conditions = ConditionEncoder(size)
        self.flow = FlowDecoder(size)


class ConditionEncoder(nn.Module):
    """The scene as `SceneEncoder` sees it, and pieces of the route."""

    def __init__(self, size: EncoderSize) -> None:
        super().__init__()
        self.scene = SceneEncoder(size)
        self.route = LineEncoder(("x", "y", "yaw"), size.width)

    def forward(self, *given: Tensor) -> Conditions:
        """From the arrays of `scene.scene_inputs`, the route's last."""
        *seen, route_lanes = given
        scene = self.scene(*seen)
        route, no_route = self.route(route_lanes)
        return Conditions(torch.cat((scene.tokens, route), dim=1), torch.cat((scene.empty, no_route), dim=1))


class FlowDecoder(nn.Module):
    """A token for each pose; what they are, how old the flow is and what the ego does modulate every block."""

    position: Tensor

    def __init__(self, size: EncoderSize) -> None:
        super().__init__()
        width = size.width
        self.pose = nn.Linear(len(CHANNELS), width)
        self.register_buffer("position", sinusoids(POSES, width), persistent=False)
        self.time = nn.Sequential(nn.Linear(_TIMES, width), nn.SiLU(), nn.Linear(width, width))
        self.blocks = nn.ModuleList(FlowBlock(size) for _ in range(BLOCKS))
        self.last = Modulation(width, 2)
        self.norm = nn.LayerNorm(width, elementwise_affine=False)
        self.ends = nn.Linear(width, len(CHANNELS))

    def forward(self, tokens: Tensor, empty: Tensor, plans: Tensor, time: Tensor) -> Tensor:
        """(B, K, POSES, 4) where the flow ends, from `Conditions`, plans (B, K, POSES, 4) and their times (B, K, 1)."""
        rate = 1e3 ** (torch.arange(0, _TIMES, 2, device=time.device) / _TIMES)
        angle = time * rate
        condition = self.time(torch.cat((angle.sin(), angle.cos()), dim=-1)) + tokens[:, :1]
        found = self.pose(plans) + self.position
        for block in self.blocks:
            found = block(found, tokens, empty, condition)
        shift, scale = self.last(condition)
        return self.ends(self.norm(found) * (1.0 + scale) + shift)


class FlowBlock(nn.Module):
    """Poses look at one another, then at the scene, then think about it; each shifted, scaled and gated (Peebles and
    Xie 2023).
    """

    def __init__(self, size: EncoderSize) -> None:
        super().__init__()
        width = size.width
        self.modulation = Modulation(width, 9)
        self.norm = nn.LayerNorm(width, elementwise_affine=False)
        self.among = Attention(width, size.heads)
        self.scene = Attention(width, size.heads)
        self.perceptron = nn.Sequential(nn.Linear(width, 4 * width), nn.GELU(), nn.Linear(4 * width, width))

    def forward(self, found: Tensor, tokens: Tensor, empty: Tensor, condition: Tensor) -> Tensor:
        """(B, K, POSES, width) from as much, `Conditions` and what modulates each plan (B, K, width)."""
        parts = self.modulation(condition)
        seen = (self.norm(found) * (1.0 + parts[1]) + parts[0]).flatten(0, 1)
        among = self.among(seen, seen, torch.zeros_like(seen[..., 0], dtype=torch.bool))
        found = found + parts[2] * among.unflatten(0, found.shape[:2])
        seen = (self.norm(found) * (1.0 + parts[4]) + parts[3]).flatten(1, 2)
        found = found + parts[5] * self.scene(seen, tokens, empty).unflatten(1, found.shape[1:3])
        return found + parts[8] * self.perceptron(self.norm(found) * (1.0 + parts[7]) + parts[6])


class Modulation(nn.Module):
    """What a condition makes of the blocks: nothing at first."""

    def __init__(self, width: int, parts: int) -> None:
        super().__init__()
        self.parts = parts
        self.layer = nn.Linear(width, parts * width)
        nn.init.zeros_(self.layer.weight)
        nn.init.zeros_(self.layer.bias)

    def forward(self, condition: Tensor) -> tuple[Tensor, ...]:
        """As many parts (B, K, 1, width) of conditions (B, K, width)."""
        return self.layer(nn.functional.silu(condition))[:, :, None].chunk(self.parts, dim=-1)


# --- learning ------------------------------------------------------------------------------------


def targets(arrays: Columns) -> Columns:
    """`wanted` (B, POSES, 4) as `told`, and `wanted_valid` (B, POSES)."""
    wanted, valid = wanted_poses(arrays["ego_future"])
    return {"wanted": told(wanted), "wanted_valid": valid}


def loss(model: nn.Module, batch: Batch, _done: float) -> Tensor:
    """Mean square of how far the ends are off, for plans at times drawn uniformly between noise and the end.

    Poses beyond the end of a drive are noise that is asked for nothing.
    """
    assert isinstance(model, FlowDrive)
    tokens, empty = model.conditions(*(batch[name] for name in SEEN))
    wanted = batch["wanted"][:, None].expand(-1, DRAWS, -1, -1)
    valid = batch["wanted_valid"][:, None].expand(-1, DRAWS, -1)
    time, noise = torch.rand(len(wanted), DRAWS, 1, device=wanted.device), torch.randn_like(wanted)
    there = torch.where(valid[..., None], wanted, noise)
    plans = noise + time[..., None] * (there - noise)
    off = (model.flow(tokens, empty, plans, time) - wanted).square().mean(dim=-1)
    return off[valid].mean()


def _poses(model: nn.Module, batch: Batch) -> Tensor:
    """The plans without noise."""
    assert isinstance(model, FlowDrive)
    flow = model.flow
    tokens, empty = model.conditions(*(batch[name] for name in SEEN))
    device = tokens.device

    def ends(plans: NDArray[np.float32], time: NDArray[np.float32]) -> NDArray[Any]:
        given = torch.from_numpy(plans).to(device), torch.from_numpy(time).to(device)
        return flow(tokens, empty, *given).cpu().numpy()

    found = carried(np.zeros((len(tokens), 1, POSES, len(CHANNELS))), ends, STEPS)
    return torch.from_numpy(poses(found[:, 0])).to(device)


def _graphs(model: nn.Module, batch: Batch) -> Mapping[str, GraphCall]:
    assert isinstance(model, FlowDrive)
    arguments = {name: batch[name] for name in SEEN}
    with torch.no_grad():
        tokens, empty = model.conditions(*arguments.values())
    given = {
        "tokens": tokens,
        "empty": empty,
        "plans": batch["wanted"][:, None],
        "time": torch.linspace(0.0, 0.75, len(tokens))[:, None, None],
    }
    return {
        "encoder": GraphCall(module=model.conditions, arguments=arguments, outputs=("tokens", "empty")),
        "decoder": GraphCall(module=model.flow, arguments=given, outputs=("ends",)),
    }
