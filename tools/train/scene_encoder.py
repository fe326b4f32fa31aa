"""Scene encoder: tokens of the ego, the agents and the map that know of each other; for GameFormer and DTPP.

A recipe takes its inputs from `interplan_learned.scene` and builds on the tokens:

    size = EncoderSize(width=64, heads=4, layers=2)
    encoder = SceneEncoder(size)
    scene = encoder(batch["ego"], batch["agents"], batch["lanes"], batch["crosswalks"])
    seen = AttentionLayer(size)(queries, scene.tokens, scene.empty)  # (B, Q, 64)

Everything here can be written as ONNX, for any number of samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import torch
from torch import Tensor, nn

from interplan_learned.scene import AGENT_CHANNELS, EGO_CHANNELS, LANE_CHANNELS
from tools.train.recipe import TrainingSettings

POOLED_POINTS: Final = 10
"""So many points of a lane or crosswalk make one token, as published."""
_SCALES: Final = {"x": 20.0, "y": 20.0, "vx": 10.0, "vy": 10.0, "ax": 3.0, "ay": 3.0, "length": 5.0, "width": 2.0}
"""Inputs are divided by these (metres and seconds), so that all are about 1."""
_NEVER: Final = -1e4
"""Stands for minus infinity among logits of an attention, also in half precision."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EncoderSize:
    """The published numbers are width 256, 8 heads, 3 layers."""

    width: int = 256
    heads: int = 8
    layers: int = 3
    dropout: float = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class NetworkSize:
    """Of a network that builds on the encoder, and how it is trained."""

    encoder: EncoderSize
    settings: TrainingSettings


class EncodedScene(NamedTuple):
    """What is known of a batch of scenes."""

    tokens: Tensor
    """(B, S, width): the ego, then the agents in their order, then pieces of lanes and of crosswalks."""
    empty: Tensor
    """(B, S) bool: tokens of rows that do not exist; nobody attends to them. The ego's is never empty."""


class SceneEncoder(nn.Module):
    """An LSTM per road user, a shared perceptron per point with a maximum over ten of them, then a transformer."""

    def __init__(self, size: EncoderSize) -> None:
        super().__init__()
        self.ego = TrackEncoder(EGO_CHANNELS, size.width)
        self.agents = TrackEncoder(AGENT_CHANNELS, size.width)
        self.lanes = LineEncoder(LANE_CHANNELS, size.width)
        self.crosswalks = LineEncoder(("x", "y", "yaw"), size.width)
        self.layers = nn.ModuleList(AttentionLayer(size) for _ in range(size.layers))
        self.norm = nn.LayerNorm(size.width)

    def forward(self, ego: Tensor, agents: Tensor, lanes: Tensor, crosswalks: Tensor) -> EncodedScene:
        """From the arrays of `scene.scene_inputs`."""
        lane_tokens, lane_empty = self.lanes(lanes)
        crosswalk_tokens, crosswalk_empty = self.crosswalks(crosswalks)
        agent_tokens, agent_empty = self.agents(agents)
        ego_token, ego_empty = self.ego(ego[:, None])
        tokens = torch.cat((ego_token, agent_tokens, lane_tokens, crosswalk_tokens), dim=1)
        empty = torch.cat((torch.zeros_like(ego_empty), agent_empty, lane_empty, crosswalk_empty), dim=1)
        for layer in self.layers:
            tokens = layer(tokens, tokens, empty)
        return EncodedScene(self.norm(tokens), empty)


class TrackEncoder(nn.Module):
    """The pasts of road users, one token each: two layers of LSTM, as published."""

    def __init__(self, channels: tuple[str, ...], width: int) -> None:
        super().__init__()
        self.scale = Scale(channels)
        self.past = nn.LSTM(len(channels), width, num_layers=2, batch_first=True)

    def forward(self, tracks: Tensor) -> tuple[Tensor, Tensor]:
        """(B, N, width) tokens and (B, N) bool whether they are empty, from (B, N, frames, C)."""
        rows, frames, channels = tracks.shape[1:]
        seen, _ = self.past(self.scale(tracks).reshape(-1, frames, channels))
        return seen[:, -1].reshape(-1, rows, seen.shape[-1]), is_zero(tracks[:, :, -1])


