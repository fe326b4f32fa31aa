"""GC-PGP's network and loss: a graph encoder with a policy over its edges, and a decoder of its traversals."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Final, cast

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from interplan_learned.card import Size
from interplan_learned.driving import POSES
from interplan_learned.gc_pgp.inputs import FIELDS, POLICY_INPUTS, inputs, kept
from interplan_learned.gc_pgp.local_graph import NONE, MapNodes, map_nodes
from interplan_learned.gc_pgp.plans import chances, clusters, plans, sampled
from interplan_learned.gc_pgp.sizes import EDGES, LATENTS, PATH_NODES, SIZES, Dimensions
from interplan_sumo.dataset.columns import Columns
from interplan_sumo.dataset.reading import Dataset
from interplan_sumo.world.geometry import Ints
from tools.train.augment import Perturbation, augmented
from tools.train.metrics import wanted_poses
from tools.train.recipe import Batch, GraphCall, Recipe, TrainingSettings
from tools.train.scene_encoder import sinusoids

_EMBEDDED, _CODE, _HIDDEN = 16, 32, 128
EXPERT_SHARE: Final = 20 / 90
"""So much of the training decodes the expert's traversals, the rest sampled ones (PGP's: 20 of 90 epochs)."""
_POLICY_WEIGHT = 0.5
_LENGTH_M = 20.0
"""Coordinates go in and come out in units of this; speeds of half of it."""
_NEVER = -1e9


def recipe(
    size: Size = "compact", perturbed: float = 0.5, agents_dropped: float = 0.5, past_dropped: float = 0.2
) -> Recipe:
    """GC-PGP, compact by default: what shrinks is told in `gc_pgp.sizes`; the method is the published one.

    `perturbed`, `agents_dropped` and `past_dropped` are the shares of samples
    that start elsewhere, lose half of their agents, or know no past.
    """
    numbers = SIZES[size]
    return Recipe(
        planner="gc_pgp",
        what="GC-PGP: traversals of the lane graph from a learned policy, decoded with noise and clustered",
        size=size,
        options={"perturbed": perturbed, "agents_dropped": agents_dropped, "past_dropped": past_dropped},
        fields=(*FIELDS, "expert_nodes", "drive"),
        inputs=inputs,
        targets=targets,
        make_model=partial(GcPgp, numbers),
        loss=partial(loss, size=numbers),
        poses=partial(poses, size=numbers),
        graphs=partial(graphs, size=numbers),
        keep=partial(keep, size=numbers),
        augmented=partial(
            augmented,
            perturbation=Perturbation(share=perturbed),
            agents_dropped=agents_dropped,
            past_dropped=past_dropped,
        ),
        settings=TrainingSettings(epochs=10, batch=64, learning_rate=1e-3, patience=8),
    )


# --- network -------------------------------------------------------------------------------------


class GcPgp(nn.Module):
    """Encoder, policy and decoder."""

    def __init__(self, size: Dimensions) -> None:
        super().__init__()
        self.policy = Policy()
        self.decoder = Decoder(size)


class Policy(nn.Module):
    """Codes of the ego and the nodes, and a score for every edge and for the end at every node."""

    def __init__(self) -> None:
        super().__init__()
        self.ego = SequenceEncoder((_LENGTH_M, _LENGTH_M, _LENGTH_M / 2, 1.0, 1.0))
        self.agents = SequenceEncoder((_LENGTH_M, _LENGTH_M, _LENGTH_M / 2, 1.0, 1.0, 1.0))
        self.nodes = SequenceEncoder((_LENGTH_M, _LENGTH_M, 1.0, 1.0, 1.0, 1.0))
        self.agent_attention = HeadAttention(_CODE)
        self.joined = nn.Linear(2 * _CODE, _CODE)
        self.graph = nn.ModuleList((HeadAttention(_CODE), HeadAttention(_CODE)))
        self.from_ego = nn.Linear(_CODE, _CODE)
        self.from_source, self.from_target = (nn.Linear(_CODE, _CODE, bias=False) for _ in range(2))
        self.from_kind = nn.Embedding(2, _CODE)
        self.edge_score = nn.Sequential(nn.LeakyReLU(), nn.Linear(_CODE, _CODE), nn.LeakyReLU(), nn.Linear(_CODE, 1))
        self.end_score = nn.Sequential(
            nn.Linear(2 * _CODE, _CODE), nn.LeakyReLU(), nn.Linear(_CODE, _CODE), nn.LeakyReLU(), nn.Linear(_CODE, 1)
        )

    def forward(
        self, ego: Tensor, agents: Tensor, agents_valid: Tensor, nodes: Tensor, nodes_valid: Tensor,
        near_agents: Tensor, adjacent: Tensor, edges: Tensor, edge_kinds: Tensor,
    ) -> tuple[Tensor, Tensor, Tensor]:  # fmt: skip
        """Scores (B, M, EDGES + 1), `ego_code` (B, 32) and `node_codes` (B, M, 32) from arrays of `inputs`.

        Scores of edges that there are not mean nothing.
        """
        ego_code = self.ego(ego)
        agent_codes = self.agents(agents) * agents_valid[..., None]
        codes = self.nodes(nodes) * nodes_valid[..., None]
        seen = self.agent_attention(codes, agent_codes, near_agents)
        codes = functional.leaky_relu(self.joined(torch.cat((codes, seen), dim=-1)))
        for layer in self.graph:
            codes = codes + layer(codes, codes, adjacent)
        return torch.cat((self._edges(ego_code, codes, edges, edge_kinds), self._ends(ego_code, codes)), -1), *(
            ego_code, codes,
        )  # fmt: skip

    def _edges(self, ego_code: Tensor, codes: Tensor, edges: Tensor, kinds: Tensor) -> Tensor:
        """(B, M, EDGES): a perceptron over ego, source, target and kind, its first layer taken apart."""
        rows = edges.clamp(min=0).flatten(1)[..., None].expand(-1, -1, _CODE)
        targets = torch.gather(self.from_target(codes), 1, rows).reshape(*edges.shape[:2], EDGES, _CODE)
        sources = (self.from_source(codes) + self.from_ego(ego_code)[:, None])[:, :, None]
        return self.edge_score(targets + sources + self.from_kind(kinds))[..., 0]

    def _ends(self, ego_code: Tensor, codes: Tensor) -> Tensor:
        return self.end_score(torch.cat((codes, ego_code[:, None].expand_as(codes)), dim=-1))


class Decoder(nn.Module):
    """Trajectories from traversals: the ego attends to the nodes passed, in order, and noise does the rest."""

    places: Tensor

    def __init__(self, size: Dimensions) -> None:
        super().__init__()
        self.heads, self.width = size.heads, size.attention
        self.query = nn.Linear(_CODE, self.width)
        self.key, self.value = (nn.Linear(_CODE, self.width, bias=False) for _ in range(2))
        self.register_buffer("places", sinusoids(PATH_NODES, _CODE), persistent=False)
        self.head = nn.Sequential(
            nn.Linear(self.width + _CODE + LATENTS, _HIDDEN), nn.LeakyReLU(), nn.Linear(_HIDDEN, POSES * 2)
        )

    def forward(self, ego_code: Tensor, node_codes: Tensor, paths: Tensor, noise: Tensor) -> Tensor:
        """(B, T, POSES, 2) from traversals (B, T, PATH_NODES), or (B, 1, PATH_NODES) for all, and noise (B, T, 5)."""
        passed = self._passed(ego_code, node_codes, paths).expand(-1, noise.shape[1], -1)
        ego = ego_code[:, None].expand(-1, noise.shape[1], -1)
        found = self.head(torch.cat((passed, ego, noise), dim=-1))
        return found.reshape(*noise.shape[:2], POSES, 2) * _LENGTH_M

    def _passed(self, ego_code: Tensor, node_codes: Tensor, paths: Tensor) -> Tensor:
        """(B, T, width): attention of the ego over each traversal; 0 for an empty one.

        Keys and values are linear in the node's code plus its place: both parts are made once, then gathered.
        """
        each = self.width // self.heads
        there, rows = (paths >= 0)[..., None], paths.clamp(min=0).flatten(1)[..., None]
        query = self.query(ego_code).unflatten(1, (1, self.heads, each))
        of_nodes, of_places = (
            (self.key(codes).unflatten(-1, (self.heads, each)) * query).sum(dim=-1) / math.sqrt(each)
            for codes in (node_codes, self.places)
        )
        weights = torch.gather(of_nodes, 1, rows.expand(-1, -1, self.heads)).reshape(*paths.shape, self.heads)
        weights = weights + of_places[:, None]
        weights = torch.softmax(weights.masked_fill(~there, _NEVER), dim=2) * there
        values = torch.gather(self.value(node_codes), 1, rows.expand(-1, -1, self.width))
        values = values.reshape(*paths.shape, self.width) + self.value(self.places)
        return (values.unflatten(-1, (self.heads, each)) * weights[..., None]).sum(dim=2).flatten(2)


class SequenceEncoder(nn.Module):
    """A code for a sequence: an embedding and a GRU, whose last state it is."""

    units: Tensor

    def __init__(self, units: tuple[float, ...]) -> None:
        super().__init__()
        self.register_buffer("units", torch.tensor(units), persistent=False)
        self.embedded = nn.Sequential(nn.Linear(len(units), _EMBEDDED), nn.LeakyReLU())
        self.gru = nn.GRU(_EMBEDDED, _CODE, batch_first=True)

    def forward(self, rows: Tensor) -> Tensor:
        """(..., 32) from rows (..., T, C)."""
        flat = rows.reshape(-1, *rows.shape[-2:]) / self.units
        return self.gru(self.embedded(flat))[1][0].reshape(*rows.shape[:-2], _CODE)


class HeadAttention(nn.Module):
    """One head; rows that may attend to nothing get 0."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.query, self.key, self.value = (nn.Linear(width, width) for _ in range(3))

    def forward(self, asking: Tensor, asked: Tensor, allowed: Tensor) -> Tensor:
        """(B, M, width) from (B, M, width) and (B, A, width), where `allowed` (B, M, A)."""
        weights = self.query(asking) @ self.key(asked).transpose(1, 2) / math.sqrt(asking.shape[-1])
        weights = torch.softmax(weights.masked_fill(~allowed, _NEVER), dim=-1) * allowed
        return weights @ self.value(asked)


