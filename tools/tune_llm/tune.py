"""From a file of examples to an adapter with its card: judge the model, tune it, judge it again."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import torch

from interplan_llm.models.fetch import default_model
from interplan_sumo.errors import InputError
from interplan_sumo.world.files import file_hash
from tools.tune_llm.card import Made, write_card
from tools.tune_llm.chat import ChatTokens
from tools.tune_llm.examples import as_samples, divided, read_examples
from tools.tune_llm.fitting import Fitting, FittingSettings
from tools.tune_llm.heldout import HeldOut, judged
from tools.tune_llm.model import TARGETS, TunedModel

SAY_EVERY_S = 10.0
WRITING_S = 20.0
"""Kept free for the files at the end."""
JUDGING_SPARE = 1.3
"""Times what judging took before, for judging after."""


def tune(given: argparse.Namespace) -> None:
    """Do what the command was given. InputError for files and settings that cannot be used."""
    began_s = time.monotonic()
    settings = _settings(given)
    torch.set_num_threads(settings.threads)
    base: Path = given.base or default_model()
    examples = read_examples(given.examples)
    chat = ChatTokens(base)
    model = TunedModel(base, settings.lora, getattr(torch, settings.precision))
    learned, held_out = divided(as_samples(examples, chat), given.held_out)
    checkpoint: Path = given.out.with_suffix(".checkpoint.pt")
    key = f"{file_hash(base)} {file_hash(given.examples)} {len(held_out)}"
    fitting = Fitting(model, learned, held_out, settings, checkpoint, key)
    tokens = sum(len(sample.read) for sample in learned)
    _say(f"{len(learned)} examples to learn from, {tokens} tokens; {len(held_out)} held out; {fitting.steps} steps")
    if given.resume:
        _say(f"resumed at step {fitting.resume()} of {fitting.steps}")

    judging_began_s = time.monotonic()
    with model.unchanged():
        before = judged(model, chat, held_out) if held_out else None
    judging_s = time.monotonic() - judging_began_s
    _say_judged("before", before)
    spent_s = time.monotonic() - began_s + JUDGING_SPARE * judging_s + WRITING_S
    fitted = fitting.run(60.0 * given.max_minutes - spent_s, _Line())
    after = judged(model, chat, held_out) if held_out else None
    _say_judged("after", after)

    model.write_adapter(given.out, given.out.stem)
    made = Made(given.out, base, given.examples, learned, held_out, settings, before, after, fitted)
    card: Path = given.out.with_suffix(".json")
    write_card(card, made)
    if fitted.ending == "out of time":
        _say(f"out of time at step {fitted.progress.step} of {fitted.steps}; --resume goes on from there")
    else:
        checkpoint.unlink(missing_ok=True)
    _say(f"wrote {given.out} ({given.out.stat().st_size / 1e6:.1f} MB) and {card}")


def _settings(given: argparse.Namespace) -> FittingSettings:
    targets = tuple(given.targets.split(","))
    unknown = sorted(set(targets) - set(TARGETS))
    if unknown:
        raise InputError(f"no target {unknown[0]!r}; there are {', '.join(TARGETS)}")
    return FittingSettings(
        epochs=given.epochs,
        rank=given.rank,
        alpha=given.rank,
        targets=targets,
        learning_rate=given.lr,
        schedule=given.schedule,
        batch=given.batch,
        seed=given.seed,
        precision=given.precision,
        threads=given.threads,
    )


class _Line:
    """A line of progress every few seconds, and after each look at held-out examples."""

    def __init__(self) -> None:
        self._began: tuple[float, int, int] | None = None
        self._said_s = 0.0
        self._looks = 0

    def __call__(self, fitting: Fitting) -> None:
        progress, now_s = fitting.progress, time.monotonic()
        if self._began is None:
            self._began = (now_s, progress.step, progress.tokens)
            self._looks = len(progress.losses)
            return
        looked = len(progress.losses) > self._looks
        if now_s - self._said_s < SAY_EVERY_S and not looked:
            return
        began_s, step, tokens = self._began
        took_s = max(now_s - began_s, 1e-9)
        left_min = (fitting.steps - progress.step) * took_s / (progress.step - step) / 60.0
        held_out = progress.losses[-1][2] if looked else None
        beside = "" if held_out is None else f", held-out loss {held_out:.4f}"
        rate = f"{(progress.tokens - tokens) / took_s:.0f} tokens/s, {left_min:.0f} min left"
        _say(f"step {progress.step} of {fitting.steps}: loss {fitting.loss:.4f}{beside}, {rate}")
        self._said_s, self._looks = now_s, len(progress.losses)


def _say_judged(when: str, judged: HeldOut | None) -> None:
    if judged is None:
        return
    said = [f"loss {judged.loss:.4f}"]
    for share, where in ((judged.agreement, ""), (judged.decisive, " where it is decisive")):
        if share is not None:
            low, high = share.interval
            said += [f"right choice{where} {share.count} of {share.of} ({share.value:.3f}, {low:.3f} to {high:.3f})"]
    _say(f"held out, {when}: {', '.join(said)}")


def _say(line: str) -> None:
    print(line, flush=True)
