"""The training loop: a recipe, samples and a seed give weights; the same ones, also if it was interrupted."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from hashlib import sha256
from math import inf, isfinite
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from torch import Tensor, nn

from interplan_sumo.dataset.columns import Columns
from interplan_sumo.errors import InputError, InterplanError
from interplan_sumo.world.files import replacing
from tools.train.crew import Crew
from tools.train.data import Balanced, Samples
from tools.train.metrics import constant_velocity, plan_errors
from tools.train.recipe import Batch, Recipe

CLIP_NORM: Final = 5.0
_HELD_BATCH: Final = 256


@dataclass(frozen=True, slots=True)
class EpochDone:
    """What is told after each epoch."""

    epoch: int
    """Counted from 1."""
    epochs: int
    loss: float
    held_out_m: float
    """`ade` of the plans on the held-out samples."""
    best_m: float
    seconds: float
    """Since the training began, the parts before an interruption included."""


@dataclass(frozen=True, slots=True)
class Trained:
    """A model with its best weights, and how it came to them."""

    model: nn.Module
    held_out_m: tuple[float, ...]
    """The error on the held-out samples after each epoch, see `EpochDone`."""
    best_epoch: int
    seconds: float
    stopped: str
    """`epochs`, `patience` or `time`: why it ended."""

    @property
    def epochs(self) -> int:
        return len(self.held_out_m)


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """Where a training is kept after each epoch."""

    path: Path
    data_hash: str = ""
    resume: bool = False
    """Go on from it."""


def train(
    recipe: Recipe,
    samples: Samples,
    held: Samples,
    *,
    checkpoint: Checkpoint,
    device: str = "cpu",
    processes: int = 1,
    max_minutes: float | None = None,
    on_epoch: Callable[[EpochDone], None] = lambda _done: None,
) -> Trained:
    """Train; the weights of the epoch with the lowest held-out error are kept.

    After each epoch everything is in the checkpoint; a training that resumes goes
    on from there and comes to the same weights as without a break. Equal seeds
    give equal weights on the same kind of machine with as many processes, which share each batch.
    InputError if the checkpoint is of another training, or there is no such device.
    """
    _settle(device, processes)
    settings = recipe.settings
    torch.manual_seed(settings.seed)
    model = recipe.make_model().to(device)
    rule = torch.optim.AdamW(model.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay)
    falling = torch.optim.lr_scheduler.CosineAnnealingLR(rule, settings.epochs)
    state = _State(model, rule, falling, _fingerprint(recipe, checkpoint.data_hash, processes), checkpoint.path)
    if checkpoint.resume:
        state.read(device)
    balanced = Balanced(samples.columns["ego_future"])
    crew = Crew(model, processes)

    def learned(epoch: int) -> float:
        loss = _one_epoch(recipe, model, rule, samples, balanced, epoch, device, crew)
        falling.step()
        return loss

    def follow() -> None:
        for epoch in range(state.epoch, settings.epochs):
            learned(epoch)

    began = time.monotonic() - state.seconds
    stopped = "epochs"
    with crew.together(follow):
        while state.epoch < settings.epochs:
            if state.epoch - state.best_epoch >= settings.patience:
                stopped = "patience"
                break
            if max_minutes is not None and time.monotonic() - began >= 60.0 * max_minutes:
                stopped = "time"
                break
            loss = learned(state.epoch)
            error_m = held_out_errors(recipe, model, held, device)["ade"]
            if not isfinite(error_m):
                raise InterplanError(f"after epoch {state.epoch + 1} the plans are no numbers; give a --learning-rate")
            state.seconds = time.monotonic() - began
            state.done(error_m)
            on_epoch(EpochDone(state.epoch, settings.epochs, loss, error_m, state.best_m, state.seconds))
    model.load_state_dict(state.best)
    return Trained(model.eval(), tuple(state.held_out_m), state.best_epoch, state.seconds, stopped)


def tensors(columns: Columns, device: str = "cpu") -> Batch:
    """Arrays as tensors."""
    return {name: torch.from_numpy(np.ascontiguousarray(values)).to(device) for name, values in columns.items()}


def batch_of(recipe: Recipe, columns: Columns, device: str = "cpu") -> Batch:
    """Inputs and targets of some samples."""
    return tensors({**recipe.inputs(columns), **recipe.targets(columns)}, device)


def held_out_errors(recipe: Recipe, model: nn.Module, held: Samples, device: str = "cpu") -> dict[str, float]:
    """Open-loop errors (see `metrics.plan_errors`) of a model's plans."""
    was_training = model.training
    model.eval()
    with torch.no_grad():
        plans = [recipe.poses(model, batch_of(recipe, part, device)).cpu().numpy() for part in _parts(held)]
    model.train(was_training)
    return plan_errors(np.concatenate(plans), held.columns["ego_future"])


def constant_velocity_errors(held: Samples) -> dict[str, float]:
    """The same of plans that keep the present velocity."""
    return plan_errors(constant_velocity(held.columns["ego_history"]), held.columns["ego_future"])


