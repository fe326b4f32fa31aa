"""A language model of 20 000 random weights as a GGUF file, and a LoRA adapter for it: real files in a blink.

Layout after the GGUF specification, version 3: header, metadata, tensor
table, then the tensors at multiples of 32 bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

WIDTH, HEADS, FEED_FORWARD, CONTEXT = 32, 2, 64, 4096
ALIGNMENT = 32
FLOAT32 = 0

TEMPLATE = (
    "{% for message in messages %}[{{ message.role }}]{{ message.content }}\n{% endfor %}"
    "{% if add_generation_prompt %}[assistant]{% endif %}"
)
"""Without a question of its own, so that a system message alone is a prompt."""

Tensors = Mapping[str, NDArray[np.float32]]


def write_model(path: Path, seed: int = 0, *, template: str = TEMPLATE) -> Path:
    """A Llama of one layer that knows the bytes and one end token."""
    tokens = [*_byte_letters(), "<end>"]
    kinds = [1] * 256 + [3]  # normal, control
    metadata = {
        "general.architecture": "llama",
        "general.name": "tiny",
        "llama.context_length": CONTEXT,
        "llama.embedding_length": WIDTH,
        "llama.block_count": 1,
        "llama.feed_forward_length": FEED_FORWARD,
        "llama.attention.head_count": HEADS,
        "llama.attention.layer_norm_rms_epsilon": 1e-5,
        "llama.rope.dimension_count": WIDTH // HEADS,
        "tokenizer.ggml.model": "gpt2",
        "tokenizer.ggml.pre": "gpt-2",
        "tokenizer.ggml.tokens": tokens,
        "tokenizer.ggml.token_type": kinds,
        "tokenizer.ggml.merges": ["never merged"],
        "tokenizer.ggml.eos_token_id": 256,
        "tokenizer.chat_template": template,
    }
    rng = np.random.default_rng(seed)
    square = (WIDTH, WIDTH)
    shapes = {
        "token_embd.weight": (len(tokens), WIDTH),
        "output.weight": (len(tokens), WIDTH),
        **{f"blk.0.attn_{part}.weight": square for part in ("q", "k", "v", "output")},
        "blk.0.ffn_gate.weight": (FEED_FORWARD, WIDTH),
        "blk.0.ffn_up.weight": (FEED_FORWARD, WIDTH),
        "blk.0.ffn_down.weight": (WIDTH, FEED_FORWARD),
    }
    tensors = {name: rng.normal(0.0, 0.3, shape).astype(np.float32) for name, shape in shapes.items()}
    norms = ("output_norm.weight", "blk.0.attn_norm.weight", "blk.0.ffn_norm.weight")
    return _write(path, metadata, {**tensors, **{name: np.ones(WIDTH, np.float32) for name in norms}})


def write_adapter(path: Path, seed: int = 1, rank: int = 4) -> Path:
    """An adapter on the query and the output of the attention."""
    metadata = {
        "general.type": "adapter",
        "general.architecture": "llama",
        "adapter.type": "lora",
        "adapter.lora.alpha": float(rank),
    }
    rng = np.random.default_rng(seed)
    tensors: dict[str, NDArray[np.float32]] = {}
    for part in ("q", "output"):
        tensors[f"blk.0.attn_{part}.weight.lora_a"] = rng.normal(0.0, 1.0, (rank, WIDTH)).astype(np.float32)
        tensors[f"blk.0.attn_{part}.weight.lora_b"] = rng.normal(0.0, 1.0, (WIDTH, rank)).astype(np.float32)
    return _write(path, metadata, tensors)


def _byte_letters() -> list[str]:
    """The letter that stands for each byte in byte-level vocabularies: printable ones for themselves."""
    printable = [*range(33, 127), *range(161, 173), *range(174, 256)]
    others = iter(range(256, 512))
    return [chr(byte) if byte in printable else chr(next(others)) for byte in range(256)]


def _write(path: Path, metadata: Mapping[str, Any], tensors: Tensors) -> Path:
    head = b"GGUF" + struct.pack("<IQQ", 3, len(tensors), len(metadata))
    head += b"".join(_text(name) + _typed(value) for name, value in metadata.items())
    data = b""
    for name, values in tensors.items():
        shape = values.shape[::-1]  # innermost first
        head += _text(name) + struct.pack(f"<I{len(shape)}QIQ", len(shape), *shape, FLOAT32, len(data))
        data += _padded(values.tobytes())
    path.write_bytes(_padded(head) + data)
    return path


def _padded(content: bytes) -> bytes:
    return content + bytes(-len(content) % ALIGNMENT)


def _text(text: str) -> bytes:
    encoded = text.encode()
    return struct.pack("<Q", len(encoded)) + encoded


def _typed(value: Any) -> bytes:
    match value:
        case int():
            return struct.pack("<II", 4, value)
        case float():
            return struct.pack("<If", 6, value)
        case str():
            return struct.pack("<I", 8) + _text(value)
        case [str(), *_]:
            return struct.pack("<IIQ", 9, 8, len(value)) + b"".join(map(_text, value))
        case _:
            return struct.pack(f"<IIQ{len(value)}i", 9, 5, len(value), *value)
