"""PDM-Open's network and loss: two linear layers of 512 joined by a perceptron; L1 on sixteen poses.

As published, but for the dropout before the first rectifier: what a rectifier
lets through on average is more where its input is noisy, so a network that
learned with it plans too short a way without: on 100,800 samples 2.6 m, with an
error of 3.6 m instead of 2.3 m.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import torch
from torch import Tensor, nn

from interplan_learned.card import Size
from interplan_learned.driving import POSES
from interplan_learned.pdm_open.planner import FIELDS, inputs
from interplan_sumo.dataset.columns import Columns
from interplan_sumo.errors import InputError
from tools.train.augment import Perturbation, augmented
from tools.train.metrics import wanted_poses
from tools.train.recipe import Batch, GraphCall, Recipe, TrainingSettings

_WIDTH = 512
EGO, CENTERLINE = 11 * 9, 120 * 3
"""Numbers in `ego` and `centerline` of a sample."""


def recipe(
    size: Size = "published", history_s: float = 2.0, perturbed: float = 0.5, past_dropped: float = 0.0
) -> Recipe:
    """PDM-Open has one size, the published one: it trains in minutes.

    `history_s` is how much of the ego's past it sees, 0 to 2 s; `perturbed` and
    `past_dropped` are the shares of samples that start elsewhere or know no past.
    """
    if size != "published":
        raise InputError(f"pdm_open has no {size} network: the published one is small enough; leave --size away")
    check_history(history_s)
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
        augmented=partial(augmented, perturbation=Perturbation(share=perturbed), past_dropped=past_dropped),
        settings=TrainingSettings(epochs=40, batch=64, learning_rate=5e-4, patience=25),
    )


def check_history(history_s: float) -> None:
    """InputError if there is not so much of the ego's past."""
    if not 0.0 <= history_s <= 2.0:
        raise InputError(f"history_s is {history_s}, expected 0 to 2")


class PdmOpen(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.ego = embedding(EGO)
        self.centerline = embedding(CENTERLINE)
        self.head = head(2)

    def forward(self, ego: Tensor, centerline: Tensor) -> Tensor:
        """(B, POSES, 3) from (B, 99) and (B, 360)."""
        seen = torch.cat((self.ego(ego), self.centerline(centerline)), dim=-1)
        return self.head(seen).reshape(-1, POSES, 3)


def embedding(numbers: int) -> nn.Sequential:
    """From an input of so many numbers to its code."""
    return nn.Sequential(nn.Linear(numbers, _WIDTH), nn.ReLU())


def head(codes: int) -> nn.Sequential:
    """From so many codes, joined, to POSES * 3 numbers."""
    return nn.Sequential(
        nn.Linear(codes * _WIDTH, _WIDTH),
        nn.ReLU(),
        nn.Linear(_WIDTH, _WIDTH),
        nn.ReLU(),
        nn.Linear(_WIDTH, POSES * 3),
    )


def targets(arrays: Columns) -> Columns:
    """`wanted` (B, POSES, 3) and `wanted_valid` (B, POSES)."""
    wanted, valid = wanted_poses(arrays["ego_future"])
    return {"wanted": wanted, "wanted_valid": valid}


def loss(model: nn.Module, batch: Batch, _done: float) -> Tensor:
    """`mean_error` of the plans."""
    return mean_error(_poses(model, batch), batch)


def mean_error(poses: Tensor, batch: Batch) -> Tensor:
    """Mean absolute error of x, y and yaw of poses (B, POSES, 3) over those that there are."""
    off = (poses - batch["wanted"]).abs().mean(dim=-1)
    return off[batch["wanted_valid"]].mean()


def _poses(model: nn.Module, batch: Batch) -> Tensor:
    return model(batch["ego"], batch["centerline"])


def _graphs(model: nn.Module, batch: Batch) -> Mapping[str, GraphCall]:
    arguments = {name: batch[name] for name in ("ego", "centerline")}
    return {"main": GraphCall(module=model, arguments=arguments, outputs=("poses",))}
