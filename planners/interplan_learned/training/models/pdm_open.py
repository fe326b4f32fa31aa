"""PDM-Open's network and loss, as published: two linear layers of 512 joined by a perceptron; L1 on sixteen poses."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np
import torch
from torch import Tensor, nn

from interplan_learned.card import Size
from interplan_learned.driving import POSES
from interplan_learned.pdm_open import FIELDS, inputs
from interplan_learned.training.augment import Perturbation, perturbed_start, without_past
from interplan_learned.training.metrics import wanted_poses
from interplan_learned.training.recipe import Batch, GraphCall, Recipe, Settings
from interplan_sumo.dataset.columns import Columns
from interplan_sumo.errors import InputError

_WIDTH = 512
_EGO, _CENTERLINE = 11 * 9, 120 * 3


def recipe(
    size: Size = "published", history_s: float = 2.0, perturbed: float = 0.5, past_dropped: float = 0.0
) -> Recipe:
    """PDM-Open has one size, the published one: it trains in minutes.

    `history_s` is how much of the ego's past it sees, 0 to 2 s; `perturbed` and
    `past_dropped` are the shares of samples that start elsewhere or know no past.
    """
    if size != "published":
        raise InputError(f"pdm_open has no {size} network: the published one is small enough; leave --size away")
    if not 0.0 <= history_s <= 2.0:
        raise InputError(f"history_s is {history_s}, expected 0 to 2")
    return Recipe(
        planner="pdm_open",
        what="PDM-Open: an MLP from the ego's past and the centre line to 8 s of poses",
        size=size,
        options={"history_s": history_s, "perturbed": perturbed, "past_dropped": past_dropped},
        fields=FIELDS,
        inputs=partial(inputs, history_s=history_s),
        targets=targets,
        make_model=PdmOpen,
        loss=loss,
        poses=_poses,
        graphs=_graphs,
        augmented=partial(_augmented, perturbation=Perturbation(share=perturbed), past_dropped=past_dropped),
        settings=Settings(epochs=100, batch=64, learning_rate=5e-4, patience=25),
    )


class PdmOpen(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.ego = nn.Sequential(nn.Linear(_EGO, _WIDTH), nn.ReLU())
        self.centerline = nn.Sequential(nn.Linear(_CENTERLINE, _WIDTH), nn.ReLU())
        self.head = nn.Sequential(
            nn.Linear(2 * _WIDTH, _WIDTH),
            nn.Dropout(0.1),
            nn.ReLU(),
            nn.Linear(_WIDTH, _WIDTH),
            nn.ReLU(),
            nn.Linear(_WIDTH, POSES * 3),
        )

    def forward(self, ego: Tensor, centerline: Tensor) -> Tensor:
        """(B, POSES, 3) from (B, 99) and (B, 360)."""
        seen = torch.cat((self.ego(ego), self.centerline(centerline)), dim=-1)
        return self.head(seen).reshape(-1, POSES, 3)


def targets(arrays: Columns) -> Columns:
    """`wanted` (B, POSES, 3) and `wanted_valid` (B, POSES)."""
    wanted, valid = wanted_poses(arrays["ego_future"])
    return {"wanted": wanted, "wanted_valid": valid}


def loss(model: nn.Module, batch: Batch, _done: float) -> Tensor:
    """Mean absolute error of x, y and yaw over the poses that there are."""
    off = (_poses(model, batch) - batch["wanted"]).abs().mean(dim=-1)
    return off[batch["wanted_valid"]].mean()


def _poses(model: nn.Module, batch: Batch) -> Tensor:
    return model(batch["ego"], batch["centerline"])


def _graphs(model: nn.Module, batch: Batch) -> Mapping[str, GraphCall]:
    arguments = {name: batch[name] for name in ("ego", "centerline")}
    return {"main": GraphCall(module=model, arguments=arguments, outputs=("poses",))}


def _augmented(columns: Columns, rng: np.random.Generator, perturbation: Perturbation, past_dropped: float) -> Columns:
    return without_past(perturbed_start(columns, rng, perturbation), rng, past_dropped)