def _one_epoch(
    recipe: Recipe,
    model: nn.Module,
    rule: torch.optim.Optimizer,
    samples: Samples,
    balanced: Balanced,
    epoch: int,
    device: str,
    crew: Crew,
) -> float:
    """The mean loss of what this process of the crew looks at.

    All randomness is the seed's, the epoch's and the process's, so that an epoch does not depend on a break.
    """
    settings = recipe.settings
    rng = np.random.default_rng((settings.seed, epoch))
    seed = int(rng.integers(2**31))
    order = balanced.draw(rng)
    if crew.rank:
        rng = np.random.default_rng((settings.seed, epoch, crew.rank))
    torch.manual_seed(seed + crew.rank)
    model.train()
    total, count = 0.0, 0
    for first in range(0, len(order), settings.batch):
        drawn = order[first : first + settings.batch]
        rows = crew.part(drawn)
        rule.zero_grad(set_to_none=True)
        if len(rows):
            batch = batch_of(recipe, recipe.augmented(samples.picked(rows), rng), device)
            loss: Tensor = recipe.loss(model, batch, (epoch + first / len(order)) / settings.epochs)
            loss.backward()
            total, count = total + float(loss.detach()) * len(rows), count + len(rows)
        crew.agree(len(rows) / len(drawn))
        nn.utils.clip_grad_norm_(model.parameters(), CLIP_NORM)
        rule.step()
    return total / max(count, 1)


def _parts(held: Samples) -> Iterator[Columns]:
    for first in range(0, len(held), _HELD_BATCH):
        yield held.picked(np.arange(first, min(first + _HELD_BATCH, len(held))))


def _settle(device: str, processes: int) -> None:
    if device != "cpu" and processes > 1:
        raise InputError(f"only the processor is shared by processes, not {device!r}; leave --processes away")
    if device != "cpu" and not torch.cuda.is_available():
        raise InputError(f"there is no device {device!r} here; train with --device cpu")
    os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")  # what CUDA wants for equal results
    torch.use_deterministic_algorithms(True)
    # nothing reads what is not filled, and filling it takes 5 to 10 % of the time
    torch.utils.deterministic.fill_uninitialized_memory = False  # type: ignore[attr-defined]  # a module with a property
    torch.set_num_threads(1)


def _fingerprint(recipe: Recipe, data_hash: str, processes: int) -> str:
    """What a checkpoint must agree in with the training that goes on from it."""
    code = sha256(b"".join(path.read_bytes() for path in sorted(Path(__file__).parent.rglob("*.py"))))
    return json.dumps(
        {
            "planner": recipe.planner, "size": recipe.size, "options": dict(recipe.options),
            "settings": asdict(recipe.settings), "data": data_hash, "processes": processes, "code": code.hexdigest(),
        },
        sort_keys=True,
    )  # fmt: skip


class _State:
    """Where a training is, in memory and in its checkpoint."""

    def __init__(
        self,
        model: nn.Module,
        rule: torch.optim.Optimizer,
        falling: torch.optim.lr_scheduler.LRScheduler,
        fingerprint: str,
        path: Path,
    ) -> None:
        self._parts: dict[str, Any] = {"model": model, "rule": rule, "falling": falling}
        self._fingerprint, self._path = fingerprint, path
        self.held_out_m: list[float] = []
        self.best_epoch = 0
        self.best = _copied(model.state_dict())
        self.seconds = 0.0

    @property
    def epoch(self) -> int:
        """How many are done."""
        return len(self.held_out_m)

    @property
    def best_m(self) -> float:
        return min(self.held_out_m)

    def done(self, error_m: float) -> None:
        """Note an epoch and write the checkpoint."""
        self.held_out_m.append(error_m)
        if error_m < min(self.held_out_m[:-1], default=inf):
            self.best_epoch = self.epoch
            self.best = _copied(self._parts["model"].state_dict())
        self._path.parent.mkdir(parents=True, exist_ok=True)
        held = {
            "fingerprint": self._fingerprint, "held_out_m": self.held_out_m, "best_epoch": self.best_epoch,
            "best": self.best, "seconds": self.seconds,
            **{name: part.state_dict() for name, part in self._parts.items()},
        }  # fmt: skip
        with replacing(self._path) as fresh, fresh.open("wb") as file:
            torch.save(held, file)

    def read(self, device: str) -> None:
        """Go on from the checkpoint."""
        try:
            held = torch.load(self._path, map_location=device, weights_only=True)  # plain tensors, nothing is run
            fingerprint = held["fingerprint"]
        except FileNotFoundError:
            raise InputError(f"there is no checkpoint {self._path} to go on from; train without --resume") from None
        except Exception as error:
            why = " ".join(str(error).split())[:200]
            raise InputError(f"cannot read the checkpoint {self._path}: {why}; train without --resume") from None
        if fingerprint != self._fingerprint:
            raise InputError(
                f"the checkpoint {self._path} is of another training (planner, options, settings, processes, data "
                "or code differ); train without --resume"
            )
        for name, part in self._parts.items():
            part.load_state_dict(held[name])
        self.held_out_m, self.best_epoch = held["held_out_m"], held["best_epoch"]
        self.best, self.seconds = held["best"], held["seconds"]


def _copied(state: Mapping[str, Tensor]) -> dict[str, Tensor]:
    return {name: values.detach().clone() for name, values in state.items()}
