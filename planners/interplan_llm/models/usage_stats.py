"""What the questions of a drive or a run came to: how many, how they failed, tokens, time."""

from __future__ import annotations

from collections import Counter
from typing import Any

from interplan_llm.models.protocol import CAUSES, Cause, ModelFailure, Reply


class Ledger:
    """Counts. A score that rests on a language model is reported beside them."""

    def __init__(self) -> None:
        self.queries = 0
        self.fallbacks: Counter[Cause] = Counter()
        self.prompt_tokens = 0
        self.completion_tokens = 0
        self.latency_sum_s = 0.0
        self.latency_max_s = 0.0
        """Latencies are those of replies and of failures."""

    def answered(self, reply: Reply) -> None:
        """Count a question that got an answer."""
        self._count(reply, reply.latency_s)

    def failed(self, failure: ModelFailure) -> None:
        """Count a question that got none, so that the planner had to fall back on something else."""
        self.fallbacks[failure.cause] += 1
        self._count(failure.reply, failure.latency_s)

    @property
    def fallback_share(self) -> float:
        """Fallbacks per query; above a few percent, a score says little about the model."""
        return self.fallbacks.total() / self.queries if self.queries else 0.0

    def add(self, other: Ledger) -> None:
        """Take in the counts of another."""
        self.queries += other.queries
        self.fallbacks.update(other.fallbacks)
        self.prompt_tokens += other.prompt_tokens
        self.completion_tokens += other.completion_tokens
        self.latency_sum_s += other.latency_sum_s
        self.latency_max_s = max(self.latency_max_s, other.latency_max_s)

    def as_json(self) -> dict[str, Any]:
        """All counts; every cause is named, also those that did not occur."""
        return {
            "queries": self.queries,
            "fallbacks": {cause: self.fallbacks[cause] for cause in CAUSES},
            "fallback_share": self.fallback_share,
            "prompt_tokens": self.prompt_tokens,
            "completion_tokens": self.completion_tokens,
            "latency_sum_s": self.latency_sum_s,
            "latency_max_s": self.latency_max_s,
        }

    def _count(self, reply: Reply | None, latency_s: float) -> None:
        self.queries += 1
        self.latency_sum_s += latency_s
        self.latency_max_s = max(self.latency_max_s, latency_s)
        if reply is not None:
            self.prompt_tokens += reply.prompt_tokens
            self.completion_tokens += reply.completion_tokens
