"""A Llama in torch: its weights stand still, low-rank changes to some of them learn.

Positions turn neighbouring components (2i, 2i + 1) of queries and keys, as
llama.cpp does with the rows in GGUF's order.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from tools.tune_llm.gguf_weights import LAYER_MATRICES, GgufModel

TARGETS = LAYER_MATRICES
"""The matrices of a layer that can be tuned."""


@dataclass(frozen=True, slots=True, eq=False)
class LowRank:
    """Changes of the matrices of one kind, one per layer: `scale * up @ down`, LoRA's B and A."""

    down: Tensor  # (layers, rank, inputs)
    up: Tensor  # (layers, outputs, rank)


@dataclass(frozen=True, slots=True, eq=False)
class LowRankSettings:
    """What is learned. `alpha / rank` scales the changes."""

    changes: dict[str, LowRank]
    """By target."""
    alpha: float

    @property
    def rank(self) -> int:
        return next(iter(self.changes.values())).down.shape[1]

    @property
    def scale(self) -> float:
        return self.alpha / self.rank

    def tensors(self) -> dict[str, Tensor]:
        """Everything that learns, by name, always in the same order."""
        return {
            f"{target}.{part}": tensor
            for target, change in self.changes.items()
            for part, tensor in (("down", change.down), ("up", change.up))
        }


@dataclass(frozen=True, slots=True, eq=False)
class TokenTree:
    """Token sequences with a common beginning, which is worked through once.

    Rows are filled up on the right; a row's tokens see the beginning, and those
    before them in the row. Flat positions count the beginning first, then row by row.
    """

    trunk: Tensor  # (P,) tokens
    branches: Tensor  # (B, S) tokens

    def flat(self, row: int, position: int) -> int:
        """The flat position of a sequence's token that belongs to its own row."""
        own = position - len(self.trunk)
        if not 0 <= own < self.branches.shape[1]:
            raise IndexError(f"position {position} is not in row {row} of its own")
        return len(self.trunk) + row * self.branches.shape[1] + own


def token_tree(sequences: Sequence[Sequence[int]], longest_trunk: int) -> TokenTree:
    """The tree of some sequences, with at most so many tokens in common."""
    trunk = min(longest_trunk, _common(sequences))
    width = max(len(sequence) for sequence in sequences) - trunk
    rows = [[*sequence[trunk:], *[0] * (width + trunk - len(sequence))] for sequence in sequences]
    return TokenTree(torch.tensor(sequences[0][:trunk], dtype=torch.long), torch.tensor(rows, dtype=torch.long))


