"""LoRA adapters as GGUF files, named and shaped as llama.cpp expects them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from gguf import GGUFReader, GGUFWriter

from interplan_sumo.errors import InputError
from interplan_sumo.world.files import replacing
from tools.tune_llm.llama import TARGETS, LowRank, LowRankSettings

ALPHA = "adapter.lora.alpha"


def write_adapter(path: Path, adapter: LowRankSettings, name: str) -> None:
    """Write the changes as float16, half the size at a precision that the activations beside them do not have."""
    with replacing(path) as fresh:
        writer = GGUFWriter(fresh, "llama")
        writer.add_type("adapter")
        writer.add_name(name)
        writer.add_string("adapter.type", "lora")
        writer.add_float32(ALPHA, adapter.alpha)
        for target, change in adapter.changes.items():
            for layer in range(len(change.down)):
                for letter, values in (("a", change.down[layer]), ("b", change.up[layer])):
                    array = values.detach().numpy().astype(np.float16)
                    writer.add_tensor(f"blk.{layer}.{target}.weight.lora_{letter}", array)
        writer.write_header_to_file()
        writer.write_kv_data_to_file()
        writer.write_tensors_to_file()
        writer.close()


def read_adapter(path: Path) -> LowRankSettings:
    """The changes that a file holds. InputError if it is no adapter, or one with parts that are unknown here."""
    try:
        reader = GGUFReader(path)
        alpha = reader.fields[ALPHA].contents()
        tensors = {tensor.name: np.array(tensor.data, np.float32) for tensor in reader.tensors}
        changes = {
            target: LowRank(_stacked(tensors, target, "a"), _stacked(tensors, target, "b"))
            for target in TARGETS
            if f"blk.0.{target}.weight.lora_a" in tensors
        }
    except (OSError, ValueError, IndexError, KeyError) as error:
        raise InputError(f"cannot read the adapter {path}: {error or type(error).__name__}") from None
    if sum(2 * len(change.down) for change in changes.values()) != len(tensors):
        raise InputError(f"{path} changes tensors that are unknown here; known: {', '.join(TARGETS)}")
    return LowRankSettings(changes, float(alpha))


def _stacked(tensors: dict[str, np.ndarray], target: str, letter: str) -> torch.Tensor:
    layers = sum(name.endswith(f".{target}.weight.lora_{letter}") for name in tensors)
    return torch.from_numpy(np.stack([tensors[f"blk.{n}.{target}.weight.lora_{letter}"] for n in range(layers)]))
