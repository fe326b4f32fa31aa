"""One training from the data set to the card."""

from __future__ import annotations

import platform
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import torch

import interplan_sumo
from interplan_learned.card import Card
from interplan_sumo.dataset.reading import Dataset, read_dataset
from interplan_sumo.dataset.records import SPLITS
from interplan_sumo.extras import library
from interplan_sumo.features import schema
from tools.train.data import held_out_split, read_samples
from tools.train.loop import (
    Checkpoint,
    EpochDone,
    Trained,
    batch_of,
    constant_velocity_errors,
    held_out_errors,
    train,
)
from tools.train.onnx_export import export_graphs, round_to_half
from tools.train.recipe import Recipe, find_recipe

_EXAMPLES = 16
"""Held-out samples on which ONNX is held against torch."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainRequest:
    """What to train, on what, and where it goes."""

    planner: str
    data: Path
    out: Path
    """Folder of the card and the weights."""
    work: Path
    """Folder of the checkpoint."""
    name: str | None = None
    """Of the weights; the planner's by default."""
    size: str | None = None
    options: dict[str, Any]
    settings: dict[str, Any]
    """Of `TrainingSettings`, where they differ from the recipe's own."""
    share: float = 1.0
    """Of the drives to learn from."""
    resume: bool = False
    device: str = "cpu"
    processes: int = 1
    """That share each batch."""
    max_minutes: float | None = None


def train_planner(request: TrainRequest, on_epoch: Callable[[EpochDone], None]) -> Card:
    """Train a planner's network, write it as ONNX with its card; the card. InputError for what cannot be used."""
    dataset = read_dataset(request.data)
    recipe = find_recipe(request.planner, request.size, request.options)
    recipe = replace(recipe, settings=replace(recipe.settings, **request.settings))
    name = request.name or request.planner
    held_split = held_out_split(dataset)
    samples, held = read_samples(dataset, "train", recipe, request.share), read_samples(dataset, held_split, recipe)
    trained = train(
        recipe, samples, held,
        checkpoint=Checkpoint(request.work / name / "checkpoint.pt", f"{dataset.hash} {len(samples)}", request.resume),
        device=request.device, processes=request.processes, max_minutes=request.max_minutes, on_epoch=on_epoch,
    )  # fmt: skip
    model = trained.model.cpu()
    round_to_half(model)
    errors: dict[str, Any] = {}
    for split in SPLITS[1:]:
        if len(dataset.split(split)):
            part = held if split == held_split else read_samples(dataset, split, recipe)
            errors[split] = {
                "samples": len(part),
                "network": held_out_errors(recipe, model, part),
                "constant_velocity": constant_velocity_errors(part),
            }
    examples = batch_of(recipe, held.picked(np.arange(min(_EXAMPLES, len(held)))))
    card = Card(
        planner=recipe.planner,
        what=recipe.what,
        size=recipe.size,
        parameters=sum(weights.numel() for weights in model.parameters()),
        options=dict(recipe.options),
        features_format=schema.FORMAT,
        graphs=export_graphs(recipe.graphs(model, examples), request.out, name),
        data=_data(dataset, len(samples)),
        training=_training(recipe, trained, held_split, request),
        errors=errors,
        versions=_versions(),
    )
    card.write(request.out / f"{name}.json")
    return card


def _data(dataset: Dataset, trained_on: int) -> dict[str, Any]:
    counts = dataset.manifest.counts
    return {"hash": dataset.hash, "drives": counts.drives, "samples": {**counts.by_split, "train": trained_on}}


def _training(recipe: Recipe, trained: Trained, held_split: str, request: TrainRequest) -> dict[str, Any]:
    return {
        **asdict(recipe.settings),
        "epochs_done": trained.epochs,
        "best_epoch": trained.best_epoch,
        "stopped_by": trained.stopped,
        "held_out_split": held_split,
        "held_out_m": [round(error_m, 4) for error_m in trained.held_out_m],
        "minutes": round(trained.seconds / 60.0, 1),
        "device": request.device,
        "processes": request.processes,
        "date": datetime.now(UTC).date().isoformat(),
    }


def _versions() -> dict[str, str]:
    named = {"numpy": np, "torch": torch, "onnx": library("onnx", "training", "train")}
    return {
        "interplan_sumo": interplan_sumo.__version__,
        "python": platform.python_version(),
        **{name: str(module.__version__) for name, module in named.items()},
    }