# --- what it learns from -------------------------------------------------------------------------


def keep(columns: Columns, dataset: Dataset, size: Dimensions) -> Columns:
    """The lane graph around each ego, and the expert's way through it.

    `expert_path` (S, PATH_NODES) its nodes, NONE beyond the last; `expert_edge`
    (S, M) which edge it takes out of each node, EDGES where it ends, NONE where
    it does not pass.
    """
    names = [dataset.drives[drive].map for drive in columns["drive"].tolist()]
    nodes: dict[str, MapNodes] = {
        name: map_nodes(dataset.lane_graph(name), size.points) for name in dict.fromkeys(names)
    }
    held = kept(columns, [nodes[name] for name in names], size)
    whole = columns["ego_future"][:, -1, 3] > 0.5
    ways = [
        expert_way(*each)
        for each in zip(columns["expert_nodes"], held.pop("node_rows"), held["edges"], whole, strict=True)
    ]
    return {
        **held,
        "ego_future": columns["ego_future"],
        "expert_path": np.stack([path for path, _ in ways]).astype(np.int16),
        "expert_edge": np.stack([edge for _, edge in ways]).astype(np.int8),
    }


def expert_way(expert_nodes: Ints, node_rows: Ints, edges: Ints, whole: bool) -> tuple[Ints, Ints]:
    """`expert_path` (PATH_NODES,) and `expert_edge` (M,) of one sample.

    `expert_nodes` (81,) are nodes of the map, `node_rows` (M,) those around the
    ego. The way ends where it leaves these or jumps; only that of a `whole`
    future has an end that the expert chose.
    """
    place = {node: row for row, node in enumerate(node_rows.tolist()) if node != NONE}
    passed = [place.get(node, NONE) for node in expert_nodes.tolist() if node != NONE]
    path, edge = np.full(PATH_NODES, NONE, dtype=np.int64), np.full(len(node_rows), NONE, dtype=np.int64)
    if not passed or passed[0] == NONE:
        return path, edge
    way = passed[:1]
    for node in passed[1:]:
        if node == way[-1]:
            continue
        taken = np.flatnonzero((edges[way[-1]] == node) & (node != NONE))
        if not len(taken) or len(way) == PATH_NODES:
            break
        edge[way[-1]] = taken[0]
        way.append(node)
    else:
        if whole:
            edge[way[-1]] = EDGES
    path[: len(way)] = way
    return path, edge


