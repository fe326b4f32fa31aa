"""UrbanDriver's network and loss: a PointNet for every polyline, then one attention with the ego as the only query.

As in nuPlan's open-loop model. Compact: the same with a width of 64 instead of
256, fewer vehicles and fewer lines.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final

import torch
from torch import Tensor, nn
from torch.nn import functional

from interplan_learned.card import Size
from interplan_learned.driving import POSES
from interplan_learned.urban_driver.planner import (
    FIELDS,
    LINE_CHANNELS,
    POINTS,
    SIZES,
    VEHICLE_CHANNELS,
    UrbanDriverSize,
    inputs,
    thinned,
)
from tools.train.augment import Perturbation, augmented
from tools.train.models.pdm_open import targets
from tools.train.recipe import Batch, GraphCall, Recipe, TrainingSettings
from tools.train.scene_encoder import Scale, pose_differences, sinusoids

INPUTS: Final = ("ego", "ego_valid", "vehicles", "vehicles_valid", "lines", "lines_valid")
FEATURES: Final = 8
"""Numbers of a point; those that a kind of polyline does not have are 0."""
AT_ONCE: Final = 1000
"""Polylines that are encoded together in training: what lies between the layers of more does not fit the cache, and
takes a third longer."""
LAYERS: Final = 3
HEADS: Final = 8
_NEVER = -1e4
"""Stands for minus infinity."""
_FAR_M = 20.0
"""The network gives places in units of this."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Learning:
    """What differs between the sizes beside `urban_driver.SIZES`."""

    width: int
    forward_m: float
    left_m: float
    turned_rad: float
    """How far from the driven line a drive may start, to both sides."""
    settings: TrainingSettings


LEARNING: Final[Mapping[Size, Learning]] = {
    "compact": Learning(
        width=64, forward_m=1.0, left_m=1.0, turned_rad=0.3,
        settings=TrainingSettings(epochs=20, batch=64, learning_rate=1e-3, patience=8),
    ),
    "published": Learning(
        width=256, forward_m=2.0, left_m=2.0, turned_rad=0.75,
        settings=TrainingSettings(epochs=100, batch=64, learning_rate=1e-4, patience=25),
    ),
}  # fmt: skip


def recipe(size: Size = "compact", perturbed: float = 0.5, agents_dropped: float = 0.5) -> Recipe:
    """UrbanDriver, compact by default.

    `perturbed` and `agents_dropped` are the shares of samples that start
    elsewhere or lose half of their agents. The past cannot be dropped: the ego's
    speed is in its past poses alone.
    """
    learning = LEARNING[size]
    perturbation = Perturbation(
        share=perturbed, forward_m=learning.forward_m, left_m=learning.left_m, turned_rad=learning.turned_rad
    )
    return Recipe(
        planner="urban_driver",
        what=f"UrbanDriver ({size}, open loop): polylines of vehicles and the map, one attention of the ego to them",
        size=size,
        options={"perturbed": perturbed, "agents_dropped": agents_dropped},
        fields=FIELDS,
        inputs=partial(inputs, size=size),
        targets=targets,
        make_model=partial(UrbanDriver, SIZES[size], learning.width),
        loss=loss,
        poses=_poses,
        graphs=_graphs,
        keep=lambda columns, _dataset: thinned(columns, size),
        augmented=partial(augmented, perturbation=perturbation, agents_dropped=agents_dropped),
        settings=learning.settings,
    )


# --- network -------------------------------------------------------------------------------------


class UrbanDriver(nn.Module):
    """Polylines become tokens of equal length, the ego's token looks at all, and a perceptron gives the poses."""

    kinds: Tensor
    scale: Tensor

    def __init__(self, size: UrbanDriverSize, width: int) -> None:
        super().__init__()
        self.width = width
        self.road_user_scale, self.line_scale = Scale(VEHICLE_CHANNELS), Scale(LINE_CHANNELS)
        self.polyline = PolylineEncoder(width)
        counts = (1, size.vehicles, *(count for _, count in size.lines))
        self.kind = nn.Embedding(len(counts), width)
        self.attention = EgoAttention(width)
        self.head = nn.Sequential(
            nn.Linear(width, 4 * width),
            nn.ReLU(),
            nn.Linear(4 * width, 4 * width),
            nn.ReLU(),
            nn.Linear(4 * width, POSES * 3),
        )
        kinds = torch.arange(len(counts)).repeat_interleave(torch.tensor(counts))
        self.register_buffer("kinds", kinds, persistent=False)
        self.register_buffer("scale", torch.tensor((_FAR_M, _FAR_M, 1.0)), persistent=False)

    def forward(
        self, ego: Tensor, ego_valid: Tensor, vehicles: Tensor, vehicles_valid: Tensor, lines: Tensor,
        lines_valid: Tensor,
    ) -> Tensor:  # fmt: skip
        """(B, POSES, 3) from the arrays of `urban_driver.inputs`."""
        road_users = torch.cat((_widened(ego)[:, None], vehicles), dim=1)
        seen = torch.cat((ego_valid[:, None], vehicles_valid), dim=1)
        whole = lines_valid[..., None].expand(-1, -1, POINTS)
        tokens = torch.cat(
            (
                self.polyline(self.road_user_scale(road_users), seen),
                self.polyline(_widened(self.line_scale(lines)), whole),
            ),
            dim=1,
        )
        tokens = functional.normalize(tokens, dim=-1) * self.width**0.5
        there = torch.cat((seen[..., 0], lines_valid), dim=1)
        found = self.attention(tokens, tokens + self.kind(self.kinds), there)
        return self.head(found).unflatten(-1, (POSES, 3)) * self.scale


