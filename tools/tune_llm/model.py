"""A model that learns: its weights of a GGUF file stand still, LoRA's changes of some of them learn."""

from __future__ import annotations

import io
import warnings
from collections.abc import Generator, Sequence
from contextlib import AbstractContextManager, contextmanager, redirect_stderr
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import peft
import torch
from gguf import GGUFReader, GGUFWriter
from torch import Tensor
from transformers.models.auto.modeling_auto import AutoModelForCausalLM

from interplan_sumo.errors import InputError
from interplan_sumo.world.files import replacing

TARGETS: Final = {
    "attn_q": "q_proj",
    "attn_k": "k_proj",
    "attn_v": "v_proj",
    "attn_output": "o_proj",
    "ffn_gate": "gate_proj",
    "ffn_up": "up_proj",
    "ffn_down": "down_proj",
}
"""The matrices of a layer that can be tuned: llama.cpp's names for them, and transformers'."""
UNREADABLE: Final = (OSError, ValueError, IndexError, KeyError, TypeError, AttributeError, NotImplementedError)
"""What gguf and transformers raise for files that are no models of a kind they know."""


@dataclass(frozen=True, slots=True)
class LoraSettings:
    """What learns. The changes are `alpha / rank * B A`; A is random at first, B zero."""

    targets: tuple[str, ...] = ("attn_q", "attn_v")
    rank: int = 16
    alpha: int = 16
    seed: int = 0


def metadata(path: Path) -> dict[str, Any]:
    """What a GGUF file says about its model. InputError for what is no Llama, or has parts that are unknown here."""
    try:
        fields = {name: field.contents() for name, field in GGUFReader(path).fields.items()}
    except UNREADABLE as error:
        raise InputError(f"cannot read the model {path}: {error or type(error).__name__}") from None
    family = fields.get("general.architecture")
    if family != "llama":
        raise InputError(f"{path} holds a model of the family {family!r}; only the family 'llama' can be tuned")
    if any(name.startswith("llama.rope.scaling") for name in fields):
        raise InputError(f"{path} stretches its positions (llama.rope.scaling), which is unknown here")
    return fields


class TunedModel:
    """The Llama of a GGUF file, in any quantisation that `gguf` knows, with LoRA's changes on it."""

    def __init__(self, path: Path, lora: LoraSettings, dtype: torch.dtype = torch.float32) -> None:
        """Matrices are multiplied in `dtype`, everything between is float32. InputError for files as in `metadata`."""
        metadata(path)
        try:
            with _in_silence():
                loaded_with: Any = AutoModelForCausalLM.from_pretrained(
                    path.parent,
                    gguf_file=path.name,
                    dtype=torch.float32,
                    local_files_only=True,
                    output_loading_info=True,
                )
        except UNREADABLE as error:
            raise InputError(f"cannot read the model {path}: {' '.join(str(error).split())}") from None
        llama, loaded = loaded_with
        if loaded["missing_keys"]:
            raise InputError(
                f"{path} has no tensor for {min(loaded['missing_keys'])}; it is no complete language model"
            )
        self._dtype = dtype
        self._head = llama.lm_head
        self._heads = {"q_proj": llama.config.num_attention_heads, "k_proj": llama.config.num_key_value_heads}
        self._alpha = lora.alpha
        names = [TARGETS[target] for target in lora.targets]
        with torch.random.fork_rng(), _in_silence():
            torch.manual_seed(lora.seed)
            self._peft: Any = peft.get_peft_model(
                llama, peft.LoraConfig(r=lora.rank, lora_alpha=lora.alpha, target_modules=names)
            )
        self._body = llama.model

    def learning(self) -> dict[str, Tensor]:
        """Everything that learns, by name, always in the same order."""
        return {name: values for name, values in self._peft.named_parameters() if values.requires_grad}

    def unchanged(self) -> AbstractContextManager[None]:
        """The model of the file, for the length of a block."""
        return self._peft.disable_adapter()

    def logits(self, sequences: Sequence[Sequence[int]], counts: Sequence[int]) -> Tensor:
        """Of the token after each of the last `counts` tokens of the sequences, one below the other: (N, vocabulary).

        What all sequences begin with is worked through once.
        """
        shared = min(_common(sequences), *(len(tokens) - n for tokens, n in zip(sequences, counts, strict=True)))
        rows = [list(tokens[shared:]) for tokens in sequences]
        width = max(map(len, rows))
        branches = torch.tensor([[*row, *[0] * (width - len(row))] for row in rows])
        with torch.autocast("cpu", self._dtype, enabled=self._dtype != torch.float32):
            trunk = None
            if shared:
                trunk = self._body(input_ids=torch.tensor([sequences[0][:shared]]), use_cache=True).cache
                trunk.batch_repeat_interleave(len(rows))
            states = self._body(input_ids=branches, cache=trunk, use_cache=shared > 0).last_hidden_state
        wanted = [states[at, len(row) - n : len(row)] for at, (row, n) in enumerate(zip(rows, counts, strict=True))]
        return self._head(torch.cat(wanted).float())

    def write_adapter(self, path: Path, name: str) -> None:
        """Write the changes for llama.cpp, as float16: half the size at a precision that activations do not have."""
        files = {theirs: ours for ours, theirs in TARGETS.items()}
        with replacing(path) as fresh:
            writer = GGUFWriter(fresh, "llama")
            writer.add_type("adapter")
            writer.add_name(name)
            writer.add_string("adapter.type", "lora")
            writer.add_float32("adapter.lora.alpha", self._alpha)
            for key, values in self.learning().items():
                *_, layer, _, matrix, part, _, _ = key.split(".")  # ... layers.0.self_attn.q_proj.lora_A.default.weight
                array = values.detach().numpy()
                if part == "lora_B" and matrix in self._heads:
                    array = _in_llama_cpp_order(array, self._heads[matrix])
                writer.add_tensor(f"blk.{layer}.{files[matrix]}.weight.{part.lower()}", array.astype(np.float16))
            writer.write_header_to_file()
            writer.write_kv_data_to_file()
            writer.write_tensors_to_file()
            writer.close()


@contextmanager
def _in_silence() -> Generator[None]:
    """Without the progress bars and the warnings by which the libraries speak to each other."""
    with warnings.catch_warnings(), redirect_stderr(io.StringIO()):
        warnings.simplefilter("ignore")
        yield


def _in_llama_cpp_order(rows: np.ndarray, heads: int) -> np.ndarray:
    """Rows of queries or keys: llama.cpp turns neighbours (2i, 2i + 1) of a head, transformers (i, i + half)."""
    return np.ascontiguousarray(rows.reshape(heads, 2, -1, rows.shape[1]).swapaxes(1, 2).reshape(rows.shape))


def _common(sequences: Sequence[Sequence[int]]) -> int:
    """How many tokens all sequences begin with."""
    ordered = sorted(tuple(sequence) for sequence in sequences)
    first, last = ordered[0], ordered[-1]
    return next((at for at, pair in enumerate(zip(first, last, strict=False)) if pair[0] != pair[1]), len(first))