def targets(held: Columns) -> Columns:
    """`wanted` (B, POSES, 2) and `wanted_valid` (B, POSES), `expert_path` and `expert_edge`."""
    wanted, valid = wanted_poses(held["ego_future"])
    labels = {name: held[name].astype(np.int64) for name in ("expert_path", "expert_edge")}
    return {"wanted": wanted[..., :2], "wanted_valid": valid, **labels}


def loss(model: nn.Module, batch: Batch, done: float, size: Dimensions) -> Tensor:
    """The smallest mean error among the modes, and the negative log likelihood of the expert's edges.

    Modes are means of clusters. The first `EXPERT_SHARE` of the training decodes
    the expert's traversals, the rest sampled ones, without the route mask.
    """
    network = cast(GcPgp, model)
    scores, ego_code, node_codes = network.policy(*(batch[name] for name in POLICY_INPUTS))
    noise = torch.randn(len(scores), size.train_traversals, LATENTS, device=scores.device)
    paths = batch["expert_path"][:, None] if done < EXPERT_SHARE else _sampled_paths(scores, batch, size)
    found = network.decoder(ego_code, node_codes, paths, noise)
    return _least_error(found, batch, size.clusters) + _POLICY_WEIGHT * _edge_loss(scores, batch)


def _sampled_paths(scores: Tensor, batch: Batch, size: Dimensions) -> Tensor:
    draws = torch.rand(len(scores), size.train_traversals, PATH_NODES, dtype=torch.float64).numpy()
    edges, starts = batch["edges"].cpu().numpy(), batch["starts"].cpu().numpy()
    chance = chances(scores.detach().cpu().numpy(), edges != NONE)
    return torch.from_numpy(sampled(chance, edges, starts, draws)).to(scores.device)


