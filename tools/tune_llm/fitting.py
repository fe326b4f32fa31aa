"""The learning itself: AdamW over low-rank changes, with a checkpoint from which it goes on to the same end."""

from __future__ import annotations

import json
import math
import pickle
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
import torch

from interplan_sumo.errors import InputError, InterplanError
from interplan_sumo.world.files import replacing
from tools.tune_llm.examples import TokenSample, shuffled_batches
from tools.tune_llm.heldout import answer_losses, mean_loss
from tools.tune_llm.model import LoraSettings, TunedModel

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
    alpha: int = 16
    targets: tuple[str, ...] = ("attn_q", "attn_v")
    learning_rate: float = 1e-3
    schedule: Schedule = "cosine"
    batch: int = 8
    seed: int = 0
    precision: str = "bfloat16"
    threads: int = 2

    @property
    def lora(self) -> LoraSettings:
        return LoraSettings(self.targets, self.rank, self.alpha, self.seed)


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
    """What came out, beside the model's changes: those with the smallest held-out loss, or the last where none is."""

    progress: Progress
    steps: int
    """In full."""
    ending: Ending


class Fitting:
    """A model that learns from samples. The same in, the same out, on the same processor with the same threads."""

    def __init__(
        self,
        model: TunedModel,
        learned: Sequence[TokenSample],
        held_out: Sequence[TokenSample],
        settings: FittingSettings,
        checkpoint: Path,
        key: str,
    ) -> None:
        """`key` stands for model and examples in the checkpoint."""
        self.model = model
        self._learned = learned
        self._looked_at = held_out[:LOOKED_AT]
        self._settings = settings
        self._checkpoint = checkpoint
        self._key = json.dumps({"of": key, **asdict(settings)}, sort_keys=True)
        self._tensors = model.learning()
        self._best = self._copied()
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
            stored = torch.load(self._checkpoint, weights_only=True)
            if stored["key"] != self._key:
                raise InputError(f"{self._checkpoint} was made with other examples or settings; leave out --resume")
            self._progress = Progress(**stored["progress"])
            self._since_look, self._best = stored["since_look"], stored["best"]
            self._put(stored["now"])
            self._optimizer.load_state_dict(stored["optimizer"])
        except OSError as error:
            raise InputError(f"nothing to resume at {self._checkpoint}: {error.strerror or error}") from None
        except (LookupError, ValueError, TypeError, RuntimeError, pickle.UnpicklingError) as error:
            why = " ".join(str(error).split())[:80]
            raise InputError(f"{self._checkpoint} is damaged ({why}); leave out --resume") from None
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
        if self._progress.best_step:
            self._put(self._best)
        return Fitted(self._progress, self.steps, ending)

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
        loss = answer_losses(self.model, samples).mean()
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
        held_out = mean_loss(self.model, self._looked_at) if self._looked_at else None
        if held_out is not None and not math.isfinite(held_out):
            raise InterplanError(f"at step {self._progress.step} the held-out loss is no number; give a smaller --lr")
        progress = self._progress
        progress.losses.append((progress.step, self.loss, held_out))
        self._since_look.clear()
        if held_out is not None and held_out >= progress.best_loss:
            progress.looks_since_best += 1
            return
        progress.best_loss = math.inf if held_out is None else held_out
        progress.best_step = progress.step
        progress.looks_since_best = 0
        self._best = self._copied()

    def _store(self) -> None:
        stored = {
            "key": self._key,
            "progress": asdict(self._progress),
            "since_look": self._since_look,
            "now": self._copied(),
            "best": self._best,
            "optimizer": self._optimizer.state_dict(),
        }
        with replacing(self._checkpoint) as fresh, fresh.open("wb") as file:
            torch.save(stored, file)

    def _copied(self) -> dict[str, torch.Tensor]:
        return {name: values.detach().clone() for name, values in self._tensors.items()}

    @torch.no_grad()
    def _put(self, values: dict[str, torch.Tensor]) -> None:
        for name, tensor in self._tensors.items():
            tensor.copy_(values[name])
