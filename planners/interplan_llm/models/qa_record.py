"""Exchange: one question of a drive with what came of it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from interplan_llm.models.protocol import ModelFailure, Reply, Request


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
