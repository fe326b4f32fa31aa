"""The learning itself: AdamW over low-rank changes, with a checkpoint from which it goes on to the same end."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch

from interplan_sumo.errors import InputError
from interplan_sumo.world.files import replacing
from tools.tune_llm.examples import TokenSample, shuffled_batches
from tools.tune_llm.heldout import answer_losses, mean_loss
from tools.tune_llm.llama import Llama, LowRankSettings

GRADIENT_NORM = 0.3
"""Of interPlan's recipe, as are WEIGHT_DECAY and WARM_UP."""
WEIGHT_DECAY = 1e-3
WARM_UP = 0.03
"""Of all steps; the learning rate rises linearly over them."""
LOOKS_PER_EPOCH = 5
"""Looks at the held-out loss, each with a checkpoint."""
LOOKED_AT = 128
"""Held-out examples that a look takes in."""
PATIENCE = 3
"""Looks in a row without a smaller loss that end the learning."""
SPARE = 1.5
"""Times a step's duration that must be left for another one."""

Schedule = Literal["cosine", "constant"]
Ending = Literal["done", "no longer better", "out of time"]


@dataclass(frozen=True, slots=True)
class FittingSettings:
    """What decides the outcome, beside model and examples."""

    epochs: int = 1
    rank: int = 16
    alpha: float = 16.0
    targets: tuple[str, ...] = ("attn_q", "attn_v")
    learning_rate: float = 1e-3
    schedule: Schedule = "cosine"
    batch: int = 8
    seed: int = 0
    precision: str = "bfloat16"
    threads: int = 2


@dataclass(slots=True)
class Progress:
    """How far the learning has come."""

    step: int = 0
    best_loss: float = math.inf
    """Smallest held-out loss so far."""
    best_step: int = 0
    looks_since_best: int = 0
    seconds: float = 0.0
    tokens: int = 0
    losses: list[tuple[int, float, float | None]] = field(default_factory=list)
    """At each look: step, mean training loss since the one before, held-out loss."""


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """What came out."""

    adapter: LowRankSettings
    """With the smallest held-out loss, or the last one where nothing is held out."""
    progress: Progress
    steps: int
    """In full."""
    ending: Ending