class Llama:
    """The model of a GGUF file. Matrices are multiplied in `dtype`, everything between is float32."""

    def __init__(self, model: GgufModel, dtype: torch.dtype = torch.float32) -> None:
        self.shape = model.shape
        self.dtype = dtype
        self._embedding = torch.from_numpy(model.matrices["token_embd"])
        self._head = torch.from_numpy(model.matrices.get("output", model.matrices["token_embd"]))
        self._matrices = {
            name: torch.from_numpy(values).to(dtype)
            for name, values in model.matrices.items()
            if name.startswith("blk.")
        }
        self._norms = {name: torch.from_numpy(values) for name, values in model.norms.items()}

    def new_adapter(self, targets: Iterable[str], rank: int, alpha: float, seed: int) -> LowRankSettings:
        """Changes that change nothing yet: A is random with variance 1/(3 inputs), B zero, as in LoRA."""
        generator = torch.Generator().manual_seed(seed)
        changes: dict[str, LowRank] = {}
        for target in targets:
            outputs, inputs = self._matrices[f"blk.0.{target}"].shape
            down = torch.rand((self.shape.layers, rank, inputs), generator=generator) * 2.0 - 1.0
            up = torch.zeros((self.shape.layers, outputs, rank))
            changes[target] = LowRank((down / inputs**0.5).requires_grad_(), up.requires_grad_())
        return LowRankSettings(changes, alpha)

    def logits(self, tree: TokenTree, wanted: Tensor, adapter: LowRankSettings | None = None) -> Tensor:
        """Of the token after each of the flat positions `wanted` (N,): (N, vocabulary), float32."""
        trunk, (rows, width) = len(tree.trunk), tree.branches.shape
        turns = self._turns(torch.cat((torch.arange(trunk), torch.arange(trunk, trunk + width).repeat(rows))))
        sees = self._sight(trunk, width)
        state = functional.embedding(torch.cat((tree.trunk, tree.branches.flatten())), self._embedding)
        for layer in range(self.shape.layers):
            state = state + self._attention(state, layer, adapter, trunk, rows, turns, sees)
            state = state + self._feed_forward(state, layer, adapter)
        return functional.linear(self._normed(state[wanted], "output_norm", torch.float32), self._head)

    def _attention(
        self,
        state: Tensor,
        layer: int,
        adapter: LowRankSettings | None,
        trunk: int,
        rows: int,
        turns: Tensor,
        sees: tuple[Tensor, Tensor],
    ) -> Tensor:
        normed = self._normed(state, f"blk.{layer}.attn_norm", self.dtype)
        groups = self.shape.kv_heads
        queries, keys, values = (
            self._times(normed, layer, name, adapter).unflatten(-1, (-1, self.shape.head_width))
            for name in ("attn_q", "attn_k", "attn_v")
        )
        queries, keys = _turned(queries, turns), _turned(keys, turns)
        seen: list[Tensor] = []
        if trunk:
            seen += [_looked_up(queries[None, :trunk], keys[None, :trunk], values[None, :trunk], groups, sees[0])]
        before = [part[:trunk].expand(rows, -1, -1, -1) for part in (keys, values)]
        own = [part[trunk:].unflatten(0, (rows, -1)) for part in (queries, keys, values)]
        seen += [
            _looked_up(own[0], torch.cat((before[0], own[1]), 1), torch.cat((before[1], own[2]), 1), groups, sees[1])
        ]
        return self._times(torch.cat(seen), layer, "attn_output", adapter).float()

    def _feed_forward(self, state: Tensor, layer: int, adapter: LowRankSettings | None) -> Tensor:
        normed = self._normed(state, f"blk.{layer}.ffn_norm", self.dtype)
        gate = functional.silu(self._times(normed, layer, "ffn_gate", adapter))
        return self._times(gate * self._times(normed, layer, "ffn_up", adapter), layer, "ffn_down", adapter).float()

    def _times(self, state: Tensor, layer: int, name: str, adapter: LowRankSettings | None) -> Tensor:
        """The product with a matrix and with its change."""
        product = functional.linear(state, self._matrices[f"blk.{layer}.{name}"])
        if adapter is None or name not in adapter.changes:
            return product
        change = adapter.changes[name]
        inner = functional.linear(state, change.down[layer].to(self.dtype))
        return product + adapter.scale * functional.linear(inner, change.up[layer].to(self.dtype))

    def _normed(self, state: Tensor, name: str, dtype: torch.dtype) -> Tensor:
        return functional.rms_norm(state, (self.shape.width,), self._norms[name], self.shape.norm_epsilon).to(dtype)

    def _turns(self, positions: Tensor) -> Tensor:
        """Unit complex numbers (N, 1, head_width / 2) by which positions turn pairs of components."""
        pairs = torch.arange(0, self.shape.head_width, 2, dtype=torch.float64)
        angles = positions[:, None].double() * self.shape.rope_base ** (-pairs / self.shape.head_width)
        return torch.polar(torch.ones_like(angles), angles).to(torch.complex64)[:, None]

    def _sight(self, trunk: int, width: int) -> tuple[Tensor, Tensor]:
        """What is added to attention: 0 where a position sees another, else minus infinity; trunk, then branches.

        The heads that share keys stand below each other: (heads per key * positions, positions seen).
        """
        times = (self.shape.heads // self.shape.kv_heads, 1)
        hidden = torch.full((trunk + width, trunk + width), -torch.inf, dtype=self.dtype).triu(1)
        return hidden[:trunk, :trunk].repeat(times), hidden[trunk:].repeat(times)


def _looked_up(queries: Tensor, keys: Tensor, values: Tensor, groups: int, sees: Tensor) -> Tensor:
    """Attention of (B, S, heads, head_width) over (B, T, groups, head_width): (B * S, heads * head_width)."""
    rows, width, heads, _ = queries.shape
    folded = queries.unflatten(2, (groups, -1)).permute(0, 2, 3, 1, 4).flatten(2, 3)
    found = functional.scaled_dot_product_attention(
        folded, keys.transpose(1, 2), values.transpose(1, 2), attn_mask=sees
    )
    return found.unflatten(2, (heads // groups, width)).permute(0, 3, 1, 2, 4).reshape(rows * width, -1)


def _turned(states: Tensor, turns: Tensor) -> Tensor:
    """(N, heads, head_width) turned pair by pair."""
    pairs = torch.view_as_complex(states.float().unflatten(-1, (-1, 2)))
    return torch.view_as_real(pairs * turns).flatten(-2).to(states.dtype)


def _common(sequences: Sequence[Sequence[int]]) -> int:
    """How many tokens all sequences begin with."""
    ordered = sorted(tuple(sequence) for sequence in sequences)
    first, last = ordered[0], ordered[-1]
    return next((at for at, pair in enumerate(zip(first, last, strict=False)) if pair[0] != pair[1]), len(first))
