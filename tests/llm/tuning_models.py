"""A language model to tune, and examples for it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from interplan_llm.models.protocol import Message
from tests.llm.tiny_gguf import write_model

NEEDED = ("torch", "transformers", "peft", "gguf")
MERGES = ("Ġ f", "o l", "ol l", "l e", "e f", "m e", "me r", "mer g", "Ġ Ġ", "s t", "st o", "sto p")
SYSTEM = "You choose. Distances in metres."
OPTIONS = ("follow", "merge_left", "merge_right", "stop")


def write_llama(path: Path, **changed: str) -> Path:
    """A model that merges letters; `changed`: texts of its metadata, a tensor `without`."""
    return write_model(path, seed=2, merges=MERGES, **{"splitting": "smollm", **changed})


def conversation(user: str, system: str = SYSTEM) -> tuple[Message, ...]:
    return Message("system", system), Message("user", user)


def line(number: int, split: str | None = None, answer: str = "") -> str:
    """An example whose answer can be read off its question, with options in an order of its own."""
    answer = answer or OPTIONS[number % len(OPTIONS)]
    order = np.random.default_rng(number).permutation(len(OPTIONS))
    choices = [OPTIONS[index] for index in order]
    turns = (("system", SYSTEM), ("user", f"Sign {answer[-3:]}{'.' * (number % 7)}"), ("assistant", answer))
    told = {"messages": [{"role": role, "content": text} for role, text in turns], "choices": choices}
    return json.dumps(told if split is None else {**told, "about": {"split": split}})


def write_examples(path: Path, learned: int = 20, held_out: int = 8, answer: str = "") -> Path:
    splits = ["train"] * learned + ["val"] * held_out
    lines = [line(number, split, answer) for number, split in enumerate(splits)]
    path.write_text("\n".join(lines), encoding="utf-8")
    return path