class Fitting:
    """A model that learns from samples. The same in, the same out, on the same processor with the same threads."""

    def __init__(
        self,
        model: Llama,
        learned: Sequence[TokenSample],
        held_out: Sequence[TokenSample],
        settings: FittingSettings,
        checkpoint: Path,
        key: str,
    ) -> None:
        """`key` stands for model and examples in the checkpoint."""
        self._model = model
        self._learned = learned
        self._looked_at = held_out[:LOOKED_AT]
        self._settings = settings
        self._checkpoint = checkpoint
        self._key = json.dumps({"of": key, **asdict(settings)}, sort_keys=True)
        self._adapter = model.new_adapter(settings.targets, settings.rank, settings.alpha, settings.seed)
        self._tensors = self._adapter.tensors()
        self._best = {name: tensor.detach().clone() for name, tensor in self._tensors.items()}
        self._optimizer = torch.optim.AdamW(
            self._tensors.values(), lr=settings.learning_rate, weight_decay=WEIGHT_DECAY
        )
        self._progress = Progress()
        self._since_look: list[float] = []
        self._per_epoch = math.ceil(len(learned) / settings.batch)
        self.steps = self._per_epoch * settings.epochs
        self._look_every = max(self._per_epoch // LOOKS_PER_EPOCH, 1)

    def resume(self) -> int:
        """Take up the checkpoint; the step it was made at. InputError if there is none, or one of something else."""
        try:
            with np.load(self._checkpoint, allow_pickle=False) as stored:
                arrays = {name: stored[name] for name in stored.files}
            told = json.loads(str(arrays["told"]))
            if told["key"] != self._key:
                raise InputError(f"{self._checkpoint} was made with other examples or settings; leave out --resume")
            self._take_up(arrays, told)
        except OSError as error:
            raise InputError(f"nothing to resume at {self._checkpoint}: {error.strerror or error}") from None
        except (ValueError, KeyError, TypeError) as error:
            raise InputError(f"{self._checkpoint} is damaged ({error}); leave out --resume") from None
        return self._progress.step

    def run(self, limit_s: float, say: Callable[[Fitting], None]) -> Fitted:
        """Learn to the end, until held-out examples no longer gain by it, or for so many seconds.

        `say` is called after each step.
        """
        began_s = time.monotonic()
        before_s = self._progress.seconds
        ending: Ending = "done"
        longest_s = 0.0
        while self._progress.step < self.steps:
            if self._progress.looks_since_best >= PATIENCE:
                ending = "no longer better"
                break
            step_began_s = time.monotonic()
            if step_began_s + SPARE * longest_s - began_s > limit_s:
                ending = "out of time"
                break
            self._step()
            if self._progress.step % self._look_every == 0 or self._progress.step == self.steps:
                self._look()
                self._store()
            longest_s = max(longest_s, time.monotonic() - step_began_s)
            self._progress.seconds = before_s + time.monotonic() - began_s
            say(self)
        if ending == "out of time":
            self._store()
        return Fitted(self._kept(), self._progress, self.steps, ending)

    @property
    def progress(self) -> Progress:
        return self._progress

    @property
    def loss(self) -> float:
        """Mean training loss since the last look, or at it."""
        return float(np.mean(self._since_look)) if self._since_look else self._progress.losses[-1][1]

    def _step(self) -> None:
        epoch, at = divmod(self._progress.step, self._per_epoch)
        rng = np.random.default_rng((self._settings.seed, epoch))
        chosen = shuffled_batches(self._learned, self._settings.batch, rng)[at]
        samples = [self._learned[index] for index in chosen]
        for group in self._optimizer.param_groups:
            group["lr"] = self._settings.learning_rate * self._pace()
        self._optimizer.zero_grad()
        loss = answer_losses(self._model, samples, self._adapter).mean()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(list(self._tensors.values()), GRADIENT_NORM)
        self._optimizer.step()
        self._progress.step += 1
        self._progress.tokens += sum(len(sample.read) for sample in samples)
        self._since_look.append(loss.item())

    def _pace(self) -> float:
        """The share of the learning rate at this step."""
        warm = math.ceil(WARM_UP * self.steps)
        step = self._progress.step
        if step < warm:
            return (step + 1) / warm
        if self._settings.schedule == "constant":
            return 1.0
        return 0.5 * (1.0 + math.cos(math.pi * (step - warm) / max(self.steps - warm, 1)))

    def _look(self) -> None:
        held_out = mean_loss(self._model, self._looked_at, self._adapter) if self._looked_at else None
        progress = self._progress
        progress.losses.append((progress.step, self.loss, held_out))
        self._since_look.clear()
        if held_out is not None and held_out >= progress.best_loss:
            progress.looks_since_best += 1
            return
        progress.best_loss = math.inf if held_out is None else held_out
        progress.best_step = progress.step
        progress.looks_since_best = 0
        self._best = {name: tensor.detach().clone() for name, tensor in self._tensors.items()}

    def _kept(self) -> LowRankSettings:
        """The adapter with the best weights in it, of the last step where no look has come yet."""
        if self._progress.best_step:
            self._put(self._tensors, self._best)
        return self._adapter

    def _store(self) -> None:
        told = {"key": self._key, "progress": asdict(self._progress), "since_look": self._since_look}
        arrays = {f"now/{name}": tensor.detach().numpy() for name, tensor in self._tensors.items()}
        arrays |= {f"best/{name}": tensor.numpy() for name, tensor in self._best.items()}
        for name, tensor in self._tensors.items():
            arrays |= {f"adam/{name}/{part}": value.numpy() for part, value in self._optimizer.state[tensor].items()}
        with replacing(self._checkpoint) as fresh, fresh.open("wb") as file:
            np.savez(file, allow_pickle=False, told=np.array(json.dumps(told)), **arrays)

    def _take_up(self, arrays: dict[str, np.ndarray], told: dict[str, Any]) -> None:
        self._progress = Progress(**told["progress"])
        self._progress.losses = [(int(step), float(loss), held_out) for step, loss, held_out in self._progress.losses]
        self._since_look = list(told["since_look"])
        for kind, tensors in (("now", self._tensors), ("best", self._best)):
            self._put(tensors, {name: torch.from_numpy(arrays[f"{kind}/{name}"]) for name in tensors})
        for key, array in arrays.items():
            if key.startswith("adam/"):
                _, name, part = key.split("/")
                self._optimizer.state[self._tensors[name]][part] = torch.from_numpy(np.array(array))

    @torch.no_grad()
    def _put(self, tensors: dict[str, torch.Tensor], values: dict[str, torch.Tensor]) -> None:
        for name, tensor in tensors.items():
            tensor.copy_(values[name])
