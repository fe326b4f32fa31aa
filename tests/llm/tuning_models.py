"""A language model of 40 000 random weights to tune, as a GGUF file, and examples for it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from interplan_llm.models.protocol import Message

NEEDED = ("torch", "transformers", "peft", "gguf")
LAYERS, WIDTH, HEADS, KV_HEADS, FEED_FORWARD = 2, 32, 4, 2, 64
TEMPLATE = (
    "{% for message in messages %}<|begin|>{{ message.role }}\n{{ message.content }}<|end|>\n{% endfor %}"
    "{% if add_generation_prompt %}<|begin|>assistant\n{% endif %}"
)
MERGES = ("Ġ f", "o l", "ol l", "l e", "e f", "m e", "me r", "mer g", "Ġ Ġ", "s t", "st o", "sto p")
SYSTEM = "You choose. Distances in metres."
OPTIONS = ("follow", "merge_left", "merge_right", "stop")


def letters() -> list[str]:
    """The letter that stands for each byte in byte-level vocabularies: printable ones for themselves."""
    printable = [*range(33, 127), *range(161, 173), *range(174, 256)]
    others = iter(range(256, 512))
    return [chr(byte) if byte in printable else chr(next(others)) for byte in range(256)]


def write_llama(path: Path, seed: int = 0, **changed: str) -> Path:
    """A Llama of two layers with shared keys, in float32; `changed`: texts of its metadata, a tensor `without`."""
    import gguf

    writer = gguf.GGUFWriter(path, changed.get("architecture", "llama"))
    writer.add_context_length(4096)
    writer.add_embedding_length(WIDTH)
    writer.add_block_count(LAYERS)
    writer.add_feed_forward_length(FEED_FORWARD)
    writer.add_head_count(HEADS)
    writer.add_head_count_kv(KV_HEADS)
    writer.add_layer_norm_rms_eps(1e-5)
    writer.add_rope_dimension_count(WIDTH // HEADS)
    writer.add_tokenizer_model("gpt2")
    writer.add_tokenizer_pre(changed.get("splitting", "smollm"))
    tokens = [*letters(), *(merge.replace(" ", "") for merge in MERGES), "<|begin|>", "<|end|>"]
    writer.add_token_list(tokens)
    writer.add_token_types([1] * (len(tokens) - 2) + [3, 3])
    writer.add_token_merges(list(MERGES))
    writer.add_eos_token_id(len(tokens) - 1)
    writer.add_chat_template(changed.get("template", TEMPLATE))
    rng = np.random.default_rng(seed)
    shapes = {"token_embd": (len(tokens), WIDTH)}
    keys = WIDTH // HEADS * KV_HEADS
    for layer in range(LAYERS):
        inside = {
            "attn_q": (WIDTH, WIDTH), "attn_k": (keys, WIDTH), "attn_v": (keys, WIDTH), "attn_output": (WIDTH, WIDTH),
            "ffn_gate": (FEED_FORWARD, WIDTH), "ffn_up": (FEED_FORWARD, WIDTH), "ffn_down": (WIDTH, FEED_FORWARD),
        }  # fmt: skip
        shapes |= {f"blk.{layer}.{name}": shape for name, shape in inside.items()}
    for name, shape in shapes.items():
        if name == changed.get("without"):
            continue
        writer.add_tensor(f"{name}.weight", rng.normal(0.0, 0.3, shape).astype(np.float32))
    norms = ["output_norm", *(f"blk.{n}.{name}" for n in range(LAYERS) for name in ("attn_norm", "ffn_norm"))]
    for name in norms:
        writer.add_tensor(f"{name}.weight", rng.uniform(0.5, 1.5, WIDTH).astype(np.float32))
    writer.write_header_to_file()
    writer.write_kv_data_to_file()
    writer.write_tensors_to_file()
    writer.close()
    return path


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
