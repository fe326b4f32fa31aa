"""What came of the questions of a drive: each of them, and how many, how they failed, tokens and time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from interplan_llm.models.protocol import CAUSES, ModelFailure, Reply, Request


@dataclass(frozen=True, slots=True)
class Exchange:
    """What a planner asked at a step, what it was told, and what it made of that."""

    time_s: float
    """Of the episode."""
    request: Request
    reply: Reply | None
    """None if the question failed without any."""
    failure: ModelFailure | None
    taken: str
    """What the planner then did."""

    def as_json(self) -> dict[str, Any]:
        """Plain data: the question, the answer with its cost, the failure with its cause."""
        return {
            "time_s": self.time_s,
            "messages": [asdict(message) for message in self.request.messages],
            "options": None if self.request.choices is None else list(self.request.choices),
            "reply": None if self.reply is None else asdict(self.reply),
            "failure": None if self.failure is None else {"cause": self.failure.cause, "message": self.failure.message},
            "taken": self.taken,
        }


def usage_stats(exchanges: Sequence[Exchange]) -> dict[str, Any]:
    """Counts; a score that rests on a language model is reported beside them.

    Every cause of a fallback is named, also those that did not occur; above a
    few percent of them, a score says little about the model.
    """
    replies = [each.reply for each in exchanges if each.reply is not None]
    fallbacks = Counter(each.failure.cause for each in exchanges if each.failure is not None)
    latencies_s = [told.latency_s for each in exchanges if (told := each.failure or each.reply)]
    return {
        "queries": len(exchanges),
        "fallbacks": {cause: fallbacks[cause] for cause in CAUSES},
        "fallback_share": fallbacks.total() / len(exchanges) if exchanges else 0.0,
        "prompt_tokens": sum(reply.prompt_tokens for reply in replies),
        "completion_tokens": sum(reply.completion_tokens for reply in replies),
        "latency_sum_s": sum(latencies_s, 0.0),
        "latency_max_s": max(latencies_s, default=0.0),
    }
