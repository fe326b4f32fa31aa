"""What a model is tuned on: conversations of a JSONL file, as text and as tokens, in batches of like length."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from interplan_llm.models.embedded import CONTEXT_TOKENS
from interplan_llm.models.protocol import Message
from interplan_sumo.errors import InputError

if TYPE_CHECKING:
    from tools.tune_llm.chat import ChatTokens

HELD_OUT_ONE_IN = 10
"""Of the lines that do not say what they are for."""
SORTED_BATCHES = 16
"""Batches are cut from so many batches' worth of examples, sorted by length."""

_ROLES = ["system", "user", "assistant"]
_SPLITS = {"train": False, "val": True}


@dataclass(frozen=True, slots=True)
class Example:
    """A question and the answer that is right."""

    messages: tuple[Message, ...]
    answer: str
    choices: tuple[str, ...] | None
    """What could have been answered, in the order in which it was offered; None for a free answer."""
    held_out: bool
    decisive: bool = True
    """Whether the other choices would have been worse, as far as that is known."""


@dataclass(frozen=True, slots=True)
class TokenSample:
    """An example as tokens."""

    example: Example
    prompt: tuple[int, ...]
    answer: tuple[int, ...]
    """With the token that ends the turn."""

    @property
    def read(self) -> tuple[int, ...]:
        """What the model reads to predict the answer: all but the last token."""
        return (*self.prompt, *self.answer[:-1])


def read_examples(path: Path) -> list[Example]:
    """The examples of a file, one JSON object a line: `messages`, and maybe `choices`, `about.split`, `about.decisive`.

    Lines without a split are held out by their own hash, one in ten, so that
    a line keeps its side when others come and go. Raises InputError.
    """
    try:
        lines = path.read_bytes().splitlines()
    except OSError as error:
        raise InputError(f"cannot read the examples {path}: {error.strerror}") from None
    examples = [_example(line, f"{path}:{number}") for number, line in enumerate(lines, 1) if line.strip()]
    if all(example.held_out for example in examples):
        raise InputError(f"{path} holds no examples to learn from")
    return examples


def as_samples(examples: Sequence[Example], chat: ChatTokens) -> list[TokenSample]:
    """The examples as the model reads them. InputError for one over the embedded model's context."""
    samples = [
        TokenSample(each, tuple(chat.prompt(each.messages)), (*chat.plain(each.answer), chat.end_of_turn))
        for each in examples
    ]
    longest = max(len(sample.prompt) + len(sample.answer) for sample in samples)
    if longest > CONTEXT_TOKENS:
        raise InputError(f"an example has {longest} tokens; the embedded model takes {CONTEXT_TOKENS}")
    return samples


def divided(samples: Sequence[TokenSample], at_most: int) -> tuple[list[TokenSample], list[TokenSample]]:
    """The samples to learn from; and those held out, in an order by chance, at most so many."""
    learned = [sample for sample in samples if not sample.example.held_out]
    held_out = [sample for sample in samples if sample.example.held_out]
    order = np.random.default_rng(0).permutation(len(held_out))[:at_most]
    return learned, [held_out[index] for index in order]


def in_batches(samples: Sequence[TokenSample], size: int) -> Iterator[list[int]]:
    """Indices of samples of like length, all of them once, in an order that depends on nothing else."""
    order = sorted(range(len(samples)), key=lambda index: len(samples[index].read))
    return (order[at : at + size] for at in range(0, len(order), size))


def shuffled_batches(samples: Sequence[TokenSample], size: int, rng: np.random.Generator) -> list[list[int]]:
    """Indices of samples, all of them once: by chance, but those of a batch of like length."""
    order = rng.permutation(len(samples)).tolist()
    pool = size * SORTED_BATCHES
    pools = (order[at : at + pool] for at in range(0, len(order), pool))
    sorted_order = [index for each in pools for index in sorted(each, key=lambda one: len(samples[one].read))]
    batches = [sorted_order[at : at + size] for at in range(0, len(sorted_order), size)]
    return [batches[at] for at in rng.permutation(len(batches)).tolist()]


def _example(line: bytes, where: str) -> Example:
    try:
        given = json.loads(line)
        turns = [(turn["role"], turn["content"]) for turn in given["messages"]]
    except (ValueError, TypeError, KeyError):
        raise InputError(f"{where}: no JSON object with messages of role and content") from None
    if [role for role, _ in turns] != _ROLES or not all(isinstance(text, str) for _, text in turns):
        raise InputError(f"{where}: the messages are not of the roles {', '.join(_ROLES)}, or not text")
    answer = turns[-1][1]
    messages = tuple(Message(role, text) for role, text in turns[:-1])
    about = given.get("about")
    told = about if isinstance(about, dict) else {}
    return Example(
        messages,
        answer,
        _choices(given, answer, where),
        held_out=_held_out(told.get("split"), line, where),
        decisive=told.get("decisive") is not False,
    )


def _choices(given: dict[str, Any], answer: str, where: str) -> tuple[str, ...] | None:
    choices = given.get("choices")
    if choices is None:
        return None
    if not isinstance(choices, list) or not all(isinstance(choice, str) and choice for choice in choices):
        raise InputError(f"{where}: choices are not a list of texts")
    if answer not in choices:
        raise InputError(f"{where}: the answer {answer!r} is not among the choices {', '.join(choices)}")
    return tuple(choices)


def _held_out(split: object, line: bytes, where: str) -> bool:
    if split is None:
        return int.from_bytes(hashlib.sha256(line.strip()).digest()[:8]) % HELD_OUT_ONE_IN == 0
    if split not in _SPLITS:
        raise InputError(f"{where}: about.split is {split!r}, expected {' or '.join(_SPLITS)}")
    return _SPLITS[str(split)]