def _least_error(found: Tensor, batch: Batch, count: int) -> Tensor:
    """Mean over the samples of the least mean distance (m) of a mode from the way that was driven."""
    kind = torch.from_numpy(clusters(found.detach().cpu().numpy(), count)).to(found.device)
    member = functional.one_hot(kind, count).to(found.dtype)
    held = member.sum(dim=1)
    modes = (member.transpose(1, 2) @ found.flatten(2) / held.clamp(min=1.0)[..., None]).unflatten(2, (POSES, 2))
    off_m = torch.sqrt(((modes - batch["wanted"][:, None]) ** 2).sum(dim=-1) + 1e-6)
    valid = batch["wanted_valid"][:, None]
    errors = (off_m * valid).sum(dim=-1) / valid.sum(dim=-1)
    return errors.masked_fill(held == 0, torch.inf).min(dim=1).values.mean()


def _edge_loss(scores: Tensor, batch: Batch) -> Tensor:
    """Negative log likelihood of the edges, and ends, that the expert took, averaged over them."""
    there = functional.pad(batch["edges"] >= 0, (0, 1), value=True)
    likely = torch.log_softmax(scores.masked_fill(~there, _NEVER), dim=-1)
    wanted = batch["expert_edge"]
    taken = torch.gather(likely, 2, wanted.clamp(min=0)[..., None])[..., 0]
    passed = wanted >= 0
    return -(taken * passed).sum() / passed.sum().clamp(min=1)


def poses(model: nn.Module, batch: Batch, size: Dimensions) -> Tensor:
    """(B, POSES, 3) as the planner drives them: the route mask is on."""
    network = cast(GcPgp, model)
    scores, ego_code, node_codes = network.policy(*(batch[name] for name in POLICY_INPUTS))
    given = {name: batch[name].cpu().numpy() for name in ("edges", "allowed", "allowed_starts")}

    def decoded(paths: Ints, noise: np.ndarray) -> np.ndarray:
        found = network.decoder(ego_code, node_codes, *(_as_tensor(each, scores) for each in (paths, noise)))
        return found.detach().cpu().numpy()

    return _as_tensor(plans(given, scores.detach().cpu().numpy(), decoded, size), scores).to(scores.dtype)


def graphs(model: nn.Module, batch: Batch, size: Dimensions) -> Mapping[str, GraphCall]:
    """`policy` and `decoder`; between them the planner samples its traversals."""
    network = cast(GcPgp, model)
    arguments = {name: batch[name] for name in POLICY_INPUTS}
    with torch.no_grad():
        _, ego_code, node_codes = network.policy(*arguments.values())
    repeats = (1, size.drive_traversals, 1)
    paths = batch["expert_path"][:, None].repeat(repeats)
    noise = torch.linspace(-1.0, 1.0, LATENTS, device=ego_code.device).repeat(len(paths), size.drive_traversals, 1)
    codes = {"ego_code": ego_code, "node_codes": node_codes}
    return {
        "policy": GraphCall(module=network.policy, arguments=arguments, outputs=("scores", *codes)),
        "decoder": GraphCall(
            module=network.decoder, arguments={**codes, "paths": paths, "noise": noise}, outputs=("trajectories",)
        ),
    }


def _as_tensor(values: np.ndarray, like: Tensor) -> Tensor:
    return torch.tensor(values, device=like.device)
