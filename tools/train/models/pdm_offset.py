"""PDM-Offset's network and loss: PDM-Open's perceptron with a third input, PDM-Closed's plan, to correct.

The planner that drives with it is PDM-Hybrid.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import torch
from torch import Tensor, nn

from interplan_learned.card import Size
from interplan_learned.driving import POSES
from interplan_learned.pdm_hybrid.planner import CLOSED_PLAN, KEPT_POSES, inputs
from interplan_learned.pdm_open import planner as pdm_open
from interplan_sumo.dataset.columns import Columns
from interplan_sumo.dataset.reading import Dataset
from interplan_sumo.errors import InputError
from tools.train.augment import without_past
from tools.train.closed_plans import FIELDS, closed_plans
from tools.train.models.pdm_open import (
    CENTERLINE,
    EGO,
    check_history,
    embedding,
    head,
    mean_error,
    targets,
)
from tools.train.recipe import ALWAYS, Batch, GraphCall, Recipe, TrainingSettings


def recipe(size: Size = "published", history_s: float = 2.0, past_dropped: float = 0.0) -> Recipe:
    """PDM-Offset has one size, the published one: it trains in minutes, after PDM-Closed has planned for each sample.

    `history_s` is how much of the ego's past it sees, 0 to 2 s; `past_dropped`
    is the share of samples that know no past. Starts are not perturbed: what
    the network says moves the ego nowhere, and PDM-Closed would have to plan anew.
    """
    if size != "published":
        raise InputError(f"pdm_offset has no {size} network: the published one is small enough; leave --size away")
    check_history(history_s)
    return Recipe(
        planner="pdm_offset",
        what="PDM-Offset, for PDM-Hybrid: an MLP from the ego's past, the centre line and PDM-Closed's plan to a "
        "correction of this plan",
        size=size,
        options={"history_s": history_s, "past_dropped": past_dropped},
        fields=tuple(dict.fromkeys((*pdm_open.FIELDS, *FIELDS))),
        inputs=partial(inputs, history_s=history_s),
        targets=targets,
        make_model=PdmOffset,
        loss=loss,
        poses=poses,
        graphs=graphs,
        keep=keep,
        augmented=partial(without_past, share=past_dropped),
        settings=TrainingSettings(epochs=20, batch=64, learning_rate=5e-4, patience=25),
    )


class PdmOffset(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.ego = embedding(EGO)
        self.centerline = embedding(CENTERLINE)
        self.closed_plan = embedding(POSES * 3)
        self.head = head(3)

    def forward(self, ego: Tensor, centerline: Tensor, closed_plan: Tensor) -> Tensor:
        """Corrections (B, POSES, 3) from (B, 99), (B, 360) and (B, POSES, 3)."""
        codes = (self.ego(ego), self.centerline(centerline), self.closed_plan(closed_plan.flatten(1)))
        return self.head(torch.cat(codes, dim=-1)).reshape(-1, POSES, 3)


def keep(columns: Columns, dataset: Dataset) -> Columns:
    """What PDM-Open keeps, and PDM-Closed's plan for each sample; takes about 10 ms for each."""
    kept = {name: columns[name] for name in dict.fromkeys((*pdm_open.FIELDS, *ALWAYS))}
    return {**kept, CLOSED_PLAN: closed_plans(columns, dataset)}


def loss(model: nn.Module, batch: Batch, _done: float) -> Tensor:
    """`mean_error` of plans that are corrected from their first pose on, as published."""
    return mean_error(batch[CLOSED_PLAN] + _corrections(model, batch), batch)


def poses(model: nn.Module, batch: Batch) -> Tensor:
    """(B, POSES, 3) as PDM-Hybrid plans them: the first 2 s are PDM-Closed's."""
    later = torch.arange(POSES, device=batch[CLOSED_PLAN].device)[:, None] >= KEPT_POSES
    return batch[CLOSED_PLAN] + later * _corrections(model, batch)


def graphs(model: nn.Module, batch: Batch) -> Mapping[str, GraphCall]:
    """One, `main`."""
    return {"main": GraphCall(module=model, arguments=_arguments(batch), outputs=("correction",))}


def _corrections(model: nn.Module, batch: Batch) -> Tensor:
    return model(*_arguments(batch).values())


def _arguments(batch: Batch) -> dict[str, Tensor]:
    return {name: batch[name] for name in ("ego", "centerline", CLOSED_PLAN)}