class PolylineEncoder(nn.Module):
    """PointNet of three layers over the points of each polyline; a point knows its number along it."""

    places: Tensor

    def __init__(self, width: int) -> None:
        super().__init__()
        self.point = nn.Linear(FEATURES, width)
        self.layers = nn.ModuleList(PointNetLayer(width) for _ in range(LAYERS))
        self.register_buffer("places", sinusoids(POINTS, width), persistent=False)

    def forward(self, points: Tensor, valid: Tensor) -> Tensor:
        """(B, N, width) from points (B, N, P, 8) and whether they are valid (B, N, P); 0 where the first one is not.

        Points that are not valid are taken for the first one again, which changes no maximum.
        """
        there = valid[..., 0]
        points, valid = points[there], valid[there][..., None]
        points = torch.where(valid, points, points[:, :1])
        places = torch.where(valid, self.places[: points.shape[1]], self.places[:1])
        tokens = points.new_zeros((*there.shape, self.point.out_features))
        if self.training:
            parts = zip(points.split(AT_ONCE), places.split(AT_ONCE), strict=True)
            tokens[there] = torch.cat([self._tokens(*part) for part in parts])
        else:
            tokens[there] = self._tokens(points, places)
        return tokens

    def _tokens(self, points: Tensor, places: Tensor) -> Tensor:
        """(K, width) from points (K, P, 8) and what tells their places (K, P, width)."""
        features = self.point(points) + places
        for layer in self.layers:
            features = layer(features)
        return features.amax(dim=1)


class PointNetLayer(nn.Module):
    """Each point by itself, then together with the largest numbers among all points of its polyline."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.own = nn.Linear(width, width, bias=False)
        self.norm = nn.LayerNorm(width)
        self.joined = nn.Linear(width, width)
        self.from_all = nn.Linear(width, width, bias=False)

    def forward(self, features: Tensor) -> Tensor:
        """(K, P, width) from features of as many points.

        `joined` and `from_all` are the halves of one linear layer on a point's
        features and the largest ones; the latter's half is computed once.
        """
        own = self.norm(self.own(features)).relu()
        return self.joined(own) + self.from_all(own.amax(dim=1, keepdim=True))


class EgoAttention(nn.Module):
    """Multi-head attention with the first token as the only query."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.of_head = width // HEADS
        self.query, self.key, self.value, self.out = (nn.Linear(width, width) for _ in range(4))

    def forward(self, tokens: Tensor, keys: Tensor, there: Tensor) -> Tensor:
        """(B, width) from tokens and keys (B, N, width); only tokens that are `there` (B, N) are looked at."""
        query, key, value = (
            made(given).unflatten(-1, (HEADS, self.of_head)).transpose(1, 2)
            for made, given in ((self.query, tokens[:, :1]), (self.key, keys), (self.value, tokens))
        )
        logits = query @ key.transpose(-1, -2) * self.of_head**-0.5
        seen = logits.masked_fill(~there[:, None, None], _NEVER).softmax(dim=-1) @ value
        return self.out(seen.flatten(1))


def _widened(points: Tensor) -> Tensor:
    """Points with zeros up to eight numbers."""
    return functional.pad(points, (0, FEATURES - points.shape[-1]))


# --- learning ------------------------------------------------------------------------------------


def loss(model: nn.Module, batch: Batch, _done: float) -> Tensor:
    """Mean absolute error of x, y and yaw over the poses that there are; a full turn is none."""
    return plan_loss(_poses(model, batch), batch["wanted"], batch["wanted_valid"])


def plan_loss(plans: Tensor, wanted: Tensor, valid: Tensor) -> Tensor:
    """Of plans (B, POSES, 3) against wanted poses, where they are valid (B, POSES)."""
    return pose_differences(plans, wanted)[valid].abs().mean()


def _poses(model: nn.Module, batch: Batch) -> Tensor:
    return model(*(batch[name] for name in INPUTS))


def _graphs(model: nn.Module, batch: Batch) -> Mapping[str, GraphCall]:
    arguments = {name: batch[name] for name in INPUTS}
    return {"main": GraphCall(module=model, arguments=arguments, outputs=("poses",))}
