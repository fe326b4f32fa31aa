"""Recipes: all that training must know of one planner; each is a function `recipe` in its own module in `models`."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import pkgutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from interplan_learned.card import SIZES, Size
from interplan_sumo.dataset.columns import Columns
from interplan_sumo.dataset.reading import Dataset
from interplan_sumo.errors import InputError, UnknownNameError, check_names
from interplan_sumo.extras import library

if TYPE_CHECKING:
    from torch import Tensor, nn

Batch = Mapping[str, "Tensor"]
"""Inputs and targets by name, as tensors."""

_MODELS: Final = "tools.train.models"
ALWAYS: Final = ("ego_history", "ego_history_valid", "ego_future")
"""Fields that augmentation and errors are made of."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingSettings:
    """How long and how fast; the rate falls along a cosine from its first value to 0 over all epochs."""

    epochs: int = 40
    batch: int = 64
    learning_rate: float = 1e-3
    weight_decay: float = 1e-4
    patience: int = 10
    """Epochs without a lower held-out error before it stops."""
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("epochs", "batch", "learning_rate", "patience"):
            if not getattr(self, name) > 0:
                raise InputError(f"{name} is {getattr(self, name)}, expected more than 0")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GraphCall:
    """A part of the model to be written as ONNX: a module and how it is called."""

    module: nn.Module
    """Takes its arguments by place and gives a tensor or a tuple of them; the first axis of all is the sample."""
    arguments: Mapping[str, Tensor]
    """Example arguments by the names they get in the card, in order, of some held-out samples."""
    outputs: tuple[str, ...]
    """The names of what it gives, in order."""


def _as_they_are(columns: Columns, _of: Any) -> Columns:
    return columns


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recipe:
    """One planner's network and how it learns. Arrays are numpy with the sample first, batches the same as tensors."""

    planner: str
    what: str
    """One sentence for the card."""
    size: Size
    options: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """As given to `recipe`, defaults filled in; for the card."""
    fields: tuple[str, ...]
    """Of the schema; `ALWAYS` come along in any case."""
    inputs: Callable[[Columns], Columns]
    """What the network is given: the function that the planner drives with."""
    targets: Callable[[Columns], Columns]
    """What the loss needs beside the inputs."""
    make_model: Callable[[], nn.Module]
    loss: Callable[[nn.Module, Batch, float], Tensor]
    """Of a batch of inputs and targets, averaged; and the share of the training that is done, 0 to 1."""
    poses: Callable[[nn.Module, Batch], Tensor]
    """(B, POSES, 3) the plan for each sample; the held-out error is that of these."""
    graphs: Callable[[nn.Module, Batch], Mapping[str, GraphCall]]
    """The ONNX files to write, `main` for a single one, from the model and some held-out samples."""
    keep: Callable[[Columns, Dataset], Columns] = _as_they_are
    """What of the samples stays in memory, for `inputs` and `targets`: fewer rows and points, or tables made with the
    map. Must not change `inputs`. Read once, before the training."""
    augmented: Callable[[Columns, np.random.Generator], Columns] = _as_they_are
    """Samples as they are shown in one epoch, perturbed (see `augment`)."""
    settings: TrainingSettings = TrainingSettings()


def find_recipe(planner: str, size: str | None = None, options: Mapping[str, Any] | None = None) -> Recipe:
    """A planner's recipe, of its usual size by default; InputError for an unknown name, or without torch."""
    if planner not in recipe_names():
        raise UnknownNameError("planner to train", planner, recipe_names())
    if size is not None and size not in SIZES:
        raise UnknownNameError("size", size, SIZES)
    library("torch", "training", "train")
    make = importlib.import_module(f"{_MODELS}.{planner}").recipe
    given = dict(options or {})
    known = [name for name in inspect.signature(make).parameters if name != "size"]
    check_names(f"option of {planner}'s training", given, known)
    return make(**given) if size is None else make(size, **given)


def recipe_names() -> list[str]:
    """Planners that can be trained, without importing any."""
    folder = importlib.util.find_spec(_MODELS)
    places = list(folder.submodule_search_locations or ()) if folder else []
    return sorted(each.name for each in pkgutil.iter_modules([str(Path(p)) for p in places]))


def fields_of(recipe: Recipe) -> Sequence[str]:
    """All schema fields that training reads."""
    return tuple(dict.fromkeys((*recipe.fields, *ALWAYS)))