class LineEncoder(nn.Module):
    """Polylines as tokens: a perceptron for each point, then the maximum over every ten points, as published."""

    def __init__(self, channels: tuple[str, ...], width: int) -> None:
        super().__init__()
        self.scale = Scale(channels)
        self.point = nn.Sequential(
            nn.Linear(len(channels), width // 4),
            nn.ReLU(),
            nn.Linear(width // 4, width // 2),
            nn.ReLU(),
            nn.Linear(width // 2, width),
        )

    def forward(self, lines: Tensor) -> tuple[Tensor, Tensor]:
        """(B, K, width) tokens and (B, K) bool whether they are empty, from (B, N, points, C); K = N points / 10."""
        rows, points, channels = lines.shape[1:]
        pieces = lines.reshape(-1, rows * points // POOLED_POINTS, POOLED_POINTS, channels)
        return self.point(self.scale(pieces)).amax(dim=2), is_zero(pieces.flatten(2))


class AttentionLayer(nn.Module):
    """Queries that look at tokens and think about it: attention and a perceptron, each added to what it was given."""

    def __init__(self, size: EncoderSize) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(size.width)
        self.attention = Attention(size.width, size.heads)
        self.perceptron = Perceptron(size.width, size.dropout)
        self.dropout = nn.Dropout(size.dropout)

    def forward(self, queries: Tensor, tokens: Tensor, empty: Tensor) -> Tensor:
        """(B, Q, width) from queries (B, Q, width), tokens (B, K, width) and `empty` as `Attention` wants it."""
        seen = self.attention(self.norm(queries), self.norm(tokens), empty)
        return self.perceptron(queries + self.dropout(seen))


class Perceptron(nn.Module):
    """Four times as wide inside; normalised before and added to what it was given."""

    def __init__(self, width: int, dropout: float) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.LayerNorm(width),
            nn.Linear(width, 4 * width),
            nn.GELU(),
            nn.Linear(4 * width, width),
        )
        self.dropout = nn.Dropout(dropout)

    def forward(self, values: Tensor) -> Tensor:
        return values + self.dropout(self.layers(values))


class Attention(nn.Module):
    """Multi-head attention whose masks may differ from query to query."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads, self.of_head = heads, width // heads
        self.query = nn.Linear(width, width)
        self.key_value = nn.Linear(width, 2 * width)
        self.out = nn.Linear(width, width)

    def forward(self, queries: Tensor, tokens: Tensor, empty: Tensor) -> Tensor:
        """(B, Q, width) from queries (B, Q, width) and tokens (B, K, width).

        `empty` is bool, (B, K) or (B, Q, K): what is not looked at. A query
        that may look at nothing gets the average of everything.
        """
        query = self._by_head(self.query(queries))
        key, value = (self._by_head(part) for part in self.key_value(tokens).chunk(2, dim=-1))
        hidden = empty[:, None, None] if empty.dim() == 2 else empty[:, None]
        logits = query @ key.transpose(-1, -2) * self.of_head**-0.5
        seen = logits.masked_fill(hidden, _NEVER).softmax(dim=-1) @ value
        return self.out(seen.transpose(1, 2).flatten(2))

    def _by_head(self, values: Tensor) -> Tensor:
        return values.reshape(-1, values.shape[1], self.heads, self.of_head).transpose(1, 2)


class Scale(nn.Module):
    """Divides channels by what they usually are."""

    scale: Tensor

    def __init__(self, channels: tuple[str, ...]) -> None:
        super().__init__()
        scale = torch.tensor([_SCALES.get(name, 1.0) for name in channels])
        self.register_buffer("scale", scale, persistent=False)

    def forward(self, values: Tensor) -> Tensor:
        return values / self.scale


def is_zero(rows: Tensor) -> Tensor:
    """(B, N) bool: rows (B, N, C) in which every number is 0, those that do not exist."""
    return rows.abs().amax(dim=-1) == 0.0


def sinusoids(points: int, width: int) -> Tensor:
    """(points, width) sines and cosines in turn, of wavelengths from 2 pi to 20000 pi points (Vaswani et al. 2017)."""
    rate = 1e4 ** (-torch.arange(0, width, 2) / width)
    angle = torch.arange(points)[:, None] * rate
    return torch.stack((angle.sin(), angle.cos()), dim=-1).flatten(1)


def pose_differences(poses: Tensor, wanted: Tensor) -> Tensor:
    """(..., 3) by how much poses are off in x, y and yaw; a full turn is none."""
    off = poses - wanted
    turned = torch.remainder(off[..., 2:] + torch.pi, 2.0 * torch.pi) - torch.pi
    return torch.cat((off[..., :2], turned), dim=-1)
