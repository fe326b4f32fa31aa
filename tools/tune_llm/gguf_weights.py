"""What a GGUF file of the Llama family holds: shape, weights as float32, vocabulary."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from gguf import GGUFReader, dequantize
from numpy.typing import NDArray

from interplan_sumo.errors import InputError
from tools.tune_llm.chat import Vocabulary

Floats = NDArray[np.float32]

LAYER_MATRICES = ("attn_q", "attn_k", "attn_v", "attn_output", "ffn_gate", "ffn_up", "ffn_down")
LAYER_NORMS = ("attn_norm", "ffn_norm")
DEFAULT_ROPE_BASE = 10_000.0
"""llama.cpp's, where a file names none."""


@dataclass(frozen=True, slots=True)
class Shape:
    """The sizes of a Llama."""

    layers: int
    width: int
    heads: int
    kv_heads: int
    """Of keys and values; each serves `heads / kv_heads` heads of queries."""
    rope_base: float
    norm_epsilon: float

    @property
    def head_width(self) -> int:
        return self.width // self.heads


@dataclass(frozen=True, slots=True, eq=False)
class GgufModel:
    """A model as its file has it. Matrices are (outputs, inputs), rows of queries and keys in GGUF's order."""

    shape: Shape
    matrices: Mapping[str, Floats]
    """`token_embd`, `output` where it is not the same, `blk.N.attn_q` and so on."""
    norms: Mapping[str, Floats]
    """`output_norm`, `blk.N.attn_norm`, `blk.N.ffn_norm`."""
    vocabulary: Vocabulary


def read_model(path: Path) -> GgufModel:
    """A file in any quantisation that `gguf` knows. InputError for what is no Llama, or has parts unknown here."""
    try:
        reader = GGUFReader(path)
        fields = {name: field.contents() for name, field in reader.fields.items()}
        weights = {tensor.name: dequantize(tensor.data, tensor.tensor_type) for tensor in reader.tensors}
    except (OSError, ValueError, IndexError, KeyError, NotImplementedError) as error:
        raise InputError(f"cannot read the model {path}: {error or type(error).__name__}") from None
    shape = _shape(fields, path)
    named = {name.removesuffix(".weight"): np.array(values, np.float32) for name, values in weights.items()}
    norms = {"output_norm", *(f"blk.{n}.{name}" for n in range(shape.layers) for name in LAYER_NORMS)}
    matrices = {"token_embd", *(f"blk.{n}.{name}" for n in range(shape.layers) for name in LAYER_MATRICES)}
    missing = sorted((norms | matrices) - named.keys())
    unknown = sorted(named.keys() - norms - matrices - {"output"})
    if missing or unknown:
        what = f"has no tensor {missing[0]}" if missing else f"has a tensor {unknown[0]}, which is unknown here"
        raise InputError(f"{path} {what}; only plain Llamas can be tuned, such as the default model")
    return GgufModel(
        shape,
        {name: values for name, values in named.items() if name not in norms},
        {name: named[name] for name in norms},
        _vocabulary(fields, path),
    )


def _shape(fields: Mapping[str, Any], path: Path) -> Shape:
    architecture = fields.get("general.architecture")
    if architecture != "llama":
        raise InputError(f"{path} holds a model of the family {architecture!r}; only the family 'llama' can be tuned")
    heads = _needed(fields, "llama.attention.head_count", path)
    shape = Shape(
        layers=_needed(fields, "llama.block_count", path),
        width=_needed(fields, "llama.embedding_length", path),
        heads=heads,
        kv_heads=fields.get("llama.attention.head_count_kv", heads),
        rope_base=fields.get("llama.rope.freq_base", DEFAULT_ROPE_BASE),
        norm_epsilon=_needed(fields, "llama.attention.layer_norm_rms_epsilon", path),
    )
    turned = fields.get("llama.rope.dimension_count", shape.head_width)
    if shape.width % heads or heads % shape.kv_heads or turned != shape.head_width:
        raise InputError(f"{path}: {heads} heads of {turned} turned components do not make up {shape.width}")
    if any(name.startswith("llama.rope.scaling") for name in fields):
        raise InputError(f"{path} stretches its positions (llama.rope.scaling), which is unknown here")
    return shape


def _vocabulary(fields: Mapping[str, Any], path: Path) -> Vocabulary:
    kind = _needed(fields, "tokenizer.ggml.model", path)
    if kind != "gpt2":
        raise InputError(f"{path} has a tokenizer of the kind {kind!r}; only byte-pair encoding, 'gpt2', is known here")
    return Vocabulary(
        tokens=tuple(_needed(fields, "tokenizer.ggml.tokens", path)),
        kinds=tuple(_needed(fields, "tokenizer.ggml.token_type", path)),
        merges=tuple(_needed(fields, "tokenizer.ggml.merges", path)),
        splitting=fields.get("tokenizer.ggml.pre", "default"),
        template=_needed(fields, "tokenizer.chat_template", path),
        end_of_turn=_needed(fields, "tokenizer.ggml.eos_token_id", path),
        begin=fields.get("tokenizer.ggml.bos_token_id") if fields.get("tokenizer.ggml.add_bos_token") else None,
    )


def _needed(fields: Mapping[str, Any], name: str, path: Path) -> Any:
    if name not in fields:
        raise InputError(f"{path} does not say {name}; it is no complete language model")
    return fields[name]
