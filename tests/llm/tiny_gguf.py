"""A language model of 30 000 random weights as a GGUF file, and a LoRA adapter for it: real files in a blink.

Layout after the GGUF specification, version 3: header, metadata, tensor
table, then the tensors at multiples of 32 bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

LAYERS, WIDTH, HEADS, KV_HEADS, FEED_FORWARD = 2, 32, 4, 2, 64
ALIGNMENT = 32
FLOAT32 = 0
TEMPLATE = (
    "{% for message in messages %}<|begin|>{{ message.role }}\n{{ message.content }}<|end|>\n{% endfor %}"
    "{% if add_generation_prompt %}<|begin|>assistant\n{% endif %}"
)
"""Without a question of its own, so that a system message alone is a prompt."""

Tensors = Mapping[str, NDArray[np.float32]]


def write_model(
    path: Path, seed: int = 0, *, template: str = TEMPLATE, merges: Sequence[str] = ("never merged",),
    splitting: str = "gpt-2", architecture: str = "llama", without: str = "",
) -> Path:  # fmt: skip
    """A Llama with shared keys that knows the bytes, what is merged of them, and the begin and the end of a turn."""
    tokens = [*_byte_letters(), *(merge.replace(" ", "") for merge in merges), "<|begin|>", "<|end|>"]
    shape = {
        "context_length": 4096, "embedding_length": WIDTH, "block_count": LAYERS, "feed_forward_length": FEED_FORWARD,
        "attention.head_count": HEADS, "attention.head_count_kv": KV_HEADS, "attention.layer_norm_rms_epsilon": 1e-5,
        "rope.dimension_count": WIDTH // HEADS,
    }  # fmt: skip
    words = {
        "model": "gpt2", "pre": splitting, "tokens": tokens, "token_type": [1] * (len(tokens) - 2) + [3, 3],
        "merges": list(merges), "eos_token_id": len(tokens) - 1,
    }  # fmt: skip
    metadata = {
        "general.architecture": architecture,
        "general.name": "tiny",
        **{f"{architecture}.{name}": value for name, value in shape.items()},
        **{f"tokenizer.ggml.{name}": value for name, value in words.items()},
        "tokenizer.chat_template": template,
    }
    rng, keys = np.random.default_rng(seed), WIDTH // HEADS * KV_HEADS
    inside = {
        "attn_q": (WIDTH, WIDTH), "attn_k": (keys, WIDTH), "attn_v": (keys, WIDTH), "attn_output": (WIDTH, WIDTH),
        "ffn_gate": (FEED_FORWARD, WIDTH), "ffn_up": (FEED_FORWARD, WIDTH), "ffn_down": (WIDTH, FEED_FORWARD),
    }  # fmt: skip
    shapes = {f"blk.{layer}.{name}": size for layer in range(LAYERS) for name, size in inside.items()}
    shapes["token_embd"] = (len(tokens), WIDTH)
    tensors = {name: rng.normal(0.0, 0.3, size) for name, size in shapes.items() if name != without}
    for name in ("output_norm", *(f"blk.{n}.{name}" for n in range(LAYERS) for name in ("attn_norm", "ffn_norm"))):
        tensors[name] = rng.uniform(0.5, 1.5, WIDTH)
    return _write(path, metadata, {f"{name}.weight": values.astype(np.float32) for name, values in tensors.items()})


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
